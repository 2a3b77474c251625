"""With what probability a step ends in the right name, against made-up campaigns that are really driven on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_grams import columns_of_runs, grams_of
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import FloatArray, Note
from model import LackCode, StepCode
from model.diagnosis.core.naming import AVERAGED_AT, NOTHING_AT, SURE_AT, beside_formed
from model.diagnosis.findings.held_out import bagged, drawn_anew
from model.diagnosis.planning.naming_chance import outlook

RUNS = 5


def look_alikes(seed: int, apart: float = 0.05):
    """Return columns of runs in which slope and torque_zero look almost the same, their residual, and a better run."""
    rng = np.random.default_rng(seed)
    columns, more = columns_of_runs(rng, runs=RUNS), columns_of_runs(rng, runs=1)
    columns[:, :, 6] = columns[:, :, 5] + apart * columns[:, :, 6]
    residual = rng.normal(size=columns.shape[:2]) + columns[:, :, 5]
    return rng, columns, residual, more


def chance_of(columns: FloatArray, residual: FloatArray, more: FloatArray, code: StepCode, **options):
    grams = grams_of(columns, residual)
    rng = np.random.default_rng(7)
    ahead = outlook(grams, bagged(grams, rng), rng, **options)
    return ahead.chance(code, grams_of(more, more[:, :, 0] * 0.0).matrices[0])


@pytest.mark.parametrize("share", [0.05, 0.15, 0.5])
def test_it_is_how_often_the_name_comes_when_truths_are_really_driven(share: float) -> None:
    rng, columns, residual, more = look_alikes(3)
    more = columns[:1] + share * (more - columns[:1])
    grams = grams_of(columns, residual)
    ahead = outlook(grams, bagged(grams, rng), rng)
    added = grams_of(more, more[:, :, 0] * 0.0).matrices[0]
    said = ahead.chance(StepCode.LIKE_OTHERS, added)
    named = []
    for truth, acts in zip(ahead.coefficients, ahead.acts, strict=True):
        answer = rng.normal(size=more.shape[:2]) + more[:, :, : truth.size] @ truth
        both = grams_of(np.concatenate([columns, more]), np.concatenate([residual, answer]))
        found = bagged(both, rng)
        alone = found.as_they_are().families()
        sure = {f for f, p in found.families().items() if p > AVERAGED_AT and alone[f] > SURE_AT}
        true = {family for family, act in zip(ahead.listed.families, acts, strict=True) if act}
        named.append(found.none < NOTHING_AT and bool(sure) and sure <= true)
    assert said == pytest.approx(np.mean(named), abs=0.15)


def test_a_run_that_parts_look_alikes_gives_the_name_and_one_like_the_others_does_not() -> None:
    _, columns, residual, more = look_alikes(0)
    assert chance_of(columns, residual, columns[:1], StepCode.LIKE_OTHERS) < 0.2
    assert chance_of(columns, residual, more, StepCode.SINKAGE) > 0.8
    assert chance_of(columns, residual, more, StepCode.SINKAGE, barred=Note(LackCode.NO_BETTER)) is None


@pytest.mark.parametrize(("apart", "enough"), [(0.0, True), (0.3, False)])
def test_a_run_is_left_out_of_a_third_of_the_campaigns_that_are_drawn_and_a_static_test_is_not(
    apart: float, enough: bool
) -> None:
    """A name asks for .8: .66 of certainty and .34 of even chances are enough; .34 of .1, a wrong rival, are not."""
    _, columns, residual, more = look_alikes(0, apart)
    told = [chance_of(columns, residual, 2.0 * more, code) for code in (StepCode.MORE_LOAD, StepCode.LIFTED_ZERO)]
    assert (told[0] > told[1] - 0.05) == enough
    assert told[1] > 0.9


def test_what_the_data_do_not_identify_is_not_named_until_a_step_shows_it() -> None:
    _, columns, residual, more = look_alikes(0, apart=0.2)
    one_way = dict.fromkeys(("slip_sinkage", "slope", "torque_zero"), Note(LackCode.ONE_DIRECTION))
    told = {
        code: chance_of(columns, residual, more, code, not_identifiable=one_way)
        for code in (StepCode.SINKAGE, StepCode.OTHER_DIRECTION)
    }
    assert told[StepCode.SINKAGE] == 0.0 < told[StepCode.OTHER_DIRECTION]


@pytest.mark.parametrize("code", [StepCode.SINKAGE, StepCode.LIFTED_ZERO])
def test_no_step_names_a_cause_beside_one_that_acts_by_another_formula(code: StepCode) -> None:
    _, columns, residual, more = look_alikes(0, apart=0.2)
    found = bagged(grams_of(columns, residual), np.random.default_rng(7))
    assert not beside_formed("", found) and set(beside_formed("slope", found)) == {"slip_sinkage", "torque_zero"}
    chances = [
        chance_of(columns, residual, more, code, not_identifiable=beside_formed(formed, found))
        for formed in ("slope", "slip_sinkage")
    ]
    assert chances[0] > 0.5 and chances[1] == 0.0


def test_two_runs_and_a_static_test_give_no_name() -> None:
    _, columns, residual, more = look_alikes(0)
    assert chance_of(columns[:2], residual[:2], more, StepCode.LIFTED_ZERO) == 0.0
    assert chance_of(columns[:2], residual[:2], more, StepCode.SINKAGE) > 0.0


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1), st.sampled_from((-1, 1)), st.booleans()), min_size=1, max_size=9))
def test_campaigns_of_the_same_design_are_drawn(runs: list[tuple[int, int, bool]]) -> None:
    drawn = drawn_anew(np.array(runs, np.intp), 8, np.random.default_rng(len(runs)))
    kinds, passes = [run[:2] for run in runs], [run[2] for run in runs]
    assert (drawn.sum(axis=1) == len(runs)).all()
    for kind in set(kinds) if len(set(kinds)) < len(runs) else ():
        assert (drawn[:, [own == kind for own in kinds]].sum(axis=1) == kinds.count(kind)).all()
    for later in set(passes):
        assert (drawn[:, [own == later for own in passes]].sum(axis=1) > 0).all()


def test_nothing_is_judged_by_all_runs_and_names_by_those_drawn_anew_in_any_order() -> None:
    rng = np.random.default_rng(1)
    columns, more = columns_of_runs(rng, runs=RUNS), columns_of_runs(rng, runs=1)
    grams = grams_of(columns, rng.normal(size=columns.shape[:2]) + 0.3 * columns[:, :, 5])
    ahead = outlook(grams, bagged(grams, rng), rng)
    order = np.r_[0, ahead.totals.shape[1] - 1 : 0 : -1]
    turned = replace(ahead, totals=ahead.totals[:, order], times=ahead.times[:, order])
    added = grams_of(more, more[:, :, 0] * 0.0).matrices[0]
    said = ahead.chance(StepCode.LIKE_OTHERS, added)
    assert said == turned.chance(StepCode.LIKE_OTHERS, added)
    assert 0.0 < said < 1.0
