"""What is plotted against slip: drawbar pull and torque with every model's band and error, sinkage, and its load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq import OUTPUTS, DataError, FloatArray
from model.fit import ModelFit
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, grouped, section
from wheelsoil.report.figures import (
    ALL_RUNS,
    EDGES,
    GREY_BAND,
    MEASURED,
    RECOMMENDED,
    Binning,
    Bins,
    Trace,
    axes,
    band,
    binned,
    density,
    dots,
    line,
    marked_line,
    matched,
    set_axis_range,
    style,
    thinned_by_sign,
)
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import Pool
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import number
from wheelsoil.workflows.key_figures import Z95
from wheelsoil.workflows.sinkage import (
    IN_THE_BAND,
    SinkageFacts,
    agreement_sentence,
    facts_of_runs,
    growth_rows,
    growth_sentence,
    sinkage_as_json,
    unknown_sentence,
)

_READING_PULL = (
    "grey cells (and lone dots) are measured samples, darker where there are more; black is their median in bins of "
    "slip, the grey band their middle half. A model's line is its median over the same samples, its coloured band the "
    "95 % of its coefficients (none is fitted in Wong's). Where black leaves a band, that model is wrong. Braking is "
    "not fitted."
)
_ERRORS_PULL = (
    "measured − predicted of each model, medians in bins of slip: above zero it predicts too little. A flat line off "
    "zero is an offset; a slope is what the sinkage law misses. Only slips right of the dotted line count in the table."
)
_READING_TORQUE = (
    "as for the drawbar pull. A law that explains the drawbar pull by sinking must not spoil the torque: where the "
    "pull fits and the torque does not, the cause is not sinkage."
)
_ERRORS_TORQUE = (
    "measured − predicted, medians in bins of slip. Where the torque was not fitted, nothing has drawn these lines "
    "to zero: what lies near it was predicted."
)
_HALVES = (("driving", (0.0, 1.0)), ("braking", (-1.0, 0.0)))
_SINKAGE_AXIS = "sinkage (mm)"
_FROM_FORCES, _FORCES_BAND, _OPACITY = "#8A6D00", "#E69F00", 0.22

_READING_SINKAGE = (
    "total sinkage of the wheel against slip, median over all samples in bins of slip. The laws are fitted to forces "
    "only: their sinkage is a consequence, and the quickest thing to check in the field with a ruler in the rut."
)
_READING_FORCES = (
    " The yellow band is what load, drawbar pull and torque ask for by themselves, with no soil and no law. Where "
    "within it the sinkage lies depends on where the stress peaks under the wheel: at the bottom, as the models have "
    "it, or ahead, and further ahead with slip."
)


@section("slip", "Single-law fits: drawbar pull against slip")
def drawbar_pull(inputs: ReportInputs) -> Contents:
    """Build the section; `DataError` if the drawbar pull was not measured."""
    return _curves(inputs, "dp", "slip", "drawbar pull (N)", _READING_PULL, _ERRORS_PULL)


@section("torque", "Single-law fits: driving torque against slip")
def torque(inputs: ReportInputs) -> Contents:
    """Build the section: where the torque was not fitted, an independent check; `DataError` if it was not measured."""
    return _curves(inputs, "t", "torque", "driving torque (N m)", _READING_TORQUE, _ERRORS_TORQUE)


def _curves(inputs: ReportInputs, channel: str, key: str, axis: str, reading: str, of_errors: str) -> Contents:
    """Return driving and braking, with a choice among all runs and each, and the errors of every model."""
    pool = inputs.pool
    measured = pool.measured(channel)
    predicted = {model.name: pool.predicted(model.name, OUTPUTS[channel].field) for model in inputs.fit.models}
    predicted = {name: np.where(np.isfinite(measured), values, np.nan) for name, values in predicted.items()}
    sigmas = inputs.sigmas[channel]
    choices = {ALL_RUNS: np.ones(len(measured), np.bool_)}
    if len(inputs.fitted) > 1:
        choices |= {run.run.id: pool.run == i for i, run in enumerate(inputs.fitted) if run.used.any()}
    figures = []
    for half, ends in _HALVES:
        inside = (pool.slip > 0) if half == "driving" else (pool.slip <= 0)
        if not (inside & np.isfinite(measured)).any():
            continue
        shown: list[tuple[str, list[Trace]]] = []
        medians: list[FloatArray] = []
        for choice, chosen in choices.items():
            rows = chosen & inside
            bins = Binning(pool.slip[rows], EDGES)
            curves = {name: bins.of(values[rows]) for name, values in predicted.items()}
            medians += [curve.median for curve in curves.values()]
            traces = _of_measured(pool.slip[rows], measured[rows], bins, ends)
            for name, curve in curves.items():
                traces += _of_model(name, curve, bins.of(sigmas[name][rows], least=1))
            shown.append((choice, traces + _recommended(inputs, channel, choice, driving=half == "driving")))
        layout = axes("slip", axis, height=430)
        visible = ends if half == "driving" else (float(np.percentile(pool.slip[inside], 0.5)), 0.0)
        set_axis_range(layout, "x", np.array(visible), margin=0.02)
        set_axis_range(layout, "y", measured[inside], also=np.concatenate(medians))
        figures.append(grouped(f"{key}-{half}", half.capitalize(), shown, layout))
    errors, numbers = _errors(inputs, key, axis, measured, predicted)
    errors = replace(errors, data=[*errors.data, *_recommended(inputs, channel, of_errors=True)])
    lacking = f" Not included because a signal is missing: {inputs.not_fitted}." if inputs.not_fitted else ""
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
    drawn = marked_line(median.centre, median.median, model_style.label, model_style)
    half = Z95 * matched(median.centre, sigma)
    if not np.isfinite(half).any():
        return [drawn]
    edges = (median.median - half, median.median + half)
    return [*band(median.centre, *edges, model_style.label, model_style.colour, _OPACITY), drawn]


def _recommended(
    inputs: ReportInputs, channel: str, choice: str = ALL_RUNS, *, driving: bool = True, of_errors: bool = False
) -> list[Trace]:
    """Return the line of the recommended model, or of its errors, where a diagnosis recommends more than the base."""
    recommendation = inputs.recommendation
    if inputs.diagnosed is None or recommendation.is_base or channel not in recommendation.measured:
        return []
    rows = ((recommendation.slip > 0) == driving) & np.isfinite(recommendation.measured[channel])
    if choice != ALL_RUNS:
        rows &= recommendation.of_run(choice)
    values = recommendation.residual(channel) if of_errors else recommendation.recommended[channel]
    curve = binned(recommendation.slip[rows], values[rows], EDGES)
    drawn = line(curve.centre, curve.median, recommendation.title.lower(), RECOMMENDED, "solid", 3.0)
    return [drawn] if len(curve.centre) else []


def _errors(
    inputs: ReportInputs, key: str, axis: str, measured: FloatArray, predicted: dict[str, FloatArray]
) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of predicted - measured, and the numbers of the curves."""
    bins = Binning(inputs.pool.slip, EDGES)
    numbers: dict[str, Any] = {"measured": bins.of(measured)}
    traces: list[Trace] = []
    medians: list[FloatArray] = []
    for name, values in predicted.items():
        error = bins.of(measured - values)
        driven = error.centre > 0
        model_style = style(name)
        traces.append(marked_line(error.centre[driven], error.median[driven], model_style.label, model_style))
        medians.append(error.median[driven])
        numbers[name] = {"predicted": bins.of(values), "error": error}
    unit = axis[axis.index("(") :]
    layout = axes("slip", f"measured − predicted {unit}", height=340, dotted=[inputs.fit.slip_threshold])
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    set_axis_range(layout, "y", np.append(np.concatenate(medians), 0.0))
    return Figure(f"{key}-error", "Error of every model, driving, all runs", traces, layout), numbers


