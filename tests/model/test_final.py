"""Final parameters: a consistent problem, recovered values, honest intervals."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from short_campaign import driven, looked, noise_of

from model.diagnosis import DiagnosisOptions
from model.diagnosis.core.naming import Judgement
from model.diagnosis.findings.explained import Fits, explain
from model.diagnosis.findings.set_fit import (
    TRUST,
    _others,
    fit_set,
    interval,
    parameters_of,
    shifted,
    soils_of,
    spread_of,
)
from model.diagnosis.findings.set_problem import set_problem
from model.diagnosis.time_series import linearise_campaigns
from model.diagnosis.time_series.evidence import estimate, posterior


@pytest.mark.parametrize("keys", [("lyasko", "torque_zero"), ("speed_latency",)])
def test_derivatives_belong_to_the_residual(keys: tuple[str, ...]) -> None:
    seen = looked(driven("vasilev:H_m=0.04"), "vasilev", "lyasko", "torque_zero", "speed_latency")
    problem = set_problem(seen.campaigns, seen.grams, keys)
    rng = np.random.default_rng(0)
    x = np.concatenate([0.3 * rng.normal(size=len(problem.soil)), np.full(len(problem.causes), 0.2)])
    _, jacobian = problem.residual_and_jacobian(x)
    for i in range(len(x)):
        step = np.zeros(len(x))
        step[i] = 1e-4
        change = problem.residual_and_jacobian(x + step)[0] - problem.residual_and_jacobian(x - step)[0]
        np.testing.assert_allclose(jacobian[:, i], change / 2e-4, atol=1e-4 * np.abs(jacobian[:, i]).max())


def test_about_its_own_point_the_problem_is_the_grams() -> None:
    """Its residual squared, without priors, is that of the Gram matrices with the same coefficients."""
    seen = looked(driven("vasilev:H_m=0.04"), "vasilev", "torque_zero")
    problem = set_problem(seen.campaigns, seen.grams, seen.best.keys)
    x = np.concatenate([seen.best.soil, seen.best.coefficients[list(seen.best.columns)]])
    problem = problem.refrozen(x)
    grams = problem.grams()
    by_run = [float(rows[:, 0] @ rows[:, 0]) for rows in problem.runs(x)]
    v = np.concatenate([[1.0], -x, np.zeros(len(grams.basis))])
    np.testing.assert_allclose(by_run, np.einsum("i,rij,j->r", v, grams.matrices, v), rtol=1e-6)


@pytest.mark.parametrize(
    "effect",
    ["vasilev:H_m=0.04", "torque_zero:offset_nm=-40", pytest.param("wheel_inertia:scale=0.8", marks=pytest.mark.slow)],
)
def test_what_was_hidden_is_found_within_its_interval(effect: str) -> None:
    key, _, given = effect.partition(":")
    name, _, value = given.partition("=")
    seen = looked(driven(effect), key, "crosstalk")
    found = {p.name: p for p in parameters_of(fit_set(seen, (key,)), seen)[key]}[name]
    low, high = found.interval95
    assert low < float(value) < high
    assert found.sigma < 0.15 * abs(float(value))


def test_a_member_of_a_set_has_its_size_beside_those_that_act_for_sure() -> None:
    """Alone, each of two causes would have to explain what the other one does."""
    keys = ("vasilev", "torque_zero")
    fits = Fits(looked(driven("vasilev:H_m=0.04"), *keys, "crosstalk"))
    found = posterior(fits.linearised.grams)
    sure = replace(found, probability=np.eye(len(found.hypotheses))[found.hypotheses.index_of(keys)])
    verdict = Judgement("one_of", ("slip_sinkage", "torque_zero", "crosstalk"))
    sizes = {cause.key: cause for cause in explain(fits, verdict, sure).causes}
    [own] = sizes["vasilev"].parameters
    together, alone = (parameters_of(fits[some], fits.linearised)["vasilev"][0] for some in (keys, keys[:1]))
    assert own.value == together.value != alone.value
    assert ("crosstalk",) not in fits.known and sizes["crosstalk"].parameters
    [named] = explain(fits, Judgement("named", ("slip_sinkage",), ("torque_zero",)), sure).causes
    assert named.parameters[0].value == together.value


def test_lyaskos_sum_comes_first_and_its_parts_only_where_they_can_be_parted() -> None:
    seen = looked(driven("lyasko:m1=0.1,m2=0.05"), "lyasko")
    total, m1, m2 = parameters_of(fit_set(seen, ("lyasko",)), seen)["lyasko"]
    assert (total.name, m1.name, m2.name) == ("p", "m1", "m2")
    assert total.interval95[0] < 0.15 < total.interval95[1]
    assert np.isnan([m1.sigma, *m1.interval95, *m2.interval95]).all()


def test_a_shift_goes_as_far_as_every_sample_has_an_answer() -> None:
    """A ground that carries no wheel has none."""
    seen = looked(driven("vasilev:H_m=0.04"), "vasilev")
    fit = fit_set(seen, ("vasilev",))
    softer = np.zeros_like(fit.estimate)
    softer[:6] = -60.0
    assert not np.isfinite(np.concatenate(fit.problem.runs(fit.estimate + softer))).all()
    moved = shifted(fit.problem, fit.estimate, softer)
    assert np.isfinite(np.concatenate(fit.problem.runs(moved))).all()
    np.testing.assert_array_equal(shifted(fit.problem, fit.estimate, 1e-3 * softer), fit.estimate + 1e-3 * softer)


def test_the_soil_alone_is_a_set_too() -> None:
    seen = looked(driven(), "vasilev")
    fit = fit_set(seen, ())
    assert parameters_of(fit, seen) == {} and fit.sizes == {}
    (soil,) = soils_of(fit, seen)
    laboratory = driven().soil
    assert abs(soil.values["tan_phi"] - laboratory.tan_phi) < 3 * soil.sigmas["tan_phi"] + 0.03 * laboratory.tan_phi
    assert soil.sigmas["tan_phi"] < 0.06 * laboratory.tan_phi


def test_a_one_sided_cause_that_is_not_there_stays_at_its_bound_with_an_interval() -> None:
    seen = looked(driven(), "bulldozing", "vasilev")
    (found,) = parameters_of(fit_set(seen, ("bulldozing",)), seen)["bulldozing"]
    assert found.value >= 0 and found.interval95[0] >= 0
    assert found.interval95[0] < 0.02 and found.interval95[1] < 0.5


def test_a_spread_weighs_the_noise_models_and_the_runs_and_adds_what_is_not_known() -> None:
    seen = looked(driven("vasilev:H_m=0.04"), "vasilev", "crosstalk")
    fit = fit_set(seen, ("vasilev",))
    spread = spread_of(fit.problem, fit.estimate, seen, fit.keys)
    share = (spread.degrees - TRUST) / spread.degrees
    both = np.diag(spread.naive) + share * np.maximum(np.diag(spread.robust - spread.naive), 0.0)
    np.testing.assert_allclose(np.diag(spread.covariance), both + spread.by_noise + spread.by_choice + spread.by_form)
    assert (spread.by_noise > 0).any() and (spread.by_choice >= 0).all() and (spread.by_form > 0).any()
    assert interval(0.0, 1.0, float(spread.degrees[0]))[1] > 1.96


def test_a_large_effect_is_not_what_the_linearisation_at_neutral_says() -> None:
    """The engine's own linear answer about neutral misses; the whole model does not."""
    campaign = driven("vasilev:H_m=0.08")
    seen = looked(campaign, "vasilev")
    first = replace(seen, best=estimate(seen.grams, ()))
    fit = fit_set(first, ("vasilev",))
    assert fit.sizes["vasilev"][0] * 0.05 == pytest.approx(0.08, rel=0.05)


