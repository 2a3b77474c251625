"""Starts loggers one after the other and kills each: ``kills.py OUT NOTES WAIT_S ...``, in a guest.

The program is loaded once, by a short run, and every logger is a process forked from there that runs
``wheelsoil log``: what is tried is how it ends, not how it starts. Each is killed so many seconds after the first
frames are in its file; the notes are CLOCK_MONOTONIC of every kill, ns, a line each. The last logger is ended as a
service manager would.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import time
from pathlib import Path

from daq.recording import Recording
from wheelsoil.cli.app import main

AFTER_THE_LAST_S = 0.5


def log(out: str, *options: str) -> None:
    sys.argv = ["wheelsoil", "log", "vehicle.toml", "--out", out, "--no-page", *options]
    main()


def logger(out: str) -> int:
    """Start a logger and return its id."""
    pid = os.fork()
    if pid:
        return pid
    try:
        log(out)
    except SystemExit as ended:
        os._exit(int(ended.code or 0))
    finally:
        os._exit(1)


def wait_for_frames(out: Path, pid: int, before: set[Path]) -> None:
    """Wait until there are frames in the logger's file."""
    while not (new := set(out.glob("*.mcap")) - before):
        assert os.waitpid(pid, os.WNOHANG) == (0, 0), "the logger has ended"
        time.sleep(0.005)
    [path] = new
    size = 0
    while path.stat().st_size == size or not Recording.open(path).has_raw_frames:
        size = path.stat().st_size
        time.sleep(0.01)


def run(out: Path, notes: Path, waits_s: list[float]) -> None:
    """Start, wait and kill."""
    with contextlib.suppress(SystemExit):
        log("first", "--duration", "0.1")
    gc.freeze()  # what is loaded stays shared
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
