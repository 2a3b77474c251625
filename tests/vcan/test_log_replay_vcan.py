"""Frames replayed onto a real SocketCAN interface and logged from it come back frame for frame."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from frames_support import some_frames
from vcan import guest
from vcan.guest import GuestResult, run_all_or_skip
from vcan.session import ADD_BUS, WHEELSOIL, check, logged

from daq.can import FrameBatch, FrameFlag, concatenate
from daq.recording import RecordingWriter

pytestmark = pytest.mark.vcan

TESTS = Path(__file__).parents[1]
VEHICLE = """
[vehicle]
name = "test rig"
[[bus]]
channel = "vcan0"
[[bus]]
channel = "vcan1"
"""


def what_can_be_sent() -> FrameBatch:
    """Return 1.5 s of two busy buses: classical, CAN FD, extended and remote frames."""
    frames = some_frames(np.random.default_rng(9), 12_800, rate_hz=8000, buses=("vcan0", "vcan1"))
    return frames[(frames.frames["flags"] & FrameFlag.ERROR) == 0][:12_000]  # no controller sends errors when asked to


TWO_BUSES, BURST = what_can_be_sent(), some_frames(np.random.default_rng(8), 15_000, buses=("vcan1",))
SEND_BURST = """
from daq.sources.player import replay
replay("burst.mcap", speed=None, send_error_frames=True)
"""
BARE = """
import json, subprocess, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from frames_support import classical, some_frames
from daq.errors import HardwareError
from daq.sources.socketcan import SocketCanSink, SocketCanSource
frames = classical(some_frames(np.random.default_rng(1), 20_000)).frames
source, sink = SocketCanSource("vcan0", buffer_bytes=100_000), SocketCanSink("vcan0")
sink.send(frames, 1.0)
received = 0
while batch := source.read(0.1):
    received += len(batch)
    assert all(batch.frames["time_ns"] > 10**18)
print(json.dumps([len(frames), received, source.counters.dropped, source.counters.received]))
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
sink = SocketCanSink("vcan0")
frames = some_frames(np.random.default_rng(1), 50).frames
attempt(lambda: sink.send(frames[(frames["flags"] & 8) != 0], 0.5))
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("vcan")


@pytest.fixture(scope="module")
def results(place: Path) -> dict[str, GuestResult]:
    """What came of the scripts, run one after the other in one guest: a logger starts once, and so do its senders."""
    for name, sent in (("sent", TWO_BUSES), ("burst", BURST)):
        with RecordingWriter(place / f"{name}.mcap") as writer:
            writer.write_frames(sent)
    (place / "vehicle.toml").write_text(VEHICLE, encoding="utf-8")
    for name, script in (("burst", SEND_BURST), ("bare", BARE)):
        (place / f"{name}.py").write_text(script, encoding="utf-8")
    sending = f"{WHEELSOIL} replay sent.mcap --json > replayed.json\n{sys.executable} burst.py"
    scripts = {
        "log": f"{ADD_BUS}\nadd_bus vcan1\n{logged(place, sending)}",
        "bare": f"{sys.executable} {place}/bare.py {TESTS}",
    }
    return run_all_or_skip(scripts, place, timeout_s=180)


def test_two_buses_of_4_kHz_and_a_burst_with_error_frames_come_back(
    results: dict[str, GuestResult], place: Path
) -> None:
    """`wheelsoil replay` sends them onto both buses and `wheelsoil log` records all of them, in order.

    A vcan never makes its sender wait, so a burst is what the receive buffer of 8 MiB must hold.
    """
    assert results["log"].exit_code == 0, results["log"].output
    recording = check(place, concatenate([TWO_BUSES, BURST]))
    replayed = json.loads((place / "replayed.json").read_text())
    assert replayed["recorded_duration_s"] == pytest.approx(_seconds(TWO_BUSES))
    shortest_s = _seconds(TWO_BUSES[TWO_BUSES.frames["bus"] == 0]) - replayed["lateness_max_s"]
    assert shortest_s - 0.01 < _seconds(recording.frames("vcan0")) < replayed["duration_s"] + 0.01


def _seconds(frames: FrameBatch) -> float:
    return float(np.ptp(frames.frames["time_ns"])) / 1e9


def test_what_is_lost_is_counted(results: dict[str, GuestResult]) -> None:
    """A receive buffer that is too small loses frames; received and lost ones make up those sent."""
    assert results["bare"].exit_code == 0, results["bare"].output
    sent, received, dropped, counted = json.loads(results["bare"].output.splitlines()[0])
    assert dropped > 0
    assert received == counted
    assert received + dropped == sent


def test_each_way_to_fail_says_what_to_do(results: dict[str, GuestResult]) -> None:
    said = results["bare"].output
    assert results["bare"].exit_code == 0, said
    assert "there is no interface vcan7" in said
    assert "nearest: vcan0" in said
    assert "the interface is down" in said
    assert "ip link set vcan0 up" in said
    assert "it may not be a CAN FD one" in said


def test_a_script_without_end_is_ended(tmp_path: Path) -> None:
    """With all that it started; a guest is a process as well."""
    script = f"sleep 600 & echo $! > {tmp_path}/started; sleep 600"
    assert guest._wait(["sh", "-c", script], tmp_path, dict(os.environ), 2.0) == 124
    state = Path(f"/proc/{(tmp_path / 'started').read_text().strip()}/stat")
    assert not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z"  # not yet waited for
