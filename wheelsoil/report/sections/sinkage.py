"""The sinkage of each model, of the forces and as measured; and the load that Eq. 7 gives for the model's sinkage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq import DataError, FloatArray
from model.fit import ModelFit
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, section
from wheelsoil.report.figures import (
    EDGES,
    GREY_BAND,
    MEASURED,
    Trace,
    axes,
    band,
    binned,
    dots,
    line,
    marked_line,
    set_axis_range,
    style,
    thinned_by_sign,
)
from wheelsoil.report.inputs import Pool, ReportInputs
from wheelsoil.report.words import number
from wheelsoil.wording.notes import note_text
from wheelsoil.workflows.sinkage import (
    IN_THE_BAND,
    SinkageFacts,
    facts_of_runs,
    growth_rows,
    growth_sentence,
    sinkage_as_json,
)

_AXIS = "sinkage (mm)"
_FROM_FORCES = "#8A6D00"
_FORCES_BAND = "rgba(230,159,0,0.22)"

_READING = (
    "total sinkage of the wheel against slip, median over all samples in bins of slip. The laws are fitted to forces "
    "only: their sinkage is a consequence, and the quickest thing to check in the field with a ruler in the rut."
)
_READING_FORCES = (
    " The yellow band is what load, drawbar pull and torque ask for by themselves, with no soil and no law. Where "
    "within it the sinkage lies depends on where the stress peaks under the wheel: at the bottom, as the models have "
    "it, or ahead, and further ahead with slip."
)


@section("sinkage", "Sinkage")
def sinkage(material: ReportInputs) -> Contents:
    """Build the section."""
    blocks: list[Block] = []
    if not np.isfinite(material.pool.sinkage_m).any():
        blocks.append(Text("The sinkage was not measured; what the models predict can be held against the rut."))
    figure, numbers = _predicted(material)
    reading = _READING
    try:
        facts = facts_of_runs(material.fitted, material.vehicle.wheel)
    except DataError as error:
        blocks.append(Text(f"No sinkage from forces: {error.faults[0].what}."))
    else:
        figure = _with_forces(figure, facts)
        numbers |= {"from_forces": sinkage_as_json(facts)}
        reading += _READING_FORCES
        blocks += _told(facts)
    return [Panels([figure], reading), *blocks], numbers


def _predicted(material: ReportInputs) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of each model's sinkage beside the measured one, and the numbers in it."""
    pool = material.pool
    measured = 1e3 * pool.sinkage_m
    data: list[Trace] = []
    numbers: dict[str, Any] = {"unit": _AXIS}
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
        curve = binned(pool.slip, 1e3 * pool.predicted(model.name, "sinkage_m"), EDGES)
        data.append(marked_line(curve.centre, curve.median, style(model.name).label, style(model.name)))
        numbers[model.name] = curve
        lines.append(curve.median[curve.centre > 0])
    layout = axes("slip", _AXIS, height=380)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    predicted = np.concatenate(lines)
    set_axis_range(layout, "y", driven if np.isfinite(driven).any() else predicted, also=predicted)
    return Figure("sinkage", _AXIS, data, layout), numbers


def _with_forces(figure: Figure, facts: SinkageFacts) -> Figure:
    """Return the figure with the sinkage from forces below everything else."""
    slip, low, high, stays, moves = np.array(
        [(one.slip, *one.sinkage_m.interval95, one.if_peak_stays_m, one.if_peak_moves_m) for one in facts.bins]
    ).T
    traces: list[Trace] = [
        *band(slip, 1e3 * low, 1e3 * high, "from forces, 95 %", _FORCES_BAND),
        line(slip, 1e3 * stays, "from forces, peak at the bottom", _FROM_FORCES, "solid", 2.5),
        line(slip, 1e3 * moves, "from forces, peak ahead", _FROM_FORCES, "longdashdot", 2.5),
    ]
    layout: dict[str, Any] = {**figure.layout, "yaxis": dict(figure.layout["yaxis"])}
    shown = layout["yaxis"].get("range", [np.nan, np.nan])
    set_axis_range(layout, "y", np.concatenate([1e3 * low, 1e3 * high, np.array(shown, float)]), margin=0.02)
    return replace(figure, data=[*traces, *figure.data], layout=layout)


def _told(facts: SinkageFacts) -> list[Block]:
    blocks: list[Block] = [
        Text(f"From forces: {growth_sentence(facts.growth)}."),
        Table(
            "Growth of sinkage from no slip to full slip",
            ["assumed", "mm", "95 % interval"],
            [[name, *map(_typeset, values)] for name, *values in growth_rows(facts.growth)],
            note="A peak that moves forward needs less sinkage for the same forces: growing sinkage and a moving peak "
            "look alike in forces. A ruler in the rut at low and high slip parts them.",
        ),
    ]
    if facts.inconsistent:
        blocks += [Text(f"Suspect {item.channel}: {note_text(item.why)}.", "warning") for item in facts.inconsistent]
    elif facts.checked:
        blocks.append(
            Text(f"Bound T/r − Dp ≤ W tan θ₁: kept in all {facts.checked} driven rows with measured sinkage.", "good")
        )
    return [*blocks, Text(f"{IN_THE_BAND[0].upper()}{IN_THE_BAND[1:]}.")]


def _typeset(text: str) -> str:
    """Return the terminal's numbers as this page writes them."""
    return text.replace("-", "−").replace("..", "…")


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


@section("load", "Load of the model's sinkage")
def load(material: ReportInputs) -> Contents:
    """Build the section: the ratio of the loads (literal), or the scale of the normal stress (balanced)."""
    fit, pool = material.fit, material.pool
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
