"""Checks of the buses: whether each interface is there, up and set as its bus is, and what came from it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from daq import LEAST_LOAD_SHARE, STANDARD_GRAVITY_MPS2, Channel, nearest
from daq.can import coverage, messages_by_bus
from daq.can.frames import ErrorClass, FrameFlag
from daq.logger.doctor.links import Link, Reception, can_links
from daq.logger.doctor.situation import Line, Situation, failed, from_fault, passed, warned
from daq.logger.health.bus_health import bits_on_wire

_STATES = {
    "ERROR-WARNING": "many frames in error",
    "ERROR-PASSIVE": "so many frames in error that it no longer objects to them: wrong bit rate, termination or cable, "
    "or it is alone on the bus",
}
_WRONG_RATE = (
    "with the wrong one there are error frames or silence, and a controller that is not listen-only disturbs the bus"
)
_LEAST_QUEUE = 10
_LATE_STAMP_S = 1.0
_FD_MTU = 72

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


def interface(now: Situation) -> Iterator[Line]:
    """Check whether the interface is there, allowed and up."""
    for bus, reception in now.receptions.items():
        link = now.links.get(bus)
        kind = reception.section.interface or "socketcan"
        if link is not None and not link.kernel_has_can:
            step = "sudo modprobe can_raw; where there is no such module, another kernel or a python-can interface"
            yield failed(bus, "this kernel has no SocketCAN", step)
        elif link is not None and not link.exists:
            known = nearest(bus, can_links(), label="known: ")
            step = "plug in the adapter, load its driver, or fix `channel` in vehicle.toml; `ip -br link show type can`"
            yield failed(bus, f"there is no interface {bus} ({known})", step)
        elif link is not None and not link.is_can:
            yield failed(
                bus,
                "this is no CAN interface",
                f"name one in vehicle.toml ({nearest(bus, can_links(), label='known: ')})",
            )
        elif link is not None and not link.up:
            yield failed(bus, "the interface is down: nothing can be received", _bring_up(now, bus))
        elif reception.fault is not None:
            yield from_fault(reception.fault, bus)
        else:
            yield passed(bus, f"{kind}, {link.kind or 'CAN'}, up" if link else f"{kind}, opened")


def bit_rate(now: Situation) -> Iterator[Line]:
    """Compare bit rate and CAN FD of the interface with vehicle.toml."""
    for bus, link in _there(now):
        stated, fd = now.sections[bus].bitrate, now.sections[bus].fd
        if fd and link.mtu < _FD_MTU:
            step = f"ip link set {bus} down; ip link set {bus} type can bitrate ... dbitrate ... fd on (vcan: mtu 72)"
            yield failed(bus, "vehicle.toml says CAN FD and the interface is set to classical CAN", step)
        if link.kind == "vcan":
            yield passed(bus, "a virtual bus has no bit rate")
        elif link.kind is None:
            yield warned(bus, "the bit rate of the interface is not known", "install iproute2 (the program `ip`)")
        elif link.bitrate is None:
            yield failed(bus, "the interface has no bit rate", _bring_up(now, bus))
        elif stated is None:
            step = f"state it in vehicle.toml: bitrate = {link.bitrate}, to check it and to compute the bus load"
            yield warned(bus, f"the interface has {link.bitrate} bit/s, vehicle.toml states none", step)
        elif stated != link.bitrate:
            found = f"the interface has {link.bitrate} bit/s, vehicle.toml says {stated}: {_WRONG_RATE}"
            yield failed(bus, found, _bring_up(now, bus))
        else:
            yield passed(bus, f"{link.bitrate} bit/s" + (f", data {link.data_bitrate}" if link.data_bitrate else ""))


def controller(now: Situation) -> Iterator[Line]:
    """Check whether the controller takes part in the bus."""
    for bus, link in _there(now):
        state = link.state
        if state is None or not link.up:
            continue
        if state == "ERROR-ACTIVE":
            yield passed(bus, state)
        elif state in _STATES:
            step = "compare the bit rate, measure 60 ohm between CAN_H and CAN_L, check that another node is on"
            yield warned(bus, f"{state}: {_STATES[state]}", step)
        else:
            step = f"correct the bit rate or the cable, then: ip link set {bus} down; ip link set {bus} up"
            yield failed(bus, f"{state}: the controller takes no part in the bus", step)


def restart(now: Situation) -> Iterator[Line]:
    """Check whether the controller comes back by itself after bus-off."""
    for bus, link in _there(now):
        if link.restart_ms is None:
            continue
        if link.restart_ms:
            yield passed(bus, f"tries again {link.restart_ms} ms after bus-off")
        else:
            step = f"ip link set {bus} down; ip link set {bus} type can restart-ms 100; ip link set {bus} up"
            found = "restart-ms is 0: after one bus-off the interface stays silent for ever (slcan knows no other way)"
            yield warned(bus, found, step)


def send_queue(now: Situation) -> Iterator[Line]:
    """Check how many frames a replay can put into the queue of the interface."""
    for bus, link in _there(now):
        if link.queue_length >= _LEAST_QUEUE:
            yield passed(
                bus, f"txqueuelen {link.queue_length} (a replay waits when it is full, a logger sends nothing)"
            )
        else:
            step = f"ip link set {bus} txqueuelen 1000, if you replay onto it"
            yield warned(bus, f"txqueuelen {link.queue_length}: a replay would wait at each frame", step)


def receive_buffer(now: Situation) -> Iterator[Line]:
    """Check whether the kernel gives the receive buffer that bursts need."""
    wanted = now.vehicle.logger.receive_buffer_bytes
    for bus, reception in now.receptions.items():
        given = reception.counters.buffer_bytes if reception.counters else None
        if reception.counters is None:
            continue
        if given is None:
            yield passed(bus, f"{reception.section.interface} has no receive buffer to set, and does not count losses")
        elif given < wanted:
            found = f"{given} instead of {wanted} bytes: at a pause of the logger frames are lost (and counted)"
            step = f"sudo sysctl net.core.rmem_max={wanted}, for good: deploy/90-wheelsoil.conf into /etc/sysctl.d"
            yield warned(bus, found, step)
        else:
            yield passed(bus, f"{given} bytes")


def time_stamps(now: Situation) -> Iterator[Line]:
    """Check whether the kernel stamps the frames when they arrive."""
    for bus, reception in now.receptions.items():
        age_s = reception.stamp_age_s
        if age_s is None:
            continue
        if math.isnan(age_s):
            yield failed(bus, "frames come without the kernel's time stamp", "use another driver for this adapter")
        elif abs(age_s) > _LATE_STAMP_S:
            step = "use the driver's software stamps, or another adapter"
            yield warned(bus, f"the kernel's stamps are {age_s:.1f} s off the host's clock", step)
        else:
            yield passed(bus, f"stamped by the kernel, read {1e3 * age_s:.2f} ms later")


def _there(now: Situation) -> Iterator[tuple[str, Link]]:
    yield from ((bus, link) for bus, link in now.links.items() if link.is_can)


def _bring_up(now: Situation, bus: str) -> str:
    link, section = now.links[bus], now.sections[bus]
    if link.kind == "vcan":
        return f"ip link set {bus} up"
    rate = section.bitrate or "BITRATE"
    more = " dbitrate DATA_BITRATE fd on" if section.fd else ""
    set_it = f"ip link set {bus} type can bitrate {rate}{more} restart-ms 100"
    return f"ip link set {bus} down; {set_it}; ip link set {bus} up"


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
        elif reference.role == "transducer_status" and values[-1] != 0:
            label = now.channels[role].labels.get(int(values[-1]), "not 0")
            yield warned(role, f"{name} says {values[-1]:g}: {label}", "see the transducer; such samples are excluded")
        else:
            value = f"{(values[-1] - reference.si_offset) / reference.si_factor:.6g} {reference.unit}".strip()
            yield passed(role, f"{value} ({name}, {len(values)} samples)")


def wheel_load(now: Situation) -> Iterator[Line]:
    """Check whether the vertical load is one that a wheel of this vehicle can carry."""
    for role, reference in now.roles.items():
        if reference.role == "vertical_load":
            yield from _load_of(role, now.channels[role], now.vehicle.vehicle.mass_kg)


def _load_of(role: str, channel: Channel, mass_kg: float | None) -> Iterator[Line]:
    if mass_kg is None or not np.isfinite(channel.values).any():
        return
    load_n = float(np.nanmedian(channel.values))
    share = load_n / (mass_kg * STANDARD_GRAVITY_MPS2)
    found = f"{load_n:.4g} N, {share:.2g} of the weight of {mass_kg:g} kg"
    if LEAST_LOAD_SHARE <= share <= 1:
        yield passed(role, found)
    else:
        step = "check its unit, its sign and mass_kg in vehicle.toml, unless the wheel is lifted"
        yield warned(role, found, step)


def _opened(now: Situation) -> Iterator[tuple[str, Reception]]:
    for bus, reception in now.receptions.items():
        if reception.counters is not None and reception.fault is None:
            yield bus, reception


def _data_frames(reception: Reception) -> int:
    return int(np.count_nonzero((reception.frames.frames["flags"] & FrameFlag.ERROR) == 0))
