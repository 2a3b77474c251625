"""The catch-all: shapes of misfit that no cause of the library has to have.

Hats (one at a knot, falling straight to zero at its neighbours) over everything that a misfit may depend on, for each
channel; a zero that grows with the load, which standstills separate from the soil; and errors of ground speed and load,
which show in all channels at once. They are taken at the smoothed slip. An error of an input that is measured too large
moves a channel by minus its slope: the model is given what was measured.

A ground speed with the same error everywhere is a listed cause. One whose error is larger at some speeds is not, and no
shape of a force alone describes it: it is large where the pull is steep in the slip. The shapes of the load are those
of two listed causes, a zero and a gain of the load, for sets without them. Cross-talk and a constant zero, one taken
for the other, leave a zero that grows with the load; without a shape for it, it would be taken for zeros that differ
between runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from math import exp
from operator import neg

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.core.shapes import Kind, Shape
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.standstills import AT_REST, READ
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

    `shape` is what the hats have in common. The knots are ascending; of equal ones the last is kept, and `value` turns
    each into the value that it stands for. A hat is zero where `on`, of the shape (n,) of `x`, is not set.
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
        Its channel is the input's key in `daq.INPUTS`.
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
FORM_ERROR = 0.0015
"""One-sigma of the error of form of a model that is right: rms over the samples, as a share of the same.

