"""The curve that the analyst's sliders move: what it is drawn for."""

from __future__ import annotations

import numpy as np
import pytest

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Soil, Wheel, speed_ratio
from wheelsoil.view.curve import SLIPS, Base, curve_of, effect_entries, over_time

WHEEL = Wheel(0.47, 0.318)
CLAY = SOILS["clay"]


def base(soil: Soil = CLAY, load_n: float = 8e3, **more: float) -> Base:
    return Base(WHEEL, soil, load_n, 2.0, **more)


def test_the_wheel_turns_as_the_slip_has_it() -> None:
    """V/(r omega) is 1 - s when driving and 1/(1 + s) when braking."""
    conditions = base().conditions()
    rim = WHEEL.radius_m * conditions.wheel_speed_radps
    np.testing.assert_allclose(conditions.ground_speed_mps / rim, speed_ratio(SLIPS), rtol=1e-12)
    assert SLIPS.min() < -0.2 and SLIPS.max() > 0.7


def test_it_is_that_of_the_load_of_the_campaign() -> None:
    light, heavy = (curve_of(base(load_n=load), (), "balanced", {}) for load in (5e3, 9e3))
    assert (light["load_n"], heavy["load_n"]) == (5e3, 9e3)
    assert np.all(heavy["sinkage_m"] > light["sinkage_m"])
    np.testing.assert_array_equal(base(load_n=5e3).conditions().vertical_load_n, 5e3)


@pytest.mark.parametrize(
    ("key", "values", "change_n"),
    [
        ("zero_drift", {"zero_drift.campaign_span_n": 100.0}, 50.0),  # at the end of the campaign
        ("drawbar_pull_zero", {"drawbar_pull_zero.offset_n": 30.0}, 30.0),
    ],
)
def test_an_effect_moves_it_by_its_size(key: str, values: dict[str, float], change_n: float) -> None:
    assert set(values) == set(EFFECTS[key].parameter_keys().values())
    with_it, without = (curve_of(base(), (key,), "balanced", own) for own in (values, {}))
    np.testing.assert_allclose(with_it["drawbar_pull_n"] - without["drawbar_pull_n"], change_n, rtol=1e-9)


def test_an_effect_of_an_undeclared_role_is_listed_only_where_it_is_chosen_and_cannot_be_identified() -> None:
    [key] = [key for key, effect in EFFECTS.items() if effect.needs.roles == ("pitch",)]

    def entries(roles: tuple[str, ...], chosen: tuple[str, ...]) -> dict[str, dict[str, object]]:
        return {entry["key"]: entry for entry in effect_entries(base(), "balanced", {}, roles, chosen)}

    assert key not in entries((), ()) and entries(("pitch",), ())[key]["can"]
    entry = entries((), (key,))[key]
    assert not entry["can"] and entry["why_not"] == "vehicle.toml declares no pitch" and entry["parameters"]


def test_the_soil_in_front_of_the_wheel_has_the_weight_of_its_soil() -> None:
    from dataclasses import replace

    light = base(replace(CLAY, unit_weight_n_m3=15e3)).conditions()
    np.testing.assert_array_equal(light.unit_weight_n_m3, 15e3)


def test_over_time_it_is_the_same_model_at_the_samples_of_the_run() -> None:
    conditions, values = base().conditions(), {"H_m": 0.03}
    along = over_time(base(), conditions, ("vasilev",), "balanced", values)
    across = curve_of(base(), ("vasilev",), "balanced", values)
    for name, found in along.items():
        np.testing.assert_array_equal(found, across[name])
