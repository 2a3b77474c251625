"""Report sections, one file each: ``KEY``, ``TITLE`` and ``build(material) -> Section``.

A section that cannot be built raises `daq.errors.DataError` with the reason; it costs itself and nothing else.
"""

from __future__ import annotations

from types import ModuleType

from wheelsoil.report.sections.diagnosis import (
    candidates,
    detectable,
    evidence,
    gain,
    glance,
    next_run,
    verdict,
    workings,
)
from wheelsoil.report.sections.fit import against_slip, against_time, coefficients, criteria, misfit, sinkage, torque
from wheelsoil.report.sections.runs import drive, load, provenance, quality, sensors, track

SECTIONS: tuple[ModuleType, ...] = (
    glance,
    verdict,
    quality,
    coefficients,
    against_slip,
    torque,
    against_time,
    drive,
    misfit,
    candidates,
    evidence,
    gain,
    criteria,
    sinkage,
    load,
    detectable,
    next_run,
    track,
    sensors,
    workings,
    provenance,
)
"""In the order of the page."""

OF_THE_DIAGNOSIS = (misfit, candidates, evidence, gain, next_run, detectable, workings)
"""Sections that are not on the page where no diagnosis was asked for."""
