"""A campaign seen at 5 Hz with the truth in hand: what each cause changes, and what else could change it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from blind.field import FieldDay, physics_of
from blind.ground import KEYS, SPREAD, Ground
from blind.wheel import COLUMNS, Care, Moments, Physics, Reading, readings, simulated

from daq import FloatArray

STEP = 40
"""Of 200 Hz: 5 Hz."""
LEVELS = (0.5, 1.0, 2.0, 5.0)
_LEAST_MPS = 0.5
_NODES = 28


@dataclass(frozen=True)
class Sight:
    """5 Hz rows of all runs, one after the other.

    Attributes
    ----------
    moments : Moments
    ground : Ground
        With every run's own scatter, shape (n,).
    run : int array (n,)
    rolls, rests : bool arrays (n,)
        Rows that count: fast enough for a slip, or at rest.
    pull, torque : float arrays (n,)
        Of Wong's wheel, without anything hidden.
    slopes : mapping -> array (2, n)
        By ``speed`` (per m/s), ``load`` (per N), and the soil's parameters (per unit of their log).
    """

    moments: Moments
    ground: Ground
    run: np.ndarray
    rolls: np.ndarray
    rests: np.ndarray
    pull: FloatArray
    torque: FloatArray
    slopes: dict[str, FloatArray]
    care: Care

    @property
    def rows(self) -> np.ndarray:
        """Rows that count."""
        return self.rolls | self.rests

    def change(self, hidden: Sequence[tuple[str, float]]) -> FloatArray:
        """Return how measured less simulated changes, shape (2, n): N and N m."""
        physics = physics_of(hidden)
        m = self.moments
        reading = self._reading(physics)
        unmoved = np.array_equal(reading.speed, m.speed) and np.array_equal(reading.load, m.load)
        said = (self.pull, self.torque) if unmoved else simulated(self.ground, m, reading, self.care)
        mass, inertia = m.vehicle.outboard_kg, m.vehicle.outboard_kgm2
        pull, torque = reading.pull + mass * m.acceleration, reading.torque - inertia * m.alpha
        return np.stack([pull - said[0], torque - said[1]])

    def _reading(self, physics: Physics) -> Reading:
        """Solve for the soil's forces only where the cause is in the soil or the slip."""
        plain, m = Physics(), self.moments
        in_soil = any(
            getattr(physics, f.name) is not getattr(plain, f.name)
            for f in fields(Physics)
            if f.name not in ("read",) and not _same_default(f.name, physics, plain)
        )
        if in_soil:
            return readings(physics, self.ground, m, self.care)[0]
        mass, inertia = m.vehicle.outboard_kg, m.vehicle.outboard_kgm2
        pull, torque = self.pull - mass * m.acceleration, self.torque + inertia * m.alpha
        return physics.read(Reading(pull, torque, m.speed, m.omega, m.load), m)


def _same_default(name: str, physics: Physics, plain: Physics) -> bool:
    return getattr(physics, name) == getattr(plain, name)


def sight_of(day: FieldDay) -> Sight:
    """Look at a campaign at 5 Hz."""
    return sight_along(day.moments, day.ground, day.scatter)


def sight_along(runs: Sequence[Moments], soil: Ground, scatter: Sequence[Mapping[str, float]]) -> Sight:
    """Look at runs at 5 Hz, each with its own scatter of the soil."""
    parts, delayed, run, logs = [], [], [], []
    for index, moments in enumerate(runs):
        rows = slice(STEP // 2, None, STEP)
        part = moments.at(rows)
        parts.append(part)
        delayed.append(lambda dt, rows=rows, later=moments.later: later(dt)[rows])
        run.append(np.full(len(part.speed), index))
        logs.append({key: np.full(len(part.speed), value) for key, value in scatter[index].items()})
    joined = Moments(
        **{name: np.concatenate([getattr(p, name) for p in parts]) for name in COLUMNS},
        later=lambda dt: np.concatenate([d(dt) for d in delayed]),
        vehicle=runs[0].vehicle,
    )
    ground = soil.changed({key: np.concatenate([x[key] for x in logs]) for key in logs[0]})
    m = joined
    rolls = np.maximum(m.speed, m.vehicle.radius_m * m.omega) >= _LEAST_MPS
    rests = (m.speed < 1e-3) & (m.omega < 1e-3)
    reading, sinkage = readings(Physics(), ground, m, Care(nodes=_NODES))
    care = Care(nodes=_NODES, start=np.where(sinkage > 0, sinkage, 0.2 * m.vehicle.radius_m))
    mass, inertia = m.vehicle.outboard_kg, m.vehicle.outboard_kgm2
    pull, torque = reading.pull + mass * m.acceleration, reading.torque - inertia * m.alpha
    return Sight(m, ground, np.concatenate(run), rolls, rests, pull, torque, _slopes(ground, m, care), care)


def _slopes(ground: Ground, m: Moments, care: Care) -> dict[str, FloatArray]:
    def forces(soil: Ground, speed: float = 0.0, load: float = 0.0) -> FloatArray:
        moved = np.where(m.speed > 0, m.speed + speed, 0.0)
        reading = Reading(m.load, m.load, np.maximum(moved, 0.0), m.omega, m.load + load)
        return np.stack(simulated(soil, m, reading, care))

    def central(key: str, step: float) -> FloatArray:
        return (forces(ground.changed({key: step})) - forces(ground.changed({key: -step}))) / (2 * step)

    slopes = {key: central(key, 0.02) for key in KEYS}
    slopes["stiffness"] = slopes["cohesive"] + slopes["frictional"]
    slopes["speed"] = (forces(ground, speed=0.01) - forces(ground, speed=-0.01)) / 0.02
    step = 0.006 * m.vehicle.loads_n[0]
    slopes["load"] = (forces(ground, load=step) - forces(ground, load=-step)) / (2 * step)
    return slopes


def soil_columns(sight: Sight) -> FloatArray:
    """Return what one sigma of each of the laboratory's parameters changes, shape (6, 2, n)."""
    return np.stack([SPREAD[key] * sight.slopes[key] for key in KEYS])
