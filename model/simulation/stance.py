"""How a simulated vehicle stands: the ground's tilt, the brakes, and what the hub carries at rest before and after.

On ground that rises by a on "out", the soil holds the vehicle's weight along it, M g sin a, at all wheels together.

- Held brakes: the hub carries any share of it, less half of what the rut keeps pushing against the wheel's front; the
  brake holds the wheel against that push too, so T = r (Dp + push).
- Released: the wheel's own share W sin a, and no torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, sin
from typing import Literal

import numpy as np

from daq import FloatArray
from model.simulation.motion import GRAVITY_MPS2, VehicleSetup, static_load_n

HELD_IN = 0.7
"""Share of the drivers who stand on the brake."""
_MOST_SHARE = 0.6
_MOST_KEPT = 0.2
"""Of the towing resistance, that the rut keeps at a braked wheel."""


@dataclass(frozen=True)
class Stance:
    """Of a campaign.

    Attributes
    ----------
    tilt_deg : uphill on "out", everywhere
    brakes : "held" or "released"
        At every standstill.
    """

    tilt_deg: float = 0.0
    brakes: Literal["held", "released"] = "released"

    def uphill(self, direction: float) -> float:
        """Return the sine of the tilt as the vehicle drives it."""
        return direction * sin(radians(self.tilt_deg))


@dataclass(frozen=True)
class StandingForces:
    """Between soil and wheel before and after a run, shape (2,): N and N m."""

    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray

    def along(self, distance_m: FloatArray, length_m: float) -> tuple[FloatArray, FloatArray]:
        """Return pull and torque of the nearer standstill, shape (n,), by the distance driven so far and in all."""
        which = (distance_m > 0.5 * length_m).astype(int)
        return self.drawbar_pull_n[which], self.driving_torque_nm[which]


def standing_forces(
    stance: Stance,
    vehicle: VehicleSetup,
    direction: float,
    added_load_kg: float,
    wheel_radius_m: float,
    towing_resistance_n: float,
    rng: np.random.Generator,
) -> StandingForces:
    """Draw what a run's standstills show.

    The towing resistance is that of the wheel that passes no torque.
    """
    share, kept = rng.uniform(0.0, _MOST_SHARE, 2), towing_resistance_n * rng.uniform(0.0, _MOST_KEPT, 2)
    uphill = stance.uphill(direction)
    if stance.brakes == "held":
        pull = uphill * share * (vehicle.mass_kg + added_load_kg) * GRAVITY_MPS2 - 0.5 * kept
        return StandingForces(pull, wheel_radius_m * (pull + kept))
    return StandingForces(uphill * static_load_n(vehicle, added_load_kg) * np.ones(2), np.zeros(2))
