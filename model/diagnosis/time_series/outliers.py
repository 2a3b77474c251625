"""Seconds that no noise model describes: a receiver that jumps, a wheel that strikes a stone.

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
from model.diagnosis.time_series.linearisation_point import cause_coefficients, remainder_of
from model.diagnosis.time_series.start import CampaignData, Start
from model.diagnosis.time_series.whitening import innovations
from model.notes import DiagnosisCode

LIMIT = 5.0
"""One-sigmas: by chance one of a million samples has as many."""
AROUND_S = 0.5
MOST_SHARE, ALWAYS = 0.005, 3
"""Of a campaign's samples that may exceed the limit, and how many may in the shortest; more are a misfit."""


def without_outliers(
    starts: Sequence[Start], campaigns: Sequence[CampaignData], grams: Grams, best: SetEstimate
) -> tuple[Start, ...] | None:
    """Return the campaigns without their outliers; None where there are none.

    Parameters
    ----------
    campaigns : sequence of CampaignData
        About the explanation.
    best : SetEstimate
        The explanation.
    """
    found, first = [], 0
    for start, data in zip(starts, campaigns, strict=True):
        soil = best.soil[first : first + len(data.columns.soil)]
        first += len(soil)
        found.append(_without(start, _outliers(data, soil, grams, best)))
    return tuple(found) if any(one is not start for one, start in zip(found, starts, strict=True)) else None


def _outliers(data: CampaignData, soil: FloatArray, grams: Grams, best: SetEstimate) -> BoolArray:
    samples, size = data.samples, innovations(remainder_of(data, soil, cause_coefficients(data, grams, best)))
    out, large = np.zeros(len(samples), bool), np.flatnonzero(size > LIMIT)
    for i in large if len(large) <= max(MOST_SHARE * len(samples), ALWAYS) else ():
        out |= (samples.run == samples.run[i]) & (np.abs(samples.time_s - samples.time_s[i]) <= AROUND_S)
    return out


def _without(start: Start, out: BoolArray) -> Start:
    """Return a campaign with some samples as not measured, and a note that says so."""
    if not out.any():
        return start
    samples = start.samples
    measured = {channel: np.where(out, np.nan, x) for channel, x in samples.measured.items()}
    runs = tuple(samples.run_names[run] for run in np.unique(samples.run[out]))
    note = Note(DiagnosisCode.OUTLIERS, values={"samples": int(out.sum()), "runs": runs, "limit": LIMIT})
    return replace(start, samples=replace(samples, measured=measured, notes=(*samples.notes, note)))
