"""A look settles at what was hidden, leaves white noise, and takes what campaigns happen to hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign, with_sinkage
from short_campaign import driven, looked, noise_of

from model.diagnosis import Campaign, DiagnosisOptions, samples_of
from model.diagnosis.findings.wheel_orders import wheel_orders_of
from model.diagnosis.time_series import linearise_campaigns
from model.diagnosis.time_series.linearise import SENSORS
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, _same, with_likely_load
from model.diagnosis.time_series.noise import hyper_priors
from model.diagnosis.time_series.samples import places_of
from model.diagnosis.time_series.whitening import whitened_rows
from model.wheel_soil import conditions_of
from processing import ProcessedRun
from wheelsoil.wording.notes import texts_of

RUNS = 3
FEW = ("vasilev", "crosstalk", "drawbar_pull_zero", "speed_latency", "wheel_radius")


@pytest.fixture(scope="module")
def null() -> LinearisedCampaign:
    return linearise_campaigns([simulated_campaign(runs=RUNS)])


def found(seen: LinearisedCampaign) -> dict[str, tuple[float, float]]:
    """Return value and one-sigma of every parameter of the best set."""
    causes = [seen.grams.causes[i] for i in seen.best.columns]
    values = [seen.best.coefficients[i] * c.scale + c.neutral for i, c in zip(seen.best.columns, causes, strict=True)]
    sigmas = [sigma * abs(c.scale) for sigma, c in zip(seen.best.sigmas, causes, strict=True)]
    return {f"{c.key}.{c.parameter}": pair for c, *pair in zip(causes, values, sigmas, strict=True)}


def innovations(seen: LinearisedCampaign) -> tuple[np.ndarray, np.ndarray]:
    """Return whitened residuals of the best set, shape (runs, samples, channels), and where there are any."""
    view = seen.campaigns[0]
    ((rows, _),) = whitened_rows(view.samples, view.linear, view.columns, view.noise.values, view.speed_variance)
    shared = np.concatenate(
        [
            [1.0],
            -seen.best.soil,
            -seen.best.coefficients,
            np.zeros(view.columns.varying - 1 - len(seen.best.soil) - len(seen.best.coefficients)),
        ]
    )
    by_run = view.grams.constants @ shared
    each = np.concatenate([np.tile(shared, (len(by_run), 1)), -by_run], axis=1)
    at = places_of(view.samples.run, view.samples.runs)
    left = np.einsum("rkm,rm->rk", rows, each)[:, : at.longest * len(view.linear.channels)]
    present = at.padded(view.columns.present.astype(float)) > 0
    return left.reshape(present.shape), present


def test_a_campaign_without_a_cause_leaves_white_noise(null: LinearisedCampaign) -> None:
    assert null.best.keys == ()
    assert null.converged
    left, present = innovations(null)
    for c in range(2):
        own = left[..., c]
        assert np.sum(own**2) / present[..., c].sum() == pytest.approx(1.0, abs=0.2)
        assert abs(np.sum(own[:, 1:] * own[:, :-1]) / np.sum(own**2)) < 0.15
    values = null.campaigns[0].noise.values
    assert 0.018 < values["speed_noise_mps"] < 0.045  # 0.03 were put in
    assert 20.0 < values["drawbar_pull_noise_n"] < 50.0  # 46, of which 35 are left of means over a fifth of a second
    assert any("once a turn of the wheel" in note for note in texts_of(null.notes))
    assert {"samples", "linearise", "noise", "whitening", "evidence", "smoothing"} <= set(null.stages_s)


def test_an_explanation_that_moves_by_a_quarter_of_its_uncertainty_has_not_converged(null: LinearisedCampaign) -> None:
    moved = [replace(null.best, soil=null.best.soil + step) for step in (0.24, 0.26)]
    assert [_same(null.best, other) for other in moved] == [True, False]


def test_a_run_without_an_outboard_mass_has_the_usual_one() -> None:
    run = simulated_campaign(runs=1).runs[0]
    found = conditions_of([replace(run, outboard_mass_kg=mass) for mass in (0.0, 60.0)], 15e3)
    assert [set(np.asarray(one.outboard_mass_kg).tolist()) for one in found] == [{75.0}, {60.0}]


def test_a_run_of_one_sample_does_not_swing() -> None:
    """Nor is the end of a run beside the begin of the next: the other way up a run says the same of the load."""
    samples = samples_of(simulated_campaign(runs=2))
    second = samples.run == 1
    load = np.asarray(samples.conditions.vertical_load_n)
    turned = np.where(second, 2.0 * load[second].mean() - load, load)
    both = [replace(samples, conditions=replace(samples.conditions, vertical_load_n=x)) for x in (load, turned)]
    values = {name: prior.centre for name, prior in hyper_priors(samples).items()}
    likely = [np.asarray(with_likely_load(one, values).conditions.vertical_load_n)[~second] for one in both]
    np.testing.assert_allclose(likely[1], likely[0], rtol=1e-9)

    samples = samples[np.flatnonzero((samples.run == 0) | (np.diff(samples.run, prepend=0) > 0))]
    load = np.asarray(samples.conditions.vertical_load_n)
    heavier = replace(samples.conditions, vertical_load_n=load + 1e5 * (samples.run == 1))
    found = [with_likely_load(one, values) for one in (samples, replace(samples, conditions=heavier))]
    first, second = (np.asarray(one.conditions.vertical_load_n)[:-1] for one in found)
    assert (samples.run == 1).sum() == 1 and not np.array_equal(first, load[:-1])
    np.testing.assert_allclose(second, first)


@pytest.mark.parametrize(("swing_n", "moves"), [(0.09, False), (0.11, True)])
def test_a_load_that_swings_by_less_than_a_tenth_of_a_newton_is_steady(swing_n: float, moves: bool) -> None:
    samples = samples_of(simulated_campaign(runs=1))
    values = {name: prior.centre for name, prior in hyper_priors(samples).items()}
    swing = np.random.default_rng(0).normal(size=len(samples))
    swing = (swing - swing.mean()) / swing.std()
    steady = replace(samples, conditions=replace(samples.conditions, vertical_load_n=5000.0 + swing_n * swing))
    assert (with_likely_load(steady, values) is not steady) == moves


def test_a_given_noise_model_is_taken_at_its_word(null: LinearisedCampaign) -> None:
    again = linearise_campaigns([null.campaigns[0].campaign], noises=null.noises)
    assert "noise" not in again.stages_s
    assert again.noises == null.noises
    assert again.best.keys == null.best.keys
    assert again.grams.matrices.shape == null.grams.matrices.shape


def test_what_turns_with_the_wheel_is_a_needle_at_its_order(null: LinearisedCampaign) -> None:
    once = wheel_orders_of(null, 0)["dp"]
    at_one, beside = np.isclose(once.order, 1.0), np.abs(once.order - 1.0) > 0.12
    stated = np.sqrt(2.0) * null.noises[0].values["drawbar_pull_wheel_order_n"]
    assert once.swing[at_one] == pytest.approx(stated, rel=0.15) and once.swing[at_one] > 2.0 * once.by_chance[at_one]
    assert np.mean(once.swing[beside] > once.by_chance[beside]) < 0.15

    def oval(run: ProcessedRun, phase: float) -> ProcessedRun:
        angle = np.cumsum(np.nan_to_num(run.wheel_speed_radps)) / run.rate_hz
        return replace(run, drawbar_pull_n=run.drawbar_pull_n + 50.0 * np.cos(2.0 * angle + phase))

    sound = null.campaigns[0].campaign
    runs = tuple(oval(run, 2.0 * i) for i, run in enumerate(sound.runs))
    seen = linearise_campaigns([replace(sound, runs=runs)], DiagnosisOptions(effects=FEW), noises=null.noises)
    twice = wheel_orders_of(seen, 0)["dp"]
    assert twice.order[np.argmax(twice.swing)] == pytest.approx(2.0)
    assert twice.swing.max() == pytest.approx(50.0, rel=0.15)


def test_effects_without_a_trace_are_left_out(null: LinearisedCampaign) -> None:
    assert "multi_pass" in null.excluded
    assert "multi_pass" in null.not_identifiable


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "parameter", "truth"),
    [
        ("vasilev:H_m=0.03", "vasilev.H_m", 0.03),
        ("crosstalk:coefficient=-0.01", "crosstalk.coefficient", -0.01),
        ("speed_latency:extra_delay_s=0.2", "speed_latency.extra_delay_s", 0.2),
    ],
)
def test_it_settles_at_a_hidden_cause(effect: str, parameter: str, truth: float) -> None:
    seen = linearise_campaigns([simulated_campaign(runs=RUNS, effect=effect)], DiagnosisOptions(effects=FEW))
    assert seen.converged
    value, sigma = found(seen)[parameter]
    assert abs(value - truth) < 5.0 * sigma + 0.1 * abs(truth)
    assert value == pytest.approx(truth, rel=0.25)


@pytest.mark.parametrize(("soil", "delay_s"), [("clay", 0.45), ("sandy", -0.3)])
def test_a_large_delay_converges_at_its_size(soil: str, delay_s: float) -> None:
    """The speed's error is kept at its moment: else linearisations about one delay and another take turns."""
    seen = looked(driven(f"speed_latency:extra_delay_s={delay_s}", soil), "speed_latency", "torque_zero")
    assert seen.converged
    [(value, sigma)] = found(seen).values()
    assert abs(value - delay_s) < 3.0 * sigma