No formula is nature's, no filter the sensor's, no mean over a block the mean of the model. These errors are the same in
every run: more runs do not average them out. What our own simulator's instruments and numerics leave after 200 runs is
about as large (docs/decisions/diagnosis-adequacy.md).
"""

FREE = 0.3
"""One-sigma of a curve that a formula is multiplied by where it is set free, at each of its knots."""

_DRIVE_KNOTS = (0.05, 0.2, 0.4, 0.65, 0.95)
_BRAKE_KNOTS = (0.05, 0.15, 0.3, 0.6)
_PLACES = 13
_OF_A_CHANNEL = (0.02, 0.25, 0.5, 0.75, 0.98)
"""Quantiles of a channel at which its own curve may bend."""
_TIMES_IN_RUN = 3


@dataclass(frozen=True)
class RunShapes:
    """Shapes that only one run may show, and the rank of each among all shapes."""

    shapes: tuple[Shape, ...] = ()
    order: IndexArray = field(default_factory=lambda: np.arange(0))


Freed = frozenset[tuple[str, str]]


@dataclass(frozen=True)
class CatchAll:
    """What the shapes of a campaign are.

    Attributes
    ----------
    shapes : tuple of Shape
        The b that every run may show.
    order : int array, shape (b,)
        Their ranks among all shapes, those of single runs included: channel after channel.
    input_heights : array, shape (b,)
        Largest error of an input, m/s or N; NaN for a shape of a channel.
    of_run : tuple of RunShapes
        Of every run.
    form : array, shape (b,)
        One-sigma of each shape's coefficient where they are the error of form: of all together it is `FORM_ERROR`; of
        a formula that is set free, 1.
    freed : set of (key, Kind)
        Effects whose formulas are set free, and over what.
    """

    shapes: tuple[Shape, ...]
    order: IndexArray
    input_heights: FloatArray
    of_run: tuple[RunShapes, ...]
    form: FloatArray
    freed: Freed = frozenset()

    @property
    def by_rank(self) -> tuple[Shape, ...]:
        """All shapes, those of single runs included."""
        shapes = (*self.shapes, *(shape for run in self.of_run for shape in run.shapes))
        ranks = np.concatenate([self.order, *(run.order for run in self.of_run)])
        return tuple(shapes[i] for i in np.argsort(ranks))


@dataclass(frozen=True)
class Basis:
    """The shapes of a campaign and their columns.

    Shapes of single runs share columns: there are as many as the run with most has (o), however many runs there are.

    Attributes
    ----------
    rows : array, shape (c, n, more + b + o + more)
        Columns and those of single runs, with room beside them for others, since they are large.
    columns : view of it, shape (c, n, b)
        In N, N m and m.
    own : view of it, shape (c, n, o)
        Of the shapes of the sample's run.
    rests : array, shape (3, m, b)
        Of drawbar pull and torque at standstill.
    """

    catch_all: CatchAll
    rows: FloatArray
    columns: FloatArray
    own: FloatArray
    rests: FloatArray


def basis(
    samples: Samples,
    linear: Linear,
    changes: Mapping[str, FloatArray] | None = None,
    freed: Freed = frozenset(),
    beside: tuple[int, int] = (0, 0),
) -> Basis:
    """Return the shapes of the channels, the zeros that standstills show, the inputs' and the formulas'.

    `changes`, shape (c, n), is what effects at the point change, of those in `freed`, whose formulas are set free:
    times a curve over a kind of shape. `beside` is for how many other columns there is room before and behind.
    """
    before, after = ([(s, x) for s, x in of(samples, linear) if np.std(x) > 0] for of in (_placed, _driven))
    formulas = [
        (replace(shape, cause=key), FREE * x * change)
        for key, change in (changes or {}).items()
        for shape, x in before
        if (key, shape.kind) in freed
    ]
    in_time, zeros, inputs = _in_time(samples), _channels_with_zeros(samples, linear), list(input_shapes(linear))
    channels = linear.channels
    width = (len(before) + len(after)) * len(channels) + len(zeros) + len(inputs) + len(formulas)
    rows, columns, own = _room(linear, beside, width, len(channels) * max(map(len, in_time), default=0))
    rests = np.zeros((len(READ), len(samples.rests), width))
    heights = np.full(width, np.nan)
    rank = count()
    listed: list[tuple[int, Shape]] = []
    of_run: list[list[tuple[int, Shape]]] = [[] for _ in in_time]

    def place(shape: Shape, among: list[tuple[int, Shape]] = listed) -> int:
        among.append((next(rank), shape))
        return len(among) - 1

    for row, channel in enumerate(channels):
        amplitude = amplitude_of(samples, channel)
        for shape, x in before:
            columns[row, :, place(replace(shape, channel=channel))] = amplitude * x
        for among, hats_of_run in zip(of_run, in_time, strict=True):
            for shape, at, x in hats_of_run:
                own[row, at, place(replace(shape, channel=channel), among)] = amplitude * x
        for shape, x in after:
            columns[row, :, place(replace(shape, channel=channel))] = amplitude * x
    for channel in zeros:
        amplitude, drive = amplitude_of(samples, channel), linear.conditions
        rolling, resting = (growing_with_load(at, drive) for at in (drive, samples.rests.conditions))
        column = place(Shape(Kind.ZERO_WITH_LOAD, channel))
        columns[channels.index(channel), :, column] = amplitude * rolling
        rests[AT_REST.index(channel), :, column] = np.where(samples.rests.lifted, 0.0, amplitude * resting)
    for error in inputs:
        column = place(error.shape)
        columns[..., column] = error.columns
        heights[column] = error.height
    unit = [amplitude_of(samples, channel) for channel in channels]
    squares = (np.vdot(of, of) / amplitude**2 for of, amplitude in zip(columns, unit, strict=True))
    together = float(sum(squares)) / linear.value.size
    form = np.full(width, FORM_ERROR / AMPLITUDE / np.sqrt(together) if together > 0 else 0.0)
    for shape, x in formulas:
        column = place(shape)
        columns[..., column], form[column] = x, 1.0
    shared, runs = _ranked(listed), tuple(_ranked(among) for among in of_run)
    return Basis(CatchAll(shared.shapes, shared.order, heights, runs, form, freed), rows, columns, own, rests)


def _ranked(listed: list[tuple[int, Shape]]) -> RunShapes:
    return RunShapes(tuple(shape for _, shape in listed), np.array([rank for rank, _ in listed], np.intp))


def no_basis(samples: Samples, linear: Linear, beside: tuple[int, int] = (0, 0)) -> Basis:
    """Return no shapes at all, for a fit that has no use for them."""
    catch_all = CatchAll((), np.arange(0), np.zeros(0), (RunShapes(),) * samples.runs, np.zeros(0))
    return Basis(catch_all, *_room(linear, beside, 0, 0), np.zeros((len(READ), len(samples.rests), 0)))


def _room(linear: Linear, beside: tuple[int, int], width: int, own: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return zeros for all columns, and the views of the shared ones and of those of single runs."""
    start, stop = beside[0] + width, beside[0] + width + own
    rows = np.zeros((*linear.value.shape, stop + beside[1]))
    return rows, rows[..., beside[0] : start], rows[..., start:stop]