@pytest.mark.slow
def test_two_campaigns_share_causes_and_not_soils() -> None:
    campaigns = [driven("torque_zero:offset_nm=-40", soil, runs=2) for soil in ("clay", "sandy")]
    seen = linearise_campaigns(
        campaigns, DiagnosisOptions(effects=("torque_zero", "vasilev")), [noise_of(c) for c in campaigns]
    )
    fit = fit_set(seen, ("torque_zero",))
    (found,) = parameters_of(fit, seen)["torque_zero"]
    assert found.interval95[0] < -40 < found.interval95[1]
    soils = soils_of(fit, seen)
    assert [soil.campaign for soil in soils] == ["clay", "sandy"]
    assert soils[0].values["tan_phi"] < 0.3 < 0.4 < soils[1].values["tan_phi"]


def test_a_fit_also_starts_from_one_sigma_of_a_cause_within_its_bounds() -> None:
    cause = SimpleNamespace(key="vasilev", one_sided=True)
    problem = SimpleNamespace(soil=("a",), causes=(cause,), bounds=(np.array([-np.inf, 0.0]), np.array([np.inf, 0.8])))
    assert [start.tolist() for start in _others(problem, np.zeros(2))] == [[0.0, 0.8]]  # type: ignore[arg-type]
    assert not list(_others(problem, np.array([0.0, 1.0])))  # type: ignore[arg-type]
