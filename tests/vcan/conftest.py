"""The fixtures ``vcan`` and ``guest``: functions that run scripts beside a real SocketCAN interface."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from vcan.guest import GuestResult, guest_or_skip, run_or_skip


@pytest.fixture
def vcan() -> Callable[..., GuestResult]:
    """Return `run_or_skip`: ``vcan(script, timeout_s=...)``."""
    return run_or_skip


@pytest.fixture
def guest() -> Callable[..., GuestResult]:
    """Return `guest_or_skip`: ``guest(script, timeout_s=..., disks=..., power_cut=...)``."""
    return guest_or_skip
