"""The verdict's order, its sets and its sentences, on probabilities made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from gram_support import column, world
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from property_settings import examples

from daq import Note
from model import LackCode
from model.diagnosis import Adequacy, CauseSet, Gain, Reduction, Scores
from model.diagnosis.core.hypotheses import (
    ALIKE_NATS,
    Posterior,
    candidates,
    likely_sets,
    more_alike,
    notes_of_more_alike,
    probable_sets,
    short_set,
)
from model.diagnosis.core.naming import (
    Judgement,
    asked_again,
    judgement,
    less_beside_usual,
    prior_shifts,
    unshown,
    with_more_probable,
)
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import hypotheses

FINE = Adequacy(1.0, 1.8, ok=True)
POOR = Adequacy(3.0, 1.8, ok=False)


def gain(nats: float) -> Gain:
    scores = {"dp": Scores(100.0, 20.0, 0.9, -500.0), "t": Scores(50.0, 9.0, 0.9, -500.0)}
    better = {"dp": Scores(80.0, 15.0, 0.95, -400.0), "t": Scores(25.0, 5.0, 0.95, -400.0)}
    return Gain(scores, better, 20.0, (10.0, 30.0), nats, (("a",),))


@pytest.fixture(scope="module")
def grams() -> Grams:
    columns = (column("a"), column("b"), column("c", "c1"), column("c", "c2"), column("d"))
    return world(0, columns, runs=3, n=20).grams(np.zeros(5), np.random.default_rng(0))


def made(grams: Grams, chances: dict[tuple[str, ...], float], calibrated: bool = True) -> Posterior:
    listed = hypotheses(grams)
    probability = np.zeros(len(listed))
    for keys, p in chances.items():
        probability[listed.index_of(keys)] = p
    assert probability.sum() == pytest.approx(1.0)
    return Posterior(listed, np.zeros(len(listed)), probability, calibrated)


def test_more_causes_that_fit_about_as_well_are_told_beside_fewer(grams: Grams) -> None:
    """The evidence decides, its prior apart; what the best set keeps is not repeated, nor what holds fewer causes."""
    listed = hypotheses(grams)

    def weighed(evidence: dict[tuple[str, ...], float]) -> Posterior:
        own = np.full(len(listed), -50.0)
        for keys, nats in evidence.items():
            own[listed.index_of(keys)] = nats
        return Posterior(listed, own, np.zeros(0), calibrated=True).as_they_are()

    pair = weighed({("a",): 10.0, ("b", "c1"): 8.0, ("b", "c2"): 7.0, ("b", "c2", "d"): 9.0, ("a", "d"): 11.0})
    assert more_alike(pair, ("a",)) == {("b", "c"): 2.0}
    assert more_alike(pair, ("a", "b")) == {}, "a set that holds one of them is no other explanation"
    [note] = notes_of_more_alike(pair, "named", ("a",))
    assert dict(note.values) == {"families": ("a",), "instead": (("b", "c"),), "nats": (2.0,)}
    assert notes_of_more_alike(pair, "nothing_detectable", ()) == ()
    assert more_alike(weighed({("a",): 10.0, ("b", "c1"): 10.0 - ALIKE_NATS}), ("a",)) == {}
    assert more_alike(weighed({("a",): 10.0, ("b",): 9.0, ("b", "c1"): 9.5}), ("a",)) == {}, (
        "one is open, not kept back"
    )
    beside = weighed({("a", "d"): 10.0, ("b", "c1", "d"): 9.0, ("b", "c1"): 9.0})
    assert more_alike(beside, ("a",)) == {("b", "c"): 1.0}
    assert [note.values["families"] for note in notes_of_more_alike(beside, "one_of", ("a", "d"))] == []


def test_lack_of_fit_comes_before_everything(grams: Grams) -> None:
    sure = made(grams, {("a",): 1.0})
    assert judgement(sure, POOR, gain(50.0)) == Judgement("unexplained")
    assert judgement(made(grams, {(): 1.0}), POOR, gain(0.0)) == Judgement("unexplained")


def test_nothing_is_seen_where_none_is_not_unlikely(grams: Grams) -> None:
    for none, verdict in ((0.6, "nothing_detectable"), (0.25, "nothing_detectable"), (0.15, "one_of")):
        assert judgement(made(grams, {(): none, ("a",): 1 - none}), FINE, gain(3.0)).verdict == verdict


def test_a_cause_of_no_use_on_other_runs_is_nothing_unless_none_is_unlikely(grams: Grams) -> None:
    likely = made(grams, {(): 0.15, ("a",): 0.85})
    assert judgement(likely, FINE, gain(-0.5)).verdict == "nothing_detectable"
    assert judgement(likely, FINE, gain(0.5)).verdict == "one_of"
    surely = made(grams, {(): 0.01, ("a",): 0.99})
    barred = judgement(surely, FINE, gain(-0.5))
    assert barred.verdict == "one_of"
    assert barred.barred is not None and barred.barred.code == LackCode.NO_BETTER
    assert barred.kept_back == (("a", barred.barred),)


def test_a_family_is_named_and_not_its_form(grams: Grams) -> None:
    found = made(grams, {(): 0.02, ("c1",): 0.5, ("c2",): 0.48})
    assert judgement(found, FINE, gain(20.0)) == Judgement("named", ("c",))
    assert found.forms("c") == pytest.approx({"c1": 0.5 / 0.98, "c2": 0.48 / 0.98})


def test_two_causes_are_named_at_once(grams: Grams) -> None:
    found = made(grams, {("a", "b"): 0.95, ("a", "d"): 0.05})
    assert judgement(found, FINE, gain(20.0)).families == ("a", "b")


def test_beside_a_named_cause_stands_the_set_of_the_other(grams: Grams) -> None:
    found = made(grams, {("a", "b"): 0.6, ("a", "d"): 0.38, ("a",): 0.02})
    said = judgement(found, FINE, gain(20.0))
    assert said.families == ("a",)
    assert said.beside == ("b", "d")
    alone = made(grams, {("a", "b"): 0.3, ("a",): 0.7})
    assert judgement(alone, FINE, gain(20.0)).beside == ()


@pytest.mark.parametrize("without", [{"calibrated": False}, {}])
def test_without_other_runs_there_is_no_name(grams: Grams, without: dict[str, bool]) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01}, **without)
    said = judgement(found, FINE, None if not without else gain(9.0))
    assert said.verdict == "one_of"
    assert said.families == ("a",)
    assert said.barred == Note(LackCode.NOT_CHECKED)


def test_a_cause_with_which_the_error_grows_is_not_named(grams: Grams) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01})
    for worse, named in (
        ((-95.0, (-140.0, -60.0)), False),
        ((-5.0, (-12.0, 2.0)), True),
        ((-1.7, (-3.4, -0.1)), True),
        ((30.0, (20.0, 40.0)), True),
    ):
        reductions = {"dp": Reduction(20.0, (10.0, 30.0)), "t": Reduction(*worse)}
        said = judgement(found, FINE, replace(gain(9.0), reductions=reductions))
        assert (said.verdict == "named") == named
        if not named:
            facts = {"channel": "t", "percent": 95.0, "low": 60.0, "high": 140.0}
            assert said.barred == Note(LackCode.CHANNEL_WORSE, values=facts)


def test_a_name_needs_three_nats_on_held_out_runs(grams: Grams) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01})
    assert judgement(found, FINE, gain(3.0)).verdict == "named"
    said = judgement(found, FINE, gain(2.9))
    assert said.barred == Note(LackCode.NO_BETTER, values={"nats": 2.9, "least": 3.0})


@pytest.mark.parametrize(("fall", "named"), [((70.0, (68.0, 72.0)), True), ((27.0, (-17.0, 55.0)), False)])
def test_or_a_held_out_error_that_falls_for_certain(
    grams: Grams, fall: tuple[float, tuple[float, float]], named: bool
) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01})
    reductions = {"dp": Reduction(3.0, (-5.0, 10.0)), "t": Reduction(*fall)}
    said = judgement(found, FINE, replace(gain(-361.0), reductions=reductions))
    assert (said.verdict == "named") == named


def test_parts_that_cancel_are_not_named(grams: Grams) -> None:
    why = Note(LackCode.PARTS_CANCEL, values={"families": ("a", "b"), "without": "b"})
    found = made(grams, {("a", "b"): 0.99, (): 0.01})
    assert judgement(found, FINE, gain(9.0), contradiction=why) == Judgement("one_of", ("a", "b"), barred=why)


def test_a_lone_family_that_is_not_named_stands_beside_its_nearest_rival(grams: Grams) -> None:
    found = made(grams, {("a",): 0.97, ("b",): 0.012, ("d",): 0.008, (): 0.01})
    assert judgement(found, FINE, gain(1.0)).families == ("a", "b")


def test_a_physical_cause_is_asked_again_beside_the_usual_soil() -> None:
    """The families of the catalogue: what becomes of a name when the stress peak may lie ahead."""
    families = ("slip_sinkage", "torque_zero")
    named = Judgement("named", families)

    def again(p: float, verdict: Judgement = named) -> Judgement:
        return asked_again(verdict, {"slip_sinkage": p}, ("stress_peak_shift",), 0.9)

    assert again(0.95) == named
    lost = again(0.6)
    assert lost.verdict == "one_of" and lost.families == ("slip_sinkage", "stress_peak_shift", "torque_zero")
    assert lost.barred is not None and lost.barred.code == LackCode.PEAK_MAY_SHIFT
    assert lost.kept_back == (("slip_sinkage", lost.barred), ("torque_zero", lost.barred))
    both = again(0.6, Judgement("named", ("slip_sinkage", "stress_peak_shift")))
    assert both.families == ("slip_sinkage", "stress_peak_shift")
    chances = {"slip_sinkage": 0.6, "torque_zero": 0.999}
    kept_name = asked_again(named, chances, ("stress_peak_shift",), 0.9)
    assert (kept_name.verdict, kept_name.families) == ("named", ("torque_zero",))
    assert kept_name.beside == ("slip_sinkage", "stress_peak_shift")
    for kept in (Judgement("named", ("torque_zero",)), Judgement("one_of", families)):
        assert again(0.0, kept) == kept


def test_a_set_holds_every_family_that_is_more_probable_than_a_member_or_than_not(grams: Grams) -> None:
    """What acts beside the members of the shortest set; a peak that a rule put there asks for none beside it."""
    found = made(grams, {("a",): 0.25, ("a", "b"): 0.35, ("c1",): 0.15, ("b", "c1"): 0.15, ("d",): 0.1})
    assert judgement(found, FINE, gain(9.0)).families == ("a", "c", "d")
    assert with_more_probable(Judgement("one_of", ("a", "c")), found).families == ("a", "b", "c")
    assert with_more_probable(Judgement("one_of", ("c",)), found).families == ("a", "b", "c")
    assert with_more_probable(Judgement("one_of", ("a",)), found).families == ("a", "b")
    assert with_more_probable(Judgement("named", ("a",)), found) == Judgement("named", ("a",))


def test_beside_a_usual_peak_stands_only_what_is_more_probable_than_not() -> None:
    families = ("slip_sinkage", "interface_friction", "shear_softening", "stress_peak_shift")
    chances = dict(zip(families, (0.99, 0.7, 0.08, 0.06), strict=True))
    found = cast(Posterior, SimpleNamespace(families=lambda: chances))
    members = ("slip_sinkage", "stress_peak_shift")
    peak = Note(LackCode.PEAK_MAY_SHIFT, values={"family": "slip_sinkage", "probability": 0.7})
    barred = with_more_probable(Judgement("one_of", members, barred=peak), found)
    assert barred.families == ("slip_sinkage", "interface_friction", "stress_peak_shift")
    assert with_more_probable(Judgement("one_of", members), found).families == families


def test_a_name_that_is_less_probable_beside_the_usual_soil_says_so() -> None:
    named = Judgement("named", ("slip_sinkage", "torque_zero", "stress_peak_shift"))
    for p, told in ((0.95, ()), (0.6, ("slip_sinkage",))):
        notes = less_beside_usual(named, {"slip_sinkage": p}, ("stress_peak_shift",), 0.9)
        assert tuple(note.values["family"] for note in notes) == told
    assert less_beside_usual(replace(named, verdict="one_of"), {}, (), 0.9) == ()


def test_a_name_is_sure_by_the_runs_as_they_are_too(grams: Grams) -> None:
    """What the average and the runs themselves say of "a"; a table has no average."""

    def said(averaged: float, alone: float, unlisted: float = 0.0) -> Judgement:
        found = made(grams, {("a",): averaged, ("b",): 1.0 - averaged})
        chances = np.full(len(found.hypotheses), 1e-12)
        chances[[found.hypotheses.index_of((key,)) for key in "ab"]] = alone, 1.0 - alone
        own = replace(found, log_evidence=np.log(chances) - found.hypotheses.log_prior)
        assert (judgement(own, FINE, gain(9.0)).verdict == "named") == (averaged > 0.9)
        return judgement(own, Adequacy(unlisted, 0.5, ok=True, measure="probability"), gain(9.0), of_runs=True)

    for averaged in (0.81, 0.95):
        assert said(averaged, 0.98) == Judgement("named", ("a",))
        assert bool(said(averaged, 0.85).kept_back) == (averaged > 0.9)
        [(family, why)] = said(averaged, 0.96).kept_back
        assert (family, why.code) == ("a", LackCode.NOT_SURE)
        assert why.values["probability"] == pytest.approx(0.96)
        assert said(averaged, 0.96) == Judgement("one_of", ("a", "b"), barred=why)
        assert said(averaged, 0.98, 0.09).kept_back[0][1].code == LackCode.UNLISTED_MAY_ACT
        assert said(averaged, 0.999, 0.09) == Judgement("named", ("a",))
    assert said(0.79, 0.999) == Judgement("one_of", ("a", "b"))


def test_a_prior_that_decides_is_said(grams: Grams) -> None:
    """.91 is named and .77 not; a third of the prior of "a" makes .99 to .97, which changes nothing."""
    close, sure = (made(grams, {("a",): p, ("b",): 1.0 - p}) for p in (0.91, 0.99))

    def judge(found: Posterior) -> Judgement:
        return judgement(found, FINE, gain(9.0))

    shifts = prior_shifts(close, judge(close), judge)
    assert {(one.family, one.factor > 1, one.verdict) for one in shifts} == {
        ("a", False, "one_of"),
        ("b", True, "one_of"),
    }
    assert prior_shifts(sure, judge(sure), judge) == ()

    def strictly(found: Posterior) -> Judgement:
        return judgement(found, FINE, gain(9.0), of_runs=True)

    evidence = np.full(len(sure.hypotheses), -99.0)
    evidence[sure.hypotheses.index_of(("a",))] = 0.0
    evidence[sure.hypotheses.index_of(("b",))] = -np.log(60.0)  # .984 of the runs as they are: .95 with a third
    alone = replace(sure, log_evidence=evidence - sure.hypotheses.log_prior)
    assert {(one.family, one.factor > 1) for one in prior_shifts(alone, strictly(alone), strictly)} == {
        ("a", False),
        ("b", True),
    }


def test_what_cannot_be_told_is_not_named(grams: Grams) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01})
    said = judgement(found, FINE, gain(9.0), {"a": Note(LackCode.ONE_DIRECTION)})
    assert said == Judgement("one_of", ("a",), barred=Note(LackCode.ONE_DIRECTION))
    assert said.kept_back == (("a", Note(LackCode.ONE_DIRECTION)),)


def test_a_likely_cause_that_a_rule_bars_beside_a_named_one_is_kept_with_the_rule(grams: Grams) -> None:
    found = made(grams, {("a", "b"): 0.99, (): 0.01})
    said = judgement(found, FINE, gain(9.0), {"b": Note(LackCode.ONE_DIRECTION)})
    assert (said.verdict, said.families) == ("named", ("a",))
    assert said.kept_back == (("b", Note(LackCode.ONE_DIRECTION)),)
    assert judgement(made(grams, {("a",): 0.99, (): 0.01}), FINE, gain(9.0)).kept_back == ()


@pytest.mark.parametrize(
    ("chance", "unlisted", "code", "shown"),
    [
        (0.99, 0.0, LackCode.NOT_AT_STANDSTILL, True),
        (0.99, 0.02, LackCode.NOT_AT_STANDSTILL, False),
        (0.97, 0.0, LackCode.NOT_AT_STANDSTILL, False),
        (0.99, 0.0, LackCode.ONE_LOAD, False),
    ],
)
def test_driving_alone_shows_a_zero_that_is_nearly_certain(
    grams: Grams, chance: float, unlisted: float, code: LackCode, shown: bool
) -> None:
    """However often it is in the resampled runs, which the rule of names judges."""
    found = made(grams, {("a",): 0.85, (): 0.15})
    chances = np.full(len(found.hypotheses), 1e-12)
    chances[[found.hypotheses.index_of(keys) for keys in (("a",), ())]] = chance, 1.0 - chance
    found = replace(found, log_evidence=np.log(chances) - found.hypotheses.log_prior)
    judged = Adequacy(unlisted, 0.5, True, "probability")
    assert unshown({"a": Note(code), "b": Note(code)}, found, judged).keys() == ({"b"} if shown else {"a", "b"})


def test_all_that_are_nearly_certain_stand_in_a_set_that_has_no_name(grams: Grams) -> None:
    found = made(grams, {("a", "b"): 0.99, (): 0.01})
    judged = Adequacy(0.2, 0.5, True, "probability")
    assert short_set(found) == ("a",)
    assert judgement(found, judged, gain(9.0)) == Judgement("one_of", ("a", "b"))


def test_a_set_is_as_short_as_the_data_allow(grams: Grams) -> None:
    found = made(grams, {(): 0.1, ("a",): 0.5, ("b",): 0.3, ("c1",): 0.08, ("d",): 0.02})
    assert short_set(found) == ("a", "b", "c")
    pairs = made(grams, {("a", "b"): 0.6, ("b", "d"): 0.38, ("c1",): 0.02})
    assert short_set(pairs) == ("b",)
    assert short_set(made(grams, {(): 1.0})) == ()


@examples(40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(0.01, 1.0), min_size=5, max_size=5), st.integers(1, 6))
def test_the_sets_that_are_kept_hold_what_is_named_and_are_the_most_probable(
    grams: Grams, weights: list[float], most: int
) -> None:
    listed = [(), ("a",), ("b",), ("a", "b"), ("a", "c1")]
    found = made(grams, dict(zip(listed, np.array(weights) / sum(weights), strict=True)))
    for named in ((), ("a",), ("a", "b")):
        kept = probable_sets(found, most, named)
        holding = {keys: p for keys, p in probable_sets(found, 99).items() if {*named} <= {*keys}}
        assert len(kept) == min(most, len(holding)) and kept.items() <= holding.items()
        left = [p for keys, p in holding.items() if keys not in kept]
        assert (() in kept) == (not named)
        assert max(left, default=0.0) <= min((p for keys, p in kept.items() if keys), default=1.0)


def test_candidates_hold_none_and_every_family(grams: Grams) -> None:
    said = {c.name: c.probability for c in candidates(made(grams, {(): 0.3, ("a",): 0.5, ("a", "c1"): 0.2}))}
    assert list(said) == ["a", "none", "c", "b", "d"]
    assert said == pytest.approx({"a": 0.7, "none": 0.3, "c": 0.2, "b": 0.0, "d": 0.0})


def test_what_did_not_converge_is_not_explained(grams: Grams) -> None:
    surely = made(grams, {(): 0.01, ("a",): 0.99})
    assert judgement(surely, FINE, gain(5.0)).verdict == "named"
    for found in (surely, made(grams, {(): 1.0})):
        unsettled = judgement(found, FINE, gain(5.0), converged=False)
        assert unsettled == Judgement("unexplained", barred=Note(LackCode.NOT_SETTLED))


@pytest.mark.parametrize(("unlisted", "named"), [(0.05, True), (0.06, False)])
def test_a_name_is_as_sure_as_that_nothing_unlisted_acts(grams: Grams, unlisted: float, named: bool) -> None:
    judged = Adequacy(unlisted, 0.5, ok=True, measure="probability")
    said = judgement(made(grams, {("a",): 0.95, (): 0.05}), judged, gain(9.0))
    why = Note(LackCode.UNLISTED_MAY_ACT, values={"probability": pytest.approx(unlisted)})
    assert said.verdict == ("named" if named else "one_of") and said.kept_back == (() if named else (("a", why),))
    assert judgement(made(grams, {("a",): 0.95, (): 0.05}), replace(judged, measure="lack of fit"), gain(9.0)).families


def test_nothing_to_judge_by_explains_nothing(grams: Grams) -> None:
    empty = Adequacy(np.nan, np.nan, ok=False)
    said = judgement(made(grams, {(): 1.0}), empty, gain(0.0))
    assert said == Judgement("unexplained", barred=Note(LackCode.NOTHING_JUDGED))
    assert judgement(made(grams, {(): 1.0}), POOR, gain(0.0), converged=False).barred is None


@pytest.mark.parametrize(
    ("runs", "error", "more"),
    # Of n few runs: sqrt(q / (n - 1)), q the 99.99 % quantile of chi-square with n - 1 degrees of freedom: 21.108 of 3
    [(60, 149.9, False), (60, 150.1, True), (60, np.nan, True), (4, 265.2, False), (4, 265.3, True), (4, np.nan, True)],
)
def test_soil_and_noise_explain_no_more_than_they_give(grams: Grams, runs: int, error: float, more: bool) -> None:
    known = replace(gain(-1.0), expected={"t": 50.0, "dp": 100.0}, chosen=(("a",),) * runs)
    known = replace(known, base={**known.base, "dp": replace(known.base["dp"], R0=error)})
    for chances in ({(): 0.9, ("a",): 0.1}, {(): 0.06, ("a",): 0.94}):
        said = judgement(made(grams, chances), FINE, known)
        assert said.verdict == ("unexplained" if more else "nothing_detectable")
        assert (said.barred is not None) == more
        if said.barred:
            assert said.barred.code == LackCode.MORE_THAN_NOISE
            assert (said.barred.values["channel"], said.barred.values["expected"]) == ("dp", 100.0)
    assert judgement(made(grams, {(): 0.01, ("a",): 0.99}), FINE, replace(known, log_likelihood_gain=9.0)).families


def test_sets_put_forms_together_and_name_pairs(grams: Grams) -> None:
    found = made(grams, {("a", "b"): 0.4, ("d",): 0.35, ("c1",): 0.1, ("c2",): 0.1, ("a",): 0.03, (): 0.02})
    said = likely_sets(found)
    assert [one.causes for one in said] == [("a", "b"), ("d",), ("c",)]
    assert [one.probability for one in said] == pytest.approx([0.4, 0.35, 0.2])
    assert likely_sets(made(grams, {(): 1.0})) == (CauseSet((), 1.0),)
