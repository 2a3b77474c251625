"""Runs ``wheelsoil doctor`` on the vehicle.toml of the working folder again and again, in a guest.

The program is loaded once, by the first run; every other one is a process forked from there.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Callable
from pathlib import Path

from wheelsoil.cli.app import main

_CAPABILITIES_3 = 0x20080522


def examine(report: Path, listen_s: float = 1.0) -> int:
    """Run the doctor here, its report on what is stdout from now on; return its exit code."""
    with report.open("w") as out:
        os.dup2(out.fileno(), 1)
    sys.argv = ["wheelsoil", "doctor", "vehicle.toml", "--out", ".", "--listen", str(listen_s), "--json"]
    try:
        main()
    except SystemExit as ended:
        return int(ended.code or 0)
    finally:
        sys.stdout.flush()
    return 0


def examine_apart(report: Path, listen_s: float = 1.0, before: Callable[[], None] = lambda: None) -> int:
    """Do the same in a process of its own, which calls `before` first."""

    def run() -> int:
        before()
        return examine(report, listen_s)

    return os.waitstatus_to_exitcode(os.waitpid(forked(run), 0)[1])


def forked(run: Callable[[], int]) -> int:
    """Start a process that ends when `run` returns its exit code; return its id."""
    pid = os.fork()
    if pid:
        return pid
    try:
        os._exit(run())
    finally:
        os._exit(1)


def without_capabilities() -> None:
    """Give up what root may do beyond any user: the receive buffer is what rmem_max allows."""
    header, nothing = struct.pack("Ii", _CAPABILITIES_3, 0), bytes(24)
    if ctypes.CDLL(None, use_errno=True).capset(header, nothing):
        raise OSError(ctypes.get_errno(), "capset")
