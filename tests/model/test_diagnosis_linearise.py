"""Columns are derivatives of what the model says, at the same slip as the residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from model.diagnosis import considered, samples_of
from model.diagnosis.time_series import coverage_of
from model.diagnosis.time_series.linearise import (
    LATE_WHEEL,
    SECANT_SHARE,
    SENSORS,
    Linear,
    Point,
    Simulation,
    late_wheel,
    linearise,
    simulated,
    soil_space,
)
from model.diagnosis.time_series.samples import Samples
from model.effects import EFFECTS
from model.wheel_soil import SoilPrior

CAUSES = {"H_m": 0.02, "crosstalk.coefficient": 0.01, "torque_gain.relative": 0.03, "wheel_radius.relative": 0.01}


@pytest.fixture(scope="module")
def about() -> tuple[Simulation, Samples, Linear]:
    campaign = simulated_campaign(runs=2)
    samples = samples_of(campaign)
    samples = samples[np.arange(len(samples)) % 3 == 0]
    simulation = Simulation(
        campaign.wheel,
        campaign.soil,
        soil_space(campaign.soil_prior),
        considered(coverage_of(campaign, samples), tuple(EFFECTS), "balanced"),
        "balanced",
    )
    soil = np.linspace(-0.5, 0.5, len(simulation.space))
    point = Point(soil, dict(CAUSES), np.full(len(samples), 0.01), np.full(len(samples), 0.05))
    return simulation, samples, linearise(simulation, samples, point)


def said(about: tuple[Simulation, Samples, Linear], soil: np.ndarray, causes: dict[str, float]) -> np.ndarray:
    """Return the model at the samples' means, not averaged over instants."""
    simulation, _, linear = about
    values = {**simulation.space.values(soil), **causes}
    found = simulation.model(causes).predict(linear.conditions, values)
    return np.stack([found.drawbar_pull_n, found.driving_torque_nm])


def close(found: np.ndarray, expected: np.ndarray, rtol: float = 2e-3) -> bool:
    return bool(np.allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max()))


def test_a_rolling_radius_acts_in_the_slip_only(about: tuple[Simulation, Samples, Linear]) -> None:
    """With radius_m in its place, torque and stresses changed, and a gain was named for it."""
    simulation, samples, linear = about
    campaign = simulated_campaign(runs=2)
    slower = [
        replace(run, wheel_speed_radps=run.wheel_speed_radps / 1.04, rolling_radius_m=1.04 * run.wheel_radius_m)
        for run in campaign.runs
    ]
    at = samples_of(replace(campaign, runs=tuple(slower)))
    at = at[np.arange(len(at)) % 3 == 0]
    soil = np.linspace(-0.5, 0.5, len(simulation.space))
    point = Point(soil, dict(CAUSES), np.full(len(at), 0.01), np.full(len(at), 0.05))
    found = linearise(replace(simulation, rolling_radius_m=1.04 * simulation.wheel.radius_m), at, point)
    np.testing.assert_allclose(at.conditions.slip, samples.conditions.slip, atol=1e-9)
    assert close(found.speed, linear.speed, 1e-6) and close(found.centre, linear.centre, 1e-6)


def test_soil_columns_are_derivatives(about: tuple[Simulation, Samples, Linear]) -> None:
    linear = about[2]
    for i in range(6):
        step = np.zeros(len(linear.point.soil))
        step[i] = 1e-4
        up, down = (said(about, linear.point.soil + side * step, linear.point.causes) for side in (1, -1))
        assert close(linear.soil[..., i], (up - down) / 2e-4)


def test_cause_columns_are_derivatives_at_their_values(about: tuple[Simulation, Samples, Linear]) -> None:
    simulation, _, linear = about
    for i, (effect, which, key) in enumerate(simulation.parameters):
        scale = effect.parameters[which].towards(simulation.wheel)
        at = linear.point.causes.get(key, effect.parameters[which].neutral)
        if effect.secant:
            moved = said(about, linear.point.soil, {**linear.point.causes, key: at + SECANT_SHARE * scale})
            expected = (moved - said(about, linear.point.soil, linear.point.causes)) / (SECANT_SHARE * scale)
        elif effect.parameters[which].one_sided and key not in linear.point.causes:
            near, far = (
                said(about, linear.point.soil, {**linear.point.causes, key: at + share * scale})
                for share in (1e-4, 2e-4)
            )
            here = said(about, linear.point.soil, linear.point.causes)
            expected = (4.0 * near - far - 3.0 * here) / (2e-4 * scale)
        else:
            up, down = (
                said(about, linear.point.soil, {**linear.point.causes, key: at + side * 1e-4 * scale})
                for side in (1, -1)
            )
            expected = (up - down) / (2e-4 * scale)
        assert close(linear.causes[..., i], expected, 1e-2), key


