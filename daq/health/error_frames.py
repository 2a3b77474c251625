"""Error frames of SocketCAN: what the controller says of itself and of the bus (linux/can/error.h)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from daq.frames import ErrorClass, FrameArray
from daq.health.board import Recent, reason
from daq.health.report import Level, Reason

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
        told = no_ack | protocol | overflow | about_state | ((classes & ErrorClass.LOST_ARBITRATION) != 0)
        for name, rows in (("no_ack", no_ack), ("protocol", protocol), ("overflow", overflow), ("other", ~told)):
            self._classes[name] += int(np.count_nonzero(rows))
        for bit, name in _PROTOCOL_NAMES.items():
            self._protocol[name] += int(np.count_nonzero(protocol & ((data[:, 2] & bit) != 0)))
        if about_state.any():
            last = int(np.flatnonzero(about_state)[-1])
            self._state = (_state(int(classes[last]), int(controller[last])), int(errors["time_ns"][last]))
            self._counters = (int(data[last, 6]), int(data[last, 7]))

    def reasons(self, bus: str, now_ns: int, last_data_ns: int | None) -> list[Reason]:
        """Return what the last seconds' error frames mean.

        Parameters
        ----------
        bus : str
        now_ns : int
        last_data_ns : int or None
            When the last data frame came: a bus that carries some is not off any more.
        """
        found = self._state_reasons(bus, now_ns, last_data_ns)
        recent = {name: self._recent[name].take(now_ns, self._classes[name]) for name in self._recent}
        if recent["overflow"]:
            what = (
                f"the controller lost frames {recent['overflow']} times in the last 10 s: it was not read fast enough"
            )
            found.append(reason("controller_overflow", Level.RED, bus, what))
        if recent["no_ack"]:
            what = f"{recent['no_ack']} frames of ours had no acknowledgement in the last 10 s"
            found.append(reason("bus_no_ack", Level.AMBER, bus, what))
        if recent["protocol"]:
            kinds = ", ".join(name for name, _ in self._protocol.most_common(2) if self._protocol[name])
            what = f"{recent['protocol']} protocol errors in the last 10 s" + (f", mostly {kinds}" if kinds else "")
            found.append(reason("bus_errors", Level.AMBER, bus, what))
        if recent["other"]:
            what = f"{recent['other']} error frames in the last 10 s"
            found.append(reason("bus_errors", Level.AMBER, bus, what))
        return found

    def _state_reasons(self, bus: str, now_ns: int, last_data_ns: int | None) -> list[Reason]:
        state, since_ns = self._state
        if state == "off" and (last_data_ns is None or last_data_ns <= since_ns):
            what = f"the controller has been off the bus for {(now_ns - since_ns) * 1e-9:.0f} s"
            return [reason("bus_off", Level.RED, bus, what)]
        if state in ("passive", "warning") and now_ns - since_ns < _STATE_HOLDS_NS:
            sent, received = self._counters
            counted = f" (error counters: {sent} sending, {received} receiving)" if sent or received else ""
            said = "is error passive" if state == "passive" else "warns of many errors"
            return [reason(f"bus_error_{state}", Level.AMBER, bus, f"the controller {said}{counted}")]
        return []


def _state(classes: int, controller: int) -> str:
    if classes & ErrorClass.BUS_OFF:
        return "off"
    if controller & _PASSIVE:
        return "passive"
    return "warning" if controller & _WARNING else ""
