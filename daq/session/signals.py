"""The signals that end a recording, as something that can be looked at."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def caught_signals() -> Iterator[list[int]]:
    """Catch SIGINT, SIGTERM and SIGHUP into a list; only the main thread may, elsewhere nothing is caught.

    SIGHUP comes when the terminal is closed, or the connection to it breaks; where it is ignored (``nohup``), it
    stays so.
    """
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def catch(number: int, frame: FrameType | None) -> None:
        del frame
        caught.append(number)

    wanted = [number for number in _ENDING if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, catch) for number in wanted}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
