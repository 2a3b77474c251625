"""What the model says of every sample, and how that changes with everything that may be otherwise.

All derivatives come from one pass in duals: by ground speed and load, by the soil, by every parameter of every cause
of the library at its current value. The soil's parameters are in units in which the laboratory knows them: independent,
of one-sigma 1. Everything is taken at one and the same slip, the smoothed one: columns at another
slip than the residual's let the fit rebuild the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray
from model.cores import in_parallel
from model.diagnosis.time_series.samples import STENCIL, Samples
from model.diagnosis.time_series.standstills import AT_REST, Standstills
from model.effects.base import Effect
from model.effects.speed_errors import DELAY as DELAY
from model.wheel_soil.conditions import Conditions, Reaction, Wheel
from model.wheel_soil.dual import Dual, Number, column, value_of
from model.wheel_soil.soils import SOIL_PARAMETERS, Soil, SoilPrior
from model.wheel_soil.stresses import slip_of_ratio
from model.wheel_soil.wheel_soil_model import Reading, WheelSoilModel

LATE_WHEEL = {"wheel_delay_s": 0.015, "wheel_edge_delay_rad": 0.06}
"""One-sigma of how late the wheel speed is beyond its declared delay: by a time, and by an angle of its ring.

A toothed ring tells its speed only when an edge comes: the slower the wheel, the longer it waits. The declared delay is
right at a typical speed. Ring and bus are the same in every run: as one value a run, independent of the others, their
delay would be known ever better by more runs, and be taken for a misfit.
"""
SENSORS = {**LATE_WHEEL, "sinkage_zero_m": 0.01}
"""One-sigma of what is unknown of sensors, is the same in every run, and is no cause of the library."""
_LEAST_RADPS = 0.3
_LOGARITHMIC_UP_TO = 0.5
"""Relative one-sigma up to which a positive parameter is moved by factors instead of by steps: it stays positive."""
_NOTHING = 1e-12


def labelled(campaign: str, label: str) -> str:
    """Put the name of a campaign, or of a wheel, before a label; `coordinate_of` takes it off."""
    return f"{campaign}: {label}"


def coordinate_of(label: str) -> str:
    """Return a coordinate of the soil, or of `SENSORS`, without the campaign or wheel that it is of."""
    return label.rpartition(": ")[2]


@dataclass(frozen=True)
class SoilSpace:
    """x = mean + R u, or mean exp(R u) where logarithmic; u ~ N(0, I).

    The last coordinates move no parameter of the soil: they are `SENSORS`, unknown in every campaign.

    Attributes
    ----------
    mean : array, shape (6,)
    logarithmic : bool array, shape (6,)
    root : array, shape (6, q)
    labels : tuple of str
        Of the q coordinates: the parameter that each is the first to move.
    """

    mean: FloatArray
    logarithmic: BoolArray
    root: FloatArray
    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)

    def values(self, u: FloatArray) -> dict[str, float]:
        """Return the soil's parameters at a point, SI units."""
        step = self.root @ u
        found = np.where(self.logarithmic, self.mean * np.exp(np.where(self.logarithmic, step, 0.0)), self.mean + step)
        return {name: float(x) for name, x in zip(SOIL_PARAMETERS, found, strict=True)}

    def jacobian(self, u: FloatArray) -> FloatArray:
        """Return dx/du, shape (6, q)."""
        at = np.array(list(self.values(u).values()))
        return np.where(self.logarithmic, at, 1.0)[:, None] * self.root

    def columns(self, by_soil: FloatArray, by_sensors: FloatArray, u: FloatArray) -> FloatArray:
        """Return derivatives by u, shape (c, n, q), from those by the parameters, (c, n, 6), and by `SENSORS`."""
        found = by_soil @ self.jacobian(u)
        found[..., -len(SENSORS) :] = by_sensors
        return np.asarray(found)


def soil_space(prior: SoilPrior) -> SoilSpace:
    """Return the coordinates that belong to a prior; an exactly known parameter has none."""
    sigma = np.sqrt(np.diag(prior.covariance))
    relative = sigma / np.where(prior.mean > 0, prior.mean, np.nan)
    logarithmic = np.nan_to_num(relative, nan=np.inf) <= _LOGARITHMIC_UP_TO
    unit = np.where(logarithmic, np.where(prior.mean > 0, prior.mean, 1.0), 1.0)
    scaled = sigma / unit
    known = np.flatnonzero(scaled > _NOTHING)
    correlation = prior.covariance[np.ix_(known, known)] / np.outer(sigma[known], sigma[known])
    root, kept = _triangle(correlation)
    full = np.zeros((len(sigma), len(kept) + len(SENSORS)))
    full[known, : len(kept)] = scaled[known, None] * root
    return SoilSpace(prior.mean, logarithmic, full, (*(SOIL_PARAMETERS[known[i]] for i in kept), *SENSORS))


