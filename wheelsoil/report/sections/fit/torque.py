"""Driving torque against slip: where it was not fitted, an independent check of every model."""

from __future__ import annotations

from wheelsoil.report.content import Panels, Section
from wheelsoil.report.curves import curves_of
from wheelsoil.report.inputs import ReportInputs

KEY = "torque"
TITLE = "Driving torque against slip"

_READING = (
    "as for the drawbar pull. A law that explains the drawbar pull by sinking must not spoil the torque: where the "
    "pull fits and the torque does not, the cause is not sinkage."
)
_ERRORS = (
    "predicted less measured, medians in bins of slip. Where the torque was not fitted, nothing has drawn these lines "
    "to zero: what lies near it was predicted."
)


def build(material: ReportInputs) -> Section:
    """Build the section.

    Raises
    ------
    DataError
        The torque was not measured.
    """
    found = curves_of(material, "t", KEY, "driving torque (N m)", _READING)
    return Section(KEY, TITLE, [found.panels, Panels([found.errors], _ERRORS)], found.numbers)
