"""Foreign wheels: physics that Wong's model does not have, at full size.

A new one needs a function (slip, vertical load) -> (drawbar pull, driving torque, sinkage) and a row in `FOREIGN`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from blind.granular import LOADS_N, RADIUS_M, WIDTH_M, GranularWheel, ground_of_terrain
from blind.ground import Ground
from blind.soil_causes import hump_shear
from blind.wheel import Physics, Resultants, Vehicle
from blind.world import World, carried, drawn_noise_world, drawn_vehicle, drawn_world
from scipy.interpolate import RegularGridInterpolator

from daq import FloatArray

SLIPS = np.concatenate([np.linspace(-0.5, -0.02, 13), np.linspace(0.0, 0.95, 24)])
_LOAD_SHARES = np.geomspace(0.35, 2.8, 9)
_SEGMENTS = 120


@dataclass(frozen=True)
class ForeignCampaign:
    """A foreign campaign before it is driven.

    Attributes
    ----------
    world : World
    laboratory : Ground
        What plate and shear tests on this soil say.
    physics : Physics
    slips : (least, largest)
        That are driven.
    """

    world: World
    laboratory: Ground
    physics: Physics
    slips: tuple[float, float] = (-0.45, 0.92)


@dataclass(frozen=True)
class Foreign:
    """A kind of foreign wheel; right are `unexplained`, and a set that holds one of its families.

    Attributes
    ----------
    families : tuple of str
        Of the library, that describe it in part.
    may_be_named : bool
        Whether one of them alone is right, too.
    """

    key: str
    formula: str
    drawn: Callable[[np.random.Generator], ForeignCampaign]
    families: tuple[str, ...] = ()
    may_be_named: bool = False


def _reece(rng: np.random.Generator) -> ForeignCampaign:
    """Wong & Reece (1967): peak ahead of the bottom; p = k' (z/b)^n, measured with plates of another width."""
    campaign = _drawn_campaign(rng)
    c1, c2 = float(rng.uniform(0.18, 0.43)), float(rng.uniform(0.25, 0.4))
    physics = Physics(peak=lambda slip: np.clip(c1 + c2 * np.maximum(slip, 0.0), 0.0, 0.9))
    return replace(campaign, physics=physics)


def _hump(rng: np.random.Generator) -> ForeignCampaign:
    """Wong and Oida: the shear stress passes a peak and falls to a residual share."""
    share = float(rng.uniform(0.4, 0.7))
    return replace(_drawn_campaign(rng), physics=Physics(shear=hump_shear(1.0, share)))


def _elastic_tyre(rng: np.random.Generator) -> ForeignCampaign:
    """A tyre whose pressure on the soil has a limit below what the rigid wheel would exert."""
    campaign = _drawn_campaign(rng)
    vehicle, soil = campaign.world.vehicle, campaign.laboratory
    sinkage = _sinkage(soil, vehicle, vehicle.loads_n[1])
    rigid = float(np.asarray(soil.stiffness(vehicle.width_m))) * sinkage ** float(np.asarray(soil.exponent))
    return replace(campaign, physics=Physics(most_pa=rigid * float(rng.uniform(0.5, 0.75))))


def _drawn_campaign(rng: np.random.Generator) -> ForeignCampaign:
    """Return a drawn world whose laboratory measured the soil's own parameters."""
    from blind.ground import LABORATORY

    world = drawn_world(rng)
    return ForeignCampaign(world, LABORATORY[world.soil], Physics())


def _sinkage(soil: Ground, vehicle: Vehicle, load_n: float) -> float:
    depths = vehicle.radius_m * np.geomspace(0.01, 0.9, 60)
    loads = [carried(soil, vehicle.radius_m, vehicle.width_m, float(z)) for z in depths]
    return float(np.interp(load_n, loads, depths))


def _resistive(rng: np.random.Generator) -> ForeignCampaign:
    """Granular resistive force theory; a plate that goes straight down feels k z."""
    stiffness = float(np.exp(rng.uniform(np.log(3e5), np.log(2e6))))
    soil = Ground("granular", 200.0, float(np.tan(np.radians(30.0))), 0.015, 1.0, 1e3, stiffness)
    while (vehicle := drawn_vehicle(soil, rng)) is None:
        continue
    wheel = ResistiveWheel(vehicle.radius_m, vehicle.width_m, stiffness)
    loads = _LOAD_SHARES * vehicle.loads_n[1]
    return ForeignCampaign(replace(drawn_noise_world(rng), vehicle=vehicle), soil, by_table(wheel.resultants, loads))


