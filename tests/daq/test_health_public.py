"""The health monitor on logs of real vehicles: it says what is wrong with them, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from health_support import HealthRun, watch
from support import data_dir

from daq import VehicleConfig
from daq.can import load_database
from daq.logger.health.report import Level
from daq.logs import read_log


def monitored(log: Path, dbcs: dict[str, Path], signals: dict[str, str], **health: object) -> HealthRun:
    buses = {bus: (load_database(path, lenient=True),) for bus, path in dbcs.items()}
    vehicle = VehicleConfig.model_validate(
        {
            "bus": [{"channel": bus, "bitrate": 500_000} for bus in buses],
            "wheel": {"radius_m": 0.35, "width_m": 0.2},
            "signals": signals,
            "health": health,
        }
    )
    return watch(vehicle, buses, read_log(log))


def reason_places(result: HealthRun) -> set[tuple[str, str]]:
    return {(one.code, one.bus) for one in result.reasons}


@pytest.mark.slow
def test_a_drive_on_the_highway() -> None:
    folder = data_dir("comma2k19-example1")
    dbc = folder / "toyota_rav4_2019.dbc"
    signals = {"wheel_speed": "can0:WHEEL_SPEEDS.WHEEL_SPEED_RL", "ground_speed": "can0:SPEED.SPEED"}
    result = monitored(folder / "candump.log.gz", {"can0": dbc, "can1": dbc}, signals)
    assert reason_places(result) == {("unknown_frames", "can0"), ("unknown_frames", "can1")}
    assert result.monitor.losses() == {}
    assert [bus.unknown_frames for bus in result.last.buses] == [16_060, 40_800]
    load = {bus.name: bus.load for bus in result.reports[100].buses}
    assert 0.1 < load["can1"] < load["can0"] < 0.3
    quiet = monitored(
        folder / "candump.log.gz", {"can0": dbc, "can1": dbc}, signals, may_carry_unknown=("can0", "can1")
    )
    assert reason_places(quiet) == set()


@pytest.mark.parametrize(
    ("name", "lacking"),
    [
        pytest.param("car_3BA199E2_165_2", 29, marks=pytest.mark.slow),
        pytest.param("car_3BA199E2_165_4", 30, marks=pytest.mark.study),
    ],
)
def test_drives_with_missing_seconds_of_gnss(name: str, lacking: int) -> None:
    folder = data_dir("css-canedge")
    signals = {
        "ground_speed": "gnss_speed.Speed",
        "ground_speed_valid": "gnss_speed.SpeedValid",
        "latitude": "gnss_pos.Latitude",
        "longitude": "gnss_pos.Longitude",
    }
    result = monitored(folder / f"{name}.candump.log.gz", {"can2": folder / "canmod-gps.dbc"}, signals)
    assert reason_places(result) == {("frames_missing", "can2")}
    losses = result.monitor.losses()
    assert losses.pop("missing.can2.gnss_imu") < 0.001 * 60_000
    assert len(losses) == 8
    assert set(losses.values()) == {lacking}
    assert result.last.gnss is not None
    assert result.last.gnss.fix


@pytest.mark.slow
def test_a_truck_whose_engine_control_pauses() -> None:
    folder = data_dir("css-canedge")
    dbc = folder / "CSS-Electronics-SAE-J1939-DEMO.dbc"
    result = monitored(
        folder / "truck_j1939_stationary.candump.log.gz",
        {"can1": dbc},
        {"wheel_speed": "CCVS1.WheelBasedVehicleSpeed"},
        may_carry_unknown=("can1",),
    )
    assert reason_places(result) == {("message_missing", "can1"), ("frames_missing", "can1")}
    assert max(one.level for one in result.reasons) is Level.RED
    assert result.monitor.losses() == {"missing.can1.CCVS1": 22, "missing.can1.EEC1": 22}
