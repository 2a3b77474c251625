"""Which file a run goes into when the one before it was cut off and the clock was set meanwhile."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from frames_support import some_frames

from daq import RunInfo, VehicleConfig, VehicleSection
from daq.logger.run_files import VEHICLE_KEY, RunFiles, named_run, unfinished_run
from daq.recording import PartWriter, Recording

VEHICLE = VehicleConfig(vehicle=VehicleSection(name="test rig"))


def cut_off(folder: Path, last_frame_in_s: float) -> Path:
    """Return a recording without its end, whose last frame came so long from now."""
    batch = some_frames(np.random.default_rng(0), 50)
    batch.frames["time_ns"] += time.time_ns() + int(last_frame_in_s * 1e9) - batch.frames["time_ns"].max()
    path = folder / "gate.mcap"
    with PartWriter(path, run=RunInfo(id="gate"), session_id="a", metadata={VEHICLE_KEY: "test rig"}) as writer:
        writer.write_frames(batch)
        writer.flush()
        data = path.read_bytes()
    path.write_bytes(data)
    return path


def named(path: Path) -> RunFiles | None:
    return named_run(path, RunInfo(id="gate"), VEHICLE)


def unnamed(path: Path) -> RunFiles | None:
    return unfinished_run(path.parent, VEHICLE)


@pytest.mark.parametrize("choose", [named, unnamed])
def test_a_run_goes_on_behind_its_last_frame(tmp_path, choose):
    files = choose(cut_off(tmp_path, -20.0))
    assert files is not None
    assert (files.run.id, files.part, files.first.name) == ("gate", 2, "gate.mcap")


@pytest.mark.parametrize("choose", [named, unnamed])
@pytest.mark.parametrize("ahead_s", [30.0, 500.0])
def test_a_clock_that_was_set_back_begins_a_new_run(tmp_path, choose, ahead_s):
    path = cut_off(tmp_path, ahead_s)
    files = choose(path)
    assert files is not None
    assert (files.run.id, files.part, files.first.name) == ("gate-2", 1, "gate-2.mcap")
    assert "run 'gate' was cut off, and the clock is " in files.remark
    assert files.remark.endswith("s behind its last frame: run 'gate-2' begins")
    assert Recording.open(path).contents.losses


def test_a_run_that_people_named_never_goes_back_however_far_the_clock_was_set(tmp_path):
    files = named(cut_off(tmp_path, 1e6))
    assert files is not None
    assert files.first.name == "gate-2.mcap"
