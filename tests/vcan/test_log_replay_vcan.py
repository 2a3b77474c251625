"""Frames replayed onto a real SocketCAN interface and logged from it come back frame for frame."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames_support import content, some_frames

from daq.recording import Recording, RecordingWriter
from vcan.guest import GuestResult

pytestmark = pytest.mark.vcan

VEHICLE = """
[vehicle]
name = "test rig"
[[bus]]
channel = "vcan0"
"""
RECORD = """
import json, sys
from pathlib import Path
from daq.config import VehicleConfig, load_toml
from daq.logger import log
summary = log(load_toml(Path(sys.argv[1]), VehicleConfig), sys.argv[2])
print(json.dumps([summary.frames, summary.drops, summary.ended_by, summary.remarks]))
"""
REPLAY = """
import sys
from daq.replay import replay
speed = float(sys.argv[3]) or None
replay(sys.argv[1], "socketcan", channels={"can0": sys.argv[2]}, speed=speed, send_error_frames=True)
"""


def script(folder: Path, speed: float) -> str:
    """Start the logger, wait for its recording, replay, and end the logger as a service manager would."""
    return f"""
set -e
cd {folder}
{sys.executable} record.py vehicle.toml out > summary.json &
logger=$!
until ls out/*.mcap > /dev/null 2>&1; do sleep 0.1; kill -0 $logger; done
{sys.executable} replay.py sent.mcap vcan0 {speed}
sleep 1
kill -TERM $logger
wait $logger
"""


# A second of a bus with 4 kframes/s takes as long; "as fast as the bus takes them" is a burst that the receive buffer
# of 8 MiB must hold, because a vcan never makes a sender wait.
@pytest.mark.parametrize(("speed", "count"), [(1.0, 12_000), (0.0, 15_000)])
def test_frames_come_back_in_order_and_none_is_lost(
    vcan: Callable[..., GuestResult], tmp_path: Path, speed: float, count: int
) -> None:
    sent = some_frames(np.random.default_rng(7), count)
    with RecordingWriter(tmp_path / "sent.mcap") as writer:
        writer.write_frames(sent)
    for name, text in (("vehicle.toml", VEHICLE), ("record.py", RECORD), ("replay.py", REPLAY)):
        (tmp_path / name).write_text(text, encoding="utf-8")

    result = vcan(script(tmp_path, speed))

    assert result.exit_code == 0, result.output
    frames, drops, ended_by, remarks = json.loads((tmp_path / "summary.json").read_text())
    assert frames == {"vcan0": count}
    assert drops == {"vcan0": 0}
    assert ended_by == "signal"
    assert remarks == []
    [recorded] = (tmp_path / "out").glob("*.mcap")
    received = Recording.open(recorded).frames()
    assert [frame[1:] for frame in content(received)] == [frame[1:] for frame in content(sent)]
    times = received.frames["time_ns"]
    assert (np.diff(times) >= 0).all()
    if speed:
        expected_s = count / 4000 / speed
        assert (times[-1] - times[0]) / 1e9 == pytest.approx(expected_s, rel=0.05)


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
