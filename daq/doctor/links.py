"""What the kernel says of a SocketCAN interface."""

from __future__ import annotations

import json
import shutil
import socket
import struct
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

_NET = Path("/sys/class/net")
_ARPHRD_CAN, _IFF_UP = 280, 1
_SO_TIMESTAMPNS = 35
_PATH = "/usr/sbin:/sbin:/usr/bin:/bin"


@dataclass(frozen=True)
class Link:
    """A network interface; what only ``ip -details`` tells is None where there is no such program.

    Attributes
    ----------
    name : str
    exists, is_can, up : bool
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
    folder = _NET / name
    if "/" in name or not folder.is_dir():
        return Link(name)
    link = Link(
        name,
        exists=True,
        is_can=_number(folder / "type") == _ARPHRD_CAN,
        up=bool(_number(folder / "flags") & _IFF_UP),
        mtu=_number(folder / "mtu"),
        queue_length=_number(folder / "tx_queue_len"),
    )
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
    names = [folder.name for folder in _NET.iterdir()] if _NET.is_dir() else []
    return sorted(name for name in names if _number(_NET / name / "type") == _ARPHRD_CAN)


def stamp_age_s(channel: str, wait_s: float) -> float | None:
    """Return how old the kernel's time stamp of the next frame is; NaN without a stamp, None without a frame."""
    with suppress(OSError), socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as made:
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


def _ip_details(name: str) -> dict[str, Any]:
    program = shutil.which("ip") or shutil.which("ip", path=_PATH)
    if program is None:
        return {}
    command = [program, "-details", "-json", "link", "show", "dev", name]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=10)
    try:
        found: list[dict[str, Any]] = json.loads(done.stdout or "[]")
    except ValueError:
        return {}  # an iproute2 of before 2018 knows no JSON
    return found[0] if found else {}


def _rate(data: dict[str, Any], key: str) -> int | None:
    """Return a bit rate; adapters with a few fixed ones (slcan) are shown in another way, and 0 before one is set."""
    return data.get(key, {}).get("bitrate") or data.get(f"{key}_bitrate") or None


def _number(path: Path) -> int:
    try:
        return int(path.read_text().strip(), 0)
    except (OSError, ValueError):
        return 0
