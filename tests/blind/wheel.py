"""A wheel driven over the ground: drawbar pull and torque at each moment, with whatever is hidden in the physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from blind.ground import Ground
from blind.rim import NODES, Column, Rim, Shear, janosi, settled, sums
from numpy.typing import NDArray

from daq import FloatArray

REST_MPS = 0.1


@dataclass(frozen=True)
class Vehicle:
    """The instrumented wheel and the vehicle around it; the defaults are Yang's (2016).

    Attributes
    ----------
    outboard_kg, outboard_kgm2 : on the soil's side of the transducer; vehicle.toml declares them
    loads_n : the three vertical loads of the runs
    pace : factor on every speed that is driven
    """

    radius_m: float = 0.47
    width_m: float = 0.318
    outboard_kg: float = 75.0
    outboard_kgm2: float = 8.0
    mass_kg: float = 3600.0
    loads_n: tuple[float, float, float] = (8000.0, 11000.0, 13000.0)
    pace: float = 1.0


YANG = Vehicle()


@dataclass(frozen=True)
class Moments:
    """What happens to the wheel, shape (n,) each; `later(dt)` is the ground speed dt seconds later.

    `line` runs from -1 to 1 along the campaign's line, `clock` from -1/2 to 1/2 over its time.
    """

    time_s: FloatArray
    speed: FloatArray
    omega: FloatArray
    acceleration: FloatArray
    alpha: FloatArray
    load: FloatArray
    distance_m: FloatArray
    line: FloatArray
    clock: FloatArray
    direction: FloatArray
    passes: FloatArray
    inflation: FloatArray
    later: Callable[[float], FloatArray] = field(repr=False, default=lambda dt: np.zeros(0))
    vehicle: Vehicle = YANG

    @property
    def slip(self) -> FloatArray:
        """Both branches: (r omega - V) over the larger; 0 at rest."""
        return slip_of(self.vehicle.radius_m * self.omega, self.speed)

    @property
    def rolls(self) -> FloatArray:
        """1 where the wheel rolls, 0 at rest."""
        return np.tanh((self.speed / REST_MPS) ** 2)

    def at(self, rows: slice | NDArray[np.intp]) -> Moments:
        """Return some of the moments (without `later`)."""
        return Moments(**{name: getattr(self, name)[rows] for name in COLUMNS}, vehicle=self.vehicle)


COLUMNS = tuple(name for name in Moments.__dataclass_fields__ if name not in ("later", "vehicle"))
"""Fields of `Moments` that are arrays."""


def slip_of(rim_speed: FloatArray, speed: FloatArray) -> FloatArray:
    """(r omega - V)/max of both; 0 where both are small."""
    larger = np.maximum(rim_speed, speed)
    return np.where(larger > 1e-3, (rim_speed - speed) / np.maximum(larger, 1e-3), 0.0)


@dataclass(frozen=True)
class Reading:
    """What perfect sensors would say, shape (n,): N, N m, m/s, rad/s, N."""

    pull: FloatArray
    torque: FloatArray
    speed: FloatArray
    omega: FloatArray
    load: FloatArray


Resultants = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Drawbar pull, driving torque and sinkage (n,) at a slip (n,) and a vertical load (n,)."""


@dataclass(frozen=True)
class Physics:
    """Wong's wheel, and what a hidden cause makes of it. Hooks get `Moments` and give columns (n,).

    `most_pa` is the pressure that a tyre does not exceed; `resultants` stands in for all that Wong's wheel is.
    """

    ground: Callable[[Ground, Moments], Ground] = lambda ground, moments: ground
    slip: Callable[[Moments], FloatArray] = lambda moments: moments.slip
    radius: Callable[[Moments], Column] = lambda moments: moments.vehicle.radius_m
    sinkage: Callable[[FloatArray, FloatArray], FloatArray] | None = None
    peak: Callable[[FloatArray], Column] = lambda slip: 0.0
    exit_share: float = 0.0
    exit_angle: Callable[[FloatArray], Column] = lambda slip: 0.0
    interface: float = 1.0
    lug: float = 0.0
    lug_arm: float = 0.0
    shear: Shear = janosi
    most_pa: float = np.inf
    resultants: Resultants | None = None
    hub: Callable[[Moments, FloatArray, Ground], tuple[Column, Column]] | None = None
    read: Callable[[Reading, Moments], Reading] = lambda reading, moments: reading


def _column(value: Column) -> Column:
    return value[:, None] if isinstance(value, np.ndarray) and value.ndim == 1 else value


