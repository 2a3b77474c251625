"""The catch-all: shapes of misfit that no cause of the library has to have.

Smooth hats over everything that a misfit may hang on, for each channel on its own; a zero that grows with the load,
which standstills part from the soil; and errors of ground speed and load, which show in all channels at once. They are
taken at the smoothed slip, like everything else.

Cross-talk and a constant zero, one taken for the other, leave a zero that grows with the load. Where no shape shows it,
it passes for zeros that differ from run to run.

Hats: shapes that are one at a knot and fall straight to nothing at its neighbours.

What an error of an input does to every channel at once: the catch-all's shapes for ground speed and load.

A speed that is off by the same everywhere is a listed cause. One that is off by more at some speeds than at others is
not, and no shape of a force alone shows it well: it is large where pull is steep in slip, and nothing elsewhere. The
shapes of the load are what two listed causes do, a zero and a gain of the load, asked of sets without them.

An error is measured less true, as everywhere: the model, which is given what was measured, is off by minus its slope.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import exp
from operator import neg

import numpy as np

from daq import BoolArray, FloatArray
from model.diagnosis.core.shapes import Kind, Shape
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.samples import AT_REST, Samples
from model.wheel_soil.conditions import Conditions

LOAD_SPREAD = 0.15
"""Departure from the mean load, as a share of it, at which a shape that grows with load is 1."""
_SAME_LOAD = 1e-6
"""Share of the mean by which loads must differ to be two."""
_LEAST_SPEED_MPS = 0.1
_OF_SPEED = (0.02, 0.35, 0.65, 0.98)
"""Quantiles of the logarithm of the ground speed at which a hat stands."""


def hats(
    shape: Shape,
    x: FloatArray,
    knots: tuple[float, ...],
    on: BoolArray,
    value: Callable[[float], float] = float,
) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield a hat over each knot; the outer ones go on.

    Parameters
    ----------
    shape : Shape
        What the hats have in common.
    x : array, shape (n,)
    knots : tuple of float
        Ascending; of equal ones the last is kept.
    on : bool array, shape (n,)
        Where it may differ from zero; elsewhere it is zero.
    value : callable
        Turns a knot into the value that it stands for.
    """
    knots = tuple(k for k, after in zip(knots, (*knots[1:], np.inf), strict=True) if after > k)
    clipped = np.clip(np.where(on, x, knots[0]), knots[0], knots[-1])
    values = [value(k) for k in knots]
    for i, knot in enumerate(values):
        height = np.zeros(len(knots))
        height[i] = 1.0
        own = replace(shape, range=(values[max(i - 1, 0)], values[min(i + 1, len(knots) - 1)]), knot=knot)
        yield own, np.where(on, np.interp(clipped, knots, height), 0.0)