def _triangle(correlation: FloatArray) -> tuple[FloatArray, list[int]]:
    """Return a lower triangle R with R R' the correlation, without the columns that would be zero."""
    left = correlation.copy()
    columns, kept = [], []
    for i in range(len(left)):
        if left[i, i] <= 1e-9:
            continue
        column = left[:, i] / np.sqrt(left[i, i])
        left = left - np.outer(column, column)
        columns.append(column)
        kept.append(i)
    return (np.stack(columns, axis=1) if columns else np.zeros((len(left), 0))), kept


_SPEED, _LOAD, _RATE, _SPIN = "measured speed", "measured load", "measured acceleration", "measured spin"
_LEAST_SPEED_MPS = 0.05
_SPEED_STEP = 0.02
SECANT_SHARE = 0.25
"""Of a prior's scale: where a derivative at neutral is infinite or zero, the column is a secant of this length."""


@dataclass(frozen=True)
class Simulation:
    """The simulation under test with every cause that is considered."""

    wheel: Wheel
    soil: Soil
    space: SoilSpace
    effects: tuple[type[Effect], ...]
    reading: Reading
    rolling_radius_m: float | None = None

    def model(self, values: Mapping[str, float]) -> WheelSoilModel:
        """Return the model with only those effects that are not at their neutral."""
        return WheelSoilModel(self.wheel, self.soil, self.active(values), self.reading)

    def active(self, values: Mapping[str, float]) -> tuple[type[Effect], ...]:
        """Return the effects that `values` moves away from neutral."""
        return tuple(e for e in self.effects if any(key in values for key in e.parameter_keys().values()))

    @property
    def parameters(self) -> list[tuple[type[Effect], int, str]]:
        """Effect, index of its parameter and the model's name of it, of every column."""
        return [(e, i, key) for e in self.effects for i, key in enumerate(e.parameter_keys().values())]


@dataclass(frozen=True)
class Point:
    """Where the model is linearised.

    Attributes
    ----------
    soil : array, shape (q,)
    causes : mapping model's parameter name -> value
        Without those at neutral.
    speed_mps, acceleration_mps2 : array, shape (n,)
        What is added to the measured ground speed of each sample, and to its acceleration.
    """

    soil: FloatArray
    causes: dict[str, float]
    speed_mps: FloatArray
    acceleration_mps2: FloatArray | float = 0.0


@dataclass(frozen=True)
class Linear:
    """A model about a point; arrays over channels ("dp", "t", "z" as far as measured), shape (c, n) or (c, n, columns).

    Attributes
    ----------
    conditions : Conditions
        With the ground speed and the slip of the point.
    value : array, shape (c, n)
        The model's, averaged over each sample's instants.
    centre : array, shape (c, n)
        The model's at each sample's mean.
    speed, curvature, load : array, shape (c, n)
        d/dV, d2/dV2, d/dW.
    acceleration : array, shape (c, n)
        Change of model less measurement by an error of the acceleration of the ground speed, which is in the
        compensated drawbar pull, too.
    soil : array, shape (c, n, q)
    causes : array, shape (c, n, k)
        By each parameter, in its own unit.
    stiffness, friction, cohesion : array, shape (c, n)
        By ln k, ln tan phi and ln c.
    rest_value : array, shape (3, m); rest_causes : array, shape (3, m, k)
        Of drawbar pull and torque at standstill.
    usable : bool array, shape (n,)
        Where the model has an answer.
    """

    channels: tuple[str, ...]
    point: Point
    conditions: Conditions
    value: FloatArray
    centre: FloatArray
    speed: FloatArray
    curvature: FloatArray
    load: FloatArray
    acceleration: FloatArray
    soil: FloatArray
    causes: FloatArray
    stiffness: FloatArray
    friction: FloatArray
    cohesion: FloatArray
    rest_value: FloatArray
    rest_causes: FloatArray
    usable: BoolArray = field(repr=False)


