"""What is selected of a run on the page, counted over all of its samples and not over the points that are drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from processing.processed_run import ProcessedRun, Reason
from wheelsoil.view.requests import SelectedAsked

_REASONS = {why.name.lower(): why for why in Reason}


def selected_of(run: ProcessedRun, asked: SelectedAsked) -> dict[str, Any]:
    """Return how many samples are selected, for how long, and what they have of slip and drawbar pull.

    The mean drawbar pull is that of the used ones among them; of all where none is used.

    Parameters
    ----------
    run : ProcessedRun
        With what was left out by hand.
    asked : SelectedAsked
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


def _rows(run: ProcessedRun, asked: SelectedAsked) -> NDArray[np.bool_]:
    if asked.kind == "reason":
        return np.asarray(run.reason == _REASONS.get(asked.code, -1))
    seen = run.used | asked.left_out
    if asked.kind == "time":
        return seen & _within(run.time_s, asked.low, asked.high)
    rows = seen & _within(run.slip, asked.low, asked.high)
    if asked.channel is None:
        return rows
    return rows & _within(getattr(run, asked.channel), asked.bottom, asked.top)


def _within(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((values >= low) & (values <= high))
