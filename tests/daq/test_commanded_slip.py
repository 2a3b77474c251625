"""A folder of series is a run folder, and a commanded slip stands for one of the speeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq import Channel, ConfigError, VehicleConfig, parse_mapping
from daq.config import WheelSection
from daq.runs import Run, open_runs
from daq.runs.commanded_slip import CommandedSlip

RADIUS_M = 0.3
SLIP = np.array([-0.5, -0.2, 0.0, 0.1, 0.6, 0.9, 1.0])
GROUND_MPS = 0.5
VEHICLE = '[wheel]\nradius_m = 0.3\nwidth_m = 0.2\n[signals]\nslip = "s"\nvertical_load = "Fz"\n'


def runs_of(folder: Path, roles: str, speed: str) -> list[Run]:
    folder.mkdir()
    (folder / "vehicle.toml").write_text(VEHICLE + roles)
    rows = "".join(f"{i / 10},{s},{GROUND_MPS},{100 + i}.5\n" for i, s in enumerate(SLIP.tolist()))
    for name in ("out", "back"):
        (folder / f"{name}.csv").write_text(f"time [s],s [1],{speed},Fz [N]\n{rows}")
    (folder / "table.csv").write_text("slip,vertical_load_n\n0.1,100\n0.2,200\n")
    (folder / "notes.txt").write_text("dry, windy\nno rain, so far\n")
    return open_runs([folder])


def test_a_commanded_slip_stands_for_the_wheel_speed(tmp_path: Path) -> None:
    first, second = runs_of(tmp_path / "campaign", 'ground_speed = "v"\n', "v [m/s]")
    assert (first.id, second.id) == ("back", "out")
    channels = first.channels()
    rim = channels["wheel_speed"].values * RADIUS_M
    larger = np.maximum(rim, np.where(SLIP < 0, GROUND_MPS, rim))
    np.testing.assert_allclose((rim - GROUND_MPS)[:-1] / larger[:-1], SLIP[:-1], atol=1e-12)
    assert np.isnan(rim[-1]) and channels["wheel_speed"].unit == "rad/s"
    assert channels["ground_speed"].values.tolist() == [GROUND_MPS] * len(SLIP)


def test_a_commanded_slip_stands_for_the_ground_speed(tmp_path: Path) -> None:
    run = runs_of(tmp_path / "campaign", 'wheel_speed = "w"\n', "w [rad/s]")[0]
    ground = run.channels(["ground_speed"])["ground_speed"].values
    rim = GROUND_MPS * RADIUS_M
    expected = np.where(SLIP < 0, rim / (1 + SLIP), rim * (1 - SLIP))
    np.testing.assert_allclose(ground[:-1], expected[:-1])


def test_a_slip_keeps_its_value_between_its_samples_and_pieces() -> None:
    wheel = parse_mapping({"radius_m": RADIUS_M, "width_m": 0.2}, WheelSection, "wheel")
    commanded = CommandedSlip(VehicleConfig(wheel=wheel), "wheel_speed")

    def piece(slip_ns: list[int], slip: list[float], ground_ns: list[int]) -> list[float]:
        speed = commanded.speed(
            {
                "slip": Channel("slip", "1", np.array(slip_ns, np.int64), np.array(slip)),
                "ground_speed": Channel("v", "m/s", np.array(ground_ns, np.int64), np.full(len(ground_ns), 0.3)),
            }
        )
        assert speed is not None
        return (speed.values * RADIUS_M).tolist()

    assert piece([10], [0.5], [5, 10, 15]) == pytest.approx([np.nan, 0.6, 0.6], nan_ok=True)
    assert piece([40], [0.25], [20, 39, 40]) == pytest.approx([0.6, 0.6, 0.4])


def test_a_commanded_slip_without_a_speed_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="needs one of the speeds"):
        runs_of(tmp_path / "campaign", "", "v [m/s]")
