"""What the page says of a selection, from all samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from daq import BoolArray, FloatArray
from processing import ProcessedRun, Reason

if TYPE_CHECKING:
    from wheelsoil.view.messages import SelectedAsked

_REASONS = {why.name.lower(): why for why in Reason}


def selected_of(run: ProcessedRun, asked: SelectedAsked) -> dict[str, Any]:
    """Return number and duration of the selected samples, their range of slip and their mean drawbar pull.

    The run is with the manual exclusions. The mean drawbar pull is that of the used samples; of all if none is used.
    """
    rows = _rows(run, asked)
    used = rows & run.used
    slip, pull = run.slip[rows], run.drawbar_pull_n[used if used.any() else rows]
    slip, pull = slip[np.isfinite(slip)], pull[np.isfinite(pull)]
    samples = int(rows.sum())
    return {
        "samples": samples,
        "of": len(run),
        "seconds": samples / run.rate_hz,
        "left_out": samples - int(used.sum()),
        "slip": [float(slip.min()), float(slip.max())] if len(slip) else None,
        "drawbar_pull_n": float(pull.mean(dtype=np.float64)) if len(pull) else None,
    }


def _rows(run: ProcessedRun, asked: SelectedAsked) -> BoolArray:
    if asked.kind == "reason":
        return np.asarray(run.reason == _REASONS.get(asked.code, -1))
    visible = run.used | asked.left_out
    if asked.kind == "time":
        return visible & _within(run.time_s, asked.low, asked.high)
    rows = visible & _within(run.slip, asked.low, asked.high)
    if asked.channel is None:
        return rows
    return rows & _within(getattr(run, asked.channel), asked.bottom, asked.top)


def _within(values: FloatArray, low: float, high: float) -> BoolArray:
    return np.asarray((values >= low) & (values <= high))
