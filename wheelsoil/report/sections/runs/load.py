"""The load that Eq. 7 gives for each model's sinkage, over the measured one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from model.fit import ModelFit
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import EDGES, axes, binned, look_at, marked_line
from wheelsoil.report.inputs import FloatArray, Material, Pool
from wheelsoil.report.words import number
from wheelsoil.wording.model_styles import style

KEY = "load"
TITLE = "Load of the model's sinkage"


@dataclass(frozen=True)
class _View:
    """What is worth seeing in one reading of the laws."""

    what: str
    intro: str
    reading: str
    values: Callable[[Pool, ModelFit], FloatArray]


_VIEWS = {
    "literal": _View(
        "load of Eq. 7 / measured load",
        "Literal reading: the sinkage of Eq. 11 or 12 goes into Eq. 1 as it is, and the stresses stay as they are.",
        "a model that is consistent lies on 1. Above 1 the soil under the model's wheel would carry more than the "
        "wheel weighs: the predicted sinkage is too deep for this soil, and the drawbar pull is bought with it.",
        lambda pool, model: pool.predicted(model.name, "vertical_load_n") / pool.vertical_load_n,
    ),
    "balanced": _View(
        "scale of the normal stress",
        "Balanced reading: the normal stress is scaled so that Eq. 7 returns the measured load.",
        "1 means that the model's sinkage is what the laboratory's soil gives under this load; the further below 1, "
        "the more the law must weaken the soil to explain the drawbar pull.",
        lambda pool, model: pool.predicted(model.name, "stress_scale"),
    ),
}


def build(material: Material) -> Section:
    """Build the section: the ratio of the loads in the literal reading, the stress scale in the balanced one."""
    fit, pool = material.fit, material.pool
    view = _VIEWS[fit.options.reading]
    lines, seen, rows = [], [], []
    numbers: dict[str, Any] = {}
    for model in fit.models:
        values = view.values(pool, model)
        curve = binned(pool.slip, values, EDGES)
        lines.append(marked_line(curve.centre, curve.median, style(model.name).label, style(model.name)))
        seen.append(curve.median[curve.centre > 0])
        driven = values[(pool.slip > 0) & np.isfinite(values)]
        percentiles = np.percentile(driven, [5, 50, 95]) if len(driven) else np.full(3, np.nan)
        rows.append([style(model.name).label, *(number(value) for value in percentiles)])
        numbers[model.name] = {"load_ratio": model.load_ratio, "curve": curve, "percentiles_5_50_95": percentiles}
    layout = axes("slip", view.what, height=340)
    look_at(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    look_at(layout, "y", np.concatenate(seen))
    blocks: list[Block] = [
        Text(view.intro),
        Panels([Figure("load", view.what.capitalize(), lines, layout)], view.reading),
        Table(f"{view.what.capitalize()} at slip > 0", ["model", "5 %", "median", "95 %"], rows),
    ]
    return Section(KEY, TITLE, blocks, {"reading": fit.options.reading, "quantity": view.what, "models": numbers})
