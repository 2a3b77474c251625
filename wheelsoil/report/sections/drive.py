"""How the test was driven: speeds, slip and load against time."""

from __future__ import annotations

import numpy as np

from processing.processed_run import ProcessedRun
from wheelsoil.report.content import Figure, Panels, Section
from wheelsoil.model_styles import STYLES
from wheelsoil.report.figures import MEASURED, Trace, axes, line
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.thinning import decimated_rows, points_of_run

KEY = "drive"
TITLE = "How the test was driven"

_READING = (
    "where the rim is faster than the ground the wheel drives and slips, where it is slower it brakes; slip has gaps "
    "where it was too slow or a sample could not be used. A good test sweeps the slip several times."
)


def build(material: Material) -> Section:
    """Build the section: three panels, a choice for each run."""
    runs = material.runs
    blue, orange = STYLES["vasilev"].colour, STYLES["wong"].colour
    speeds: list[Trace] = []
    slips: list[Trace] = []
    loads: list[Trace] = []
    points = points_of_run(len(runs))
    for run in runs:
        speeds += [
            _series(run, run.wheel_speed_radps * run.wheel_radius_m, points, "rim", orange, "dash"),
            _series(run, run.ground_speed_mps, points, "ground", MEASURED),
        ]
        slips.append(_series(run, np.where(run.used, run.slip, np.nan), points, "slip", blue))
        loads.append(_series(run, run.vertical_load_n, points, "load", MEASURED))
    names = [run.run.id for run in runs]
    figures = [
        Figure(
            "drive-speed",
            "Speeds",
            speeds,
            axes("time (s)", "speed (m/s)", height=280),
            [n for n in names for _ in (0, 1)],
        ),
        Figure("drive-slip", "Slip", slips, axes("time (s)", "slip", height=280, showlegend=False), names),
    ]
    if any(np.isfinite(run.vertical_load_n).any() for run in runs):
        layout = axes("time (s)", "vertical load (N)", height=280, showlegend=False)
        figures.append(Figure("drive-load", "Vertical load", loads, layout, names))
    numbers = {"mean_load_n": {run.run.id: _mean(run.vertical_load_n) for run in runs}}
    return Section(KEY, TITLE, [Panels(figures, _READING, names)], numbers)


def _mean(values: FloatArray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _series(run: ProcessedRun, values: FloatArray, points: int, name: str, colour: str, dash: str = "solid") -> Trace:
    rows = decimated_rows(values, points)
    return line(run.time_s[rows], values[rows], name, colour, dash, 1.5)
