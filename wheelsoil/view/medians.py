"""Medians of a run, and of groups of runs that the page compares, from all used samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from daq import FloatArray
from processing import ProcessedRun
from wheelsoil.workflows.traction import at_usual_slip

_EDGES = np.round(np.arange(-0.5, 1.0001, 0.05), 2)
_LEAST = 20
"""Samples of a bin that has a median."""
_CHANNELS = ("drawbar_pull_n", "driving_torque_nm")


def medians_of(run: ProcessedRun) -> dict[str, float | None]:
    """Return median load (N), ground speed (m/s) and the greatest slip of the used samples; None where unknown."""
    used = run.used
    slip = run.slip[used]
    slip = slip[np.isfinite(slip)]
    return {
        "load_n": _median(run.vertical_load_n[used]),
        "speed_mps": _median(run.ground_speed_mps[used]),
        "greatest_slip": float(slip.max()) if len(slip) else None,
    }


def compared(groups: Sequence[Sequence[ProcessedRun]]) -> dict[str, Any]:
    """Return medians of each group of runs, by bins of slip and as single numbers, from all used samples.

    The runs are with the manual exclusions. A bin with fewer than 20 samples has no median.
    """
    centres = np.round((_EDGES[:-1] + _EDGES[1:]) / 2, 3)
    return {"slip": centres.tolist(), "groups": [_summary(group) for group in groups]}


def _summary(runs: Sequence[ProcessedRun]) -> dict[str, Any]:
    used = [run.used for run in runs]

    def of(name: str) -> FloatArray:
        pieces = [np.asarray(getattr(run, name), np.float64) for run in runs]
        pieces = [
            p[u] if len(p) == len(u) else np.full(int(u.sum()), np.nan) for p, u in zip(pieces, used, strict=True)
        ]
        return np.concatenate([np.zeros(0), *pieces])

    slip, pull, load = of("slip"), of("drawbar_pull_n"), of("vertical_load_n")
    number = np.where(np.isfinite(slip), np.digitize(slip, _EDGES) - 1, -1)
    at_slip, torque = (at_usual_slip(runs, field) for field in ("drawbar_pull_n", "driving_torque_nm"))
    return {
        "runs": len(runs),
        "seconds": float(sum(u.sum() / run.rate_hz for run, u in zip(runs, used, strict=True))),
        "load_n": _median(load),
        "speed_mps": _median(of("ground_speed_mps")),
        "greatest_slip": float(np.nanmax(slip)) if np.isfinite(slip).any() else None,
        "greatest_pull_n": max(filter(None, (binned := _binned(number, pull))), default=None),
        "pull_n": at_slip.pull_n if at_slip else None,
        "pull_coefficient": at_slip.pull_n / at_slip.load_n if at_slip else None,
        "torque_nm": torque.pull_n if torque else None,
        "curves": {name: binned if name == "drawbar_pull_n" else _binned(number, of(name)) for name in _CHANNELS},
    }


def _binned(number: FloatArray, values: FloatArray) -> list[float | None]:
    inside = [values[(number == i) & np.isfinite(values)] for i in range(len(_EDGES) - 1)]
    return [_median(each) if len(each) >= _LEAST else None for each in inside]


def _median(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
