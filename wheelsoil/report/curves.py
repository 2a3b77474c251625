"""Figures over slip: a channel with its density and every model with its band, driving and braking separately."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray
from wheelsoil.report.content import Figure, Panels
from wheelsoil.report.figures import (
    EDGES,
    GREY_BAND,
    MEASURED,
    Bins,
    Trace,
    axes,
    band,
    binned,
    density,
    dots,
    line,
    marked_line,
    set_axis_range,
    thinned_by_sign,
    translucent,
)
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.model_styles import style


def quantity_figure(
    material: ReportInputs, key: str, name: str, measured: FloatArray, axis: str, factor: float = 1.0
) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of one predicted quantity and the numbers in it.

    Parameters
    ----------
    key : str
        Key of the figure.
    name : str
        Name of the prediction, e.g. ``"sinkage_m"``.
    measured : float64 array, shape (n,)
        In the unit of the axis; all NaN if it was not measured.
    axis : str
        Axis title with unit.
    factor : float
        Conversion from the prediction's unit to that of the axis.
    """
    pool = material.pool
    data: list[Trace] = []
    numbers: dict[str, Any] = {"unit": axis}
    driven = measured[pool.slip > 0]
    lines = []
    if np.isfinite(measured).any():
        curve = binned(pool.slip, measured, EDGES)
        rows = thinned_by_sign(pool.slip, measured)
        data = [
            dots(pool.slip[rows], measured[rows], "measured"),
            *band(curve.centre, curve.lower, curve.upper, "middle half", GREY_BAND),
            line(curve.centre, curve.median, "median of measured", MEASURED, "solid", 2.2),
        ]
        numbers["measured"] = curve
    for model in material.fit.models:
        curve = binned(pool.slip, factor * pool.predicted(model.name, name), EDGES)
        data.append(marked_line(curve.centre, curve.median, style(model.name).label, style(model.name)))
        numbers[model.name] = curve
        lines.append(curve.median[curve.centre > 0])
    layout = axes("slip", axis, height=380)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    predicted = np.concatenate(lines)
    set_axis_range(layout, "y", driven if np.isfinite(driven).any() else predicted, also=predicted)
    return Figure(key, axis, data, layout), numbers


ALL_RUNS = "all runs"
_SIGMAS = 1.959964
"""Half width of a 95 % interval in sigmas."""
_HALVES = (("driving", (0.0, 1.0)), ("braking", (-1.0, 0.0)))


@dataclass(frozen=True)
class Curves:
    """One channel of all fitted runs against slip.

    Attributes
    ----------
    panels : Panels
        Driving and braking; the reader chooses among all runs and each.
    errors : Figure
        Predicted - measured of every model, all runs.
    """

    panels: Panels
    errors: Figure
    numbers: dict[str, Any]


def curves_of(material: ReportInputs, channel: str, key: str, axis: str, reading: str) -> Curves:
    """Draw "dp" or "t" against slip.

    Parameters
    ----------
    channel : "dp" or "t"
    key : str
        Prefix of the figures' keys.
    axis : str
        Title of the y axis with unit.
    reading : str
        Text on how to read the panels.

    Raises
    ------
    DataError
        The channel was not measured.
    """
    pool = material.pool
    measured = pool.measured(channel)
    predicted = {model.name: pool.predicted(model.name, OUTPUTS[channel].field) for model in material.fit.models}
    predicted = {name: np.where(np.isfinite(measured), values, np.nan) for name, values in predicted.items()}
    sigmas = material.sigmas[channel]
    choices = {ALL_RUNS: np.ones(len(measured), np.bool_)}
    if len(material.fitted) > 1:
        choices |= {run.run.id: pool.run == i for i, run in enumerate(material.fitted) if run.used.any()}
    figures = []
    for half, ends in _HALVES:
        inside = (pool.slip > 0) if half == "driving" else (pool.slip <= 0)
        if not (inside & np.isfinite(measured)).any():
            continue
        data: list[Trace] = []
        groups: list[str] = []
        for choice, chosen in choices.items():
            traces = _traces(pool.slip, measured, predicted, sigmas, chosen & inside, ends)
            data += traces
            groups += [choice] * len(traces)
        layout = axes("slip", axis, height=430)
        visible = ends if half == "driving" else (float(np.percentile(pool.slip[inside], 0.5)), 0.0)
        set_axis_range(layout, "x", np.array(visible), margin=0.02)
        set_axis_range(layout, "y", measured[inside], also=_medians(pool.slip, predicted, choices, inside))
        figures.append(Figure(f"{key}-{half}", half.capitalize(), data, layout, groups))
    errors, numbers = _errors(material, key, axis, measured, predicted)
    lacking = f" Not included because a signal is missing: {material.not_fitted}." if material.not_fitted else ""
    return Curves(Panels(figures, f"{reading}{lacking}", list(choices)), errors, numbers)


