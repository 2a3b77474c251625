"""Health of one bus: its traffic, load and error frames (linux/can/error.h), and its faults.

A bus is down, silent, losing frames, in error, or carries what no DBC describes.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator

import numpy as np

from daq.arrays import FloatArray
from daq.can.frames import ErrorClass, FrameArray, FrameFlag
from daq.logger.health.report import (
    RECENT_NS,
    BusHealth,
    HostStatus,
    Level,
    Reason,
    Recent,
    reason,
    worst,
)
from daq.sources.can_source import BusStatus

_OVERFLOW, _WARNING, _PASSIVE, _ACTIVE = 0x01, 0x0C, 0x30, 0x40
_PROTOCOL_NAMES = {
    0x01: "bit",
    0x02: "form",
    0x04: "stuff",
    0x08: "bit (dominant)",
    0x10: "bit (recessive)",
    0x20: "overload",
}
_STATE_HOLDS_NS = 30_000_000_000
"""Not every driver says when the controller is well again."""

_RATE_OVER_NS = 1_000_000_000
_IDS_KEPT = 64
_IDS_COUNTED = 256
_STUFFED_EVERY = 30
"""Random bits get a stuff bit after 31 bits for the first, then after 30 each; constant ones after 4."""

_ACTIVE_FOR_NS = 500_000_000
_SILENT_AFTER_NS, _SILENT_FROM_START_NS = 2_000_000_000, 5_000_000_000
_UNKNOWN_SHARE = 0.05
_BEHIND = 0.25
_RETURN_REPORTED_NS = 60_000_000_000


class ErrorFrames:
    """Follows the error frames of one bus."""

    def __init__(self) -> None:
        self.count = 0
        self._classes: Counter[str] = Counter()
        self._protocol: Counter[str] = Counter()
        self._state: tuple[str, int] = ("", 0)
        self._counters = (0, 0)
        self._recent = {name: Recent() for name in ("no_ack", "protocol", "overflow", "other")}

    def take(self, errors: FrameArray) -> None:
        """Take error frames in order."""
        self.count += len(errors)
        classes, data = errors["can_id"], errors["data"]
        controller = np.where(classes & ErrorClass.CONTROLLER, data[:, 1], 0)
        protocol = (classes & (ErrorClass.PROTOCOL | ErrorClass.BUS_ERROR)) != 0
        no_ack = (classes & ErrorClass.NO_ACK) != 0
        overflow = (controller & _OVERFLOW) != 0
        about_state = (controller & (_WARNING | _PASSIVE | _ACTIVE)) != 0
        about_state |= (classes & (ErrorClass.BUS_OFF | ErrorClass.RESTARTED)) != 0
        known = no_ack | protocol | overflow | about_state | ((classes & ErrorClass.LOST_ARBITRATION) != 0)
        for name, rows in (("no_ack", no_ack), ("protocol", protocol), ("overflow", overflow), ("other", ~known)):
            self._classes[name] += int(np.count_nonzero(rows))
        for bit, name in _PROTOCOL_NAMES.items():
            self._protocol[name] += int(np.count_nonzero(protocol & ((data[:, 2] & bit) != 0)))
        if about_state.any():
            last = int(np.flatnonzero(about_state)[-1])
            self._state = (_state(int(classes[last]), int(controller[last])), int(errors["time_ns"][last]))
            self._counters = (int(data[last, 6]), int(data[last, 7]))

    def reasons(self, bus: str, now_ns: int, last_data_ns: int | None) -> Iterator[Reason]:
        """Yield what the last seconds' error frames mean; a bus with a later data frame is not off any more."""
        yield from self._state_reasons(bus, now_ns, last_data_ns)
        recent = {name: self._recent[name].take(now_ns, self._classes[name]) for name in self._recent}
        if recent["overflow"]:
            what = (
                f"the controller lost frames {recent['overflow']} times in the last 10 s: it was not read fast enough"
            )
            yield reason("controller_overflow", Level.RED, bus, what)
        if recent["no_ack"]:
            what = f"{recent['no_ack']} frames of this machine had no acknowledgement in the last 10 s"
            yield reason("bus_no_ack", Level.AMBER, bus, what)
        if recent["protocol"]:
            kinds = ", ".join(name for name, _ in self._protocol.most_common(2) if self._protocol[name])
            what = f"{recent['protocol']} protocol errors in the last 10 s" + (f", mostly {kinds}" if kinds else "")
            yield reason("bus_errors", Level.AMBER, bus, what)
        if recent["other"]:
            yield reason("bus_errors", Level.AMBER, bus, f"{recent['other']} error frames in the last 10 s")

    def _state_reasons(self, bus: str, now_ns: int, last_data_ns: int | None) -> Iterator[Reason]:
        state, since_ns = self._state
        if state == "off" and (last_data_ns is None or last_data_ns <= since_ns):
            what = f"the controller has been off the bus for {(now_ns - since_ns) * 1e-9:.0f} s"
            yield reason("bus_off", Level.RED, bus, what)
        elif state in ("passive", "warning") and now_ns - since_ns < _STATE_HOLDS_NS:
            sent, received = self._counters
            counted = f" (error counters: {sent} sending, {received} receiving)" if sent or received else ""
            text = "is error passive" if state == "passive" else "warns of many errors"
            yield reason(f"bus_error_{state}", Level.AMBER, bus, f"the controller {text}{counted}")