def test_the_speed_moves_both_channels_through_the_slip(about: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = about
    step = 1e-3
    up, here, down = (
        linearise(simulation, samples, Point(linear.point.soil, linear.point.causes, linear.point.speed_mps + side))
        for side in (step, 0.0, -step)
    )
    slope = (up.value - down.value) / (2 * step)
    assert np.linalg.norm(linear.speed - slope) < 0.1 * np.linalg.norm(slope)  # of the mean, not the mean of it
    bend = (up.value + down.value - 2 * here.value) / step**2
    assert np.linalg.norm(linear.curvature - bend) < 0.3 * np.linalg.norm(bend)


def test_the_value_is_that_of_the_mean_of_three_instants(about: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = about
    late = linear.soil[..., -len(SENSORS) :] @ linear.point.soil[-len(SENSORS) :]
    assert np.array_equal(linear.value, simulated(simulation, samples, linear.point) + late)
    plain = said(about, linear.point.soil, linear.point.causes)
    assert 1.0 < np.std(linear.value[0] - late[0] - plain[0]) < 60.0


def test_only_causes_show_at_standstill(about: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = about
    names = [key for _, _, key in simulation.parameters]
    load = samples.rests.conditions.vertical_load_n
    assert np.allclose(linear.rest_value[0], 0.01 * load)
    assert np.allclose(linear.rest_causes[0][:, names.index("crosstalk.coefficient")], load)
    assert np.allclose(linear.rest_causes[1][:, names.index("torque_zero.offset_nm")], 1.0)
    assert not linear.rest_causes[..., names.index("H_m")].any()


def test_the_soils_coordinates_are_independent_and_of_unit_variance() -> None:
    campaign = simulated_campaign(runs=2)
    prior = campaign.soil_prior
    space = soil_space(prior)
    rng = np.random.default_rng(0)
    drawn = np.array([list(space.values(u).values()) for u in rng.standard_normal((4000, len(space)))])
    relative = np.std(np.log(drawn / prior.mean), axis=0)
    assert np.allclose(relative, np.sqrt(np.diag(prior.covariance)) / prior.mean, rtol=0.1)
    wide = np.diag(prior.covariance).copy()
    wide[0] = 0.0
    correlation = np.eye(6)
    correlation[4, 5] = correlation[5, 4] = -0.9
    sigma = np.sqrt(wide)
    known = soil_space(SoilPrior(prior.mean, correlation * np.outer(sigma, sigma), "test"))
    assert len(known) == 5 + len(SENSORS)
    assert "cohesion_pa" not in known.labels
    jacobian = known.jacobian(np.zeros(len(known)))
    assert np.allclose(jacobian @ jacobian.T, correlation * np.outer(sigma, sigma))


def test_a_late_wheel_speed_acts_by_the_slip_and_by_the_compensated_inertia(
    about: tuple[Simulation, Samples, Linear],
) -> None:
    """Ring and bus late by 10 ms: what is measured less what the model says of the measured wheel speed."""
    _, _, linear = about
    late_s, inertia = 0.01, 8.0
    at = replace(linear.conditions, compensated_inertia_kgm2=inertia)
    omega, spin, change = at.wheel_speed_radps, at.wheel_acceleration_radps2, at.wheel_jerk_radps3
    none, own = np.zeros_like(linear.speed), np.stack([np.zeros(len(omega)), np.full(len(omega), 5.0)])
    scaled = late_s / LATE_WHEEL["wheel_delay_s"]
    told = late_wheel(at, linear.speed, none, linear.channels)[..., 0] * scaled
    true_omega = omega + spin * late_s
    by_slip = linear.speed * (at.ground_speed_mps * omega / true_omega - at.ground_speed_mps)
    assert close(told[0], by_slip[0], 5e-2)
    plain, undeclared = (
        late_wheel(linear.conditions, linear.speed, by_spin, linear.channels)[..., 0] * scaled
        for by_spin in (none, own)
    )
    assert np.allclose(told[1] - plain[1], inertia * late_s * np.asarray(change))
    assert np.allclose(undeclared[1] - plain[1], 5.0 * late_s * np.asarray(change))
    assert np.array_equal(told[0], plain[0])
    assert np.array_equal(undeclared[0], plain[0])


def test_what_waits_for_an_edge_is_later_the_slower_the_wheel(about: tuple[Simulation, Samples, Linear]) -> None:
    linear = about[2]
    omega = np.asarray(linear.conditions.wheel_speed_radps)
    by_time, by_angle = np.moveaxis(linear.soil[0][:, -3:-1] / list(LATE_WHEEL.values()), -1, 0)
    assert np.allclose(by_angle, by_time * (1.0 / omega - 1.0 / np.median(omega)))
    assert np.ptp(omega) > 0.5


def test_an_error_of_the_acceleration_is_in_the_compensated_pull(about: tuple[Simulation, Samples, Linear]) -> None:
    """The mass that was added to the measurement, and what an undeclared one takes off the model."""
    simulation, samples, linear = about
    assert not linear.acceleration.any()
    heavy = replace(samples, conditions=replace(samples.conditions, compensated_mass_kg=np.full(len(samples), 75.0)))
    causes = {**linear.point.causes, "wheel_inertia.scale": 0.2}
    found = linearise(simulation, heavy, replace(linear.point, causes=causes))
    assert np.allclose(found.acceleration[0], -75.0 - 0.2 * 75.0)
    assert not found.acceleration[1].any()
