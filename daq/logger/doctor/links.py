"""What the kernel reports of a SocketCAN interface, and what every bus carries for a while."""

from __future__ import annotations

import errno
import json
import shutil
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from daq import BusSection, ConfigError, Fault, HardwareError, LoggerSection
from daq.can.frames import FrameBatch, concatenate
from daq.sources import SourceCounters, open_source

# linux/sockios.h, linux/if_arp.h, linux/if.h
_SIOCGIFFLAGS, _SIOCGIFMTU, _SIOCGIFHWADDR, _SIOCGIFTXQLEN = 0x8913, 0x8921, 0x8927, 0x8942
_ARPHRD_CAN, _IFF_UP = 280, 1
_NAME_BYTES = 16
_SO_TIMESTAMPNS = 35
_PATH = "/usr/sbin:/sbin:/usr/bin:/bin"

_READ_S = 0.05


@dataclass(frozen=True)
class Link:
    """A network interface; what only ``ip -details`` reports is None where there is no such program.

    Attributes
    ----------
    kernel_has_can : bool
        Whether this kernel knows SocketCAN; asked where there is no such interface.
    mtu, queue_length : int
        72 for CAN FD, 16 without; frames that wait to be sent.
    kind : str or None
        ``"can"`` for a controller, ``"vcan"`` for a virtual bus.
    state : str or None
        Of a controller: ``"ERROR-ACTIVE"``, ``"ERROR-PASSIVE"``, ``"BUS-OFF"``, ``"STOPPED"``, ...
    bitrate, data_bitrate : int or None
        bit/s.
    restart_ms : int or None
        After which a controller that is bus-off tries again; 0: never.
    """

    name: str
    exists: bool = False
    kernel_has_can: bool = True
    is_can: bool = False
    up: bool = False
    mtu: int = 0
    queue_length: int = 0
    kind: str | None = None
    state: str | None = None
    bitrate: int | None = None
    data_bitrate: int | None = None
    restart_ms: int | None = None


def read_link(name: str) -> Link:
    """Ask the kernel of an interface."""
    try:
        flags, mtu, kind, queue = (
            _asked(name, request, form)
            for request, form in (
                (_SIOCGIFFLAGS, "H"),
                (_SIOCGIFMTU, "i"),
                (_SIOCGIFHWADDR, "H"),
                (_SIOCGIFTXQLEN, "i"),
            )
        )
    except OSError:
        return Link(name, kernel_has_can=_kernel_has_can())
    link = Link(name, exists=True, is_can=kind == _ARPHRD_CAN, up=bool(flags & _IFF_UP), mtu=mtu, queue_length=queue)
    return with_details(link, _ip_details(name))


def with_details(link: Link, details: dict[str, Any]) -> Link:
    """Add what an entry of ``ip -details -json link show`` says."""
    info = details.get("linkinfo", {})
    data = info.get("info_data", {})
    return replace(
        link,
        kind=info.get("info_kind"),
        state=data.get("state"),
        bitrate=_rate(data, "bittiming"),
        data_bitrate=_rate(data, "data_bittiming"),
        restart_ms=data.get("restart_ms", 0) if info.get("info_kind") == "can" else None,
    )


def can_links() -> list[str]:
    """Return the names of the CAN interfaces of this machine."""
    names = [name for _, name in socket.if_nameindex()]
    return sorted(name for name in names if _asked(name, _SIOCGIFHWADDR, "H") == _ARPHRD_CAN)


def stamp_age_s(channel: str, wait_s: float) -> float | None:
    """Return how old the kernel's time stamp of the next frame is; NaN without a stamp, None without a frame."""
    with suppress(OSError, AttributeError), socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as made:
        made.bind((channel,))
        made.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        made.settimeout(wait_s)
        _, control, _, _ = made.recvmsg(16, 64)
        now_ns = time.time_ns()
        for level, kind, content in control:
            if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
                seconds, nanoseconds = struct.unpack("=qq", content[:16])
                return float(now_ns - seconds * 10**9 - nanoseconds) * 1e-9
        return float("nan")
    return None


