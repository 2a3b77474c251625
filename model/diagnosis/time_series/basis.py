"""The catch-all: shapes of misfit that no cause of the library has to have.

Smooth hats over everything that a misfit may hang on, for each channel on its own; a zero that grows with the load,
which standstills part from the soil; and errors of ground speed and load, which show in all channels at once. Their
labels are what a person is told: "dp|slip 0.35 to 0.65". They are taken at the smoothed slip, like everything else.

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

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.rests import AT_REST, ZERO_WITH_LOAD, growing_with_load, several_loads
from model.diagnosis.time_series.samples import Samples

FloatArray = NDArray[np.float64]

_LEAST_SPEED_MPS = 0.1
_OF_SPEED = (0.02, 0.35, 0.65, 0.98)
"""Quantiles of the logarithm of the ground speed at which a hat stands."""


def hats(
    what: str,
    x: FloatArray,
    knots: tuple[float, ...],
    on: NDArray[np.bool_],
    say: Callable[[float], float] = float,
    unit: str = "",
) -> Iterator[tuple[str, FloatArray]]:
    """Yield label and shape of a hat over each knot; the outer ones go on.

    Parameters
    ----------
    what : str
        First words of the labels.
    x : array, shape (n,)
    knots : tuple of float
        Ascending; of equal ones the last is kept.
    on : bool array, shape (n,)
        Where it may differ from zero; elsewhere it is zero.
    say : callable
        Turns a knot into what is said of it.
    unit : str
        Behind what is said.
    """
    knots = tuple(k for k, after in zip(knots, (*knots[1:], np.inf), strict=True) if after > k)
    clipped = np.clip(np.where(on, x, knots[0]), knots[0], knots[-1])
    for i in range(len(knots)):
        height = np.zeros(len(knots))
        height[i] = 1.0
        low, high = ends(knots, i)
        yield hat_label(what, say(low), say(high), unit), np.where(on, np.interp(clipped, knots, height), 0.0)


def ends(knots: tuple[float, ...], i: int) -> tuple[float, float]:
    """Return a hat's neighbours; an outer one ends at its own knot."""
    return knots[max(i - 1, 0)], knots[min(i + 1, len(knots) - 1)]


def hat_label(what: str, low: float, high: float, unit: str = "") -> str:
    """Return "what low to high"."""
    return f"{what} {low:.2g} to {high:.2g}{unit}"


