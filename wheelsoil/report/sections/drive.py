"""How the test was driven: speeds, slip and load against time."""

from __future__ import annotations

import numpy as np

from processing.processed_run import ProcessedRun
from wheelsoil.report.content import Figure, Panels, Section
from wheelsoil.report.figures import MEASURED, STYLES, Trace, axes, line
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.thinning import decimated_rows

KEY = "drive"
TITLE = "How the test was driven"

_POINTS = 600
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
    for run in runs:
        speeds += [
            _series(run, run.wheel_speed_radps * run.wheel_radius_m, "rim", orange, "dash"),
            _series(run, run.ground_speed_mps, "ground", MEASURED),
        ]
        slips.append(_series(run, np.where(run.used, run.slip, np.nan), "slip", blue))
        loads.append(_series(run, run.vertical_load_n, "load", MEASURED))
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
    numbers = {
        figure.key: [
            {"run": group, "name": t["name"], "time_s": t["x"], "values": t["y"]}
            for group, t in zip(figure.groups, figure.data, strict=True)
        ]
        for figure in figures
    }
    return Section(KEY, TITLE, [Panels(figures, _READING, names)], numbers)


def _series(run: ProcessedRun, values: FloatArray, name: str, colour: str, dash: str = "solid") -> Trace:
    rows = decimated_rows(values, _POINTS)
    return line(run.time_s[rows], values[rows], name, colour, dash, 1.5)
