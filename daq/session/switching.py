"""How quickly Python's threads take turns."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

SWITCH_S = 0.0005


@contextmanager
def quick_switching() -> Iterator[None]:
    """Have a thread wait for the interpreter 0.5 ms where it would wait 5.

    A flush gives the interpreter away a dozen times (compression, writing), and while frames are inspected it would
    wait each time: a kill takes what waits.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
