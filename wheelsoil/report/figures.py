"""Figures of the appendix as dicts, which figure.js draws: one style, for colour-blind readers; few points."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from daq import BoolArray, FloatArray, IntArray
from wheelsoil.wording.numbers import number

EDGES = np.round(np.arange(-1.0, 1.0001, 0.05), 2)
"""Bins of slip."""
_POINTS_IN_ALL, _FEWEST, _MOST = 14_000, 250, 700

Trace = dict[str, Any]
Places = Sequence[float | str | None]

ALL_RUNS = "all runs"
"""Name of the choice among the runs that shows all of them."""

MEASURED = "#111111"
RECOMMENDED = "#0b62c4"
CLOUD = "rgba(90,90,90,0.35)"
GREY_BAND = "rgba(0,0,0,0.13)"
_NONE: FloatArray = np.zeros(0)
_COLUMNS, _ROWS, _LONE_CELLS = 50, 34, 12
"""Columns and rows of the cells of a density, and of the grid that thins the samples outside them."""
_FEW = 60
"""Samples that are too few for bins."""
_REPEAT = 0.02
"""Range of slip within which rows of a table repeat one condition."""
_SAME_LOAD, _MOST_LOADS = 0.1, 4
"""Share of a load within which the next larger one is the same; loads of a table that are drawn apart."""
_BULK = (0.5, 99.5)
"""Percentiles that limit the initial range of an axis."""


@dataclass(frozen=True)
class Style:
    """How one model looks wherever it is drawn; figure.js has the dashes and symbols."""

    label: str
    colour: str
    dash: str
    symbol: str


STYLES: dict[str, Style] = {
    "wong": Style("Wong", "#D55E00", "dash", "circle"),
    "vasilev": Style("Vasil'ev", "#6b5a00", "dot", "square-open"),
    "lyasko": Style("Lyasko", "#009E73", "solid", "diamond"),
    "ding": Style("Ding", "#CC79A7", "dashdot", "triangle-up"),
    "chosen": Style("chosen", "#7A5FD0", "longdashdot", "star"),
}
"""Okabe and Ito's colours, but no blue: that is the recommended model's.

Dash and marker keep a black-and-white print legible.
"""
_SPARE = Style("", "#777777", "longdash", "hexagon")


def style(model: str) -> Style:
    """Return a model's style; an unknown model gets a spare one under its own name."""
    return STYLES.get(model) or Style(model, _SPARE.colour, _SPARE.dash, _SPARE.symbol)


_FORMS = {key: model_style.label for key, model_style in STYLES.items()} | {"second_order": "second order"}


def form_name(text: str) -> str:
    """Return the form of an effect as people write it, also in brackets after its family: "slip sinkage (Vasil'ev)"."""
    return re.sub(r"\w+", lambda found: _FORMS.get(found[0], found[0]), text)


@dataclass(frozen=True)
class Bins:
    """Medians and quartiles (`lower`, `upper`) of y in bins of x, each of shape (bins,); see `binned`."""

    centre: FloatArray
    median: FloatArray
    lower: FloatArray
    upper: FloatArray
    count: IntArray


def points_of_run(runs: int) -> int:
    """Return the number of rows per run in a figure against time, so that the total hardly depends on the run count."""
    return int(np.clip(_POINTS_IN_ALL // max(runs, 1), _FEWEST, _MOST))


def decimated_rows(values: FloatArray, limit: int) -> IntArray:
    """Choose at most `limit` rows of a series so that its line keeps every peak and both ends, in ascending order.

    The series is cut into ``limit / 2 - 1`` pieces; each keeps the rows of its minimum and maximum.
    A piece without a number keeps its first row, so that gaps stay visible.
    """
    if len(values) <= limit:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), max(limit // 2 - 1, 1) + 1).astype(np.int64)[:-1]
    finite = np.isfinite(values)
    piece = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(values)))
    known = np.flatnonzero(finite)
    order = known[np.lexsort((values[known], piece[known]))]
    edge = np.flatnonzero(np.diff(piece[order], prepend=-1))
    lows, highs = order[edge], order[np.append(edge[1:], len(order)) - 1] if len(order) else order
    empty = starts[~np.isin(np.arange(len(starts)), piece[order])]
    return np.unique(np.concatenate([lows, highs, empty, [0, len(values) - 1]]))


