"""The extended model as a file: what goes in comes out, and what cannot be is said in words."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import ConfigError
from model.diagnosis.core.result import Cause, ParameterEstimate, SoilEstimate
from model.effects.catalogue import EFFECTS
from model.extended import ExtendedEffect, ExtendedModel, extended_model
from model.wheel_soil.conditions import Conditions, Wheel
from model.wheel_soil.soils import SOIL_PARAMETERS, SOILS
from model.wheel_soil.wheel_soil_model import WheelSoilModel

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


@settings(max_examples=60, deadline=None)
@given(extended_models(), st.sampled_from(("toml", "json")))
def test_what_is_written_is_read_again(extended: ExtendedModel, form: str) -> None:
    written = extended.to_mapping()
    text = tomli_w.dumps(written) if form == "toml" else json.dumps(written, allow_nan=False)
    read = ExtendedModel.from_mapping(tomllib.loads(text) if form == "toml" else json.loads(text))
    assert read.soil.tan_phi == pytest.approx(extended.soil.tan_phi, rel=1e-15)
    again = read.to_mapping()
    again["soil"]["tan_phi"] = written["soil"]["tan_phi"]
    assert again == written
    assert read.values == extended.values


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


@pytest.mark.parametrize("broken", [{"schema": "wheelsoil/model/2"}, {"wheel": {"radius_m": -1.0, "width_m": 0.2}}])
def test_a_foreign_file_is_refused(broken: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        ExtendedModel.from_mapping(vasilev_and_clay().to_mapping() | broken)
