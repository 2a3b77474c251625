"""Results that several workers need and one of them makes: kept in the session's folder, behind a file lock."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder of the session that `make` has filled, in this worker or in another. Not to be written to."""
    own = factory.getbasetemp()
    session = own.parent if own.name == f"popen-{os.environ.get('PYTEST_XDIST_WORKER')}" else own
    folder = session / "shared" / name
    folder.parent.mkdir(exist_ok=True)
    with folder.with_suffix(".lock").open("w") as lock:
        with suppress(ImportError):  # Windows has none: run it with one worker
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            part = folder.with_suffix(".part")
            shutil.rmtree(part, ignore_errors=True)  # of a `make` that failed
            part.mkdir()
            make(part)
            part.rename(folder)
    return folder
