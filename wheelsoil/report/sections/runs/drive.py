"""How the test was driven: speeds, slip and load against time."""

from __future__ import annotations

import numpy as np

from daq import FloatArray
from processing import SLIP_ROLES, ProcessedRun
from wheelsoil.report.content import Figure, Panels, Section
from wheelsoil.report.figures import MEASURED, Trace, axes, decimated_rows, line, points_of_run
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.model_styles import STYLES

KEY = "drive"
TITLE = "How the test was driven"

_READING = (
    "if the rim is faster than the ground, the wheel drives and slips; if it is slower, it brakes. Slip has gaps "
    "at low speed and at excluded samples. A good test covers the range of slip several times."
)

_PANELS = (
    ("speed", "Speeds", "speed (m/s)"),
    ("slip", "Slip", "slip"),
    ("load", "Vertical load", "vertical load (N)"),
)


def build(material: ReportInputs) -> Section:
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
    return Section(KEY, TITLE, [Panels(figures, _READING, names)], numbers)


def _mean(values: FloatArray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _series(run: ProcessedRun, values: FloatArray, points: int, name: str, colour: str, dash: str = "solid") -> Trace:
    rows = decimated_rows(values, points)
    return line(run.time_s[rows], values[rows], name, colour, dash, 1.5)