def hats_of_speed(shape: Shape, speed_mps: FloatArray) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield hats over the logarithm of the ground speed, shape (n,)."""
    tempo = np.log(np.maximum(speed_mps, _LEAST_SPEED_MPS))
    knots = tuple(np.quantile(tempo, _OF_SPEED))
    yield from hats(replace(shape, unit="m/s"), tempo, knots, np.ones(len(tempo), bool), exp)


SPEED_MPS = 0.03
"""One-sigma of an error of the ground speed that lasts over a range of speeds."""
LOAD_SHARE = 0.02
"""One-sigma of an error of the load, as a share of the mean load."""


@dataclass(frozen=True)
class InputShape:
    """An error of an input and what it does.

    Attributes
    ----------
    shape : Shape
        Its channel is the input's key in `model.diagnosis.core.result.INPUTS`.
    columns : array, shape (c, n)
        In N, N m and m.
    height : float
        The error's largest value, in m/s or N.
    """

    shape: Shape
    columns: FloatArray
    height: float


def input_shapes(linear: Linear) -> Iterator[InputShape]:
    """Yield the shapes; what grows with the load only where there is more than one load."""
    at = linear.conditions
    by_speed, by_load = np.nan_to_num(linear.speed), np.nan_to_num(linear.load)
    for shape, hat in hats_of_speed(Shape(Kind.SPEED_ERROR, "v"), np.asarray(at.ground_speed_mps)):
        yield InputShape(shape, -SPEED_MPS * by_speed * hat, SPEED_MPS)
    size = LOAD_SHARE * float(np.mean(np.asarray(at.vertical_load_n)))
    yield InputShape(Shape(Kind.LOAD_ERROR, "w"), -size * by_load, size)
    if several_loads(at):
        growing = growing_with_load(at, at)
        grown = Shape(Kind.LOAD_ERROR_WITH_LOAD, "w")
        yield InputShape(grown, -size * by_load * growing, size * float(np.abs(growing).max()))


AMPLITUDE = 0.02
"""One-sigma of a shape: share of the load, of load times radius, of the radius."""

_DRIVE_KNOTS = (0.05, 0.2, 0.4, 0.65, 0.95)
_BRAKE_KNOTS = (0.05, 0.15, 0.3, 0.6)
_PLACES = 13
_OF_A_CHANNEL = (0.02, 0.25, 0.5, 0.75, 0.98)
"""Quantiles of a channel at which its own curve may bend."""
_TIMES_IN_RUN = 3


@dataclass(frozen=True)
class Basis:
    """The shapes of a campaign.

    Attributes
    ----------
    columns : array, shape (c, n, b)
        In N, N m and m.
    rests : array, shape (2, m, b)
        Of drawbar pull and torque at standstill.
    input_heights : array, shape (b,)
        Largest error of an input, m/s or N; NaN for a shape of a channel.
    """

    shapes: tuple[Shape, ...]
    columns: FloatArray
    rests: FloatArray
    input_heights: FloatArray


def basis(samples: Samples, linear: Linear) -> Basis:
    """Return the shapes of the channels, then the zeros that standstills show, then those of the inputs."""
    own = [(shape, x) for shape, x in _shapes(samples, linear) if np.std(x) > 0]
    zeros, inputs = _channels_with_zeros(samples, linear), list(input_shapes(linear))
    found = _empty(samples, linear, len(own) * len(linear.channels) + len(zeros) + len(inputs))
    shapes: list[Shape] = []
    for row, channel in enumerate(linear.channels):
        amplitude = amplitude_of(samples, channel)
        for shape, x in own:
            found.columns[row, :, len(shapes)] = amplitude * x
            shapes.append(replace(shape, channel=channel))
    for channel in zeros:
        amplitude, drive = amplitude_of(samples, channel), linear.conditions
        rolling, resting = (growing_with_load(at, drive) for at in (drive, samples.rests.conditions))
        found.columns[linear.channels.index(channel), :, len(shapes)] = amplitude * rolling
        found.rests[AT_REST.index(channel), :, len(shapes)] = amplitude * resting
        shapes.append(Shape(Kind.ZERO_WITH_LOAD, channel))
    for error in inputs:
        found.columns[..., len(shapes)] = error.columns
        found.input_heights[len(shapes)] = error.height
        shapes.append(error.shape)
    return replace(found, shapes=tuple(shapes))


def no_basis(samples: Samples, linear: Linear) -> Basis:
    """Return no shapes at all, for a fit that has no use for them."""
    return _empty(samples, linear, 0)


def _empty(samples: Samples, linear: Linear, count: int) -> Basis:
    rests = np.zeros((len(AT_REST), len(samples.rests), count))
    return Basis((), np.zeros((*linear.value.shape, count)), rests, np.full(count, np.nan))


def _channels_with_zeros(samples: Samples, linear: Linear) -> list[str]:
    """Return the channels whose standstills part a zero that grows with the load from the soil."""
    if not several_loads(linear.conditions):
        return []
    known = [c for c in AT_REST if c in linear.channels and c in samples.rests.measured]
    return [c for c in known if np.isfinite(samples.rests.measured[c]).any()]


def amplitude_of(samples: Samples, channel: str) -> float:
    """Return one-sigma of a shape, in the channel's unit."""
    load = float(np.median(samples.conditions.vertical_load_n)) if len(samples) else 1.0
    unit = {"dp": load, "t": load * samples.wheel_radius_m, "z": samples.wheel_radius_m}
    return AMPLITUDE * unit[channel]


def _shapes(samples: Samples, linear: Linear) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield the shapes that every channel has, without their channel."""
    at = linear.conditions
    slip, speed = np.asarray(at.slip), np.asarray(at.ground_speed_mps)
    yield from hats(Shape(Kind.SLIP), slip, _DRIVE_KNOTS, slip > 0)
    yield from hats(Shape(Kind.BRAKING_SLIP), -slip, _BRAKE_KNOTS, slip < 0, neg)
    driving = np.where(slip > 0, 1.0, 0.0)
    growing = growing_with_load(at, at)
    yield Shape(Kind.LOAD_DRIVING), driving * growing
    yield Shape(Kind.LOAD_BRAKING), (1.0 - driving) * growing
    yield Shape(Kind.LOAD_SQUARED), growing**2
    yield from hats_of_speed(Shape(Kind.GROUND_SPEED), speed)
    place = np.asarray(samples.conditions.line_position)
    yield from hats(Shape(Kind.LINE_POSITION), place, tuple(np.linspace(-1.0, 1.0, _PLACES)), np.isfinite(place))
    yield from _in_time(samples)
    yield from _of_direction(np.asarray(samples.conditions.direction), driving)
    yield from _products(samples, linear, driving)


def _in_time(samples: Samples) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield hats over each run's own time: early, middle and late."""
    for index, name in enumerate(samples.run_names):
        own = samples.run == index
        if own.sum() < 2:
            continue
        at = samples.time_s
        knots = np.linspace(at[own].min(), at[own].max(), _TIMES_IN_RUN)
        yield from hats(Shape(Kind.TIME_IN_RUN, unit="s", run=name), at, tuple(knots), own)


