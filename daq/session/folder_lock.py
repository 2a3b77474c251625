"""One logger a folder: a lock on the folder itself, which the kernel takes off however the logger ends.

Others tell by it whether a file without its end is still being written.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq.errors import Fault, HardwareError

_LOOKED_AT_S = 0.05
"""How long somebody who looks whether the folder is held may hold it."""
_WRITTEN_WITHIN_S = 10.0
"""A file that is being recorded grows at least once a second."""
BETWEEN_FOLDER = "between"
"""In the logger's folder: what comes between runs."""


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the folder for one logger.

    A file system that knows no such locks (some network ones) is used without.

    Raises
    ------
    HardwareError
        If another logger holds it.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            _take(descriptor)
        except BlockingIOError:
            raise HardwareError(
                Fault(
                    "another logger records into this folder",
                    str(folder),
                    next_step="end it, or give this one a folder of its own: --out",
                )
            ) from None
        except OSError:
            pass
        yield
    finally:
        os.close(descriptor)


def is_being_recorded(file: Path) -> bool:
    """Return whether a logger holds the folder of a recording, and wrote into it just now.

    Parameters
    ----------
    file : Path
        A recording without its end.
    """
    folder = file.parent.parent if file.parent.name == BETWEEN_FOLDER else file.parent
    try:
        recent = abs(time.time() - file.stat().st_mtime) <= _WRITTEN_WITHIN_S
        return recent and (_is_held(folder) or (folder != file.parent and _is_held(file.parent)))
    except OSError:
        return False


def _take(descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        time.sleep(_LOOKED_AT_S)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _is_held(folder: Path) -> bool:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False
