"""Runs that lack a role, for a purpose that only looks: what is there is processed, what is not says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from synthetic_run import channel, forces, speeds, vehicle

from daq import Channel, ConfigError, DataError, VehicleConfig
from daq.config import TransducerSection, WheelSection
from processing import LOOK, SLIP_ROLES, ProcessedRun, ProcessOptions, Reason, Segment
from processing.options import FORCE_ROLES, NEEDED_ROLES
from processing.pipeline import process
from wheelsoil.wording.notes import note_text, texts_of
from wheelsoil.wording.run_summary import summary_table

QUANTITIES = {
    "ground_speed": "ground_speed_mps",
    "wheel_speed": "wheel_speed_radps",
    "vertical_load": "vertical_load_n",
    "drawbar_pull": "drawbar_pull_n",
    "driving_torque": "driving_torque_nm",
}
OUTBOARD = WheelSection(radius_m=0.47, width_m=0.318, outboard_mass_kg=75.0, outboard_inertia_kgm2=8.0)
LOOKING = ProcessOptions(purpose=LOOK)


def everything() -> dict[str, Channel]:
    return speeds(12.0, slip=0.2, rng=np.random.default_rng(1)) | forces(12.0, 200.0, np.random.default_rng(2))


def without(*roles: str) -> dict[str, Channel]:
    return {role: one for role, one in everything().items() if role not in roles}


def empty(role: str) -> dict[str, Channel]:
    return {role: channel(role, np.zeros(0), np.zeros(0))}


def looked_at(channels: dict[str, Channel], config: VehicleConfig | None = None) -> ProcessedRun:
    return process(channels, config or vehicle(), options=LOOKING)


def test_with_all_roles_nothing_is_different() -> None:
    looked, processed = looked_at(everything()), process(everything(), vehicle(), options=ProcessOptions())
    assert looked.quality == processed.quality and looked.quality.missing == {}
    for name, values in vars(processed).items():
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(getattr(looked, name), values)


@pytest.mark.parametrize("role", QUANTITIES)
@pytest.mark.parametrize("declared", [False, True])
def test_a_missing_role_costs_itself(role: str, declared: bool) -> None:
    run = looked_at(without(role) | (empty(role) if declared else {}), vehicle(wheel=OUTBOARD))
    for other, name in QUANTITIES.items():
        assert np.isfinite(getattr(run, name)).any() == (other != role)
    assert np.isfinite(run.slip).any() == (role not in SLIP_ROLES)
    assert set(run.quality.missing) == {role} - {"driving_torque"}
    for note in run.quality.missing.values():
        assert note in run.quality.notes
        wanted = "holds no sample" if declared else f"{role} is missing; name it under [signals]"
        assert wanted in note_text(note)
    assert sum(run.quality.shares.values()) == pytest.approx(1.0)
    assert summary_table(run)


@pytest.mark.parametrize("role", SLIP_ROLES)
def test_slip_that_was_not_measured_is_no_slow_drive(role: str) -> None:
    run = looked_at(without(role))
    assert not run.used.any()
    assert set(run.reason.tolist()) <= {Reason.SLIP_NOT_MEASURED, Reason.FILTER_EDGE, Reason.GAP}
    assert run.quality.shares["SLIP_NOT_MEASURED"] > 0.8
    assert set(run.segment.tolist()) == {Segment.UNKNOWN} and run.quality.standstills == ()
    assert np.isnan(run.quality.residual_latency_s) and np.isnan(run.quality.speed_scale)


def test_forces_that_are_missing_leave_the_slip_to_be_used() -> None:
    run = looked_at(without("vertical_load", "drawbar_pull", "driving_torque"))
    assert run.used.any() and set(run.quality.missing) == {"vertical_load", "drawbar_pull"}


@pytest.mark.parametrize(("role", "force"), [("ground_speed", "drawbar_pull"), ("wheel_speed", "driving_torque")])
def test_a_force_that_cannot_be_carried_to_the_soil_says_so(role: str, force: str) -> None:
    run = looked_at(without(role), vehicle(wheel=OUTBOARD))
    assert any(note.startswith(f"{force}: the inertia") and role in note for note in texts_of(run.quality.notes))
    name = QUANTITIES[force]
    np.testing.assert_array_equal(getattr(run, name), getattr(looked_at(without(role)), name))


@pytest.mark.parametrize("flags", [np.zeros(0), np.ones(200)])
def test_flags_and_epochs_of_a_speed_that_is_missing_do_no_harm(flags: np.ndarray[Any, Any]) -> None:
    at = np.arange(len(flags)) / 20
    more = {
        "ground_speed_valid": channel("ground_speed_valid", at, flags),
        "gnss_time": channel("gnss_time", at, 5000.0 + at),
    }
    assert set(looked_at(without("ground_speed") | more).quality.missing) == {"ground_speed"}
    assert set(looked_at(without("ground_speed") | empty("ground_speed") | more).quality.missing) == {"ground_speed"}


AT = np.arange(120) / 10
DEAD = {role: {role: channel(role, AT, np.full(120, np.nan))} for role in QUANTITIES}
NO_FIX = {
    "ground_speed": channel("ground_speed", AT, np.full(120, 3.0)),
    "ground_speed_valid": channel("ground_speed_valid", AT, np.zeros(120)),
}


@pytest.mark.parametrize(("role", "given"), [*DEAD.items(), ("ground_speed", NO_FIX)])
def test_a_role_without_a_usable_value_costs_no_more_than_one_that_is_missing(
    role: str, given: dict[str, Channel]
) -> None:
    config = vehicle(wheel=OUTBOARD)
    run, lacking = looked_at(without(role) | given, config), looked_at(without(role), config)
    for name in (*QUANTITIES.values(), "slip", "reason"):
        np.testing.assert_array_equal(getattr(run, name), getattr(lacking, name))
    assert run.cutoff_hz == lacking.cutoff_hz
    assert set(run.quality.missing) == {role} - {"driving_torque"}
    assert any(role in note and "never" in note and "usable value" in note for note in texts_of(run.quality.notes))
    assert all("never has a usable value: check" in said for said in texts_of(run.quality.missing.values()))
    assert any("fix" in said for said in texts_of(run.quality.missing.values())) == (role == "ground_speed")


@pytest.mark.parametrize("lacking", ["wheel_angle", "vertical_load", "drawbar_pull"])
def test_wheel_axes_cannot_be_turned_by_halves(lacking: str) -> None:
    at = np.arange(2400) / 200
    angle = {"wheel_angle": channel("wheel_angle", at, np.mod(3 * at, 2 * np.pi))}
    given = {role: one for role, one in (everything() | angle).items() if role != lacking}
    run = looked_at(given, vehicle(transducer=TransducerSection(frame="wheel")))
    assert set(run.quality.missing) == {"vertical_load", "drawbar_pull"}
    assert all(
        f"name {'it' if role == lacking else lacking}" in note_text(note) for role, note in run.quality.missing.items()
    )
    assert np.isfinite(run.driving_torque_nm).any() and run.used.any()


def test_without_any_role_there_is_nothing_to_look_at() -> None:
    with pytest.raises(ConfigError, match="no signal has a role that can be shown"):
        looked_at({})
    with pytest.raises(DataError, match="no sample of wheel_speed"):
        looked_at(empty("ground_speed") | empty("wheel_speed"))


@pytest.mark.parametrize("roles", [("drawbar_pull",), ("driving_torque",), tuple(QUANTITIES)])
def test_where_nothing_is_usable_each_role_says_why(roles: tuple[str, ...]) -> None:
    position = {role: channel(role, AT, np.full(120, 48.0)) for role in ("latitude", "longitude")}
    given = {role: DEAD[role][role] for role in roles} | position
    with pytest.raises(DataError) as caught:
        looked_at(given)
    assert {fault.what for fault in caught.value.faults} == {f"{role} is missing" for role in roles}
    assert {fault.found for fault in caught.value.faults} == {"never a usable value"}


def test_forces_alone_that_cannot_be_turned_say_why() -> None:
    given = {role: one for role, one in everything().items() if role in FORCE_ROLES}
    with pytest.raises(DataError, match="name wheel_angle, which turns it into vehicle axes, under"):
        looked_at(given, vehicle(transducer=TransducerSection(frame="wheel")))


@pytest.mark.parametrize("purpose", NEEDED_ROLES)
def test_who_needs_a_role_still_asks_for_it(purpose: str) -> None:
    with pytest.raises(ConfigError, match="'wheel_speed', which"):
        process(without("wheel_speed"), vehicle(), options=ProcessOptions(purpose=purpose))
