"""Plotly figures as plain dicts: one style, colour-blind-safe, and legible in black and white.

Colours are Okabe and Ito's; every model also has its own dash and marker.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Trace = dict[str, Any]

MEASURED = "#111111"
CLOUD = "rgba(90,90,90,0.35)"
GREY_BAND = "rgba(0,0,0,0.13)"
GRID = "#e3e3e3"


@dataclass(frozen=True)
class Style:
    """How one model looks in every figure."""

    label: str
    colour: str
    dash: str
    symbol: str


STYLES: dict[str, Style] = {
    "wong": Style("Wong", "#D55E00", "dash", "circle"),
    "vasilev": Style("Vasil'ev", "#0072B2", "dot", "square-open"),
    "lyasko": Style("Lyasko", "#009E73", "solid", "diamond"),
    "ding": Style("Ding", "#CC79A7", "dashdot", "triangle-up"),
}
_SPARE = Style("", "#56B4E9", "longdash", "cross")


def style(model: str) -> Style:
    """Return a model's style; an unknown model gets a spare one under its own name."""
    return STYLES.get(model) or Style(model, _SPARE.colour, _SPARE.dash, _SPARE.symbol)


def words(text: str) -> str:
    """Return a name as plotly shows it letter for letter (plotly reads some HTML in its texts)."""
    return html.escape(text, quote=False)


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
        "xaxis": axis | {"title": {"text": x_title}},
        "yaxis": axis | {"title": {"text": y_title}},
    }
    return layout | more


def look_at(layout: dict[str, Any], axis: str, values: FloatArray, *, margin: float = 0.08) -> None:
    """Let an axis start at the range of some values (their outermost half percent left out); double-click shows all.

    Parameters
    ----------
    layout : dict
        Of `axes`; changed in place.
    axis : "x" or "y"
    values : float64 array
        NaN is left out; without any number the axis stays as it is.
    margin : float
        Share of the range that is added on either side.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return
    low, high = (float(value) for value in np.percentile(known, [0.5, 99.5]))
    pad = margin * (high - low) or 1.0
    layout[f"{axis}axis"] |= {"range": [low - pad, high + pad], "autorange": False}
