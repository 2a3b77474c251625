"""``wheelsoil view`` as a program: its port, its address, its end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPException
from pathlib import Path
from types import SimpleNamespace

import pytest
from cli_support import invoke
from view_client import START, Program, taken_from, viewing

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken_from(ROOT / "recordings" / "clay", tmp_path_factory.mktemp("command") / "clay", 1)


@contextmanager
def occupied(port: int) -> Iterator[int]:
    """A port that somebody listens on, this test or another program."""
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(("127.0.0.1", port))
            taken.listen()
        except OSError:
            assert port
        yield taken.getsockname()[1]


def test_a_port_that_was_asked_for_and_is_taken_is_a_fault(folder: Path) -> None:
    with occupied(0) as port:
        result = invoke("view", folder, "--no-browser", "--port", port)
    assert result.code == 4
    assert f"port {port} is taken" in result.err and "analyst's page" in result.err and "next:" in result.err


@pytest.mark.slow
def test_where_the_usual_port_is_taken_the_next_free_one_is_and_a_browser_opens_it(
    folder: Path, tmp_path: Path
) -> None:
    script, told = tmp_path / "browser", tmp_path / "told"
    script.write_text(f'#!/bin/sh\necho "$1" >> {told}\n')
    script.chmod(0o755)
    shown = {"DISPLAY": ":7", "BROWSER": f"{script} %s"}
    with occupied(8200), viewing(folder, port=None, browser=True, **shown) as view:
        assert 8200 < view.port < 8220
        assert view.ask("GET", "/api/list").status == 200
        until = time.monotonic() + 60
        while not told.exists() or not told.read_text().endswith("\n"):
            assert time.monotonic() < until
            time.sleep(0.02)
        assert told.read_text() == f"{view.address}\n"


class _EndedByCtrlC:
    """A server that is ended as soon as it runs."""

    ended_by = signal.SIGINT

    def __init__(self, *_: object) -> None:
        pass

    def handle_exit(self, *_: object) -> None:
        """Do nothing."""

    async def serve(self, sockets: list[socket.socket]) -> None:
        """Return at once."""
        assert sockets


@pytest.mark.parametrize(("given", "display", "opens"), [((), ":7", 1), ((), "", 0), (("--no-browser",), ":7", 0)])
def test_no_browser_is_opened_without_a_display_or_where_none_is_wanted(
    folder: Path, monkeypatch: pytest.MonkeyPatch, given: tuple[str, ...], display: str, opens: int
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("wheelsoil.view.server.webbrowser", SimpleNamespace(open=opened.append))
    monkeypatch.setattr("wheelsoil.view.server.server_of", _EndedByCtrlC)
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setenv("WAYLAND_DISPLAY", "")
    result = invoke("view", folder, "--port", 0, *given)
    assert result.code == 130 and "analyst's page: http://127.0.0.1:" in result.err
    until = time.monotonic() + 60
    while len(opened) < opens:  # it is opened by a thread of its own
        assert time.monotonic() < until
        time.sleep(0.01)
    time.sleep(0.05)
    assert len(opened) == opens


def test_an_address_of_another_machine_is_a_fault(folder: Path) -> None:
    result = invoke("view", folder, "--no-browser", "--host", "192.0.2.1", "--port", 0)
    assert result.code == 4 and "cannot listen" in result.err


def test_a_token_that_is_too_short_is_a_fault(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text("short\n")
    result = invoke("view", folder, "--no-browser", "--port", 0, "--token-file", file)
    assert result.code == 2 and "token" in result.err


@pytest.mark.parametrize(
    ("args", "code"), [(["nowhere"], 3), (["nowhere.mcap"], 3), ([], 2), (["--soil", "cheese", "."], 2)]
)
def test_what_cannot_be_opened_is_reported_before_a_page_is(
    args: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke("view", "--no-browser", "--port", 0, *args)
    assert result.code == code
    assert "http://" not in result.err


def test_ctrl_c_leaves_nothing_behind_and_waits_for_no_fit_or_diagnosis(folder: Path, tmp_path: Path) -> None:
    asked: list[threading.Thread] = []
    answers: list[int] = []
    with viewing(folder, TMPDIR=str(tmp_path)) as view:
        view.settled()
        [scratch] = tmp_path.glob("wheelsoil-view-*")
        assert [path.suffix for path in scratch.iterdir()] == [".pickle"]
        assert scratch.stat().st_mode & 0o077 == 0
        assert view.tell("/api/diagnose", campaign="c1").status == 202
        for _ in range(12):  # one after the other
            thread = threading.Thread(target=_ask_for_a_fit, args=(view, answers))
            thread.start()
            asked.append(thread)
        children = _children(view.process.pid)
        assert len(children) >= 2
    done = sum(answer == 200 for answer in answers)
    assert done < len(asked)  # the last of them were not waited for
    for thread in asked:
        thread.join()
    assert not list(tmp_path.glob("wheelsoil-view-*"))
    _gone(children)


def test_sigterm_ends_it_with_its_helpers(folder: Path, tmp_path: Path) -> None:
    process = _started(folder, tmp_path)
    children = _helpers(process)
    process.send_signal(signal.SIGTERM)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == 143 and "Traceback" not in rest
    assert not list(tmp_path.glob("wheelsoil-view-*"))
    _gone(children)


_SIGTERM_BEFORE_THE_LOOP = """
import asyncio.events as events, signal
from wheelsoil.cli.app import main
make = events.new_event_loop
events.new_event_loop = lambda: signal.raise_signal(signal.SIGTERM) or make()
main()
"""


@pytest.mark.slow
def test_sigterm_while_the_page_starts_says_nothing(folder: Path, tmp_path: Path) -> None:
    process = _started(folder, tmp_path, _SIGTERM_BEFORE_THE_LOOP)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == 143
    assert not rest.removeprefix("Ctrl-C ends\n")  # which may have been read with the address


@pytest.mark.slow
def test_helpers_do_not_outlive_a_page_that_is_killed(folder: Path, tmp_path: Path) -> None:
    process = _started(folder, tmp_path)
    children = _helpers(process)
    process.kill()
    process.communicate(timeout=60)
    _gone(children)


def _ask_for_a_fit(view: Program, answers: list[int]) -> None:
    with suppress(OSError, HTTPException):
        answers.append(view.tell("/api/fit", campaign="c1").status)


def _started(folder: Path, scratch: Path, code: str = START) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", code, "view", str(folder), "--no-browser", "--port", "0"],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(scratch)},
    )
    assert process.stderr is not None
    assert process.stderr.readline().startswith("analyst's page: http://127.0.0.1:")
    return process


def _helpers(process: subprocess.Popen[str]) -> list[int]:
    """The processes that read its runs."""
    until = time.monotonic() + 60
    while not (children := _children(process.pid)):
        assert time.monotonic() < until
        time.sleep(0.02)
    return children


def _children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def _gone(pids: list[int]) -> None:
    until = time.monotonic() + 60
    while any(Path(f"/proc/{pid}").exists() and _state(pid) != "Z" for pid in pids):
        assert time.monotonic() < until, f"some of {pids} are still there"
        time.sleep(0.02)


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"
