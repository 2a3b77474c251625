"""Checks of the interfaces: whether they are there, up, and set as the bus is."""

from __future__ import annotations

import math
from collections.abc import Iterator

from daq.errors import nearest
from daq.logger.doctor.links import Link, can_links
from daq.logger.doctor.situation import Line, Situation, failed, from_fault, passed, warned

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


def interface(now: Situation) -> Iterator[Line]:
    """Check whether the interface is there, allowed and up."""
    for bus, reception in now.receptions.items():
        link = now.links.get(bus)
        kind = reception.section.interface or "socketcan"
        if link is not None and not link.kernel_has_can:
            step = "sudo modprobe can_raw; where there is no such module, another kernel or a python-can interface"
            yield failed(bus, "this kernel has no SocketCAN", step)
        elif link is not None and not link.exists:
            known = nearest(bus, can_links())
            step = "plug in the adapter, load its driver, or fix `channel` in vehicle.toml; `ip -br link show type can`"
            yield failed(bus, f"there is no interface {bus} ({known})", step)
        elif link is not None and not link.is_can:
            yield failed(bus, "this is no CAN interface", f"name one in vehicle.toml ({nearest(bus, can_links())})")
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
