"""Real cars, from their frames to slip: no force channels, receivers beside and on the bus."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import data_dir

from daq import Channel, VehicleConfig, parse_toml
from daq.config import SensorSection
from daq.runs import Run, open_runs
from processing import ProcessedRun, Reason, RunCode, Segment
from processing.pipeline import process, process_stream
from wheelsoil.wording.run_summary import summary_table

RADIUS_M = 0.33

_RAV4 = f"""
[wheel]
radius_m = {RADIUS_M}
width_m = 0.225
[[bus]]
channel = "can0"
dbc = ["toyota.dbc"]
[signals]
wheel_speed = "WHEEL_SPEEDS.WHEEL_SPEED_RL"
"""

_CANEDGE = f"""
[wheel]
radius_m = {RADIUS_M}
width_m = 0.2
[[bus]]
channel = "can1"
dbc = ["obd2.dbc"]
[[bus]]
channel = "can2"
dbc = ["canmod-gps.dbc"]
[signals]
wheel_speed = "OBD2_RESPONSE.VehicleSpeed"
ground_speed = "gnss_speed.Speed"
ground_speed_valid = "gnss_speed.SpeedValid"
latitude = "gnss_pos.Latitude"
longitude = "gnss_pos.Longitude"
gnss_time = "gnss_time.Epoch"
"""


def _receiver(column: int) -> Channel:
    """Return a column of comma2k19's u-blox array as a channel."""
    folder = data_dir("comma2k19-example1", "processed_log", "GNSS", "live_gnss_ublox")
    time_s, values = np.load(folder / "t.npy"), np.load(folder / "value.npy")
    return Channel("gnss", "", np.round(time_s * 1e9).astype(np.int64), values[:, column])


@pytest.fixture(scope="module")
def rav4_wheel(tmp_path_factory: pytest.TempPathFactory) -> Channel:
    """Return the wheel speed decoded from the candump log."""
    source = data_dir("comma2k19-example1")
    folder = tmp_path_factory.mktemp("rav4")
    (folder / "vehicle.toml").write_text(_RAV4)
    (folder / "toyota.dbc").write_bytes((source / "toyota_rav4_2019.dbc").read_bytes())
    (folder / "drive.log").write_bytes(gzip.decompress((source / "candump.log.gz").read_bytes()))
    (run,) = open_runs([folder], lenient_dbc=True)
    return run.channels()["wheel_speed"]


def _rav4_vehicle() -> VehicleConfig:
    return parse_toml(_RAV4, VehicleConfig, "test")


def test_receiver_beside_the_log_is_late_by_what_the_answer_key_says(rav4_wheel: Channel) -> None:
    channels = {"wheel_speed": rav4_wheel, "ground_speed": _receiver(2)}
    run = process(channels, _rav4_vehicle())
    quality = run.quality
    assert quality.residual_latency_s == pytest.approx(0.16, abs=0.03)
    assert quality.residual_latency_sigma_s < 0.02
    assert abs(quality.speed_scale - 1) < 0.015
    assert run.used.mean() > 0.9
    assert np.abs(np.median(run.slip[run.used])) < 0.02


@pytest.mark.parametrize("wheels", [[0, 1, 2, 3], [2, 3], [2], [3]])
def test_the_key_says_the_same(wheels: list[int]) -> None:
    """Rear wheels or all four: in the curves of this drive each front wheel alone goes another way than the car."""
    folder = data_dir("comma2k19-example1", "processed_log", "CAN", "wheel_speed")
    time_ns = np.round(np.load(folder / "t.npy") * 1e9).astype(np.int64)
    speed = np.load(folder / "value.npy")[:, wheels].mean(axis=1) / RADIUS_M
    channels = {"wheel_speed": Channel("w", "rad/s", time_ns, speed), "ground_speed": _receiver(2)}
    quality = process(channels, _rav4_vehicle()).quality
    assert quality.residual_latency_s == pytest.approx(0.16, abs=0.03)
    assert abs(quality.speed_scale - 1) < 0.015


def test_the_latency_once_declared_is_gone(rav4_wheel: Channel) -> None:
    config = _rav4_vehicle().model_copy(update={"sensors": {"ground_speed": SensorSection(latency_s=0.16)}})
    channels = {"wheel_speed": rav4_wheel, "ground_speed": _receiver(2)}
    before, after = process(channels, _rav4_vehicle()), process(channels, config)
    assert abs(after.quality.residual_latency_s) < 0.03
    assert np.std(after.slip[after.used]) < 0.75 * np.std(before.slip[before.used])


