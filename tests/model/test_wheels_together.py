"""Wheels of one vehicle weighed together: what they share, what is of one wheel alone, and what counts once."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from shared_results import made_once

from daq import OUTPUTS, FloatArray, IndexArray, StaticTest
from model.diagnosis import Campaign, DiagnosisOptions, Kind, OfVehicle, Shape, diagnose, samples_of
from model.diagnosis.findings.adequacy import Unlisted, _rms
from model.diagnosis.findings.adequacy import kinds_of as kinds_of_shapes
from model.diagnosis.findings.held_out import predict_held_out
from model.diagnosis.findings.set_fit import fit_set, soils_with
from model.diagnosis.findings.set_problem import set_problem
from model.diagnosis.pooling import Observation, SoilDeparture, soil_departure
from model.diagnosis.time_series import linearise_campaigns
from model.diagnosis.time_series.columns import soil_places
from model.diagnosis.time_series.joining import (
    APART,
    OWN_SHARES,
    OWN_SPEED,
    _on_one_clock,
    joined,
    layout_of,
    most_probable_shares,
    part_of,
    runs_of,
    side_by_side,
    smoothed_speeds,
)
from model.diagnosis.time_series.linearise import SENSORS
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.samples import on_common_blocks
from model.diagnosis.time_series.start import Start, begin, not_identifiable_in_any
from model.diagnosis.time_series.whitening import Neighbours, StateSpace, run_design, run_grams, whiten
from model.effects import EFFECTS, parted
from model.effects.catalogue import at_wheel
from model.wheel_soil import SOIL_PARAMETERS
from processing import ProcessedRun, ProcessOptions
from wheelsoil.simulation import SimulationOptions, simulate_campaign
from wheelsoil.workflows import Files, process_runs, vehicles_of

GAIN = 0.12
WHEELS = ("FL", "RL")
SPEED = ("speed_noise_mps", "speed_noise_time_s", "speed_white_mps")


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
    given_soils = [(OfVehicle(name, f"W{i}") if name else None, LABELS) for i, name in enumerate(vehicles)]
    places = soil_places(given_soils)
    soils = len({name or i for i, name in enumerate(vehicles)})
    every = np.concatenate(places)
    assert set(every.tolist()) == set(range(2 * soils + len(SENSORS) * len(vehicles))), "without a gap"
    assert all(len(set(own.tolist())) == len(LABELS) for own in places)
    for i, first in enumerate(vehicles):
        for j, second in enumerate(vehicles[:i]):
            shared = set(places[i].tolist()) & set(places[j].tolist())
            assert shared == (set(places[i][:2].tolist()) if first and first == second else set())


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
    return vehicles_of([folder], {wheel: process_runs(runs, purpose) for wheel, runs in opened.items()})


@pytest.fixture(scope="module")
def linearised(wheels: tuple[Campaign, ...]) -> LinearisedCampaign:
    return linearise_campaigns(wheels)


def test_campaigns_of_wheels_know_their_vehicle(wheels: tuple[Campaign, ...]) -> None:
    assert [c.name for c in wheels] == ["wheel FL", "wheel RL"]
    assert [c.of_vehicle for c in wheels] == [OfVehicle("campaign", w) for w in WHEELS]


def test_the_error_of_one_transducer_is_named_with_its_wheel(wheels: tuple[Campaign, ...]) -> None:
    found = diagnose(wheels, DiagnosisOptions())
    assert found.verdict == "named"
    [cause] = found.causes
    assert cause.name == "torque_gain@RL"
    [size] = cause.parameters
    assert size.interval95[0] < GAIN < size.interval95[1]
    assert [soil.campaign for soil in found.soils] == ["campaign"], "they have one soil"
    assert not found.next_run


def test_a_soil_is_held_against_its_laboratory_by_all_wheels_and_not_by_the_faulty_one(
    wheels: tuple[Campaign, ...], linearised: LinearisedCampaign
) -> None:
    def departure(data: LinearisedCampaign, **changes: object) -> SoilDeparture:
        information = data.information(1.0)
        assert information is not None
        return soil_departure(Observation("campaign", 0.0, replace(information, **changes), "all"), known)

    known: dict[str, float] = {}
    faulty = linearise_campaigns((replace(wheels[1], of_vehicle=None),))
    assert departure(faulty).p_value < 1e-9, "a gain that one wheel takes for its soil"
    together = departure(linearised)
    assert together.p_value > 0.02 and set(together.sigmas) == set(SOIL_PARAMETERS)
    assert departure(linearised, about=()).p_value < 1e-9
    known["torque_gain@RL"] = GAIN
    assert departure(linearised, about=()).p_value > 0.02, "by the passport of the transducer"
    other = replace(wheels[0], of_vehicle=None, name="another")
    assert linearise_campaigns((other, faulty.campaigns[0].campaign)).information(1.0) is None


def test_a_run_is_the_drive_of_all_wheels(linearised: LinearisedCampaign) -> None:
    grams = linearised.grams
    assert grams.run_names == ("run-1", "run-2", "run-3", "run-4") and len(grams.own) == 4
    alone = [data.grams for data in linearised.campaigns]
    assert grams.samples.tolist() == sum(of.samples for of in alone).tolist()
    assert grams.matrices.shape[1] == 1 + len(grams.soil) + len(grams.causes) + len(grams.basis)
    owners = [
        [wheel for wheel, _ in members] for members in runs_of([(d.campaign, d.samples) for d in linearised.campaigns])
    ]
    assert owners == [[0, 1]] * 4
    own = [run_design(data.samples, data.linear, data.columns) for data in linearised.campaigns]
    assert grams.design is not None and (grams.design[:, 1:] == own[1][:, 1:]).all()
    channels = (own[0][:, 0] << len(OUTPUTS)) + own[1][:, 0]  # of another vehicle with other channels another number
    assert grams.design[:, 0].tolist() == channels.tolist() and own[0][:, 0].all()


def test_wheels_that_share_nothing_are_those_by_themselves(linearised: LinearisedCampaign) -> None:
    """With a speed error of its own each, and no soil of the run, the filter of both is that of each."""
    parts = []
    for data in linearised.campaigns:
        part = part_of(data)
        nothing = {name: 1e-12 for name in part.values if name.endswith("_run_to_run")}
        same = {name: linearised.campaigns[0].noise.values[name] for name in SPEED}
        parts.append(replace(part, values={**part.values, **nothing, **same, OWN_SPEED: 1.0}))
    together = joined(parts)
    single = [replace(part, campaign=replace(part.campaign, of_vehicle=None)) for part in parts]
    layout, alone = layout_of(parts), [run_grams(*part.whitening) for part in single]
    expected = sum(turn.T @ grams.matrices.sum(axis=0) @ turn for turn, grams in zip(layout.turns, alone, strict=True))
    assert_close(together.matrices.sum(axis=0), expected)
    assert together.log_determinants.sum() == pytest.approx(sum(g.log_determinants.sum() for g in alone), rel=1e-5)
    for of_drive, first, second in zip(together.own, *(grams.own for grams in alone), strict=True):
        assert_close(of_drive.inner, block_diag(first.inner, second.inner))
        across = [gram.across @ turn for gram, turn in zip((first, second), layout.turns, strict=True)]
        assert_close(of_drive.across, np.concatenate(across))


def assert_close(found: FloatArray, expected: FloatArray) -> None:
    """Steps of one clock are whole blocks, so that they differ a little from those of each wheel's."""
    np.testing.assert_allclose(found, expected, atol=1e-4 * float(np.abs(expected).max()))


