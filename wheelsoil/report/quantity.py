"""One quantity against slip with every model in one panel, as the section on the sinkage draws it."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelsoil.model_styles import style
from wheelsoil.report.content import Figure
from wheelsoil.report.figures import GREY_BAND, MEASURED, Trace, axes, band, dots, line, look_at, marked_line
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.thinning import EDGES, binned, thinned_by_sign


def quantity_figure(
    material: Material, key: str, name: str, measured: FloatArray, axis: str, factor: float = 1.0
) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of one predicted quantity and the numbers in it.

    Parameters
    ----------
    material : Material
    key : str
        Of the figure.
    name : str
        Of the prediction, e.g. ``"sinkage_m"``.
    measured : float64 array, shape (n,)
        In the unit of the axis; all NaN where it was not measured.
    axis : str
        Title of the axis, with its unit.
    factor : float
        From the prediction's unit to the axis'.
    """
    pool = material.pool
    data: list[Trace] = []
    numbers: dict[str, Any] = {"unit": axis}
    driven = measured[pool.slip > 0]
    lines = []
    if np.isfinite(measured).any():
        curve = binned(pool.slip, measured, EDGES)
        rows = thinned_by_sign(pool.slip, measured)
        data = [
            dots(pool.slip[rows], measured[rows], "measured"),
            *band(curve.centre, curve.lower, curve.upper, "middle half", GREY_BAND),
            line(curve.centre, curve.median, "median of measured", MEASURED, "solid", 2.2),
        ]
        numbers["measured"] = curve
    for model in material.fit.models:
        curve = binned(pool.slip, factor * pool.predicted(model.name, name), EDGES)
        data.append(marked_line(curve.centre, curve.median, style(model.name).label, style(model.name)))
        numbers[model.name] = curve
        lines.append(curve.median[curve.centre > 0])
    layout = axes("slip", axis, height=380)
    look_at(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    said = np.concatenate(lines)
    look_at(layout, "y", driven if np.isfinite(driven).any() else said, also=said)
    return Figure(key, axis, data, layout), numbers
