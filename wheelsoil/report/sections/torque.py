"""Driving torque against slip: where it was not fitted, an independent check of every model."""

from __future__ import annotations

from wheelsoil.report.content import Panels, Section
from wheelsoil.report.material import Material
from wheelsoil.report.sections.quantity import quantity_figure

KEY = "torque"
TITLE = "Driving torque against slip"

_READING = (
    "as above, all models in one panel. A law that explains the drawbar pull by sinking must not spoil the torque: "
    "where the pull fits and the torque does not, the cause is not sinkage. Click a name to hide or show a line."
)


def build(material: Material) -> Section:
    """Build the section.

    Raises
    ------
    DataError
        The torque was not measured.
    """
    measured = material.pool.measured("t")
    figure, numbers = quantity_figure(material, "torque", "driving_torque_nm", measured, "driving torque (N m)")
    return Section(KEY, TITLE, [Panels([figure], _READING)], numbers)