def at_point(samples: Samples, point: Point) -> Samples:
    """Return the samples with the ground speed of the moment itself, where the point has a delay of it."""
    return samples.with_delay(point.causes.get(DELAY, 0.0))


def at_speed(samples: Samples, point: Point) -> Conditions:
    """Return the samples' conditions with the ground speed of a point, its acceleration, and the slip with it."""
    at = samples.conditions
    moved = replace(at, ground_acceleration_mps2=at.ground_acceleration_mps2 + point.acceleration_mps2)
    return _moved(moved, at.ground_speed_mps + point.speed_mps, samples.wheel_radius_m)


def _moved(conditions: Conditions, ground_speed_mps: Number, radius_m: float) -> Conditions:
    speed = np.maximum(value_of(ground_speed_mps), _LEAST_SPEED_MPS) if not isinstance(ground_speed_mps, Dual) else None
    v = ground_speed_mps if speed is None else speed
    return replace(conditions, ground_speed_mps=v, slip=slip_of_ratio(v / (radius_m * conditions.wheel_speed_radps)))


def linearise(simulation: Simulation, samples: Samples, point: Point) -> Linear:
    """Linearise the model about a point."""
    samples = at_point(samples, point)
    channels = tuple(c for c in OUTPUTS if c in samples.measured)
    conditions = at_speed(samples, point)
    soil = simulation.space.values(point.soil)
    plain = simulation.model(point.causes)
    values = {**soil, **point.causes}
    v = conditions.ground_speed_mps
    step = np.minimum(_SPEED_STEP, 0.25 * v)
    secants = {
        i: (effect, key)
        for i, (effect, _, key) in enumerate(simulation.parameters)
        if effect.secant and key not in point.causes
    }

    def at_other_speed(side: float) -> FloatArray:
        moved = _moved(conditions, v + side * step, samples.wheel_radius_m)
        return _stacked(plain.predict(moved, values), channels)

    pieces = [_piece(conditions, rows) for rows in _pieces(len(samples))]
    parts: list[Callable[[], Any]] = [
        *(partial(_derivatives, simulation, piece, values, channels) for piece in pieces),
        lambda: simulated(simulation, samples, point),
        lambda: at_other_speed(1.0),
        lambda: at_other_speed(-1.0),
        *(partial(_by_secant, simulation, conditions, values, e, key, channels) for e, key in secants.values()),
    ]
    done = list((in_parallel if len(pieces) > 1 else map)(lambda part: part(), parts))  # of one they cost less
    found, (value, up, down, *moved) = _joined(done[: len(pieces)]), done[len(pieces) :]
    centre, causes = found["value"], found["causes"]
    for i, (by, share) in zip(secants, moved, strict=True):
        causes[..., i] = (by - centre) / share
    by_soil, by_sensors = found["soil"], _by_sensors(conditions, found["speed"], found["spin"], channels)
    rest_value, rest_causes = at_rest(simulation, samples, values)
    sound = [np.isfinite(x).all(axis=axes) for x, axes in ((value, 0), (causes, (0, 2)), (by_soil, (0, 2)))]
    at = dict(zip(SOIL_PARAMETERS, np.moveaxis(by_soil, -1, 0), strict=True))
    return Linear(
        channels=channels,
        point=point,
        conditions=conditions,
        value=value + by_sensors @ point.soil[-len(SENSORS) :],
        centre=centre,
        speed=found["speed"],
        curvature=np.nan_to_num((up - 2.0 * centre + down) / step**2),
        load=found["load"],
        acceleration=_of_acceleration(found["acceleration"], conditions, channels),
        soil=simulation.space.columns(by_soil, by_sensors, point.soil),
        causes=causes,
        stiffness=at["cohesive_modulus"] * soil["cohesive_modulus"]
        + at["frictional_modulus"] * soil["frictional_modulus"],
        friction=at["tan_phi"] * soil["tan_phi"],
        cohesion=at["cohesion_pa"] * soil["cohesion_pa"],
        rest_value=rest_value,
        rest_causes=rest_causes,
        usable=np.logical_and.reduce(sound),
    )


def _of_acceleration(by_model: FloatArray, conditions: Conditions, channels: Sequence[str]) -> FloatArray:
    """Return what an error of the acceleration does to model less measurement: its mass is added to the latter."""
    mass = _only("dp", channels) * conditions.compensated_mass_kg
    return np.asarray(np.nan_to_num(by_model) - mass)