def _rim(physics: Physics, ground: Ground, moments: Moments, slip: FloatArray) -> Rim:
    soil = physics.ground(ground, moments)
    slow = np.clip(slip, -0.995, 0.995)
    return Rim(
        ratio=_column(np.where(slow < 0, 1 / (1 + slow), 1 - slow)),
        radius=_column(physics.radius(moments)),
        width=moments.vehicle.width_m,
        cohesion=_column(soil.cohesion),
        friction=_column(soil.friction * physics.interface),
        shear_modulus=_column(soil.shear_modulus),
        stiffness=_column(soil.stiffness(moments.vehicle.width_m)),
        exponent=_column(soil.exponent),
        peak=_column(physics.peak(slip)),
        exit_share=physics.exit_share,
        exit_angle=_column(physics.exit_angle(slip)),
        lug=physics.lug,
        lug_arm=physics.lug_arm,
        shear=physics.shear,
        most_pa=physics.most_pa,
    )


@dataclass(frozen=True)
class Care:
    """How the forces are found: nodes, every how many moments the balance is solved, and from where (n,)."""

    nodes: int = NODES
    every: int = 1
    start: FloatArray | None = None


FULL = Care()


def soil_forces(
    physics: Physics, ground: Ground, moments: Moments, care: Care = FULL
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return drawbar pull, torque and sinkage (n,) of the wheel; 0 at rest. Eq. 7 returns the load exactly.

    A wheel by its resultants on soil that is stiffer by a factor carries a load that is larger by it.

    Where the balance is not solved at every moment, the normal stress makes up for the interpolation.
    """
    slip = physics.slip(moments)
    turning = np.flatnonzero((moments.speed > 0) | (moments.omega > 0))
    if physics.resultants is not None:
        factor = np.broadcast_to(physics.ground(ground, moments).factor, slip.shape)[turning]
        pull, torque, depth = physics.resultants(slip[turning], moments.load[turning] / factor)
        return _spread((factor * pull, factor * torque, depth), turning, len(slip))
    rim, slip = _rim(physics, ground, moments, slip).rows(turning), slip[turning, None]
    load = moments.load[turning, None]
    coarse = np.arange(0, len(turning), care.every)
    start = None if care.start is None else care.start[turning[coarse], None]
    static = settled(rim.rows(coarse), load[coarse], start, care.nodes)
    if care.every > 1:
        static = np.exp(np.interp(np.arange(len(turning)), coarse, np.log(static[:, 0])))[:, None]
    deepest = 0.97 * moments.vehicle.radius_m
    total = static if physics.sinkage is None else np.minimum(physics.sinkage(static, slip), deepest)
    found = sums(rim, total, care.nodes)
    scale = (load - found.load_cohesion) / found.load
    arm = moments.vehicle.radius_m / np.broadcast_to(rim.radius, load.shape)  # of a tread that runs at r omega
    torque = arm * (found.torque * scale + found.torque_cohesion)
    columns = (found.pull * scale + found.pull_cohesion, torque, total)
    return _spread([values[:, 0] for values in columns], turning, len(moments.speed))


def _spread(
    columns: Sequence[FloatArray], rows: NDArray[np.intp], count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return columns of some rows among all, 0 elsewhere."""
    out = np.zeros((3, count))
    out[:, rows] = columns
    return out[0], out[1], out[2]


def readings(physics: Physics, ground: Ground, moments: Moments, care: Care = FULL) -> tuple[Reading, FloatArray]:
    """Return what perfect sensors say at the hub, and the sinkage."""
    vehicle = moments.vehicle
    pull, torque, sinkage = soil_forces(physics, ground, moments, care)
    pull, torque = pull * moments.rolls, torque * moments.rolls
    if physics.hub is not None:
        more_pull, more_torque = physics.hub(moments, sinkage, physics.ground(ground, moments))
        pull, torque = pull + more_pull, torque + more_torque
    pull, torque = pull - vehicle.outboard_kg * moments.acceleration, torque + vehicle.outboard_kgm2 * moments.alpha
    plain = Reading(pull, torque, moments.speed, moments.omega, moments.load)
    return physics.read(plain, moments), sinkage


def simulated(ground: Ground, moments: Moments, reading: Reading, care: Care = FULL) -> tuple[FloatArray, FloatArray]:
    """Return drawbar pull and torque that Wong's wheel would have at what the sensors say of speed and load."""
    load = np.maximum(reading.load, 0.025 * moments.vehicle.loads_n[0])
    priors = replace(moments, speed=reading.speed, omega=reading.omega, load=load)
    pull, torque, _ = soil_forces(Physics(), ground, priors, care)
    return pull * moments.rolls, torque * moments.rolls
