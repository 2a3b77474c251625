"""Fewer points that look like all of them: what keeps a report of many runs small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

EDGES = np.round(np.arange(-1.0, 1.0001, 0.05), 2)
"""Bins of slip."""
_POINTS_IN_ALL, _FEWEST, _MOST = 14_000, 250, 700


@dataclass(frozen=True)
class Bins:
    """Medians and quartiles of y in bins of x; bins of fewer than `least` samples are left out.

    Attributes
    ----------
    centre, median, lower, upper : float64 array, shape (bins,)
        `lower` and `upper` are the quartiles.
    count : int64 array, shape (bins,)
    """

    centre: FloatArray
    median: FloatArray
    lower: FloatArray
    upper: FloatArray
    count: NDArray[np.int64]


def points_of_run(runs: int) -> int:
    """Return how many rows of each run a figure against time may have, so that many runs take no more room than few."""
    return int(np.clip(_POINTS_IN_ALL // max(runs, 1), _FEWEST, _MOST))


def decimated_rows(values: FloatArray, limit: int) -> NDArray[np.int64]:
    """Choose rows of a series so that its line keeps every peak.

    The series is cut into ``limit / 2`` pieces; of each the rows of the least and the greatest value stay.
    A piece without a number keeps its first row, so that a gap stays a gap.

    Parameters
    ----------
    values : float64 array, shape (n,)
    limit : int
        The greatest number of rows to return.

    Returns
    -------
    int64 array
        Rows in rising order; all of them when there are at most `limit`.
    """
    if len(values) <= limit:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), max(limit // 2, 1) + 1).astype(np.int64)[:-1]
    finite = np.isfinite(values)
    piece = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(values)))
    known = np.flatnonzero(finite)
    order = known[np.lexsort((values[known], piece[known]))]
    edge = np.flatnonzero(np.diff(piece[order], prepend=-1))
    lows, highs = order[edge], order[np.append(edge[1:], len(order)) - 1] if len(order) else order
    empty = starts[~np.isin(np.arange(len(starts)), piece[order])]
    return np.unique(np.concatenate([lows, highs, empty]))


def thinned_rows(x: FloatArray, y: FloatArray, *, cells: int = 40, per_cell: int = 2) -> NDArray[np.int64]:
    """Choose rows of a cloud of points: at most `per_cell` in each cell of a `cells` x `cells` grid over them.

    Rows with a NaN are left out. In a crowded cell rows are taken at even steps, so that no time is preferred.
    """
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(rows) == 0:
        return rows
    cell = _cell(x[rows], cells) * cells + _cell(y[rows], cells)
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    sizes = np.diff(starts, append=len(rows))
    steps = np.arange(per_cell)
    picks = starts[:, None] + (steps[None, :] * sizes[:, None]) // per_cell
    kept: NDArray[np.int64] = np.sort(rows[order[np.unique(picks)]])
    return kept


def thinned_by_sign(x: FloatArray, y: FloatArray) -> NDArray[np.int64]:
    """Choose rows of a cloud as `thinned_rows`, at x > 0 and elsewhere by themselves: each is looked at alone."""
    halves = (np.flatnonzero(x > 0), np.flatnonzero(~(x > 0)))
    return np.concatenate([half[thinned_rows(x[half], y[half])] for half in halves])


def binned(x: FloatArray, y: FloatArray, edges: FloatArray, *, least: int = 5) -> Bins:
    """Summarise y in bins of x; see `Bins`."""
    finite = np.isfinite(x) & np.isfinite(y)
    which = np.digitize(x, edges) - 1
    centre, quartiles, count = [], [], []
    for i in range(len(edges) - 1):
        inside = y[finite & (which == i)]
        if len(inside) >= least:
            centre.append((edges[i] + edges[i + 1]) / 2)
            quartiles.append(np.percentile(inside, [25, 50, 75]))
            count.append(len(inside))
    table = np.array(quartiles, float).reshape(-1, 3)
    return Bins(np.array(centre, float), table[:, 1], table[:, 0], table[:, 2], np.array(count, np.int64))


def parted_at_zero(curve: Bins) -> Bins:
    """Return the bins with a gap at x = 0, so that a line does not join braking to driving."""
    at = int(np.searchsorted(curve.centre, 0.0))
    if at in (0, len(curve.centre)):
        return curve
    gap = {name: np.insert(getattr(curve, name), at, np.nan) for name in ("median", "lower", "upper")}
    return Bins(centre=np.insert(curve.centre, at, 0.0), count=np.insert(curve.count, at, 0), **gap)


def _cell(values: FloatArray, cells: int) -> NDArray[np.int64]:
    low, high = values.min(), values.max()
    if high == low:
        return np.zeros(len(values), np.int64)
    return np.asarray(np.minimum((values - low) / (high - low) * cells, cells - 1), np.int64)
