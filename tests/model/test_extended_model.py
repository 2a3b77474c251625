"""The extended model as a file: what goes in comes out, and what cannot be is said in words."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from short_campaign import driven, looked

from daq import ConfigError
from model import AveragedModel, ExtendedEffect, ExtendedModel, extended_model
from model.diagnosis import Cause, ParameterEstimate, SoilEstimate
from model.diagnosis.findings.set_problem import set_problem
from model.effects import EFFECTS
from model.effects.speed_errors import DELAY
from model.extended import ModelSet
from model.fit import FitOptions, fit_models
from model.wheel_soil import SOIL_PARAMETERS, SOILS, Conditions, Wheel, WheelSoilModel, conditions_of
from model.wheel_soil.run_conditions import SpeedHistory

WHEEL = Wheel(0.47, 0.318)
NAN = float("nan")


def estimate(key: str, name: str, share: float, known: bool) -> ParameterEstimate:
    parameter = next(p for p in EFFECTS[key].parameters if p.name == name)
    value = parameter.lower + share * (parameter.upper - parameter.lower)
    interval = (value - 0.1, value + 0.2) if known else (NAN, NAN)
    return ParameterEstimate(name, parameter.unit, value, interval, 0.05 if known else NAN)


@st.composite
def extended_models(draw: st.DrawFn) -> ExtendedModel:
    keys = draw(st.lists(st.sampled_from(sorted(EFFECTS)), unique=True, max_size=3))
    effects = tuple(
        ExtendedEffect(
            key,
            tuple(estimate(key, p.name, draw(st.floats(0, 1)), draw(st.booleans())) for p in EFFECTS[key].parameters),
        )
        for key in keys
    )
    facts = st.one_of(st.text(max_size=8), st.floats(-9, 9), st.lists(st.text(max_size=4), max_size=3).map(tuple))
    return ExtendedModel(
        Wheel(draw(st.floats(0.05, 1)), draw(st.floats(0.02, 1))),
        SOILS[draw(st.sampled_from(sorted(SOILS)))],
        effects,
        draw(st.sampled_from(("balanced", "literal"))),
        draw(st.sampled_from(("", "smooth", "lugged"))),
        draw(st.dictionaries(st.sampled_from(SOIL_PARAMETERS), st.floats(0, 1e6))),
        draw(st.dictionaries(st.text("abc", min_size=1, max_size=4), facts, max_size=3)),
    )


@st.composite
def averages(draw: st.DrawFn) -> ExtendedModel:
    """Several sets of causes, each with its soil and covariance; no two alike."""
    count = draw(st.integers(1, 4))
    keys = draw(st.lists(st.sampled_from(sorted(EFFECTS)), unique=True, min_size=count, max_size=count))
    weights = np.array(draw(st.lists(st.floats(0.01, 1), min_size=count + 1, max_size=count + 1)))
    shares = weights / weights.sum()
    sets = []
    for i, key in enumerate(keys):
        chosen = () if i == 0 and draw(st.booleans()) else (key,)
        effects = tuple(
            ExtendedEffect(k, tuple(estimate(k, p.name, draw(st.floats(0, 1)), True) for p in EFFECTS[k].parameters))
            for k in chosen
        )
        names = (*SOIL_PARAMETERS, *(n for k in chosen for n in EFFECTS[k].parameter_keys().values()))
        root = np.random.default_rng(draw(st.integers(0, 99))).standard_normal((len(names), len(names)))
        covariance = tuple(map(tuple, (root @ root.T).tolist()))
        soil = SOILS[draw(st.sampled_from(sorted(SOILS)))]
        values = {name: float(getattr(soil, name)) for name in SOIL_PARAMETERS}
        sets.append(ModelSet(float(shares[i]), values, effects, names, covariance))
    plain = draw(extended_models())
    rest = 1.0 - sum(one.probability for one in sets)
    return replace(plain, effects=(), soil_sigmas={}, sets=tuple(sets), rest_probability=rest)


@examples(60)
@given(st.one_of(extended_models(), averages()), st.sampled_from(("toml", "json")))
def test_what_is_written_is_read_again(extended: ExtendedModel, form: str) -> None:
    written = extended.to_mapping()
    text = tomli_w.dumps(written) if form == "toml" else json.dumps(written, allow_nan=False)
    read = ExtendedModel.from_mapping(tomllib.loads(text) if form == "toml" else json.loads(text))
    assert read.soil.tan_phi == pytest.approx(extended.soil.tan_phi, rel=1e-15)
    again = read.to_mapping()
    again["soil"]["tan_phi"] = written["soil"]["tan_phi"]
    assert again == written
    assert read.values == extended.values
    assert read.sets == extended.sets
    assert read.keys == extended.keys


def vasilev_and_clay() -> ExtendedModel:
    cause = Cause(
        "slip_sinkage",
        "vasilev",
        "physical",
        "vasilev",
        0.97,
        0.8,
        (ParameterEstimate("H_m", "m", 0.02, (0.015, 0.026), 0.003),),
    )
    soil = SoilEstimate("clay", {"tan_phi": 0.26, "cohesion_pa": 8000.0}, {"tan_phi": 0.01, "cohesion_pa": NAN})
    return extended_model(WHEEL, SOILS["clay"], soil, (cause,), provenance={"runs": ("a", "b")})


def test_it_predicts_as_the_model_of_the_same_soil_and_effect_does() -> None:
    conditions = Conditions(np.linspace(-0.3, 0.9, 13), np.full(13, 9000.0))
    soil = replace(SOILS["clay"], cohesion_pa=8000.0, friction_angle_rad=np.arctan(0.26))
    direct = WheelSoilModel(WHEEL, soil, [EFFECTS["vasilev"]]).predict(conditions, {"H_m": 0.02})
    extended = ExtendedModel.from_mapping(vasilev_and_clay().to_mapping())
    np.testing.assert_allclose(extended.predict(conditions).drawbar_pull_n, direct.drawbar_pull_n, rtol=1e-12)
    assert extended.soil_sigmas == {"tan_phi": 0.01}
    assert extended.provenance == {"runs": ("a", "b")}


def test_a_parameter_that_a_cause_does_not_state_is_neutral() -> None:
    """Lyasko's sum alone is stated where m1 and m2 are not separable."""
    cause = Cause(
        "slip_sinkage", "lyasko", "physical", "lyasko", 1.0, 1.0, (ParameterEstimate("m1", "1", 0.2, (0.1, 0.3), 0.05),)
    )
    extended = extended_model(WHEEL, SOILS["clay"], SoilEstimate("clay", {}, {}), (cause,))
    assert extended.values == {"m1": 0.2, "m2": 0.0}


