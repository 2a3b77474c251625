"""Report sections; each is a function of the report's inputs, made a `SectionBuilder` by `@section(KEY, TITLE)`.

A section that cannot be built raises `daq.errors.DataError` with the reason; it costs itself and nothing else.
"""

from __future__ import annotations

from wheelsoil.report.content import SectionBuilder
from wheelsoil.report.sections import (
    against_slip,
    against_time,
    answers,
    candidates,
    change,
    coefficients,
    evidence,
    glance,
    misfit,
    overview,
    planning,
    provenance,
    quality,
    tables,
    track,
    verdict,
)

EVIDENCE: tuple[SectionBuilder, ...] = (
    answers.answers,
    change.against,
    overview.fit,
    overview.causes,
    change.cost,
    overview.runs,
    overview.signals,
)
"""Below the first screen; what follows them is the appendix."""

DIAGNOSIS: tuple[SectionBuilder, ...] = (
    misfit.misfit,
    candidates.candidates,
    evidence.evidence,
    evidence.gain,
    planning.detectable,
    planning.next_run,
)
"""What a diagnosis has in the appendix."""

RECORDINGS = (against_time.time, track.track)
"""What was recorded, sample by sample."""

SINGLE_LAWS = (
    verdict.verdict,
    against_slip.drawbar_pull,
    against_slip.torque,
    coefficients.coefficients,
    coefficients.criteria,
    against_slip.sinkage,
    against_slip.load,
)
"""The fits of the paper's models."""

PROVENANCE = (quality.quality, quality.sensors, provenance.workings, provenance.provenance)
"""What the runs are worth, and how the page was made."""

SECTIONS = (glance.glance, *EVIDENCE, *RECORDINGS, *DIAGNOSIS, *SINGLE_LAWS, *PROVENANCE)
"""In the order of the page."""

SECTIONS_OF_TABLES: tuple[SectionBuilder, ...] = (
    glance.glance,
    answers.answers,
    overview.fit,
    overview.causes,
    tables.rows,
    *DIAGNOSIS,
    tables.verdict,
    coefficients.coefficients,
    coefficients.criteria,
    tables.sinkage,
    provenance.workings,
    provenance.provenance,
)
"""The same where there are single-wheel tables in place of runs."""

GROUPS = {
    "Recordings": (*RECORDINGS, tables.rows),
    "Diagnosis": DIAGNOSIS,
    "Single-law fits": (*SINGLE_LAWS, tables.verdict, tables.sinkage),
    "Quality and provenance": PROVENANCE,
}
"""Of the appendix: one section of each group is open at a time."""

OF_THE_DIAGNOSIS = (answers.answers, overview.causes, *DIAGNOSIS, provenance.workings)
"""Sections that are not on the page where no diagnosis was asked for."""
