"""The sinkage each model predicts, beside the measured one where there is one."""

from __future__ import annotations

import numpy as np

from wheelsoil.report.content import Block, Panels, Section, Text
from wheelsoil.report.material import Material
from wheelsoil.report.sections.quantity import quantity_figure

KEY = "sinkage"
TITLE = "Sinkage"

_READING = (
    "total sinkage of the wheel against slip, median over all samples in bins of slip. The laws are fitted to forces "
    "only: their sinkage is a consequence, and the quickest thing to check in the field with a ruler in the rut."
)


def build(material: Material) -> Section:
    """Build the section."""
    measured = material.pool.sinkage_m
    blocks: list[Block] = []
    if not np.isfinite(measured).any():
        blocks.append(Text("The sinkage was not measured; what the models predict can be held against the rut."))
    figure, numbers = quantity_figure(material, "sinkage", "sinkage_m", 1e3 * measured, "sinkage (mm)", 1e3)
    return Section(KEY, TITLE, [*blocks, Panels([figure], _READING)], numbers)
