"""The sinkage of a braked wheel: a law of its own, fitted to rows with s <= 0 alone.

Z = Z0 + H2 s^2 with Z0 the sinkage at no slip, as it was measured. Rows with s < 0 do not enter the fit of a driven
wheel, whose laws say nothing of them: a locked wheel ploughs, and pulls back with more than its friction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_noise import groups_of_rows
from model.diagnosis.campaign import Bench

FloatArray = NDArray[np.float64]

NO_SLIP = 0.02
"""Slip below which a wheel neither drives nor brakes: a controller's residue."""
_LEAST_GROUPS = 3


@dataclass(frozen=True)
class SkidLaw:
    """Z = Z0 + H2 s^2.

    Attributes
    ----------
    static_sinkage_m, H2_m : float
    H2_sigma_m : float
        From the scatter about the law.
    left_out_rms_m : float
        Of groups (one speed each) that the fit has not seen.
    rows : int
    """

    static_sinkage_m: float
    H2_m: float
    H2_sigma_m: float
    left_out_rms_m: float
    rows: int


def driven_rows(bench: Bench) -> Bench:
    """Return a bench with the rows of its driven wheel; a slip just below 0 counts as 0."""
    rows = bench.rows[bench.rows.slip > -NO_SLIP]
    return replace(bench, rows=replace(rows, slip=np.maximum(rows.slip, 0.0)))


def skid_law(bench: Bench) -> SkidLaw | None:
    """Return the law of a bench's braked rows; None where sinkage was measured at fewer than three braked speeds."""
    rows = bench.rows
    chosen = (rows.slip < NO_SLIP) & np.isfinite(rows.sinkage_m)
    slip, sinkage = np.minimum(rows.slip[chosen], 0.0), rows.sinkage_m[chosen]
    group = groups_of_rows(rows.run[chosen], slip, rows.vertical_load_n[chosen]) if chosen.any() else np.zeros(0)
    if len(np.unique(group[slip < -NO_SLIP])) < _LEAST_GROUPS:
        return None
    design = np.column_stack([np.ones_like(slip), slip**2])
    values = np.linalg.lstsq(design, sinkage, rcond=None)[0]
    error = sinkage - design @ values
    variance = float(error @ error) / max(len(error) - 2, 1)
    sigma = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[1, 1]))
    left_out = [_left_out(design, sinkage, group == g) for g in np.unique(group)]
    rms = float(np.sqrt(np.mean(np.concatenate(left_out) ** 2)))
    return SkidLaw(float(values[0]), float(values[1]), sigma, rms, int(chosen.sum()))


def _left_out(design: FloatArray, sinkage: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
    values = np.linalg.lstsq(design[~rows], sinkage[~rows], rcond=None)[0]
    return np.asarray(sinkage[rows] - design[rows] @ values)
