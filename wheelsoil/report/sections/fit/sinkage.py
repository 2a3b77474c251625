"""The sinkage each model predicts, beside the one that the forces ask for, and the measured one where there is one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from daq import DataError
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.curves import quantity_figure
from wheelsoil.report.figures import Trace, band, line, set_axis_range
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.notes import note_text
from wheelsoil.workflows.sinkage import (
    IN_THE_BAND,
    SinkageFacts,
    facts_of_runs,
    growth_rows,
    growth_sentence,
    sinkage_as_json,
)

KEY = "sinkage"
TITLE = "Sinkage"

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


def build(material: ReportInputs) -> Section:
    """Build the section."""
    measured = material.pool.sinkage_m
    blocks: list[Block] = []
    if not np.isfinite(measured).any():
        blocks.append(Text("The sinkage was not measured; what the models predict can be held against the rut."))
    figure, numbers = quantity_figure(material, "sinkage", "sinkage_m", 1e3 * measured, "sinkage (mm)", 1e3)
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
    return Section(KEY, TITLE, [Panels([figure], reading), *blocks], numbers)


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
