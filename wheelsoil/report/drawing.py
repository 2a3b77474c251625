"""Figures drawn as SVG: readable without a script, in the colours of the page's theme, sharp on paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from math import ceil, floor, isfinite, log10

import numpy as np

from daq import BoolArray, DataError, FloatArray
from wheelsoil.report.content import Drawing, Text

_SHARES = (0.97, 0.85, 0.65, 0.42, 0.20)
"""Shares of the samples that lie in the cells of each grey, from the lightest to the darkest."""
_CELLS = (64, 48)
_TOP, _BOTTOM, _LEFT = 34, 44, 58
_LABEL_GAP = 38
_NARROW = (420, 330, 14)


@dataclass(frozen=True)
class Curve:
    """A line of a figure; the class is that of the style sheet: "base", "model", "alt", "second", "measured".

    The mark is written at the line's end where there is no room for names.
    """

    name: str
    x: FloatArray
    y: FloatArray
    look: str
    lower: FloatArray | None = None
    upper: FloatArray | None = None
    note: str = ""
    points: bool = False
    mark: str = ""


@dataclass(frozen=True)
class Plane:
    """Axes of a figure: their ranges and titles."""

    x: tuple[float, float]
    y: tuple[float, float]
    x_title: str
    y_title: str


@dataclass
class _Canvas:
    plane: Plane
    width: int
    height: int
    right: int
    parts: list[str] = field(default_factory=list)

    def at(self, x: float, y: float) -> tuple[float, float]:
        (x0, x1), (y0, y1) = self.plane.x, self.plane.y
        across = _LEFT + (x - x0) / (x1 - x0) * (self.width - _LEFT - self.right)
        return across, _TOP + (y1 - y) / (y1 - y0) * (self.height - _TOP - _BOTTOM)

    def add(self, text: str) -> None:
        self.parts.append(text)

    def text(self, look: str, x: float, y: float, text: str, anchor: str = "start") -> None:
        self.add(f'<text class="{look}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>')


def figure_or_reason(draw: Callable[[], Drawing]) -> Drawing | Text:
    """Return a figure, or the sentence why there is none."""
    try:
        return draw()
    except DataError as error:
        return Text(f"No figure: {error.what}.", "missing")


def drawn(
    key: str,
    title: str,
    caption: str,
    plane: Plane,
    curves: Sequence[Curve],
    *,
    samples: tuple[FloatArray, FloatArray] | None = None,
    shades: Sequence[tuple[float, float]] = (),
    reading: str = "",
    wide: tuple[int, int, int] = (720, 340, 170),
) -> Drawing:
    """Draw a figure for a wide screen, and for a phone and paper.

    Parameters
    ----------
    samples : two float64 arrays, shape (n,)
        Drawn as a density in greys below the curves.
    shades : sequence of (from, to)
        Stripes along x behind everything.
    wide : three int
        Width, height and the room for names right of the lines, in pixels.
    """
    drawings = [_svg(title, plane, curves, samples, shades, size) for size in (wide, _NARROW)]
    values: list[Mapping[str, object]] = []
    for curve in curves:
        edges = {name: edge for name in ("lower", "upper") if (edge := getattr(curve, name)) is not None}
        values.append({"name": curve.name, "look": curve.look, "x": curve.x, "y": curve.y, **edges})
    return Drawing(key, title, caption, drawings[0], drawings[1], values, reading)


def _svg(
    title: str,
    plane: Plane,
    curves: Sequence[Curve],
    samples: tuple[FloatArray, FloatArray] | None,
    shades: Sequence[tuple[float, float]],
    size: tuple[int, int, int],
) -> str:
    canvas = _Canvas(plane, *size)
    _axes(canvas, shades)
    if samples is not None:
        _density(canvas, *samples)
    for curve in curves:
        _band(canvas, curve)
    for curve in sorted(curves, key=lambda curve: (curve.points, curve.look == "base")):
        _line(canvas, curve)  # a broken line over a solid one that it lies on: both are seen
    if size[2] > _LABEL_GAP:
        _labels(canvas, curves)
    body = "".join(canvas.parts)
    box = f'viewBox="0 0 {size[0]} {size[1]}" preserveAspectRatio="xMidYMin"'
    head = f'<svg {box} role="img" aria-label="{escape(title)}">'
    return f"{head}<title>{escape(title)}</title>{body}</svg>"


def _axes(canvas: _Canvas, shades: Sequence[tuple[float, float]]) -> None:
    plane = canvas.plane
    (x0, x1), (y0, y1) = plane.x, plane.y
    left, top = canvas.at(x0, y1)
    right, bottom = canvas.at(x1, y0)
    for start, end in shades:
        a, b = canvas.at(start, y0)[0], canvas.at(end, y0)[0]
        canvas.add(f'<rect class="shade" x="{a:.1f}" y="{top:.1f}" width="{b - a:.1f}" height="{bottom - top:.1f}"/>')
    for value in ticks(y0, y1):
        y = canvas.at(x0, value)[1]
        kind = "zero" if value == 0 else "grid"
        canvas.add(f'<path class="{kind}" d="M{left:.1f} {y:.1f}H{right:.1f}"/>')
        canvas.text("tick", left - 8, y + 4, tick_text(value), "end")
    canvas.add(f'<path class="axis" d="M{left:.1f} {bottom:.1f}H{right:.1f}"/>')
    for value in ticks(x0, x1, 8):
        x = canvas.at(value, y0)[0]
        canvas.add(f'<path class="axis" d="M{x:.1f} {bottom:.1f}v4"/>')
        canvas.text("tick", x, bottom + 18, tick_text(value), "middle")
    canvas.text("title", 0, 14, plane.y_title)
    canvas.text("title", right, bottom + 37, plane.x_title, "end")


def _density(canvas: _Canvas, x: FloatArray, y: FloatArray) -> None:
    """Draw the cells that hold most samples in five greys."""
    plane = canvas.plane
    inside = (x >= plane.x[0]) & (x <= plane.x[1]) & (y >= plane.y[0]) & (y <= plane.y[1])
    if not inside.any():
        return
    across = np.linspace(*plane.x, _CELLS[0] + 1)
    up = np.linspace(*plane.y, _CELLS[1] + 1)
    counts = np.histogram2d(x[inside], y[inside], bins=[across, up])[0]
    ordered = np.sort(counts[counts > 0])[::-1]
    reached = np.cumsum(ordered) / ordered.sum()
    least = [ordered[min(int(np.searchsorted(reached, share)), len(ordered) - 1)] for share in _SHARES]
    for grey, (low, high) in enumerate(pairwise([*least, np.inf]), 1):
        chosen = (counts >= low) & (counts < high)
        pieces = [_run(canvas, across, up, row, chosen[:, row]) for row in range(chosen.shape[1])]
        canvas.add(f'<path class="dens-{grey}" d="{"".join(pieces)}"/>')


def _run(canvas: _Canvas, across: FloatArray, up: FloatArray, row: int, chosen: BoolArray) -> str:
    """Return the rectangles of neighbouring cells in one row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    pieces = []
    for start, stop in edges.reshape(-1, 2).tolist():
        (x0, y0), (x1, y1) = canvas.at(across[start], up[row]), canvas.at(across[stop], up[row + 1])
        pieces.append(f"M{x0:.1f} {y0:.1f}H{x1:.1f}V{y1:.1f}H{x0:.1f}z")
    return "".join(pieces)


