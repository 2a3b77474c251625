"""Report sections, one file each: ``KEY``, ``TITLE`` and ``build(material) -> Section``.

A section that cannot be built raises `daq.errors.DataError` with the reason; it costs itself and nothing else.
"""

from __future__ import annotations

from types import ModuleType

from wheelsoil.report.sections import (
    against_slip,
    against_time,
    coefficients,
    criteria,
    drive,
    load,
    provenance,
    quality,
    sinkage,
    torque,
    verdict,
)

SECTIONS: tuple[ModuleType, ...] = (
    verdict,
    coefficients,
    criteria,
    against_time,
    against_slip,
    torque,
    sinkage,
    load,
    drive,
    quality,
    provenance,
)
"""In the order of the page."""