def _medians(
    slip: FloatArray,
    predicted: dict[str, FloatArray],
    choices: dict[str, BoolArray],
    inside: BoolArray,
) -> FloatArray:
    """Return the points of every model's line for every choice of runs."""
    rows = [chosen & inside for chosen in choices.values()]
    return np.concatenate(
        [binned(slip[keep], values[keep], EDGES).median for values in predicted.values() for keep in rows]
    )


def _traces(
    slip: FloatArray,
    measured: FloatArray,
    predicted: dict[str, FloatArray],
    sigmas: dict[str, FloatArray],
    rows: BoolArray,
    ends: tuple[float, float],
) -> list[Trace]:
    """Return the traces of one choice of runs."""
    s, y = slip[rows], measured[rows]
    curve = binned(s, y, EDGES)
    traces = [
        *density(s, y, ends, "samples"),
        *band(curve.centre, curve.lower, curve.upper, "middle half", GREY_BAND),
        line(curve.centre, curve.median, "measured", MEASURED, "solid", 2.4),
    ]
    for name, values in predicted.items():
        traces += _of_model(name, s, values[rows], sigmas[name][rows])
    return traces


def _of_model(name: str, slip: FloatArray, values: FloatArray, sigma: FloatArray) -> list[Trace]:
    """Return a model's median in bins of slip, and the 95 % band of its coefficients if known."""
    model_style, median = style(name), binned(slip, values, EDGES)
    drawn = marked_line(median.centre, median.median, model_style.label, model_style) | {"legendgroup": name}
    half = _SIGMAS * _binned_sigma(median, slip, sigma)
    if not np.isfinite(half).any():
        return [drawn]
    edges = band(
        median.centre, median.median - half, median.median + half, model_style.label, translucent(model_style.colour)
    )
    hidden = [trace | {"showlegend": False, "legendgroup": name} for trace in edges]
    return [*hidden, drawn]


def _binned_sigma(curve: Bins, slip: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the median sigma in each bin of a curve, shape (bins,), NaN if unknown."""
    found = binned(slip, sigma, EDGES, least=1)
    known = dict(zip(found.centre.tolist(), found.median.tolist(), strict=True))
    return np.array([known.get(centre, np.nan) for centre in curve.centre.tolist()])


def _errors(
    material: ReportInputs, key: str, axis: str, measured: FloatArray, predicted: dict[str, FloatArray]
) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of predicted - measured, and the numbers of the curves."""
    slip = material.pool.slip
    numbers: dict[str, Any] = {"measured": binned(slip, measured, EDGES)}
    traces: list[Trace] = []
    medians: list[FloatArray] = []
    for name, values in predicted.items():
        error = binned(slip, values - measured, EDGES)
        driven = error.centre > 0
        model_style = style(name)
        traces.append(marked_line(error.centre[driven], error.median[driven], model_style.label, model_style))
        medians.append(error.median[driven])
        numbers[name] = {"predicted": binned(slip, values, EDGES), "error": error}
    unit = axis[axis.index("(") :]
    layout = axes("slip", f"predicted − measured {unit}", height=340)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    set_axis_range(layout, "y", np.append(np.concatenate(medians), 0.0))
    layout["shapes"] = [upright(material.fit.slip_threshold)]
    return Figure(f"{key}-error", "Error of every model, driving, all runs", traces, layout), numbers


def upright(x: float) -> dict[str, Any]:
    """Return a vertical dotted line over the whole figure at one x, as plotly's shape."""
    place = {"type": "line", "xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1}
    return place | {"line": {"color": "#555", "width": 1.2, "dash": "dot"}}