def thinned_rows(x: FloatArray, y: FloatArray, *, cells: int = 40, per_cell: int = 2) -> IntArray:
    """Choose rows of a cloud of points: at most `per_cell` in each cell of a `cells` x `cells` grid over them.

    Rows with a NaN are omitted. In a crowded cell rows are taken at even steps, so that no time is preferred.
    """
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(rows) == 0:
        return rows
    return rows[even_rows(_cell(x[rows], cells) * cells + _cell(y[rows], cells), per_cell)]


def even_rows(label: IntArray, most: int) -> IntArray:
    """Choose at most so many rows of each label, at even steps, in ascending order."""
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    picks = starts[:, None] + (np.arange(most)[None, :] * sizes[:, None]) // most
    return np.asarray(np.sort(order[np.unique(picks)]), np.int64)


def thinned_by_sign(x: FloatArray, y: FloatArray) -> IntArray:
    """Choose rows of a cloud as `thinned_rows`, separately for x > 0 and the rest."""
    halves = (np.flatnonzero(x > 0), np.flatnonzero(~(x > 0)))
    return np.concatenate([half[thinned_rows(x[half], y[half])] for half in halves])


class Binning:
    """Samples in bins of x, for one or several y; `edges` ascend."""

    def __init__(self, x: FloatArray, edges: FloatArray) -> None:
        which = np.digitize(x, edges).astype(np.int16)
        self._order = np.argsort(which, kind="stable")
        self._number = which[self._order]
        self._bins = np.arange(1, len(edges))
        self._centre = (edges[:-1] + edges[1:]) / 2

    def of(self, y: FloatArray, *, least: int = 5) -> Bins:
        """Summarise y, shape as x; bins with fewer than `least` samples are omitted."""
        y, number = y[self._order], self._number
        finite = np.isfinite(y)
        if not finite.all():
            y, number = y[finite], number[finite]
        start, stop = (np.searchsorted(number, self._bins, side) for side in ("left", "right"))
        kept = stop - start >= max(least, 1)
        start, count = start[kept], (stop - start)[kept]
        for first, size in zip(start.tolist(), count.tolist(), strict=True):
            y[first : first + size].sort()
        lower, median, upper = (_quantile(y, start, count, share) for share in (0.25, 0.5, 0.75))
        return Bins(self._centre[kept], median, lower, upper, count)


def _quantile(y: FloatArray, start: IntArray, count: IntArray, share: float) -> FloatArray:
    """Return the quantile of pieces of y that are in order, between two samples as numpy's."""
    at = (count - 1) * share
    low = np.floor(at)
    first = start + low.astype(np.int64)
    below, above, part = y[first], y[np.minimum(first + 1, start + count - 1)], at - low
    return np.asarray(np.where(part < 0.5, below + (above - below) * part, above - (above - below) * (1 - part)))


def binned(x: FloatArray, y: FloatArray, edges: FloatArray) -> Bins:
    """Summarise y in bins of x; see `Binning.of`."""
    return Binning(x, edges).of(y)


def by_slip(slip: FloatArray, y: FloatArray) -> Bins:
    """Summarise samples of runs in bins of slip."""
    return binned(slip, y, EDGES)


def by_slip_or_each(slip: FloatArray, y: FloatArray) -> Bins:
    """Summarise samples of runs in bins of slip; readings of a rut, which are too few for bins, stand one by one."""
    return by_slip(slip, y) if np.count_nonzero(np.isfinite(slip + y)) > _FEW else repeated(slip, y)


def repeated(x: FloatArray, y: FloatArray) -> Bins:
    """Summarise the rows of a table at each x; rows within `_REPEAT` of the first of them are repeats of it."""
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    order = rows[np.argsort(x[rows], kind="stable")]
    starts: list[int] = []
    for i, value in enumerate(x[order].tolist()):
        if not starts or value > x[order[starts[-1]]] + _REPEAT:
            starts.append(i)
    parts = np.split(order, starts[1:]) if len(order) else []
    at = [(float(np.mean(x[part])), *np.percentile(y[part], [50, 25, 75]).tolist()) for part in parts]
    centre, median, lower, upper = np.array(at, np.float64).reshape(-1, 4).T
    return Bins(centre, median, lower, upper, np.array([len(part) for part in parts], np.int64))


