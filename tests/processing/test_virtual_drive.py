"""A simulated vehicle on soil through the whole room: its truth must come back, whatever axes the transducer has."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from daq import ROLES, Channel, RunInfo, VehicleConfig
from model.simulation import (
    TRUTH_QUADRATURE,
    HostClock,
    TransducerSetup,
    VehicleSetup,
    VirtualRun,
    VirtualSetup,
    virtual_run,
)
from model.wheel_soil import SOILS, Wheel, WheelSoilModel
from processing import ProcessedRun, Segment
from processing.pipeline import process

RADIUS_M, WIDTH_M = 0.47, 0.318
START_NS = 1_700_000_000_000_000_000


@lru_cache(maxsize=8)
def _drive(setup: VirtualSetup, soil: str = "clay", seed: int = 0) -> VirtualRun:
    model = WheelSoilModel(Wheel(RADIUS_M, WIDTH_M), SOILS[soil], quadrature=TRUTH_QUADRATURE)
    rng, ring = np.random.default_rng(seed), np.random.default_rng(99)
    return virtual_run(setup, model, {}, RunInfo(), start_ns=START_NS, elapsed_s=0.0, rng=rng, ring=ring)


def _channels(run: VirtualRun) -> dict[str, Channel]:
    channels = {role: c for sensor in run.sensors.values() for role, c in sensor.items() if role in ROLES}
    for role in ("latitude", "longitude"):
        channels[role] = replace(channels[role], values=np.degrees(channels[role].values))
    return channels


def _vehicle(setup: VirtualSetup) -> VehicleConfig:
    transducer = setup.transducer
    latencies = dict.fromkeys(("vertical_load", "drawbar_pull", "driving_torque", "wheel_angle"), transducer.latency_s)
    latencies |= {"wheel_speed": setup.wheel_speed.latency_s, "ground_speed": setup.gnss.latency_s}
    wheel = {
        "radius_m": RADIUS_M,
        "width_m": WIDTH_M,
        "outboard_mass_kg": setup.vehicle.outboard_mass_kg,
        "outboard_inertia_kgm2": setup.vehicle.outboard_inertia_kgm2,
    }
    names = ("frame", "side", "angle_offset_deg", "angle_direction", "zero")
    return VehicleConfig.model_validate(
        {
            "wheel": wheel,
            "sensors": {role: {"latency_s": latency} for role, latency in latencies.items()},
            "transducer": {name: getattr(transducer, name) for name in names},
        }
    )


def _setup(**transducer: object) -> VirtualSetup:
    return VirtualSetup(
        duration_s=40.0,
        vehicle=VehicleSetup(outboard_mass_kg=75.0, outboard_inertia_kgm2=10.0),
        transducer=replace(TransducerSetup(), **transducer),  # type: ignore[arg-type]
        clock=HostClock(offset_s=0.0, drift_ppm=0.0),
    )


def _errors(run: ProcessedRun, truth: VirtualRun, name: str, rows: np.ndarray) -> np.ndarray:
    at = run.time_s + (run.start_ns - START_NS) * 1e-9
    return (getattr(run, name) - np.interp(at, truth.truth.time_s, getattr(truth.truth, name)))[rows]


AXES = {
    "vehicle axes": {},
    "left wheel": {"frame": "wheel", "angle_offset_deg": 82.09},
    "right wheel, angle backward, spin zero": {
        "frame": "wheel",
        "side": "right",
        "angle_direction": -1,
        "angle_offset_deg": -30.0,
        "zero": "spin",
    },
}


@pytest.mark.parametrize("axes", AXES)
def test_forces_and_slip_come_back_in_any_axes(axes: str) -> None:
    setup = _setup(**AXES[axes])
    drive = _drive(setup)
    run = process(_channels(drive), _vehicle(setup))
    assert run.used.mean() > 0.7
    for name, spread, bias in (
        ("drawbar_pull_n", 70.0, 15.0),
        ("driving_torque_nm", 25.0, 5.0),
        ("vertical_load_n", 130.0, 25.0),
        ("ground_speed_mps", 0.045, 0.01),
        ("slip", 0.04, 0.01),
    ):
        error = _errors(run, drive, name, run.used)
        assert np.std(error) < spread, name
        assert abs(np.mean(error)) < bias, name


def test_sigmas_are_honest_where_they_are_estimated() -> None:
    setup = _setup()
    ratios = {name: [] for name in ("drawbar_pull", "driving_torque", "ground_speed", "slip")}  # type: ignore[var-annotated]
    columns = {
        "drawbar_pull": ("drawbar_pull_n", "drawbar_pull_sigma_n"),
        "driving_torque": ("driving_torque_nm", "driving_torque_sigma_nm"),
        "ground_speed": ("ground_speed_mps", "ground_speed_sigma_mps"),
        "slip": ("slip", "slip_sigma"),
    }
    for seed in range(2):
        drive = _drive(setup, "sandy", seed)
        config = _vehicle(setup)
        sensors = config.sensors | {"ground_speed": config.sensors["ground_speed"].model_copy(update={"sigma": 0.034})}
        run = process(_channels(drive), config.model_copy(update={"sensors": sensors}))
        for name, (value, sigma) in columns.items():
            error = _errors(run, drive, value, run.used)
            ratios[name].append(np.sqrt(np.mean((error / getattr(run, sigma)[run.used]) ** 2)))
    for name, found in ratios.items():
        assert 0.6 < np.mean(found) < 1.7, (name, found)


def test_standstill_and_segments_are_seen() -> None:
    setup = _setup(zero_offset_n=(0.0, 0.0))
    drive = _drive(setup, seed=3)
    run = process(_channels(drive), _vehicle(setup))
    at = run.time_s + (run.start_ns - START_NS) * 1e-9
    torque = np.interp(at, drive.truth.time_s, drive.truth.driving_torque_nm)
    slip = np.interp(at, drive.truth.time_s, drive.truth.slip)
    assert len(run.quality.standstills) == 2
    for standing in run.quality.standstills:
        assert abs(standing.levels["drawbar_pull"]) < 4 * standing.sigmas["drawbar_pull"] < 200
    assert np.mean(torque[run.segment == Segment.DRIVE] > 0) > 0.99
    assert np.mean(torque[run.segment == Segment.BRAKE] < 0) > 0.97
    assert np.mean(run.segment[(slip > 0.1) & (run.ground_speed_mps > 0.5)] == Segment.DRIVE) > 0.98


@pytest.mark.parametrize("soil", ["clay", "sandy"])
@pytest.mark.parametrize("undeclared_s", [0.0, 0.1])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_on_soft_soil_slip_is_not_taken_for_latency(soil: str, undeclared_s: float, seed: int) -> None:
    """The toothed ring itself is 10 to 20 ms late at the low speeds at which the wheel hardly slips."""
    setup = _setup()
    config = _vehicle(setup)
    late = config.sensors["ground_speed"].model_copy(update={"latency_s": setup.gnss.latency_s - undeclared_s})
    config = config.model_copy(update={"sensors": config.sensors | {"ground_speed": late}})
    quality = process(_channels(_drive(setup, soil, seed)), config).quality
    assert abs(quality.residual_latency_s + 0.015 - undeclared_s) < 3 * quality.residual_latency_sigma_s + 0.015
    assert quality.residual_latency_sigma_s < 0.06
    assert np.isnan(quality.speed_scale)  # a wheel without torque skids on soft soil


def test_the_host_clock_is_fitted_to_gnss_time() -> None:
    setup = replace(_setup(), clock=HostClock(offset_s=0.25, drift_ppm=40.0))
    clock = process(_channels(_drive(setup)), _vehicle(setup)).quality.clock
    assert clock["offset_s"] == pytest.approx(0.25 + setup.gnss.transport_s + 20 * 40e-6, abs=1e-3)
    assert clock["drift_ppm"] == pytest.approx(40.0, abs=3.0)
    assert clock["residual_s"] < 1e-3
