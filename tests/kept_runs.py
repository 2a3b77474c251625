"""Simulated runs that several workers need: one of them simulates, and keeps them in the session's folder."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
from shared_results import made_once

Made = TypeVar("Made")
FACTORIES: list[pytest.TempPathFactory] = []
"""The session's, which a fixture of tests/model puts here; without one everything is made anew."""


def kept(name: str, make: Callable[[], Made]) -> Made:
    """Return what `make` returns, here or in the worker that was first to ask for `name`."""
    if not FACTORIES:
        return make()

    def write(folder: Path) -> None:
        (folder / "made.pickle").write_bytes(pickle.dumps(make()))

    folder = made_once(FACTORIES[-1], hashlib.sha256(name.encode()).hexdigest()[:20], write)
    made: Made = pickle.loads((folder / "made.pickle").read_bytes())
    return made
