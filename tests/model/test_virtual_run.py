"""A whole run of the virtual test: truth, sensors, seeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_support import LYASKO, START_NS, WHEEL, lyasko_model, simulated

from daq import ConfigError, DataError, RunInfo
from model.simulation import (
    TRUTH_QUADRATURE,
    GnssSetup,
    TransducerSetup,
    VehicleSetup,
    VirtualSetup,
    drawn_soil,
    virtual_run,
)
from model.simulation.truth import Circumstances, free_rolling_slip
from model.wheel_soil import LABORATORY_SPREAD, SOILS, Conditions, WheelSoilModel

SHORT = VirtualSetup(duration_s=20.0)


def values_of(run, sensor: str, name: str) -> np.ndarray:
    return run.sensors[sensor][name].values


@pytest.mark.parametrize("soil", ["clay", "sandy"])
def test_the_truth_is_what_the_fitter_s_own_model_says(soil: str) -> None:
    """Other nodes, other map, another rate: the same physics to 1e-5 of the load."""
    truth = simulated(SHORT, 3, soil).truth
    fitter = WheelSoilModel(WHEEL, SOILS[soil], lyasko_model(soil).effects)
    assert fitter.quadrature != TRUTH_QUADRATURE
    rolling = truth.ground_speed_mps > 0.9
    said = fitter.predict(Conditions(truth.slip[rolling], truth.vertical_load_n[rolling]), LYASKO[soil])
    assert said.drawbar_pull_n == pytest.approx(truth.drawbar_pull_n[rolling], abs=0.1)
    assert said.driving_torque_nm == pytest.approx(truth.driving_torque_nm[rolling], abs=0.1)
    assert said.sinkage_m == pytest.approx(truth.sinkage_m[rolling], abs=1e-6)


def test_slip_digs_the_wheel_in() -> None:
    truth = simulated(SHORT, 3).truth
    s = truth.slip
    expected = truth.static_sinkage_m * (1 + 0.1 * s) / (1 - 0.05 * s)
    driven = s > 0
    assert truth.sinkage_m[driven] == pytest.approx(expected[driven], rel=1e-12)
    assert np.array_equal(truth.sinkage_m[~driven], truth.static_sinkage_m[~driven])


def test_a_standing_wheel_pulls_nothing_and_carries_its_load() -> None:
    run = simulated(SHORT, 3, info=RunInfo(id="loaded", added_load_kg=500.0))
    truth = run.truth
    standing = truth.time_s < 2.4
    assert not truth.drawbar_pull_n[standing].any()
    assert not truth.driving_torque_nm[standing].any()
    assert truth.vertical_load_n[standing] == pytest.approx(8000 + 0.4 * 500 * 9.80665)
    load = run.sensors["transducer"]["vertical_load"]
    at_rest = load.values[:2400]
    assert np.mean(at_rest) == pytest.approx(truth.vertical_load_n[0], abs=70)


def test_the_coasting_wheel_transmits_no_torque() -> None:
    circumstances = Circumstances(RunInfo(), 340.0, 0.0, 40.0, (0.0, 60.0))
    slip = free_rolling_slip(lyasko_model(), LYASKO["clay"], 8000.0, circumstances)
    torque = lyasko_model().predict(Conditions(np.array([slip]), np.array([8000.0])), LYASKO["clay"])
    assert -0.3 < slip < -0.02
    assert torque.driving_torque_nm[0] == pytest.approx(0.0, abs=3.0)


def quiet(outboard: bool) -> VirtualSetup:
    transducer = TransducerSetup(
        drawbar_pull_noise_n=0,
        load_noise_n=0,
        torque_noise_nm=0,
        white_noise_n=0,
        white_noise_nm=0,
        zero_offset_n=(0, 0),
        latency_s=0.0,
        clock_ppm=0.0,
    )
    parts = {} if outboard else {"outboard_mass_kg": 0.0, "outboard_inertia_kgm2": 0.0}
    return replace(SHORT, transducer=transducer, vehicle=VehicleSetup(**parts))


def test_outboard_parts_are_felt_with_the_right_sign() -> None:
    with_parts, without = simulated(quiet(True), 3), simulated(quiet(False), 3)
    truth = with_parts.truth
    at = (with_parts.sensors["transducer"]["drawbar_pull"].time_ns - START_NS) * 1e-9 - 0.25
    a = np.interp(at, truth.time_s, truth.ground_acceleration_mps2)
    alpha = np.interp(at, truth.time_s, truth.wheel_acceleration_radps2)
    for name, expected in (("drawbar_pull", -75 * a), ("driving_torque", 8 * alpha)):
        difference = values_of(with_parts, "transducer", name) - values_of(without, "transducer", name)
        assert difference == pytest.approx(expected, abs=0.01 * np.abs(expected).max())


def test_the_same_seed_gives_the_same_run_and_another_one_another() -> None:
    first = simulated(SHORT, 7)
    again = simulated.__wrapped__(SHORT, 7)
    other = simulated(SHORT, 8)
    for sensor, channels in first.sensors.items():
        for name, channel in channels.items():
            assert np.array_equal(channel.values, again.sensors[sensor][name].values)
            assert np.array_equal(channel.time_ns, again.sensors[sensor][name].time_ns)
    assert np.ptp(other.truth.slip - first.truth.slip) > 0.1


def test_switching_one_noise_off_leaves_the_others_as_they_are() -> None:
    silent = replace(SHORT, gnss=GnssSetup(speed_noise_mps=0), transducer=TransducerSetup(torque_noise_nm=0))
    noisy, quieter = simulated(SHORT, 7), simulated(silent, 7)
    assert np.array_equal(
        values_of(noisy, "transducer", "drawbar_pull"), values_of(quieter, "transducer", "drawbar_pull")
    )
    assert np.array_equal(values_of(noisy, "gnss", "latitude"), values_of(quieter, "gnss", "latitude"))
    assert not np.array_equal(values_of(noisy, "gnss", "ground_speed"), values_of(quieter, "gnss", "ground_speed"))
    assert np.array_equal(noisy.truth.drawbar_pull_n, quieter.truth.drawbar_pull_n)


def test_runs_of_both_directions_share_one_line() -> None:
    out, back = (simulated(SHORT, 7, info=RunInfo(id=d, direction=d)).truth for d in ("out", "back"))
    assert out.track_position_m[0] == 0
    assert np.all(np.diff(out.track_position_m) >= 0)
    assert np.all(np.diff(back.track_position_m) <= 0)
    assert out.track_position_m + back.track_position_m == pytest.approx(60.0)


def test_a_drawn_soil_scatters_as_the_laboratory_says() -> None:
    rng = np.random.default_rng(0)
    drawn = [drawn_soil(SOILS["sandy"], rng) for _ in range(4000)]
    for name, sigma in LABORATORY_SPREAD.items():
        ratio = np.log([getattr(soil, name) / getattr(SOILS["sandy"], name) for soil in drawn])
        assert np.std(ratio) == pytest.approx(sigma, rel=0.05)
        assert np.mean(ratio) == pytest.approx(0.0, abs=4 * sigma / np.sqrt(4000))
    same = drawn_soil(SOILS["clay"], rng, {})
    assert replace(same, source=SOILS["clay"].source) == SOILS["clay"]
    with pytest.raises(ConfigError, match=r"cohesion_pa") as refused:
        drawn_soil(SOILS["clay"], rng, {"cohesion": 0.1})
    assert refused.value.exit_code == 2


def test_a_soil_that_cannot_carry_the_wheel_is_told() -> None:
    weak = replace(SOILS["clay"], cohesion_pa=100.0, cohesive_modulus=1e3, frictional_modulus=5e3)
    with pytest.raises(DataError, match="cannot carry the wheel"):
        virtual_run(
            SHORT,
            WheelSoilModel(WHEEL, weak),
            {},
            RunInfo(id="weak"),
            start_ns=START_NS,
            elapsed_s=0.0,
            rng=np.random.default_rng(0),
            ring=np.random.default_rng(1),
        )