def by_load(load_n: FloatArray) -> list[tuple[str, BoolArray]]:
    """Return the rows of a table at each of its loads, with that load in words.

    Neighbours in the order of loads belong together up to a tenth. All rows are one group without a name where there is
    one load, or more than a figure has room for.
    """
    order = np.argsort(load_n)
    group = np.empty(len(load_n), np.int64)
    group[order] = np.cumsum(np.diff(load_n[order], prepend=load_n[order[:1]]) > _SAME_LOAD * load_n[order])
    loads = [group == i for i in range(int(group.max(initial=0)) + 1)]
    if not 1 < len(loads) <= _MOST_LOADS:
        return [("", np.ones(len(load_n), np.bool_))]
    return [(f"{number(float(np.median(load_n[rows])), 2)} N", rows) for rows in loads]


def matched(at: FloatArray, known: Bins) -> FloatArray:
    """Return the medians at some of the centres of bins; NaN where a bin had too few samples."""
    medians = dict(zip(known.centre.tolist(), known.median.tolist(), strict=True))
    return np.array([medians.get(centre, np.nan) for centre in at.tolist()])


def parted_at_zero(curve: Bins) -> Bins:
    """Return the bins with a gap at x = 0, so that no line connects braking and driving."""
    at = int(np.searchsorted(curve.centre, 0.0))
    if at in (0, len(curve.centre)):
        return curve
    gap = {name: np.insert(getattr(curve, name), at, np.nan) for name in ("median", "lower", "upper")}
    return Bins(centre=np.insert(curve.centre, at, 0.0), count=np.insert(curve.count, at, 0), **gap)


def _cell(values: FloatArray, cells: int) -> IntArray:
    low, high = values.min(), values.max()
    if high == low:
        return np.zeros(len(values), np.int64)
    return np.asarray(np.minimum((values - low) / (high - low) * cells, cells - 1), np.int64)


def numbers(values: FloatArray, digits: int = 5) -> list[float | None]:
    """Return values rounded to `digits` significant digits, NaN as None."""
    form = f".{digits}g"
    return [float(format(v, form)) if isfinite(v) else None for v in values.tolist()]


def line(x: FloatArray, y: FloatArray, name: str, colour: str, dash: str = "solid", width: float = 2.0) -> Trace:
    """Return a line; NaN breaks it."""
    place = {"x": numbers(x), "y": numbers(y)}
    return {"kind": "line", "name": name, **place, "colour": colour, "dash": dash, "width": width}


def marked_line(x: FloatArray, y: FloatArray, name: str, style: Style) -> Trace:
    """Return a line with the markers of a model."""
    return line(x, y, name, style.colour, style.dash) | {"symbol": style.symbol, "size": 8}


def points(x: Places, y: Places, name: str, look: tuple[str, str], size: float = 6.0) -> Trace:
    """Return points at numbers or names; a look is a colour and a symbol."""
    return {"kind": "points", "name": name, "x": x, "y": y, "colour": look[0], "symbol": look[1], "size": size}


def dots(x: FloatArray, y: FloatArray, name: str) -> Trace:
    """Return a cloud of small dots, which do not answer to the pointer."""
    return points(numbers(x, 4), numbers(y, 4), name, (CLOUD, "circle"), 4.0) | {"quiet": True}


def band(
    x: FloatArray, lower: FloatArray, upper: FloatArray, name: str, colour: str, opacity: float = 1.0
) -> list[Trace]:
    """Return two traces: the upper edge, which is not drawn, and the area down to the lower one."""
    base: Trace = {"name": name, "x": numbers(x)}
    area = {"kind": "band", "colour": colour, "opacity": opacity}
    return [base | {"kind": "edge", "y": numbers(upper)}, base | {"y": numbers(lower)} | area]