def test_the_physical_part_leaves_out_what_belongs_to_the_sensors() -> None:
    """A torque offset of those runs says nothing of the next vehicle on that soil."""
    offset = (ParameterEstimate("offset_nm", "N m", 30.0, (25.0, 35.0), 2.5),)
    digging = vasilev_and_clay()
    extended = replace(digging, effects=(*digging.effects, ExtendedEffect("torque_zero", offset)))
    conditions = Conditions(np.linspace(0.1, 0.9, 9), np.full(9, 9000.0))
    everything, soil_only = extended.predict(conditions), extended.predict(conditions, "physical")
    np.testing.assert_allclose(everything.driving_torque_nm - soil_only.driving_torque_nm, 30.0, rtol=1e-9)
    np.testing.assert_allclose(soil_only.driving_torque_nm, digging.predict(conditions).driving_torque_nm)


def late(delay_s: float, soil: str = "clay") -> ExtendedModel:
    """Return the model of a late ground speed."""
    return ExtendedModel(
        WHEEL,
        SOILS[soil],
        (ExtendedEffect("speed_latency", (ParameterEstimate("extra_delay_s", "s", delay_s, (NAN, NAN), NAN),)),),
    )


@examples(20, gate=4, deadline=None)
@given(st.sampled_from(("clay", "sandy")), st.floats(-0.3, 0.3))
def test_a_late_speed_is_shifted_as_the_diagnosis_does(soil: str, delay_s: float) -> None:
    """Its forces are those of the diagnosis to a tenth of the noise; a series is off by 6 to 10 times it at 0.3 s."""
    campaign = driven(soil=soil)
    seen = looked(campaign, "speed_latency")
    [part] = set_problem(seen.campaigns, seen.grams, ("speed_latency",)).parts
    samples, at = part.data.samples, np.zeros(len(part.simulation.space))
    diagnosed = part.at_measured_slip(replace(part.data.linear.point, soil=at, causes={DELAY: delay_s}))
    model, step = late(delay_s, soil), round(samples.block_s * campaign.runs[0].rate_hz)
    conditions = conditions_of(campaign.runs, campaign.soil.unit_weight_n_m3)
    predicted = np.full(diagnosed.shape, np.nan)
    for i, (run, of_run) in enumerate(zip(campaign.runs, conditions, strict=True)):
        own = samples.run == i
        first = np.searchsorted(run.time_s, samples.time_s[own] - 0.5 * samples.block_s)
        found, rows = model.predict(of_run), first[:, None] + np.arange(step)
        lacking = of_run.at_delay(delay_s).miscompensated_n[rows].mean(axis=1)
        predicted[0, own] = found.drawbar_pull_n[rows].mean(axis=1) - lacking
        predicted[1, own] = found.driving_torque_nm[rows].mean(axis=1)
    both = np.isfinite(predicted) & np.isfinite(diagnosed)
    assert both.mean() > 0.9
    error = np.where(both, predicted - diagnosed, 0.0) / np.sqrt(part.noise_variance)
    assert (np.sqrt((error**2).mean(axis=1)) < 0.1).all()


