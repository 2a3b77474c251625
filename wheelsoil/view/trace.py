"""Thinning for the plots: few points of a run that keep the peaks of pull and slip, and of each decoded signal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq import FloatArray, IntArray
from daq.can import Decoder
from daq.runs import Run
from processing import ProcessedRun, Reason, Segment
from processing.pipeline import runs_of

MOST_POINTS = 6000
_RATE_HZ = 10.0
_GUIDES = 2
_KEPT_PER_PIECE = 2 * _GUIDES
"""Minimum and maximum of the two guiding quantities, drawbar pull and slip."""

_DECIMALS = {
    "time_s": 3,
    "slip": 5,
    "drawbar_pull_n": 1,
    "driving_torque_nm": 1,
    "vertical_load_n": 1,
    "ground_speed_mps": 4,
    "rim_speed_mps": 4,
    "sinkage_m": 5,
    "distance_m": 3,
}
_TRACK = ("east_m", "north_m")
_MAY_BE_ABSENT = ("driving_torque_nm", "sinkage_m", *_TRACK)
_METRES_A_DEGREE = 6_371_000.0 * np.pi / 180.0


@dataclass(frozen=True)
class Trace:
    """A thinned run; arrays of shape (n,).

    Attributes
    ----------
    quantities : mapping name with unit -> float64 array
        NaN if unknown.
    reason : uint8 array, see `Reason`
    rows : int array
        Of the samples that are kept.
    segments : tuple of (kind, from_s, to_s)
        Of the whole run.
    thinned_from : int
        Number of samples of the run.
    """

    quantities: dict[str, FloatArray]
    reason: NDArray[np.uint8]
    rows: IntArray
    segments: tuple[tuple[str, float, float], ...]
    thinned_from: int

    @property
    def time_s(self) -> FloatArray:
        """Seconds since the start of the run's time base, shape (n,)."""
        return self.quantities["time_s"]


def trace_of(run: ProcessedRun) -> Trace:
    """Thin a processed run; see `rows_to_draw`."""
    rows = rows_to_draw(run)
    quantities = {name: np.round(getattr(run, name)[rows], decimals) for name, decimals in _DECIMALS.items()}
    quantities |= dict(zip(_TRACK, _track(run.latitude_deg, run.longitude_deg, rows), strict=True))
    return Trace(quantities, run.reason[rows], rows, _segments(run), len(run))