def _state(classes: int, controller: int) -> str:
    if classes & ErrorClass.BUS_OFF:
        return "off"
    if controller & _PASSIVE:
        return "passive"
    return "warning" if controller & _WARNING else ""


def bits_on_wire(frames: FrameArray) -> FloatArray:
    """Return the bits that frames take on the bus, with the space behind them.

    Classical frame with n data bytes: 34 + 8 n bits (54 + 8 n with a 29-bit identifier) from start of frame to CRC
    that are stuffed, 13 more to the end of the interframe space. CAN FD: 22 + 8 n (41 + 8 n) stuffed bits, 4 of stuff
    count, a CRC of 17 or 21 with a fixed stuff bit for every 4, and 13. To the stuffed ones comes a bit for every 30,
    as random content has it. All zeros would have one for every 4: the load may be up to a fifth higher.

    Shape (n,); NaN for CAN FD frames whose data have a bit rate of their own.
    """
    flags = frames["flags"]
    data = np.where(flags & FrameFlag.REMOTE, 0, frames["length"].astype(np.float64)) * 8
    long_id = (flags & FrameFlag.EXTENDED) != 0
    stuffed = data + np.where(long_id, 54.0, 34.0)
    bits = stuffed * (1 + 1 / _STUFFED_EVERY) + 13
    fd = (flags & FrameFlag.FD) != 0
    if fd.any():
        stuffed = data + np.where(long_id, 41.0, 22.0)
        checked = np.where(frames["length"] > 16, 25 + 7, 21 + 6)
        bits = np.where(fd, stuffed * (1 + 1 / _STUFFED_EVERY) + checked + 13, bits)
        bits[fd & ((flags & FrameFlag.BITRATE_SWITCH) != 0)] = np.nan
    return bits