def test_the_derivative_by_a_delay_is_that_of_the_forces() -> None:
    """A fit ended without progress where the slopes were those of another filter."""
    campaign = driven(soil="sandy")
    conditions = conditions_of(campaign.runs, 16_500.0)[1]
    key, step, model = DELAY, 1e-5, late(0.2, "sandy").model()
    by_delay = model.predict(conditions, {key: 0.2}, wrt=[key]).sensitivities[key]
    after, before = (model.predict(conditions, {key: 0.2 + side * step}) for side in (1.0, -1.0))
    for name in ("drawbar_pull_n", "driving_torque_nm"):
        slope, change = getattr(by_delay, name), getattr(after, name) - getattr(before, name)
        np.testing.assert_allclose(slope, change / (2 * step), atol=1e-4 * np.nanmax(np.abs(slope)))


def test_a_late_speed_makes_the_compensation_late() -> None:
    """What is added for the outboard mass is by the acceleration that is measured, not by that of the moment."""
    conditions = conditions_of(driven().runs, 16_500.0)[0]
    heavy, light = (replace(conditions, compensated_mass_kg=np.full(len(conditions.slip), m)) for m in (80.0, 0.0))
    pull, true = (late(0.25).predict(one).drawbar_pull_n for one in (heavy, light))
    rate = np.asarray(conditions.ground_acceleration_mps2)
    shifted = np.interp(np.arange(len(rate)) + 25.0, np.arange(len(rate)), rate)
    known = np.isfinite(pull) & np.isfinite(shifted)
    assert known.sum() > 500 and np.abs(shifted - rate)[known].max() > 0.2
    np.testing.assert_allclose((pull - true)[known], 80.0 * (rate - shifted)[known], atol=1e-6)


def test_beyond_its_ends_and_in_holes_the_speed_is_joined() -> None:
    speed = np.array([1.0, 2.0, np.nan, 4.0, 5.0, 5.0])
    history = SpeedHistory((speed, np.zeros(6), np.full(6, np.nan)), 10.0)
    np.testing.assert_allclose(history.at(np.array([-3, 2, 9]))[0], [1.0, 3.0, 5.0])
    change, rate = history.changes(np.array([0, 1, 4, 5]), 0.1)
    np.testing.assert_allclose(change, [[1.0, 1.0, 0.0, 0.0], [0.0] * 4, [0.0] * 4], atol=1e-12)
    assert rate[0, 0] > 5.0 and rate[0, 3] == 0.0
    assert not SpeedHistory((speed[:1],) * 3, 10.0).changes(np.array([0]), -0.2).any()


