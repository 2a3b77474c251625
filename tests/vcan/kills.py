"""Starts loggers one after the other and kills each: ``kills.py OUT NOTES WAIT_S ...``, in a guest.

The program is loaded once, and every logger is a process forked from there that runs ``wheelsoil log``: what is tried
is how it ends, not how it starts. Each is killed so many seconds after its file has begun to grow; the notes are
CLOCK_MONOTONIC of every kill, ns, a line each. The last logger is ended as a service manager would.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
import time
from pathlib import Path

from wheelsoil.cli.app import main

LOADED = ("daq.logger", "wheelsoil.cli.log", "daq.socketcan", "daq.recording", "zstandard")
AFTER_THE_LAST_S = 0.5


def logger(out: str) -> int:
    """Start a logger and return its id."""
    pid = os.fork()
    if pid:
        return pid
    sys.argv = ["wheelsoil", "log", "vehicle.toml", "--out", out, "--no-page"]
    try:
        main()
    except SystemExit as ended:
        os._exit(int(ended.code or 0))
    finally:
        os._exit(1)


def wait_for_frames(out: Path, pid: int, before: set[Path]) -> None:
    """Wait until the logger's file is there and grows."""
    while not (new := set(out.glob("*.mcap")) - before):
        assert os.waitpid(pid, os.WNOHANG) == (0, 0), "the logger has ended"
        time.sleep(0.005)
    [path] = new
    began = path.stat().st_size
    while path.stat().st_size == began:
        time.sleep(0.005)


def run(out: Path, notes: Path, waits_s: list[float]) -> None:
    """Start, wait and kill."""
    for name in LOADED:
        importlib.import_module(name)
    with notes.open("w", buffering=1) as file:
        for wait_s in (*waits_s, None):
            before = set(out.glob("*.mcap"))
            pid = logger(str(out))
            wait_for_frames(out, pid, before)
            time.sleep(AFTER_THE_LAST_S if wait_s is None else wait_s)
            os.kill(pid, signal.SIGTERM if wait_s is None else signal.SIGKILL)
            killed_ns = time.monotonic_ns()
            _, status = os.waitpid(pid, 0)
            if wait_s is None:
                assert os.waitstatus_to_exitcode(status) == 128 + signal.SIGTERM
            else:
                file.write(f"{killed_ns}\n")


if __name__ == "__main__":
    run(Path(sys.argv[1]), Path(sys.argv[2]), [float(wait) for wait in sys.argv[3:]])
