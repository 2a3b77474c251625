"""What a longest gap other than the default would change in a run of which little is used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from daq import BoolArray, Note, Severity
from processing import ProcessedRun, ProcessOptions, Reason, RunCode
from processing.pipeline.collection import Samples
from processing.pipeline.filters import EDGE_SIGMAS, KERNEL_REACH_SIGMAS
from processing.pipeline.resampling import gap_limit_s
from processing.timebase import nearest, seconds_since, stretch_of, stretches

_LITTLE = 0.5
"""A run of which less is used is remarked upon."""
_GAPS_S = (0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0)
_MOST_OF = 0.8
"""The shortest gap is proposed that gives this share of what any gives."""
_WORTH = 0.05
_INSTANTS = 20_000


def many_holes(samples: Mapping[str, Samples], kernel_s: float, options: ProcessOptions) -> bool:
    """Return whether so little is free of holes that a longer gap could matter."""
    return bool(samples) and _free_share(samples, kernel_s, options) < _LITTLE


def little_used(
    run: ProcessedRun,
    samples: Mapping[str, Samples],
    kernel_s: float,
    options: ProcessOptions,
    again: Callable[[ProcessOptions], ProcessedRun],
) -> list[Note]:
    """Return a note where less than half of a run is used: why, and what a longer gap would change.

    A vehicle that stands is no reason for one. `samples` are those of the roles that a used sample must have, empty
    where holes are not the reason; `again` processes the run with other options, for the figure.
    """
    shares = dict(run.quality.shares)
    used = shares.pop(Reason.USED.name)
    if used >= _LITTLE:
        return []
    reason = max(shares, key=lambda name: shares[name])
    facts = {"used": used, "reason": reason, "share": shares[reason], "max_gap_s": None, "used_then": used}
    gap_s = _longer_gap_s(samples, kernel_s, options) if samples else None
    if gap_s is not None:
        then = again(replace(options, max_gap_s=gap_s)).quality.shares[Reason.USED.name]
        if then > used + _WORTH:
            facts |= {"max_gap_s": gap_s, "used_then": then}
    if reason == Reason.STANDSTILL.name and facts["max_gap_s"] is None:
        return []
    return [Note(RunCode.LITTLE_USED, Severity.DOUBT, facts)]


def _longer_gap_s(samples: Mapping[str, Samples], kernel_s: float, options: ProcessOptions) -> float | None:
    now = _free_share(samples, kernel_s, options)
    longer = [gap_s for gap_s in _GAPS_S if gap_s > (options.max_gap_s or kernel_s)]
    free = {gap_s: _free_share(samples, kernel_s, replace(options, max_gap_s=gap_s)) for gap_s in longer}
    most = max(free.values(), default=0.0)
    enough = now + _MOST_OF * (most - now)
    return next((gap_s for gap_s in longer if free[gap_s] >= enough), None) if most > now + _WORTH else None


def _free_share(samples: Mapping[str, Samples], kernel_s: float, options: ProcessOptions) -> float:
    """Return the share of instants at which every channel is in a stretch, away from its ends and near a sample."""
    some = [channel for channel in samples.values() if len(channel.time_ns)]
    if not some:
        return 0.0
    start_ns = min(int(channel.time_ns[0]) for channel in some)
    at_s = np.linspace(0.0, (max(int(channel.time_ns[-1]) for channel in some) - start_ns) * 1e-9, _INSTANTS)
    free: BoolArray = np.ones(len(at_s), np.bool_)
    for channel in some:
        time_s = seconds_since(channel.time_ns, start_ns)
        pairs = stretches(time_s, gap_limit_s(channel, kernel_s, options), least=3)
        which = stretch_of(at_s, time_s, pairs)
        inside = np.flatnonzero(free & (which >= 0))
        first, last = (time_s[pairs[which[inside], end] - end] for end in (0, 1))
        away = np.minimum(at_s[inside] - first, last - at_s[inside]) >= EDGE_SIGMAS * kernel_s
        near = np.abs(time_s[nearest(at_s[inside], time_s)] - at_s[inside]) < KERNEL_REACH_SIGMAS * kernel_s
        free = np.zeros(len(at_s), np.bool_)
        free[inside[away & near]] = True
    return float(free.mean())
