"""The status page's process: snapshots come out, commands come back, and nothing in it stops a logger."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from live_client import PATIENCE_S, ask, command, connect, events, next_event, page, until
from live_support import snapshot

from daq import ConfigError, HardwareError
from daq.logger import Command
from wheelsoil.live import PagePanel
from wheelsoil.live.hub import MOST_STREAMS
from wheelsoil.web.listening import listen

_LOGGER = """
import sys, time
from wheelsoil.live import PagePanel
panel = PagePanel("127.0.0.1", int(sys.argv[1]), None, "a tractor")
while panel.pid is None:
    time.sleep(0.01)
print(panel.pid, panel.port, flush=True)
time.sleep(600)
"""


def test_a_snapshot_reaches_every_browser_and_a_late_one_too() -> None:
    with page() as panel, events(panel) as first:
        assert next_event(first, "hello") == {"vehicle": "a tractor"}
        panel.show(snapshot(4.75, 5.0))
        seen = next_event(first, "snapshot")
        assert seen["snapshot"]["run"]["id"] == "clay-out-3"
        assert "traces" not in seen["snapshot"]
        with events(panel) as late:
            assert next_event(late, "snapshot")["snapshot"] == seen["snapshot"]


def test_curves_are_sent_whole_once_and_then_only_what_is_new() -> None:
    with page() as panel:
        panel.show(snapshot(0.0, 10.0))
        with events(panel) as stream:
            whole = next_event(stream, "snapshot")["curves"]
            assert whole["fresh"] and len(whole["pull"]) > 150 and len(whole["slip"]) > 20
            panel.show(snapshot(10.0, 10.5))
            more = next_event(stream, "snapshot")["curves"]
            assert not more["fresh"] and 0 < len(more["pull"]) < 12
            assert more["pull"][0][0] > whole["pull"][-1][0]


def test_what_no_json_holds_becomes_null(panel: PagePanel) -> None:
    with events(panel) as stream:
        panel.show(snapshot(4.75, 5.0, cpu_percent=float("nan"), rss_mb=float("inf")))
        seen = next_event(stream, "snapshot")["snapshot"]
        assert seen["cpu_percent"] is None and seen["rss_mb"] is None


def test_a_snapshot_that_cannot_be_shown_leaves_the_page_alive(capfd: pytest.CaptureFixture[str]) -> None:
    with page() as panel, events(panel) as stream:
        panel.show(snapshot(4.75, 5.0, traces={"drawbar_pull": {"time_s": [1.0], "value": []}}))
        panel.show(snapshot(5.0, 5.25))
        assert next_event(stream, "snapshot")["snapshot"]["session_s"] == 5.25
        assert panel.starts == 1
    assert "a snapshot was skipped" in capfd.readouterr().err


@pytest.mark.parametrize("kind", ["start", "stop", "mark"])
def test_a_command_comes_back_to_the_logger(panel: PagePanel, kind: str) -> None:
    assert panel.commands() == []
    assert command(panel, {"kind": kind, "text": "left  rut\nwet"}) == 202
    assert until(panel.commands, "the command") == [Command(kind, "left rut wet")]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"\xff",
        b"[" * 4000,
        {"kind": "halt"},
        {"text": "no kind"},
        {"kind": ["mark"]},
        {"kind": "mark", "text": 1},
        {"kind": "mark", "text": "x" * 201},
        {"kind": "mark", "run": "../x"},
    ],
)
def test_what_is_no_command_is_refused(panel: PagePanel, body: object) -> None:
    assert command(panel, body) == 400
    assert panel.commands() == []


def test_a_logger_that_does_not_listen_is_reported_to_the_browser() -> None:
    with page() as panel:
        statuses = {command(panel, {"kind": "mark", "text": "x" * 200})}
        until(lambda: statuses.add(command(panel, {"kind": "mark"})) or 503 in statuses, "a full pair of sockets")
        assert statuses == {202, 503}


def test_a_stopped_page_costs_the_logger_nothing_but_snapshots() -> None:
    with page() as panel:
        assert ask(panel, "GET", "/").status == 200
        assert panel.pid is not None
        os.kill(panel.pid, signal.SIGSTOP)
        longest_s = 0.0
        while not panel.dropped:
            started_s = time.perf_counter()
            panel.show(snapshot(4.0, 5.0))
            longest_s = max(longest_s, time.perf_counter() - started_s)
            panel.commands()
        assert longest_s < 1.0  # a call that waited would have waited for ever
        dropped = panel.dropped
        os.kill(panel.pid, signal.SIGCONT)
        with events(panel) as stream:
            panel.show(snapshot(5.0, 6.0))
            until(lambda: next_event(stream, "snapshot")["snapshot"]["session_s"] == 6.0 or None, "the newest snapshot")
        assert panel.dropped == dropped


def test_a_killed_page_comes_back_and_shows_what_comes_then() -> None:
    with page(restart_s=0.1) as panel:
        assert ask(panel, "GET", "/").status == 200
        first = panel.pid
        assert first is not None
        os.kill(first, signal.SIGKILL)
        until(lambda: panel.pid not in (None, first), "another process")
        assert panel.starts == 2
        with events(panel) as stream:
            panel.show(snapshot(5.0, 6.0))
            until(lambda: next_event(stream, "snapshot")["snapshot"]["session_s"] == 6.0 or None, "the newest snapshot")
        assert command(panel, {"kind": "mark"}) == 202


def test_a_page_that_always_dies_is_not_started_all_the_time() -> None:
    with page(restart_s=600.0) as panel:
        assert ask(panel, "GET", "/").status == 200
        assert panel.pid is not None
        os.kill(panel.pid, signal.SIGKILL)
        until(lambda: panel.pid is None, "its end")
        panel.show(snapshot(5.0, 6.0))
        assert panel.commands() == [] and panel.starts == 1


def test_closing_tells_the_browsers_and_ends_the_process() -> None:
    with page() as panel:
        with events(panel) as stream:
            next_event(stream, "hello")
            pid = panel.pid
            panel.close()
            assert next_event(stream, "ended") == {}
        assert pid is not None and not _alive(pid)
        panel.close()
        panel.show(snapshot(5.0, 6.0))
        assert panel.commands() == []


def test_closing_a_stopped_page_ends_it_too() -> None:
    with page() as panel:
        assert ask(panel, "GET", "/").status == 200
        pid = panel.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        panel.close()
        assert not _alive(pid)


def test_the_page_dies_with_a_killed_logger_and_its_port_is_free_at_once() -> None:
    with _logger_process(0) as (logger, pid, port):
        os.kill(pid, signal.SIGSTOP)  # even one that could not notice by itself
        logger.kill()
        logger.wait()
        panel = PagePanel("127.0.0.1", port, None, "its successor")
        panel.close()
        until(lambda: not _alive(pid), "the page's end")


def test_the_page_gives_way_to_the_logger_and_does_not_show_its_token() -> None:
    with page(token="not-for-everyone") as panel:
        assert ask(panel, "GET", "/").status == 200
        process = Path(f"/proc/{panel.pid}")
        assert os.getpriority(os.PRIO_PROCESS, panel.pid or 0) > os.getpriority(os.PRIO_PROCESS, 0)
        assert int((process / "oom_score_adj").read_text()) == 900
        assert b"not-for-everyone" not in (process / "cmdline").read_bytes() + (process / "environ").read_bytes()


def test_a_taken_port_is_one_clear_fault() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(HardwareError, match=f"port {port} is taken") as caught:
            PagePanel("127.0.0.1", port, None, "a tractor")
        assert caught.value.exit_code == 4 and caught.value.faults[0].next_step


def test_a_phone_out_of_reach_loses_its_place_soon() -> None:
    with listen("127.0.0.1", 0) as listening, socket.create_connection(listening.getsockname()):
        accepted, _ = listening.accept()
        with accepted:
            assert 0 < accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) <= 30_000


def test_more_browsers_than_allowed_are_refused_with_the_reason() -> None:
    with page() as panel, ExitStack() as streams:
        for _ in range(MOST_STREAMS):
            next_event(streams.enter_context(events(panel)), "hello")
        assert ask(panel, "GET", "/events").status == 503
        assert command(panel, {"kind": "mark"}) == 202
        streams.close()
        until(lambda: _opens(panel), "a place")


@pytest.mark.slow
def test_who_does_not_say_what_he_wants_holds_no_place() -> None:
    """Anybody in the network can open connections; there is room for few."""
    with page() as panel, ExitStack() as silent:
        address = ("127.0.0.1", panel.port)
        usual = f"Host: {address[0]}:{address[1]}\r\nOrigin: http://{address[0]}:{address[1]}\r\n"
        usual += "Content-Type: application/json\r\n"
        until(lambda: ask(panel, "GET", "/").status == 200, "the page")
        stream = silent.enter_context(events(panel))
        said = ("", "GET / HTTP/1.1\r\n", f"POST /command HTTP/1.1\r\n{usual}Content-Length: 9\r\n\r\n{{")
        opened = [silent.enter_context(socket.create_connection(address)) for _ in range(72)]
        for each, text in zip(opened, said * 24, strict=True):
            with suppress(OSError):  # the first ones have been closed for the later ones
                each.sendall(text.encode())
        assert ask(panel, "GET", "/").status == 200
        for each in opened:
            each.settimeout(PATIENCE_S)
            with suppress(ConnectionResetError):
                assert each.recv(1) == b""
        assert next_event(stream, "hello")
        panel.show(snapshot(4.75, 5.0))
        assert next_event(stream, "snapshot")


def _opens(panel: PagePanel) -> bool:
    connection = connect(panel)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    answer.close()
    connection.close()
    return answer.status == 200


@pytest.mark.parametrize("host", ["192.0.2.1", "no-such-host.invalid"])
def test_an_address_of_another_machine_is_one_clear_fault(host: str) -> None:
    with pytest.raises(HardwareError, match="cannot listen on this address"):
        PagePanel(host, 0, None, "a tractor")


def test_no_such_port_and_no_such_token() -> None:
    with pytest.raises(ConfigError, match="no such port"):
        PagePanel("127.0.0.1", 65536, None, "a tractor")
    for token in ("short", "with blanks in it", "für-alle-da"):
        with pytest.raises(ConfigError, match="token"):
            PagePanel("127.0.0.1", 0, token, "a tractor")


def test_only_others_are_asked_for_a_token_and_the_address_holds_it() -> None:
    with page() as panel:
        assert panel.token is None and panel.address == f"http://127.0.0.1:{panel.port}/"
    with page("0.0.0.0") as panel:
        assert panel.token is not None and len(panel.token) >= 20
        assert all(url.endswith(f":{panel.port}/#{panel.token}") for url in panel.addresses)
        assert all("0.0.0.0" not in url for url in panel.addresses)


def test_the_package_is_imported_without_a_server() -> None:
    script = (
        "import sys; from wheelsoil.live import PagePanel; print({'starlette', 'uvicorn', 'numpy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@contextmanager
def _logger_process(port: int) -> Iterator[tuple[subprocess.Popen[str], int, int]]:
    """A process with a page; the page's id and port."""
    with subprocess.Popen([sys.executable, "-c", _LOGGER, str(port)], stdout=subprocess.PIPE, text=True) as logger:
        try:
            assert logger.stdout is not None
            pid, bound = map(int, logger.stdout.readline().split())
            panel = _Listening(bound)
            assert ask(panel, "GET", "/").status == 200
            yield logger, pid, bound
        finally:
            logger.kill()


class _Listening(PagePanel):
    """Somebody else's page."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.token = None


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