def test_a_fit_holds_the_delay_of_the_file_and_follows_the_pull_with_it() -> None:
    """By a series the pull was followed no better than by Wong's model."""
    campaign = driven("speed_latency:extra_delay_s=0.25", "sandy")
    options = FitOptions(models=("wong",), extended=late(0.24, "sandy"))
    wong, extended = fit_models(campaign.runs, campaign.wheel, campaign.soil, options).models
    assert extended.values == {DELAY: 0.24} and not extended.estimates
    assert extended.criteria["dp"].R0_N < 0.9 * wong.criteria["dp"].R0_N


def test_every_fault_of_a_file_is_listed_at_once() -> None:
    raw = vasilev_and_clay().to_mapping()
    raw["soil_sigmas"]["cohesion"] = 1.0
    raw["effect"].append({"name": "slip_sinkage", "form": "dung"})
    raw["effect"].append({"name": "slip_sinkage", "form": "vasilev", "parameter": [{"name": "H", "value": 0.02}]})
    raw["effect"][0]["parameter"][0]["value"] = -3.0
    with pytest.raises(ConfigError) as raised:
        ExtendedModel.from_mapping(raw, "m.toml")
    said = str(raised.value)
    for words in ("'slip_sinkage/dung'", "no parameter 'H'", "H_m is out of bounds", "'vasilev' is there twice"):
        assert words in said
    assert "no parameter 'cohesion'" in said and "m.toml" in said