def test_the_density_of_both_wheels_is_that_of_the_whole_covariance() -> None:
    """Of two wheels on offset blocks, by the filter and by the matrix of the model's definition."""
    rng = np.random.default_rng(1)
    count, block, memory = 7, 0.2, 0.8
    times = [np.array([0.0, 0.2, 0.4, 1.0, 1.2]), np.array([0.2, 0.4, 0.6, 1.0])]
    slopes = [rng.uniform(-3.0, 3.0, (1, len(t))) for t in times]
    white, speed, share = (0.3, 0.5), 0.7, 0.2
    blocks = np.arange(count) * block
    lag = np.abs(blocks[:, None] - blocks)
    shared, own = (part * speed**2 * np.exp(-lag / memory) for part in (1.0 - share, share))
    places = [np.rint(t / block).astype(int) for t in times]
    seen = [np.zeros((len(p), count)) for p in places]
    for at, p, slope in zip(seen, places, slopes, strict=True):
        at[np.arange(len(p)), p] = slope[0]
    whole = np.concatenate(seen)
    expected = whole @ shared @ whole.T + block_diag(*(at @ own @ at.T for at in seen))
    expected += np.diag(np.repeat(np.square(white), [len(t) for t in times]))
    spaces = [
        _one_channel(p, s, w, count, (speed, memory, block)) for p, s, w in zip(places, slopes, white, strict=True)
    ]
    data = np.zeros((1, count, 2, 1))
    residual = [rng.standard_normal(len(t)) for t in times]
    for wheel, (p, r) in enumerate(zip(places, residual, strict=True)):
        data[0, p, wheel, 0] = r
    found = whiten(side_by_side(spaces, share), data)
    every = np.concatenate(residual)
    assert float((found.columns**2).sum()) == pytest.approx(every @ np.linalg.solve(expected, every), rel=1e-9)
    assert found.log_determinants[0] == pytest.approx(np.linalg.slogdet(expected)[1], rel=1e-9)


