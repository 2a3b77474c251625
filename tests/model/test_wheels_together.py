"""Wheels of one vehicle weighed together: what they share, what is of one wheel alone, and what counts once."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_results import made_once

from model.diagnosis import Campaign, DiagnosisOptions, OfVehicle, diagnose
from model.diagnosis.core.shapes import Kind, Shape
from model.diagnosis.findings.adequacy import kinds_of as kinds_of_shapes
from model.diagnosis.findings.held_out import bagged, kinds_of, predict_held_out
from model.diagnosis.findings.set_fit import fit_set, soils_with
from model.diagnosis.time_series.columns import Grams, soil_places
from model.diagnosis.time_series.evidence import log_evidence, log_likelihood_of_run
from model.diagnosis.time_series.linearise import SENSORS
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, linearise_campaigns
from model.diagnosis.time_series.noise import Process, constant_sigmas, constants
from model.effects import EFFECTS, parted
from model.effects.catalogue import at_wheel
from processing import ProcessOptions
from wheelsoil.simulation import SimulationOptions, simulate_campaign
from wheelsoil.workflows.diagnosis import campaigns_of, vehicles_of
from wheelsoil.workflows.runs import Files, process_runs

GAIN = 0.12
WHEELS = ("FL", "RL")


def test_an_effect_at_one_wheel_is_a_family_of_its_own() -> None:
    found = EFFECTS["torque_gain@FR"]
    assert (found.key(), found.name, found.form) == ("torque_gain@FR", "torque_gain@FR", "")
    assert found.parameters == EFFECTS["torque_gain"].parameters and found is at_wheel(EFFECTS["torque_gain"], "FR")
    assert list(found.parameter_keys().values()) == ["torque_gain@FR.relative"]
    assert "torque_gain@FR" not in list(EFFECTS) and "torque_gain@FR" in EFFECTS
    assert parted("torque_gain@FR") == ("torque_gain", "FR") and parted("slip_sinkage") == ("slip_sinkage", "")
    assert pickle.loads(pickle.dumps(found)) is found


@pytest.mark.parametrize("key", ["vasilev", "speed_bias", "multi_pass", "nothing_of_that_name"])
def test_what_acts_at_all_wheels_has_no_wheel(key: str) -> None:
    with pytest.raises(KeyError):
        EFFECTS[f"{key}@FR"]


def test_transducers_and_tyres_are_of_a_wheel() -> None:
    of_wheels = {key for key, effect in EFFECTS.items() if effect.goes_with_a_wheel()}
    gains = {"drawbar_pull_gain", "torque_gain", "load_gain", "crosstalk"}
    zeros = {"drawbar_pull_zero", "torque_zero", "load_zero", "zero_drift"}
    assert of_wheels == gains | zeros | {"wheel_radius", "tyre_flattening"}


LABELS = ("tan_phi", "cohesion_pa", *SENSORS)


@given(st.lists(st.sampled_from(["", "clay", "sandy"]), min_size=1, max_size=5))
@settings(max_examples=30)
def test_wheels_of_a_vehicle_have_one_soil_and_sensors_of_their_own(vehicles: list[str]) -> None:
    given_soils = [(OfVehicle(name, f"W{i}", 2) if name else None, LABELS) for i, name in enumerate(vehicles)]
    places = soil_places(given_soils)
    soils = len({name or i for i, name in enumerate(vehicles)})
    every = np.concatenate(places)
    assert set(every.tolist()) == set(range(2 * soils + len(SENSORS) * len(vehicles))), "without a gap"
    assert all(len(set(own.tolist())) == len(LABELS) for own in places)
    for i, first in enumerate(vehicles):
        for j, second in enumerate(vehicles[:i]):
            shared = set(places[i].tolist()) & set(places[j].tolist())
            assert shared == (set(places[i][:2].tolist()) if first and first == second else set())


def test_errors_that_wheels_share_are_as_uncertain_as_at_one() -> None:
    names = [name for name, _ in constants(("dp", "t"))]
    values = {name: 1.0 + i for i, name in enumerate(names)}
    one, four = (constant_sigmas(("dp", "t"), values, wheels) for wheels in (1, 4))
    shared = [name.endswith("_run_to_run") for name in names]
    np.testing.assert_array_equal(one, [values[name] for name in names])
    np.testing.assert_array_equal(four / one, np.where(shared, 2.0, 1.0))
    assert Process("speed_white_mps", None, over_distance=False, loading="speed").times(4) == 2.0
    assert Process("load_noise_n", "load_noise_time_s", over_distance=False, loading="load").times(4) == 1.0


def test_what_no_cause_describes_is_asked_of_all_wheels_at_once() -> None:
    shapes = [
        Shape(Kind.SLIP, "dp", campaign=name, vehicle=vehicle)
        for name, vehicle in (("wheel FL", "clay"), ("wheel RL", "clay"), ("day 2", ""))
    ]
    assert [own.tolist() for own in kinds_of_shapes(shapes)] == [[0, 1], [2]]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, ...]:
    """Return the campaigns of two wheels, the rear one's torque with a wrong gain."""
    options = SimulationOptions(
        soil="sandy",
        seed=3,
        runs=4,
        duration_s=15.0,
        wheels=2,
        faulty_wheel="RL",
        effects={"torque_gain": {"relative": GAIN}},
    )

    def simulate(folder: Path) -> None:
        simulate_campaign(folder / "campaign", options)

    folder = made_once(tmp_path_factory, "wheels_together", simulate) / "campaign"
    opened = Files().runs_of_wheels([folder], lambda _: None)
    purpose = ProcessOptions(purpose="diagnose")
    return vehicles_of({w: campaigns_of([folder], process_runs(runs, purpose)) for w, runs in opened.items()})


