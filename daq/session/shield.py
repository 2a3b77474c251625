"""The boundary around everything that only looks at frames: whatever goes wrong there, recording goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from daq.errors import HardwareError

T = TypeVar("T")


class Shield:
    """Runs what must not end a recording, and keeps what went wrong.

    Attributes
    ----------
    failures : int
        How often something went wrong.
    last : str
        What went wrong the last time.
    """

    def __init__(self) -> None:
        self.failures = 0
        self.last = ""

    def run(self, act: Callable[[], T]) -> T | None:
        """Return what `act` returns, or None where it fails.

        Raises
        ------
        HardwareError
            If the disk fails: that is no matter of looking at frames.
        """
        try:
            return act()
        except HardwareError:
            raise
        except Exception as error:  # noqa: BLE001 - a bug in looking at frames must not cost the frames
            self.failures += 1
            self.last = f"{type(error).__name__}: {error}"
            return None
