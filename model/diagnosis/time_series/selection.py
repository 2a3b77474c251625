"""Samples that are left out once the noise is known: near the cuts at little slip and speed, and outliers.

**Near a cut.** Samples of little measured slip are not used (`LITTLE_SLIP`). Of those just beyond it, whose true slip
is small, only those are used whose ground speed happens to be off outwards: their mean error is as large as its
one-sigma, in every run, and looks like too much pull and torque where the wheel brakes a little. Nor are samples used
whose larger speed is below the run's least: where the wheel brakes that is the measured ground speed, and of those just
above only those are used that are off upwards. So samples that are by their smoothed speed within some one-sigmas of a
cut are left out: beyond, it has hardly chosen by the error.

**Outliers.** Seconds that no noise model describes: a receiver that jumps, a wheel that strikes a stone.
The noise is Gaussian. One second in which the ground speed is off by five times its usual error outweighs a whole run:
it is taken for a torque that grows with the pull, or keeps the linearisation from settling. So samples whose whitened
residual about the explanation exceeds `LIMIT`, and those within `AROUND_S` of them, are left out, if they are few: of a
misfit there is more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq import BoolArray, FloatArray, Note
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import SetEstimate
from model.diagnosis.time_series.linearisation_point import LinearisationPoint, cause_coefficients, remainder_of
from model.diagnosis.time_series.linearise import at_point, at_speed
from model.diagnosis.time_series.samples import FEWEST, LITTLE_SLIP, STENCIL
from model.diagnosis.time_series.start import CampaignData, Start, soil_places_of
from model.diagnosis.time_series.whitening import innovations
from model.notes import DiagnosisCode

NEAR_SIGMAS = 2.0
"""How far from a cut, in one-sigmas of the measured speed: of samples beyond, one in 44 is chosen by its error."""
MOST_NEAR = 0.5
"""Share of a campaign's samples that may be near a cut; where more are, little would be left, and all are used."""
LIMIT = 5.0
"""One-sigmas: by chance one of a million samples has as many."""
AROUND_S = 0.5
MOST_SHARE, ALWAYS = 0.005, 3
"""Of a campaign's samples that may exceed the limit, and how many may in the shortest; more are a misfit."""


def without_near_cuts(starts: Sequence[Start], points: Sequence[LinearisationPoint]) -> list[Start]:
    """Return the campaigns without the samples whose speed at the points is near a cut, of slip or of speed."""
    return [_measured_beyond_cuts(start, at) for start, at in zip(starts, points, strict=True)]


def _measured_beyond_cuts(start: Start, at: LinearisationPoint) -> Start:
    samples, noise = at_point(start.samples, at.point), at.noise.values
    reach_mps = NEAR_SIGMAS * np.hypot(noise["speed_noise_mps"], noise["speed_white_mps"])
    rim_mps = samples.wheel_radius_m * samples.instants.wheel_speed_radps
    ground_mps = samples.instants.ground_speed_mps + at.point.speed_mps
    slip = np.asarray(at_speed(samples, at.point).slip)
    near = np.abs(slip) < LITTLE_SLIP + reach_mps / (np.array(STENCIL) @ rim_mps)
    near |= (np.maximum(rim_mps, ground_mps - reach_mps) < samples.least_speed_mps).any(axis=0)
    few = len(near) - int(near.sum()) < FEWEST or near.mean() > MOST_NEAR
    return start if few else _not_measured(start, near)


def without_outliers(
    starts: Sequence[Start], campaigns: Sequence[CampaignData], grams: Grams, best: SetEstimate
) -> tuple[Start, ...] | None:
    """Return the campaigns without their outliers; None where there are none.

    The campaigns are linearised about `best`.
    """
    found = []
    for start, data, places in zip(starts, campaigns, soil_places_of(campaigns), strict=True):
        found.append(_without(start, _outliers(data, best.soil[places], grams, best)))
    return tuple(found) if any(kept is not start for kept, start in zip(found, starts, strict=True)) else None


def _outliers(data: CampaignData, soil: FloatArray, grams: Grams, best: SetEstimate) -> BoolArray:
    samples, size = data.samples, innovations(remainder_of(data, soil, cause_coefficients(data, grams, best)))
    out, large = np.zeros(len(samples), bool), np.flatnonzero(size > LIMIT)
    for i in large if len(large) <= max(MOST_SHARE * len(samples), ALWAYS) else ():
        out |= (samples.run == samples.run[i]) & (np.abs(samples.time_s - samples.time_s[i]) <= AROUND_S)
    return out


def _without(start: Start, out: BoolArray) -> Start:
    """Return a campaign without its outliers, and with a note that says so."""
    if not out.any():
        return start
    found = _not_measured(start, out)
    samples = found.samples
    runs = tuple(samples.run_names[run] for run in np.unique(samples.run[out]))
    note = Note(DiagnosisCode.OUTLIERS, values={"samples": int(out.sum()), "runs": runs, "limit": LIMIT})
    return replace(found, samples=replace(samples, notes=(*samples.notes, note)))


def _not_measured(start: Start, out: BoolArray) -> Start:
    samples = start.samples
    measured = {channel: np.where(out, np.nan, x) for channel, x in samples.measured.items()}
    return replace(start, samples=replace(samples, measured=measured))
