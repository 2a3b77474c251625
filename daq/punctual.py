"""Waiting for a moment: the kernel is asked to wake this thread on time, and the rest is spent looking at the clock."""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

SPIN_S = 40e-6
"""Spent looking at the clock at the end of a wait: about what a wake-up costs once the kernel does not put it off."""

# linux/prctl.h
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_SHORTEST_SLACK_NS = 1


@contextmanager
def punctual() -> Iterator[None]:
    """Have this thread woken when it asked for, not up to 50 us later: Linux gathers wake-ups to save power."""
    if sys.platform != "linux":
        yield
        return
    libc = ctypes.CDLL(None)
    before = int(libc.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))
    libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(_SHORTEST_SLACK_NS), 0, 0, 0)
    try:
        yield
    finally:
        libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(before), 0, 0, 0)


def wait_until(moment_s: float) -> float:
    """Wait, and return the time: `moment_s` of `time.perf_counter`, or a little later."""
    while (now := time.perf_counter()) < moment_s:
        if moment_s - now > SPIN_S:
            time.sleep(moment_s - now - SPIN_S)
    return now