def _one_channel(
    places: IndexArray, slopes: FloatArray, white: float, count: int, speed: tuple[float, float, float]
) -> StateSpace:
    """Return the noise of one wheel with one channel that sees the speed's error and none of its slope."""
    sigma, memory, block = speed
    decay = np.exp(-block / memory)
    loadings = np.zeros((1, count, 1, 3))
    loadings[0, places, 0, 1] = slopes[0]
    noise = np.ones((1, count, 1))
    noise[0, places, 0] = white**2
    shares = np.zeros((1, count, 3, 1))
    shares[:, :, 0], shares[:, :, 2] = 1.0, 1.0
    steps = np.full((1, count, 3), [decay, 0.0, 0.0])
    near = Neighbours(*(np.array([i]) for i in range(3)), shares, np.array([decay]))
    return StateSpace(loadings, steps, np.full(3, sigma**2), noise, near)


def test_blocks_that_one_wheel_lacks_are_no_samples(wheels: tuple[Campaign, ...]) -> None:
    """The second run of the rear wheel is missing, its first begins later: the others stay where they are."""
    front, rear = wheels
    late = replace(rear.runs[0], start_ns=rear.runs[0].start_ns + 400_000_000)
    fewer = replace(rear, runs=(late, *rear.runs[2:]))
    linearised = linearise_campaigns((front, fewer))
    assert linearised.grams.run_names == ("run-1", "run-2", "run-3", "run-4")
    alone = sum(int(data.grams.samples.sum()) for data in linearised.campaigns)
    assert int(linearised.grams.samples.sum()) == alone


def test_a_wheel_whose_run_begins_later_is_on_the_blocks_of_the_others(linearised: LinearisedCampaign) -> None:
    front, rear = (part_of(data) for data in linearised.campaigns)
    first = rear.campaign.runs[0]
    late = replace(first, start_ns=first.start_ns + 400_000_000)
    later = replace(rear, campaign=replace(rear.campaign, runs=(late, *rear.campaign.runs[1:])))
    drives = list(front.samples.run_names)
    (before, _), (plain, _) = _on_one_clock([front, rear], drives), _on_one_clock([front, later], drives)
    own = rear.samples.run == 0
    for wheels, blocks in ((before, 0), (plain, 2)):
        present = np.flatnonzero(wheels[1].columns.present.any(axis=0) & (wheels[1].samples.run == 0))
        expected = rear.samples.time_s[own & rear.columns.present.any(axis=0)] + blocks * rear.samples.block_s
        np.testing.assert_allclose(wheels[1].samples.time_s[present], expected, atol=0.51 * rear.samples.block_s)