def _track(latitude_deg: FloatArray, longitude_deg: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return east and north of the run's first fix, m; NaN without a fix."""
    fixed = np.flatnonzero(np.isfinite(latitude_deg) & np.isfinite(longitude_deg))
    if not len(fixed):
        return np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    latitude, longitude = latitude_deg[fixed[0]], longitude_deg[fixed[0]]
    turned = (longitude_deg[rows] - longitude + 180.0) % 360.0 - 180.0
    east = turned * _METRES_A_DEGREE * np.cos(np.radians(latitude))
    return np.round(east, 3), np.round((latitude_deg[rows] - latitude) * _METRES_A_DEGREE, 3)


def rows_to_draw(run: ProcessedRun) -> IntArray:
    """Choose about ten rows a second, at most `MOST_POINTS`, in ascending order.

    The run is cut into pieces of equal length. Each piece keeps the rows of minimum and maximum drawbar pull and slip
    (of torque, load or speeds if one of them is missing), among its used samples if it has any, and the first row of
    each exclusion reason, so that every gap stays visible.
    """
    most = min(MOST_POINTS, int(len(run) / run.rate_hz * _RATE_HZ) + _KEPT_PER_PIECE)
    if len(run) <= most:
        return np.arange(len(run))
    pieces = max(most // _KEPT_PER_PIECE, 1)
    while len(rows := _rows_of_pieces(run, pieces)) > MOST_POINTS:
        pieces = pieces * MOST_POINTS // len(rows)
    return rows


def _rows_of_pieces(run: ProcessedRun, pieces: int) -> IntArray:
    guides = [run.drawbar_pull_n, run.slip]
    if run.quality.missing:
        guides += [run.driving_torque_nm, run.vertical_load_n, run.ground_speed_mps, run.wheel_speed_radps]
    guides = [values for values in guides if np.isfinite(values).any()][:_GUIDES]
    chosen = []
    for piece in np.array_split(np.arange(len(run)), pieces):
        reasons, first = np.unique(run.reason[piece], return_index=True)
        used = piece[run.used[piece]]
        inside = used if len(used) else piece
        found = [row for values in guides for row in _ends(values, inside)]
        found += piece[first[(reasons != Reason.USED) | (not found)]].tolist()
        chosen.append(np.unique(found))
    return np.concatenate(chosen)


def trace_as_json(trace: Trace, reason: NDArray[np.uint8]) -> dict[str, Any]:
    """Return JSON values; NaN becomes None, and a quantity that was not measured is None as a whole.

    `reason`, shape (n,), stands in for the trace's own: it has the manual exclusions.
    """
    words = ["" if why is Reason.USED else why.name.lower() for why in Reason]
    arrays = {
        name: None if name in _MAY_BE_ABSENT and np.isnan(values).all() else _with_none(values)
        for name, values in trace.quantities.items()
    }
    return {
        **arrays,
        "used": (reason == Reason.USED).tolist(),
        "reason": [words[why] for why in reason],
        "segments": [{"kind": kind, "from_s": first, "to_s": last} for kind, first, last in trace.segments],
        "thinned_from": trace.thinned_from,
    }


def _ends(values: FloatArray, rows: IntArray) -> list[int]:
    known = rows[np.isfinite(values[rows])]
    return [int(known[pick(values[known])]) for pick in (np.argmin, np.argmax)] if len(known) else []


def _segments(run: ProcessedRun) -> tuple[tuple[str, float, float], ...]:
    last_s = float(run.time_s[-1])
    return tuple(
        (
            Segment(int(run.segment[start])).name.lower(),
            float(run.time_s[start]),
            float(run.time_s[stop]) if stop < len(run) else last_s,
        )
        for start, stop in runs_of(run.segment)
    )


def _with_none(values: FloatArray) -> list[float | None]:
    return [value if value == value else None for value in values.tolist()]


@dataclass(frozen=True)
class Signal:
    """A decoded signal, thinned: time in seconds since the run's time base begins, and values, each of shape (n,)."""

    unit: str
    time_s: FloatArray
    values: FloatArray


Signals = dict[str, Signal]
"""By ``bus message.signal``; of decoded series ``topic.signal``."""


def signals_of(run: Run, start_ns: int) -> Signals:
    """Decode every signal of a run, in the unit of its database; each keeps the least and greatest of its pieces."""
    pieces: dict[str, list[tuple[IntArray, FloatArray]]] = {}
    units: dict[str, str] = {}
    for name, unit, time_ns, values in _decoded(run):
        if len(time_ns):
            pieces.setdefault(name, []).append((time_ns, values))
            units[name] = unit
    found = {}
    for name, parts in sorted(pieces.items()):
        time_s = (np.concatenate([time for time, _ in parts]) - start_ns) * 1e-9
        values = np.concatenate([value for _, value in parts])
        rows = _extremes(values)
        found[name] = Signal(units[name], np.round(time_s[rows], 4), values[rows])
    return found


def _decoded(run: Run) -> Iterator[tuple[str, str, IntArray, FloatArray]]:
    if run.series:
        for blocks in run.series.blocks():
            for block in blocks:
                for name, values in block.columns.items():
                    unit = run.series.topics[block.topic].get(name, "")
                    yield f"{block.topic}.{name}", unit, block.time_ns, np.asarray(values, np.float64)
        return
    decoder = Decoder(run.databases)
    for batch in run.frame_batches():
        for (bus, name), channel in decoder.decode(batch).items():
            yield f"{bus} {name}", channel.unit, channel.time_ns, np.asarray(channel.values, np.float64)


def _extremes(values: FloatArray) -> IntArray:
    """Return the rows of minimum and maximum of each of the pieces, in ascending order."""
    if len(values) <= MOST_POINTS:
        return np.arange(len(values))
    pieces = np.array_split(np.arange(len(values)), MOST_POINTS // 2)
    return np.concatenate([np.unique(_ends(values, piece) or [piece[0]]) for piece in pieces])


def signal_as_json(signal: Signal) -> dict[str, Any]:
    """Return JSON values; NaN becomes None."""
    values = [float(f"{value:.7g}") for value in signal.values]
    return {"unit": signal.unit, "time_s": signal.time_s.tolist(), "values": _with_none(np.array(values))}