@section("sinkage", "Sinkage: from forces and by the single-law fits")
def sinkage(inputs: ReportInputs) -> Contents:
    """Build the section."""
    blocks: list[Block] = []
    if not np.isfinite(inputs.pool.sinkage_m).any():
        blocks.append(Text("The sinkage was not measured; what the models predict can be held against the rut."))
    figure, numbers = _predicted(inputs)
    reading = _READING_SINKAGE
    try:
        facts = facts_of_runs(inputs.fitted, inputs.vehicle.wheel)
    except DataError as error:
        blocks.append(Text(f"No sinkage from forces: {error.faults[0].what}."))
    else:
        figure = figure if facts.withdrawn else _with_forces(figure, facts)
        numbers |= {"from_forces": sinkage_as_json(facts)}
        reading += _READING_FORCES
        blocks += _sinkage_texts(facts)
    return [Panels([figure], reading), *blocks], numbers


def _predicted(inputs: ReportInputs) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of each model's sinkage beside the measured one, and the numbers in it."""
    pool = inputs.pool
    measured = 1e3 * pool.sinkage_m
    data: list[Trace] = []
    numbers: dict[str, Any] = {"unit": _SINKAGE_AXIS}
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
    for model in inputs.fit.models:
        curve = binned(pool.slip, 1e3 * pool.predicted(model.name, "sinkage_m"), EDGES)
        data.append(marked_line(curve.centre, curve.median, style(model.name).label, style(model.name)))
        numbers[model.name] = curve
        lines.append(curve.median[curve.centre > 0])
    layout = axes("slip", _SINKAGE_AXIS, height=380)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    predicted = np.concatenate(lines)
    set_axis_range(layout, "y", driven if np.isfinite(driven).any() else predicted, also=predicted)
    return Figure("sinkage", _SINKAGE_AXIS, data, layout), numbers


