"""Parts of the diagnosis of benches against what can be computed otherwise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from bench_samples import REPEATS, SAND, WHEEL, bench, prior
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr
from scipy.stats import multivariate_normal

from daq import Note
from model import LackCode
from model.diagnosis.core.naming import Judgement
from model.diagnosis.single_wheel import (
    BenchProblem,
    CauseUse,
    Hypothesis,
    SoilCoordinates,
    Weighed,
    Weighing,
    driven_rows,
    family_of,
    library,
    listed_uses,
    scatter_of_repeats,
    sets_of,
    skid_law,
)
from model.diagnosis.single_wheel.coordinates import CauseCoordinate, cut_off
from model.diagnosis.single_wheel.evidence import SetPosterior, posterior_of
from model.diagnosis.single_wheel.noise import ChannelNoise, groups_of_rows
from model.diagnosis.single_wheel.predictions import _across_the_peak, _left_open, _parted, _rivals
from model.diagnosis.single_wheel.search import answered, log_likelihood, search
from model.diagnosis.single_wheel.weighing import misfits, threshold
from model.effects import EFFECTS

BOTH = ("dp", "z")


# --- coordinates -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lower", "upper"), [(0.0, np.inf), (-np.inf, 0.0), (-7.5, 0.0), (-1.0, 2.0), (-2.0, np.inf)])
def test_cut_off_keeps_probabilities(lower: float, upper: float) -> None:
    standard = np.linspace(-5, 5, 101)
    x, slope = cut_off(standard, lower, upper)
    assert np.all((x >= lower) & (x <= upper))
    share = (ndtr(x) - ndtr(lower)) / (ndtr(upper) - ndtr(lower))
    assert share == pytest.approx(ndtr(standard), abs=1e-9)
    ahead, _ = cut_off(standard + 1e-6, lower, upper)
    behind, _ = cut_off(standard - 1e-6, lower, upper)
    assert slope == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-6)


@given(st.floats(-200, 200), st.sampled_from([(0.0, np.inf), (-np.inf, 0.0), (-1.0, 2.0), (-1e4, 1e4), (0.0, 50.0)]))
def test_cut_off_is_finite_far_out(standard: float, bounds: tuple[float, float]) -> None:
    x, slope = cut_off(np.array([standard]), *bounds)
    assert np.isfinite(x).all()
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("key", sorted(EFFECTS))
def test_a_cause_finds_its_value_again(key: str) -> None:
    for parameter in EFFECTS[key].parameters:
        coordinate = CauseCoordinate.of(parameter, WHEEL, 25.0)
        value = coordinate.neutral + 0.4 * coordinate.side * coordinate.scale
        assert coordinate.values(np.array([coordinate.standard(value)]))[0] == pytest.approx(value, rel=1e-9)


def test_scales_in_newtons_shrink_with_the_load() -> None:
    (zero,) = (CauseCoordinate.of(p, WHEEL, 25.0) for p in EFFECTS["drawbar_pull_zero"].parameters)
    (gain,) = (CauseCoordinate.of(p, WHEEL, 25.0) for p in EFFECTS["drawbar_pull_gain"].parameters)
    assert zero.scale == pytest.approx(150.0 * 25.0 / 10_000.0)
    assert gain.scale == pytest.approx(0.08)


def test_a_barely_known_soil_stays_a_soil() -> None:
    wide = {"cohesion_pa": 900.0, "shear_modulus_m": 0.02, "frictional_modulus": 3 * SAND.frictional_modulus}
    given_bench = replace(bench(np.random.default_rng(0)), soil_prior=prior(wide))
    soil = SoilCoordinates.of(given_bench)
    assert soil.names == ("cohesion_pa", "ln_shear_modulus", "ln_stiffness")
    standard = np.random.default_rng(1).standard_normal((4000, 3))
    values = soil.soil_parameters(soil.values(standard)[0], WHEEL.width_m)
    assert all((values[name] >= 0).all() for name in values)
    assert np.median(values["frictional_modulus"]) == pytest.approx(SAND.frictional_modulus, rel=0.15)
    assert np.log(values["shear_modulus_m"]).std() == pytest.approx(0.02 / SAND.shear_modulus_m, rel=0.05)


# --- rows of many hypotheses at once ---------------------------------------------------------------------------------


def test_slopes_are_those_of_the_model() -> None:
    problem = BenchProblem.of([bench(np.random.default_rng(0))], BOTH)
    known = library(problem)
    hypotheses: list[Hypothesis] = [(), *((use,) for use in known.uses), known.uses[:1] + known.uses[4:5]]
    widest = max(problem.size(h) for h in hypotheses)
    standard = -0.6 + 0.1 * np.random.default_rng(2).standard_normal((len(hypotheses), widest))
    _, slopes = problem.evaluate(hypotheses, standard, slopes=True)
    for column in range(widest):
        step = np.zeros(widest)
        step[column] = 1e-5
        ahead, _ = problem.evaluate(hypotheses, standard + step)
        behind, _ = problem.evaluate(hypotheses, standard - step)
        for channel, slope in slopes.items():
            numeric = (ahead[channel] - behind[channel]) / 2e-5
            scale = np.abs(ahead[channel]).max()
            np.testing.assert_allclose(slope[:, :, column], numeric, rtol=1e-4, atol=1e-6 * scale)


def test_a_cause_of_one_bench_leaves_the_other_alone() -> None:
    rng = np.random.default_rng(0)
    problem = BenchProblem.of([bench(rng), bench(rng)], BOTH)
    assert problem.soil_of == (0, 0)
    own: Hypothesis = (CauseUse("vasilev", 1),)
    shared: Hypothesis = (CauseUse("vasilev"),)
    standard = np.zeros((3, problem.size(own)))
    said, _ = problem.evaluate([(), own, shared], standard)
    first, second = problem.table == 0, problem.table == 1
    assert said["z"][1, first] == pytest.approx(said["z"][0, first])
    assert said["z"][1, second] == pytest.approx(said["z"][2, second])
    assert (said["z"][1, second] > said["z"][0, second]).any()


def test_benches_on_other_soils_have_soils_of_their_own() -> None:
    rng = np.random.default_rng(0)
    other = replace(bench(rng), soil=replace(SAND, name="another"))
    problem = BenchProblem.of([bench(rng), other], BOTH)
    assert problem.soil_of == (0, 1)
    assert problem.soil_offsets == (0, 5, 10)
    standard = np.zeros((1, 10))
    moved = standard.copy()
    moved[0, 9] = 1.0
    before, after = problem.evaluate([()], standard)[0]["z"], problem.evaluate([()], moved)[0]["z"]
    assert before[0, problem.table == 0] == pytest.approx(after[0, problem.table == 0])
    assert (after[0, problem.table == 1] < before[0, problem.table == 1]).all()


# --- noise -----------------------------------------------------------------------------------------------------------


def _noise(rng: np.random.Generator, sigma: float | None = None) -> ChannelNoise:
    groups = np.repeat(np.arange(4), [3, 3, 1, 2])
    return ChannelNoise.of("dp", rng.standard_normal(9), groups, 0.1 * rng.random(9), 0.7, sigma)


def test_likelihood_is_the_mixture_of_normals() -> None:
    rng = np.random.default_rng(3)
    noise = _noise(rng)
    error = rng.standard_normal(9)
    together = noise.members @ noise.members.T
    total = 0.0
    for scatter, form, weight in zip(noise.scatter, noise.form, noise.log_weight, strict=True):
        covariance = np.diag(scatter**2 + noise.carried) + form**2 * together
        total += np.exp(weight) * multivariate_normal(cov=covariance).pdf(error)
    assert noise.log_likelihood(error) == pytest.approx(np.log(total), rel=1e-9)
    assert np.exp(noise.log_weight).sum() == pytest.approx(1.0)


def test_precision_is_the_gradient_of_the_likelihood() -> None:
    rng = np.random.default_rng(4)
    noise, error = _noise(rng), rng.standard_normal(9)
    precision = noise.precision(noise.node_shares(error[None]))[0]
    numeric = np.zeros(9)
    for i in range(9):
        step = np.zeros(9)
        step[i] = 1e-5
        numeric[i] = (noise.log_likelihood(error + step) - noise.log_likelihood(error - step)) / 2e-5
    assert -precision @ error == pytest.approx(numeric, rel=1e-5, abs=1e-7)


def test_rows_left_out_do_not_count() -> None:
    rng = np.random.default_rng(5)
    noise, error = _noise(rng), rng.standard_normal(9)
    kept = np.where(noise.groups == 1, 0.0, 1.0)
    part = ChannelNoise(
        "dp",
        noise.measured[kept > 0],
        np.unique(noise.groups[kept > 0], return_inverse=True)[1],
        noise.carried[kept > 0],
        noise.form_scale,
        noise.scatter,
        noise.form,
        noise.log_weight,
    )
    assert noise.log_likelihood(error, kept) == pytest.approx(part.log_likelihood(error[kept > 0]))
    other = np.where(kept > 0, error, 99.0)
    assert noise.log_likelihood(other, kept) == pytest.approx(noise.log_likelihood(error, kept))


def test_scatter_of_repeats_and_their_groups() -> None:
    rng = np.random.default_rng(6)
    groups = np.repeat(np.arange(400), 3)
    values = groups * 5.0 + 0.3 * rng.standard_normal(1200)
    assert scatter_of_repeats(values, groups) == pytest.approx(0.3, rel=0.06)
    assert scatter_of_repeats(values[:3], np.arange(3)) == 0.0
    slip, load = np.array([0.2, 0.21, 0.5, 0.2, 0.5]), np.array([25.0, 26.0, 24.0, 80.0, 25.0])
    found = groups_of_rows(np.zeros(5, np.intp), slip, load)
    assert found[0] == found[1] != found[3]
    assert found[2] == found[4]
    assert groups_of_rows(np.array([4, 4, 2, 2, 2]), slip, load).tolist() == [1, 1, 0, 0, 0]


# --- evidence --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value", "channels"),
    [
        pytest.param("interface_friction", {"ln_mu": -0.4}, ("dp",), marks=pytest.mark.slow),
        ("vasilev", {"H_m": 0.01}, ("dp", "z")),
        pytest.param("crosstalk", {}, ("dp",), marks=pytest.mark.slow),
    ],
)
def test_evidence_is_that_of_quadrature(key: str, value: dict[str, float], channels: tuple[str, ...]) -> None:
    """One soil parameter and one cause: the integral over both on a grid."""
    rng = np.random.default_rng(7)
    few = bench(rng, {key: value} if value else {}, spread={"frictional_modulus": 2e6})
    problem = BenchProblem.of([few], channels)
    hypothesis: Hypothesis = (CauseUse(key),)
    assert problem.size(hypothesis) == 2
    optima = search(problem, [hypothesis] * 2, [np.zeros(2), np.ones(2)])
    found = posterior_of(problem, optima, rng)
    mean = found.weights @ found.standard
    spread = np.sqrt(found.weights @ (found.standard - mean) ** 2)
    axes = [np.linspace(m - 10 * s, m + 10 * s, 121) for m, s in zip(mean, spread, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    said, _ = problem.evaluate([hypothesis] * len(grid), grid)
    each = log_likelihood(problem, said) - 0.5 * (grid**2).sum(axis=1) - np.log(2 * np.pi)
    top = each.max()
    exact = top + np.log(np.exp(each - top).sum() * np.prod([axis[1] - axis[0] for axis in axes]))
    assert found.log_evidence == pytest.approx(exact, abs=4 * found.log_evidence_sigma + 0.02)
    assert found.log_evidence_sigma < 0.15
    share = np.exp(each - top) / np.exp(each - top).sum()
    assert np.abs(share @ grid - mean) / spread == pytest.approx(0.0, abs=0.35)
    assert np.sqrt(share @ grid**2 - (share @ grid) ** 2) / spread == pytest.approx(1.0, abs=0.3)


def test_search_finds_the_best_values() -> None:
    rng = np.random.default_rng(8)
    truth = {"vasilev": {"H_m": 0.012}, "interface_friction": {"ln_mu": -0.3}}
    problem = BenchProblem.of([bench(rng, truth, noise=0.05)], BOTH)
    hypothesis: Hypothesis = (CauseUse("vasilev"), CauseUse("interface_friction"))
    (found,) = search(problem, [hypothesis], [np.zeros(problem.size(hypothesis))])
    positions = problem.positions(hypothesis)
    values = {use.key: problem.coordinates(use)[0].values(found.standard[positions[use]])[0][0] for use in hypothesis}
    assert values["vasilev"] == pytest.approx(0.012, rel=0.1)
    assert values["interface_friction"] == pytest.approx(-0.3, abs=0.1)
    nudged = [found.standard + 0.02 * rng.standard_normal(found.standard.size) for _ in range(20)]
    said, _ = problem.evaluate([hypothesis] * 20, np.array(nudged))
    objective = log_likelihood(problem, said) - 0.5 * (np.array(nudged) ** 2).sum(axis=1)
    assert (objective <= found.log_posterior + 0.02).all()


def test_a_cause_that_would_bury_the_axle_starts_small() -> None:
    small = replace(bench(np.random.default_rng(0)), wheel=replace(WHEEL, radius_m=0.03))
    rows = replace(small.rows, vertical_load_n=small.rows.vertical_load_n / 6.0)
    problem = BenchProblem.of([replace(small, rows=rows)], BOTH)
    hypothesis: Hypothesis = (CauseUse("vasilev"),)
    start = np.zeros(problem.size(hypothesis))
    assert not np.isfinite(problem.evaluate([hypothesis], start[None])[0]["dp"]).all()
    (found,) = answered(problem, [(hypothesis, start)])
    assert np.isfinite(problem.evaluate([hypothesis], found[None])[0]["dp"]).all()


def test_the_gate_lets_the_truth_pass_and_stops_what_is_wrong() -> None:
    rng = np.random.default_rng(9)
    null: Hypothesis = ()
    passed = []
    for _ in range(20):
        problem = BenchProblem.of([bench(rng)], BOTH)
        (best,) = search(problem, [null], [np.zeros(5)])
        passed.append(misfits(problem, [best])[0] <= threshold(problem, rng))
    assert all(passed)
    problem = BenchProblem.of([bench(rng, {"vasilev": {"H_m": 0.02}})], BOTH)
    (best,) = search(problem, [null], [np.zeros(5)])
    assert misfits(problem, [best])[0] > threshold(problem, rng)


# --- sets ------------------------------------------------------------------------------------------------------------


def test_the_published_prior() -> None:
    problem = BenchProblem.of([bench(np.random.default_rng(0))], BOTH)
    known = library(problem)
    p = {h: np.exp(x) for h, x in sets_of(known.uses, listed_uses(known.uses, 2)).items()}
    total = [sum(x for h, x in p.items() if len(h) == size) for size in range(3)]
    assert total == pytest.approx([0.5 / 0.97, 0.35 / 0.97, 0.12 / 0.97])
    alone = {family_of(h[0]): 0.0 for h in p if len(h) == 1}
    for h, x in p.items():
        if len(h) == 1:
            alone[family_of(h[0])] += x
    assert list(alone.values()) == pytest.approx([0.35 / 0.97 / len(alone)] * len(alone))
    assert not any(len({family_of(use) for use in h}) < len(h) for h in p)


def test_what_a_table_cannot_tell_is_said() -> None:
    known = library(BenchProblem.of([bench(np.random.default_rng(0))], ("dp",)))
    assert {"speed_latency", "track_drift", "torque_zero", "skid_sinkage"} <= set(known.not_identifiable)
    assert known.not_identifiable["grouser"] == Note(LackCode.SMOOTH_TYRE)
    assert {"interface_friction", "wheel_radius", "drawbar_pull_gain", "crosstalk", "load_zero"} <= set(known.families)


# --- braked wheels ---------------------------------------------------------------------------------------------------


def test_laws_of_a_driven_wheel_do_not_act_on_a_braked_one() -> None:
    braked = bench(np.random.default_rng(0), slips=(-0.9, -0.6, -0.3))
    known = library(BenchProblem.of([braked], ("z",)))
    assert "slip_sinkage" in known.not_identifiable
    assert "skid_sinkage" in known.families


def test_skid_law() -> None:
    rng = np.random.default_rng(10)
    slips = (-0.9, -0.6, -0.3, 0.0, 0.4)
    given_bench = bench(rng, {"skid_sinkage": {"H2_m": 0.03}}, slips=slips)
    law = skid_law(given_bench)
    assert law is not None
    assert law.H2_m == pytest.approx(0.03, rel=0.15)
    assert law.left_out_rms_m < 4 * REPEATS["z"]
    assert law.rows == 12
    assert (driven_rows(given_bench).rows.slip >= 0).all()
    assert skid_law(driven_rows(given_bench)) is None


# --- further tests ---------------------------------------------------------------------------------------------------


def test_rivals_are_probable_sets_with_a_posterior() -> None:
    posterior = cast(SetPosterior, object())
    none, *causes = ((), *((use,) for use in library(BenchProblem.of([bench(np.random.default_rng(0))], BOTH)).uses))
    improbable, unknown, probable = (Weighed(none, 0.0, 0.0, (), 0.0, known) for known in (posterior, None, posterior))
    sets = (probable, replace(unknown, hypothesis=causes[0]), replace(improbable, hypothesis=causes[1]))
    weighing = cast(Weighing, SimpleNamespace(sets=sets, probabilities=np.array([0.6, 0.4, 0.0])))
    assert _rivals(weighing, ()) == [(0.6, probable)]


def _weighed(*sets: tuple[float, tuple[str, ...]]) -> Weighing:
    posterior = cast(SetPosterior, object())
    found = [Weighed(tuple(map(CauseUse, keys)), 0.0, float(np.log(p)), (), 0.0, posterior) for p, keys in sets]
    return cast(Weighing, SimpleNamespace(sets=tuple(found), probabilities=np.array([p for p, _ in sets])))


def test_sets_to_separate_differ_in_what_the_verdict_leaves_open() -> None:
    friction, peak = "interface_friction", "stress_peak_shift"
    weighing = _weighed(
        (0.4, ("vasilev", friction)), (0.3, ("vasilev", "grouser")), (0.2, (peak,)), (0.1, ("vasilev",))
    )
    first, _, third, last = weighing.sets
    assert _rivals(weighing, ("slip_sinkage", peak)) == [(0.4, first), (0.2, third)]
    assert _rivals(weighing, ("slip_sinkage", friction)) == [(0.4, first), (0.3, weighing.sets[1])]
    apart = np.array([[0.0, 5.0], [5.0, 0.0]])
    names = _parted([(0.4, first), (0.2, third)], apart, ("slip_sinkage", friction, peak))
    assert names == (f"slip_sinkage + {friction}", peak)
    assert _parted([(0.4, first), (0.1, last)], apart, ("slip_sinkage", friction)) == (friction,)


def test_where_a_usual_peak_bars_a_name_these_two_are_to_be_separated() -> None:
    """By the probability that the name has beside a usual peak; what acts beside both is none of it."""
    peak = "stress_peak_shift"
    weighing = _weighed((0.7, ("vasilev", "interface_friction")), (0.2, ("vasilev", peak)), (0.1, (peak, "exit_angle")))
    why = Note(LackCode.PEAK_MAY_SHIFT, values={"family": "slip_sinkage", "probability": 0.6})
    rivals = _across_the_peak(weighing, why, np.random.default_rng(0))
    assert rivals == [(0.6, weighing.sets[0]), (0.4, weighing.sets[2])]
    verdict = Judgement("one_of", ("slip_sinkage", "interface_friction", peak), barred=why)
    assert _left_open(verdict) == ("slip_sinkage", peak)
    assert _left_open(replace(verdict, barred=None)) == verdict.families and _left_open(Judgement("named")) == ()