def hats_of_speed(speed_mps: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield label and shape of hats over the logarithm of the ground speed, shape (n,)."""
    tempo = np.log(np.maximum(speed_mps, _LEAST_SPEED_MPS))
    yield from hats("ground speed", tempo, tuple(np.quantile(tempo, _OF_SPEED)), np.ones(len(tempo), bool), exp)


SPEED_MPS = 0.03
"""One-sigma of an error of the ground speed that lasts over a range of speeds."""
LOAD_SHARE = 0.02
"""One-sigma of an error of the load, as a share of the mean load."""


MISREAD = "as if misread"
"""First words of a label's second part."""


@dataclass(frozen=True)
class InputShape:
    """An error of an input and what it does.

    Attributes
    ----------
    label : str
        "input|where", the input as a key of `model.diagnosis.core.result.INPUTS`.
    columns : array, shape (c, n)
        In N, N m and m.
    height : float
        The error's largest value, in m/s or N.
    """

    label: str
    columns: FloatArray
    height: float


def input_shapes(linear: Linear) -> Iterator[InputShape]:
    """Yield the shapes; what grows with the load only where there is more than one load.

    Parameters
    ----------
    linear : Linear
    """
    at = linear.conditions
    by_speed, by_load = np.nan_to_num(linear.speed), np.nan_to_num(linear.load)
    for where, hat in hats_of_speed(np.asarray(at.ground_speed_mps)):
        yield InputShape(f"v|{MISREAD}, {where}", -SPEED_MPS * by_speed * hat, SPEED_MPS)
    size = LOAD_SHARE * float(np.mean(np.asarray(at.vertical_load_n)))
    yield InputShape(f"w|{MISREAD} everywhere", -size * by_load, size)
    if several_loads(at):
        growing = growing_with_load(at, at)
        yield InputShape(
            f"w|{MISREAD}, growing with the load", -size * by_load * growing, size * float(np.abs(growing).max())
        )


Shape = tuple[str, FloatArray]

AMPLITUDE = 0.02
"""One-sigma of a shape: share of the load, of load times radius, of the radius."""

_DRIVING, _BRAKING = "slip", "braking, slip -"
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
    labels : tuple of str
        "channel|where"; of an error of an input, "input|where".
    columns : array, shape (c, n, b)
        In N, N m and m.
    rests : array, shape (2, m, b)
        Of drawbar pull and torque at standstill.
    input_heights : array, shape (b,)
        Largest error of an input, m/s or N; NaN for a shape of a channel.
    """

    labels: tuple[str, ...]
    columns: FloatArray
    rests: FloatArray
    input_heights: FloatArray


def basis(samples: Samples, linear: Linear) -> Basis:
    """Return the shapes of the channels, then the zeros that standstills show, then those of the inputs.

    Parameters
    ----------
    samples : Samples
    linear : Linear
    """
    shapes = [(label, x) for label, x in _shapes(samples, linear) if np.std(x) > 0]
    zeros, inputs = _channels_with_zeros(samples, linear), list(input_shapes(linear))
    found = _empty(samples, linear, len(shapes) * len(linear.channels) + len(zeros) + len(inputs))
    labels: list[str] = []
    for row, channel in enumerate(linear.channels):
        amplitude = amplitude_of(samples, channel)
        for label, x in shapes:
            found.columns[row, :, len(labels)] = amplitude * x
            labels.append(f"{channel}|{label}")
    for channel in zeros:
        amplitude, drive = amplitude_of(samples, channel), linear.conditions
        rolling, resting = (growing_with_load(at, drive) for at in (drive, samples.rests.conditions))
        found.columns[linear.channels.index(channel), :, len(labels)] = amplitude * rolling
        found.rests[AT_REST.index(channel), :, len(labels)] = amplitude * resting
        labels.append(f"{channel}|{ZERO_WITH_LOAD}")
    for shape in inputs:
        found.columns[..., len(labels)] = shape.columns
        found.input_heights[len(labels)] = shape.height
        labels.append(shape.label)
    return replace(found, labels=tuple(labels))


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


def _shapes(samples: Samples, linear: Linear) -> Iterator[Shape]:
    at = linear.conditions
    slip, speed = np.asarray(at.slip), np.asarray(at.ground_speed_mps)
    yield from hats(_DRIVING, slip, _DRIVE_KNOTS, slip > 0)
    yield from hats(_BRAKING, -slip, _BRAKE_KNOTS, slip < 0)
    driving = np.where(slip > 0, 1.0, 0.0)
    growing = growing_with_load(at, at)
    yield "load, driving", driving * growing
    yield "load, braking", (1.0 - driving) * growing
    yield "load squared", growing**2
    yield from hats_of_speed(speed)
    place = np.asarray(samples.conditions.line_position)
    yield from hats("place on the line", place, tuple(np.linspace(-1.0, 1.0, _PLACES)), np.isfinite(place))
    yield from _in_time(samples)
    direction = np.asarray(samples.conditions.direction)
    what, sense = ("direction", direction) if np.ptp(direction) > 0 else ("all alike", np.ones(len(direction)))
    yield f"{what}, driving", sense * driving
    yield f"{what}, braking", sense * (1.0 - driving)
    yield from _products(samples, linear, driving)


def _slip_ranges() -> dict[str, tuple[float, float]]:
    """Return the slips that each hat over slip covers; the outer ones go on to no slip and to all of it."""
    found = {}
    for what, knots, sign in ((_DRIVING, _DRIVE_KNOTS, 1.0), (_BRAKING, _BRAKE_KNOTS, -1.0)):
        for i in range(len(knots)):
            low, high = ends(knots, i)
            covered = (sign * (low if i else 0.0), sign * (high if i < len(knots) - 1 else 1.0))
            found[hat_label(what, low, high)] = (min(covered), max(covered))
    return found


def _in_time(samples: Samples) -> Iterator[Shape]:
    """Yield hats over each run's own time: early, middle and late."""
    for index, name in enumerate(samples.run_names):
        own = samples.run == index
        if own.sum() < 2:
            continue
        at = samples.time_s
        knots = np.linspace(at[own].min(), at[own].max(), _TIMES_IN_RUN)
        for label, x in hats("", at, tuple(knots), own):
            yield f"{name},{label} s", x


def _products(samples: Samples, linear: Linear, driving: FloatArray) -> Iterator[Shape]:
    """Yield shapes of usual causes that nobody lists: hysteresis, lag, curved channels."""
    at = linear.conditions
    yield "speeding up, driving", driving * np.tanh(np.asarray(at.ground_acceleration_mps2) / 0.3)
    yield "speeding up, braking", (1.0 - driving) * np.tanh(np.asarray(at.ground_acceleration_mps2) / 0.3)
    spin, omega = np.asarray(at.wheel_acceleration_radps2), np.maximum(np.asarray(at.wheel_speed_radps), 0.3)
    ground = np.maximum(np.asarray(at.ground_speed_mps), 0.1)
    rate = np.where(
        np.asarray(at.slip) > 0,
        (1.0 - np.asarray(at.slip)) * (spin / omega - np.asarray(at.ground_acceleration_mps2) / ground),
        (1.0 + np.asarray(at.slip)) * (spin / omega - np.asarray(at.ground_acceleration_mps2) / ground),
    )
    yield "rising slip, driving", driving * np.tanh(rate / 0.2)
    yield "rising slip, braking", (1.0 - driving) * np.tanh(rate / 0.2)
    yield from _of_channels(samples, linear)


def _of_channels(samples: Samples, linear: Linear) -> Iterator[Shape]:
    """Yield shapes of a channel's own doing: a curve that bends, a gain that drifts."""
    for channel, words, unit in (("dp", "drawbar pull", " kN"), ("t", "torque", " kN m")):
        if channel not in linear.channels:
            continue
        x = linear.value[linear.channels.index(channel)] / 1e3
        known = np.isfinite(x)
        if known.sum() < 2:
            continue
        x = np.where(known, x, 0.0)
        yield from hats(words, x, tuple(np.quantile(x[known], _OF_A_CHANNEL)), known, unit=unit)
        x = x / max(float(np.std(x[known])), 1e-9)
        yield f"large {words}", x * np.abs(x) / 2.0
        yield f"{words} over the campaign", np.nan_to_num(samples.conditions.campaign_time) * x


SLIP_RANGES = _slip_ranges()
"""Label of a hat over slip -> slips that it covers."""
