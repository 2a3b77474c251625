"""What several tests need."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def data_dir(*parts: str) -> Path:
    """Return a folder or file of the public data, or skip: it is not part of the repository."""
    root = os.environ.get("WHEELSOIL_DATA")
    if not root:
        pytest.skip("WHEELSOIL_DATA is not set: the public data sets are not part of the repository")
    path = Path(root, *parts)
    if not path.exists():
        pytest.skip(f"not in WHEELSOIL_DATA: {'/'.join(parts)}")
    return path


def shared_file(name: str) -> Path:
    """Return a file that stands beside the data folder, or skip."""
    path = data_dir().parent / name
    if not path.exists():
        pytest.skip(f"{name} does not stand beside WHEELSOIL_DATA")
    return path
