"""The table of channels: names, units and look-ups."""

from __future__ import annotations

import pytest

from daq import CHANNELS, INPUTS, ON_TIME_BASE, OUTPUTS, REACTIONS, ROLES, TRANSDUCER_ROLES, Use


def test_roles_keys_and_fields_are_unique() -> None:
    keys = [channel.key for channel in CHANNELS if channel.key]
    assert len(ROLES) == len(CHANNELS) == len({channel.field for channel in CHANNELS})
    assert len(keys) == len(set(keys)) == len(INPUTS) + len(OUTPUTS)
    assert not INPUTS.keys() & OUTPUTS.keys()


@pytest.mark.parametrize(
    ("role", "field", "sigma", "unit"),
    [
        ("drawbar_pull", "drawbar_pull_n", "drawbar_pull_sigma_n", "N"),
        ("driving_torque", "driving_torque_nm", "driving_torque_sigma_nm", "N m"),
        ("ground_speed", "ground_speed_mps", "ground_speed_sigma_mps", "m/s"),
        ("wheel_speed", "wheel_speed_radps", "wheel_speed_sigma_radps", "rad/s"),
        ("latitude", "latitude_deg", "latitude_sigma_deg", "deg"),
    ],
)
def test_names_of_columns_end_in_the_unit(role: str, field: str, sigma: str, unit: str) -> None:
    channel = ROLES[role]
    assert (channel.field, channel.sigma_field, channel.unit_text) == (field, sigma, unit)
    assert channel.name == role.replace("_", " ")


def test_look_ups_follow_from_the_table() -> None:
    assert list(OUTPUTS) == ["dp", "t", "z"]
    assert list(REACTIONS) == ["dp", "t"]
    assert set(TRANSDUCER_ROLES) == {"vertical_load", "drawbar_pull", "driving_torque"}
    assert {channel.use for channel in ON_TIME_BASE} <= {Use.INPUT, Use.OUTPUT, Use.EXTRA}
    assert [channel.role for channel in ON_TIME_BASE if channel.required] == [
        "ground_speed",
        "wheel_speed",
        "vertical_load",
        "drawbar_pull",
        "driving_torque",
    ]
