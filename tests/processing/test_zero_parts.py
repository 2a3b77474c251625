"""Which part of a recording a zero is taken from."""

from __future__ import annotations

import numpy as np
import pytest

from daq import DataError, FloatArray, VehicleConfig
from processing.transducer_zero import TransducerSignal, determine
from processing.transducer_zero.parts import Motion, find_spin, find_standstill
from wheelsoil.wording.notes import texts_of

RATE_HZ = 1000.0
INERTIA = 8.0
VEHICLE = VehicleConfig.model_validate(
    {"wheel": {"radius_m": 0.47, "width_m": 0.3, "outboard_inertia_kgm2": INERTIA}, "vehicle": {"mass_kg": 3600}}
)


def _at(duration_s: float) -> FloatArray:
    return np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def _motion(speed_radps: FloatArray, load_n: float | FloatArray = -700.0) -> Motion:
    at = np.arange(len(speed_radps)) / RATE_HZ
    psi = np.cumsum(speed_radps) / RATE_HZ
    return Motion((at, np.broadcast_to(load_n, at.shape).astype(np.float64)), (at, psi), None)


def test_spin_up_and_run_out_are_left_out() -> None:
    at = _at(30.0)
    speed = np.interp(at, [0, 2, 8, 20, 26, 30], [0, 0, 7, 7, 0, 0])
    part = find_spin(_motion(speed), 1700.0)
    assert part is not None
    assert 7.4 < part.start_s < 9.0  # a revolution that is 4 % slower than the next still counts
    assert 19.0 < part.stop_s < 20.6
    assert part.revolutions == int((part.stop_s - part.start_s) * 7 / (2 * np.pi) + 0.1)
    assert part.mean_speed_radps == pytest.approx(7, rel=0.01)


def test_what_stands_on_the_ground_meanwhile_is_left_out() -> None:
    at = _at(30.0)
    part = find_spin(_motion(np.full(len(at), 7.0), np.where(at < 12, 8800.0, -700.0)), 1700.0)
    assert part is not None
    assert part.start_s >= 11.8
    assert find_spin(_motion(np.full(len(at), 7.0), 8800.0), 1700.0) is None
    rest = find_standstill(_motion(np.zeros(len(at)), np.where(at < 12, 8800.0, -700.0)), (0.0, 1700.0))
    assert rest is not None and (rest.start_s, rest.stop_s) == pytest.approx((12.5, 29.75))


def test_rocking_is_no_spin() -> None:
    at = _at(30.0)
    assert find_spin(_motion(4 * np.sin(2 * at)), 1700.0) is None
    assert find_standstill(_motion(4 * np.sin(2 * at)), (0.0, 1700.0)) is None


def test_the_longest_rest_counts() -> None:
    at = _at(20.0)
    part = find_standstill(_motion(np.where((at > 5) & (at < 7), 3.0, 0.0)), (0.0, 1700.0))
    assert part is not None
    assert part.method == "standstill"
    assert 7.0 < part.start_s < 9.0
    assert part.stop_s > 19.5
    assert part.angle_rad == pytest.approx(6.0, abs=0.01)


def test_a_wheel_that_runs_out_by_itself_is_used_and_its_inertia_taken_out_of_the_torque() -> None:
    at = _at(16.0)
    speed = 9 * np.exp(-at / 9)
    psi = np.cumsum(speed) / RATE_HZ
    rng = np.random.default_rng(2)
    torque = 5.0 + INERTIA * np.gradient(speed, at) + rng.standard_normal(len(at))
    load = TransducerSignal("W.Fz", "vertical_load", "N", 1.0, 2.0, at, -700 + 20 * rng.standard_normal(len(at)))
    moment = TransducerSignal("W.My", "driving_torque", "Nm", 1.0, 0.5, at, torque)
    found = determine([load, moment], (at, psi), None, VEHICLE)
    assert found.part.method == "spin"
    assert found.part.revolutions >= 7
    assert found.channels["W.My"].offset == pytest.approx(5.0, abs=0.25)
    assert np.mean(torque) < 2
    assert any("outboard inertia, 8 kg m2" in remark for remark in texts_of(found.remarks))


def test_two_revolutions_are_needed() -> None:
    for count in (2100, 2400, 2700):  # up to one with 2 3/4
        part = find_spin(_motion(np.full(count, 6.3)), 1700.0)
        assert part is not None and part.revolutions == 2
    at = _at(1.5)
    load = TransducerSignal("W.Fz", "vertical_load", "N", 1.0, 2.0, at, np.full(len(at), -700.0))
    with pytest.raises(DataError, match="two revolutions"):
        determine([load], (at, 6.3 * at), None, VEHICLE)