def _channels_with_zeros(samples: Samples, linear: Linear) -> list[str]:
    """Return the channels whose standstills part a zero that grows with the load from the soil."""
    if not several_loads(linear.conditions):
        return []
    known = [c for c in AT_REST if c in linear.channels and c in samples.rests.measured]
    return [c for c in known if np.isfinite(samples.rests.measured[c][~samples.rests.lifted]).any()]


def amplitude_of(samples: Samples, channel: str) -> float:
    """Return one-sigma of a shape, in the channel's unit."""
    load = float(np.median(samples.conditions.vertical_load_n)) if len(samples) else 1.0
    unit = {"dp": load, "t": load * samples.wheel_radius_m, "z": samples.wheel_radius_m}
    return AMPLITUDE * unit[channel]


def _placed(samples: Samples, linear: Linear) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield the shapes over slip, load, speed and place, without their channel."""
    at = linear.conditions
    slip, speed = np.asarray(at.slip), np.asarray(at.ground_speed_mps)
    yield from hats(Shape(Kind.SLIP), slip, _DRIVE_KNOTS, slip > 0)
    yield from hats(Shape(Kind.BRAKING_SLIP), -slip, _BRAKE_KNOTS, slip < 0, neg)
    driving, growing = _driving(linear), growing_with_load(at, at)
    yield Shape(Kind.LOAD_DRIVING), driving * growing
    yield Shape(Kind.LOAD_BRAKING), (1.0 - driving) * growing
    yield Shape(Kind.LOAD_SQUARED), growing**2
    yield from hats_of_speed(Shape(Kind.GROUND_SPEED), speed)
    place = np.asarray(samples.conditions.line_position)
    yield from hats(Shape(Kind.LINE_POSITION), place, tuple(np.linspace(-1.0, 1.0, _PLACES)), np.isfinite(place))


def _driven(samples: Samples, linear: Linear) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield the shapes of direction and of products, without their channel."""
    driving = _driving(linear)
    yield from _of_direction(np.asarray(samples.conditions.direction), driving)
    yield from _products(samples, linear, driving)


def _driving(linear: Linear) -> FloatArray:
    """Return 1 where the wheel drives and 0 where it brakes, shape (n,)."""
    return np.where(np.asarray(linear.conditions.slip) > 0, 1.0, 0.0)


def _in_time(samples: Samples) -> list[list[tuple[Shape, IndexArray, FloatArray]]]:
    """Return hats over each run's own time, early, middle and late: shape, the run's samples, and values there."""
    found = []
    for index, name in enumerate(samples.run_names):
        at = np.flatnonzero(samples.run == index)
        time = samples.time_s[at]
        over = Shape(Kind.TIME_IN_RUN, unit="s", run=name)
        knots = tuple(np.linspace(time.min(), time.max(), _TIMES_IN_RUN)) if len(at) > 1 else ()
        own = hats(over, time, knots, np.ones(len(at), bool)) if knots else ()
        found.append([(shape, at, x) for shape, x in own if x.any()])
    return found


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

    `at` is of samples or standstills, `drive` of the samples: their mean load is what a load is counted from.
    """
    mean = float(np.mean(np.asarray(drive.vertical_load_n)))
    return (np.asarray(at.vertical_load_n) / mean - 1.0) / LOAD_SPREAD


def several_loads(drive: Conditions) -> bool:
    """Return whether there is more than one load."""
    load = np.asarray(drive.vertical_load_n)
    return bool(np.ptp(load) > _SAME_LOAD * load.mean())
