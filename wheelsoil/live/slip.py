"""Live traces of the last minute: drawbar pull, and slip at each of its samples, corrected for latencies."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from daq import FloatArray
from processing import interpolate
from processing.pipeline import slip_of

SPAN_S = 60.0
"""Time span of the plots."""

_PATIENCE_S = 5.0
"""A sample of the pull without speeds after this time has no slip."""
_MAX_GAP_S = 1.0
"""Speeds are not interpolated over a longer gap; a GNSS receiver at 1 Hz is just accepted."""
_MIN_SPEED_MPS = 0.5
_NOTHING = np.empty((0, 2))


class Curve:
    """Samples of the last `SPAN_S` seconds, as rows whose first column is the time in s."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []

    def add(self, rows: Sequence[tuple[float, ...]]) -> None:
        """Append the rows that are newer than the last one, and delete those older than `SPAN_S`."""
        last = self._rows[-1][0] if self._rows else -np.inf
        self._rows += [row for row in rows if row[0] > last]
        if self._rows:
            del self._rows[: bisect_right(self._rows, (self._rows[-1][0] - SPAN_S, np.inf))]

    def since(self, time_s: float) -> list[tuple[float, ...]]:
        """Return the rows after a time in s."""
        return self._rows[bisect_right(self._rows, (time_s, np.inf)) :]

    @property
    def end_s(self) -> float:
        """Time of the last row, -inf without any."""
        return self._rows[-1][0] if self._rows else -np.inf


class LiveSlip:
    """Traces of pull and slip, assembled from the snapshots.

    Attributes
    ----------
    pull : Curve
        (time_s, pull_n).
    slip : Curve
        (time_s, slip, pull_n), at the samples of the pull whose slip is known.
    """

    def __init__(self) -> None:
        self.pull, self.slip = Curve(), Curve()
        self._waiting: FloatArray = _NOTHING
        self._speeds: dict[str, FloatArray] = {"wheel_speed": _NOTHING, "ground_speed": _NOTHING}

    def take(self, snapshot: Mapping[str, Any]) -> None:
        """Add the ``traces`` of a snapshot, with its ``setup``."""
        setup, traces = snapshot.get("setup") or {}, snapshot.get("traces") or {}
        latencies = setup.get("latency_s") or {}
        pull = _samples(traces.get("drawbar_pull"), latencies.get("drawbar_pull"))
        self.pull.add([(round(t, 3), round(n, 1)) for t, n in pull.tolist()])
        for role, kept in self._speeds.items():
            self._speeds[role] = _newest(np.vstack([kept, _samples(traces.get(role), latencies.get(role))]))
        self._waiting = _newest(np.vstack([self._waiting, pull]))
        radius_m = setup.get("wheel_radius_m")
        if radius_m:
            self._compute_slip(float(radius_m), float(setup.get("min_speed_mps") or _MIN_SPEED_MPS))

    def _compute_slip(self, radius_m: float, min_speed_mps: float) -> None:
        """Compute the slip of the samples up to which both speeds are known."""
        wheel, ground = self._speeds["wheel_speed"], self._speeds["ground_speed"]
        if not len(wheel) or not len(ground) or not len(self._waiting):
            return
        ready = self._waiting[:, 0] <= min(wheel[-1, 0], ground[-1, 0])
        due, self._waiting = self._waiting[ready], self._waiting[~ready]
        rim = radius_m * interpolate(due[:, 0], wheel[:, 0], wheel[:, 1], _MAX_GAP_S)
        slip = slip_of(rim, interpolate(due[:, 0], ground[:, 0], ground[:, 1], _MAX_GAP_S), min_speed_mps)
        rows = np.column_stack([due[:, 0], slip, due[:, 1]])[np.isfinite(slip)]
        self.slip.add([(round(t, 3), round(s, 4), round(n, 1)) for t, s, n in rows.tolist()])


def _samples(trace: Mapping[str, Any] | None, latency_s: float | None) -> FloatArray:
    """Return a trace as (time, value) rows in time order, without the samples that have no value."""
    if not trace:
        return _NOTHING
    rows = np.array([trace["time_s"], trace["value"]], np.float64).T.reshape(-1, 2)
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows[:, 0] -= latency_s or 0.0
    return rows


def _newest(rows: FloatArray) -> FloatArray:
    """Return the rows of the last seconds, in time order."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return rows[rows[:, 0] > rows[-1, 0] - _PATIENCE_S] if len(rows) else rows
