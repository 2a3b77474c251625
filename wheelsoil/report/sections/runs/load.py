"""Consistency of the load: the load that Eq. 7 gives for each model's sinkage, relative to the measured one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq import FloatArray
from model.fit import ModelFit
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import EDGES, axes, binned, marked_line, set_axis_range
from wheelsoil.report.inputs import Pool, ReportInputs
from wheelsoil.report.words import number
from wheelsoil.wording.model_styles import style

KEY = "load"
TITLE = "Load of the model's sinkage"


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


def build(material: ReportInputs) -> Section:
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
    return Section(KEY, TITLE, blocks, {"reading": fit.options.reading, "quantity": quantity.what, "models": numbers})
