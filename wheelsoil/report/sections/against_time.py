"""Drawbar pull against time with each model: the paper's Fig. 4 and 5."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq.errors import DataError
from model.fit_result import ModelFit
from model.observations import CHANNELS
from processing.processed_run import ProcessedRun
from wheelsoil.report.content import Figure, Panels, Section
from wheelsoil.report.figures import MEASURED, Trace, axes, line, look_at, style
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.thinning import decimated_rows

KEY = "time"
TITLE = "Drawbar pull against time"

_POINTS = 700
_READING = (
    "black is measured, the broken coloured line is what the model predicts from the measured slip and load; where "
    "they part, the model is wrong. Gaps are samples that could not be used. The axis holds what was driven "
    "(slip > 0), which is what is fitted; double-click shows braking, too."
)


def build(material: Material) -> Section:
    """Build the section: a panel for each model, a choice for each run.

    Raises
    ------
    DataError
        The drawbar pull was not measured.
    """
    material.pool.measured("dp")
    runs = [(i, run) for i, run in enumerate(material.runs) if run.used.any()]
    if not runs:
        raise DataError("no run has a sample that can be used")
    choices = [run.run.id for _, run in runs]
    figures = []
    shown: dict[str, dict[str, Any]] = {}
    for model in material.fit.models:
        data: list[Trace] = []
        for i, run in runs:
            traces, numbers = _traces(run, model, i)
            data += traces
            shown.setdefault(run.run.id, {"measured": numbers["measured"]})[model.name] = numbers["predicted"]
        layout = axes("time (s)", "drawbar pull (N)", height=330)
        look_at(layout, "y", material.pool.measured("dp")[material.pool.slip > 0], margin=0.25)
        groups = [run.run.id for _, run in runs for _ in range(2)]
        figures.append(Figure(f"time-{model.name}", f"{style(model.name).label}'s model", data, layout, groups))
    return Section(KEY, TITLE, [Panels(figures, _READING, choices)], shown)


def _traces(
    run: ProcessedRun, model: ModelFit, index: int
) -> tuple[list[Trace], dict[str, dict[str, list[float | None]]]]:
    look = style(model.name)
    measured = np.where(run.used, run.drawbar_pull_n, np.nan)
    predicted = np.where(run.used, getattr(model.predictions[index], CHANNELS["dp"]), np.nan)
    traces = [
        _series(run.time_s, measured, "measured", MEASURED, "solid", 1.3),
        _series(run.time_s, predicted, look.label, look.colour, "dash", 2.0),
    ]
    numbers = {
        name: {"time_s": t["x"], "drawbar_pull_n": t["y"]}
        for name, t in zip(("measured", "predicted"), traces, strict=True)
    }
    return traces, numbers


def _series(time_s: FloatArray, values: FloatArray, name: str, colour: str, dash: str, width: float) -> Trace:
    rows = decimated_rows(values, _POINTS)
    return line(time_s[rows], values[rows], name, colour, dash, width)
