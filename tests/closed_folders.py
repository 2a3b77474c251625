"""Folders that may not be read, and a user to whom that applies."""

from __future__ import annotations

import codecs
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NOBODY = 65534


@contextmanager
def as_nobody() -> Iterator[None]:
    """Ask the system as a user who may not read everything, which root may."""
    codecs.lookup("utf-8-sig")  # of Python's own files, which may be root's alone
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


def closed(folder: Path) -> Path:
    """Make a folder that only root may read."""
    folder.mkdir()
    folder.chmod(0)
    with as_nobody(), pytest.raises(PermissionError):
        list(folder.iterdir())
    return folder