class BusTraffic:
    """Counts what comes on a bus; bounded in memory whatever comes."""

    def __init__(self) -> None:
        self.frames = 0
        self.known = 0
        self.unknown = 0
        self.errors = ErrorFrames()
        self.last_ns: int | None = None
        self.last_data_ns: int | None = None
        self._bits = 0.0
        self._unmeasured = 0
        self._ids: Counter[tuple[int, bool]] = Counter()
        self._past: deque[tuple[int, int, float, int, int, int]] = deque()

    def take(self, frames: FrameArray, unknown: FrameArray) -> None:
        """Take frames of this bus, and again those data frames of them that no DBC describes."""
        if not len(frames):
            return
        self.last_ns = max(int(frames["time_ns"].max()), self.last_ns or 0)
        self.frames += len(frames)
        self.unknown += len(unknown)
        flags = frames["flags"]
        if np.bitwise_or.reduce(flags) & FrameFlag.ERROR:
            is_error = (flags & FrameFlag.ERROR) != 0
            self.errors.take(frames[is_error])
            frames = frames[~is_error]
        self.known += int(np.count_nonzero((frames["flags"] & FrameFlag.REMOTE) == 0)) - len(unknown)
        if len(frames):
            self.last_data_ns = max(int(frames["time_ns"].max()), self.last_data_ns or 0)
        bits = bits_on_wire(frames)
        unmeasured = np.isnan(bits)
        self._unmeasured += int(np.count_nonzero(unmeasured))
        self._bits += float(bits.sum(where=~unmeasured))
        self._count_unknown(unknown[:_IDS_COUNTED])

    def ids(self) -> list[str]:
        """Return the most frequent identifiers that no DBC knows, of those that were counted."""
        return [f"0x{i:08X}" if extended else f"0x{i:03X}" for (i, extended), _ in self._ids.most_common(5)]

    def rates(self, now_ns: int) -> tuple[float, float, float]:
        """Return frames per second, bits per second and the share of unknown frames over about the last second."""
        self._past.append((now_ns, self.frames, self._bits, self._unmeasured, self.unknown, self.known))
        while len(self._past) > 2 and now_ns - self._past[1][0] >= _RATE_OVER_NS:
            self._past.popleft()
        since_ns, frames, bits, unmeasured, unknown, known = self._past[0]
        elapsed_s = (now_ns - since_ns) * 1e-9
        if elapsed_s <= 0:
            return float("nan"), float("nan"), 0.0
        described = self.known - known + self.unknown - unknown
        share = (self.unknown - unknown) / described if described else 0.0
        bit_rate = float("nan") if self._unmeasured > unmeasured else (self._bits - bits) / elapsed_s
        return (self.frames - frames) / elapsed_s, bit_rate, share

    def _count_unknown(self, unknown: FrameArray) -> None:
        """Count identifiers in a sample of the unknown frames; those that came first are kept."""
        extended = (unknown["flags"] & FrameFlag.EXTENDED) != 0
        keys, numbers = np.unique(unknown["can_id"].astype(np.int64) << 1 | extended, return_counts=True)
        for key, number in zip(keys.tolist(), numbers.tolist(), strict=True):
            place = (key >> 1, bool(key & 1))
            if place in self._ids or len(self._ids) < _IDS_KEPT:
                self._ids[place] += number


