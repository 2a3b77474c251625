"""The wheel, as the wheel-soil model sees it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wheel:
    """A rigid wheel.

    Attributes
    ----------
    radius_m : float
        r of Eq. 1.
    width_m : float
        b of Eq. 2 and 7: width of the contact patch.
    """

    radius_m: float
    width_m: float
