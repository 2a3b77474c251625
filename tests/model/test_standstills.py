"""Standstills show zeros with released brakes only, and the pull's only as well as the ground is level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import linearised, simulated_campaign

from daq import Brakes
from model import LackCode
from model.diagnosis import Campaign, bound_rows_of_runs, not_identifiable, samples_of
from model.diagnosis.time_series import coverage_of
from model.diagnosis.time_series.columns import columns_of
from model.diagnosis.time_series.noise import hyper_priors
from model.effects import EFFECTS
from model.simulation import Stance, VehicleSetup, VirtualRun
from model.simulation.stance import standing_forces
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import simulated_run, true_stance
from wheelsoil.workflows.grading import grade_of


def braked(campaign: Campaign, brakes: Brakes) -> Campaign:
    """Return the campaign with other brakes at every standstill."""
    runs = []
    for run in campaign.runs:
        stands = tuple(replace(stand, brakes=brakes) for stand in run.quality.standstills)
        runs.append(replace(run, quality=replace(run.quality, standstills=stands)))
    return replace(campaign, runs=tuple(runs))


@pytest.mark.parametrize("brakes", ["held", "unknown"])
def test_a_braked_standstill_shows_no_zero(brakes: Brakes) -> None:
    released = simulated_campaign(runs=2)
    seen = samples_of(released).rests
    stands = [stand.duration_s for run in released.runs for stand in run.quality.standstills]
    assert len(seen) == 4 and ((seen.duration_s < stands) & (seen.duration_s > np.subtract(stands, 1.0))).all()
    held = braked(released, brakes)
    samples = samples_of(held)
    assert len(samples.rests) == 0 and set(samples.rests.measured) == {"dp", "t", "slip"}
    assert not_identifiable(coverage_of(held, samples))["torque_zero"].code == LackCode.NOT_AT_STANDSTILL
    assert np.isfinite(bound_rows_of_runs(released.runs).torque_at_rest_nm).all()
    assert np.isnan(bound_rows_of_runs(held.runs).torque_at_rest_nm).all()


def test_a_run_is_not_spoilt_by_what_a_brake_holds() -> None:
    (run,) = simulated_campaign(runs=1).runs
    stands = tuple(
        replace(s, levels=s.levels | {"driving_torque": 400.0}, brakes="held") for s in run.quality.standstills
    )
    held = replace(run, quality=replace(run.quality, standstills=stands))
    free = replace(run, quality=replace(run.quality, standstills=tuple(replace(s, brakes="released") for s in stands)))
    assert not any("take a zero" in why for why in grade_of(held).reasons)
    assert any("take a zero" in why for why in grade_of(free).reasons)


def test_the_pull_at_rest_is_one_value_a_run_that_grows_with_the_load_and_the_torque_s_is_small() -> None:
    simulation, samples, linear = linearised(3)
    found = columns_of(simulation, samples, linear, np.zeros(len(samples)))
    priors = hyper_priors(samples)
    load = np.asarray(samples.rests.conditions.vertical_load_n)
    at = {name: found.constants.index(name) - len(found.constants) for name in found.constants}
    pull = found.rests[..., at["drawbar_pull_standing_n"]]
    torque = found.rests[..., at["driving_torque_standing_nm"]]
    np.testing.assert_allclose(pull[0] / load, pull[0][0] / load[0])
    assert not pull[1].any() and not torque[0].any() and (torque[1] == 1.0).all()
    assert not found.rows[..., at["drawbar_pull_standing_n"]].any()
    assert not found.rows[..., at["driving_torque_standing_nm"]].any()
    middle = float(np.median(samples.conditions.vertical_load_n))
    tilt, rut = middle * np.sin(np.radians(0.3)), 0.01 * middle
    assert priors["drawbar_pull_standing_n"].centre == pytest.approx(np.hypot(np.sqrt(3) * tilt, rut))
    assert priors["driving_torque_standing_nm"].centre < 5.0
    rests = samples.rests
    lifted = replace(rests, conditions=replace(rests.conditions, vertical_load_n=np.zeros(len(rests))))
    found = columns_of(simulation, replace(samples, rests=lifted), linear, np.zeros(len(samples)))
    assert not found.rests[0, :, at["drawbar_pull_standing_n"]].any()


def test_a_slope_is_that_of_the_declared_outboard_mass() -> None:
    campaign = replace(simulated_campaign(runs=2), outboard_mass_kg=40.0)
    samples = samples_of(campaign)
    assert (samples.conditions.outboard_mass_kg == 40.0).all()
    assert (samples_of(replace(campaign, outboard_mass_kg=0.0)).conditions.outboard_mass_kg == 75.0).all()
    assert campaign.runs[0].outboard_mass_kg == 75.0
    assert not EFFECTS["slope"].at_standstill


OUT, BACK = 1.0, -1.0


@pytest.mark.parametrize("direction", [OUT, BACK])
def test_a_released_wheel_holds_its_own_share_and_no_torque(direction: float) -> None:
    forces = standing_forces(Stance(0.3), VehicleSetup(), direction, 500.0, 0.47, 1500.0, np.random.default_rng(0))
    own = direction * (8000 + 0.4 * 500 * 9.80665) * np.sin(np.radians(0.3))
    np.testing.assert_allclose(forces.drawbar_pull_n, own)
    assert not forces.driving_torque_nm.any()


def test_a_held_wheel_holds_any_share_and_the_torque_of_it_and_of_the_rut() -> None:
    weight = 3600 * 9.80665 * np.sin(np.radians(0.3))
    rng = np.random.default_rng(0)
    drawn = [standing_forces(Stance(0.3, "held"), VehicleSetup(), OUT, 0.0, 0.47, 1000.0, rng) for _ in range(200)]
    pull = np.array([one.drawbar_pull_n for one in drawn])
    kept = np.array([one.driving_torque_nm for one in drawn]) / 0.47 - pull
    assert 0.0 <= kept.min() < 20.0 and 180.0 < kept.max() <= 200.0
    share = (pull + 0.5 * kept) / weight
    assert 0.0 <= share.min() < 0.05 and 0.55 < share.max() <= 0.6
    assert np.ptp(share, axis=1).max() > 0.3


def run_of(**options: object) -> VirtualRun:
    return simulated_run(SimulationOptions(runs=2, duration_s=15.0, noise=0.0, **options), 0)  # type: ignore[arg-type]


def test_the_simulator_tilts_the_ground_and_holds_the_brakes() -> None:
    level = run_of(tilt_deg=0.0, brakes="released")
    tilted = run_of(tilt_deg=0.3, brakes="released")
    rolls = level.truth.ground_speed_mps > 1.0
    assert not level.truth.drawbar_pull_n[0]
    assert tilted.truth.drawbar_pull_n[0] == pytest.approx(8000 * np.sin(np.radians(0.3)))
    np.testing.assert_allclose(tilted.truth.drawbar_pull_n[rolls], level.truth.drawbar_pull_n[rolls])
    read = [run.sensors["transducer"]["drawbar_pull"].values for run in (level, tilted)]
    moving = np.interp(level.sensors["transducer"]["drawbar_pull"].time_ns, *_moving(level)) > 0.5
    outboard = -75 * 9.80665 * np.sin(np.radians(0.3))
    assert np.mean(read[1][moving] - read[0][moving]) == pytest.approx(outboard, abs=0.05)
    held = run_of(tilt_deg=0.3, brakes="held")
    assert held.truth.driving_torque_nm[0] > 0 and held.truth.driving_torque_nm[-1] > 0
    assert held.truth.driving_torque_nm[0] != pytest.approx(held.truth.driving_torque_nm[-1], rel=0.01)


def _moving(run: VirtualRun) -> tuple[np.ndarray, np.ndarray]:
    stamps = run.start_ns + (run.truth.time_s + 0.25) * 1e9
    return stamps, (run.truth.ground_speed_mps > 1.0).astype(float)


def test_stances_are_drawn_up_to_three_tenths_of_a_degree_and_held_in_most() -> None:
    drawn = [true_stance(SimulationOptions(seed=seed)) for seed in range(300)]
    tilt = np.array([one.tilt_deg for one in drawn])
    assert 0.25 < np.abs(tilt).max() <= 0.3 and abs(tilt.mean()) < 0.03
    assert 0.6 < np.mean([one.brakes == "held" for one in drawn]) < 0.8
    given = true_stance(SimulationOptions(seed=1, tilt_deg=2.0, brakes="released"))
    assert given == Stance(2.0, "released")