def _only(channel: str, channels: Sequence[str]) -> FloatArray:
    """Return 1 for a channel and 0 for the others, shape (c, 1)."""
    return np.array([[float(c == channel)] for c in channels])


def _by_sensors(conditions: Conditions, speed: FloatArray, spin: FloatArray, channels: Sequence[str]) -> FloatArray:
    """Return what each of `SENSORS` does to each channel, shape (c, n, 3), per one-sigma."""
    zero = np.zeros((*speed.shape, 1))
    if "z" in channels:
        zero[channels.index("z")] = SENSORS["sinkage_zero_m"]
    return np.concatenate([late_wheel(conditions, speed, spin, channels), zero], axis=-1)


def late_wheel(conditions: Conditions, speed: FloatArray, spin: FloatArray, channels: Sequence[str]) -> FloatArray:
    """Return what a late wheel speed does to each channel, shape (c, n, 2): by each of `LATE_WHEEL`, per one-sigma.

    It acts by the slip, as an error of the ground speed does, and by the outboard inertia: what was compensated, and
    what the model adds to it. `speed` and `spin`, shape (c, n), are the model's derivatives by ground speed and by the
    wheel's angular acceleration.
    """
    omega = np.maximum(np.asarray(conditions.wheel_speed_radps), _LEAST_RADPS)
    acceleration = np.asarray(conditions.wheel_acceleration_radps2)
    compensated = _only("t", channels) * conditions.compensated_inertia_kgm2
    by_delay = -speed * np.asarray(conditions.ground_speed_mps) * acceleration / omega
    by_delay += np.nan_to_num((compensated + spin) * np.asarray(conditions.wheel_jerk_radps3))
    waiting = 1.0 / omega - 1.0 / float(np.median(omega))
    delay, angle = LATE_WHEEL.values()
    return np.stack([delay * by_delay, angle * by_delay * waiting], axis=-1)


ROWS_AT_ONCE = 2048
"""Samples whose derivatives are taken together: what bounds their memory."""


def derivatives(
    simulation: Simulation, conditions: Conditions, values: Mapping[str, float], channels: Sequence[str]
) -> dict[str, FloatArray]:
    """Return value and derivatives by speed, load, soil and causes at the samples' means, in one pass.

    The conditions are those of the samples, perhaps at another speed; `values` are the parameters of the soil, and
    those of causes that are not at neutral. The result has "value", "speed", "load", "acceleration" and "spin" of shape
    (c, n), and "soil", by the parameters themselves, and "causes" of shape (c, n, ...).
    """
    pieces = (_piece(conditions, rows) for rows in _pieces(len(np.asarray(conditions.slip))))
    return _joined([_derivatives(simulation, piece, values, channels) for piece in pieces])


def _pieces(count: int) -> list[slice]:
    return [slice(first, first + ROWS_AT_ONCE) for first in range(0, max(count, 1), ROWS_AT_ONCE)]


def _piece(conditions: Conditions, rows: slice) -> Conditions:
    return conditions.map(lambda x: np.asarray(x)[rows])


def _joined(parts: Sequence[dict[str, FloatArray]]) -> dict[str, FloatArray]:
    return {name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0]}


def _derivatives(
    simulation: Simulation, conditions: Conditions, values: Mapping[str, float], channels: Sequence[str]
) -> dict[str, FloatArray]:
    model = WheelSoilModel(simulation.wheel, simulation.soil, simulation.effects, simulation.reading)
    secants = {key for e, _, key in simulation.parameters if e.secant and key not in values}
    names = [*SOIL_PARAMETERS, *(key for _, _, key in simulation.parameters if key not in secants)]
    neutral = {key: e.parameters[i].neutral for e, i, key in simulation.parameters}
    radius, width = simulation.wheel.radius_m, simulation.wheel.width_m
    parameters: dict[str, Number] = {"radius_m": radius, "width_m": width, **neutral, **values}
    parameters |= {name: Dual(parameters[name], {name: 1.0}) for name in names}
    columns = conditions.map(column)
    speed = Dual(columns.ground_speed_mps, {_SPEED: 1.0})
    seeded = replace(
        _moved(columns, speed, simulation.rolling_radius_m or radius),
        vertical_load_n=Dual(columns.vertical_load_n, {_LOAD: 1.0}),
        ground_acceleration_mps2=Dual(columns.ground_acceleration_mps2, {_RATE: 1.0}),
        wheel_acceleration_radps2=Dual(columns.wheel_acceleration_radps2, {_SPIN: 1.0}),
    )
    with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
        outputs = model.evaluate(seeded, parameters)
    n = len(np.asarray(conditions.slip))

    def of(name: str, key: str) -> FloatArray:
        x = outputs[name]
        return np.broadcast_to(x.partials.get(key, 0.0) if isinstance(x, Dual) else 0.0, (n, 1))[:, 0]

    def by(key: str) -> FloatArray:
        return np.stack([of(OUTPUTS[c].field, key) for c in channels])

    return {
        "value": np.stack([np.broadcast_to(value_of(outputs[OUTPUTS[c].field]), (n, 1))[:, 0] for c in channels]),
        "speed": by(_SPEED),
        "load": by(_LOAD),
        "acceleration": by(_RATE),
        "spin": by(_SPIN),
        "soil": np.stack([by(name) for name in SOIL_PARAMETERS], axis=-1),
        "causes": np.stack([by(key) for _, _, key in simulation.parameters], axis=-1)
        if simulation.parameters
        else np.zeros((len(channels), n, 0)),
    }