def test_measured_sinkage_is_a_channel_like_the_others() -> None:
    campaign = with_sinkage(simulated_campaign(runs=RUNS, effect="vasilev:H_m=0.03"), "vasilev:H_m=0.03")
    seen = linearise_campaigns([campaign], DiagnosisOptions(effects=FEW))
    assert seen.campaigns[0].linear.channels == ("dp", "t", "z")
    assert any(shape.channel == "z" for shape in seen.grams.basis)
    assert found(seen)["vasilev.H_m"][0] == pytest.approx(0.03, rel=0.1)
    assert 0.001 < seen.campaigns[0].noise.values["sinkage_noise_m"] < 0.006


def test_campaigns_share_their_causes_and_not_their_soils() -> None:
    both = [driven("crosstalk:coefficient=0.03", soil, RUNS) for soil in ("clay", "sandy")]
    options = DiagnosisOptions(effects=("crosstalk", "drawbar_pull_zero", "torque_gain"))
    seen = linearise_campaigns(both, options, [noise_of(one) for one in both])
    assert seen.grams.matrices.shape[0] == 2 * RUNS
    own = 6 + len(SENSORS)
    assert len(seen.grams.soil) == 2 * own
    assert seen.grams.soil[0] == "clay: cohesion_pa"
    assert seen.grams.run_names[-1] == f"sandy: run-{RUNS}"
    soils = seen.grams.soil_columns
    assert not seen.grams.matrices[0][soils, soils][own:, own:].any()
    assert found(seen)["crosstalk.coefficient"][0] == pytest.approx(0.03, abs=0.004)
    assert len(seen.noises) == 2


