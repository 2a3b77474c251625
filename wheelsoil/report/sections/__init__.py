"""Report sections, one file each: ``KEY``, ``TITLE`` and ``build(material) -> Section``.

A section that cannot be built raises `daq.errors.DataError` with the reason; it costs itself and nothing else.
"""

from __future__ import annotations

from types import ModuleType

from wheelsoil.report.sections import (
    against_slip,
    against_time,
    candidates,
    coefficients,
    criteria,
    detectable,
    drive,
    evidence,
    gain,
    glance,
    load,
    misfit,
    next_run,
    provenance,
    quality,
    sensors,
    sinkage,
    torque,
    track,
    verdict,
    workings,
)

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
