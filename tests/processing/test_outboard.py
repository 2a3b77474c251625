"""Signs of the outboard compensation, against a simulated wheel: soil force in, hub force out."""

import numpy as np
import pytest
from synthetic_run import RADIUS_M, START_NS, channel, driven_speed, speeds, stamps, vehicle

from daq import VehicleConfig
from daq.config import TransducerSection, WheelSection
from processing.pipeline import process

MASS, INERTIA = 75.0, 10.0


def _config(zero: str = "lifted") -> VehicleConfig:
    wheel = WheelSection(radius_m=RADIUS_M, width_m=0.3, outboard_mass_kg=MASS, outboard_inertia_kgm2=INERTIA)
    return vehicle(wheel=wheel, transducer=TransducerSection(zero=zero))


def _hub_forces(duration_s: float) -> tuple[dict, np.ndarray]:  # type: ignore[type-arg]
    """Integrate m dV/dt = F_soil - F_hub and I domega/dt = T_hub - T_soil for F_hub and T_hub, soil forces constant."""
    at = stamps(duration_s, 1000.0)
    acceleration = np.gradient(driven_speed(at), at)
    hub = {
        "drawbar_pull": channel("D", at, 500.0 - MASS * acceleration),
        "driving_torque": channel("T", at, 300.0 + INERTIA * acceleration / RADIUS_M),
        "vertical_load": channel("W", at, np.full(len(at), 7000.0)),
    }
    return hub, acceleration


def test_what_accelerates_the_wheel_is_given_back_to_the_soil() -> None:
    hub, acceleration = _hub_forces(30.0)
    run = process(speeds(30.0) | hub, _config())
    assert np.std(MASS * acceleration) > 50
    np.testing.assert_allclose(run.drawbar_pull_n[run.used], 500.0, atol=0.5)
    np.testing.assert_allclose(run.driving_torque_nm[run.used], 300.0, atol=0.2)
    np.testing.assert_allclose(run.vertical_load_n[run.used], 7000.0, atol=1e-6)


def test_without_declared_parts_nothing_is_compensated() -> None:
    hub, _ = _hub_forces(30.0)
    run = process(speeds(30.0) | hub, vehicle())
    assert np.ptp(run.drawbar_pull_n[run.used]) > 150
    correlation = np.corrcoef(run.drawbar_pull_n[run.used], run.ground_acceleration_mps2[run.used])[0, 1]
    assert correlation < -0.99


def test_a_spin_zero_lacks_the_outboard_weight() -> None:
    hub, _ = _hub_forces(30.0)
    run = process(speeds(30.0) | hub, _config("spin"))
    np.testing.assert_allclose(run.vertical_load_n[run.used], 7000.0 + MASS * 9.80665, atol=1e-6)


def test_the_noise_of_the_derivative_is_in_the_sigma() -> None:
    hub, _ = _hub_forces(60.0)
    rng = np.random.default_rng(3)
    channels = speeds(60.0, rng=rng)
    speed = channels["ground_speed"]
    noisy = speed.values + 0.05 * rng.standard_normal(len(speed))
    at = (speed.time_ns - START_NS) * 1e-9
    run = process(channels | hub | {"ground_speed": channel("v", at, noisy)}, _config())
    error = run.drawbar_pull_n[run.used] - 500.0
    assert np.mean(run.drawbar_pull_sigma_n) == pytest.approx(np.std(error), rel=0.15)
