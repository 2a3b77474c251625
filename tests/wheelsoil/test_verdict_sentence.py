"""The sentence of a verdict says what, how large, how sure, where, and what to do next."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import nan

import pytest
from diagnosis_samples import MORE_LOAD, diagnosis

from daq import Fault, Note, Severity, VehicleConfig
from model import DiagnosisCode, LackCode
from model.diagnosis import (
    Adequacy,
    Candidate,
    Cause,
    CauseSet,
    Detectable,
    Finding,
    Gain,
    Grounds,
    Kind,
    NextRun,
    ParameterEstimate,
    Reduction,
    Scores,
    Shape,
)
from model.diagnosis.core.result import BarredCause, PriorShift, RefutedSoil, undecided
from model.diagnosis.findings.agreement import Disagreement, Own, disagreement_notes
from wheelsoil.view.jobs import shown_of
from wheelsoil.wording.diagnosis_text import gain_text
from wheelsoil.wording.grounds_text import (
    Statement,
    chances_of,
    nothing_words,
    rival_words,
    unexplained_words,
    verdict_words,
    want_words,
)
from wheelsoil.wording.mending import next_steps, step_of
from wheelsoil.wording.names import stretches
from wheelsoil.wording.notes import note_text, step_text
from wheelsoil.wording.verdict import (
    deciding_runs,
    details_of,
    falling_channel,
    finding_of,
    gain_words,
    headline_of,
    model_title,
    named_words,
    one_of_words,
    sentence_of,
    sentences_of,
    statements_of,
)

SIZE = ParameterEstimate("H_m", "m", 0.031, (0.027, 0.035), 0.002)
CAUSE = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.97, 0.7, (SIZE,))
CHANCES = {"slip_sinkage": 0.97, "slope": 0.4, "bulldozing": 0.5, "grouser": 0.01}
SKID, PEAK = "skid_sinkage", "stress_peak_shift"
ONE_WAY = Note(LackCode.ONE_DIRECTION)
DRIFT = Note(LackCode.ONE_RUN_NO_DRIFT)
BARE = replace(
    diagnosis("named"), causes=(CAUSE,), gain=None, next_run=(), sets=(), not_identifiable={}, grounds=Grounds()
)


def words(statements: Iterable[Statement]) -> str:
    return " ".join(one.text for one in statements)


def gain(reduction_percent: float = 20.0) -> Gain:
    score = Scores(100.0, 1.0, 0.9, 0.0)
    better, half = replace(score, R0=80.0), replace(score, R0=50.0)
    return Gain({"dp": score, "t": score}, {"dp": better, "t": half}, reduction_percent, (10.0, 30.0), 9.0, ())


def test_a_gain_is_that_of_its_own_channel() -> None:
    assert gain_words(gain()) == "the error of drawbar pull falls by 20 (10 to 30) % and of driving torque by 50 %"
    of_torque = replace(gain(), channel="t", reduction_percent=50.0, interval95=(40.0, 60.0))
    assert gain_words(of_torque) == "the error of driving torque falls by 50 (40 to 60) % and of drawbar pull by 20 %"
    small = replace(gain(), reduction_percent=-0.2, interval95=(-1.0, 0.8))
    assert (
        gain_words(small)
        == "the error of drawbar pull stays as it is (-1 to 1 %) and that of driving torque falls by 50 %"
    )
    assert gain_words(replace(gain(), reduction_percent=float("nan"))) == gain_words(None) == ""


def test_a_look_alike_comes_with_the_run_that_would_split_it() -> None:
    size = ParameterEstimate("p", "1", 0.615, (0.58, 0.64), 0.02)
    cause = Cause("slip_sinkage", "lyasko", "physical", "lyasko", 0.99, 0.9, (size,))
    runs = (NextRun(MORE_LOAD, ("slip_sinkage", "grouser"), 9.0),)
    likely = (Candidate("slip_sinkage", 0.93), Candidate("grouser", 0.06))
    grounds = Grounds(confounded=("grouser",))
    alike = replace(BARE, causes=(cause,), candidates=likely, next_run=runs, grounds=grounds)
    said = words(named_words(alike, CHANCES))
    assert said.endswith("Next: a run with more load: about 12.9 kN on the wheel, 500 kg more there than so far.")
    assert "p = m1 + m2 = 0.615 (0.580 to 0.640)" in said
    assert "Next:" not in words(named_words(replace(alike, grounds=Grounds()), CHANCES))
    decided = replace(alike, candidates=(Candidate("grouser", 0.001),))
    assert "Next:" not in words(named_words(decided, CHANCES)) and not deciding_runs(decided)


def test_an_error_that_grows_is_not_said_to_fall_by_less_than_nothing() -> None:
    worse = replace(gain(), reduction_percent=-38.0, interval95=(-75.0, -4.6))
    said = words(named_words(replace(BARE, gain=worse), CHANCES))
    assert "the error of drawbar pull grows by 38 (5 to 75) % and that of driving torque falls by 50 %" in said


def test_campaigns_that_disagree_are_reported_with_their_own_values() -> None:
    own = (Own("clay", 0.03, 0.001), Own("sand", 0.04, 0.002))
    found = [Disagreement("H_m", "m", own, 20.0, 8e-6)]
    [size, form] = map(note_text, disagreement_notes(found, {("slip_sinkage", "sand"): ("ding", 3.6)}))
    assert "disagree about H_m: clay 0.03 ± 0.001 m, sand 0.04 ± 0.002 m (Cochran's Q 20.0 on 1, p < 0.1 %)" in size
    assert form == "by itself, sand asks for slip sinkage as ding instead (3.6 nats)"
    assert disagreement_notes([], {}) == ()


def causes(*families: str) -> tuple[Cause, ...]:
    return tuple(Cause(family, "", "physical", family, CHANCES.get(family, 0.5), 1.0, ()) for family in families)


def test_a_name_is_said_with_size_gain_and_what_is_beside_it() -> None:
    named = words(named_words(replace(BARE, gain=gain(), grounds=Grounds(beside=("slope", "bulldozing"))), CHANCES))
    assert named.startswith("Slip sinkage explains the misfit (97.0 %; vasilev most probable, 70.0 %): ")
    assert "H = 0.0310 (0.0270 to 0.0350) m" in named
    assert "drawbar pull falls by 20 (10 to 30) % and of driving torque by 50 %" in named
    assert "A further cause acts: slope (40.0 %) or bulldozing (50.0 %)" in named
    unsure = replace(CAUSE, parameters=(replace(SIZE, interval95=(nan, nan)),))
    alone = words(named_words(replace(BARE, causes=(unsure,), grounds=Grounds(confounded=("grouser",))), CHANCES))
    assert "H = 0.031" in alone
    assert "Grouser (1.0 %) has a similar signature, but is separable in these data" in alone


def test_other_places_take_the_parts_of_a_verdict_that_they_show_by_themselves() -> None:
    """The page shows finding, gain and next step apart: each is marked, none is found again by its words."""
    run = NextRun(MORE_LOAD, (), 4.0)
    grounds, likely = Grounds(confounded=("grouser",)), (Candidate("grouser", 0.06),)
    found = replace(BARE, gain=gain(), grounds=grounds, candidates=likely, next_run=(run,))
    assert [one.about for one in statements_of(found)] == ["cause", "gain", "", "next"]
    assert finding_of(found) == "Slip sinkage explains the misfit (97.0 %; vasilev most probable, 70.0 %)"
    assert statements_of(found)[0].text.startswith(f"{finding_of(found)}: H = ")
    shown = shown_of(found)
    assert shown["next"] == f"Next: {step_text(run)}."
    assert shown["details"] == " ".join(one.text for one in statements_of(found)[1:-1])
    doubtful = replace(run, naming_chance=0.1)
    open_one = replace(BARE, verdict="one_of", causes=causes("slope", "bulldozing"), next_run=(doubtful,))
    assert [one.about for one in statements_of(open_one)][-2:] == ["", "next"]
    assert "No single run decides." in details_of(open_one)


def test_the_first_cause_is_most_probable_where_it_is_twice_as_probable_as_the_next() -> None:
    pair = causes("slope", "bulldozing")
    titles = [
        model_title(replace(BARE, verdict="one_of", causes=(replace(pair[0], probability=first), pair[1])))
        for first in (1.1 * pair[1].probability, 2.1 * pair[1].probability)
    ]
    assert titles == ["Possible", "Most probable"]
    assert [model_title(replace(BARE, verdict=v, causes=pair[:1])) for v in ("named", "one_of")] == [
        "Recommended",
        "Most probable",
    ]


def test_a_set_is_said_with_what_bars_a_name_and_what_to_drive() -> None:
    runs = (NextRun(MORE_LOAD, ("slope",), 4.0),)
    said = one_of_words(replace(BARE, causes=causes("slope", "bulldozing"), next_run=runs), CHANCES, 0.04)
    one_of = words(said)
    assert one_of.startswith("A cause acts (with probability 96.0 %): slope (40.0 %) or bulldozing (50.0 %).")
    assert one_of.endswith("Next: a run with more load: about 12.9 kN on the wheel, 500 kg more there than so far.")
    grounds = Grounds(barred=ONE_WAY, confounded=("grouser",))
    barred = words(one_of_words(replace(BARE, causes=causes("slope"), grounds=grounds), CHANCES, 0.0))
    assert "Slope is not named: all runs go one way: drive some back" in barred
    assert "Grouser (1.0 %) has a similar signature, but is separable in these data" in barred


def test_causes_that_surely_act_are_joined_by_and() -> None:
    """Two above 95 % are no choice; a third one that is open stands beside them."""
    chances = {"slope": 0.97, "bulldozing": 0.96, "grouser": 0.3}
    both = one_of_words(replace(BARE, verdict="one_of", causes=causes("slope", "bulldozing")), chances, 0.0)
    assert words(both).startswith(
        "Several causes act (with probability > 99.9 %): slope (97.0 %) and bulldozing (96.0 %). "
        "None is sure enough for a name."
    )
    three = one_of_words(replace(BARE, verdict="one_of", causes=causes(*chances)), chances, 0.0)
    assert "slope (97.0 %) and bulldozing (96.0 %), perhaps with grouser (30.0 %)" in words(three)
    likely = [replace(cause, probability=chances[cause.name]) for cause in causes(*chances)]
    title = headline_of(replace(BARE, verdict="one_of", causes=tuple(likely), gain=None))
    assert title == "Slope and bulldozing, perhaps with grouser: these data cannot separate them."
    title = headline_of(replace(BARE, verdict="one_of", causes=tuple(likely[:2]), gain=None))
    assert title == "Slope and bulldozing: not sure enough for names."
    hardly = [replace(likely[2], name=name, probability=0.006) for name in ("grouser", "track_drift", "exit_angle")]
    rare = replace(BARE, verdict="one_of", causes=(*likely[:2], *hardly), gain=None, candidates=())
    assert headline_of(rare) == title and "perhaps" not in sentence_of(rare), "nobody acts upon 0.6 %"


LATE = Cause(
    "speed_latency",
    "",
    "measurement",
    "speed_latency",
    0.999,
    1.0,
    (ParameterEstimate("extra_delay_s", "s", 0.1531, (0.1374, 0.1689), 0.008),),
)


def test_sizes_of_several_causes_stand_behind_their_names() -> None:
    size = (ParameterEstimate("relative", "1", -0.0434, (-0.05, -0.037), 0.0034),)
    gains = [replace(each, key=each.name, parameters=size) for each in causes("torque_gain", "pull_gain")]
    both, one = (replace(BARE, causes=tuple(some), gain=gain()) for some in (gains, gains[:1]))
    value = "relative error = −0.0434 (−0.0500 to −0.0370)"
    assert f"Torque gain: {value}; pull gain: {value}." in details_of(both)
    assert value.capitalize() + "." in details_of(one)


def test_the_headline_states_an_error_only_where_it_falls_for_certain() -> None:
    """Never "explains" beside an error that grows; another channel may fall for certain; else the size is certain."""
    unsure = replace(gain(4.0), interval95=(-1.0, 9.0), reductions={})
    late = replace(BARE, causes=(LATE,), gain=unsure, plot_data=())
    title = "Speed latency acts: the ground speed comes 0.1531 s (0.1374 to 0.1689) later than declared."
    assert headline_of(late) == title and falling_channel(late) is None
    assert finding_of(late) == "Speed latency acts (99.9 %)" and "0.1531" not in " ".join(details_of(late))
    worse = replace(gain(-10.0), interval95=(-169.0, 55.0))
    assert headline_of(replace(BARE, gain=worse)) == "Slip sinkage acts: H = 0.0310 (0.0270 to 0.0350) m."
    other = replace(worse, reductions={"dp": Reduction(-10.0, (-169.0, 55.0)), "t": Reduction(50.0, (40.0, 60.0))})
    assert headline_of(replace(BARE, gain=other)) == (
        "Slip sinkage explains the misfit: the driving torque error on held-out data falls by 50 %."
    )
    found = replace(BARE, gain=other)
    assert "On held-out runs the error of driving torque falls by 50 (40 to 60) %" in sentence_of(found)
    assert gain_text(found).startswith("R0 of the driving torque falls by 50 % (95 %: 40 to 60 %)")
    assert shown_of(found)["main_channel"] == "t" and shown_of(found)["change_percent"] == 50.0


def test_a_name_that_the_stress_peak_bars_is_said_with_the_rule_and_both_probabilities() -> None:
    peak = Note(LackCode.PEAK_MAY_SHIFT, values={"family": "slip_sinkage", "probability": 0.177})
    likely = (Candidate("slip_sinkage", 0.998), Candidate("stress_peak_shift", 0.002))
    both = (replace(CAUSE, probability=0.998), *causes("stress_peak_shift"))
    found = replace(BARE, verdict="one_of", causes=both, candidates=likely, grounds=Grounds(barred=peak))
    title = "Slip sinkage or a stress peak ahead of the wheel's bottom: these runs do not decide."
    assert headline_of(found) == title == headline_of(replace(found, causes=both[:1]))
    first, size, why = details_of(found)
    assert first == "A cause acts (with probability > 99.9 %): slip sinkage or stress peak shift."
    assert size == "If slip sinkage acts: H = 0.0310 (0.0270 to 0.0350) m."
    assert why == (
        "Slip sinkage is not named: its probability is only 17.7 % if the stress peak usually lies ahead of the "
        "wheel's bottom, as on most soils, and 99.8 % if it seldom does."
    )


@pytest.mark.parametrize("channels", [(), ("dp",)])
def test_a_cause_that_a_rule_keeps_back_beside_a_name_does_not_act_but_has_the_rule(channels: tuple[str, ...]) -> None:
    (gain_cause,) = causes("torque_gain")
    kept = BarredCause(replace(gain_cause, probability=0.979), Note(LackCode.FORM_NOT_LISTED, values={"family": SKID}))
    likely = (Candidate(SKID, 0.999), Candidate("torque_gain", 0.979), Candidate("slope", 0.3))
    grounds = Grounds(beside=("torque_gain",), kept_back=(kept,), table_channels=channels)
    named = replace(BARE, candidates=likely, grounds=grounds)
    said = sentence_of(named)
    assert "Torque gain (97.9 %) is not named: skid sinkage acts by another formula than the listed ones, and" in said
    assert "A further cause" not in said
    beside = replace(named, grounds=replace(grounds, beside=("torque_gain", "slope")))
    assert "A further cause may act: slope (30.0 %). Torque gain (97.9 %) is not named" in sentence_of(beside)
    sure = replace(beside, candidates=(*likely[:2], Candidate("slope", 0.96)))
    assert "A further cause acts: slope (96.0 %). Torque gain (97.9 %) is not named" in sentence_of(sure)


def test_beside_a_name_the_stress_peak_bars_another_with_both_probabilities() -> None:
    (slope,) = causes("slope")
    peak = Note(LackCode.PEAK_MAY_SHIFT, values={"family": "slip_sinkage", "probability": 0.177})
    grounds = Grounds(barred=peak, beside=("slip_sinkage", PEAK), kept_back=(BarredCause(CAUSE, peak),))
    likely = (Candidate("slip_sinkage", 0.9996), Candidate("slope", 0.99), Candidate(PEAK, 0.001))
    assert (
        "A further cause acts: slip sinkage or stress peak shift. Slip sinkage is not named: its probability is only "
        "17.7 % if the stress peak usually lies ahead of the wheel's bottom, as on most soils, and > 99.9 % if it "
        "seldom does."
    ) in sentence_of(replace(BARE, causes=(slope,), candidates=likely, grounds=grounds))


def test_a_sure_cause_that_another_rule_bars_is_said_with_the_rule() -> None:
    """Not "these data cannot separate them" beside a probability of 99.8 %."""
    worse = Note(LackCode.CHANNEL_WORSE, values={"channel": "t", "percent": 8.0, "low": 2.0, "high": 15.0})
    both = (replace(CAUSE, probability=0.998), *causes("slope"))
    found = replace(BARE, verdict="one_of", causes=both, grounds=Grounds(barred=worse))
    assert headline_of(found) == (
        "Most probably slip sinkage, but not named: it contradicts driving torque, whose held-out error grows by 8 % "
        "(2 to 15)."
    )
    long_one = Note(LackCode.NO_BETTER, values={"nats": 2.0, "least": 3.0})
    below = headline_of(replace(found, grounds=Grounds(barred=long_one)))
    assert below == "Most probably slip sinkage, but not named: the reason is below."


MIXED = Note(
    DiagnosisCode.SEVERAL_TERRAINS,
    Severity.FAULT,
    {
        "campaign": "clay",
        "share": 0.22,
        "runs": ("run-1", "run-2", "run-3", "run-4"),
        "groups": (("run-1", "run-2", "run-3"), ("run-4",)),
        "drawbar_coefficients": ((-0.02, 0.01), (0.09, 0.09)),
        "files": ("run-4.log",),
    },
)


@pytest.mark.parametrize("verdict", ["named", "one_of", "unexplained", "nothing_detectable"])
def test_that_runs_are_probably_not_of_one_soil_comes_first(verdict: str) -> None:
    found = diagnosis(verdict)  # type: ignore[arg-type]
    mixed = replace(found, grounds=Grounds(cautions=(MIXED,), prior_shifts=(PriorShift("slope", 3.0, verdict, ()),)))  # type: ignore[arg-type]
    assert headline_of(mixed) == "These runs are probably not of one soil: runs 1 to 3 differ from run-4."
    first, numbers, *others, last = sentences_of(mixed)
    assert first == headline_of(mixed) and "and 0.09 on run-4. Nothing is said of a cause" in numbers
    assert any(one.startswith("As if of one soil: ") for one in others)
    assert last.startswith("Next: move run-4 into a folder of its own, with its soil in")
    assert details_of(mixed) == [numbers] and "Whoever" not in sentence_of(mixed)
    [step] = next_steps(mixed, VehicleConfig())
    assert step.what.startswith("Move run-4 into") and "mv run-4.log ../second" in step.paste
    unknown = replace(MIXED, values={"campaign": "clay", "share": 0.22})
    bare = replace(found, grounds=Grounds(cautions=(unknown,)))
    assert headline_of(bare) == "These runs are probably not of one soil." and not deciding_runs(bare)


def test_runs_that_ask_for_two_soils_are_in_the_headline_of_unexplained() -> None:
    runs = (("run-2",), ("run-1",))
    found = replace(diagnosis("unexplained"), grounds=Grounds(terrains=runs))
    assert headline_of(found) == "No known cause explains these data: run-2 asks for another soil than run-1."
    assert next_steps(found, VehicleConfig())[0].what.startswith("If these are two soils, move run-1 into a folder")


def test_runs_are_listed_in_stretches() -> None:
    order = [f"run-{i}" for i in range(1, 11)]
    assert stretches(order[:3], order) == "runs 1 to 3"
    assert stretches([order[9], order[0], order[1]], order) == "runs 1, 2 and 10"
    assert stretches(["a"], ["a", "b"]) == "a"
    assert stretches(order[::2], order, most=3) == "5 runs"
    assert stretches(["b", "c", "d"], ["a", "b", "c", "d"]) == "b to d"


def test_how_well_two_are_separated_is_said_by_one_probability() -> None:
    chances = {"slope": 0.4, "bulldozing": 1e-5, "grouser": 0.0499}
    assert rival_words(("slope", "bulldozing", "grouser"), chances) == [
        "Slope (40.0 %) would fit almost as well",
        "Bulldozing (< 0.1 %) and grouser (5.0 %) have similar signatures, but are separable in these data",
    ]


def test_the_verdict_comes_before_the_soil() -> None:
    off = Grounds(refuted_soil=(RefutedSoil("clay", "tan_phi", 0.99, 10.0),))
    for verdict in ("named", "one_of", "nothing_detectable"):
        bare, moved = diagnosis(verdict), replace(diagnosis(verdict), grounds=off)  # type: ignore[arg-type]
        assert sentences_of(moved)[0] == sentences_of(replace(bare, grounds=Grounds()))[0]
        assert sentences_of(moved)[1].startswith("The laboratory's soil does not hold here: tan φ is 10.0 sigma above")
    refused = sentences_of(replace(diagnosis("unexplained"), grounds=off))
    assert not any("laboratory" in one for one in refused), "nothing explains the data, so nothing refutes a soil"


@pytest.mark.parametrize("families", [("slope",), ("slope", "bulldozing")])
def test_what_is_unlisted_is_the_reason_where_it_keeps_a_name_back(families: tuple[str, ...]) -> None:
    doubted = replace(BARE, causes=causes(*families), adequacy=Adequacy(0.16, 0.5, True, "probability"))
    said = words(one_of_words(doubted, CHANCES, 0.0))
    assert "sure enough for a name: an unknown cause may act (16.0 %)." in said
    surely = replace(doubted, adequacy=Adequacy(0.01, 0.5, True, "probability"))
    assert "library" not in words(one_of_words(surely, CHANCES, 0.0))


def test_under_one_of_a_family_that_acts_beside_the_set_is_said() -> None:
    chances = {"load_gain": 0.62, "wheel_radius": 0.41, "grouser": 0.44}
    sets = (CauseSet(("load_gain", "grouser"), 0.43), CauseSet(("wheel_radius",), 0.4), CauseSet((), 0.02))
    said = words(one_of_words(replace(BARE, causes=causes("load_gain", "wheel_radius"), sets=sets), chances, 0.02))
    assert "Several may act together: load gain and grouser (43.0 %)." in said


REASONS = {
    Note(LackCode.NOT_SETTLED): "the iterated linearisation of the model did not converge",
    Note(LackCode.NOTHING_JUDGED): "the model has no answer for these samples",
    Note(LackCode.MORE_THAN_NOISE, values={"channel": "dp", "error": 294.4, "expected": 61.0}): (
        "no cause is detected, but the held-out error of drawbar pull is 294 N, where soil and noise give 61 N"
    ),
    Note(LackCode.MORE_THAN_NOISE, values={"channel": "z", "error": 0.0123, "expected": 0.002}): (
        "no cause is detected, but the held-out error of sinkage is 12.3 mm, where soil and noise give 2 mm"
    ),
}


def test_sentences_say_where_it_shows_and_what_would_have_been_seen() -> None:
    worst = Finding("drawbar_pull", Shape(Kind.SLIP, "dp", (0.4, 0.9)), -120.0, -8.2)
    judged = Adequacy(0.9876, 0.5, ok=False, measure="probability")
    grounds = Grounds(most_probable=("slope",), terrains=(("r1",), ("r2", "r3")))
    left = words(unexplained_words(replace(BARE, what_is_wrong=(worst,), grounds=grounds), judged))
    assert "there are two soils, or an unknown cause acts, with a probability of 98.8 %" in left
    assert "With calibrated soil the simulation is off most in drawbar pull, slip 0.4 to 0.9 (8.2 sigma). " in left
    assert "Runs r1 ask for another soil than r2 and r3" in left
    for why, reason in REASONS.items():
        barred = replace(BARE, what_is_wrong=(worst,), grounds=Grounds(barred=why))
        said = [one.text for one in unexplained_words(barred, Adequacy(nan, nan, ok=False))]
        assert said[0].startswith(f"These runs are not explained: {reason}"), said
        assert said[-1].startswith("Next: check zeros")
    unsure = words(nothing_words(BARE, {"slope": 0.6, "grouser": 0.1}, 0.3))
    assert unsure.startswith(
        "No cause is distinguishable from chance (no cause: 30.0 %). The most probable one is slope"
    )
    idle = replace(BARE, verdict="nothing_detectable", causes=(), gain=Gain({}, {}, 10.3, (nan, nan), -1.9, ()))
    idle = replace(idle, candidates=(Candidate("wheel_radius", 0.778), Candidate("none", 0.124)))
    for doubted, why in ((idle, "held-out data do not confirm it"), (replace(idle, gain=None), "chance may explain")):
        assert headline_of(doubted).startswith("No cause is sure (no cause: 12.4 %): wheel radius (77.8 %) is most")
        assert why in headline_of(doubted) and sentence_of(doubted).startswith(headline_of(doubted))
        assert headline_of(doubted) not in " ".join(details_of(doubted))
        assert step_of(doubted).what.startswith("Drive another run") and "detected" not in headline_of(doubted)
        of_table = replace(doubted, grounds=Grounds(table_channels=("dp",)))
        assert sentence_of(of_table).startswith(headline_of(doubted))
        in_words = "no cause is sure: wheel radius (77.8 %) is most probable"
        assert verdict_words(doubted.verdict, chances_of(doubted)) == shown_of(doubted)["words"] == in_words
        assert headline_of(doubted).replace(" (no cause: 12.4 %)", "").lower().startswith(in_words)
    for chances in ({}, {"none": 0.5, "slope": 0.4}, {"none": nan, "slope": 0.4}):
        assert verdict_words("nothing_detectable", chances) == "nothing detectable"
    assert verdict_words("one_of", {"none": 0.1, "slope": 0.4}) == "one of several"
    sizes = {"vasilev": Detectable("H_m", 0.0034, "m")}
    seldom = replace(BARE, minimum_detectable=sizes, what_is_wrong=(worst,))
    nothing = words(nothing_words(seldom, {"slope": 0.05}, 0.93))
    assert "no cause: 93.0 %" in nothing
    assert "a slip sinkage of H = 0.0034 m or more would be detected in half of such campaigns" in nothing


def test_what_is_wanting_is_said_once_for_all_families_that_it_is_wanting_for() -> None:
    wanted = {"slope": ONE_WAY, "track_drift": ONE_WAY, "zero_drift": DRIFT}
    want = want_words(replace(BARE, not_identifiable=wanted))
    assert [one.text for one in want] == [
        "Slope and track drift are not identifiable from these runs: all runs go one way: drive some back.",
        "Zero drift is not identifiable from these runs: one run only: a drift over the campaign does not show.",
    ]
    assert want_words(BARE) == []
    usual = {"multi_pass": Note(LackCode.SAME_PASS), "tyre_flattening": Note(LackCode.PRESSURE_UNKNOWN)}
    assert want_words(replace(BARE, not_identifiable=usual)) == [], (
        "what is wanting nearly always stands in the table alone"
    )
    assert "Zero drift" in words(want_words(replace(BARE, not_identifiable={**usual, "zero_drift": DRIFT})))


def test_no_cause_is_separable_and_not_identifiable_at_once() -> None:
    rival = replace(BARE, not_identifiable={"slope": ONE_WAY}, grounds=Grounds(confounded=("slope",)))
    for p, words_of_it in ((0.01, "has a similar signature, but is separable"), (0.2, "would fit almost as well")):
        text = sentence_of(replace(rival, candidates=(Candidate("slope", p),)))
        assert words_of_it in text and ("not identifiable" in text) == (p == 0.2)


@pytest.mark.parametrize("verdict", ["named", "unexplained"])
def test_what_speaks_against_one_diagnosis_stands_behind_the_verdict(verdict: str) -> None:
    facts = {"parameter": "H_m", "unit": "m", "own": (("a", 0.01, 0.001), ("b", 0.03, 0.002)), "q": 9.0, "chance": 1e-4}
    grounds = Grounds(cautions=(Note(DiagnosisCode.DISAGREEMENT, Severity.FAULT, facts),))
    caution = "The campaigns disagree about H_m: a 0.01 ± 0.001 m, b 0.03 ± 0.002 m (Cochran's Q 9.0 on 1, p < 0.1 %)"
    sentences = sentences_of(replace(diagnosis(verdict), grounds=grounds))  # type: ignore[arg-type]
    assert any(one.startswith(caution) for one in sentences[1:])
    assert sentences[1].startswith(caution) == (verdict == "unexplained")


def test_of_what_decides_nothing_the_reason_is_said() -> None:
    few = Note(LackCode.FEW_ROWS, Severity.FAULT, {"rows": 3, "conditions": 1})
    assert sentence_of(undecided(few, {}, ())).startswith("Nothing can be decided: 3 rows at 1 slip and load")
    fault = Fault("there is no run", "clay", next_step="give recordings of driven runs")
    nothing = Note(LackCode.NOTHING_USABLE, Severity.FAULT, {"faults": (fault,)})
    assert sentence_of(undecided(nothing, {}, ())) == (
        "Nothing can be decided: there is no run. Next: give recordings of driven runs."
    )


@pytest.mark.parametrize("verdict", ["named", "one_of", "unexplained", "nothing_detectable"])
def test_of_a_table_its_channels_are_said(verdict: str) -> None:
    found = replace(diagnosis(verdict), grounds=Grounds(table_channels=("dp", "t", "z")))  # type: ignore[arg-type]
    said = sentence_of(found)
    assert "drawbar pull, driving torque and sinkage" in said


def test_a_probability_is_never_one_and_none_is_a_candidate() -> None:
    sure = replace(BARE, candidates=(Candidate("slip_sinkage", 1.0), Candidate("none", 0.0)))
    assert "none" not in sentence_of(sure)
    assert gain_words(None) == ""
