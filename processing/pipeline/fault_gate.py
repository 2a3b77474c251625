"""What a sensor gives where it gives no measurement is taken out of a run, and remembered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from daq import ON_TIME_BASE, BoolArray, Channel, IntArray, Note, Severity, VehicleConfig, mean_interval_ns
from processing.notes import RunCode
from processing.pipeline.collection import Samples
from processing.pipeline.sensor_faults import (
    LOADS,
    FaultKind,
    Series,
    dropped,
    frozen,
    held_too_long,
    held_values,
    speed_changes,
    stuck,
    values_apart,
)
from processing.pipeline.spikes import spikes

_PIECE = 1 << 16
"""So many samples of the fastest channel are looked at together."""
_MARK_STRETCHES, _MARK_S = 3, 1.0
"""So often, or so long, comes a mark; a shock may be sent twice."""
_MEASURED = tuple(channel.role for channel in ON_TIME_BASE)


@dataclass
class _Tally:
    """What was found of one kind in one channel, or of one value that stands apart."""

    count: int = 0
    time_s: float = 0.0
    value: float = 0.0


class FaultGate:
    """Takes what is no measurement out of a stream and remembers where and why.

    Raw values are looked at, before zeros and axes change them: a stretch of the stream at a time. The ground speed is
    looked at when all of it is there and the receiver's own word has been applied. `node_ns` is the grid on which the
    instants are kept; `vehicle` says whether the transducer rotates.
    """

    def __init__(self, node_ns: int, vehicle: VehicleConfig) -> None:
        self._node_ns = node_ns
        self._flagged = False
        self._rotating = vehicle.transducer.frame == "wheel"
        self._radius_m = vehicle.wheel.radius_m if vehicle.wheel else 1.0
        self._apart: dict[tuple[str, float], _Tally] = {}
        self._where: dict[str, list[IntArray]] = {}
        self._found: dict[tuple[str, FaultKind], _Tally] = {}
        self._total: Counter[str] = Counter()

    def without_faults(self, chunks: Iterable[Mapping[str, Channel]]) -> Iterator[dict[str, Channel]]:
        """Yield the chunks without them, some together; latencies must be off the stamps already."""
        waiting: list[Mapping[str, Channel]] = []
        count: Counter[str] = Counter()
        for chunk in chunks:
            waiting.append(chunk)
            count.update({role: len(channel) for role, channel in chunk.items()})
            if max(count.values(), default=0) >= _PIECE:
                yield from self._sound(waiting)
                waiting, count = [], Counter()
        yield from self._sound(waiting)

    def marked(self, samples: Mapping[str, Samples]) -> dict[str, Samples]:
        """Return the samples with the instants at which the sensor gave no measurement.

        A force in wheel axes is part of both forces in vehicle axes.
        """
        where = dict(self._where)
        if self._rotating:
            both = [stamps for role in LOADS for stamps in where.get(role, [])]
            where |= dict.fromkeys(LOADS, both)
        return {
            role: replace(channel, faulty_ns=np.unique(np.concatenate(where[role]))) if where.get(role) else channel
            for role, channel in samples.items()
        }

    def without_faulty_ground_speed(self, samples: Mapping[str, Samples]) -> dict[str, Samples]:
        """Return the samples without what is no measurement in the ground speed; invalid fixes must be out."""
        sound = dict(samples)
        ground_speed = samples.get("ground_speed")
        if ground_speed is None or not len(ground_speed.values):
            return sound
        speed = (ground_speed.time_ns, ground_speed.values)
        rows = self._without_marks("ground_speed", speed) if self._flagged else np.arange(len(ground_speed.values))
        speed = (ground_speed.time_ns[rows], ground_speed.values[rows])
        if self._flagged:
            [bad] = spikes({"ground_speed": speed}, self._radius_m).values()
            self._note("ground_speed", FaultKind.SPIKE, speed, bad)
            rows, speed = rows[~bad], (speed[0][~bad], speed[1][~bad])
        wheel = [(w.time_ns, w.values) for w in (samples.get("wheel_speed"),) if w is not None and len(w.values)]
        held = held_values(speed)
        bad = dropped(speed, held, wheel)
        still = frozen(speed, held, wheel, [speed, *wheel], speed_changes) | stuck(speed, held, [speed, *wheel])
        self._note("ground_speed", FaultKind.DROPPED, speed, bad)
        self._note("ground_speed", FaultKind.FROZEN, speed, still)
        rows = rows[~(bad | still)]
        faulty_ns = np.union1d(ground_speed.faulty_ns, np.delete(ground_speed.time_ns, rows))
        kept = replace(
            ground_speed, time_ns=ground_speed.time_ns[rows], values=ground_speed.values[rows], faulty_ns=faulty_ns
        )
        sound["ground_speed"] = replace(kept, count=ground_speed.count - len(ground_speed.values) + len(rows))
        return sound

    def notes(self) -> Iterator[Note]:
        """Yield a note for each channel and kind of fault."""
        for (role, kind), tally in self._found.items():
            facts = {
                "role": role,
                "kind": kind.value,
                "value": tally.value,
                "time_s": tally.time_s,
                "count": tally.count,
                "share": tally.count / self._total[role],
            }
            yield Note(RunCode.SENSOR_FAULT, Severity.DOUBT, facts)

    def _sound(self, chunks: list[Mapping[str, Channel]]) -> Iterator[dict[str, Channel]]:
        """Yield consecutive chunks without their faults, and remember those."""
        bad = self._faulty(_joined(chunks))
        begin: Counter[str] = Counter()
        for chunk in chunks:
            sound = dict(chunk)
            for role in chunk.keys() & bad.keys():
                channel = chunk[role]
                rows = ~bad[role][begin[role] : begin[role] + len(channel)]
                begin[role] += len(channel)
                if not rows.all():
                    sound[role] = replace(channel, time_ns=channel.time_ns[rows], values=channel.values[rows])
            yield sound

    def _faulty(self, channels: Mapping[str, Channel]) -> dict[str, BoolArray]:
        """Return which samples are faulty, of the channels that have any, and remember where."""
        self._flagged |= "ground_speed_valid" in channels
        rows, series = {}, {}
        for role in (name for name in _MEASURED if name in channels):
            self._total[role] += len(channels[role])
            rows[role] = _in_order(channels[role])
            ordered = (channels[role].time_ns[rows[role]], channels[role].values[rows[role]])
            if role != "ground_speed" or not self._flagged:
                rows[role] = rows[role][self._without_marks(role, ordered)]
            if len(rows[role]):
                series[role] = (channels[role].time_ns[rows[role]], channels[role].values[rows[role]])
        early = {role: samples for role, samples in series.items() if role != "ground_speed" or not self._flagged}
        for role, bad in spikes(early, self._radius_m).items():
            self._note(role, FaultKind.SPIKE, series[role], bad)
            rows[role], series[role] = rows[role][~bad], (series[role][0][~bad], series[role][1][~bad])
        for role in series:
            held_long = np.zeros(len(rows[role]), np.bool_)
            for kind, at in held_too_long(role, series, rotating=self._rotating).items():
                self._note(role, kind, series[role], at)
                held_long |= at
            rows[role] = rows[role][~held_long]
        faulty = {}
        for role, kept in rows.items():
            bad = np.isfinite(channels[role].values)
            bad[kept] = False
            if bad.any():
                faulty[role] = bad
                nodes = np.unique(channels[role].time_ns[bad] // self._node_ns) * self._node_ns + self._node_ns // 2
                self._where.setdefault(role, []).append(nodes)
        return faulty

    def _without_marks(self, role: str, series: Series) -> IntArray:
        """Return the rows that are no marks; a value that stands apart is one when it came too often for a shock."""
        time_ns, values = series
        for value in values_apart(values):
            held = held_values((time_ns, (values == value).astype(np.float64)))
            here = self._apart.setdefault((role, value), _Tally(value=value))
            of_value = values[held.start] == value
            here.count += int(of_value.sum())
            here.time_s += float(held.between_s[of_value].sum())
        often = [
            apart.value
            for (of_role, _), apart in self._apart.items()
            if of_role == role and (apart.count >= _MARK_STRETCHES or apart.time_s >= _MARK_S)
        ]
        marks = np.isin(values, often)
        if marks.any() and not marks.all():  # one that lies among others here was a measurement all along
            low, high = values[~marks].min(), values[~marks].max()
            marks &= (values < low) | (values > high)
        self._note(role, FaultKind.MARK, series, marks)
        return np.flatnonzero(~marks)

    def _note(self, role: str, kind: FaultKind, series: Series, rows: BoolArray) -> None:
        if rows.any():
            found = self._found.setdefault((role, kind), _Tally())
            found.count += int(rows.sum())
            found.time_s += float(rows.sum() * np.nan_to_num(mean_interval_ns(np.diff(series[0])))) * 1e-9
            found.value = float(np.quantile(series[1][rows], 0.5, method="nearest"))  # one that came


def _joined(chunks: list[Mapping[str, Channel]]) -> Mapping[str, Channel]:
    if len(chunks) == 1:
        return chunks[0]
    parts: dict[str, list[Channel]] = {}
    for chunk in chunks:
        for role, channel in chunk.items():
            parts.setdefault(role, []).append(channel)
    return {
        role: replace(
            some[0],
            time_ns=np.concatenate([channel.time_ns for channel in some]),
            values=np.concatenate([channel.values for channel in some]),
        )
        for role, some in parts.items()
    }


def _in_order(channel: Channel) -> IntArray:
    """Return the rows of a channel's finite values, in order of time."""
    rows = np.flatnonzero(np.isfinite(channel.values))
    time_ns = channel.time_ns[rows]
    return rows[np.argsort(time_ns, kind="stable")] if np.any(np.diff(time_ns) < 0) else rows
