"""A sample run replayed over a bus and logged from it: the same frames, and the same fit."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames_support import content
from vcan.guest import GuestResult
from vcan.session import WHEELSOIL, check, logged

from daq import VehicleConfig
from daq.can import shipped_dbc
from daq.logger import log
from daq.recording import Recording, RecordingWriter
from daq.runs import open_runs, vehicle_from_file
from daq.sources import replay
from model.fit import CampaignFit, FitOptions, fit_models
from model.wheel_soil import SOILS, Wheel
from processing import ProcessOptions
from wheelsoil.workflows import process_runs

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
DRIVEN_S = 25.0
"""So much of a run is sent."""


def fitted(recording: Path) -> CampaignFit:
    runs = [run for _, run in process_runs(open_runs([recording]), ProcessOptions(purpose="fit"))]
    return fit_models(runs, Wheel(0.47, 0.318), SOILS["clay"], FitOptions(models=("vasilev", "ding")))


def assert_same_fit(sent: Path, received: Path) -> None:
    """The frames are the same to the bit, their times of arrival are not: on a busy machine they jitter by tens of ms.

    What that may do to a fit is not for a test of the logger to judge; that the estimates mean the same soil is.
    """
    before, after = fitted(sent), fitted(received)
    for name, parameter in (("vasilev", "H_m"), ("ding", "n1")):
        a, b = before.model(name).estimate(parameter), after.model(name).estimate(parameter)
        assert abs(a.value - b.value) < 3 * a.sigma, (parameter, a, b)
        assert 1 / 3 < b.sigma / a.sigma < 3, (parameter, a, b)  # twenty pauses of 0.1 s: 0.8 to 1.9


def rig(folder: Path, channel: str) -> Path:
    """Put the campaign's vehicle on another bus."""
    for name in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc"):
        shutil.copy(shipped_dbc(name), folder)
    text = (CLAY / "vehicle.toml").read_text().replace('channel = "can0"', f'channel = "{channel}"')
    path = folder / "vehicle.toml"
    path.write_text(text, encoding="utf-8")
    return path


def sample(folder: Path, name: str) -> Path:
    """Write the beginning of one of the campaign's runs."""
    run = Recording.open(CLAY / name)
    batch = run.frames()
    time_ns = batch.frames["time_ns"]
    path = folder / "sent" / "run.mcap"  # away from the vehicle.toml of the other bus
    path.parent.mkdir()
    with RecordingWriter(path, run=run.run, attachments=run.attachments) as writer:
        writer.write_frames(batch[time_ns < time_ns[0] + int(DRIVEN_S * 1e9)])
    return path


@pytest.mark.slow
@pytest.mark.vcan
def test_a_sample_run_over_socketcan_gives_the_same_fit(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    """At their recorded times, through `wheelsoil replay` and `wheelsoil log` on vcan0."""
    rig(tmp_path, "vcan0")
    run = sample(tmp_path, "run-1.mcap")

    result = vcan(logged(tmp_path, f"{WHEELSOIL} replay {run} --channel can0=vcan0"), timeout_s=150)

    assert result.exit_code == 0, result.output
    check(tmp_path, Recording.open(run).frames())
    [received] = (tmp_path / "out").glob("*.mcap")
    assert_same_fit(run, received)


@pytest.mark.slow
def test_a_sample_run_over_a_virtual_bus_gives_the_same_fit(tmp_path: Path) -> None:
    """The same everywhere: python-can's virtual bus, which lives within one process."""
    name = f"bus-{uuid.uuid4().hex}"
    configured = vehicle_from_file(rig(tmp_path, name))
    assert configured.vehicle is not None
    bus = configured.vehicle.bus[0].model_copy(update={"interface": "virtual"})
    vehicle: VehicleConfig = configured.vehicle.model_copy(update={"bus": (bus,)})
    run, out, stop = sample(tmp_path, "run-2.mcap"), tmp_path / "out.mcap", threading.Event()
    thread = threading.Thread(
        target=log, args=(vehicle, out), kwargs={"stop": stop, "attachments": configured.attachments}
    )
    thread.start()
    while not out.exists():
        time.sleep(0.01)
    time.sleep(0.3)
    replay(run, "virtual", channels={"can0": name})
    time.sleep(0.5)
    stop.set()
    thread.join(10)

    sent, received = Recording.open(run).frames(), Recording.open(out).frames()
    assert [f[1:] for f in content(received)] == [f[1:] for f in content(sent)]
    assert (np.diff(received.frames["time_ns"]) >= 0).all()
    assert_same_fit(run, out)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_leaves_a_closed_recording(tmp_path: Path) -> None:
    """The command itself, on a bus without traffic."""
    (tmp_path / "vehicle.toml").write_text('[[bus]]\nchannel = "quiet"\ninterface = "virtual"\n', encoding="utf-8")
    logger = subprocess.Popen([WHEELSOIL, "log", "vehicle.toml", "--out", "out"], cwd=tmp_path, stderr=subprocess.PIPE)
    for _ in range(200):
        if list(tmp_path.glob("out/*.mcap")):
            break
        time.sleep(0.05)
    logger.send_signal(signal.SIGINT)
    _, said = logger.communicate(timeout=20)
    assert logger.returncode == 130, said
    [path] = tmp_path.glob("out/*.mcap")
    recording = Recording.open(path)
    assert not recording.loss and b"Traceback" not in said