def _with_forces(figure: Figure, facts: SinkageFacts) -> Figure:
    """Return the figure with the sinkage from forces below everything else."""
    slip, low, high, stays, moves = np.array(
        [
            (slip_bin.slip, *slip_bin.sinkage_m.interval95, slip_bin.if_peak_stays_m, slip_bin.if_peak_moves_m)
            for slip_bin in facts.bins
        ]
    ).T
    traces: list[Trace] = [
        *band(slip, 1e3 * low, 1e3 * high, "from forces, 95 %", _FORCES_BAND, _OPACITY),
        line(slip, 1e3 * stays, "from forces, peak at the bottom", _FROM_FORCES, "solid", 2.5),
        line(slip, 1e3 * moves, "from forces, peak ahead", _FROM_FORCES, "longdashdot", 2.5),
    ]
    layout: dict[str, Any] = {**figure.layout, "yaxis": dict(figure.layout["yaxis"])}
    shown = layout["yaxis"].get("range", [np.nan, np.nan])
    set_axis_range(layout, "y", np.concatenate([1e3 * low, 1e3 * high, np.array(shown, float)]), margin=0.02)
    return replace(figure, data=[*traces, *figure.data], layout=layout)


def _sinkage_texts(facts: SinkageFacts) -> list[Block]:
    blocks: list[Block] = [
        Text(f"From forces: {growth_sentence(facts.growth)}."),
        Table(
            "Growth of sinkage from no slip to full slip",
            ["assumed", "mm", "95 % interval"],
            [
                [name, *(value.replace("-", "−").replace("..", "…") for value in values)]
                for name, *values in growth_rows(facts.growth)
            ],
            note="A peak that moves forward needs less sinkage for the same forces: growing sinkage and a moving peak "
            "look alike in forces. A ruler in the rut at low and high slip parts them.",
        ),
    ]
    if unknown := unknown_sentence(facts):
        blocks.append(Text(f"{unknown[0].upper()}{unknown[1:]}.", "warning" if facts.withdrawn else "text"))
    if facts.agreement is not None:
        kind = "warning" if facts.agreement.refuted else "text"
        blocks.append(Text(f"M{agreement_sentence(facts.agreement)[1:]}.", kind))
    if facts.inconsistent:
        blocks += [Text(f"Suspect {item.channel}: {note_text(item.why)}.", "warning") for item in facts.inconsistent]
    elif facts.checked:
        blocks.append(
            Text(f"Bound T/r − Dp ≤ W tan θ₁: kept in all {facts.checked} driven rows with measured sinkage.", "good")
        )
    return [*blocks, Text(f"{IN_THE_BAND[0].upper()}{IN_THE_BAND[1:]}.")]


@dataclass(frozen=True)
class _Quantity:
    """The plotted quantity in one interpretation of the slip-sinkage laws."""

    what: str
    intro: str
    reading: str
    values: Callable[[Pool, ModelFit], FloatArray]


_QUANTITIES = {
    "literal": _Quantity(
        "load of Eq. 7 / measured load",
        "As published (--sinkage literal): the sinkage of Eq. 11 or 12 enters Eq. 1 directly; stress is not scaled.",
        "a consistent model lies on 1. Above 1 the soil under the model's wheel would carry more than the measured "
        "load: the predicted sinkage is too deep for this soil, and the predicted drawbar pull depends on it.",
        lambda pool, model: pool.predicted(model.name, "vertical_load_n") / pool.vertical_load_n,
    ),
    "balanced": _Quantity(
        "scale of the normal stress",
        "Load-consistent (--sinkage balanced): the normal stress is scaled so that Eq. 7 returns the measured load.",
        "1 means that the model's sinkage is that of the laboratory's soil under this load; the further below 1, the "
        "weaker the law makes the soil to explain the drawbar pull.",
        lambda pool, model: pool.predicted(model.name, "stress_scale"),
    ),
}


@section("load", "Single-law fits: load of the model's sinkage")
def load(inputs: ReportInputs) -> Contents:
    """Build the section: the ratio of the loads (literal), or the scale of the normal stress (balanced)."""
    fit, pool = inputs.fit, inputs.pool
    quantity = _QUANTITIES[fit.options.reading]
    lines, medians, rows = [], [], []
    numbers: dict[str, Any] = {}
    for model in fit.models:
        values = quantity.values(pool, model)
        curve = binned(pool.slip, values, EDGES)
        lines.append(marked_line(curve.centre, curve.median, style(model.name).label, style(model.name)))
        medians.append(curve.median[curve.centre > 0])
        driven = values[(pool.slip > 0) & np.isfinite(values)]
        percentiles = np.percentile(driven, [5, 50, 95]) if len(driven) else np.full(3, np.nan)
        rows.append([style(model.name).label, *(number(value) for value in percentiles)])
        numbers[model.name] = {"load_ratio": model.load_ratio, "curve": curve, "percentiles_5_50_95": percentiles}
    layout = axes("slip", quantity.what, height=340)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    set_axis_range(layout, "y", np.concatenate(medians))
    blocks: list[Block] = [
        Text(quantity.intro),
        Panels([Figure("load", quantity.what.capitalize(), lines, layout)], quantity.reading),
        Table(f"{quantity.what.capitalize()} at slip > 0", ["model", "5 %", "median", "95 %"], rows),
    ]
    return blocks, {"reading": fit.options.reading, "quantity": quantity.what, "models": numbers}
