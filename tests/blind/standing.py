"""How the vehicle stands: the ground's tilt, the brakes, and what the hub carries of both before and after a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from blind.driving import GRAVITY_MPS2, Plan
from blind.ground import Ground
from blind.hooks import at_hub
from blind.wheel import COLUMNS, YANG, Moments, Physics, Vehicle, soil_forces

from daq import FloatArray

TILT_RAD = float(np.radians(0.3))
HELD_IN = 0.7
"""Share of the campaigns whose driver stands on the brake."""
_MOST_SHARE = 0.6
_KEPT, _KEPT_FREE = 0.2, 0.02
"""Of the towing resistance, that the rut keeps: at most with held brakes, one-sigma with released ones."""


@dataclass(frozen=True)
class Stance:
    """Of a campaign.

    Attributes
    ----------
    tilt_rad : uphill on "out", everywhere
    held : whether the brakes are held at every standstill
    """

    tilt_rad: float = 0.0
    held: bool = False

    @staticmethod
    def drawn(rng: np.random.Generator) -> Stance:
        """Up to .3 deg either way, brakes held in 7 of 10."""
        return Stance(float(rng.uniform(-TILT_RAD, TILT_RAD)), bool(rng.random() < HELD_IN))


def towed(
    ground: Ground, load_n: float, vehicle: Vehicle = YANG, physics: Physics | None = None
) -> tuple[float, float]:
    """Return the slip at which the wheel passes no torque, and its resistance there, N."""
    slip = np.linspace(-0.35, 0.0, 36)
    ones = np.ones(len(slip))
    rows = {**dict.fromkeys(COLUMNS, ones), "omega": (1 + slip) / vehicle.radius_m, "load": load_n * ones}
    pull, torque, _ = soil_forces(physics or Physics(), ground, Moments(**rows, vehicle=vehicle))
    free = float(np.interp(0.0, torque, slip))
    return free, -float(np.interp(free, slip, pull))


def on_tilted_ground(
    physics: Physics, stance: Stance, plan: Plan, vehicle: Vehicle, rut_n: float, rng: np.random.Generator
) -> Physics:
    """Return the physics with the ground's tilt, and with what the hub carries at rest, before and after the run.

    Held brakes: any share of the vehicle's weight along the ground, less half of what the rut keeps; the brake holds
    the wheel against the rut's push too. Released: no torque; the wheel's own share, and a little of the rut's.
    The outboard parts hang on the soil, not on the hub.

    Parameters
    ----------
    rut_n : towing resistance of the run's load
    """
    share, kept = rng.uniform(0.0, _MOST_SHARE, 2), rut_n * rng.uniform(0.0, _KEPT, 2)
    free = _KEPT_FREE * rut_n * rng.standard_normal(2)
    uphill = plan.direction * float(np.sin(stance.tilt_rad))
    if stance.held:
        pull = uphill * share * (vehicle.mass_kg + plan.added_load_kg) * GRAVITY_MPS2 - 0.5 * kept
        torque = vehicle.radius_m * (pull + kept)
    else:
        pull, torque = uphill * plan.load_n + free, np.zeros(2)

    def more(m: Moments) -> tuple[FloatArray, FloatArray]:
        second, rests = m.distance_m > 0.5 * m.distance_m[-1], 1 - m.rolls
        outboard = -vehicle.outboard_kg * GRAVITY_MPS2 * uphill
        return outboard + rests * np.where(second, *pull[::-1]), rests * np.where(second, *torque[::-1])

    return at_hub(lambda m, z, soil, size: more(m))(physics, 1.0)


def rest_covariance(
    stance: Stance, vehicle: Vehicle, load_n: float, rut_n: float, same_rest: FloatArray, rests: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what a standstill hides of pull and torque, two arrays (k, k).

    Parameters
    ----------
    same_rest, rests : (k, k)
        1 for two rows at the same standstill; at any two.
    """
    if stance.held:
        return 1e6 * same_rest, 1e6 * vehicle.radius_m**2 * same_rest
    free = (load_n * TILT_RAD) ** 2 * rests + (_KEPT_FREE * rut_n) ** 2 * same_rest
    return free, 0.0 * rests
