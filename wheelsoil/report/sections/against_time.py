"""Drawbar pull and torque against time with each model (the paper's Fig. 4 and 5), and how the test was driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq import OUTPUTS, DataError, FloatArray
from daq.recording import Event
from processing import SLIP_ROLES, ProcessedRun, Segment
from processing.pipeline import runs_of
from wheelsoil.report.content import Block, Contents, Figure, Panels, Text, grouped, section
from wheelsoil.report.figures import (
    MEASURED,
    RECOMMENDED,
    STYLES,
    Trace,
    axes,
    decimated_rows,
    line,
    points_of_run,
    set_axis_range,
    shades,
    style,
)
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.track import places

_CAPTION = (
    "black is measured, a coloured line what a model predicts from the measured slip and load; where they differ, the "
    "model is wrong. The background shows what the vehicle did (plain: it coasted); gaps are excluded samples. "
    "The axis covers the driven samples, which are the fitted ones."
)
_CAPTION_WITHOUT_FIT = (
    "all that was measured: no model was fitted to these runs. The background shows what the vehicle did (plain: it "
    "coasted, or that is not known)."
)
_SEGMENTS = {
    Segment.DRIVE: ("driving", ("#dcebf7", "")),
    Segment.BRAKE: ("braking", ("#fbe5d3", "/")),
    Segment.STANDSTILL: ("standstill", ("#eeeeee", ".")),
}
_SHOWN = ("dp", "t")
_GAP_S = 0.5

_CAPTION_DRIVE = (
    "If the rim is faster than the ground, the wheel drives and slips; if it is slower, it brakes. Slip has gaps "
    "at low speed and at excluded samples. A good test covers the range of slip several times."
)

_PANELS = (("slip", "Slip", "slip"), ("speed", "Speeds", "speed (m/s)"), ("load", "Vertical load", "vertical load (N)"))


@section("time", "Time histories")
def time(inputs: ReportInputs) -> Contents:
    """Build the section: a panel for each channel on one time axis, a choice for each run.

    Where no force was measured, a text says so; without a fit only the measured forces are shown.
    """
    blocks: list[Block] = []
    figures: list[Figure] = []
    caption = _CAPTION
    try:
        figures, caption = _forces(inputs)
    except DataError as error:
        blocks = [Text(f"No forces: {error.what}.", "missing")]
    figures = [_with_marks(figure, inputs) for figure in (*_drive(inputs.runs), *figures)]
    named = {group for figure in figures for group in figure.groups}
    names = [run.run.id for run in inputs.runs if run.run.id in named]
    lengths = {run.run.id: float(run.time_s[-1]) for run in inputs.runs if len(run)}
    loads = {run.run.id: _mean(run.vertical_load_n) for run in inputs.runs}
    panels = Panels(figures, f"{caption} {_CAPTION_DRIVE}", names, linked=True, places=places(inputs.runs))
    return [*blocks, panels], {"length_s": lengths, "mean_load_n": loads}


def _forces(inputs: ReportInputs) -> tuple[list[Figure], str]:
    """Return a figure of each force, and how to read them; `DataError` where none can be shown."""
    if inputs.campaign is None:
        return _of_all(inputs), _CAPTION_WITHOUT_FIT
    inputs.pool.measured("dp")
    runs = [run for run in inputs.runs if run.used.any()]
    if not runs:
        raise DataError("no run has a sample that can be used")
    figures = []
    for channel in _SHOWN:
        try:
            figures.append(_channel_figure(inputs, channel, runs))
        except DataError:
            continue  # a channel that was not measured
    return figures, _CAPTION


def _with_marks(figure: Figure, inputs: ReportInputs) -> Figure:
    """Return a figure with the marks that were set in the field, as flags over its whole height."""
    data, groups = list(figure.data), list(figure.groups)
    for run in inputs.runs:
        source = inputs.source_of(run)
        marks = [event for event in (source.events if source else ()) if event.name == "mark"]
        if marks and run.run.id in groups:
            data.append(_flags(run, marks))
            groups.append(run.run.id)
    return replace(figure, data=data, groups=groups) if len(data) > len(figure.data) else figure


def _flags(run: ProcessedRun, marks: Sequence[Event]) -> Trace:
    """Return a vertical line with its text at each mark."""
    times_s = [round(1e-9 * (event.time_ns - run.start_ns), 3) for event in marks]
    x = [value for time_s in times_s for value in (time_s, time_s, None)]
    place = {"x": x, "y": [0.0, 1.0, None] * len(times_s)}
    return {"kind": "flags", "name": "marks", **place, "texts": [event.text for event in marks]}


def _of_all(inputs: ReportInputs) -> list[Figure]:
    """Return the figures without a fit: all measured samples, excluded ones too."""
    figures = []
    points = points_of_run(len(inputs.runs))
    for channel in _SHOWN:
        values = [getattr(run, OUTPUTS[channel].field) for run in inputs.runs]
        runs = [run for run, measured in zip(inputs.runs, values, strict=True) if np.isfinite(measured).any()]
        if not runs:
            continue
        everything = np.concatenate(values)
        low, high = float(np.nanmin(everything)), float(np.nanmax(everything))
        shown = []
        for run in runs:
            measured = getattr(run, OUTPUTS[channel].field)
            rows = decimated_rows(measured, points)
            measured_line = line(run.time_s[rows], measured[rows], "measured", MEASURED)
            shown.append((run.run.id, [*_segments(run, low, high), measured_line]))
        layout = axes("time (s)", f"{OUTPUTS[channel].name} ({OUTPUTS[channel].unit_text})", height=360)
        set_axis_range(layout, "y", everything, margin=0.15)
        figures.append(grouped(f"time-{channel}", OUTPUTS[channel].name.capitalize(), shown, layout, wide=True))
    if not figures:
        raise DataError("neither drawbar pull nor driving torque was measured")
    return figures


def _channel_figure(inputs: ReportInputs, channel: str, runs: list[ProcessedRun]) -> Figure:
    name = OUTPUTS[channel].name
    values = inputs.pool.measured(channel)
    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    beyond = 0.3 * (high - low)
    traces = [
        (run.run.id, [*_segments(run, low - beyond, high + beyond), *_lines(inputs, run, OUTPUTS[channel].field)])
        for run in runs
    ]
    layout = axes("time (s)", f"{name} ({OUTPUTS[channel].unit_text})", height=360)
    driven = np.isfinite(values) & (inputs.pool.slip > 0)
    shown = driven if driven.any() else np.isfinite(values)
    predictions = [inputs.pool.predicted(model.name, OUTPUTS[channel].field)[shown] for model in inputs.fit.models]
    bulk = [np.nanpercentile(prediction, [1, 99]) for prediction in predictions if np.isfinite(prediction).any()]
    set_axis_range(layout, "y", values[shown], also=np.concatenate([*bulk, np.zeros(0)]), margin=0.15)
    return grouped(f"time-{channel}", name.capitalize(), traces, layout, wide=True)


def _segments(run: ProcessedRun, low: float, high: float) -> list[Trace]:
    """Return a run's segments as stripes behind everything else."""
    step = 1.0 / run.rate_hz
    pieces = [(int(run.segment[a]), run.time_s[a], run.time_s[b - 1] + step) for a, b in runs_of(run.segment).tolist()]
    traces = []
    for kind, (name, look) in _SEGMENTS.items():
        spans = [(float(start), float(end)) for which, start, end in pieces if which == kind]
        if spans:
            traces.append(shades(spans, round(low), round(high), name, look))
    return traces


