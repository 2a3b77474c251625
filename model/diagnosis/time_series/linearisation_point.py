"""Points of linearisation: where the first one is, and the next one about an explanation.

The next one is at the most probable soil and causes, with the ground speed that goes with them. A step to it may be
shortened, so that the model keeps an answer for every sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import BoolArray, FloatArray
from model.diagnosis.time_series.columns import Columns, Grams
from model.diagnosis.time_series.evidence import SetEstimate
from model.diagnosis.time_series.joining import APART, OWN_SPEED, groups_of, part_of, smoothed_speeds
from model.diagnosis.time_series.linearise import DELAY, Linear, Point
from model.diagnosis.time_series.noise import Noise, hyper_priors
from model.diagnosis.time_series.start import CampaignData, Start, soil_places_of
from model.diagnosis.time_series.whitening import Remainder, remainder, smoothed_speed
from model.wheel_soil.conditions import Conditions

_LONGEST_STEP = 2.0
"""Of the soil, in the laboratory's one-sigma."""
_FARTHEST = 3.5
"""Times its one-sigma that the ground speed is off: a sample that asks for more is an outlier, not to be followed."""


@dataclass(frozen=True)
class LinearisationPoint:
    """Point of linearisation, its noise model, and the variance of the ground speed there.

    Attributes
    ----------
    before : Point or None
        From which the step to the point is taken.
    answered : bool array, shape (n,), optional
        Samples for which the model has an answer at `before`.
    """

    point: Point
    noise: Noise
    speed_variance: FloatArray
    before: Point | None = None
    answered: BoolArray | None = None

    def shortened(self, step: float, neutral: Mapping[str, float]) -> LinearisationPoint:
        """Return the point at a share of the step; `neutral` by each cause's name in the model."""
        if self.before is None or step == 1.0:
            return self
        old, new = self.before, self.point
        causes = {
            key: (1.0 - step) * old.causes.get(key, neutral[key]) + step * new.causes.get(key, neutral[key])
            for key in (old.causes | new.causes if step else old.causes)
        }
        pairs = ((getattr(old, name), getattr(new, name)) for name in ("soil", "speed_mps", "acceleration_mps2"))
        soil, speed, acceleration = (a + step * (b - a) for a, b in pairs)
        return replace(self, point=Point(soil, causes, speed, acceleration))

    def loses(self, linear: Linear) -> bool:
        """Return whether a model about the point has no answer where that before had one."""
        return self.answered is not None and bool((self.answered & ~linear.usable).any())


def first_point(start: Start, causes: dict[str, float]) -> LinearisationPoint:
    """Return the laboratory's soil with the given causes, and the noise of the prior."""
    samples = start.samples
    noise = start.noise or Noise({name: b.centre for name, b in hyper_priors(samples).items()})
    if start.campaign.of_vehicle:
        noise = noise.with_value(OWN_SPEED, APART)
    variance = noise.values["speed_noise_mps"] ** 2 + noise.values["speed_white_mps"] ** 2
    point = Point(np.zeros(len(start.simulation.space)), causes, np.zeros(len(samples)))
    return LinearisationPoint(point, noise, np.full(len(samples), variance))


def linearisation_points(
    campaigns: Sequence[CampaignData], grams: Grams, best: SetEstimate, step: float = 1.0
) -> list[LinearisationPoint]:
    """Return the next points of linearisation: the best soil and causes, and the ground speed that goes with them.

    `step` is the share of the way from the points of now.
    """
    estimates = [
        _estimate(data, best.soil[places], grams, best, step)
        for data, places in zip(campaigns, soil_places_of(campaigns), strict=True)
    ]
    speeds = _speeds(campaigns, estimates, grams.constants)
    found = []
    for data, (soil, at), (*estimated, variance) in zip(campaigns, estimates, speeds, strict=True):
        values = zip(data.simulation.parameters, data.columns.causes, at, strict=True)
        sizes = {name: (c, float(x)) for (_, _, name), c, x in values if x != 0.0}
        causes = {name: float(np.clip(c.neutral + x * c.scale, c.lower, c.upper)) for name, (c, x) in sizes.items()}
        by_line, moved = _moved_speed(data, causes)
        last = data.linear.point
        before = np.stack(np.broadcast_arrays(last.speed_mps, last.acceleration_mps2))
        speed, acceleration = (1.0 - step) * before + step * (np.stack(estimated) + by_line) - moved
        noise = data.noise.values
        farthest = _FARTHEST * float(np.hypot(noise["speed_noise_mps"], noise["speed_white_mps"]))
        point = Point(soil, causes, np.clip(speed, -farthest, farthest), acceleration)
        found.append(LinearisationPoint(point, data.noise, variance, before=last, answered=data.linear.usable))
    return found


