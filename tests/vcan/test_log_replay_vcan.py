"""Frames replayed onto a real SocketCAN interface and logged from it come back frame for frame."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames_support import some_frames
from vcan.guest import GuestResult, run_all_or_skip
from vcan.session import ADD_BUS, WHEELSOIL, check, logged

from daq.can.frames import FrameBatch, FrameFlag
from daq.recording import RecordingWriter

pytestmark = pytest.mark.vcan

TESTS = Path(__file__).parents[1]
VEHICLE = """
[vehicle]
name = "test rig"
[[bus]]
channel = "vcan0"
"""


def replayed(folder: Path, sent: FrameBatch) -> str:
    with RecordingWriter(folder / "sent.mcap") as writer:
        writer.write_frames(sent)
    return f"{WHEELSOIL} replay sent.mcap"


def what_can_be_sent(seed: int, buses: tuple[str, ...]) -> FrameBatch:
    """Return 3 s of a busy bus, or of two: classical, CAN FD, extended and remote frames."""
    frames = some_frames(np.random.default_rng(seed), 25_500, rate_hz=8000, buses=buses)
    return frames[(frames.frames["flags"] & FrameFlag.ERROR) == 0][:24_000]  # no controller sends errors when asked to


ONE_BUS, TWO_BUSES = what_can_be_sent(7, ("vcan0",)), what_can_be_sent(9, ("vcan0", "vcan1"))
BURST = some_frames(np.random.default_rng(8), 15_000)
SEND_BURST = """
from daq.sources.player import replay
replay("sent.mcap", channels={"can0": "vcan0"}, speed=None, send_error_frames=True)
"""
LOSE = """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from frames_support import classical, some_frames
from daq.sources.socketcan import SocketCanSink, SocketCanSource
frames = classical(some_frames(np.random.default_rng(1), 20_000)).frames
source, sink = SocketCanSource("vcan0", buffer_bytes=100_000), SocketCanSink("vcan0")
sink.send(frames, 1.0)
received = 0
while batch := source.read(0.1):
    received += len(batch)
    assert all(batch.frames["time_ns"] > 10**18)
print(json.dumps([len(frames), received, source.counters.dropped, source.counters.received]))
"""
FAIL = """
import subprocess
from daq.errors import HardwareError
from daq.sources.socketcan import SocketCanSink, SocketCanSource
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
"""


def logging(folder: Path, sent: FrameBatch, vehicle: str = VEHICLE) -> str:
    """Return a script that logs while frames are replayed."""
    folder.mkdir()
    (folder / "vehicle.toml").write_text(vehicle, encoding="utf-8")
    return logged(folder, replayed(folder, sent))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("vcan")


@pytest.fixture(scope="module")
def results(place: Path) -> dict[str, GuestResult]:
    """What came of all scripts, run one after the other in one guest."""
    two = logging(place / "two", TWO_BUSES, f'{VEHICLE}[[bus]]\nchannel = "vcan1"\n')
    logging(place / "burst", BURST)
    for name, script in (("send", SEND_BURST), ("lose", LOSE), ("fail", FAIL)):
        (place / f"{name}.py").write_text(script, encoding="utf-8")
    scripts = {
        "one": logging(place / "one", ONE_BUS),
        "two": f"{ADD_BUS}\nadd_bus vcan1\n{two}",
        "burst": logged(place / "burst", f"{sys.executable} {place}/send.py"),
        "lose": f"{sys.executable} {place}/lose.py {TESTS}",
        "fail": f"{sys.executable} {place}/fail.py {TESTS}",
    }
    return run_all_or_skip(scripts, place, timeout_s=180)


def test_24000_frames_at_8_kHz_come_back(results: dict[str, GuestResult], place: Path) -> None:
    """`wheelsoil replay` sends them onto vcan0 and `wheelsoil log` records all of them, in order."""
    assert results["one"].exit_code == 0, results["one"].output
    first_ns, last_ns = check(place / "one", ONE_BUS).time_range_ns or (0, 0)
    assert 3.0 < (last_ns - first_ns) / 1e9 < 6.0


def test_two_buses_of_4_kHz_come_back(results: dict[str, GuestResult], place: Path) -> None:
    assert results["two"].exit_code == 0, results["two"].output
    check(place / "two", TWO_BUSES)


def test_a_burst_with_error_frames_comes_back(results: dict[str, GuestResult], place: Path) -> None:
    """A vcan never makes its sender wait, so a burst is what the receive buffer of 8 MiB must hold."""
    assert results["burst"].exit_code == 0, results["burst"].output
    check(place / "burst", BURST)


def test_what_is_lost_is_counted(results: dict[str, GuestResult]) -> None:
    """A receive buffer that is too small loses frames; received and lost ones make up those sent."""
    assert results["lose"].exit_code == 0, results["lose"].output
    sent, received, dropped, counted = json.loads(results["lose"].output)
    assert dropped > 0
    assert received == counted
    assert received + dropped == sent


def test_each_way_to_fail_says_what_to_do(results: dict[str, GuestResult]) -> None:
    said = results["fail"].output
    assert results["fail"].exit_code == 0, said
    assert "there is no interface vcan7" in said
    assert "nearest: vcan0" in said
    assert "the interface is down" in said
    assert "ip link set vcan0 up" in said
    assert "it may not be a CAN FD one" in said


def test_a_script_without_end_is_ended(vcan: Callable[..., GuestResult]) -> None:
    result = vcan("echo begun; sleep 600", timeout_s=6)
    assert result.exit_code == 124
    assert result.output == "begun\n"
