"""How good a run is, at a glance: good, fair or poor, and what speaks against it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from processing.processed_run import ProcessedRun, Reason

Level = Literal["good", "fair", "poor"]

_BY_DESIGN = (Reason.STANDSTILL, Reason.TOO_SLOW, Reason.FILTER_EDGE, Reason.BY_HAND)
"""Samples that no run has a use for: they speak against none."""
_GOOD_SHARE, _FAIR_SHARE = 0.8, 0.5
_GOOD_SLIP, _FAIR_SLIP = 0.5, 0.1
_WRONG_SIGN = re.compile(r"check (its|the) sign")
_DOUBTFUL = re.compile(r"^ground speed is |is missing for|at standstill reads|never a usable value|stamps run backward")
"""Notes of the processing that make a good run fair; the others only tell how it was processed."""


@dataclass(frozen=True)
class Grade:
    """What a run is worth.

    Attributes
    ----------
    level : "good", "fair" or "poor"
    reasons : tuple of str
        What speaks against it, the worst first; empty for a good run.
    usable_share : float
        Of the samples in which the vehicle moved; NaN where it never did.
    highest_slip : float
        Of the usable samples; NaN without any.
    """

    level: Level
    reasons: tuple[str, ...]
    usable_share: float
    highest_slip: float


def grade_of(run: ProcessedRun, lost: Sequence[str] = ()) -> Grade:
    """Grade a run.

    Parameters
    ----------
    run : ProcessedRun
    lost : sequence of str
        What of its recording was lost, in words; anything makes a good run fair.
    """
    moving = ~np.isin(run.reason, _BY_DESIGN)
    share = float(run.used.sum() / moving.sum()) if moving.any() else float("nan")
    slip = run.slip[run.used]
    highest = float(np.percentile(slip, 99.5)) if len(slip) else float("nan")
    poor, fair = _of_samples(run, share, highest)
    notes = run.quality.notes
    poor += [note for note in notes if _WRONG_SIGN.search(note)]
    fair += [*(note for note in notes if _DOUBTFUL.search(note)), *lost]
    level: Level = "poor" if poor else "fair" if fair else "good"
    return Grade(level, (*poor, *fair), share, highest)


def _of_samples(run: ProcessedRun, share: float, highest: float) -> tuple[list[str], list[str]]:
    """Return what is poor and what is only fair about the samples that are left."""
    if not run.used.any():
        return [f"no sample can be used: most are {_mostly(run)}"], []
    poor: list[str] = []
    fair: list[str] = []
    if share < _GOOD_SHARE:
        text = f"{100 * share:.0f} % of the samples in motion can be used, most others are {_mostly(run)}"
        (poor if share < _FAIR_SHARE else fair).append(text)
    if highest < _GOOD_SLIP:
        text = f"slip reaches {highest:.2f} only"
        (poor if highest < _FAIR_SLIP else fair).append(text)
    return poor, fair


def _mostly(run: ProcessedRun) -> str:
    """Return the reason that cost most samples, by its name in the run's shares."""
    kinds = [reason for reason in Reason if reason != Reason.USED and reason not in _BY_DESIGN]
    counts = [int(np.count_nonzero(run.reason == reason)) for reason in kinds]
    if not any(counts):
        return "at standstill or too slow"
    return kinds[int(np.argmax(counts))].name.lower().replace("_", " ")
