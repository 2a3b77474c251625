"""Curves of the last minute (drawbar pull, and slip without latencies), streamed with the last snapshot to browsers."""

from __future__ import annotations

import asyncio
import json
import time
from bisect import bisect_right
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any

import numpy as np

from daq import FloatArray, Quantity, find_unit
from processing import interpolate
from processing.pipeline import slip_of

SPAN_S = 60.0
"""Time span of the plots."""

_PATIENCE_S = 5.0
"""A sample of the pull without speeds after this time has no slip."""
_MAX_GAP_S = 1.0
"""Speeds are not interpolated over a longer gap; a GNSS receiver at 1 Hz is just accepted."""
_MIN_SPEED_MPS = 0.5
_HELD_S, _HELD_SAMPLES = 0.5, 3
"""A slip counts as reached when it was held this long: at starting, a GNSS receiver's delay looks like 100 %."""
_NOTHING = np.empty((0, 2))

MOST_STREAMS = 12
KEEP_ALIVE_S = 1.0
_KEEP_ALIVE = b": alive\n\n"


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
    """Traces assembled from the snapshots.

    `pull` has rows (time_s, pull_n); `slip` (time_s, slip, pull_n), at the samples of the pull whose slip is known.
    `highest_slip` is the highest that was held in the present run, None where none is known of it yet; `lost_frames`
    are those lost in it.
    """

    def __init__(self) -> None:
        self.pull, self.slip = Curve(), Curve()
        self.highest_slip: float | None = None
        self.lost_frames = self._lost_before = 0
        self._run: str | None = None
        self._run_start_s = -np.inf
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
        # The frames that the logger has lost; `wrapped` counts something else.
        losses = snapshot.get("losses") or {}
        lost = sum(int(n) for name, n in losses.items() if not name.startswith("wrapped."))
        self._begin(snapshot, lost)
        self.lost_frames = max(lost - self._lost_before, 0)
        radius_m = setup.get("wheel_radius_m")
        if radius_m:
            self._compute_slip(float(radius_m), float(setup.get("min_speed_mps") or _MIN_SPEED_MPS))

    def _begin(self, snapshot: Mapping[str, Any], lost: int) -> None:
        """Forget the highest slip and what was lost where a new run began, or the time between runs."""
        run, now_s = snapshot.get("run") or {}, snapshot.get("session_s")
        if now_s is None or "id" not in run or run["id"] == self._run:
            return
        self._lost_before = 0 if self._run is None else lost
        self._run, self._run_start_s, self.highest_slip = run["id"], now_s - run["since_s"], None

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
        if len(rows):
            before_s = rows[0, 0] - _HELD_SAMPLES * _MAX_GAP_S
            held = _held(np.array(self.slip.since(max(before_s, self._run_start_s))).reshape(-1, 3))
            if held is not None:
                self.highest_slip = max(held, self.highest_slip or 0.0)


def _held(rows: FloatArray) -> float | None:
    """Return the highest slip of (time, slip, ...) rows that `_HELD_S` and `_HELD_SAMPLES` do not fall below."""
    time_s, slip = rows[:, 0], rows[:, 1]
    begin = np.searchsorted(time_s, time_s - _HELD_S + 1e-6, side="right") - 1
    begin = np.minimum(begin, np.arange(len(rows)) - _HELD_SAMPLES + 1)
    held = [
        float(slip[first : last + 1].min())
        for last, first in enumerate(begin.tolist())
        if first >= 0 and np.diff(time_s[first : last + 1]).max() <= _MAX_GAP_S
    ]
    return max(held, default=None)


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


class Hub:
    """Distribution of the snapshots to the browsers; `vehicle` is the name to show before the first snapshot.

    A browser is sent the newest snapshot as soon as it has received the previous one, with all samples of the curves
    since then. A slow browser receives fewer snapshots and complete curves, and does not delay the others.
    """

    def __init__(self, vehicle: str) -> None:
        self.streams = 0
        self._hello = _event("hello", {"vehicle": vehicle})
        self._live = LiveSlip()
        self._snapshot: dict[str, Any] | None = None
        self._taken_s = 0.0
        self._number = 0
        self._ended = False
        self._news = asyncio.Condition()

    async def take(self, snapshot: dict[str, Any]) -> None:
        """Store the newest snapshot of the logger and notify the streams."""
        self._live.take(snapshot)
        self._snapshot = {key: value for key, value in snapshot.items() if key != "traces"}
        self._snapshot["values"] = [_with_factor(value) for value in snapshot.get("values") or ()]
        self._taken_s = time.monotonic()
        self._number += 1
        await self._notify()

    async def end(self) -> None:
        """End the streams with the event that the logger has ended."""
        self._ended = True
        await self._notify()

    async def stream(self) -> AsyncIterator[bytes]:
        """Yield server-sent events: ``hello``, ``snapshot``, ``ended``, and a comment each second without either."""
        self.streams += 1
        try:
            number, sent_s = 0, (-float("inf"), -float("inf"))
            yield self._hello
            while not self._ended:
                if self._number == number and not await self._wait(number):
                    yield _KEEP_ALIVE
                    continue
                if self._number != number and self._snapshot is not None:
                    number, message = self._number, self._message(sent_s)
                    sent_s = (self._live.pull.end_s, self._live.slip.end_s)
                    yield message
            yield _event("ended", {})
        finally:
            self.streams -= 1

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    async def _wait(self, number: int) -> bool:
        """Return whether there is a new snapshot, or the end, within `KEEP_ALIVE_S`."""
        try:
            async with asyncio.timeout(KEEP_ALIVE_S), self._news:
                await self._news.wait_for(lambda: self._number != number or self._ended)
        except TimeoutError:
            return False
        return True

    def _message(self, sent_s: tuple[float, float]) -> bytes:
        pull, slip = self._live.pull.since(sent_s[0]), self._live.slip.since(sent_s[1])
        body = {
            "snapshot": self._snapshot,
            "age_s": round(time.monotonic() - self._taken_s, 3),
            "curves": {"fresh": sent_s[0] == sent_s[1] == -float("inf"), "span_s": SPAN_S, "pull": pull, "slip": slip},
            "highest_slip": self._live.highest_slip,
            "lost_frames": self._live.lost_frames,
        }
        return _event("snapshot", body)


def _with_factor(value: dict[str, Any]) -> dict[str, Any]:
    """Return a value with ``to_mps``, its unit in m/s, where it is a speed in a known unit."""
    speed = find_unit(value["unit"], [Quantity.SPEED]) if value.get("role") == "ground_speed" else None
    return value if speed is None else value | {"to_mps": speed.factor}


def _event(name: str, body: dict[str, Any]) -> bytes:
    return f"event: {name}\ndata: {json.dumps(body, separators=(',', ':'))}\n\n".encode()