@pytest.fixture(scope="module")
def linearised(wheels: tuple[Campaign, ...]) -> LinearisedCampaign:
    return linearise_campaigns(wheels)


def test_campaigns_of_wheels_know_their_vehicle(wheels: tuple[Campaign, ...]) -> None:
    assert [c.name for c in wheels] == ["wheel FL", "wheel RL"]
    assert [c.of_vehicle for c in wheels] == [OfVehicle("campaign", w, 2) for w in WHEELS]
    two = vehicles_of({w: [replace(wheels[0], name=n) for n in ("clay", "sandy")] for w in WHEELS})
    assert [c.name for c in two] == ["clay, wheel FL", "sandy, wheel FL", "clay, wheel RL", "sandy, wheel RL"]
    assert {c.of_vehicle.wheels for c in two if c.of_vehicle} == {2}


def test_the_error_of_one_transducer_is_named_with_its_wheel(wheels: tuple[Campaign, ...]) -> None:
    found = diagnose(wheels, DiagnosisOptions())
    assert found.verdict == "named"
    [cause] = found.causes
    assert cause.name == "torque_gain@RL"
    [size] = cause.parameters
    assert size.interval95[0] < GAIN < size.interval95[1]
    assert [soil.campaign for soil in found.soils] == ["campaign"], "they have one soil"
    assert not found.next_run and found.information is None


def test_a_drive_is_all_wheels_of_it(linearised: LinearisedCampaign) -> None:
    grams = linearised.grams
    assert grams.drive_count == 4 and len(grams.run_names) == 8
    np.testing.assert_array_equal(grams.drives, np.tile(np.arange(4), 2))
    assert len(kinds_of(grams)) == 4
    left = grams.without(1)
    others = grams.chosen(grams.drives != 1)
    np.testing.assert_allclose(left.total, others.total, rtol=1e-9, atol=1e-6)
    assert int(left.samples.sum()) == int(others.samples.sum())
    expected = log_evidence(grams) - log_evidence(others)
    assert log_likelihood_of_run(grams, 1) == pytest.approx(expected, abs=1e-6)


def test_resampled_drives_take_all_their_wheels(linearised: LinearisedCampaign) -> None:
    """One drive stands for its wheels: put together as one run, they have the same probabilities."""
    grams = linearised.grams
    summed = replace(
        grams,
        matrices=np.stack([grams.matrices[grams.drives == d].sum(axis=0) for d in range(4)]),
        log_determinants=np.zeros(4),
        samples=np.ones(4, np.intp),
        run_names=tuple("abcd"),
        own=(),
        measured=None,
        drive=None,
    )
    plain: list[Grams] = [replace(grams, own=()), summed]
    each = [bagged(g, np.random.default_rng(5), linearised.excluded, 2).families() for g in plain]
    assert each[0] == pytest.approx(each[1], abs=1e-6)


def test_a_held_out_drive_is_predicted_at_every_wheel(linearised: LinearisedCampaign) -> None:
    fit = fit_set(linearised, linearised.best.keys, starts="one")
    found = predict_held_out(linearised, fit, 2)
    runs = [data.samples[data.samples.run == 2] for data in linearised.campaigns]
    assert len(found.slip) == sum(map(len, runs)) == len(found.measured["dp"]) == len(found.variance["t"])
    np.testing.assert_array_equal(found.measured["t"], np.concatenate([run.measured["t"] for run in runs]))
    assert np.isfinite(found.predicted["dp"]).mean() > 0.95
    [soil] = soils_with(fit, linearised, np.eye(len(fit.estimate)))
    assert soil.campaign == "campaign"
    assert fit.problem.drives.max() == 3
