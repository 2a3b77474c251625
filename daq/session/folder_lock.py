"""One logger a folder: a lock on the folder itself, which the kernel takes off however the logger ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq.errors import Fault, HardwareError


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
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
