"""Frames replayed onto a real SocketCAN interface and logged from it come back frame for frame."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames_support import some_frames
from vcan.guest import GuestResult
from vcan.session import ADD_BUS, WHEELSOIL, check, logged

from daq.frames import FrameBatch, FrameFlag
from daq.recording import RecordingWriter

pytestmark = pytest.mark.vcan

VEHICLE = """
[vehicle]
name = "test rig"
[[bus]]
channel = "vcan0"
"""


def replayed(folder: Path, sent: FrameBatch, channels: str) -> str:
    with RecordingWriter(folder / "sent.mcap") as writer:
        writer.write_frames(sent)
    return f"{WHEELSOIL} replay sent.mcap {channels}"


def what_can_be_sent(seed: int, buses: tuple[str, ...]) -> FrameBatch:
    """Return 3 s of a busy bus, or of two: classical, CAN FD, extended and remote frames."""
    frames = some_frames(np.random.default_rng(seed), 25_500, rate_hz=8000, buses=buses)
    return frames[(frames.frames["flags"] & FrameFlag.ERROR) == 0][:24_000]  # no controller sends errors when asked to


def test_24000_frames_at_8_kHz_come_back(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    """`wheelsoil replay` sends them onto vcan0 and `wheelsoil log` records all of them, in order."""
    sent = what_can_be_sent(7, ("vcan0",))
    (tmp_path / "vehicle.toml").write_text(VEHICLE, encoding="utf-8")

    result = vcan(logged(tmp_path, replayed(tmp_path, sent, "")), timeout_s=90)

    assert result.exit_code == 0, result.output
    first_ns, last_ns = check(tmp_path, sent).time_range_ns or (0, 0)
    assert 3.0 < (last_ns - first_ns) / 1e9 < 6.0


def test_two_buses_of_4_kHz_come_back(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    sent = what_can_be_sent(9, ("vcan0", "vcan1"))
    (tmp_path / "vehicle.toml").write_text(f'{VEHICLE}[[bus]]\nchannel = "vcan1"\n', encoding="utf-8")

    result = vcan(f"{ADD_BUS}\nadd_bus vcan1\n{logged(tmp_path, replayed(tmp_path, sent, ''))}", timeout_s=90)

    assert result.exit_code == 0, result.output
    check(tmp_path, sent)


def test_a_burst_with_error_frames_comes_back(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    """A vcan never makes its sender wait, so a burst is what the receive buffer of 8 MiB must hold."""
    sent = some_frames(np.random.default_rng(8), 15_000)
    (tmp_path / "vehicle.toml").write_text(VEHICLE, encoding="utf-8")
    (tmp_path / "send.py").write_text(
        "from daq.replay import replay\n"
        "replay('sent.mcap', channels={'can0': 'vcan0'}, speed=None, send_error_frames=True)\n",
        encoding="utf-8",
    )
    with RecordingWriter(tmp_path / "sent.mcap") as writer:
        writer.write_frames(sent)

    result = vcan(logged(tmp_path, f"{sys.executable} send.py"))

    assert result.exit_code == 0, result.output
    check(tmp_path, sent)


def test_what_is_lost_is_counted(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    """A receive buffer that is too small loses frames; received and lost ones make up those sent."""
    (tmp_path / "lose.py").write_text(
        """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from frames_support import classical, some_frames
from daq.socketcan import SocketCanSink, SocketCanSource
frames = classical(some_frames(np.random.default_rng(1), 20_000)).frames
source, sink = SocketCanSource("vcan0", buffer_bytes=100_000), SocketCanSink("vcan0")
sink.send(frames, 1.0)
received = 0
while batch := source.read(0.1):
    received += len(batch)
    assert all(batch.frames["time_ns"] > 10**18)
print(json.dumps([len(frames), received, source.counters.dropped, source.counters.received]))
""",
        encoding="utf-8",
    )
    tests = Path(__file__).parents[1]

    result = vcan(f"{sys.executable} {tmp_path}/lose.py {tests}")

    assert result.exit_code == 0, result.output
    sent, received, dropped, counted = json.loads(result.output)
    assert dropped > 0
    assert received == counted
    assert received + dropped == sent


def test_each_way_to_fail_says_what_to_do(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    (tmp_path / "fail.py").write_text(
        """
import subprocess
from daq.errors import HardwareError
from daq.socketcan import SocketCanSink, SocketCanSource
def attempt(act):
    try:
        act()
    except HardwareError as error:
        print(error)
attempt(lambda: SocketCanSource("vcan7"))
source = SocketCanSource("vcan0")
subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
attempt(lambda: source.read(1.0))
subprocess.run(["ip", "link", "set", "vcan0", "mtu", "16"], check=True)
subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
from frames_support import some_frames
sink = SocketCanSink("vcan0")
frames = some_frames(np.random.default_rng(1), 50).frames
attempt(lambda: sink.send(frames[(frames["flags"] & 8) != 0], 0.5))
""",
        encoding="utf-8",
    )

    result = vcan(f"{sys.executable} {tmp_path}/fail.py {Path(__file__).parents[1]}")

    assert result.exit_code == 0, result.output
    assert "there is no interface vcan7" in result.output
    assert "nearest: vcan0" in result.output
    assert "the interface is down" in result.output
    assert "ip link set vcan0 up" in result.output
    assert "it may not be a CAN FD one" in result.output


def test_a_script_without_end_is_ended(vcan: Callable[..., GuestResult]) -> None:
    result = vcan("echo begun; sleep 600", timeout_s=6)
    assert result.exit_code == 124
    assert result.output == "begun\n"