def _lines(inputs: ReportInputs, run: ProcessedRun, quantity: str) -> list[Trace]:
    """Return the measured values of a run and, if it was fitted, those of every model at the same samples."""
    measured = _used(run, getattr(run, quantity))
    rows = decimated_rows(measured, points_of_run(len(inputs.runs)))
    time_s = run.time_s[rows]
    traces = [line(time_s, measured[rows], "measured", MEASURED, "solid", 2.6)]
    for name, prediction in inputs.predictions_of(run).items():
        look = style(name)
        predicted = _used(run, getattr(prediction, quantity))
        traces.append(line(time_s, predicted[rows], look.label, look.colour, look.dash, 1.6))
    return [*traces, *_recommended(inputs, run, quantity)]


def _recommended(inputs: ReportInputs, run: ProcessedRun, quantity: str) -> list[Trace]:
    """Return what the recommended model predicts for a run, where a diagnosis recommends more than calibrated soil."""
    if inputs.diagnosed is None or (recommendation := inputs.recommendation).is_base:
        return []
    channel = next((c for c in recommendation.recommended if OUTPUTS[c].field == quantity), "")
    rows = np.flatnonzero(recommendation.of_run(run.run.id))
    if not channel or not len(rows):
        return []
    rows = rows[np.argsort(recommendation.time_s[rows], kind="stable")]
    gaps = np.flatnonzero(np.diff(recommendation.time_s[rows]) > _GAP_S) + 1
    time_s, values = (
        np.insert(x[rows], gaps, np.nan) for x in (recommendation.time_s, recommendation.recommended[channel])
    )
    return [line(time_s, values, recommendation.title.lower(), RECOMMENDED, "solid", 2.2)]


def _used(run: ProcessedRun, values: FloatArray) -> FloatArray:
    return np.where(run.used, values, np.nan)


def _drive(runs: tuple[ProcessedRun, ...]) -> list[Figure]:
    """Return how the test was driven: slip, speeds, load; a channel that no run has is omitted."""
    blue, orange = RECOMMENDED, STYLES["wong"].colour
    points = points_of_run(len(runs))
    drawn: dict[str, list[tuple[str, list[Trace]]]] = {"speed": [], "slip": [], "load": []}
    for run in runs:
        missing = run.quality.missing
        series = (
            ("speed", "wheel_speed", run.rim_speed_mps, "rim", orange, "dash"),
            ("speed", "ground_speed", run.ground_speed_mps, "ground", MEASURED, "solid"),
            ("slip", "slip", np.where(run.used, run.slip, np.nan), "slip", blue, "solid"),
            ("load", "vertical_load", run.vertical_load_n, "load", MEASURED, "solid"),
        )
        lacking = {*missing, *(["slip"] if set(missing) & set(SLIP_ROLES) else [])}
        for panel, role, values, name, colour, dash in series:
            if role not in lacking:
                rows = decimated_rows(values, points)
                drawn[panel].append((run.run.id, [line(run.time_s[rows], values[rows], name, colour, dash, 1.5)]))
    if not any(np.isfinite(run.vertical_load_n).any() for run in runs):
        drawn["load"] = []
    return [
        grouped(f"drive-{panel}", title, drawn[panel], axes("time (s)", axis, height=240), wide=True)
        for panel, title, axis in _PANELS
        if drawn[panel]
    ]


def _mean(values: FloatArray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")
