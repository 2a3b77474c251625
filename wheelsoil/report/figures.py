"""Plotly figures as plain dicts: one style, colour-blind-safe, and legible in black and white."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelsoil.model_styles import Style
from wheelsoil.report.thinning import thinned_rows

FloatArray = NDArray[np.float64]
Trace = dict[str, Any]

MEASURED = "#111111"
CLOUD = "rgba(90,90,90,0.35)"
GREY_BAND = "rgba(0,0,0,0.13)"
GRID = "#e3e3e3"
_NONE: FloatArray = np.zeros(0)
_COLUMNS, _ROWS, _LONE_CELLS = 50, 34, 12
"""Cells of a density, and those of which one sample each is drawn where it lies outside of them."""
_BULK = (0.5, 99.5)
"""Percentiles between which the bulk of a figure lies."""


def words(text: str) -> str:
    """Return a name as plotly shows it letter for letter (plotly reads some HTML in its texts)."""
    return html.escape(text, quote=False)


def see_through(colour: str) -> str:
    """Return a colour "#rrggbb" as it fills a band under lines."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.22)"


def numbers(values: FloatArray, digits: int = 5) -> list[float | None]:
    """Return values with few digits, NaN as None: what a figure needs and no more."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values.tolist()]


def line(x: FloatArray, y: FloatArray, name: str, colour: str, dash: str = "solid", width: float = 2.0) -> Trace:
    """Return a line trace; NaN breaks it."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": words(name),
        "x": numbers(x),
        "y": numbers(y),
        "line": {"color": colour, "dash": dash, "width": width},
        "connectgaps": False,
    }


def marked_line(x: FloatArray, y: FloatArray, name: str, look: Style) -> Trace:
    """Return a line with the markers of a model."""
    trace = line(x, y, name, look.colour, look.dash)
    return trace | {"mode": "lines+markers", "marker": {"symbol": look.symbol, "size": 8, "color": look.colour}}


