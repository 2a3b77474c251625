"""The catch-all: shapes of misfit that no cause of the library has to have.

Smooth hats over everything that a misfit may hang on, for each channel on its own. Their labels are what a person is
told: "dp|slip 0.35 to 0.65". They are taken at the smoothed slip, like everything else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import exp

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.linearise import Linear
from model.diagnosis.samples import Samples

FloatArray = NDArray[np.float64]
Shape = tuple[str, FloatArray]

AMPLITUDE = {"dp": 0.02, "t": 0.02, "z": 0.02}
"""One-sigma of a shape: share of the load, of load times radius, of the radius."""

_DRIVING, _BRAKING = "slip", "braking, slip -"
_DRIVE_KNOTS = (0.05, 0.2, 0.4, 0.65, 0.95)
_BRAKE_KNOTS = (0.05, 0.15, 0.3, 0.6)
_PLACES = 13
_OF_A_CHANNEL = (0.02, 0.25, 0.5, 0.75, 0.98)
"""Quantiles of a channel at which its own curve may bend."""
_TIMES_IN_RUN = 3


def basis(samples: Samples, linear: Linear) -> tuple[tuple[str, ...], FloatArray]:
    """Return labels "channel|where" and the columns, shape (c, n, b), in N, N m and m."""
    shapes = [(label, x) for label, x in _shapes(samples, linear) if np.std(x) > 0 or label == "everywhere"]
    load = float(np.median(samples.conditions.vertical_load_n)) if len(samples) else 1.0
    unit = {"dp": load, "t": load * samples.wheel_radius_m, "z": samples.wheel_radius_m}
    channels = linear.channels
    columns = np.zeros((*linear.value.shape, len(shapes) * len(channels)))
    labels: list[str] = []
    for c, channel in enumerate(channels):
        for label, x in shapes:
            columns[c, :, len(labels)] = AMPLITUDE[channel] * unit[channel] * x
            labels.append(f"{channel}|{label}")
    return tuple(labels), columns


def _shapes(samples: Samples, linear: Linear) -> Iterator[Shape]:
    at = linear.conditions
    slip, speed, load = (np.asarray(x) for x in (at.slip, at.ground_speed_mps, at.vertical_load_n))
    yield from _hats(_DRIVING, slip, _DRIVE_KNOTS, slip > 0)
    yield from _hats(_BRAKING, -slip, _BRAKE_KNOTS, slip < 0)
    driving = np.where(slip > 0, 1.0, 0.0)
    relative = load / load.mean() - 1.0
    yield "load, driving", driving * relative / 0.15
    yield "load, braking", (1.0 - driving) * relative / 0.15
    yield "load squared", (relative / 0.15) ** 2
    tempo = np.log(np.maximum(speed, 0.1))
    yield from _hats("ground speed", tempo, tuple(np.quantile(tempo, (0.02, 0.35, 0.65, 0.98))), slip > -1.0, exp)
    place = np.asarray(samples.conditions.line_position)
    yield from _hats("place on the line", place, tuple(np.linspace(-1.0, 1.0, _PLACES)), np.isfinite(place))
    yield from _in_time(samples)
    direction = np.asarray(samples.conditions.direction)
    yield "direction, driving", direction * driving
    yield "direction, braking", direction * (1.0 - driving)
    yield from _products(samples, linear, driving)


def _hats(
    what: str,
    x: FloatArray,
    knots: tuple[float, ...],
    on: NDArray[np.bool_],
    say: Callable[[float], float] = float,
    unit: str = "",
) -> Iterator[Shape]:
    """Yield a hat over each knot, straight down to its neighbours; the outer ones go on."""
    knots = tuple(k for k, after in zip(knots, (*knots[1:], np.inf), strict=True) if after > k)
    clipped = np.clip(np.where(on, x, knots[0]), knots[0], knots[-1])
    for i in range(len(knots)):
        height = np.zeros(len(knots))
        height[i] = 1.0
        low, high = _ends(knots, i)
        yield _hat_label(what, say(low), say(high), unit), np.where(on, np.interp(clipped, knots, height), 0.0)


def _ends(knots: tuple[float, ...], i: int) -> tuple[float, float]:
    """Return a hat's neighbours; an outer one ends at its own knot."""
    return knots[max(i - 1, 0)], knots[min(i + 1, len(knots) - 1)]


def _hat_label(what: str, low: float, high: float, unit: str = "") -> str:
    return f"{what} {low:.2g} to {high:.2g}{unit}"


def _slip_ranges() -> dict[str, tuple[float, float]]:
    """Return the slips that each hat over slip covers; the outer ones go on to no slip and to all of it."""
    found = {}
    for what, knots, sign in ((_DRIVING, _DRIVE_KNOTS, 1.0), (_BRAKING, _BRAKE_KNOTS, -1.0)):
        for i in range(len(knots)):
            low, high = _ends(knots, i)
            ends = (sign * (low if i else 0.0), sign * (high if i < len(knots) - 1 else 1.0))
            found[_hat_label(what, low, high)] = (min(ends), max(ends))
    return found


def _in_time(samples: Samples) -> Iterator[Shape]:
    """Yield hats over each run's own time: early, middle and late."""
    for index, name in enumerate(samples.run_names):
        own = samples.run == index
        if own.sum() < 2:
            continue
        at = samples.time_s
        knots = np.linspace(at[own].min(), at[own].max(), _TIMES_IN_RUN)
        for label, x in _hats("", at, tuple(knots), own):
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
        yield from _hats(words, x, tuple(np.quantile(x[known], _OF_A_CHANNEL)), known, unit=unit)
        x = x / max(float(np.std(x[known])), 1e-9)
        yield f"large {words}", x * np.abs(x) / 2.0
        yield f"{words} over the campaign", np.nan_to_num(samples.conditions.campaign_time) * x


SLIP_RANGES = _slip_ranges()
"""Label of a hat over slip -> slips that it covers."""
