"""The ``vcan`` fixture: a function that runs scripts beside a real SocketCAN interface."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from vcan.guest import GuestResult, run_or_skip


@pytest.fixture
def vcan() -> Callable[..., GuestResult]:
    """Return `run_or_skip`: ``vcan(script, timeout_s=...)``."""
    return run_or_skip
