"""Drawbar pull against slip: measured with its density, every model with its band, and what each gets wrong where."""

from __future__ import annotations

from wheelsoil.report.content import Panels, Section
from wheelsoil.report.curves import curves_of
from wheelsoil.report.inputs import ReportInputs

KEY = "slip"
TITLE = "Drawbar pull against slip"

_READING = (
    "grey cells (and lone dots) are measured samples, darker where there are more; black is their median in bins of "
    "slip, the grey band their middle half. A model's line is its median over the same samples, its coloured band the "
    "95 % of its coefficients (none is fitted in Wong's). Where black leaves a band, that model is wrong. Braking is "
    "not fitted."
)
_ERRORS = (
    "how far each model's median lies above (+) or below (−) the measured one at each slip. A flat line off zero is an "
    "offset; a slope is what the sinkage law misses. Only slips right of the dotted line count in the table."
)


def build(material: ReportInputs) -> Section:
    """Build the section.

    Raises
    ------
    DataError
        The drawbar pull was not measured.
    """
    found = curves_of(material, "dp", KEY, "drawbar pull (N)", _READING)
    return Section(KEY, TITLE, [found.panels, Panels([found.errors], _ERRORS)], found.numbers)
