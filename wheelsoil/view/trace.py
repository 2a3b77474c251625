"""Thinning of a run for the plots: few points that keep the peaks of pull and slip, the same rows of each quantity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq import FloatArray, IntArray
from processing import ProcessedRun, Reason, Segment
from processing.pipeline import runs_of

MOST_POINTS = 6000
_RATE_HZ = 10.0
_GUIDES = 2
_KEPT_PER_PIECE = 2 * _GUIDES
"""Minimum and maximum of the two guiding quantities, drawbar pull and slip."""

_DECIMALS = {
    "time_s": 3,
    "slip": 5,
    "drawbar_pull_n": 1,
    "driving_torque_nm": 1,
    "vertical_load_n": 1,
    "ground_speed_mps": 4,
    "rim_speed_mps": 4,
    "sinkage_m": 5,
    "distance_m": 3,
}
_MAY_BE_ABSENT = ("driving_torque_nm", "sinkage_m")


@dataclass(frozen=True)
class Trace:
    """A thinned run; arrays of shape (n,).

    Attributes
    ----------
    quantities : mapping name with unit -> float64 array
        NaN if unknown.
    reason : uint8 array, see `Reason`
    segments : tuple of (kind, from_s, to_s)
        Of the whole run.
    thinned_from : int
        Number of samples of the run.
    """

    quantities: dict[str, FloatArray]
    reason: NDArray[np.uint8]
    segments: tuple[tuple[str, float, float], ...]
    thinned_from: int

    @property
    def time_s(self) -> FloatArray:
        """Seconds since the start of the run's time base, shape (n,)."""
        return self.quantities["time_s"]


def trace_of(run: ProcessedRun) -> Trace:
    """Thin a processed run; see `rows_to_draw`."""
    rows = rows_to_draw(run)
    quantities = {name: np.round(getattr(run, name)[rows], decimals) for name, decimals in _DECIMALS.items()}
    return Trace(quantities, run.reason[rows], _segments(run), len(run))


def rows_to_draw(run: ProcessedRun) -> IntArray:
    """Choose about ten rows a second, at most `MOST_POINTS`, in ascending order.

    The run is cut into pieces of equal length. Each piece keeps the rows of minimum and maximum drawbar pull and slip
    (of torque, load or speeds if one of them is missing), among its used samples if it has any, and the first row of
    each exclusion reason, so that every gap stays visible.
    """
    most = min(MOST_POINTS, int(len(run) / run.rate_hz * _RATE_HZ) + _KEPT_PER_PIECE)
    if len(run) <= most:
        return np.arange(len(run))
    pieces = max(most // _KEPT_PER_PIECE, 1)
    while len(rows := _rows_of_pieces(run, pieces)) > MOST_POINTS:
        pieces = pieces * MOST_POINTS // len(rows)
    return rows


def _rows_of_pieces(run: ProcessedRun, pieces: int) -> IntArray:
    guides = [run.drawbar_pull_n, run.slip]
    if run.quality.missing:
        guides += [run.driving_torque_nm, run.vertical_load_n, run.ground_speed_mps, run.wheel_speed_radps]
    guides = [values for values in guides if np.isfinite(values).any()][:_GUIDES]
    chosen = []
    for piece in np.array_split(np.arange(len(run)), pieces):
        reasons, first = np.unique(run.reason[piece], return_index=True)
        used = piece[run.used[piece]]
        inside = used if len(used) else piece
        found = [row for values in guides for row in _ends(values, inside)]
        found += piece[first[(reasons != Reason.USED) | (not found)]].tolist()
        chosen.append(np.unique(found))
    return np.concatenate(chosen)


def trace_as_json(trace: Trace, reason: NDArray[np.uint8]) -> dict[str, Any]:
    """Return JSON values; NaN becomes None, and a quantity that was not measured is None as a whole.

    `reason`, shape (n,), stands in for the trace's own: it has the manual exclusions.
    """
    words = ["" if why is Reason.USED else why.name.lower() for why in Reason]
    arrays = {
        name: None if name in _MAY_BE_ABSENT and np.isnan(values).all() else _with_none(values)
        for name, values in trace.quantities.items()
    }
    return {
        **arrays,
        "used": (reason == Reason.USED).tolist(),
        "reason": [words[why] for why in reason],
        "segments": [{"kind": kind, "from_s": first, "to_s": last} for kind, first, last in trace.segments],
        "thinned_from": trace.thinned_from,
    }


def _ends(values: FloatArray, rows: IntArray) -> list[int]:
    known = rows[np.isfinite(values[rows])]
    return [int(known[pick(values[known])]) for pick in (np.argmin, np.argmax)] if len(known) else []


def _segments(run: ProcessedRun) -> tuple[tuple[str, float, float], ...]:
    last_s = float(run.time_s[-1])
    return tuple(
        (
            Segment(int(run.segment[start])).name.lower(),
            float(run.time_s[start]),
            float(run.time_s[stop]) if stop < len(run) else last_s,
        )
        for start, stop in runs_of(run.segment)
    )


def _with_none(values: FloatArray) -> list[float | None]:
    return [value if value == value else None for value in values.tolist()]
