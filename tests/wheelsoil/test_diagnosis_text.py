"""A diagnosis in a terminal: everything is said, nothing runs off the side."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis_samples import SENTENCES, diagnosis
from hypothesis import given
from hypothesis import strategies as st
from short_campaign import driven

from daq import ConfigError, Note, RunsConfig, StaticTest, VehicleConfig, WheelSection, parse_toml
from model import DiagnosisCode, LackCode, StepCode
from model.diagnosis import (
    Adequacy,
    Candidate,
    Cause,
    CauseSet,
    Diagnosis,
    Finding,
    Grounds,
    Kind,
    LackOfFit,
    NextRun,
    OfVehicle,
    ParameterEstimate,
    Rows,
    Shape,
)
from model.diagnosis.core.result import BarredCause, PriorShift, RefutedSoil, SoilInstead, Verdict
from model.effects import EFFECTS
from model.wheel_soil import Wheel
from wheelsoil.view.jobs import shown_of
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.wording.diagnosis_text import covered, diagnosis_lines, gain_text, wrapped
from wheelsoil.wording.mending import first_steps, next_steps
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import typeset
from wheelsoil.wording.verdict import details_of, headline_of, sentence_of
from wheelsoil.wording.wheel_pair_text import wheel_pair_lines
from wheelsoil.workflows import parse_choice
from wheelsoil.workflows.diagnosis import _like_radius, _rolling_alike

VERDICTS = tuple(SENTENCES)


def text_of(found: Diagnosis, width: int = 96, *, verbose: bool = True) -> str:
    return "\n".join(diagnosis_lines(found, VehicleConfig(), width, verbose=verbose))


def test_the_next_runs_are_numbered_from_the_best_on() -> None:
    _, _, shown = text_of(diagnosis()).partition("Next run, best first\n")
    assert re.findall(r"(?m)^  (\d+)\. (.{12})", shown) == [("1", "a run with m"), ("2", "a run with b")]


@pytest.mark.parametrize("several", [False, True])
def test_a_soil_is_of_a_campaign_where_there_are_several(several: bool) -> None:
    found = diagnosis()
    clay = replace(found.soils[0], laboratory={"cohesion_pa": (3800.0, 200.0)})
    soils = (clay, replace(clay, campaign="sand")) if several else (clay,)
    lines = text_of(replace(found, soils=soils)).splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("Soil here less"))
    shown = "\n".join(lines[at + 1 : at + 3])
    assert ("clay: " in shown) == ("sand: " in shown) == several


def squeezed(text: str) -> str:
    return re.sub(r"\s+", " ", text)


@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.parametrize("width", [80, 100])
def test_the_verdict_and_the_next_step_stand_in_the_first_six_lines(verdict, width):
    found = diagnosis(verdict)
    check = ("Braking, drawbar pull: the median residual is -573 N",)
    whole, brief = (
        diagnosis_lines(found, VehicleConfig(), width, checks=check, verbose=verbose) for verbose in (True, False)
    )
    assert f"  {check[0]}" in whole and f"  {check[0]}" in brief
    assert max(map(len, [*whole, *brief])) <= width
    said, left = " ".join(brief[:6]), squeezed("\n".join(brief))
    assert said.startswith(headline_of(found)) and " Next: " in said
    assert all(detail in left for detail in details_of(found))
    assert set(brief) - set(whole) <= {*wrapped(gain_text(found), width), brief[-1]}
    assert len(brief) < len(whole) and "--verbose" in brief[-1]


@pytest.mark.parametrize(
    ("verdict", "family", "step"),
    [
        (
            "named",
            "torque_zero",
            "name its file in vehicle.toml.\n  # record the lifted wheel as spin.mcap, then:\n  wheelsoil zero",
        ),
        ("named", "slip_sinkage", "Next: save the recommended model"),
        ("unexplained", "", "Next: look at what is wrong"),
        ("nothing_detectable", "", "Next: no further run is asked for"),
    ],
)
def test_no_verdict_ends_without_a_next_step(verdict, family, step):
    found = replace(diagnosis(verdict), next_run=(), not_identifiable={})
    if family:
        kind = EFFECTS[family].kind if family in EFFECTS else "physical"
        found = replace(found, causes=(replace(found.causes[0], name=family, key=family, kind=kind, parameters=()),))
    assert step in text_of(found, 100)


def test_a_model_that_is_saved_is_not_to_be_saved():
    found = replace(diagnosis(), next_run=(), not_identifiable={})
    saved = "\n".join(diagnosis_lines(found, VehicleConfig(), 100, saved=True))
    assert "-o model.toml" in text_of(found) and "model.toml" not in saved and "ave the" not in saved
    assert "Next: no further run is needed for the name." in saved


def test_a_residual_in_one_channel_is_followed_to_its_sensor() -> None:
    bent = Finding("driving_torque", Shape(Kind.DRAWBAR_PULL_SQUARED, "t"), -469.0, -9.0)
    found = replace(diagnosis("unexplained"), grounds=Grounds(lack_of_fit=LackOfFit((bent,))), next_run=())
    first, *_ = next_steps(found, VehicleConfig())
    assert first.what.startswith("Check the drawbar pull against known pulls in both directions")
    assert first.why.startswith("Residual: drawbar pull, slip 0.4 to 0.9: -122 N (8.3 sigma).")
    soil = Finding("sinkage", Shape(Kind.SLIP, "z", (0.4, 0.9)), 0.01, 5.0)
    both = replace(found, grounds=Grounds(lack_of_fit=LackOfFit((bent, soil))))
    assert next_steps(both, VehicleConfig())[0].what.startswith("Look at what is wrong")


def test_a_standstill_is_declared_for_a_new_run_only_and_asked_of_no_table() -> None:
    """The line would declare the held brakes of these runs as released."""
    held = {"torque_zero": Note(LackCode.NOT_AT_STANDSTILL)}
    found = replace(diagnosis("nothing_detectable"), next_run=(), not_identifiable=held)
    [step] = next_steps(found, VehicleConfig())
    assert step.what.startswith("Drive another run") and "do not show torque zero" in step.why
    assert step.paste.startswith("# in the vehicle.toml of that run only\n")
    assert next_steps(replace(found, grounds=Grounds(table_channels=("dp",))), VehicleConfig()) == []


def test_a_step_that_separates_what_is_separable_is_not_shown() -> None:
    runs = (NextRun(Note(StepCode.LIKE_OTHERS), ("slip_sinkage", "bulldozing"), 9.0),)
    decided = Grounds(confounded=("bulldozing",))
    found = replace(diagnosis("named"), grounds=decided, next_run=runs, not_identifiable={})
    [step] = next_steps(found, VehicleConfig())
    assert step.why == "No further run is needed for the name."
    assert "like the others" not in text_of(found)
    likely = replace(found, candidates=(Candidate("bulldozing", 0.1),))
    assert next_steps(likely, VehicleConfig())[0].what == "One more run like the others"


def test_a_step_that_separates_sets_by_one_cause_decides_whether_it_acts() -> None:
    found = replace(diagnosis("one_of"), next_run=(NextRun(Note(StepCode.LIKE_OTHERS), ("slope",), 3.0),))
    assert next_steps(found, VehicleConfig())[0].why == "Decides whether slope acts; expected odds 20 : 1."


def with_lugs(verdict: Verdict, tyre: str) -> Diagnosis:
    """Return a verdict of lugs of 19 mm, of a wheel of 0.47 m with such a tyre, with what is noted of it."""
    size = ParameterEstimate("height_m", "m", 0.019, (0.0167, 0.0213), 1e-3)
    lugs = Cause("grouser", "", "physical", "grouser", 0.6, 1.0, (size,))
    found = replace(diagnosis(verdict), causes=(lugs,), next_run=(), not_identifiable={})
    given: Any = SimpleNamespace(wheel=Wheel(0.47, 0.318), tyre=tyre)
    return replace(found, grounds=Grounds(cautions=tuple(_like_radius(found, [given, given]))))


@pytest.mark.parametrize("verdict", ["named", "one_of"])
def test_lugs_are_said_with_the_wheel_radius_that_looks_the_same(verdict: Verdict) -> None:
    """A radius that is 19 mm too small was named as lugs of 19 mm, with no further run needed."""
    found, declared = with_lugs(verdict, ""), with_lugs(verdict, "lugged")
    assert "rouser (or a wheel radius larger by 19 mm)" in headline_of(found)
    assert "A wheel radius of 0.489 m in place of 0.47 m looks the same as grouser" in sentence_of(found)
    alike = {"family": "grouser", "radius_m": 0.47, "larger_m": 0.019, "wheel": ""}
    assert diagnosis_json(found)["like_radius"] == [alike]
    step, text = next_steps(found, VehicleConfig())[0], text_of(found)
    assert step.what.startswith("Measure the wheel's radius from hub to ground") and "further run" not in text
    for line in ("radius_m = 0.4890", 'tyre = "lugged"', 'tyre = "smooth"'):
        assert f"[wheel]  # add to the one in the file\n{line}" in step.paste
    assert "radius" not in headline_of(declared) and "like_radius" not in diagnosis_json(declared)


GAIN = ParameterEstimate("relative", "1", -0.0404, (-0.0455, -0.0352), 0.003)
ROLLS = ParameterEstimate("relative", "1", -0.0434, (-0.051, -0.0358), 0.004)


@pytest.mark.parametrize(
    ("family", "size", "rolling_m", "rolls", "smaller_mm"),
    [
        ("torque_gain", GAIN, 0.49, ROLLS, 20),
        ("torque_gain", GAIN, 0.469, None, 20),
        ("drawbar_pull_gain", replace(GAIN, value=0.05, interval95=(0.041, 0.059)), 0.469, None, 23),
        ("torque_gain", GAIN, 0.49, None, 0),  # it rolls on the declared radius: the gain is one
        ("torque_gain", replace(GAIN, value=0.04, interval95=(0.035, 0.045)), 0.469, None, 0),
        ("load_gain", GAIN, 0.469, None, 0),
    ],
)
def test_a_gain_is_said_with_the_radius_that_looks_the_same_where_the_wheel_rolls_on_it(
    family: str, size: ParameterEstimate, rolling_m: float, rolls: ParameterEstimate | None, smaller_mm: int
) -> None:
    """A radius of 0.49 m for 0.47 m was named as a torque gain of -4 %, to be calibrated away."""
    causes = [Cause(family, "", "measurement", family, 0.99, 1.0, (size,))]
    causes += [Cause("wheel_radius", "", "measurement", "wheel_radius", 0.99, 1.0, (rolls,))] if rolls else []
    found = replace(diagnosis("named"), causes=tuple(causes), next_run=(), not_identifiable={})
    campaign = replace(driven(), wheel=Wheel(0.49, 0.318), tyre="smooth")
    runs = tuple(replace(run, wheel_radius_m=0.49, rolling_radius_m=rolling_m) for run in campaign.runs)
    found = replace(found, grounds=Grounds(cautions=tuple(_rolling_alike(found, [replace(campaign, runs=runs)]))))
    said = f"(or a wheel radius smaller by {smaller_mm} mm)"
    assert (said in headline_of(found)) == bool(smaller_mm)
    steps = next_steps(found, VehicleConfig())
    assert not smaller_mm or steps[0].paste.endswith(f"radius_m = {0.49 - size_m(found):.4f}")
    assert not smaller_mm or "calibrat" not in "".join(step.what for step in steps)


def size_m(found: Diagnosis) -> float:
    return -float(found.grounds.cautions[0].values["larger_m"])


def test_a_static_test_that_the_runs_contradict_is_repeated_first() -> None:
    values = {"channel": "slip", "reading": 0.0, "sigma": 0.005, "runs": -0.036, "runs_sigma": 0.002, "sigmas": 6.0}
    note = Note(DiagnosisCode.STATIC_CONTRADICTS, values=values | {"radius_m": 0.47, "applied": 0.0, "zeroed": False})
    found = replace(diagnosis("one_of"), grounds=Grounds(cautions=(note,)))
    step = next_steps(found, VehicleConfig())[0]
    assert step.what.startswith("Repeat the static test, and take it out") and "6 sigma apart" in step.why
    assert "rolls on 0.470 ± 0.002 m, but by the runs it would roll on 0.487 ± 0.001 m (6 sigma apart)" in step.why
    agree = replace(note, values={**note.values, "agree": ("grouser", "torque_gain")})
    assert "(6 sigma apart; with grouser and torque gain they agree)" in note_text(agree)


@pytest.mark.parametrize("verdict", ["named", "one_of"])
def test_a_radius_that_coasting_showed_is_not_asked_for_again(verdict: Verdict) -> None:
    radius = Cause("wheel_radius", "", "measurement", "wheel_radius", 0.99, 1.0, (ROLLS,))
    found = replace(diagnosis(verdict), causes=(radius,), next_run=(), not_identifiable={})
    vehicle = VehicleConfig(wheel=WheelSection(radius_m=0.49, width_m=0.3))
    rolled = StaticTest(
        test="coasting", ground_speed_mps=3.0, ground_speed_sigma_mps=0.01, wheel_speed_radps=6.4, run="road"
    )
    before, after = (next_steps(replace(found, static=tests), vehicle)[0] for tests in ((), (rolled,)))
    assert "on firm ground" in before.what and "on firm ground" not in after.what and before.paste == after.paste


def test_what_else_the_verdict_would_be_is_said_in_plain_words() -> None:
    shifts = (PriorShift("slope", 3.0, "named", ("slope",)), PriorShift("torque_gain", 1 / 3, "one_of", ()))
    found = replace(diagnosis("named"), grounds=Grounds(prior_shifts=shifts))
    said = "The verdict depends on the prior: at three times the prior odds of slope it would be: slope named; "
    assert f"{said}the prior of torque gain changes it, too." in sentence_of(found)
    fewer = replace(found, grounds=Grounds(prior_shifts=(PriorShift("slope", 1 / 3, "nothing_detectable", ()),)))
    assert "at a third of the prior odds of slope it would be: nothing detectable." in sentence_of(fewer)
    unsure = Note(LackCode.NOT_SURE, values={"family": "slope", "probability": 0.961, "least": 0.97})
    assert note_text(unsure).startswith("by these runs as they are, not averaged over resampled ones")
    assert note_text(unsure).endswith("its probability is 96.1 %, below the 97 % that a name needs")


def test_lugs_of_a_probable_set_are_said_with_a_larger_radius_too() -> None:
    found = replace(diagnosis("named"), sets=(CauseSet(("grouser",), 0.06), CauseSet(("grouser", "slope"), 0.04)))
    given: Any = SimpleNamespace(wheel=Wheel(0.47, 0.318), tyre="")
    [note] = _like_radius(found, [given])
    assert note_text(note).startswith("a radius above 0.47 m looks the same as grouser")
    cautious = replace(found, grounds=Grounds(cautions=(note,)))
    assert "A radius above 0.47 m looks" in sentence_of(cautious) and "radius" not in headline_of(cautious)
    assert next_steps(cautious, VehicleConfig()) == next_steps(found, VehicleConfig()), "there is no size to measure"
    rare = replace(found, sets=(CauseSet(("grouser",), 0.04),))
    assert _like_radius(rare, [given]) == []


def test_each_wheel_has_its_own_radius_that_looks_like_lugs() -> None:
    size = ParameterEstimate("height_m", "m", 0.019, (0.0167, 0.0213), 1e-3)
    radii, vehicles = {"FL": 0.47, "FR": 0.47, "RL": 0.6}, dict[str, VehicleConfig]()
    given: Any = []
    for wheel, radius in radii.items():
        vehicles[wheel] = VehicleConfig(wheel=WheelSection(id=wheel, radius_m=radius, width_m=0.3))
        given.append(SimpleNamespace(wheel=Wheel(radius, 0.3), tyre="", of_vehicle=OfVehicle("c", wheel)))

    def steps(family: str) -> list[tuple[str, str]]:
        lugs = Cause(family, "", "physical", family, 0.99, 1.0, (size,))
        found = replace(diagnosis("named"), causes=(lugs,), next_run=(), not_identifiable={})
        found = replace(found, grounds=Grounds(cautions=tuple(_like_radius(found, given))))
        pastes = [step.paste.splitlines()[1:3] for step in next_steps(found, VehicleConfig(), vehicles)]
        return [(head.partition(":")[0], line) for head, line in pastes]

    assert steps("grouser@RL") == [("[[wheel]]  # of wheel RL", "radius_m = 0.6190")]
    assert steps("grouser@FR") == [("[[wheel]]  # of wheel FR", "radius_m = 0.4890")]
    assert steps("grouser") == [
        ("[[wheel]]  # of wheel RL", "radius_m = 0.6190"),
        ("[[wheel]]  # of wheel FL", "radius_m = 0.4890"),
    ]


@pytest.mark.parametrize(("verdict", "probability", "first"), [("one_of", 0.99, True), ("one_of", 0.4, False)])
def test_a_probable_radius_is_measured_before_a_zero(verdict: Verdict, probability: float, first: bool) -> None:
    """Of a smooth tyre of a wrong radius the first step was the zero of the lifted wheel."""
    size = ParameterEstimate("relative", "1", -0.006, (-0.04, 0.028), 0.017)
    radius = Cause("wheel_radius@FR", "", "measurement", "wheel_radius", probability, 1.0, (size,))
    zero = NextRun(Note(StepCode.LIFTED_ZERO), ("slope", "torque_zero"), 3.0)
    steps = next_steps(replace(diagnosis(verdict), causes=(radius,), next_run=(zero,)), VehicleConfig())
    assert steps[0].what.startswith("Measure the wheel's radius from hub to ground, and the rolling") == first
    assert not first or steps[0].why == "Probably wrong: wheel radius of wheel FR (99.0 %)."
    assert "wheelsoil zero" in steps[-1].paste and not (first and steps[0].paste)


def test_what_looks_like_a_larger_radius_is_a_length_of_its_effect() -> None:
    alike = [effect for effect in EFFECTS.values() if effect.like_radius]
    assert [p.unit for effect in alike for p in effect.parameters if p.name == effect.like_radius] == ["m"] * len(alike)


def test_a_lifted_zero_is_a_command_to_paste() -> None:
    found = replace(diagnosis("one_of"), next_run=(NextRun(Note(StepCode.LIFTED_ZERO), ("slope", "torque_zero"), 3.0),))
    step = next_steps(found, VehicleConfig())[0]
    assert "`" not in f"{step.what}{step.why}{text_of(found)}" and "\nwheelsoil zero" in step.paste


@pytest.mark.parametrize("code", [StepCode.RUT, StepCode.KNOWN_PULL, StepCode.KNOWN_TORQUE])
def test_a_table_of_runs_toml_is_pasted_with_its_keys_and_holds_no_number_that_was_not_read(code: StepCode) -> None:
    note = Note(code, values={"count": 6, "pull_n": 5200.0, "torque_nm": 900.0})
    found = replace(diagnosis("one_of"), next_run=(NextRun(note, ("slope", "torque_zero"), 3.0),))
    vehicle = VehicleConfig(wheel=WheelSection(id="FL", radius_m=0.5, width_m=0.3))
    for of in (VehicleConfig(), vehicle):
        step = next_steps(found, of)[0]
        assert "in runs.toml" in step.why
        with pytest.raises(ConfigError, match="not valid TOML"):
            parse_toml(step.paste, RunsConfig, "runs.toml")
        lines = re.sub("= [A-Z]+", "= 500.0", step.paste)
        runs = parse_toml(f'[[run]]\nfile = "a.mcap"\n{lines}', RunsConfig, "runs.toml")
        [read] = runs.static or runs.run[0].rut
        assert read.wheel == (of.wheel.id if of.wheel else "")


@pytest.mark.parametrize(("campaign", "run"), [("", "Lauf 3: Ton"), ("clay", "clay: Lauf 3: Ton")])
def test_a_run_that_lies_apart_is_switched_off_by_its_own_id(campaign: str, run: str) -> None:
    values = {"campaign": campaign, "run": run, "family": "torque_zero@FR", "channel": "t", "size": 90.0, "sigma": 10.0}
    apart = Grounds(cautions=(Note(DiagnosisCode.RUN_APART, values=values),))
    step = next_steps(replace(diagnosis("nothing_detectable"), grounds=apart), VehicleConfig())[0]
    assert step.what.startswith(f"Check the torque zero of wheel FR in {run}; ")
    [chosen] = parse_choice(tomllib.loads(step.paste)).runs
    assert (chosen.id, chosen.use) == ("Lauf 3: Ton", False)


def test_what_is_to_be_pasted_names_the_wheel_of_several() -> None:
    vehicle = VehicleConfig(wheel=WheelSection(id="FL", radius_m=0.5, width_m=0.3))
    zero = replace(diagnosis("one_of"), next_run=(NextRun(Note(StepCode.LIFTED_ZERO), ("slope", "torque_zero"), 3.0),))
    size = ParameterEstimate("relative", "", 0.02, (0.01, 0.03), 0.005)
    radius = Cause("wheel_radius", "", "measurement", "wheel_radius", 0.99, 0.99, (size,))
    named = replace(diagnosis("named"), causes=(radius,))
    of_wheel = "[[wheel]]  # of wheel FL: add to the one in the file"
    assert next_steps(zero, vehicle)[0].paste.splitlines() == [
        "# record the lifted wheel as spin.mcap, then:",
        "wheelsoil zero spin.mcap --vehicle vehicle.toml --wheel FL",
        "# then:",
        "[wheel.transducer]  # of wheel FL: add to the one in the file",
        'zero_file = "zero-FL.toml"',
    ]
    assert next_steps(named, vehicle)[0].paste == f"{of_wheel}\nrolling_radius_m = 0.5100"
    undeclared = next_steps(with_lugs("one_of", ""), vehicle)
    assert undeclared[0].paste.endswith(f'{of_wheel}\ntyre = "smooth"')
    rear = VehicleConfig(wheel=WheelSection(id="RL", radius_m=0.4, width_m=0.3, outboard_mass_kg=75.0))
    inertia = replace(radius, name="wheel_inertia@RL", key="wheel_inertia")
    two = replace(named, causes=(replace(radius, name="wheel_radius@FL"), inertia))
    first, second, *_ = next_steps(two, VehicleConfig(), {"FL": vehicle, "RL": rear})
    assert first.what.startswith("At wheel FL: measure") and first.paste.endswith(
        f"{of_wheel}\nrolling_radius_m = 0.5100"
    )
    assert second.what.startswith("At wheel RL: weigh") and "in the file\noutboard_mass_kg = 76" in second.paste


def test_a_gain_is_scaled_where_no_other_wheel_is_changed() -> None:
    size = ParameterEstimate("relative", "", 0.058, (0.05, 0.066), 0.004)
    cause = Cause("torque_gain@FR", "", "measurement", "torque_gain@FR", 0.99, 0.99, (size,))
    gain = replace(diagnosis("named"), causes=(cause,))
    buses = [{"channel": f"can{i}", "dbc": ["wft.dbc", *(["gnss.dbc"] if i == 1 else [])]} for i in range(3)]
    signals = {"driving_torque": "can1:WFT_Moments.My"}
    shared = VehicleConfig.model_validate({"bus": buses, "signals": signals})
    step = next_steps(gain, shared)[0]
    assert step.what.startswith("At wheel FR: calibrate the driving torque: these runs suggest 0.945 times")
    assert step.what.endswith("scale of WFT_Moments.My on can1, in a copy of wft.dbc for can1 alone.")
    assert step.why == "Scaled in wft.dbc itself, it changes can0 and can2 too."
    copied, _, *lines = step.paste.splitlines()
    assert copied == "cp wft.dbc wft-can1.dbc"
    [bus] = tomllib.loads("\n".join(lines))["bus"]
    assert bus == {"channel": "can1", "dbc": ["wft-can1.dbc", "gnss.dbc"]}
    alone = VehicleConfig.model_validate({"bus": buses[1:2], "signals": signals})
    assert next_steps(gain, alone)[0].what.endswith("0.945 times today's scale in the DBC.")
    series = VehicleConfig.model_validate({"signals": {"driving_torque": "T right"}})
    assert next_steps(gain, series)[0].what.endswith("today's values of the column T right.")
    of_table = replace(gain, grounds=Grounds(table_channels=("dp", "t")))
    step = next_steps(of_table, VehicleConfig())[0]
    assert "DBC" not in step.what and step.paste == "--rename driving_torque_nm=COLUMN*0.945"


def test_each_named_cause_has_its_step_in_the_terminal_and_on_the_page() -> None:
    named = [
        replace(diagnosis("named").causes[0], name=key, key=key, form="", kind="measurement", parameters=(size,))
        for key, parameter in (("torque_gain", "relative"), ("load_gain", "relative"), ("slope", "angle_rad"))
        for size in [ParameterEstimate(parameter, "", 0.058, (0.05, 0.066), 0.004)]
    ]
    found = replace(diagnosis("named"), causes=tuple(named), next_run=())
    steps = [text for text, _ in first_steps(found, VehicleConfig())]
    assert len(steps) == 3 and [text.split(": ")[0] for text in steps] == ["Next", "Also", "Also"]
    printed = squeezed("\n".join(diagnosis_lines(found, VehicleConfig(), 100)))
    assert all(text in printed for text in steps) and shown_of(found)["next"] == typeset(" ".join(steps))
    for verdict in VERDICTS:
        [(text, _)] = first_steps(diagnosis(verdict), VehicleConfig())
        assert shown_of(diagnosis(verdict))["next"] == typeset(text) and text in squeezed(text_of(diagnosis(verdict)))


def test_more_causes_that_look_the_same_are_said_beside_a_name_and_in_the_json() -> None:
    values = {"families": ("torque_gain",), "instead": (("load_gain", "drawbar_pull_gain"),), "nats": (1.9,)}
    found = replace(diagnosis("named"), grounds=Grounds(cautions=(Note(DiagnosisCode.MORE_ALIKE, values=values),)))
    said = "Load gain with drawbar pull gain is confounded with torque gain: fewer causes at once are more probable."
    assert said in squeezed(text_of(found)) and said in sentence_of(found)
    assert diagnosis_json(found)["more_alike"] == [values] and "more_alike" not in diagnosis_json(diagnosis("named"))
    many = note_text(Note(DiagnosisCode.MORE_ALIKE, values={**values, "instead": (("slope", "load_gain"),) * 6}))
    assert many.startswith("slope with load gain, ") and " or 3 more sets is confounded with" in many


def test_in_how_many_campaigns_an_interval_is_right_is_said_of_few_runs_only() -> None:
    found = diagnosis("named")
    assert found.gain is not None and covered(found)
    assert not covered(replace(found, gain=replace(found.gain, chosen=(("vasilev",),) * 98)))
    assert not covered(replace(found, grounds=Grounds(table_channels=("dp", "z"))))
    by_table = replace(found, grounds=Grounds(table_channels=("dp", "z")))
    assert "of a study" in gain_text(found) and "of a study" not in gain_text(by_table)


def test_of_a_bench_table_the_mean_of_the_rows_is_said():
    rows = (Finding("sinkage", Rows(0.35, 512.0, 3), -0.004, -9.1),)
    text = squeezed(text_of(replace(diagnosis("named"), what_is_wrong=rows)))
    assert "channel mean sigmas where sinkage -0.004 m -9.1 slip 0.35, load 512 N, driving (3 rows)" in text
    assert "mean: of measured - predicted over these rows" in text
    assert "shape:" not in text and "median" not in text


def test_the_gain_is_of_its_own_channel():
    found = diagnosis("named")
    assert found.gain is not None
    text = squeezed(text_of(replace(found, gain=replace(found.gain, channel="t"))))
    assert "R0 of the driving torque falls by 45 %" in text


def test_everything_is_said():
    text = squeezed(text_of(diagnosis("named")))
    for words in (
        "slip sinkage H_m 97.0 % 0.0510 0.0400 .. 0.0600 m",
        "as vasilev, within the family 62.0 %",
        "slip sinkage 97.0 %, bulldozing 3.0 %, none 2.0 %, 1 more below 1 %",
        "-122 N -8.3 slip 0.4 to 0.9",
        "its sign can be opposite",
        "driving torque: 14 rows",
        "R0 of the drawbar pull falls by 45 % (95 %: 35 to 52 %)",
        "1 of 2 folds chose a cause",
        "The best explanation is adequate: an unknown cause acts with a probability of 2.0 %.",
        "Samples used: 1210 of 1214. The linearisation converged after 5 iterations.",
        "Not detectable (1) slope: all runs go one way",
        "Detectable, not identifiable (1) speed bias: all runs go one way",
        "speed bias * offset_mps 0.02 m/s",
        "* detectable, not identifiable: see above",
        "slip sinkage 90.0 %, slip sinkage + bulldozing 6.0 %, all other sets 4.0 %",
        "slip sinkage (vasilev) H_m 0.012 m",
        "not detectable in these data: slope",
        "1. a run with more load: about 12.9 kN on the wheel, 500 kg more there than so far: expected odds "
        "545 : 1, costs 1 run, separates slip sinkage, bulldozing",
        "the usual laboratory's is taken",
    ):
        assert words in text, words


def test_under_one_of_the_causes_are_a_set():
    text = text_of(diagnosis("one_of"))
    assert "Possible causes, each with its size if it acts" in text
    assert re.search(r"bulldozing +fraction +40\.0 % +0\.20 +–\n", text)


def test_the_log_likelihood_of_a_run_is_told_once():
    found = diagnosis("named")
    assert text_of(found).count("-3200") == text_of(found).count("-3100") == 1
    assert diagnosis_json(found)["gain"]["held_out"]["base"]["log_likelihood_of_a_run"] == -3200.0


def test_a_set_of_one_is_no_choice():
    found = diagnosis("one_of")
    text = text_of(replace(found, causes=found.causes[:1]))
    assert "One of, each" not in text
    assert "Most probable, not named" in text


def test_an_error_that_grows_is_said_to_grow():
    found = diagnosis("named")
    worse = replace(found.gain, reduction_percent=-38.0, interval95=(-75.0, -4.6))
    text = squeezed(text_of(replace(found, gain=worse)))
    assert "R0 of the drawbar pull grows by 38 % (95 %: 4.6 to 75 %)" in text
    assert "-38" not in text


def test_the_sum_of_lyaskos_parameters_says_what_it_is():
    found = diagnosis("named")
    total = ParameterEstimate("p", "1", 0.6, (0.5, 0.7), 0.05)
    lyasko = replace(found.causes[0], key="lyasko", form="lyasko", parameters=(total,))
    assert "p = m1 + m2 97.0 % 0.600" in squeezed(text_of(replace(found, causes=(lyasko,))))


def test_an_empty_score_and_no_convergence_are_said():
    grounds = Grounds(barred=Note(LackCode.NOTHING_JUDGED))
    found = replace(diagnosis("unexplained"), adequacy=Adequacy(np.nan, np.nan, ok=False), grounds=grounds)
    text = squeezed(text_of(found))
    assert "not adequate: whether anything explains them is not known." in text and "nan" not in text
    assert "The linearisation did not converge in 5 iterations." in text


@pytest.mark.parametrize("verdict", ["one_of", "unexplained", "nothing_detectable"])
@pytest.mark.parametrize(("runs", "more"), [(1, "2 runs"), (2, "one run")])
def test_fewer_than_three_runs_are_made_three_before_anything_else(verdict, runs, more):
    found = diagnosis(verdict)
    few = replace(found, notes=(Note(DiagnosisCode.FEW_RUNS, values={"runs": runs}),))
    first, *others = next_steps(few, VehicleConfig())
    assert first.what == f"Drive {more} more like the others, so that there are three."
    assert others == next_steps(found, VehicleConfig()) and "Next: drive " + more in squeezed(text_of(few))


def test_what_is_not_there_is_not_spoken_of():
    bare = replace(
        diagnosis("nothing_detectable"),
        gain=None,
        adequacy=None,
        linearisation=None,
        what_is_wrong=(),
        inconsistent=(),
        next_run=(),
        not_identifiable={},
        notes=(),
        minimum_detectable={},
        candidates=(),
        sets=(),
    )
    text = f"{headline_of(bare)} Next: no further run is asked for; see the minimum detectable effect. "
    assert squeezed(text_of(bare)) == text + " ".join(details_of(bare))


@given(st.floats(0, 1) | st.just(np.nan))
def test_no_probability_is_written_as_certain(probability):
    text = text_of(replace(diagnosis(), candidates=(Candidate("slip_sinkage", probability),)))
    assert not re.search(r"slip sinkage (1\.000|0\.000|nan)", text)


@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=300), st.integers(20, 200))
def test_any_sentence_fits(sentence, width):
    found = replace(diagnosis(), causes=(replace(diagnosis().causes[0], name=sentence),))
    lines = text_of(found, width).splitlines()
    assert max(map(len, lines)) <= max(80, min(width, 100))


def test_a_program_reads_what_acts_beside_the_named_cause_and_what_bars_its_name() -> None:
    named = replace(diagnosis("named"), grounds=Grounds(beside=("slope", "bulldozing")))
    slope, pushing = diagnosis_json(named)["further_causes"]
    assert (slope["name"], slope["probability"], slope["barred"]["code"]) == ("slope", 1e-5, "one_direction")
    assert pushing == {"name": "bulldozing", "probability": 0.03, "barred": None}
    formed = Note(LackCode.FORM_NOT_LISTED, values={"family": "slip_sinkage"})
    kept = BarredCause(Cause("bulldozing", "", "physical", "bulldozing", 0.96, 1.0, ()), formed)
    said = diagnosis_json(replace(named, grounds=replace(named.grounds, kept_back=(kept,))))
    assert said["further_causes"][1]["barred"] == said["causes"][1]["barred"]
    assert said["further_causes"][1]["barred"]["code"] == "form_not_listed"


def test_a_cause_whose_name_a_rule_bars_stands_among_the_causes_with_the_rule() -> None:
    """A program that reads `causes` misses nothing; beside a named cause it has no values."""
    named, doubtful = diagnosis("named"), diagnosis("one_of")
    one_way = Note(LackCode.ONE_DIRECTION)
    slope = Cause("slope", "", "measurement", "slope", 0.96, 1.0, ())
    said = replace(named, grounds=Grounds(kept_back=(BarredCause(slope, one_way),)))
    sinkage, kept = diagnosis_json(said)["causes"]
    assert "barred" not in sinkage
    assert (kept["name"], kept["probability"], kept["parameters"]) == ("slope", 0.96, [])
    assert kept["barred"]["code"] == "one_direction" and "drive some back" in kept["barred"]["text"]
    assert said.to_frames()["causes"][["name", "barred"]].to_numpy().tolist() == [
        ["slip_sinkage", ""],
        ["slope", "one_direction"],
    ]
    peak = Note(LackCode.PEAK_MAY_SHIFT, values={"family": "slip_sinkage", "probability": 0.3})
    first = BarredCause(doubtful.causes[0], peak)
    member, other = diagnosis_json(replace(doubtful, grounds=Grounds(barred=peak, kept_back=(first,))))["causes"]
    assert member["barred"]["code"] == "peak_may_shift" and member["parameters"] and "barred" not in other


def test_the_laboratory_is_named_where_it_does_not_hold_and_where_it_may_stand_for_a_cause() -> None:
    off = RefutedSoil("clay", "tan_phi", 0.97, -5.2)
    instead = SoilInstead("slip_sinkage", RefutedSoil("clay", "frictional_modulus", 0.3, 4.8))
    found = replace(diagnosis("named"), grounds=Grounds(refuted_soil=(off,), soil_instead=(instead,)))
    text = sentence_of(found)
    assert "The laboratory's soil does not hold here: tan φ is 5.2 sigma below (97.0 %) its value." in text
    assert (
        "whose k_φ is 4.8 sigma too low would explain these runs in place of slip sinkage, with a probability of 30.0 %"
        in text
    )
    assert diagnosis_json(found)["laboratory"] == {
        "refuted": [vars(off)],
        "in_place_of": [{"family": "slip_sinkage", **vars(instead.soil)}],
    }
    assert "does not hold" not in sentence_of(replace(found, verdict="unexplained")), (
        "the next sentence refutes the fit"
    )
    assert "laboratory" not in diagnosis_json(diagnosis("named"))


@pytest.mark.parametrize(("families", "listed"), [({"slip_sinkage": 0.7}, "slip sinkage 70.0 %"), ({}, "none")])
def test_two_wheels_are_compared_with_the_causes_of_the_second(families: dict[str, float], listed: str) -> None:
    both = SimpleNamespace(any_adequate=True, probabilities=np.zeros(0), sets=())
    size, sigma = {"dp": np.array([-120.0, np.nan])}, {"dp": np.array([30.0, 30.0])}
    found = SimpleNamespace(
        p_value=0.001, own_cause=0.5, families=lambda: families, form_errors=(), both=both, slip=np.array([0.1, 0.2])
    )
    found.difference, found.difference_sigma = size, sigma
    lines = wheel_pair_lines(found, "old", "new", 96)  # type: ignore[arg-type]
    assert lines[0].startswith("What old taught does not hold for new (p = 0.001)") and "-1.2e+02 N" in lines[0]
    assert lines[lines.index("Causes of new alone (probability of being among them)") + 1].strip() == listed
    assert [line.split() for line in lines if line.startswith("  0.")] == [
        ["0.10", "-120", "±", "30"],
        ["0.20", "-"],
    ]