def dots(x: FloatArray, y: FloatArray, name: str, colour: str = CLOUD) -> Trace:
    """Return a cloud of small dots."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": words(name),
        "x": numbers(x, 4),
        "y": numbers(y, 4),
        "marker": {"color": colour, "size": 4},
        "hoverinfo": "skip",
    }


def band(x: FloatArray, lower: FloatArray, upper: FloatArray, name: str, colour: str) -> list[Trace]:
    """Return two traces: an invisible upper edge and the area down to the lower one."""
    edge = {"width": 0, "color": colour}
    base: Trace = {"type": "scatter", "mode": "lines", "x": numbers(x), "line": edge, "hoverinfo": "skip"}
    return [
        base | {"y": numbers(upper), "showlegend": False, "name": words(name)},
        base | {"y": numbers(lower), "fill": "tonexty", "fillcolor": colour, "name": words(name)},
    ]


def density(x: FloatArray, y: FloatArray, x_range: tuple[float, float], name: str) -> list[Trace]:
    """Return how many samples lie where, as grey cells: white is none, the darker the more; the few beyond as dots.

    Parameters
    ----------
    x, y : float64 array, shape (n,)
        Rows with a NaN are left out.
    x_range : (float, float)
        What lies outside is left out.
    name : str

    Returns
    -------
    list of Trace
        The cells, over all but the outermost half percent of y at either end, and dots for what lies outside of them.
    """
    known = np.isfinite(x) & np.isfinite(y) & (x >= x_range[0]) & (x <= x_range[1])
    x, y = x[known], y[known]
    across = np.linspace(*x_range, _COLUMNS + 1)
    low, high = np.percentile(y, _BULK) if len(y) else (0.0, 1.0)
    up = np.linspace(low, high if high > low else low + 1.0, _ROWS + 1)
    counts = np.histogram2d(y, x, bins=[up, across])[0].astype(int)
    filled = np.flatnonzero(counts.any(axis=0))
    first, last = (filled[0], filled[-1] + 1) if len(filled) else (0, 1)
    seen = counts[counts > 0]
    cells: Trace = {
        "type": "heatmap",
        "name": words(name),
        "x0": float(f"{(across[first] + across[first + 1]) / 2:.5g}"),
        "dx": float(f"{across[1] - across[0]:.5g}"),
        "y0": float(f"{(up[0] + up[1]) / 2:.5g}"),
        "dy": float(f"{up[1] - up[0]:.5g}"),
        "z": counts[:, first:last].tolist(),
        "zmin": 0,
        "zmax": float(np.percentile(seen, 95)) if len(seen) else 1.0,
        "colorscale": [[0, "rgba(0,0,0,0)"], [1e-6, "#efefef"], [1, "#a6a6a6"]],
        "showscale": False,
        "hoverinfo": "skip",
    }
    beyond = np.flatnonzero((y < up[0]) | (y > up[-1]))
    lone = beyond[thinned_rows(x[beyond], y[beyond], cells=_LONE_CELLS, per_cell=1)]
    return [cells, *([dots(x[lone], y[lone], name) | {"showlegend": False}] if len(lone) else [])]


def shades(spans: Sequence[tuple[float, float]], low: float, high: float, name: str, look: tuple[str, str]) -> Trace:
    """Return upright stripes, e.g. segments of time; `look` is a colour and plotly's pattern (readable without colour).

    Parameters
    ----------
    spans : sequence of (from, to)
    low, high : float
        Of the stripes, on the y axis.
    name : str
    look : (colour, pattern)
    """
    x: list[float | None] = []
    y: list[float | None] = []
    for start, end in spans:
        x += [round(start, 3), round(start, 3), round(end, 3), round(end, 3), None]
        y += [low, high, high, low, None]
    colour, pattern = look
    return {
        "type": "scatter",
        "mode": "lines",
        "name": words(name),
        "x": x,
        "y": y,
        "line": {"width": 0, "color": colour},
        "fill": "toself",
        "fillcolor": colour,
        "fillpattern": {"shape": pattern, "fgcolor": "#b5b5b5", "bgcolor": colour, "size": 7, "solidity": 0.12},
        "hoverinfo": "skip",
    }


def bars(labels: Sequence[str], values: Sequence[float], name: str, colour: str, pattern: str) -> Trace:
    """Return one part of a stacked horizontal bar; the pattern tells the parts apart without colour."""
    return {
        "type": "bar",
        "orientation": "h",
        "name": words(name),
        "y": [words(label) for label in labels],
        "x": [round(float(v), 5) for v in values],
        "marker": {"color": colour, "pattern": {"shape": pattern, "solidity": 0.3}},
    }


def axes(x_title: str, y_title: str, *, height: int = 380, **more: Any) -> dict[str, Any]:
    """Return the layout of a figure: axis titles with units, a legend above, no frame."""
    axis = {"gridcolor": GRID, "zerolinecolor": "#9a9a9a", "linecolor": "#555", "ticks": "outside", "automargin": True}
    layout: dict[str, Any] = {
        "height": height,
        "margin": {"l": 60, "r": 14, "t": 10, "b": 50},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#1a1a1a"},
        "hovermode": "closest",
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 1.02,
            "yanchor": "bottom",
            "font": {"size": 12},
            "traceorder": "normal",
        },
        "xaxis": axis | {"title": {"text": x_title, "font": {"size": 12.5}}},
        "yaxis": axis | {"title": {"text": y_title, "font": {"size": 12.5}}},
    }
    return layout | more


def look_at(
    layout: dict[str, Any], axis: str, values: FloatArray, *, also: FloatArray = _NONE, margin: float = 0.08
) -> None:
    """Let an axis start at the range of some values (their outermost half percent left out); double-click shows all.

    Parameters
    ----------
    layout : dict
        Of `axes`; changed in place.
    axis : "x" or "y"
    values : float64 array
        NaN is left out; without any number the axis stays as it is.
    also : float64 array
        What belongs to the view too, e.g. the lines of models, as long as that no more than doubles its range.
    margin : float
        Share of the range that is added on either side.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return
    low, high = (float(value) for value in np.percentile(known, _BULK))
    low, high = _stretched(low, high, also[np.isfinite(also)])
    pad = margin * (high - low) or 1.0
    layout[f"{axis}axis"] |= {"range": [low - pad, high + pad], "autorange": False}


def _stretched(low: float, high: float, also: FloatArray) -> tuple[float, float]:
    """Return a range that holds some values too, at most twice as long: what one end leaves, the other may take."""
    if not len(also):
        return low, high
    span = high - low
    below, above = max(low - float(also.min()), 0.0), max(float(also.max()) - high, 0.0)
    if below + above > span:
        below, above = min(below, max(span - above, span / 2)), min(above, max(span - below, span / 2))
    return low - below, high + above