def _of_direction(direction: FloatArray, driving: FloatArray) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield what has the sign of the direction; a constant where all runs go one way."""
    two_ways = np.ptp(direction) > 0
    sense = direction if two_ways else np.ones(len(direction))
    yield Shape(Kind.DIRECTION_DRIVING if two_ways else Kind.CONSTANT_DRIVING), sense * driving
    yield Shape(Kind.DIRECTION_BRAKING if two_ways else Kind.CONSTANT_BRAKING), sense * (1.0 - driving)


def _products(samples: Samples, linear: Linear, driving: FloatArray) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield shapes of usual causes that nobody lists: hysteresis, lag, curved channels."""
    at = linear.conditions
    yield Shape(Kind.ACCELERATION_DRIVING), driving * np.tanh(np.asarray(at.ground_acceleration_mps2) / 0.3)
    yield Shape(Kind.ACCELERATION_BRAKING), (1.0 - driving) * np.tanh(np.asarray(at.ground_acceleration_mps2) / 0.3)
    spin, omega = np.asarray(at.wheel_acceleration_radps2), np.maximum(np.asarray(at.wheel_speed_radps), 0.3)
    ground = np.maximum(np.asarray(at.ground_speed_mps), 0.1)
    rate = np.where(
        np.asarray(at.slip) > 0,
        (1.0 - np.asarray(at.slip)) * (spin / omega - np.asarray(at.ground_acceleration_mps2) / ground),
        (1.0 + np.asarray(at.slip)) * (spin / omega - np.asarray(at.ground_acceleration_mps2) / ground),
    )
    yield Shape(Kind.SLIP_RATE_DRIVING), driving * np.tanh(rate / 0.2)
    yield Shape(Kind.SLIP_RATE_BRAKING), (1.0 - driving) * np.tanh(rate / 0.2)
    yield from _of_channels(samples, linear)


_OWN_KINDS = (
    ("dp", "kN", Kind.DRAWBAR_PULL, Kind.DRAWBAR_PULL_SQUARED, Kind.DRAWBAR_PULL_DRIFT),
    ("t", "kN m", Kind.TORQUE, Kind.TORQUE_SQUARED, Kind.TORQUE_DRIFT),
)


def _of_channels(samples: Samples, linear: Linear) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield shapes of a channel's own doing: a curve that bends, a gain that drifts."""
    for channel, unit, bend, square, drift in _OWN_KINDS:
        if channel not in linear.channels:
            continue
        x = linear.value[linear.channels.index(channel)] / 1e3
        known = np.isfinite(x)
        if known.sum() < 2:
            continue
        x = np.where(known, x, 0.0)
        yield from hats(Shape(bend, unit=unit), x, tuple(np.quantile(x[known], _OF_A_CHANNEL)), known)
        x = x / max(float(np.std(x[known])), 1e-9)
        yield Shape(square), x * np.abs(x) / 2.0
        yield Shape(drift), np.nan_to_num(samples.conditions.campaign_time) * x


def growing_with_load(at: Conditions, drive: Conditions) -> FloatArray:
    """Return a shape that grows with the load, shape (n,): 1 where the load is `LOAD_SPREAD` above its mean.

    Parameters
    ----------
    at : Conditions
        Of samples or standstills.
    drive : Conditions
        Of the samples: their mean load is what a load is counted from.
    """
    mean = float(np.mean(np.asarray(drive.vertical_load_n)))
    return (np.asarray(at.vertical_load_n) / mean - 1.0) / LOAD_SPREAD


def several_loads(drive: Conditions) -> bool:
    """Return whether there is more than one load."""
    load = np.asarray(drive.vertical_load_n)
    return bool(np.ptp(load) > _SAME_LOAD * load.mean())