def test_a_held_out_drive_is_predicted_at_every_wheel(linearised: LinearisedCampaign) -> None:
    fit = fit_set(linearised, linearised.best.keys, starts="one")
    found = predict_held_out(linearised, fit, 2)
    runs = [data.samples[data.samples.run == 2] for data in linearised.campaigns]
    assert len(found.slip) == sum(map(len, runs)) == len(found.measured["dp"]) == len(found.variance["t"])
    np.testing.assert_array_equal(found.measured["t"], np.concatenate([run.measured["t"] for run in runs]))
    assert np.isfinite(found.predicted["dp"]).mean() > 0.95
    [soil] = soils_with(fit, linearised, np.eye(len(fit.estimate)))
    assert soil.campaign == "campaign"
    rows = fit.problem.runs(fit.estimate)
    assert len(rows) == 4 and all(np.isfinite(run).all() for run in rows)


def test_the_fitted_problem_is_whitened_as_the_evidence_is(linearised: LinearisedCampaign) -> None:
    """At the point about which was linearised the set's Gram matrix is that of the whole, of both wheels."""
    keys = linearised.best.keys
    problem = set_problem(linearised.campaigns, linearised.grams, keys)
    found = problem.runs(np.zeros(problem.size))
    own = [position for key in keys for position in linearised.grams.columns_of(key)]
    at = np.r_[0, linearised.grams.soil_columns, own]
    expected = linearised.grams.matrices[:, at[:, None], at]
    point = np.r_[linearised.best.soil, linearised.best.coefficients[list(linearised.best.columns)]]
    rows = problem.runs(point)
    jacobian = sum(run[:, 1:].T @ run[:, 1:] for run in rows)
    net = expected.sum(axis=0)[1:, 1:]
    np.testing.assert_allclose(jacobian, net, atol=0.05 * float(np.abs(net).max()))
    assert len(found) == len(rows) == 4


def test_what_one_wheel_alone_shows_is_that_wheels(wheels: tuple[Campaign, ...]) -> None:
    """With no torque at the front wheel, a gain at the rear one and a gain at all wheels are the same columns."""
    front, rear = wheels
    mute = tuple(replace(run, driving_torque_nm=np.full(len(run.time_s), np.nan)) for run in front.runs)
    found = diagnose((replace(front, runs=mute), rear), DiagnosisOptions())
    assert [cause.name for cause in found.causes] == ["torque_gain@RL"] and found.verdict == "named"
    assert "torque_gain" not in {candidate.name for candidate in found.candidates}


def test_wheels_of_other_cutoffs_have_common_blocks(wheels: tuple[Campaign, ...]) -> None:
    front, rear = wheels
    slow = replace(rear, runs=tuple(replace(run, cutoff_hz=2.0) for run in rear.runs))
    blocks = {samples_of(campaign).block_s for campaign in on_common_blocks((front, slow))}
    assert blocks == {0.4}
    assert samples_of(front).block_s < 0.4


def test_a_wheel_may_have_nearly_the_whole_error_of_the_speed_for_itself(linearised: LinearisedCampaign) -> None:
    parts = [part_of(data) for data in linearised.campaigns]
    most = [replace(part, values={**part.values, OWN_SPEED: APART}) for part in parts]
    columns = [np.r_[1.0, np.zeros(part.columns.shared - 1)] for part in parts]
    for speed, slope, variance in smoothed_speeds(most, columns):
        assert np.isfinite(speed).all() and np.isfinite(slope).all() and (variance > 0).all()
    assert OWN_SHARES[-1] < APART < 1.0, "with all of it the common process would have no variance"
    assert most_probable_shares(parts, lambda _: float("nan")) == [OWN_SHARES[0]] * 2


