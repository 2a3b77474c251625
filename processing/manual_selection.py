"""Parts of a processed run that a person keeps; the rest is left out with a reason of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq import ConfigError, Fault, FloatArray
from processing.pipeline.quality import shares_of
from processing.processed_run import ProcessedRun, Reason

Interval = tuple[float, float]
"""First and last second, since the time base of the run begins."""

_ROUNDED_S = 1.0
"""People round a run's end up."""


def keep_only(run: ProcessedRun, keep: Sequence[Interval], where: str = "") -> ProcessedRun:
    """Return the run with what lies outside `keep` left out by hand.

    A used sample outside becomes `Reason.BY_HAND`; one that was left out anyway keeps its reason. A standstill counts
    only where it lies inside as a whole.

    Parameters
    ----------
    keep : sequence of (from, to)
        Seconds since the time base begins; both ends belong to it.
    where : str
        Who asks for it, for messages.

    Raises
    ------
    ConfigError
        Intervals that reach beyond the run.
    """
    check_within(keep, float(run.time_s[-1]), where)
    reason = with_by_hand(run.reason, run.time_s, keep)
    standstills = tuple(
        stand
        for stand in run.quality.standstills
        if any(first <= stand.start_s and stand.start_s + stand.duration_s <= last for first, last in keep)
    )
    quality = replace(run.quality, shares=shares_of(reason), standstills=standstills)
    return replace(run, reason=reason, quality=quality)


def check_within(keep: Sequence[Interval], end_s: float, where: str = "") -> None:
    """See that intervals lie within a run whose time base ends at `end_s`, but for a rounded last end.

    Raises
    ------
    ConfigError
        Those that do not.
    """
    beyond = [(first, last) for first, last in keep if first < 0 or first > end_s or last > end_s + _ROUNDED_S]
    if beyond:
        raise ConfigError(*(_beyond(interval, end_s, where) for interval in beyond))


def with_by_hand(reason: NDArray[np.uint8], time_s: FloatArray, keep: Sequence[Interval]) -> NDArray[np.uint8]:
    """Return the reasons, shape (n,), with used samples outside `keep` left out by hand."""
    inside = np.zeros(len(time_s), np.bool_)
    for first, last in keep:
        inside |= (time_s >= first) & (time_s <= last)
    return np.where((reason == Reason.USED) & ~inside, np.uint8(Reason.BY_HAND), reason)


def _beyond(interval: Interval, end_s: float, where: str) -> Fault:
    return Fault(
        "what is to be kept reaches beyond the run",
        where,
        found=f"{interval[0]:g} to {interval[1]:g} s",
        expected=f"within 0 to {end_s:.2f} s",
        next_step="mend keep; the seconds count from the first sample of the run's time base",
    )