def silenced(campaign: Campaign, field: str) -> Campaign:
    return replace(campaign, runs=tuple(replace(r, **{field: np.full(len(r), np.nan)}) for r in campaign.runs))


@pytest.mark.parametrize("field", ["driving_torque_nm", "drawbar_pull_n"])
def test_one_channel_is_enough_for_an_answer(field: str) -> None:
    effects = ("torque_zero", "drawbar_pull_zero", "wheel_radius")
    seen = linearise_campaigns([silenced(simulated_campaign(runs=RUNS), field)], DiagnosisOptions(effects=effects))
    assert len(seen.campaigns[0].linear.channels) == 1
    assert np.isfinite(seen.grams.matrices).all()
    family = "torque_zero" if field == "driving_torque_nm" else "drawbar_pull_zero"
    assert family in seen.not_identifiable
    assert family in seen.excluded


def test_one_run_and_pieces_of_it_are_enough_for_an_answer() -> None:
    campaign = simulated_campaign(runs=RUNS)
    run = campaign.runs[0]
    hole = (run.time_s % 7.0) > 6.0
    torn = replace(
        run,
        reason=np.where(hole, 1, run.reason).astype(np.uint8),
        driving_torque_nm=np.where(run.time_s > 20.0, np.nan, run.driving_torque_nm),
    )
    seen = linearise_campaigns([replace(campaign, runs=(torn,))], DiagnosisOptions(effects=FEW))
    assert np.isfinite(seen.grams.matrices).all()
    assert seen.grams.samples[0] < 1.6 * len(seen.campaigns[0].samples)
