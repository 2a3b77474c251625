"""The verdict's order, its sets and its sentences, on probabilities made by hand."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from gram_support import column, world

from model.diagnosis.core.coverage import PRESSURE_UNKNOWN, SAME_PASS
from model.diagnosis.core.naming import MOVING, Judgement, judgement
from model.diagnosis.core.posterior import Posterior, candidates, likely_sets, short_set
from model.diagnosis.core.result import (
    Adequacy,
    Cause,
    CauseSet,
    Detectable,
    Finding,
    Gain,
    NextRun,
    ParameterEstimate,
    Scores,
)
from model.diagnosis.core.verdict_words import (
    disagreement_words,
    gain_words,
    named_words,
    nothing_words,
    one_of_words,
    unexplained_words,
    want_words,
)
from model.diagnosis.findings.agreement import Disagreement, Own
from model.diagnosis.time_series.evidence import hypotheses
from model.diagnosis.time_series.grams import Grams

FINE = Adequacy(1.0, 1.8, ok=True)
POOR = Adequacy(3.0, 1.8, ok=False)


def gain(nats: float) -> Gain:
    scores = {"dp": Scores(100.0, 20.0, 0.9, -500.0), "t": Scores(50.0, 9.0, 0.9, -500.0)}
    better = {"dp": Scores(80.0, 15.0, 0.95, -400.0), "t": Scores(25.0, 5.0, 0.95, -400.0)}
    return Gain(scores, better, 20.0, (10.0, 30.0), nats, (("a",),))


def test_a_gain_is_that_of_its_own_channel() -> None:
    assert gain_words(gain(5.0)) == "the error of drawbar pull falls by 20 (10 to 30) % and of driving torque by 50 %"
    of_torque = replace(gain(5.0), channel="t", reduction_percent=50.0, interval95=(40.0, 60.0))
    assert gain_words(of_torque) == "the error of driving torque falls by 50 (40 to 60) % and of drawbar pull by 20 %"
    small = replace(gain(5.0), reduction_percent=-0.2, interval95=(-1.0, 0.8))
    stays = "the error of drawbar pull stays as it is (-1 to 1 %) and that of driving torque falls by 50 %"
    assert gain_words(small) == stays
    assert gain_words(replace(gain(5.0), reduction_percent=float("nan"))) == gain_words(None) == ""


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
    assert "left out" in barred.barred


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
    assert "runs" in said.barred


def test_a_cause_with_which_the_error_grows_is_not_named(grams: Grams) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01})
    said = judgement(found, FINE, replace(gain(9.0), reduction_percent=-1.0))
    assert (said.verdict, said.families) == ("one_of", ("a",))
    assert "left out" in said.barred


def test_what_cannot_be_told_is_not_named(grams: Grams) -> None:
    found = made(grams, {("a",): 0.99, (): 0.01})
    said = judgement(found, FINE, gain(9.0), {"a": "one direction only"})
    assert said == Judgement("one_of", ("a",), barred="one direction only")


def test_a_set_is_as_short_as_the_data_allow(grams: Grams) -> None:
    found = made(grams, {(): 0.1, ("a",): 0.5, ("b",): 0.3, ("c1",): 0.08, ("d",): 0.02})
    assert short_set(found) == ("a", "b", "c")
    pairs = made(grams, {("a", "b"): 0.6, ("b", "d"): 0.38, ("c1",): 0.02})
    assert short_set(pairs) == ("b",)
    assert short_set(made(grams, {(): 1.0})) == ()


def test_candidates_hold_none_and_every_family(grams: Grams) -> None:
    said = {c.name: c.probability for c in candidates(made(grams, {(): 0.3, ("a",): 0.5, ("a", "c1"): 0.2}))}
    assert list(said) == ["a", "none", "c", "b", "d"]
    assert said == pytest.approx({"a": 0.7, "none": 0.3, "c": 0.2, "b": 0.0, "d": 0.0})


def test_sentences_say_verdict_size_and_what_to_do() -> None:
    size = ParameterEstimate("H_m", "m", 0.031, (0.027, 0.035), 0.002)
    cause = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.97, 0.7, (size,))
    chances = {"slip_sinkage": 0.97, "slope": 0.4, "bulldozing": 0.5, "grouser": 0.01}
    named = named_words(Judgement("named", ("slip_sinkage",), ("slope", "bulldozing")), [cause], chances, gain(9), ())
    assert named.startswith("Slip sinkage is at work (probability .970, likeliest as vasilev (.700)): ")
    assert "H_m = 0.031 (0.027 to 0.035) m" in named
    assert "drawbar pull falls by 20 (10 to 30) % and of driving torque by 50 %" in named
    assert "Something more is at work: one of slope (.400), bulldozing (.500)" in named
    unsure = replace(size, interval95=(nan, nan))
    alone = named_words(
        Judgement("named", ("slip_sinkage",)), [replace(cause, parameters=(unsure,))], chances, None, ("grouser",)
    )
    assert "H_m = 0.031 m" in alone
    assert "Grouser would look almost the same" in alone
    runs = (NextRun("a run with more load", ("slope",), 4.0),)
    one_of = one_of_words(Judgement("one_of", ("slope", "bulldozing")), chances, 0.04, (), runs)
    assert one_of.startswith("Something is at work (with probability .960): one of slope (.400), bulldozing (.500).")
    assert one_of.endswith("Next: a run with more load.")
    barred = one_of_words(Judgement("one_of", ("slope",), barred="one direction only"), chances, 0.0, ("grouser",), ())
    assert "Slope is not named: one direction only" in barred
    assert "Grouser would look almost the same" in barred


def test_sentences_say_where_it_shows_and_what_would_have_been_seen() -> None:
    found = [Finding("drawbar_pull", "slip 0.4 to 0.9", -120.0, -8.2)]
    left = unexplained_words(POOR, found, ("slope",), (("r1",), ("r2", "r3")))
    assert "the lack of fit is 3.00, where noise leaves up to 1.80" in left
    assert "drawbar pull, slip 0.4 to 0.9: -120 N (8.2 sigma)" in left
    assert "Runs r1 ask for another soil than r2 and r3" in left
    unsure = nothing_words({"slope": 0.6, "grouser": 0.1}, 0.3, {}, ())
    assert unsure.startswith("Nothing is sure enough to be told from chance (none: .300). Most suspicious is slope")
    nothing = nothing_words({"slope": 0.05}, 0.93, {"slip_sinkage": Detectable("H_m", 0.0034, "m")}, found)
    assert "none: .930" in nothing
    assert "slip sinkage from H_m = 0.0034 m on would be seen in half of such campaigns" in nothing
    want = want_words({"slope": "all runs go one way", "track_drift": "all runs go one way", "zero_drift": "one run"})
    assert (
        want == " Cannot be named from these runs: slope and track drift (all runs go one way); zero drift (one run)."
    )
    assert want_words({}) == ""
    usual = {"multi_pass": SAME_PASS, "tyre_flattening": PRESSURE_UNKNOWN}
    assert want_words(usual) == "", "what is wanting nearly always stands in the table alone"
    assert want_words({**usual, "zero_drift": "one run"}) == " Cannot be named from these runs: zero drift (one run)."


def test_what_never_stood_still_is_not_named(grams: Grams) -> None:
    surely = made(grams, {(): 0.01, ("a",): 0.99})
    assert judgement(surely, FINE, gain(5.0)).verdict == "named"
    moving = judgement(surely, FINE, gain(5.0), settled=False)
    assert (moving.verdict, moving.families, moving.barred) == ("one_of", ("a",), MOVING)


def test_sets_put_forms_together_and_name_pairs(grams: Grams) -> None:
    found = made(grams, {("a", "b"): 0.4, ("d",): 0.35, ("c1",): 0.1, ("c2",): 0.1, ("a",): 0.03, (): 0.02})
    said = likely_sets(found)
    assert [one.causes for one in said] == [("a", "b"), ("d",), ("c",)]
    assert [one.probability for one in said] == pytest.approx([0.4, 0.35, 0.2])
    assert likely_sets(made(grams, {(): 1.0})) == (CauseSet((), 1.0),)


def test_under_one_of_a_family_that_acts_beside_the_set_is_said() -> None:
    chances = {"load_gain": 0.62, "wheel_radius": 0.41, "grouser": 0.44}
    sets = (CauseSet(("load_gain", "grouser"), 0.43), CauseSet(("wheel_radius",), 0.4), CauseSet((), 0.02))
    said = one_of_words(Judgement("one_of", ("load_gain", "wheel_radius")), chances, 0.02, (), (), sets)
    assert "Several may act together: load gain and grouser (.430)." in said
    alone = one_of_words(Judgement("one_of", ("load_gain",)), chances, 0.02, (), (), sets[1:])
    assert "together" not in alone


def test_a_look_alike_comes_with_the_run_that_would_split_it() -> None:
    size = ParameterEstimate("p", "1", 0.615, (0.58, 0.64), 0.02)
    cause = Cause("slip_sinkage", "lyasko", "physical", "lyasko", 0.99, 0.9, (size,))
    runs = (NextRun("a run with more load", ("slip_sinkage", "grouser"), 9.0),)
    judged, chances = Judgement("named", ("slip_sinkage",)), {"slip_sinkage": 0.99, "grouser": 0.01}
    said = named_words(judged, [cause], chances, gain(9), ("grouser",), runs)
    assert said.endswith("To be surer of the name, drive next: a run with more load.")
    assert "p = m1 + m2 = 0.615 (0.58 to 0.64)" in said
    assert "drive next" not in named_words(judged, [cause], chances, gain(9), (), ())


def test_an_error_that_grows_is_not_said_to_fall_by_less_than_nothing() -> None:
    size = ParameterEstimate("H_m", "m", 0.03, (0.02, 0.04), 0.005)
    cause = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.97, 0.7, (size,))
    worse = replace(gain(9), reduction_percent=-38.0, interval95=(-75.0, -4.6))
    said = named_words(Judgement("named", ("slip_sinkage",)), [cause], {"slip_sinkage": 0.97}, worse, ())
    assert "the error of drawbar pull grows by 38 (5 to 75) % and that of driving torque falls by 50 %" in said


def test_campaigns_that_disagree_are_told_with_their_own_values() -> None:
    own = (Own("clay", 0.03, 0.001), Own("sand", 0.04, 0.002))
    [size, form] = disagreement_words(
        [Disagreement("H_m", "m", own, 20.0, 8e-6)], {("slip_sinkage", "sand"): ("ding", 3.6)}
    )
    assert "disagree about H_m: clay 0.03 +- 0.001 m, sand 0.04 +- 0.002 m (Cochran's Q 20.0 on 1, p < .001)" in size
    assert form == "sand by itself asks for slip sinkage as ding instead (3.6 nats)."
    assert disagreement_words([], {}) == ()