class BusWatch:
    """Follows one bus from report to report.

    The bus is `described` where a DBC describes it and `has_roles` where a role's signal is on it; `may_be_unknown` is
    whether it may carry what no DBC knows.
    """

    def __init__(
        self,
        name: str,
        bit_rate: int | None,
        *,
        described: bool,
        has_roles: bool,
        may_be_unknown: bool,
        started_ns: int,
    ) -> None:
        self.name = name
        self.traffic = BusTraffic()
        self.status = BusStatus("up", 0, None)
        self._bit_rate = bit_rate
        self._described = described
        self._judge_ids = described and not may_be_unknown
        self._level = Level.RED if has_roles else Level.AMBER
        self._started_ns = self._away_ns = started_ns
        self._kernel, self._queue, self._returns = Recent(), Recent(), Recent()

    def active(self, now_ns: int) -> bool:
        """Whether it is carrying frames, so that a missing message is a matter of its own."""
        return self.traffic.last_ns is not None and now_ns - self.traffic.last_ns < _ACTIVE_FOR_NS

    def fits(self, now_ns: int) -> bool:
        """Whether a message of its DBCs has come; True while it is too early to decide."""
        early = now_ns - self._started_ns < _SILENT_FROM_START_NS
        return early or not self._described or not self.traffic.frames or self.traffic.known > 0

    def health(self, now_ns: int, host: HostStatus) -> tuple[BusHealth, list[Reason]]:
        """Return the state of the bus and what is wrong with it."""
        traffic = self.traffic
        self.status = host.buses.get(self.name, BusStatus("up", traffic.frames, None))
        if self.status.state != "up":
            self._away_ns = now_ns
        rate_hz, bit_rate, unknown = traffic.rates(now_ns)
        found = [*self._state(now_ns, host), *self._drops(now_ns)]
        if self.status.state == "up":
            found += traffic.errors.reasons(self.name, now_ns, traffic.last_data_ns)
        found += self._unknown(now_ns, unknown)
        state = BusHealth(
            name=self.name,
            level=worst(found),
            status=self.status,
            rate_hz=rate_hz,
            load=bit_rate / self._bit_rate if self._bit_rate else math.nan,
            age_s=math.nan if traffic.last_ns is None else (now_ns - traffic.last_ns) * 1e-9,
            error_frames=traffic.errors.count,
            unknown_frames=traffic.unknown,
        )
        return state, found

    def losses(self) -> dict[str, int]:
        """Return what was lost on the bus, by who lost it."""
        return {f"kernel.{self.name}": self.status.kernel_drops or 0, f"queue.{self.name}": self.status.queue_drops}

    def _state(self, now_ns: int, host: HostStatus) -> Iterator[Reason]:
        status = self.status
        self._returns.take(now_ns, status.reconnects)
        if status.state == "down":
            yield reason("bus_down", self._level, self.name, status.detail or "the interface is down")
        elif status.state == "bus_off":
            yield reason("bus_off", self._level, self.name, status.detail or "the controller is off the bus")
        else:
            yield from self._silence(now_ns, host)
            if self._returns.last_ns is not None and now_ns - self._returns.last_ns < _RETURN_REPORTED_NS:
                what = f"the bus was lost and came back, {status.reconnects} times so far"
                yield reason("bus_returned", Level.AMBER, self.name, what)

    def _silence(self, now_ns: int, host: HostStatus) -> list[Reason]:
        last_ns = self.traffic.last_data_ns
        quiet_ns = now_ns - max(self._away_ns, last_ns or 0)
        limit_ns = _SILENT_FROM_START_NS if last_ns is None else _SILENT_AFTER_NS
        if quiet_ns < limit_ns or host.queue_share > _BEHIND:
            return []
        what = (
            f"no frame for {quiet_ns * 1e-9:.1f} s"
            if last_ns
            else f"no frame since the start {quiet_ns * 1e-9:.0f} s ago"
        )
        return [reason("bus_silent", self._level, self.name, what)]

    def _drops(self, now_ns: int) -> Iterator[Reason]:
        for code, recent, count in (
            ("kernel_drops", self._kernel, self.status.kernel_drops or 0),
            ("queue_drops", self._queue, self.status.queue_drops),
        ):
            now = recent.take(now_ns, count)
            if count:
                level = Level.RED if now else Level.AMBER
                what = f"lost {count} frames so far, {now} of them in the last {RECENT_NS * 1e-9:.0f} s"
                yield reason(code, level, self.name, what)

    def _unknown(self, now_ns: int, share: float) -> list[Reason]:
        ids = ", ".join(self.traffic.ids())
        if not self.fits(now_ns):
            what = f"none of the DBC's messages has come, but {self.traffic.frames} frames, e.g. {ids}"
            return [reason("dbc_does_not_fit", Level.AMBER, self.name, what)]
        early = now_ns - self._started_ns < _SILENT_FROM_START_NS
        if early or not self._judge_ids or share <= _UNKNOWN_SHARE:
            return []
        what = f"{100 * share:.0f} % of the frames are in no DBC, e.g. {ids}"
        return [reason("unknown_frames", Level.AMBER, self.name, what)]
