"""Checks of what came from the buses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from daq.can.databases import messages_by_bus
from daq.can.frames import ErrorClass, FrameFlag
from daq.can.identify import coverage
from daq.can.roles import SignalRef
from daq.logger.doctor.links import Reception
from daq.logger.doctor.situation import Line, Situation, failed, passed, warned
from daq.logger.health.traffic import bits_on_wire

_HIGH_LOAD = 0.8
_MANY_ERRORS = 0.01
_IDS_LISTED = 8
_KNOWN_ENOUGH = 0.5
_CLASSES = (
    (ErrorClass.PROTOCOL, "protocol"),
    (ErrorClass.NO_ACK, "no acknowledgement"),
    (ErrorClass.BUS_OFF, "bus-off"),
    (ErrorClass.CONTROLLER, "controller"),
)
_SILENCE = (
    "that the ignition is on and a node is sending, the bit rate (with a wrong one a listen-only interface is silent), "
    "CAN_H and CAN_L not swapped, 60 ohm between them"
)


def arrivals(now: Situation) -> Iterator[Line]:
    """Check whether frames come and the kernel keeps all of them."""
    for bus, reception in _opened(now):
        dropped = (reception.counters.dropped if reception.counters else None) or 0
        count = f"{len(reception.frames)} frames in {reception.seconds:.1f} s, {reception.rate_hz:.0f}/s"
        if not _data_frames(reception):
            yield failed(bus, f"silent: no frame in {reception.seconds:.1f} s", f"check {_SILENCE}")
        elif dropped:
            step = "a bigger receive buffer, and nothing else on this machine that takes the processor"
            yield failed(bus, f"{count}, {dropped} lost by the kernel", step)
        else:
            yield passed(bus, count)


def load(now: Situation) -> Iterator[Line]:
    """Check how full the bus is."""
    for bus, reception in _opened(now):
        rate = reception.section.bitrate
        if rate is None or not len(reception.frames):
            continue
        share = float(bits_on_wire(reception.frames.frames).sum()) / reception.seconds / rate
        if not np.isfinite(share):
            yield passed(bus, "not computed: CAN FD frames send their data at another bit rate")
        elif share > 1:
            found = f"{share:.0%} of {rate} bit/s: more than the bus can carry"
            yield failed(bus, found, "correct bitrate in vehicle.toml; the bus is faster than it says")
        elif share > _HIGH_LOAD:
            yield warned(bus, f"{share:.0%} of {rate} bit/s", "low-priority messages will come late; send fewer")
        else:
            yield passed(bus, f"{share:.0%} of {rate} bit/s")


def error_frames(now: Situation) -> Iterator[Line]:
    """Check whether there are error frames."""
    for bus, reception in _opened(now):
        frames = reception.frames.frames
        errors = frames[(frames["flags"] & FrameFlag.ERROR) != 0]
        if not len(errors):
            yield passed(bus, "none")
            continue
        kinds = [name for bit, name in _CLASSES if np.any(errors["can_id"] & bit)]
        found = f"{len(errors)} ({', '.join(kinds) or 'other'}) beside {_data_frames(reception)} good frames"
        step = "compare the bit rate, check the termination (60 ohm) and the plugs"
        many = len(errors) > _MANY_ERRORS * len(frames)
        yield failed(bus, found, step) if many else warned(bus, found, step)


def dbc_coverage(now: Situation) -> Iterator[Line]:
    """Check whether the DBCs describe what is on the bus."""
    for bus, reception in _opened(now):
        if not now.databases.get(bus) or not _data_frames(reception):
            continue
        rows = coverage(reception.frames, now.databases).ids
        total = sum(row.frames for row in rows)
        known = sum(row.frames for row in rows if row.message is not None) / max(total, 1)
        unknown = Counter({(r.can_id, r.extended): r.frames for r in rows if r.message is None}).most_common()
        listed = [f"0x{i:08X} ({n})" if extended else f"0x{i:03X} ({n})" for (i, extended), n in unknown[:_IDS_LISTED]]
        found = f"{known:.0%} of the frames known"
        if unknown:
            more = f", and {len(unknown) - _IDS_LISTED} more" if len(unknown) > _IDS_LISTED else ""
            found += f"; unknown, most frequent first: {', '.join(listed)}{more}"
        if known == 0:
            yield failed(
                bus, found, "this DBC does not fit this bus: correct dbc in vehicle.toml, or swap the channels"
            )
        elif known < _KNOWN_ENOUGH:
            yield warned(bus, found, "fine if those are other nodes' frames; they are recorded raw in any case")
        else:
            yield passed(bus, found)


def silent_messages(now: Situation) -> Iterator[Line]:
    """Check whether every message of the DBCs comes."""
    merged = messages_by_bus(now.databases)
    for bus, reception in _opened(now):
        messages = merged.get(bus, {})
        if not messages or not _data_frames(reception):
            continue
        received = {row.message for row in coverage(reception.frames, now.databases).ids}
        silent = [name for name in messages if name not in received and name not in now.vehicle.health.may_be_silent]
        if silent:
            found = f"{len(silent)} of {len(messages)} messages never came: {', '.join(silent[:_IDS_LISTED])}"
            step = "check their senders; a message that may be silent goes into [health] may_be_silent"
            yield warned(bus, found + (", ..." if len(silent) > _IDS_LISTED else ""), step)
        else:
            yield passed(bus, f"all {len(messages)} messages came")


def role_values(now: Situation) -> Iterator[Line]:
    """Check whether the signal of each role came, and its last value."""
    active = {bus for bus, reception in now.receptions.items() if _data_frames(reception)}
    for role, reference in now.roles.items():
        if reference.bus not in active:
            continue
        values = now.channels[role].values
        name = f"{reference.bus}: {reference.name}"
        if not len(values):
            yield failed(role, f"{name} did not come", "check its sender, and [signals] in vehicle.toml")
        elif not np.isfinite(values[-1]):
            yield warned(role, f"{name} came without data (not available)", "wait until its sender is ready")
        elif role == "transducer_status" and values[-1] != 0:
            label = now.channels[role].labels.get(int(values[-1]), "not 0")
            yield warned(role, f"{name} says {values[-1]:g}: {label}", "see the transducer; such samples are excluded")
        else:
            yield passed(role, f"{_value_text(values[-1], reference)} ({name}, {len(values)} samples)")


def _value_text(value_si: float, reference: SignalRef) -> str:
    """Return a value in the DBC's unit, as the status page shows it."""
    return f"{(value_si - reference.si_offset) / reference.si_factor:.6g} {reference.unit}".strip()


def _opened(now: Situation) -> Iterator[tuple[str, Reception]]:
    for bus, reception in now.receptions.items():
        if reception.counters is not None and reception.fault is None:
            yield bus, reception


def _data_frames(reception: Reception) -> int:
    return int(np.count_nonzero((reception.frames.frames["flags"] & FrameFlag.ERROR) == 0))
