"""A formula set free: its columns, and a cause that acts by a formula that the engine does not have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from blind.engine import asked, campaign_from_channels
from blind.mix import WHOLE, Case, cases
from blind.study import truth_of
from short_campaign import driven, looked

from model.diagnosis import Kind
from model.diagnosis.findings.adequacy import kinds_of, unlisted
from model.diagnosis.findings.free_form import with_free_form
from model.diagnosis.time_series.columns import columns_of


def test_a_curve_multiplies_what_the_cause_changes() -> None:
    [data] = looked(driven("vasilev:H_m=0.04"), "vasilev", "torque_zero").campaigns
    freed = frozenset({("vasilev", Kind.SLIP)})
    plain, curved = (
        columns_of(data.simulation, data.samples, data.linear, data.speed_variance, freed=chosen)
        for chosen in (frozenset(), freed)
    )
    shapes = curved.catch_all.shapes
    own = [i for i, shape in enumerate(shapes) if shape.cause]
    assert own == list(range(len(plain.catch_all.shapes), len(shapes))) and len(own) == 5
    assert {shapes[i].kind for i in own} == {Kind.SLIP} and {shapes[i].cause for i in own} == {"vasilev"}
    np.testing.assert_array_equal(curved.catch_all.form, np.r_[plain.catch_all.form, np.ones(5)])
    assert len(kinds_of(shapes)) == len(kinds_of(plain.catch_all.shapes)) + 1
    [at] = [i for i, cause in enumerate(curved.causes) if cause.key == "vasilev"]
    change = data.linear.causes[..., at] * curved.causes[at].centre
    driving = np.asarray(data.linear.conditions.slip) > 0
    columns = curved.rows[..., curved.shared - 5 : curved.shared]
    together = np.where(driving & curved.present, 0.3 * change, 0.0)  # the hats of driving add up to one
    np.testing.assert_allclose(columns.sum(axis=-1), together, atol=1e-9)


def test_without_a_cause_no_formula_is_set_free() -> None:
    seen = looked(driven(), "vasilev")
    assert seen.best.keys == () and with_free_form(seen, unlisted(seen.grams)) is None


def test_no_formula_of_an_instrument_is_set_free() -> None:
    """A drifting, curved or saturated reading is no other cause of the list: it is unlisted."""
    seen = looked(driven("speed_bias:offset_mps=0.2"), "speed_bias")
    assert seen.best.keys == ("speed_bias",)
    assert with_free_form(seen, unlisted(seen.grams)) is None


@pytest.mark.parametrize(
    ("key", "level", "family"),
    [
        pytest.param("skid_hyperbola", 12.0, "skid_sinkage", marks=pytest.mark.slow),
        pytest.param("hump", 16.0, "shear_softening", marks=pytest.mark.study),
    ],
)
def test_a_cause_by_another_formula_is_no_longer_unexplained(key: str, level: float, family: str) -> None:
    """Skid sinkage that levels off, softening with a hump: so many times the noise, by the study's own formulas."""
    case = Case("single", 0, ((key, level, 1.0),))
    truth = truth_of(case)
    said = asked(campaign_from_channels(case.day, [(m["key"], m["size"]) for m in truth["members"]]), case, truth)
    assert said["verdict"] in ("named", "one_of")
    assert said["free_form"]["family"] == family == said["causes"][0]["name"]
    assert said["adequacy"]["ok"]


@pytest.mark.slow
def test_beside_a_cause_by_another_formula_no_other_is_named() -> None:
    """A torque gain made up for part of a skid sinkage that levels off, at more than 99.9 %."""
    case = next(case for case in cases(replace(WHOLE, block=11)) if case.name == "single/skid_hyperbola@5/31001")
    truth = truth_of(case)
    said = asked(campaign_from_channels(case.day, [(m["key"], m["size"]) for m in truth["members"]]), case, truth)
    assert said["verdict"] == "named" and said["as_they_are"]["torque_gain"] > 0.999
    assert [cause["name"] for cause in said["causes"] if "barred" not in cause] == ["skid_sinkage"]
    assert [c["barred"]["code"] for c in said["causes"] if c["name"] == "torque_gain"] == ["form_not_listed"]


@pytest.mark.parametrize(
    "key",
    [
        pytest.param("brake_asymmetry", marks=pytest.mark.slow),
        pytest.param("bridge_gain_drift", marks=pytest.mark.study),
    ],
)
def test_what_no_cause_does_stays_unexplained(key: str) -> None:
    case = Case("outside", 0, ((key, 5.0, 1.0),))
    truth = truth_of(case)
    said = asked(campaign_from_channels(case.day, [(m["key"], m["size"]) for m in truth["members"]]), case, truth)
    assert said["verdict"] == "unexplained" and said["adequacy"]["statistic"] > 0.9
    assert said["free_form"] is None and said["lack_of_fit_rms"]
