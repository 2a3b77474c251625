"""Drawbar pull and driving torque against slip: measured with its density, every model with its band and its error."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq import OUTPUTS, FloatArray
from wheelsoil.report.content import Contents, Figure, Panels, section
from wheelsoil.report.figures import (
    ALL_RUNS,
    EDGES,
    GREY_BAND,
    MEASURED,
    Binning,
    Bins,
    Trace,
    axes,
    band,
    density,
    dotted_line,
    line,
    marked_line,
    set_axis_range,
    style,
    translucent,
)
from wheelsoil.report.inputs import ReportInputs

_READING_PULL = (
    "grey cells (and lone dots) are measured samples, darker where there are more; black is their median in bins of "
    "slip, the grey band their middle half. A model's line is its median over the same samples, its coloured band the "
    "95 % of its coefficients (none is fitted in Wong's). Where black leaves a band, that model is wrong. Braking is "
    "not fitted."
)
_ERRORS_PULL = (
    "how far each model's median lies above (+) or below (−) the measured one at each slip. A flat line off zero is an "
    "offset; a slope is what the sinkage law misses. Only slips right of the dotted line count in the table."
)
_READING_TORQUE = (
    "as for the drawbar pull. A law that explains the drawbar pull by sinking must not spoil the torque: where the "
    "pull fits and the torque does not, the cause is not sinkage."
)
_ERRORS_TORQUE = (
    "predicted less measured, medians in bins of slip. Where the torque was not fitted, nothing has drawn these lines "
    "to zero: what lies near it was predicted."
)
_SIGMAS = 1.959964
"""Half width of a 95 % interval in sigmas."""
_HALVES = (("driving", (0.0, 1.0)), ("braking", (-1.0, 0.0)))


@section("slip", "Drawbar pull against slip")
def drawbar_pull(material: ReportInputs) -> Contents:
    """Build the section; `DataError` if the drawbar pull was not measured."""
    return _curves(material, "dp", "slip", "drawbar pull (N)", _READING_PULL, _ERRORS_PULL)


@section("torque", "Driving torque against slip")
def torque(material: ReportInputs) -> Contents:
    """Build the section: where the torque was not fitted, an independent check; `DataError` if it was not measured."""
    return _curves(material, "t", "torque", "driving torque (N m)", _READING_TORQUE, _ERRORS_TORQUE)


def _curves(material: ReportInputs, channel: str, key: str, axis: str, reading: str, of_errors: str) -> Contents:
    """Return driving and braking, with a choice among all runs and each, and the errors of every model."""
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
        medians: list[FloatArray] = []
        for choice, chosen in choices.items():
            rows = chosen & inside
            bins = Binning(pool.slip[rows], EDGES)
            curves = {name: bins.of(values[rows]) for name, values in predicted.items()}
            medians += [curve.median for curve in curves.values()]
            traces = _of_measured(pool.slip[rows], measured[rows], bins, ends)
            for name, curve in curves.items():
                traces += _of_model(name, curve, bins.of(sigmas[name][rows], least=1))
            data += traces
            groups += [choice] * len(traces)
        layout = axes("slip", axis, height=430)
        visible = ends if half == "driving" else (float(np.percentile(pool.slip[inside], 0.5)), 0.0)
        set_axis_range(layout, "x", np.array(visible), margin=0.02)
        set_axis_range(layout, "y", measured[inside], also=np.concatenate(medians))
        figures.append(Figure(f"{key}-{half}", half.capitalize(), data, layout, groups))
    errors, numbers = _errors(material, key, axis, measured, predicted)
    lacking = f" Not included because a signal is missing: {material.not_fitted}." if material.not_fitted else ""
    return [Panels(figures, f"{reading}{lacking}", list(choices)), Panels([errors], of_errors)], numbers


def _of_measured(slip: FloatArray, measured: FloatArray, bins: Binning, ends: tuple[float, float]) -> list[Trace]:
    """Return the traces of what one choice of runs measured."""
    curve = bins.of(measured)
    return [
        *density(slip, measured, ends, "samples"),
        *band(curve.centre, curve.lower, curve.upper, "middle half", GREY_BAND),
        line(curve.centre, curve.median, "measured", MEASURED, "solid", 2.4),
    ]


def _of_model(name: str, median: Bins, sigma: Bins) -> list[Trace]:
    """Return a model's median in bins of slip, and the 95 % band of its coefficients if known."""
    model_style = style(name)
    drawn = marked_line(median.centre, median.median, model_style.label, model_style) | {"legendgroup": name}
    known = dict(zip(sigma.centre.tolist(), sigma.median.tolist(), strict=True))
    half = _SIGMAS * np.array([known.get(centre, np.nan) for centre in median.centre.tolist()])
    if not np.isfinite(half).any():
        return [drawn]
    edges = band(
        median.centre, median.median - half, median.median + half, model_style.label, translucent(model_style.colour)
    )
    hidden = [trace | {"showlegend": False, "legendgroup": name} for trace in edges]
    return [*hidden, drawn]


def _errors(
    material: ReportInputs, key: str, axis: str, measured: FloatArray, predicted: dict[str, FloatArray]
) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of predicted - measured, and the numbers of the curves."""
    bins = Binning(material.pool.slip, EDGES)
    numbers: dict[str, Any] = {"measured": bins.of(measured)}
    traces: list[Trace] = []
    medians: list[FloatArray] = []
    for name, values in predicted.items():
        error = bins.of(values - measured)
        driven = error.centre > 0
        model_style = style(name)
        traces.append(marked_line(error.centre[driven], error.median[driven], model_style.label, model_style))
        medians.append(error.median[driven])
        numbers[name] = {"predicted": bins.of(values), "error": error}
    unit = axis[axis.index("(") :]
    layout = axes("slip", f"predicted − measured {unit}", height=340)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    set_axis_range(layout, "y", np.append(np.concatenate(medians), 0.0))
    layout["shapes"] = [dotted_line(material.fit.slip_threshold)]
    return Figure(f"{key}-error", "Error of every model, driving, all runs", traces, layout), numbers
