"""Drawbar pull against slip with each model, and what each gets wrong where."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.fit_result import ModelFit
from model.observations import CHANNELS
from wheelsoil.report.content import Block, Figure, Panels, Section
from wheelsoil.report.figures import GREY_BAND, MEASURED, Trace, axes, band, dots, line, look_at, marked_line, style
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.thinning import Bins, binned, thinned_by_sign

KEY = "slip"
TITLE = "Drawbar pull against slip"

EDGES = np.round(np.arange(-1.0, 1.0001, 0.05), 2)
"""Bins of slip."""
_PANELS = (
    "grey dots are measured samples (thinned where they crowd), the black line their median in bins of slip and the "
    "grey band their middle half; the coloured line is the model's median over the same samples, so that the swing of "
    "the load is in both. Double-click shows braking (slip below 0), which is not fitted."
)
_ERRORS = (
    "how far each model's median lies above (+) or below (−) the measured one at each slip. A flat line off zero is an "
    "offset; a slope is what the sinkage law misses. Only slips right of the dotted line count in the table."
)


def build(material: Material) -> Section:
    """Build the section.

    Raises
    ------
    DataError
        The drawbar pull was not measured.
    """
    pool = material.pool
    measured = pool.measured("dp")
    curve = binned(pool.slip, measured, EDGES)
    rows = thinned_by_sign(pool.slip, measured)
    cloud = dots(pool.slip[rows], measured[rows], "measured")
    driven = pool.slip > 0
    panels, errors, seen = [], [], []
    numbers: dict[str, Any] = {"measured": curve}
    for model in material.fit.models:
        predicted = pool.predicted(model.name, CHANNELS["dp"])
        median = binned(pool.slip, np.where(np.isfinite(measured), predicted, np.nan), EDGES)
        error = binned(pool.slip, predicted - measured, EDGES)
        panels.append(_panel(model, cloud, curve, median, measured[driven]))
        errors.append(marked_line(error.centre, error.median, style(model.name).label, style(model.name)))
        seen.append(error.median[error.centre > 0])
        numbers[model.name] = {"predicted": median, "error": error}
    blocks: list[Block] = [
        Panels(panels, _PANELS),
        Panels([_error_figure(errors, material.fit.slip_threshold, np.concatenate(seen))], _ERRORS),
    ]
    return Section(KEY, TITLE, blocks, numbers)


def _panel(model: ModelFit, cloud: Trace, curve: Bins, median: Bins, seen: FloatArray) -> Figure:
    look = style(model.name)
    data = [
        cloud,
        *band(curve.centre, curve.lower, curve.upper, "middle half", GREY_BAND),
        line(curve.centre, curve.median, "median of measured", MEASURED, "solid", 2.2),
        marked_line(median.centre, median.median, look.label, look),
    ]
    layout = axes("slip", "drawbar pull (N)", height=340)
    look_at(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    look_at(layout, "y", np.concatenate([seen, median.median[median.centre > 0]]))
    return Figure(f"slip-{model.name}", f"{look.label}'s model", data, layout)


def _error_figure(errors: list[Trace], threshold: float, seen: FloatArray) -> Figure:
    layout = axes("slip", "predicted − measured (N)", height=380)
    look_at(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    look_at(layout, "y", seen)
    edge = {"type": "line", "xref": "x", "yref": "paper", "x0": threshold, "x1": threshold, "y0": 0, "y1": 1}
    layout["shapes"] = [edge | {"line": {"color": "#555", "width": 1.2, "dash": "dot"}}]
    return Figure("slip-error", "Error of the drawbar pull, every model (median in bins of slip)", errors, layout)
