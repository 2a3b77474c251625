"""Live traces of the last minute: drawbar pull, and the slip at each of its samples, latencies taken out."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from processing import FloatArray, interpolate
from processing.pipeline import slip_of

SPAN_S = 60.0
"""What the plots show."""

_PATIENCE_S = 5.0
"""A pull whose speeds have not come after this time gets no slip."""
_MAX_GAP_S = 1.0
"""Speeds are not interpolated over a longer hole; a GNSS receiver at 1 Hz just passes."""
_MIN_SPEED_MPS = 0.5
_NOTHING = np.empty((0, 2))


class Curve:
    """Samples of the last `SPAN_S` seconds, as rows that begin with the time."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []

    def add(self, rows: Sequence[tuple[float, ...]]) -> None:
        """Append rows that are newer than the last one; forget what is too old."""
        last = self._rows[-1][0] if self._rows else -np.inf
        self._rows += [row for row in rows if row[0] > last]
        if self._rows:
            del self._rows[: bisect_right(self._rows, (self._rows[-1][0] - SPAN_S, np.inf))]

    def since(self, time_s: float) -> list[tuple[float, ...]]:
        """Return the rows after an instant."""
        return self._rows[bisect_right(self._rows, (time_s, np.inf)) :]

    @property
    def end_s(self) -> float:
        """Time of the last row, -inf without any."""
        return self._rows[-1][0] if self._rows else -np.inf


class LiveSlip:
    """Puts the snapshots' traces together.

    Attributes
    ----------
    pull : Curve
        (time_s, pull_n).
    slip : Curve
        (time_s, slip, pull_n), at the pull's samples whose slip could be formed.
    """

    def __init__(self) -> None:
        self.pull, self.slip = Curve(), Curve()
        self._waiting: FloatArray = _NOTHING
        self._speeds: dict[str, FloatArray] = {"wheel_speed": _NOTHING, "ground_speed": _NOTHING}

    def take(self, snapshot: Mapping[str, Any]) -> None:
        """Take a snapshot's ``traces`` with its ``setup``."""
        setup, traces = snapshot.get("setup") or {}, snapshot.get("traces") or {}
        latencies = setup.get("latency_s") or {}
        pull = _samples(traces.get("drawbar_pull"), latencies.get("drawbar_pull"))
        self.pull.add([(round(t, 3), round(n, 1)) for t, n in pull.tolist()])
        for role, kept in self._speeds.items():
            self._speeds[role] = _newest(np.vstack([kept, _samples(traces.get(role), latencies.get(role))]))
        self._waiting = _newest(np.vstack([self._waiting, pull]))
        radius_m = setup.get("wheel_radius_m")
        if radius_m:
            self._form(float(radius_m), float(setup.get("min_speed_mps") or _MIN_SPEED_MPS))

    def _form(self, radius_m: float, min_speed_mps: float) -> None:
        """Form the slip of the samples that both speeds have passed."""
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
    """Return a trace as (time, value) rows in time order, samples without a value left out."""
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