def _inside(canvas: _Canvas, x: FloatArray, y: FloatArray) -> list[list[tuple[float, float]]]:
    """Return the pieces of a line that lie within the axes; it ends where it leaves them."""
    (left, right), (low, high) = canvas.plane.x, canvas.plane.y
    pieces: list[list[tuple[float, float]]] = []
    goes_on = False
    for (a, b), (c, d) in pairwise(zip(x.tolist(), y.tolist(), strict=True)):
        start, stop = _within(a, c, left, right, _within(b, d, low, high, (0.0, 1.0)))
        if not start < stop:
            goes_on = False
            continue
        if not (goes_on and start == 0.0):
            pieces.append([canvas.at(a + start * (c - a), b + start * (d - b))])
        goes_on = stop == 1.0
        pieces[-1].append(canvas.at(c, d) if goes_on else canvas.at(a + stop * (c - a), b + stop * (d - b)))
    return pieces


def _within(start: float, end: float, low: float, high: float, part: tuple[float, float]) -> tuple[float, float]:
    """Return which part of the way from one value to another lies within limits; (1, 0) where nothing does."""
    if not (isfinite(start) and isfinite(end)) or (start == end and not low <= start <= high):
        return 1.0, 0.0
    if start == end:
        return part
    first, last = sorted(((low - start) / (end - start), (high - start) / (end - start)))
    return max(part[0], first), min(part[1], last)


