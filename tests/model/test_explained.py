"""A value that does not bear a name takes it away."""

from __future__ import annotations

from dataclasses import replace

import pytest

from model.diagnosis import Cause, ParameterEstimate
from model.diagnosis.core.naming import doubtful
from model.effects import EFFECTS
from wheelsoil.wording.notes import note_text


def cause(key: str, *values: tuple[float, float, float]) -> Cause:
    effect = EFFECTS[key]
    found = tuple(
        ParameterEstimate(p.name, p.unit, value, (low, high), (high - low) / 4)
        for p, (value, low, high) in zip(effect.parameters, values, strict=True)
    )
    return Cause(effect.name, effect.form, effect.kind, key, 0.99, 1.0, found)


def lyasko_with_p() -> Cause:
    found = cause("lyasko", (0.3, -0.1, 0.7), (0.02, -0.3, 0.3))
    return replace(found, parameters=(ParameterEstimate("p", "1", 0.32, (0.3, 0.34), 0.01), *found.parameters))


@pytest.mark.parametrize(
    ("causes", "why"),
    [
        ([cause("vasilev", (0.03, 0.02, 0.04))], ""),
        ([cause("lyasko", (0.3, -0.1, 0.7), (0.02, -0.3, 0.3))], ""),
        ([lyasko_with_p()], ""),
        ([cause("speed_bias", (-0.05, -0.29, 0.19))], "may as well be 0"),
        (
            [cause("vasilev", (0.03, 0.02, 0.04)), cause("bulldozing", (3.0, 2.5, 3.0))],
            "the bulldozing's fraction ends",
        ),
        ([cause("exit_angle", (0.01, 0.001, 0.02))], ""),
        ([cause("exit_angle", (0.0, 0.0, 0.01))], "may as well be 0"),
    ],
)
def test_a_value_at_its_limit_or_as_well_neutral_is_doubtful(causes: list[Cause], why: str) -> None:
    found = doubtful(causes)
    assert (found is None) == (why == "")
    assert found is None or why in note_text(found)


def test_a_value_that_may_be_neutral_has_its_label_and_no_unit_of_one() -> None:
    [found] = filter(None, [doubtful([cause("wheel_radius", (-0.0243, -0.0589, 0.0103))])])
    assert note_text(found) == "the wheel radius's relative error may as well be 0 (−0.0589 to 0.0103)"