def density(x: FloatArray, y: FloatArray, x_range: tuple[float, float], name: str) -> list[Trace]:
    """Return the density of samples as grey cells, darker for more samples; samples outside the cells are dots.

    Samples outside `x_range` and rows with a NaN are omitted; the cells hold the 0.5th to the 99.5th percentile of y.
    """
    known = np.isfinite(x) & np.isfinite(y) & (x >= x_range[0]) & (x <= x_range[1])
    x, y = x[known], y[known]
    across = np.linspace(*x_range, _COLUMNS + 1)
    low, high = np.percentile(y, _BULK) if len(y) else (0.0, 1.0)
    up = np.linspace(low, high if high > low else low + 1.0, _ROWS + 1)
    counts = np.histogram2d(y, x, bins=[up, across])[0].astype(int)
    filled = np.flatnonzero(counts.any(axis=0))
    first, last = (filled[0], filled[-1] + 1) if len(filled) else (0, 1)
    filled_counts = counts[counts > 0]
    cells: Trace = {
        "kind": "cells",
        "name": name,
        "x0": float(f"{(across[first] + across[first + 1]) / 2:.5g}"),
        "dx": float(f"{across[1] - across[0]:.5g}"),
        "y0": float(f"{(up[0] + up[1]) / 2:.5g}"),
        "dy": float(f"{up[1] - up[0]:.5g}"),
        "z": counts[:, first:last].tolist(),
        "most": float(np.percentile(filled_counts, 95)) if len(filled_counts) else 1.0,
    }
    beyond = np.flatnonzero((y < up[0]) | (y > up[-1]))
    lone = beyond[thinned_rows(x[beyond], y[beyond], cells=_LONE_CELLS, per_cell=1)]
    return [cells, *([dots(x[lone], y[lone], name)] if len(lone) else [])]


def shades(spans: Sequence[tuple[float, float]], low: float, high: float, name: str, fill: tuple[str, str]) -> Trace:
    """Return vertical stripes (from, to), e.g. segments of time, between `low` and `high` on the y axis.

    `fill` is a colour and a pattern, readable without colour.
    """
    x: list[float | None] = []
    y: list[float | None] = []
    for start, end in spans:
        x += [round(start, 3), round(start, 3), round(end, 3), round(end, 3), None]
        y += [low, high, high, low, None]
    return {"kind": "stripes", "name": name, "x": x, "y": y, "colour": fill[0], "pattern": fill[1]}


def bars(labels: Sequence[str], values: Sequence[float], name: str, colour: str, pattern: str) -> Trace:
    """Return one part of a stacked horizontal bar; the pattern distinguishes the parts without colour."""
    place = {"x": [round(float(v), 5) for v in values], "y": list(labels)}
    return {"kind": "bar", "name": name, **place, "colour": colour, "pattern": pattern}


def axes(x_title: str, y_title: str, *, height: int = 380, **more: Any) -> dict[str, Any]:
    """Return the layout of a figure: its axes, whose titles have units, its height in pixels, and what is special.

    An axis may have a ``range`` to begin with, names in an ``order`` from the left or the top, powers of ten
    (``log``), or hold ``zero``. The rest: ``one_scale`` for both axes, ``grouped`` bars, ``dotted`` vertical lines.
    """
    return {"height": height, "xaxis": {"title": x_title}, "yaxis": {"title": y_title}, **more}


def set_axis_range(
    layout: dict[str, Any], axis: str, values: FloatArray, *, also: FloatArray = _NONE, margin: float = 0.08
) -> None:
    """Set the initial range of an axis ("x" or "y") to the 0.5th to 99.5th percentile of some values, as far as known.

    Double-click shows all. `also` has further values to include, e.g. the lines of models, as far as the range is at
    most doubled; `margin` is the share of the range added on either side.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return
    low, high = (float(value) for value in np.percentile(known, _BULK))
    low, high = _stretched(low, high, also[np.isfinite(also)])
    pad = margin * (high - low) or 1.0
    layout[f"{axis}axis"] |= {"range": [low - pad, high + pad]}


def _stretched(low: float, high: float, also: FloatArray) -> tuple[float, float]:
    """Return the range extended to further values, to at most twice its length; the two ends share the extension."""
    if not len(also):
        return low, high
    span = high - low
    below, above = max(low - float(also.min()), 0.0), max(float(also.max()) - high, 0.0)
    if below + above > span:
        below, above = min(below, max(span - above, span / 2)), min(above, max(span - below, span / 2))
    return low - below, high + above