def _kernel_has_can() -> bool:
    """Return whether SocketCAN's sockets can be made; the kernel loads its module where there is one."""
    if not hasattr(socket, "AF_CAN"):  # macOS
        return False
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW):
            return True
    except OSError as error:
        return error.errno not in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT)


def _ip_details(name: str) -> dict[str, Any]:
    program = shutil.which("ip") or shutil.which("ip", path=_PATH)
    if program is None:
        return {}
    command = [program, "-details", "-json", "link", "show", "dev", name]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        found: list[dict[str, Any]] = json.loads(done.stdout or "[]")
    except ValueError:
        return {}  # an iproute2 of before 2018 knows no JSON
    return found[0] if found else {}


def _rate(data: dict[str, Any], key: str) -> int | None:
    """Return a bit rate; adapters with a few fixed ones (slcan) are shown in another way, and 0 before one is set."""
    return data.get(key, {}).get("bitrate") or data.get(f"{key}_bitrate") or None


def _asked(name: str, request: int, form: str) -> int:
    """Return a number of an interface's ``struct ifreq``; `OSError` where there is no such interface.

    A container may have no /sys to read it in.
    """
    import fcntl  # Unix has it; so has every system with SocketCAN

    encoded = name.encode()
    if len(encoded) >= _NAME_BYTES:
        raise OSError(errno.ENODEV, "the name is too long")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as any_socket:
        answer = fcntl.ioctl(any_socket, request, encoded.ljust(40, b"\0"))
    return int(struct.unpack_from(form, answer, _NAME_BYTES)[0])


@dataclass(frozen=True)
class Reception:
    """What came from one bus.

    Attributes
    ----------
    seconds : float
        How long it was listened to.
    counters : SourceCounters or None
        None where it could not be opened.
    fault : Fault or None
        Why it could not be opened, or what ended it.
    stamp_age_s : float or None
        See `daq.logger.doctor.links.stamp_age_s`; None also where the interface is not SocketCAN's.
    """

    section: BusSection
    frames: FrameBatch
    seconds: float = 0.0
    counters: SourceCounters | None = None
    fault: Fault | None = None
    stamp_age_s: float | None = None

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return len(self.frames) / self.seconds if self.seconds else 0.0


def is_socketcan(section: BusSection) -> bool:
    """Whether a bus is one of the kernel's."""
    return section.interface in (None, "socketcan")


def listen(sections: Mapping[str, BusSection], logger: LoggerSection, seconds: float) -> dict[str, Reception]:
    """Listen to all buses at once, with the receive buffer that the logger would ask for."""
    receptions: dict[str, Reception] = {}

    def run(name: str, section: BusSection) -> None:
        receptions[name] = _listen(section, logger, seconds)

    threads = [threading.Thread(target=run, args=item, daemon=True) for item in sections.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return {name: receptions[name] for name in sections}


def _listen(section: BusSection, logger: LoggerSection, seconds: float) -> Reception:
    nothing = FrameBatch.empty((section.channel,))
    try:
        source = open_source(section, logger.receive_buffer_bytes)
    except (ConfigError, HardwareError) as error:
        return Reception(section, nothing, fault=error.faults[0])
    started = time.monotonic()
    batches: list[FrameBatch] = [nothing]
    fault = None
    try:
        while (left_s := started + seconds - time.monotonic()) > 0:
            batches.append(source.read(min(_READ_S, left_s)))
    except HardwareError as error:
        fault = error.faults[0]
    elapsed_s = time.monotonic() - started
    counters = source.counters
    source.close()
    frames = concatenate(batches)
    age_s = stamp_age_s(section.channel, 1.0) if is_socketcan(section) and len(frames) else None
    return Reception(section, frames, elapsed_s, counters, fault, age_s)
