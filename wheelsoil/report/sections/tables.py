"""Single-wheel tables: how far to trust their verdict, their rows beside the models, and their sinkage from forces."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq import OUTPUTS, DataError, FloatArray, number
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, section
from wheelsoil.report.figures import MEASURED, Trace, axes, by_load, marked_line, points, set_axis_range, style
from wheelsoil.report.figures import numbers as plotted
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.grounds_text import adequacy_words, form_error_words
from wheelsoil.wording.names import page_unit
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.verdict import sentence_of
from wheelsoil.workflows.sinkage import (
    agreement_sentence,
    growth_sentence,
    sinkage_as_json,
    sinkage_of_table,
    unknown_sentence,
)
from wheelsoil.workflows.tables import BenchFiles

_READING = (
    "dots are the rows of the table. A model's line joins what it says of these rows at one load; only driven rows "
    "(slip > 0) were fitted."
)


@section("verdict", "How far to trust it")
def verdict(inputs: ReportInputs) -> Contents:
    """Build the section: the error of form, what it decides, and whether an explanation is adequate."""
    found = inputs.diagnosed
    if found is None:
        text = f"No diagnosis: {inputs.no_diagnosis or 'none was asked for'}."
        return [Text(text)], {"sentence": text}
    sentences = form_error_words(found.grounds.form_errors)
    blocks: list[Block] = [Text(text) for text in sentences]
    if found.grounds.form_matters is not None:
        blocks.append(Text(f"The verdict depends on it: {note_text(found.grounds.form_matters)}.", "warning"))
    if found.adequacy is not None:
        kind = "good" if found.adequacy.ok else "warning"
        grade = "adequate" if found.adequacy.ok else "not adequate"
        blocks.append(Text(f"The best explanation is {grade}: {adequacy_words(found.adequacy)}.", kind))
    blocks += [Text(f"Inconsistent: {note_text(item.why)}.", "warning") for item in found.inconsistent]
    blocks += [Text(f"{note_text(note)}.", "warning") for note in found.grounds.cautions]
    return blocks, {"sentence": sentence_of(found), "verdict": found.verdict}


@section("rows", "Rows of the tables")
def rows(inputs: ReportInputs) -> Contents:
    """Build the section: every channel against slip, of every wheel, with the fitted models of an only one."""
    blocks: list[Block] = []
    numbers: dict[str, Any] = {}
    for i, wheel_test in enumerate(inputs.tables):
        predicted = _predicted(inputs) if len(inputs.tables) == 1 else {}
        channels = [c for c, channel in OUTPUTS.items() if np.isfinite(getattr(wheel_test.rows, channel.field)).any()]
        figures = [_figure(wheel_test, channel, predicted, f"rows-{i}-{channel}") for channel in channels]
        blocks += [Text(wheel_test.name), Panels(figures, _READING), _table(wheel_test, channels)]
        numbers[wheel_test.name] = {
            "slip": wheel_test.rows.slip,
            "vertical_load_n": wheel_test.rows.vertical_load_n,
            **{OUTPUTS[c].field: getattr(wheel_test.rows, OUTPUTS[c].field) for c in channels},
            "predicted": predicted,
        }
    none = [Text(f"No fit of the four models: {inputs.no_fit}.")]
    blocks += none if inputs.no_fit else [Text(f"{note_text(n)}.", "warning") for n in inputs.fit.notes]
    return blocks, numbers


def _predicted(inputs: ReportInputs) -> dict[str, dict[str, FloatArray]]:
    """Return what every fitted model says of the rows of the only table: model -> channel -> values."""
    if inputs.campaign is None:
        return {}
    fit = inputs.campaign
    found = {}
    for model in fit.models:
        forward = fit.options.forward(fit.wheel, fit.soil, model.name)
        prediction = forward.predict(fit.observations.conditions, model.values)
        found[model.name] = {c: getattr(prediction, channel.field) for c, channel in OUTPUTS.items()}
    return found


def _figure(wheel_test: BenchFiles, channel: str, predictions: dict[str, dict[str, FloatArray]], key: str) -> Figure:
    factor, unit = page_unit(channel)
    measured, slip = factor * getattr(wheel_test.rows, OUTPUTS[channel].field), np.append(wheel_test.rows.slip, np.nan)
    loads = [np.flatnonzero(rows) for _, rows in by_load(wheel_test.rows.vertical_load_n)]
    # of each load after the other, with a gap between them
    order = np.concatenate([np.append(rows[np.argsort(slip[rows])], -1) for rows in loads])[:-1]
    data: list[Trace] = [
        marked_line(slip[order], factor * np.append(values[channel], np.nan)[order], style(name).label, style(name))
        for name, values in predictions.items()
    ]
    data.append(points(plotted(wheel_test.rows.slip, 4), plotted(measured, 4), "measured", (MEASURED, "circle"), 7.0))
    title = f"{OUTPUTS[channel].name} ({unit})"
    layout = axes("slip", title, height=360)
    set_axis_range(layout, "x", wheel_test.rows.slip)
    predicted = [factor * values[channel] for values in predictions.values()]
    set_axis_range(layout, "y", measured, also=np.concatenate(predicted) if predicted else measured)
    return Figure(key, title, data, layout)


def _table(wheel_test: BenchFiles, channels: list[str]) -> Table:
    head = ["slip", "load (N)", *(f"{OUTPUTS[c].name} ({OUTPUTS[c].unit_text})" for c in channels)]
    columns = [
        wheel_test.rows.slip,
        wheel_test.rows.vertical_load_n,
        *(getattr(wheel_test.rows, OUTPUTS[c].field) for c in channels),
    ]
    cells = [[number(x, 4) if np.isfinite(x) else "–" for x in row] for row in np.array(columns).T]
    return Table(f"Rows: {wheel_test.name}", head, cells, left=0)


@section("sinkage", "Sinkage from forces")
def sinkage(inputs: ReportInputs) -> Contents:
    """Build the section; `DataError` if no table holds a torque."""
    blocks: list[Block] = []
    numbers: dict[str, Any] = {}
    why: list[str] = []
    for wheel_test in inputs.tables:
        try:
            facts = sinkage_of_table(wheel_test.rows, wheel_test.wheel_section)
        except DataError as error:
            why.append(f"{wheel_test.name}: {error.faults[0].what}")
            continue
        sentences = [f"{wheel_test.name}: {growth_sentence(facts.growth)}."]
        if facts.agreement is not None:
            sentences.append(f"{agreement_sentence(facts.agreement)}.")
        if unknown := unknown_sentence(facts):
            sentences.append(f"{unknown[0].upper()}{unknown[1:]}.")
        blocks.append(Text(" ".join(sentences), "warning" if facts.withdrawn else "text"))
        numbers[wheel_test.name] = sinkage_as_json(facts)
    if not blocks:
        raise DataError("; ".join(why))
    return [*blocks, *(Text(f"Not evaluated: {text}.") for text in why)], numbers
