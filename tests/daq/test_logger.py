"""The logger on python-can's virtual bus: what is sent is recorded, however it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from frames_support import content, some_frames
from logger_support import Handset, Recorder, virtual_bus, wait_until

from daq import BusSection, ConfigError, HardwareError, VehicleConfig
from daq.logger import log
from daq.logger.listener import SILENCE_S
from daq.recording import Recording
from daq.sources import Sink, open_sink


@pytest.fixture
def sinks() -> Iterator[list[Sink]]:
    opened: list[Sink] = []
    yield opened
    for sink in opened:
        sink.close()


def test_two_buses_are_recorded_frame_for_frame(tmp_path: Path, sinks: list[Sink]) -> None:
    buses = [virtual_bus(), virtual_bus()]
    sent = [some_frames(np.random.default_rng(seed), 1500, buses=(bus.channel,)) for seed, bus in enumerate(buses)]
    panel = Handset()
    recorder = Recorder(VehicleConfig(bus=tuple(buses)), tmp_path, panel=panel)
    for bus, batch in zip(buses, sent, strict=True):
        sinks.append(open_sink(bus))
        sinks[-1].send(batch.frames, 5.0)
    panel.wait_for(lambda now: [bus["frames"] for bus in now["buses"]] == [1500, 1500])
    summary = recorder.end()

    assert summary.ended_by == "stop"
    assert summary.frames == {bus.channel: 1500 for bus in buses}
    assert summary.drops == {}
    assert all("does not report frames that it loses" in remark for remark in summary.remarks)
    recording = Recording.open(summary.path)
    assert recording.loss == ()
    for bus, batch in zip(buses, sent, strict=True):
        assert content(recording.frames(bus.channel)) == content(batch)
    assert recording.metadata["run_end"]["exit_status"] == "ok"
    assert recording.metadata["run_start"][f"interface.{buses[0].channel}"] == "virtual"
    errors = int(np.count_nonzero(sent[0].frames["flags"] & 4))
    assert summary.error_frames[buses[0].channel] == errors


def test_duration_ends_it_and_an_empty_run_is_a_recording(tmp_path: Path) -> None:
    summary = log(VehicleConfig(bus=(virtual_bus(),)), tmp_path / "run.mcap", duration_s=0.3)
    assert summary.ended_by == "duration"
    assert 0.3 <= summary.duration_s < 10.0
    assert summary.path == tmp_path / "run.mcap"
    assert len(Recording.open(summary.path).frames()) == 0


def test_threads_take_quick_turns_while_it_records(tmp_path: Path) -> None:
    seen: list[float] = []
    before = sys.getswitchinterval()
    vehicle = VehicleConfig(bus=(virtual_bus(),))
    log(vehicle, tmp_path, duration_s=0.1, progress=lambda _: seen.append(sys.getswitchinterval()))
    assert seen[0] < before == sys.getswitchinterval()


def test_recordings_of_one_second_get_different_names(tmp_path: Path) -> None:
    vehicle = VehicleConfig.model_validate({"vehicle": {"name": "Unimog / U 400"}, "bus": [virtual_bus().model_dump()]})
    paths = [log(vehicle, tmp_path, duration_s=0.0).path for _ in range(2)]
    assert len(set(paths)) == 2
    assert all(path.name.startswith("Unimog-U-400_") for path in paths)


LOGGER = """
import json, sys, threading
import can
from daq.config import BusSection, VehicleConfig
from daq.logger.field_logger import log
bus = can.Bus(interface="virtual", channel="x")
def send(_):
    bus.send_periodic(can.Message(arbitration_id=0x123, data=[1, 2, 3]), 0.01)
    print("ready", flush=True)
vehicle = VehicleConfig(bus=(BusSection(channel="x", interface="virtual"),))
first = []
done = log(vehicle, sys.argv[1], progress=lambda seen: first or (first.append(1), send(seen)))
print(json.dumps([done.ended_by, done.signal_number, done.frames["x"]]))
bus.shutdown()
"""


def logging(folder: Path) -> subprocess.Popen[str]:
    """Return a logger in a process of its own that has recorded some frames."""
    (folder / "run.py").write_text(LOGGER, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, folder / "run.py", folder / "run.mcap"], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    wait_until(lambda: sum(Recording.open(folder / "run.mcap").frame_counts.values()) > 5)
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_closed_recording(tmp_path: Path, number: signal.Signals) -> None:
    process = logging(tmp_path)
    os.kill(process.pid, number)
    said, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    ended_by, caught, count = json.loads(said)
    assert (ended_by, caught) == ("signal", number)
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.loss == ()
    assert recording.metadata["run_end"]["exit_status"] == "interrupted"
    assert 5 < len(recording.frames()) == count


def test_a_logger_that_was_stopped_says_for_how_long(tmp_path: Path) -> None:
    process = logging(tmp_path)
    os.kill(process.pid, signal.SIGSTOP)
    stopped_at = time.monotonic()
    time.sleep(SILENCE_S + 0.5)
    os.kill(process.pid, signal.SIGCONT)
    stopped_s = time.monotonic() - stopped_at
    time.sleep(1.0)
    os.kill(process.pid, signal.SIGTERM)
    process.communicate(timeout=20)
    silences = [event for event in Recording.open(tmp_path / "run.mcap").events() if "not read for" in event.text]
    assert [event.severity for event in silences] == ["warning"]
    said = re.match(r"x not read for (\d+\.\d) s: the logger was stopped", silences[0].text)
    assert said
    assert stopped_s - 0.1 <= float(said[1]) < stopped_s + 2.0


def test_what_cannot_be_opened_is_reported_at_once_and_nothing_is_written(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(ConfigError, match="no bus to record"):
        log(VehicleConfig(), out)
    with pytest.raises(ConfigError, match=r"no interface 'virtuel'[\s\S]*nearest: virtual"):
        log(VehicleConfig(bus=(BusSection(channel="x", interface="virtuel"),)), out)
    missing = (BusSection(channel="nocan0"), BusSection(channel="nocan1"))
    with pytest.raises(HardwareError) as caught:
        log(VehicleConfig(bus=missing), out)
    assert caught.value.exit_code == 4
    assert len(caught.value.faults) == 2
    assert all(fault.next_step for fault in caught.value.faults)
    assert not out.exists()


def test_without_databases_the_roles_are_no_matter(tmp_path: Path) -> None:
    vehicle = VehicleConfig(bus=(virtual_bus(),), signals={"ground_speed": "GNSS_2.Speed"})
    assert log(vehicle, tmp_path, duration_s=0.1).remarks == ("virtual does not report frames that it loses",)
