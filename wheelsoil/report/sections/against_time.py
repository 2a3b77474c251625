"""Drawbar pull and torque against time with each model (the paper's Fig. 4 and 5), and how the test was driven."""

from __future__ import annotations

import numpy as np

from daq import OUTPUTS, DataError, FloatArray
from processing import SLIP_ROLES, ProcessedRun, Segment
from processing.pipeline import runs_of
from wheelsoil.report.content import Contents, Figure, Panels, section
from wheelsoil.report.figures import (
    MEASURED,
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

_READING = (
    "black is measured, a coloured line what a model predicts from the measured slip and load; where they part, the "
    "model is wrong. The ground says what the vehicle did (plain: it coasted); gaps are excluded samples. "
    "The axis holds what was driven, which is what is fitted."
)
_READING_OF_ALL = (
    "what was measured, all of it: no model was fitted to these runs. The ground says what the vehicle did (plain: it "
    "coasted, or that is not known)."
)
_SEGMENTS = {
    Segment.DRIVE: ("driving", ("#dcebf7", "")),
    Segment.BRAKE: ("braking", ("#fbe5d3", "/")),
    Segment.STANDSTILL: ("standstill", ("#eeeeee", ".")),
}
_SHOWN = ("dp", "t")

_READING_DRIVE = (
    "if the rim is faster than the ground, the wheel drives and slips; if it is slower, it brakes. Slip has gaps "
    "at low speed and at excluded samples. A good test covers the range of slip several times."
)

_PANELS = (
    ("speed", "Speeds", "speed (m/s)"),
    ("slip", "Slip", "slip"),
    ("load", "Vertical load", "vertical load (N)"),
)


@section("time", "Drawbar pull and torque against time")
def forces(material: ReportInputs) -> Contents:
    """Build the section: a panel for each channel, a choice for each run.

    `DataError` if the drawbar pull was not measured, or no run has a sample that can be used.
    """
    if material.campaign is None:
        return _of_all(material)
    material.pool.measured("dp")
    runs = [run for run in material.runs if run.used.any()]
    if not runs:
        raise DataError("no run has a sample that can be used")
    figures = []
    for channel in _SHOWN:
        try:
            figures.append(_channel_figure(material, channel, runs))
        except DataError:
            continue  # the section on the torque says that it was not measured
    names = [run.run.id for run in runs]
    lengths = {run.run.id: float(run.time_s[-1]) for run in material.runs if len(run)}
    return [Panels(figures, _READING, names)], {"length_s": lengths}


def _of_all(material: ReportInputs) -> Contents:
    """Return the contents where there is no fit: what was measured, whether it could be used or not."""
    figures, names = [], []
    points = points_of_run(len(material.runs))
    for channel in _SHOWN:
        values = [getattr(run, OUTPUTS[channel].field) for run in material.runs]
        runs = [run for run, of in zip(material.runs, values, strict=True) if np.isfinite(of).any()]
        if not runs:
            continue
        everything = np.concatenate(values)
        low, high = float(np.nanmin(everything)), float(np.nanmax(everything))
        data: list[Trace] = []
        groups: list[str] = []
        for run in runs:
            measured = getattr(run, OUTPUTS[channel].field)
            rows = decimated_rows(measured, points)
            traces = [*_segments(run, low, high), line(run.time_s[rows], measured[rows], "measured", MEASURED)]
            data += traces
            groups += [run.run.id] * len(traces)
        layout = axes("time (s)", f"{OUTPUTS[channel].name} ({OUTPUTS[channel].unit_text})", height=360)
        set_axis_range(layout, "y", everything, margin=0.15)
        figures.append(Figure(f"time-{channel}", OUTPUTS[channel].name.capitalize(), data, layout, groups, wide=True))
        names += [run.run.id for run in runs]
    if not figures:
        raise DataError("neither drawbar pull nor driving torque was measured")
    lengths = {run.run.id: float(run.time_s[-1]) for run in material.runs if len(run)}
    return [Panels(figures, _READING_OF_ALL, list(dict.fromkeys(names)))], {"length_s": lengths}


def _channel_figure(material: ReportInputs, channel: str, runs: list[ProcessedRun]) -> Figure:
    name = OUTPUTS[channel].name
    values = material.pool.measured(channel)
    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    beyond = 0.3 * (high - low)
    data: list[Trace] = []
    groups: list[str] = []
    for run in runs:
        traces = [*_segments(run, low - beyond, high + beyond), *_lines(material, run, OUTPUTS[channel].field)]
        data += traces
        groups += [run.run.id] * len(traces)
    layout = axes("time (s)", f"{name} ({OUTPUTS[channel].unit_text})", height=360)
    driven = np.isfinite(values) & (material.pool.slip > 0)
    shown = driven if driven.any() else np.isfinite(values)
    said = [material.pool.predicted(model.name, OUTPUTS[channel].field)[shown] for model in material.fit.models]
    bulk = [np.nanpercentile(one, [1, 99]) for one in said if np.isfinite(one).any()]
    set_axis_range(layout, "y", values[shown], also=np.concatenate([*bulk, np.zeros(0)]), margin=0.15)
    return Figure(f"time-{channel}", name.capitalize(), data, layout, groups, wide=True)


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


def _lines(material: ReportInputs, run: ProcessedRun, quantity: str) -> list[Trace]:
    """Return what was measured and, of a fitted run, what every model says, at the same samples."""
    measured = _used(run, getattr(run, quantity))
    rows = decimated_rows(measured, points_of_run(len(material.runs)))
    time_s = run.time_s[rows]
    traces = [line(time_s, measured[rows], "measured", MEASURED, "solid", 2.6)]
    for name, prediction in material.predictions_of(run).items():
        look = style(name)
        predicted = _used(run, getattr(prediction, quantity))
        traces.append(line(time_s, predicted[rows], look.label, look.colour, look.dash, 1.6))
    return traces


def _used(run: ProcessedRun, values: FloatArray) -> FloatArray:
    return np.where(run.used, values, np.nan)


@section("drive", "How the test was driven")
def drive(material: ReportInputs) -> Contents:
    """Build the section: three panels, a choice for each run; a channel that no run has is omitted."""
    runs = material.runs
    blue, orange = STYLES["vasilev"].colour, STYLES["wong"].colour
    points = points_of_run(len(runs))
    drawn: dict[str, list[tuple[str, Trace]]] = {"speed": [], "slip": [], "load": []}
    for run in runs:
        missing = run.quality.missing
        series = (
            ("speed", "wheel_speed", run.wheel_speed_radps * run.wheel_radius_m, "rim", orange, "dash"),
            ("speed", "ground_speed", run.ground_speed_mps, "ground", MEASURED, "solid"),
            ("slip", "slip", np.where(run.used, run.slip, np.nan), "slip", blue, "solid"),
            ("load", "vertical_load", run.vertical_load_n, "load", MEASURED, "solid"),
        )
        lacking = {*missing, *(["slip"] if set(missing) & set(SLIP_ROLES) else [])}
        for panel, role, values, name, colour, dash in series:
            if role not in lacking:
                drawn[panel].append((run.run.id, _series(run, values, points, name, colour, dash)))
    if not any(np.isfinite(run.vertical_load_n).any() for run in runs):
        drawn["load"] = []
    names = [run.run.id for run in runs]
    figures = [
        Figure(
            f"drive-{panel}",
            title,
            [trace for _, trace in drawn[panel]],
            axes("time (s)", axis, height=280, showlegend=panel == "speed"),
            [name for name, _ in drawn[panel]],
        )
        for panel, title, axis in _PANELS
        if drawn[panel]
    ]
    numbers = {"mean_load_n": {run.run.id: _mean(run.vertical_load_n) for run in runs}}
    return [Panels(figures, _READING_DRIVE, names)], numbers


def _mean(values: FloatArray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _series(run: ProcessedRun, values: FloatArray, points: int, name: str, colour: str, dash: str = "solid") -> Trace:
    rows = decimated_rows(values, points)
    return line(run.time_s[rows], values[rows], name, colour, dash, 1.5)
