"""Report sections; each is a function of the report's inputs, made a `SectionBuilder` by `@section(KEY, TITLE)`.

A section that cannot be built raises `daq.errors.DataError` with the reason; it costs itself and nothing else.
"""

from __future__ import annotations

from wheelsoil.report.content import SectionBuilder
from wheelsoil.report.sections import (
    against_slip,
    against_time,
    candidates,
    coefficients,
    evidence,
    glance,
    misfit,
    planning,
    provenance,
    quality,
    tables,
    track,
    verdict,
)

SECTIONS: tuple[SectionBuilder, ...] = (
    glance.glance,
    verdict.verdict,
    quality.quality,
    coefficients.coefficients,
    against_slip.drawbar_pull,
    against_slip.torque,
    against_time.forces,
    against_time.drive,
    misfit.misfit,
    candidates.candidates,
    evidence.evidence,
    evidence.gain,
    coefficients.criteria,
    against_slip.sinkage,
    against_slip.load,
    planning.detectable,
    planning.next_run,
    track.track,
    quality.sensors,
    provenance.workings,
    provenance.provenance,
)
"""In the order of the page."""

SECTIONS_OF_TABLES: tuple[SectionBuilder, ...] = (
    glance.glance,
    tables.verdict,
    tables.rows,
    coefficients.coefficients,
    misfit.misfit,
    candidates.candidates,
    evidence.evidence,
    evidence.gain,
    coefficients.criteria,
    tables.sinkage,
    planning.detectable,
    planning.next_run,
    provenance.workings,
    provenance.provenance,
)
"""The same where there are single-wheel tables in place of runs."""

OF_THE_DIAGNOSIS = (
    misfit.misfit,
    candidates.candidates,
    evidence.evidence,
    evidence.gain,
    planning.next_run,
    planning.detectable,
    provenance.workings,
)
"""Sections that are not on the page where no diagnosis was asked for."""