def test_the_point_of_a_vehicle_has_one_ground_speed(linearised: LinearisedCampaign) -> None:
    """Blocks are on one clock, and what is added to the measured speed of a block is the same at both wheels."""
    front, rear = (data.samples for data in linearised.campaigns)
    added = [data.linear.point.speed_mps for data in linearised.campaigns]
    for run in range(front.runs):
        own = [np.flatnonzero(samples.run == run) for samples in (front, rear)]
        times = [samples.time_s[at] for samples, at in zip((front, rear), own, strict=True)]
        blocks = [(time - times[0][0]) / front.block_s for time in times]
        ticks = [np.rint(of_wheel).astype(int) for of_wheel in blocks]
        np.testing.assert_allclose(blocks[1], ticks[1], atol=0.02)
        _, here, there = np.intersect1d(*ticks, return_indices=True)
        np.testing.assert_allclose(added[0][own[0][here]], added[1][own[1][there]], atol=1e-9)
    assert {data.noise.values[OWN_SPEED] for data in linearised.campaigns} == {OWN_SHARES[0]}


def test_readings_of_the_lifted_wheel_count_in_the_fit_and_in_the_evidence(wheels: tuple[Campaign, ...]) -> None:
    """One reading under a known torque pins the gain; the last rows of the problem are those of the lifted wheels."""
    reading = {"driving_torque_nm": 500.0 * (1.0 + GAIN), "driving_torque_sigma_nm": 0.2}
    test = StaticTest(test="known_torque", applied_nm=500.0, applied_share=0.0, **reading)
    read = linearise_campaigns((wheels[0], replace(wheels[1], static=(test,))))
    problem = set_problem(read.campaigns, read.grams, ("torque_gain@RL",))
    rows = problem.runs(np.zeros(problem.size))
    assert len(rows) == len(read.grams.run_names) + 1
    own = read.grams.columns_of("torque_gain@RL")[0]
    assert float(np.sum(rows[-1][:, -1] ** 2)) == pytest.approx(
        float(np.asarray(read.grams.static)[own, own]), rel=0.01
    )
    assert float(np.asarray(read.grams.static)[own, own]) > 30.0


def test_a_misfit_of_one_run_is_measured_at_its_own_wheel(linearised: LinearisedCampaign) -> None:
    columns = [data.columns for data in linearised.campaigns]
    of_run = [of.catch_all.of_run[2].shapes for of in columns]
    sizes = [np.zeros(len(shapes)) for shapes in of_run]
    sizes[1][0] = 1.0
    count = sum(map(len, of_run))
    found = Unlisted(1.0, np.arange(count), 2, 1.0)
    rms = _rms(linearised.campaigns, found, np.concatenate(sizes))
    rear = linearised.campaigns[1]
    curve = rear.columns.rows[:, rear.samples.run == 2, rear.columns.shared]
    assert max(rms.values()) == pytest.approx(float(np.sqrt(np.mean(curve**2, axis=1)).max()))


def test_every_wheel_may_show_what_it_shows_in_one_of_several_folders(wheels: tuple[Campaign, ...]) -> None:
    """Of two vehicles, what the rear wheel identifies in one is identified; passes of two vehicles are not several."""

    def start(campaign: Campaign, name: str) -> Start:
        of = replace(campaign, of_vehicle=OfVehicle(name, campaign.of_vehicle.wheel if campaign.of_vehicle else ""))
        return begin(of, samples_of(of), tuple(EFFECTS), "balanced", None)

    first, last = wheels[1].runs[0], wheels[1].runs[3]
    again = [replace(run, run=run.run.model_copy(update={"id": f"{run.run.id} again"})) for run in (first, last)]
    one_load = replace(wheels[1], runs=(first, last, *again))
    alone = not_identifiable_in_any([start(one_load, "a")])
    both = not_identifiable_in_any([start(one_load, "a"), start(wheels[1], "b")])
    lost = {name for name in alone if name.endswith("@RL")} - set(both)
    assert lost, "runs of one load show less than those of three"
    first, second = (replace(wheels[0], runs=tuple(_of_pass(run, n) for run in wheels[0].runs)) for n in (1, 2))
    assert "multi_pass" in not_identifiable_in_any([start(first, "a"), start(second, "b")])
    assert "multi_pass" not in not_identifiable_in_any([start(first, "a"), start(second, "a")])


def _of_pass(run: ProcessedRun, number: int) -> ProcessedRun:
    return replace(run, run=run.run.model_copy(update={"pass_number": number}))
