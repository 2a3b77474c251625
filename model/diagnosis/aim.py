"""Where to linearise next: the likeliest soil and causes, and the ground speed that goes with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import SetEstimate
from model.diagnosis.grams import Grams
from model.diagnosis.linearise import Point
from model.diagnosis.noise import Noise, beliefs
from model.diagnosis.start import LATENCY, Start
from model.diagnosis.whitening import smoothed_speed

if TYPE_CHECKING:
    from model.diagnosis.view import View

FloatArray = NDArray[np.float64]

_LONGEST_STEP = 2.0
"""Of the soil, in the laboratory's one-sigma."""
_FARTHEST = 3.5
"""Times its one-sigma that the ground speed is off: a sample that asks for more is an outlier, not to be followed."""


@dataclass(frozen=True)
class Aim:
    """Where to linearise, by which noise, and how well the ground speed is known there."""

    point: Point
    noise: Noise
    speed_variance: FloatArray


def first_aim(start: Start, delay_s: float) -> Aim:
    """Return the laboratory's soil with no cause but a delay, and the noise as it is thought of beforehand."""
    samples = start.samples
    noise = start.noise or Noise({name: b.centre for name, b in beliefs(samples).items()})
    variance = noise.values["speed_noise_mps"] ** 2 + noise.values["speed_white_mps"] ** 2
    causes = {name: delay_s for e, _, name in start.simulation.parameters if e.key() == LATENCY and delay_s}
    point = Point(np.zeros(len(start.simulation.space)), causes, np.zeros(len(samples)))
    return Aim(point, noise, np.full(len(samples), variance))


def aims_of(views: Sequence[View], grams: Grams, best: SetEstimate) -> list[Aim]:
    """Return where to linearise next: the best soil and causes, and the ground speed that goes with them."""
    found = []
    soil_at = 0
    for view in views:
        own = len(view.columns.soil)
        soil = best.soil[soil_at : soil_at + own]
        soil_at += own
        coefficient = {
            (c.key, c.parameter): float(x) for c, x in zip(grams.causes, best.coefficients, strict=True) if x != 0.0
        }
        scale = {(c.key, c.parameter): c.scale for c in grams.causes}
        causes, at = {}, np.zeros(len(view.columns.causes))
        for i, ((_, _, name), c) in enumerate(zip(view.simulation.parameters, view.columns.causes, strict=True)):
            size = coefficient.get((c.key, c.parameter), 0.0) * scale[c.key, c.parameter]
            if size != 0.0:
                causes[name] = float(np.clip(c.neutral + size, c.lower, c.upper))
                at[i] = size / c.scale
        soil = view.linear.point.soil + np.clip(soil - view.linear.point.soil, -_LONGEST_STEP, _LONGEST_STEP)
        speed, variance = _speed(view, soil, at)
        noise = view.noise.values
        farthest = _FARTHEST * float(np.hypot(noise["speed_noise_mps"], noise["speed_white_mps"]))
        speed = np.clip(speed, -farthest, farthest)
        found.append(Aim(Point(soil, causes, speed), view.noise, variance))
    return found


def _speed(view: View, soil: FloatArray, causes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smoothed error of the ground speed under a soil and causes, and its variance."""
    columns = view.columns
    shared = np.concatenate([[1.0], -soil, -causes, np.zeros(len(columns.basis))])
    by_run = view.grams.constants @ shared
    scale = np.array([view.noise.values[name] for name in columns.constants])
    coefficients = np.concatenate([np.tile(shared, (len(by_run), 1)), -by_run * scale], axis=1)
    return smoothed_speed(view.samples, view.linear, columns, view.noise.values, view.speed_variance, coefficients)