def _estimate(
    data: CampaignData, soil: FloatArray, grams: Grams, best: SetEstimate, step: float
) -> tuple[FloatArray, FloatArray]:
    """Return the soil and the causes' coefficients of a step towards an explanation."""
    named = zip(data.simulation.parameters, data.columns.causes, strict=True)
    now = [data.linear.point.causes.get(name, c.neutral) - c.neutral for (_, _, name), c in named]
    scale = np.array([c.scale for c in data.columns.causes])
    size = (1.0 - step) * np.array(now) + step * cause_coefficients(data, grams, best) * scale
    moved = np.clip(soil - data.linear.point.soil, -_LONGEST_STEP, _LONGEST_STEP)
    return data.linear.point.soil + step * moved, size / scale


def _speeds(
    campaigns: Sequence[CampaignData], estimates: Sequence[tuple[FloatArray, FloatArray]], constants: FloatArray | None
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the error of each campaign's ground speed, its slope and its variance; wheels of a vehicle have one."""
    found: dict[int, tuple[FloatArray, FloatArray, FloatArray]] = {}
    for group in groups_of([data.campaign for data in campaigns]):
        if campaigns[group[0]].campaign.of_vehicle:
            shared = [_coefficients(campaigns[i].columns, *estimates[i])[: campaigns[i].columns.shared] for i in group]
            found |= zip(group, smoothed_speeds([part_of(campaigns[i]) for i in group], shared, constants), strict=True)
        else:
            [i] = group
            found[i] = smoothed_speed(remainder_of(campaigns[i], *estimates[i]), campaigns[i].samples.block_s)
    return [found[i] for i in range(len(campaigns))]


def cause_coefficients(data: CampaignData, grams: Grams, best: SetEstimate) -> FloatArray:
    """Return an explanation's coefficients by a campaign's own causes, whose scales may differ, shape (k,)."""
    size = {(c.key, c.parameter): x * c.scale for c, x in zip(grams.causes, best.coefficients, strict=True)}
    return np.array([size.get((c.key, c.parameter), 0.0) / c.scale for c in data.columns.causes])


def _moved_speed(data: CampaignData, causes: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return by how much ground speed and acceleration move with the delay, by the columns' line and truly; (2, n).

    The next point is at the ground speed that was estimated, so that its error is what that leaves of the moved one:
    of another moment, the measured speed has another error.
    """
    old, new = (c.get(DELAY, 0.0) for c in (data.linear.point.causes, causes))
    before, after = (_speed_and_slope(data.samples.with_delay(x).conditions) for x in (old, new))
    at = data.linear.conditions
    line = np.stack([np.asarray(at.ground_acceleration_mps2), np.asarray(at.ground_jerk_mps3)])
    return (new - old) * line, after - before


def _speed_and_slope(at: Conditions) -> FloatArray:
    return np.stack([np.asarray(at.ground_speed_mps), np.asarray(at.ground_acceleration_mps2)])


def remainder_of(data: CampaignData, soil: FloatArray, causes: FloatArray) -> Remainder:
    """Return what a soil, shape (q,), and causes, shape (k,), leave of a campaign's residual.

    What is one value a run is at its mean.
    """
    columns, noise = data.columns, data.noise.values
    shared = _coefficients(columns, soil, causes)
    by_run = data.grams.constants @ shared
    scale = np.array([noise[name] for name in columns.constants])
    coefficients = np.concatenate([np.tile(shared, (len(by_run), 1)), -by_run * scale], axis=1)
    return remainder(data.samples, data.linear, columns, noise, data.speed_variance, coefficients)


def _coefficients(columns: Columns, soil: FloatArray, causes: FloatArray) -> FloatArray:
    """Return 1 for the residual, minus the estimate, and 0 for the shapes, shape (columns before the constants,)."""
    return np.concatenate([[1.0], -soil, -causes, np.zeros(columns.varying - 1 - len(soil) - len(causes))])
