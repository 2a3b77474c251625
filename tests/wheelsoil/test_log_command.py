"""``wheelsoil log`` as people and service managers call it."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import termios
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_support import busy, invoke, ok
from logger_support import wait_until

from daq.recording import Recording

PROGRAM = Path(sys.executable).with_name("wheelsoil")


def write_vehicle(folder: Path, channel: str, more: str = "") -> Path:
    path = folder / "vehicle.toml"
    path.write_text(f'[[bus]]\nchannel = "{channel}"\ninterface = "virtual"\n{more}', encoding="utf-8")
    return path


@contextmanager
def logging(*args: object, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """Have a logger run, and have it gone in the end."""
    command = [str(PROGRAM), "log", *map(str, args)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ, **environment}) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def taken_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_everything_it_says_is_json(tmp_path):
    vehicle = write_vehicle(tmp_path, "told", "[logger]\nrotate_mb = 0.002\nflush_s = 0.01\n")
    with busy("told"):
        said = ok("log", vehicle, "-o", tmp_path / "out", "--duration", 1.5, "--no-page", "--json").json
    assert said["ended_by"] == "duration"
    assert said["losses"] == {}
    assert len(said["paths"]) > 1
    assert len(said["runs"]) == 1
    frames = [len(Recording.open(path).frames()) for path in said["paths"]]
    assert sum(frames) == said["frames"]["told"] > 100
    (facts,) = ok("info", said["path"], "--json").json
    assert facts["run_id"] == said["runs"][0]


def test_waiting_records_between_runs_only(tmp_path):
    vehicle = write_vehicle(tmp_path, "waiting")
    with busy("waiting"):
        said = ok("log", vehicle, "-o", tmp_path / "out", "--duration", 0.5, "--wait", "--no-page", "--json").json
    assert said["runs"] == []
    assert [Path(path).parent for path in said["paths"]] == [tmp_path / "out" / "between"]
    assert said["frames"]["waiting"] > 10


def test_a_page_on_a_port_that_is_taken_costs_no_recording_unless_it_was_asked_for(tmp_path, taken_port, monkeypatch):
    vehicle = write_vehicle(tmp_path, "paged")
    result = invoke("log", vehicle, "-o", tmp_path / "out", "--duration", 0.3, "--page-port", taken_port)
    assert result.code == 4
    assert str(taken_port) in result.err
    assert "Traceback" not in result.err
    assert not (tmp_path / "out").exists()

    monkeypatch.setattr("wheelsoil.cli.logger._PAGE_PORT", taken_port)
    with busy("paged"):
        result = ok("log", vehicle, "-o", tmp_path / "out", "--duration", 0.3)
    assert "no status page" in result.err
    assert "--page-port" in result.err


def test_a_page_whose_process_does_not_start_is_reported_and_not_announced(tmp_path, monkeypatch):
    vehicle = write_vehicle(tmp_path, "lone")
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no-python"))
    with busy("lone"):
        result = ok("log", vehicle, "-o", tmp_path / "out", "--duration", 1.0, "--page-port", 0)
    said = result.err.splitlines()
    assert (
        said.count("no status page: its process cannot be started: No such file or directory; it is tried again") == 1
    )
    assert not any(line.startswith("status page: ") for line in said)
    assert len(Recording.open(*(tmp_path / "out").glob("*.mcap")).frames()) > 10


def test_the_page_shows_the_run_that_is_recorded(tmp_path):
    vehicle = write_vehicle(tmp_path, "shown")
    with logging(vehicle, "-o", tmp_path / "out", "--page-port", 0, "--run-id", "seven") as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert line.startswith("status page: http://127.0.0.1:")
        wait_until(lambda: (tmp_path / "out" / "seven.mcap").exists())
        with urllib.request.urlopen(line.split()[-1], timeout=20) as page:
            assert b"<html" in page.read()
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 143, err
    assert "Traceback" not in err
    assert Recording.open(tmp_path / "out" / "seven.mcap").metadata["run_end"]["exit_status"] == "interrupted"


def test_a_terminal_that_is_closed_ends_the_recording_as_ctrl_c_does(tmp_path):
    """As where the connection of an ssh session breaks."""
    vehicle, out = write_vehicle(tmp_path, "hung-up"), tmp_path / "out"
    held, terminal = pty.openpty()
    with subprocess.Popen(
        [str(PROGRAM), "log", vehicle, "-o", out, "--no-page"],
        stdin=terminal, stdout=terminal, stderr=terminal, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(terminal, termios.TIOCSCTTY, 0),
    ) as process:  # fmt: skip
        try:
            os.close(terminal)
            wait_until(lambda: list(out.glob("*.mcap")) and select.select([held], [], [], 0)[0])
            os.read(held, 1000)
            os.close(held)
            assert process.wait(30) == 128 + signal.SIGHUP
        finally:
            process.kill()
    (path,) = out.glob("*.mcap")
    assert Recording.open(path).metadata["run_end"]["exit_status"] == "interrupted"


def test_a_logger_under_nohup_ignores_the_end_of_its_terminal(tmp_path):
    vehicle, out = write_vehicle(tmp_path, "stays"), tmp_path / "out"
    command = ["nohup", str(PROGRAM), "log", vehicle, "-o", out, "--no-page"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: list(out.glob("*.mcap")))
            process.send_signal(signal.SIGHUP)
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 128 + signal.SIGINT
        finally:
            process.kill()


def test_a_token_is_read_from_a_file(tmp_path):
    vehicle, empty = write_vehicle(tmp_path, "token"), tmp_path / "token"
    empty.touch()
    for file in (empty, tmp_path / "nothing"):
        result = invoke("log", vehicle, "-o", tmp_path / "out", "--duration", 0.1, "--page-token-file", file)
        assert result.code == 2
        assert "token" in result.err
    assert not (tmp_path / "out").exists()


def test_a_second_logger_is_refused(tmp_path):
    vehicle = write_vehicle(tmp_path, "twice")
    out = tmp_path / "out"
    with logging(vehicle, "-o", out, "--no-page") as process:
        wait_until(lambda: list(out.glob("*.mcap")))
        result = invoke("log", vehicle, "-o", out, "--duration", 0.1, "--no-page")
        assert result.code == 4
        assert "another logger records into this folder" in result.err
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)
    assert process.returncode == 130
    assert len(list(out.iterdir())) == 1


def test_a_service_manager_hears_that_it_is_ready_alive_and_stopping(tmp_path):
    vehicle = write_vehicle(tmp_path, "service")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(30)
        told = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "10000000"}
        with logging(vehicle, "-o", tmp_path / "out", "--no-page", **told) as process:
            assert manager.recv(1000).startswith(b"READY=1")
            assert list((tmp_path / "out").glob("*.mcap"))
            assert b"WATCHDOG=1" in [manager.recv(1000) for _ in range(2)]
            process.send_signal(signal.SIGTERM)
            while manager.recv(1000) != b"STOPPING=1":
                pass
            process.communicate(timeout=30)


def test_a_role_that_names_no_signal_is_reported_and_recorded_all_the_same(tmp_path):
    vehicle = write_vehicle(tmp_path, "roles", 'dbc = ["gnss.dbc"]\n[signals]\nground_speed = "GNSS_2.Sped"\n')
    with busy("roles"):
        result = ok("log", vehicle, "-o", tmp_path / "out", "--duration", 0.3, "--no-page")
    assert "GNSS_2.Sped" in result.err
    assert "GNSS_2.Speed" in result.err


def test_it_says_where_it_records_and_how_well_without_a_terminal(tmp_path):
    vehicle, out = write_vehicle(tmp_path, "said"), tmp_path / "out"
    (tmp_path / "vehicle.toml").write_text(vehicle.read_text() + '[transducer]\nzero_file = "zero.toml"\n')
    with logging(vehicle, "-o", out, "--no-page") as process:
        assert process.stderr is not None
        assert "`process` fails until the file exists" in process.stderr.readline()
        line = process.stderr.readline()
        assert line.startswith("recording run ")
        path = Path(line.split()[-1])
        assert path.parent == out
        assert path.exists()
        assert process.stderr.readline().startswith("amber: said: no frame since the start")
        process.kill()
        process.wait()
    with logging(vehicle, "-o", out, "--no-page") as process:
        assert process.stderr is not None
        process.stderr.readline()
        line = process.stderr.readline()
        assert "was interrupted and continues" in line
        assert Path(line.split()[-1]) == path.with_name(f"{path.stem}.part2.mcap")


def test_nothing_is_said_of_a_page_before_an_error(tmp_path):
    vehicle = write_vehicle(tmp_path, "none")
    vehicle.write_text(vehicle.read_text().replace('"virtual"', '"socketcan"').replace('"none"', '"nocan0"'))
    result = invoke("log", vehicle, "-o", tmp_path / "out", "--page-port", 0)
    assert result.code == 4
    assert "status page" not in result.err


@pytest.mark.parametrize("run_id", ["...", "-", "a" * 400, "run \udcff", "two\nlines"])
def test_a_run_that_no_file_can_be_named_after_is_refused(tmp_path, run_id):
    result = invoke("log", write_vehicle(tmp_path, "x"), "-o", tmp_path / "out", "--run-id", run_id, "--no-page")
    assert result.code == 2
    assert "--run-id" in result.err
    assert run_id not in result.err or len(run_id) < 10
    assert not (tmp_path / "out").exists()


def test_a_file_cannot_be_named_where_no_run_begins(tmp_path):
    result = invoke("log", write_vehicle(tmp_path, "x"), "-o", tmp_path / "run.mcap", "--wait", "--no-page")
    assert result.code == 2
    assert "--wait" in result.err


def test_a_token_that_is_given_is_in_no_journal(tmp_path):
    vehicle = write_vehicle(tmp_path, "x")
    arguments = (vehicle, "-o", tmp_path / "out", "--page-host", "0.0.0.0", "--page-port", 0, "--duration", 0.2)
    for environment, shown in (({"WHEELSOIL_PAGE_TOKEN": "a-secret"}, False), ({}, True)):
        with logging(*arguments, **environment) as process:
            _, err = process.communicate(timeout=60)
        [first, *_] = [line for line in err.splitlines() if line.startswith("status page: ")]
        assert ("#" in first) is shown
        assert "a-secret" not in err


def test_a_channel_of_udp_multicast_that_is_no_address_is_reported_without_noise(tmp_path):
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[[bus]]\nchannel = "can0"\ninterface = "udp_multicast"\n')
    with logging(vehicle, "-o", tmp_path / "out", "--no-page") as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 4
    assert "multicast address, e.g. 239.74.163.2" in err
    assert "shut down" not in err


def test_the_help_names_every_exit_code():
    text = " ".join(ok("log", "--help").out.split())
    for code in (
        "0 ok",
        "1 a bus was silent",
        "2 usage",
        "3 the recording exists",
        "4 a bus was down",
        "129 the terminal",
        "130 Ctrl-C",
    ):
        assert code in text