@pytest.mark.parametrize("broken", [{"schema": "wheelsoil/other/1"}, {"wheel": {"radius_m": -1.0, "width_m": 0.2}}])
def test_a_foreign_file_is_refused(broken: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        ExtendedModel.from_mapping(vasilev_and_clay().to_mapping() | broken)


def test_a_file_of_a_later_version_is_refused_by_name() -> None:
    raw = vasilev_and_clay().to_mapping() | {"schema": "wheelsoil/model/4", "something_new": 1}
    with pytest.raises(ConfigError) as raised:
        ExtendedModel.from_mapping(raw, "m.toml")
    said = str(raised.value)
    assert "later version" in said and "wheelsoil/model/4" in said and "m.toml" in said
    assert "something_new" not in said, "what it holds is not known yet"


def test_a_file_of_one_wheel_with_the_schema_of_several_is_refused_in_words_of_the_file() -> None:
    raw = vasilev_and_clay().to_mapping() | {"schema": "wheelsoil/model/3"}
    with pytest.raises(ConfigError, match=r"\[wheel\] is one table(.|\n)*\[\[wheel\]\](.|\n)*schema") as raised:
        ExtendedModel.from_mapping(raw, "m.toml")
    assert "tuple" not in str(raised.value)


def member(probability: float, key: str = "", cohesion_pa: float = 7_500.0, **values: float) -> ModelSet:
    """A set on clay whose cohesion and whose effect's parameters have a one-sigma of a tenth."""
    soil = {name: float(getattr(SOILS["clay"], name)) for name in SOIL_PARAMETERS} | {"cohesion_pa": cohesion_pa}
    effects = ()
    if key:
        parameters = (ParameterEstimate(n, "", v, (NAN, NAN), NAN) for n, v in values.items())
        effects = (ExtendedEffect(key, tuple(parameters)),)
    known = {"cohesion_pa": cohesion_pa, **(effects[0].values if effects else {})}
    covariance = np.diag([(0.1 * x) ** 2 for x in known.values()])
    return ModelSet(probability, soil, effects, tuple(known), tuple(map(tuple, covariance.tolist())))


DOUBT = ExtendedModel(
    WHEEL,
    SOILS["clay"],
    sets=(
        member(0.5, "vasilev", H_m=0.02),
        member(0.3, "drawbar_pull_zero", 6_000.0, offset_n=80.0),
        member(0.1),
    ),
    rest_probability=0.1,
)
CONDITIONS = Conditions(np.linspace(-0.3, 0.9, 13), np.full(13, 9000.0))
FIELDS = ("drawbar_pull_n", "driving_torque_nm", "sinkage_m", "vertical_load_n")


def alone(one: ModelSet) -> ExtendedModel:
    return replace(DOUBT, sets=(replace(one, probability=1.0),), rest_probability=0.0)


@pytest.mark.parametrize("kind", ["all", "physical"])
def test_predictions_are_the_mean_by_probability(kind: Literal["all", "physical"]) -> None:
    """The rest is in no prediction: the weights are 5/9, 3/9 and 1/9."""
    mean, each = DOUBT.predict(CONDITIONS, kind), [alone(one).predict(CONDITIONS, kind) for one in DOUBT.sets]
    for name in FIELDS:
        expected = sum(w * getattr(said, name) for w, said in zip((5 / 9, 3 / 9, 1 / 9), each, strict=True))
        np.testing.assert_allclose(getattr(mean, name), expected, rtol=1e-12)
    slopes = DOUBT.model(kind).predict(CONDITIONS, wrt=("slip",)).sensitivities["slip"]
    own = [alone(one).model(kind).predict(CONDITIONS, wrt=("slip",)).sensitivities["slip"] for one in DOUBT.sets]
    expected = sum(w * x.drawbar_pull_n for w, x in zip((5 / 9, 3 / 9, 1 / 9), own, strict=True))
    np.testing.assert_allclose(slopes.drawbar_pull_n, expected, rtol=1e-10)


def test_the_band_is_within_and_between_the_sets() -> None:
    model = DOUBT.model()
    assert isinstance(model, AveragedModel)
    sigma = model.sigmas(CONDITIONS)["dp"]
    mean = DOUBT.predict(CONDITIONS).drawbar_pull_n
    expected = np.zeros(13)
    for weight, one in zip((5 / 9, 3 / 9, 1 / 9), DOUBT.sets, strict=True):
        [only] = alone(one).model().members  # type: ignore[attr-defined]
        said = only.model.predict(CONDITIONS, only.values, wrt=only.names)
        slopes = np.stack([said.sensitivities[name].drawbar_pull_n for name in only.names])
        within = sum((s * one.sigmas[name]) ** 2 for s, name in zip(slopes, only.names, strict=True))
        expected += weight * (within + (said.drawbar_pull_n - mean) ** 2)
    np.testing.assert_allclose(sigma, np.sqrt(expected), rtol=1e-9)


def test_a_sample_that_some_sets_do_not_answer_is_averaged_over_the_others() -> None:
    """Without most of the probability there is no answer: a wheel may not be carried."""
    soft = {name: x / 300.0 for name, x in DOUBT.sets[0].soil.items() if name.endswith("modulus")}
    lost = replace(DOUBT.sets[1], soil={**DOUBT.sets[1].soil, **soft})
    assert not np.isfinite(alone(lost).predict(CONDITIONS).drawbar_pull_n).any()
    left = replace(DOUBT, sets=(DOUBT.sets[0], lost)).predict(CONDITIONS)
    np.testing.assert_allclose(left.drawbar_pull_n, alone(DOUBT.sets[0]).predict(CONDITIONS).drawbar_pull_n)
    most = replace(DOUBT, sets=(replace(DOUBT.sets[0], probability=0.2), lost))
    assert not np.isfinite(most.predict(CONDITIONS).drawbar_pull_n).any()
    assert not np.isfinite(most.model().sigmas(CONDITIONS)["dp"]).any()  # type: ignore[attr-defined]


def test_a_drawn_set_is_drawn_by_its_probability_and_has_no_error_of_sensors() -> None:
    rng = np.random.default_rng(1)
    drawn = [DOUBT.drawn(rng) for _ in range(600)]
    cohesions = np.array([one.soil.cohesion_pa for one in drawn])
    assert np.mean(cohesions == 6_000.0) == pytest.approx(3 / 9, abs=0.06)
    assert np.mean([one.keys == ("vasilev",) for one in drawn]) == pytest.approx(5 / 9, abs=0.06)
    faulty = next(one for one in drawn if one.soil.cohesion_pa == 6_000.0)
    assert faulty.effects == () and not faulty.sets
    assert faulty.soil_sigmas == {"cohesion_pa": pytest.approx(600.0)}
    assert vasilev_and_clay().drawn(rng) == vasilev_and_clay()


def test_an_average_has_no_parameters() -> None:
    with pytest.raises(ConfigError, match="no parameters"):
        DOUBT.model().predict(CONDITIONS, {"cohesion_pa": 1.0})
    with pytest.raises(ConfigError, match="no parameters"):
        DOUBT.model().predict(CONDITIONS, wrt=("H_m",))


def test_every_fault_of_a_file_of_sets_is_listed_at_once() -> None:
    raw = DOUBT.to_mapping()
    raw["rest_probability"] = 0.5
    raw["set"][0]["effect"][0]["form"] = "someones_law"
    raw["set"][1]["covariance"]["rows"][0][0] = -1.0
    raw["set"][2]["covariance"]["rows"] = [[1.0, 2.0]]
    with pytest.raises(ConfigError) as raised:
        ExtendedModel.from_mapping(raw, "m.toml")
    said = str(raised.value)
    for words in (
        "there is no effect 'slip_sinkage/someones_law'",
        "m.toml, set 1 (50 %)",
        "install the package that brings it",
        "not positive semi-definite",
        "m.toml, set 2 (30 %)",
        "no square of its names",
        "do not sum to 1",
    ):
        assert words in said
    twice = DOUBT.to_mapping()
    twice["set"] = [twice["set"][0], {**twice["set"][0], "probability": 0.4}]
    with pytest.raises(ConfigError, match="a set is there twice"):
        ExtendedModel.from_mapping(twice)
    foreign = DOUBT.to_mapping()
    foreign["set"][2]["covariance"]["names"] = ["H_m"]
    with pytest.raises(ConfigError, match="no parameter 'H_m' of this set"):
        ExtendedModel.from_mapping(foreign)


OLD = """
schema = "wheelsoil/model/1"
reading = "balanced"
soil_sigmas = {cohesion_pa = 390.0}
wheel = {radius_m = 0.47, width_m = 0.318, tyre = "smooth"}
effect = [{name = "slip_sinkage", form = "vasilev", parameter = [{name = "H_m", unit = "m", value = 0.02}]}]
provenance = {verdict = "named"}

[soil]
name = "clay"
source = "re-calibrated with clay"
unit_weight_n_m3 = 16500.0
cohesion_pa = 7900.0
tan_phi = 0.24
shear_modulus_m = 0.025
sinkage_exponent = 0.85
cohesive_modulus = 43680.0
frictional_modulus = 499300.0
"""


def test_a_file_of_the_first_version_is_read_as_before() -> None:
    read = ExtendedModel.from_mapping(tomllib.loads(OLD))
    assert (read.values, read.soil.cohesion_pa, read.soil_sigmas) == ({"H_m": 0.02}, 7900.0, {"cohesion_pa": 390.0})
    assert not read.sets
    assert read.to_mapping()["schema"] == "wheelsoil/model/1", "a named cause is written so that older versions read it"


def of_vehicle(model: ExtendedModel) -> ExtendedModel:
    return replace(model, wheels={"FL": (WHEEL, ""), "FR": (Wheel(0.5, 0.3), "lugged")})


ZERO = member(0.3, "drawbar_pull_zero@FR", 6_000.0, offset_n=80.0)
LAW = member(0.5, "vasilev", H_m=0.02)
ONE = of_vehicle(ExtendedModel(WHEEL, SOILS["clay"], (*LAW.effects, *ZERO.effects)))
SEVERAL = of_vehicle(replace(DOUBT, sets=(LAW, ZERO, member(0.1))))


@pytest.mark.parametrize("model", [ONE, SEVERAL], ids=["one set", "several sets"])
def test_a_wheel_of_a_vehicle_has_what_acts_at_all_and_at_it(model: ExtendedModel) -> None:
    """A file with these wheels is read again as it was; each wheel predicts what a model of it alone does."""
    written = tomllib.loads(tomli_w.dumps(model.to_mapping()))
    assert written["schema"] == "wheelsoil/model/3" and [each["id"] for each in written["wheel"]] == ["FL", "FR"]
    sections = [e for part in (written, *written.get("set", ())) for e in part.get("effect", ())]
    assert [(e["name"], e.get("wheel")) for e in sections] == [("slip_sinkage", None), ("drawbar_pull_zero", "FR")]
    read = ExtendedModel.from_mapping(written)
    assert read.wheels == model.wheels and read.to_mapping() == model.to_mapping()
    front, right = read.of_wheel("FL"), read.of_wheel("FR")
    assert (right.wheel, right.tyre, right.wheels) == (Wheel(0.5, 0.3), "lugged", {})
    assert front.keys == ("vasilev",) and right.keys == ("vasilev", "drawbar_pull_zero@FR")
    assert [set(each.names) for each in front.sets][1:2] == [{"cohesion_pa"}] * bool(model.sets)
    plain = replace(front, wheel=Wheel(0.5, 0.3))
    if model.sets:
        zero = member(0.3, "drawbar_pull_zero", 6_000.0, offset_n=80.0)
        plain = replace(plain, sets=(plain.sets[0], zero, plain.sets[2]))
        assert plain.model().sigmas(CONDITIONS)["dp"] == pytest.approx(right.model().sigmas(CONDITIONS)["dp"])
    share = 3 / 9 if model.sets else 1.0
    said, without = right.predict(CONDITIONS), plain.predict(CONDITIONS)
    offset = 0.0 if model.sets else 80.0
    np.testing.assert_allclose(said.drawbar_pull_n, without.drawbar_pull_n + offset, rtol=1e-12)
    np.testing.assert_allclose(
        right.predict(CONDITIONS).drawbar_pull_n - right.predict(CONDITIONS, "physical").drawbar_pull_n, share * 80.0
    )


def test_a_vehicle_predicts_at_no_wheel_and_no_other_one() -> None:
    for use in (ONE.model, lambda: ONE.predict(CONDITIONS), lambda: ONE.of_wheel("RR", "m.toml")):
        with pytest.raises(ConfigError, match="of the wheels of a vehicle") as raised:
            use()
    [fault] = raised.value.faults
    assert (fault.where, fault.found, fault.expected) == ("m.toml", "wheel RR", "FL, FR") and fault.next_step
    assert vasilev_and_clay().of_wheel("RR") == vasilev_and_clay(), "a model of one wheel is used as it is"


def test_an_effect_at_a_wheel_that_the_file_lacks_is_refused() -> None:
    raw = ONE.to_mapping()
    for broken in (
        {**raw, "wheel": [raw["wheel"][0], {**raw["wheel"][1], "id": "RR"}]},
        {**raw, "schema": "wheelsoil/model/1", "wheel": {"radius_m": 0.47, "width_m": 0.318}},
    ):
        with pytest.raises(ConfigError, match="of no wheel of the file"):
            ExtendedModel.from_mapping(broken)
    with pytest.raises(ConfigError, match="there twice"):
        ExtendedModel.from_mapping({**raw, "wheel": raw["wheel"][:1] * 2})
    raw["effect"][0]["wheel"] = "FR"
    with pytest.raises(ConfigError, match="no effect 'slip_sinkage/vasilev at wheel FR'"):
        ExtendedModel.from_mapping(raw)


@given(st.sampled_from(("FL", "FR", "RL", "RR")), st.sampled_from(("", "FL", "FR", "RL", "RR")), extended_models())
def test_a_model_of_one_of_several_wheels_is_of_that_wheel(own: str, asked: str, model: ExtendedModel) -> None:
    """Of an old file nothing is known, and nothing refused; runs whose wheel has no id are of another vehicle."""
    of_one = replace(model, provenance={**model.provenance, "wheel": own})
    read = ExtendedModel.from_mapping(of_one.to_mapping())
    assert read.wheel_id == own and model.of_wheel(asked) is model
    if asked == own:
        assert read.model().wheel == read.wheel
        assert read.of_wheel(asked).to_mapping() == of_one.to_mapping()
        return
    with pytest.raises(ConfigError, match="of another wheel"):
        read.of_wheel(asked)
