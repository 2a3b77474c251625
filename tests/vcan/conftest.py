"""The ``vcan`` fixture: a function that runs scripts beside a real SocketCAN interface."""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

from vcan.guest import GuestResult, NoGuestError, run_with_vcan


@pytest.fixture
def vcan() -> Callable[..., GuestResult]:
    """Return `run_with_vcan`; where no kernel has vcan the test skips, or fails if WHEELSOIL_REQUIRE_VCAN is 1."""

    def run(script: str, **options: object) -> GuestResult:
        try:
            return run_with_vcan(script, **options)  # type: ignore[arg-type]
        except NoGuestError as error:
            if os.environ.get("WHEELSOIL_REQUIRE_VCAN") == "1":
                pytest.fail(f"WHEELSOIL_REQUIRE_VCAN=1, but {error}")
            pytest.skip(str(error))

    return run