def test_receiver_time_fits_the_logger_clock(rav4_wheel: Channel) -> None:
    utc = _receiver(3)
    seconds = Channel("t", "s", utc.time_ns, utc.values * 1e-3)
    channels = {"wheel_speed": rav4_wheel, "ground_speed": _receiver(2), "gnss_time": seconds}
    quality = process(channels, _rav4_vehicle()).quality
    assert quality.clock["residual_s"] < 0.02
    assert abs(quality.clock["drift_ppm"]) < 200
    assert quality.residual_latency_s == pytest.approx(0.16, abs=0.03)


@pytest.fixture(scope="module", params=["165_2", pytest.param("165_4", marks=pytest.mark.slow)])
def drive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a CANedge drive as frames."""
    source = data_dir("css-canedge")
    folder = tmp_path_factory.mktemp("car")
    (folder / "vehicle.toml").write_text(_CANEDGE)
    (folder / "obd2.dbc").write_bytes((Path(__file__).parent / "obd2.dbc").read_bytes())
    (folder / "canmod-gps.dbc").write_bytes((source / "canmod-gps.dbc").read_bytes())
    log = gzip.decompress((source / f"car_3BA199E2_{request.param}.candump.log.gz").read_bytes())
    (folder / "drive.log").write_bytes(log)
    (run,) = open_runs([folder])
    return run


@pytest.fixture(scope="module")
def car(drive: Run) -> ProcessedRun:
    """Return the same drive, streamed from its log."""
    return process_stream(drive.channel_batches(), drive.vehicle, drive.info)


def test_a_real_drive_is_neither_refused_nor_noted(car: ProcessedRun, rav4_wheel: Channel) -> None:
    rav4 = process({"wheel_speed": rav4_wheel, "ground_speed": _receiver(2)}, _rav4_vehicle())
    codes = (RunCode.IMPLAUSIBLE, RunCode.SENSOR_FAULT)
    assert not [note for run in (car, rav4) for note in run.quality.notes if note.code in codes]


def test_a_drive_with_a_slow_receiver_gives_slip(car: ProcessedRun) -> None:
    assert len(car) == pytest.approx(60_000, abs=30)
    assert car.cutoff_hz == pytest.approx(0.2, abs=0.01)
    assert car.used.mean() > 0.6
    assert np.abs(np.median(car.slip[car.used])) < 0.02
    assert sum(car.quality.shares.values()) == pytest.approx(1.0)
    assert 0.3 < car.quality.residual_latency_s < 0.45
    assert car.quality.speed_scale == pytest.approx(0.993, abs=0.003)
    assert car.quality.clock["residual_s"] < 0.05
    assert dict(summary_table(car))["run"] == "drive"


def test_missing_seconds_stay_missing(car: ProcessedRun) -> None:
    facts = car.quality.sensors["ground_speed"]
    assert 20 <= facts.gaps <= 35
    missing = car.reason == Reason.GAP
    assert np.isnan(car.ground_speed_mps[missing]).all()
    assert np.isnan(car.slip[missing]).all()
    assert missing.mean() > 0.9 * facts.gaps * 2.0 / 600
    assert (car.segment[missing] == Segment.UNKNOWN).all()
    wheel = car.quality.sensors["wheel_speed"]
    assert wheel.rate_hz == pytest.approx(wheel.samples / 600, rel=0.002), "every 0.5 s, and some twice"


def test_invalid_fixes_are_honoured(drive: Run, car: ProcessedRun) -> None:
    """These receivers never lost their fix: here they say of one minute that they had."""
    assert "INVALID_FIX" not in car.quality.shares
    assert np.isfinite(car.latitude_deg).mean() > 0.85
    channels = drive.channels()
    flags = channels["ground_speed_valid"]
    elapsed_s = (flags.time_ns - car.start_ns) * 1e-9
    lost = (elapsed_s > 200) & (elapsed_s < 260)
    channels["ground_speed_valid"] = replace(flags, values=np.where(lost, 0.0, flags.values))
    run = process(channels, drive.vehicle)
    minute = (run.time_s > 203) & (run.time_s < 257)
    assert np.isnan(run.ground_speed_mps[minute]).all()
    assert set(run.reason[minute]) <= {Reason.GAP, Reason.INVALID_FIX}
    assert run.quality.shares["INVALID_FIX"] == pytest.approx(0.09, abs=0.02)
    np.testing.assert_array_equal(run.slip[run.time_s < 195], car.slip[car.time_s < 195])