def _clipped(canvas: _Canvas, x: FloatArray, y: FloatArray) -> list[list[tuple[float, float]]]:
    """Return the pieces of a line between its gaps, held at the axes' ends."""
    low, high = canvas.plane.y
    pieces: list[list[tuple[float, float]]] = [[]]
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if isfinite(b) and canvas.plane.x[0] <= a <= canvas.plane.x[1]:
            pieces[-1].append(canvas.at(a, min(max(b, low), high)))
        elif pieces[-1]:
            pieces.append([])
    return [piece for piece in pieces if piece]


def _path(points: Sequence[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _band(canvas: _Canvas, curve: Curve) -> None:
    if curve.lower is None or curve.upper is None or curve.points:
        return
    known = np.isfinite(curve.lower) & np.isfinite(curve.upper)
    for above, below in zip(
        _clipped(canvas, curve.x, np.where(known, curve.upper, np.nan)),
        _clipped(canvas, curve.x, np.where(known, curve.lower, np.nan)),
        strict=True,
    ):
        canvas.add(f'<path class="band {curve.look}" d="{_path([*above, *below[::-1]])}z"/>')


def _line(canvas: _Canvas, curve: Curve) -> None:
    if not curve.points:
        pieces = _inside(canvas, curve.x, curve.y)
        canvas.parts += [f'<path class="line {curve.look}" d="{_path(piece)}"/>' for piece in pieces]
        if curve.mark and pieces and canvas.right <= _LABEL_GAP:
            canvas.text(f"label {curve.look}", pieces[-1][-1][0] - 8, pieces[-1][-1][1] - 9, curve.mark, "end")
        return
    low, high = canvas.plane.y
    edges = (curve.y, curve.y) if curve.lower is None or curve.upper is None else (curve.lower, curve.upper)
    for x, y, below, above in zip(curve.x, curve.y, *edges, strict=True):
        if not (isfinite(y) and low <= y <= high):
            continue
        across, place = canvas.at(float(x), float(y))
        ends = [canvas.at(float(x), float(np.clip(end, low, high)))[1] for end in (above, below)]
        canvas.add(f'<path class="whisker {curve.look}" d="M{across:.1f} {ends[0]:.1f}V{ends[1]:.1f}"/>')
        canvas.add(f'<circle class="point {curve.look}" cx="{across:.1f}" cy="{place:.1f}" r="4"/>')


def _labels(canvas: _Canvas, curves: Sequence[Curve]) -> None:
    """Write the name of each line at its right end, moved apart where they would touch."""
    named = []
    for curve in curves:
        pieces = [] if curve.points else _inside(canvas, curve.x, curve.y)
        if pieces and curve.name:
            named.append((pieces[-1][-1][1], curve))
    below = float(_TOP)
    for place, curve in sorted(named, key=lambda item: item[0]):
        y = max(place, below)
        x = canvas.width - canvas.right + 10
        canvas.text(f"label {curve.look}", x, y + 4, curve.name)
        for i, part in enumerate(curve.note.split("\n") if curve.note else (), 1):
            canvas.text("note", x, y + 4 + 15 * i, part)
        below = y + _LABEL_GAP + (15 if "\n" in curve.note else 0)


def ticks(low: float, high: float, most: int = 7) -> list[float]:
    """Return round values within a range, at most about `most` of them."""
    step = 10.0 ** floor(log10((high - low) / most))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (step * factor) <= most)
    return [round(i * step, 10) + 0.0 for i in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def tick_text(value: float) -> str:
    """Return a number at an axis, with a proper minus and thin spaces between thousands."""
    return f"{value:,.10g}".replace(",", "\u202f").replace("-", "−")


def beyond(samples: tuple[FloatArray, FloatArray], plane: Plane) -> str:
    """Return in words how many of the samples within the range of x lie above or below the axis; "" for none."""
    x, y = samples
    within = y[(x >= plane.x[0]) & (x <= plane.x[1]) & np.isfinite(y)]
    share = float(np.mean((within < plane.y[0]) | (within > plane.y[1]))) if len(within) else 0.0
    if share == 0.0:
        return ""
    return f", {100 * share:.1f} % beyond the axis" if share >= 5e-4 else ", fewer than 0.1 % beyond the axis"


def reach(*values: FloatArray, zero: bool = True) -> tuple[float, float]:
    """Return the range that holds all values, 4 % wider, with zero in it if asked for."""
    known = np.concatenate([array[np.isfinite(array)] for array in values] + ([np.zeros(1)] if zero else []))
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    pad = 0.04 * (high - low) or 1.0
    return low - pad, high + pad