@dataclass(frozen=True)
class ResistiveWheel:
    """A rigid rim in granular resistive force theory, with the generic coefficients.

    Source: Li, Zhang & Goldman (2013), Science 339:1408, Tab. S3: each segment that moves into the material feels
    alpha(tilt, direction) times its depth.
    """

    radius_m: float
    width_m: float
    stiffness_pa_m: float

    def resultants(self, slip: float, vertical_load_n: float) -> tuple[float, float, float]:
        """Return drawbar pull, driving torque and sinkage."""
        low, high = 1e-4 * self.radius_m, 0.98 * self.radius_m
        for _ in range(50):
            half = 0.5 * (low + high)
            low, high = (half, high) if self._forces(slip, half)[1] < vertical_load_n else (low, half)
        pull, _, torque = self._forces(slip, high)
        return pull, torque, high

    def _forces(self, slip: float, sinkage_m: float) -> tuple[float, float, float]:
        """Return the horizontal and vertical force on the wheel, and the driving torque."""
        r = self.radius_m
        entry = float(np.arccos(1 - sinkage_m / r))
        theta = (np.arange(_SEGMENTS) + 0.5) / _SEGMENTS * entry
        ratio = 1 / (1 + slip) if slip < 0 else 1 - slip  # V/(r omega)
        along, down = ratio - np.cos(theta), np.sin(theta)
        direction = np.arctan2(down, np.abs(along))
        forwards = np.where(along >= 0, 1.0, -1.0)
        drag, lift = resistive_stress(forwards * theta, direction)
        area = self.stiffness_pa_m * r * (np.cos(theta) - np.cos(entry)) * r * self.width_m * entry / _SEGMENTS
        x, z = -forwards * drag * area, lift * area
        return float(x.sum()), float(z.sum()), float(r * np.sum(np.cos(theta) * x + np.sin(theta) * z))


def resistive_stress(tilt: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return alpha_x (against the motion) and alpha_z (upwards) of a segment, 1 for a flat plate straight down.

    Parameters
    ----------
    tilt : from horizontal, positive where the face looks forward and down
    direction : of the motion, from horizontal downwards
    """
    sum_, difference = 2 * tilt + direction, -2 * tilt + direction
    up = (
        0.206 + 0.169 * np.cos(2 * tilt) + 0.212 * np.sin(sum_) + 0.358 * np.sin(direction) + 0.055 * np.sin(difference)
    )
    back = -0.124 * np.cos(sum_) + 0.253 * np.cos(direction) + 0.007 * np.cos(difference) + 0.088 * np.sin(2 * tilt)
    return back, up


def by_table(
    resultants: Callable[[float, float], Sequence[float]], loads_n: FloatArray, slips: FloatArray = SLIPS
) -> Physics:
    """Return a wheel that interpolates a table of its resultants, all of them over the load; outside: the edge's."""
    rows = [list(resultants(float(s), float(w))) for s, w in product(slips, loads_n)]
    pull, torque, sinkage = np.array(rows, float).T
    shape = (len(slips), len(loads_n))
    loads = np.tile(loads_n, len(slips))
    tables = [
        RegularGridInterpolator((slips, np.log(loads_n)), column.reshape(shape))
        for column in (pull / loads, torque / loads, sinkage)
    ]

    def table(slip: FloatArray, load_n: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        at = np.column_stack(
            [np.clip(slip, slips[0], slips[-1]), np.log(np.clip(load_n, loads_n[0], loads_n[-1]))],
        )
        pull, torque, sinkage = (one(at) for one in tables)
        return pull * load_n, torque * load_n, sinkage

    found: Resultants = table
    return Physics(resultants=found)


def _granular(rng: np.random.Generator) -> ForeignCampaign:
    """A granular simulation by its table; the wheel and the loads are the table's own."""
    loads, slips = np.array(LOADS_N), np.linspace(GranularWheel.BRAKING_LIMIT, 0.8, 23)
    wheel = by_table(GranularWheel().resultants, loads, slips)
    low, high = 1.25 * loads[0], loads[-1] / 1.25
    middle = float(np.sqrt(low * high))
    mass = float(middle * 0.45)
    vehicle = Vehicle(RADIUS_M, WIDTH_M, 0.0, 0.0, mass, (float(low), middle, float(high)), 0.7)
    world = replace(drawn_noise_world(rng), vehicle=vehicle)
    return ForeignCampaign(world, ground_of_terrain(), wheel, (slips[0], slips[-1]))


FOREIGN = {
    one.key: one
    for one in (
        Foreign("reece", "theta_m = (c1 + c2 s) theta_1, c1 .18 to .43", _reece, ("stress_peak_shift",), True),
        Foreign("resistive_force", "granular resistive force theory", _resistive),
        Foreign("hump_shear", "Wong and Oida's hump, residual .4 to .7", _hump, ("shear_softening",), True),
        Foreign(
            "elastic_tyre", "pressure of at most .5 to .75 of a rigid wheel's", _elastic_tyre, ("tyre_flattening",)
        ),
        Foreign("granular", "table of a granular simulation", _granular, ("slip_sinkage",), True),
    )
}
"""Every foreign wheel."""