def _stacked(prediction: Any, channels: Sequence[str]) -> FloatArray:
    return np.stack([getattr(prediction, OUTPUTS[c].field) for c in channels])


def _by_secant(
    simulation: Simulation,
    conditions: Conditions,
    values: Mapping[str, float],
    effect: type[Effect],
    key: str,
    channels: Sequence[str],
) -> tuple[FloatArray, float]:
    """Return the model's value with a fraction of a cause's scale, whose mean slope is wanted, and that fraction."""
    parameter = {k: p for p, k in zip(effect.parameters, effect.parameter_keys().values(), strict=True)}[key]
    step = SECANT_SHARE * parameter.towards(simulation.wheel)
    moved = {**values, key: parameter.neutral + step}
    return _stacked(simulation.model(moved).predict(conditions, moved), channels), step


def simulated(simulation: Simulation, samples: Samples, point: Point) -> FloatArray:
    """Return the model output of each sample, averaged over its three instants, NaN without one; shape (c, n)."""
    channels = tuple(c for c in OUTPUTS if c in samples.measured)
    values = {**simulation.space.values(point.soil), **point.causes}
    model = simulation.model(point.causes)
    samples = at_point(samples, point)
    instants = samples.instants
    total = np.zeros((len(channels), len(samples)))
    for weight, speed, omega, load in zip(
        STENCIL,
        instants.ground_speed_mps,
        instants.wheel_speed_radps,
        instants.vertical_load_n,
        strict=True,
    ):
        at = replace(samples.conditions, wheel_speed_radps=omega, vertical_load_n=load)
        moved = _moved(at, speed + point.speed_mps, samples.wheel_radius_m)
        total += weight * _stacked(model.predict(moved, values), channels)
    return total


def at_rest(
    simulation: Simulation, samples: Samples, values: Mapping[str, float], applied: Reaction | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return what shows of `READ` without soil, shape (3, m), and its derivatives by the causes, (3, m, k).

    `values` are the parameters that are not at neutral. `applied` is the known pull and torque on the wheel, shape
    (m,), instead of those of its static tests.
    """
    rests = samples.rests
    value, by_cause = _shown(simulation, rests, values, applied)
    if applied is None and (tested := rests.tested).any():
        known = Reaction(*(rests.applied[c] for c in AT_REST))
        under_force = _shown(simulation, rests, values, known)
        value[:, tested], by_cause[:, tested] = (x[:, tested] for x in under_force)
    return value, by_cause


def _shown(
    simulation: Simulation, rests: Standstills, values: Mapping[str, float], applied: Reaction | None
) -> tuple[FloatArray, FloatArray]:
    count = len(rests)
    names = [key for _, _, key in simulation.parameters]
    model = WheelSoilModel(simulation.wheel, simulation.soil, simulation.effects, simulation.reading)
    shown = (
        *model.at_rest(rests.conditions, dict(values), names, applied),
        model.slip_beyond(rests.conditions, dict(values), names),
    )

    def by(x: Number, key: str) -> FloatArray:
        return np.broadcast_to(x.partials.get(key, 0.0) if isinstance(x, Dual) else 0.0, (count,))

    value = np.stack([np.broadcast_to(value_of(x), (count,)) for x in shown])
    if not names:
        return value, np.zeros((len(shown), count, 0))
    return value, np.stack([np.stack([by(x, key) for key in names], axis=-1) for x in shown])
