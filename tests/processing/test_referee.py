"""The physics referee: mistakes of vehicle.toml are named, sound runs are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fault_support import recording
from referee_study import base_world, is_right, partly_mistaken, ruling_of
from referee_world import WAYS, Way, World, firm, mistaken, sound_world

from daq import ROLES, Severity, VehicleConfig, find_unit
from model.wheel_soil import SOILS
from processing import LOOK, ProcessOptions, RunCode, is_refused
from processing.pipeline import process
from processing.referee import BY_KEY, LISTED, MENDS, Evidence, Kind, Ruling, densities, evidence_of, judge
from wheelsoil.wording.notes import note_text

UNLISTED_SEED = 9000


@pytest.fixture(
    scope="module", params=[("firm", True), pytest.param(("sandy", False), marks=pytest.mark.slow)], ids=str
)
def sound(request: pytest.FixtureRequest):  # type: ignore[no-untyped-def]
    """A sound run with, and one without quiet stretches."""
    soil, quiet = request.param
    return base_world(soil, quiet=quiet, seed=UNLISTED_SEED)


@pytest.fixture(scope="module")
def on_firm_soil() -> World:
    """A sound run on firm soil: on soft soil some mistakes that are not listed look like another slip."""
    return base_world("firm", quiet=True, seed=UNLISTED_SEED)


@pytest.mark.parametrize("key", LISTED)
def test_a_listed_mistake_is_named_and_refused(sound, key: str) -> None:  # type: ignore[no-untyped-def]
    ruling = ruling_of(mistaken(sound, key))
    assert key in [mend.key for mend in ruling.named]
    assert is_right(ruling, key) or ruling.mends[0][0].key == key
    assert ruling.sound < 0.01 or "lbf ft" in key


@pytest.mark.parametrize(
    "key", ["ground_speed=kt", "wheel_speed=rpm", "wheel_speed=deg/s", "drawbar_pull=kgf", "drawbar_pull=lbf"]
)
def test_a_run_that_pulls_all_the_time_is_judged_as_a_whole(key: str) -> None:
    """By the least slip and sliding, by how pull follows traction, and by the distance of the positions."""
    world = base_world("sandy", quiet=False, seed=100)
    assert is_right(ruling_of(mistaken(world, f"unit:{key}")), f"unit:{key}")


def test_thirty_are_listed() -> None:
    assert len(LISTED) == 30
    assert len(BY_KEY) == len(MENDS) + 1
    declared = [mend for mend in MENDS if mend.kind is Kind.DECLARED]
    for mend in declared:
        mistaken_for_si = BY_KEY[mend.key.replace(Kind.DECLARED, Kind.UNIT)]
        assert {role: factor * mend.factors[role] for role, factor in mistaken_for_si.factors.items()} == pytest.approx(
            dict.fromkeys(mend.roles, 1.0)
        )
    assert len(declared) > 2


@pytest.mark.parametrize(
    ("role", "turned"),
    [
        ("driving_torque", lambda values: 0.1 * values),
        ("driving_torque", lambda values: 0.05 * values),  # of the motor
        ("wheel_speed", lambda values: values / (2 * np.pi)),
        ("ground_speed", lambda values: 100.0 * values),
        ("ground_speed", lambda values: 1.0 * (values > 1)),
        ("driving_torque", lambda values: np.where(np.arange(len(values)) > len(values) // 2, -values, values)),
    ],
)
def test_a_mistake_that_is_not_listed_gets_no_mend(on_firm_soil: World, role: str, turned) -> None:  # type: ignore[no-untyped-def]
    channels = dict(on_firm_soil.channels)
    channels[role] = replace(channels[role], values=turned(channels[role].values))
    ruling = ruling_of(World(channels, on_firm_soil.vehicle))
    assert ruling.refused
    assert [mend.kind for mend in ruling.named] == [Kind.UNLISTED]


@pytest.mark.parametrize(
    ("role", "size", "unit", "fits"),
    [
        ("sinkage", 50.0, "m", {"mm", "cm", "um"}),
        ("sinkage", 0.05, "m", None),
        ("tyre_pressure", 2.4, "Pa", {"bar", "psi"}),
        ("tyre_pressure", 2.4e5, "bar", {"Pa"}),
        ("tyre_pressure", 0.0, "Pa", None),
        ("pitch", 5.0, "rad", {"deg", "min", "arcsec", "mrad"}),
        ("yaw_rate", 10.0, "rad/s", {"deg/s", "rpm"}),
        ("steering_angle", 15.0, "rad", {"deg", "min", "arcsec", "mrad"}),
        ("longitudinal_acceleration", 100.0, "m/s^2", {"mm/s^2", "mg"}),
        ("wheel_acceleration_x", 1.0, "m/s^2", None),
        ("latitude", 3120.0, "deg", {"min", "arcsec"}),
        ("latitude", 52.0, "deg", None),
        ("pitch", 5.0, None, set()),
    ],
)
def test_a_channel_beyond_what_is_possible_has_another_unit(
    sound,  # type: ignore[no-untyped-def]
    role: str,
    size: float,
    unit: str | None,
    fits: set[str] | None,
) -> None:
    one = sound.channels["vertical_load"]
    values = size * find_unit(unit or ROLES[role].unit, ROLES[role].quantities).factor  # type: ignore[union-attr]
    values = np.degrees(values) if ROLES[role].in_degrees else values
    channels = dict(sound.channels)
    channels[role] = replace(
        one, name=role, values=np.full(len(one), values) + 1e-6 * values * np.sin(np.arange(len(one)))
    )
    signals = {role: {"signal": role} | ({"unit": unit} if unit else {})}
    given = sound.vehicle.model_dump(exclude_unset=True) | {"signals": signals}
    run = World(channels, VehicleConfig.model_validate(given)).processed()
    notes = [note for note in run.quality.notes if note.code == RunCode.WRONG_SIZE]
    assert [note.values["role"] for note in notes] == ([] if fits is None else [role])
    assert is_refused(run) is (role == "sinkage" and fits is not None)
    for note in notes:
        assert set(note.values["units"]) == fits
        assert all(f'unit = "{unit}"' in note_text(note) for unit in fits or ())


def changed_world(sound: World, sections: dict[str, object], **values: object) -> World:
    """Return a sound run with other values of channels, by role, and sections of vehicle.toml."""
    channels = dict(sound.channels)
    for role, changed in values.items():
        one = channels.get(role, channels["ground_speed"])
        channels[role] = replace(one, name=role, values=np.broadcast_to(changed, one.values.shape))  # type: ignore[call-overload]
    given = sound.vehicle.model_dump(exclude_unset=True)
    given |= {"signals": {role: f"M.{role}" for role in channels}}
    return World(channels, VehicleConfig.model_validate(given | sections))


def sized(world: World) -> list[tuple[str, str]]:
    """Return role and kind of each note on a size, which its text names."""
    notes = [note for note in world.processed().quality.notes if note.code == RunCode.WRONG_SIZE]
    assert all(note.values["role"] in note_text(note) for note in notes)
    return [(note.values["role"], note.values["why"]) for note in notes]


def test_a_sinkage_above_the_ground_is_turned(sound) -> None:  # type: ignore[no-untyped-def]
    depth = 0.06 + 0.01 * np.sin(np.arange(len(sound.channels["ground_speed"])))
    assert not sized(changed_world(sound, {}, sinkage=depth))
    assert not sized(changed_world(sound, {}, sinkage=depth - 0.08))
    turned = changed_world(sound, {}, sinkage=-depth)
    assert sized(turned) == [("sinkage", "turned")]
    assert 'write sinkage = "-M.sinkage"' in note_text(turned.processed().quality.notes[-1])
    assert is_refused(turned.processed())


@pytest.mark.parametrize("factor", [1, 1000])
def test_time_that_the_positions_contradict_is_refused(factor: int) -> None:
    """1 kHz in ms that are taken for s looks like 1 Hz for hours, and drives a thousand times as far."""
    run, _ = recording("clay", 0)
    channels = {role: one for role, one in run.channels().items() if role != "gnss_time"}
    slow = {
        role: replace(one, time_ns=(one.time_ns - one.time_ns[0]) * factor, values=one.values)
        for role, one in channels.items()
    }
    found = process(slow, run.vehicle, run.info, ProcessOptions(purpose=LOOK, rate_hz=max(1, 100 / factor)))
    texts = [note_text(note) for note in found.quality.notes if note.code == RunCode.WRONG_SIZE]
    assert is_refused(found) == (factor > 1) and len(texts) == (factor > 1)
    assert all('write time_unit = "ms" under [series]' in text for text in texts)


def test_positions_in_radians_are_noted(sound) -> None:  # type: ignore[no-untyped-def]
    positions = {role: sound.channels[role].values for role in ("latitude", "longitude")}
    assert not sized(changed_world(sound, {}, **positions))
    wrong = {role: np.radians(values) for role, values in positions.items()}
    assert sized(changed_world(sound, {}, **wrong)) == [("latitude", "radians")]


@pytest.mark.parametrize(
    ("role", "sigma", "noted"),
    [
        ("ground_speed", 0.05, False),
        ("ground_speed", 500.0, True),
        ("vertical_load", 80.0, False),
        ("vertical_load", 0.08, True),
        ("driving_torque", 0.02, True),
    ],
)
def test_a_sigma_in_another_unit_is_noted(sound, role: str, sigma: float, noted: bool) -> None:  # type: ignore[no-untyped-def]
    world = changed_world(sound, {"sensors": {role: {"sigma": sigma}}})
    assert sized(world) == ([(role, "sigma")] if noted else [])


@pytest.mark.parametrize(("factor", "axles", "said"), [(1.0, None, ""), (2.2046, None, " lb are "), (2.2046, 4, "")])
def test_a_mass_in_pounds_is_noted(sound, factor: float, axles: int | None, said: str) -> None:  # type: ignore[no-untyped-def]
    load_n = np.median(sound.channels["vertical_load"].values)
    vehicle = {"mass_kg": 4 * load_n / 9.80665 * factor} | ({"axles": axles} if axles else {})
    wheel = {"radius_m": 0.47, "width_m": 0.318} | ({"axle": 1} if axles else {})
    run = changed_world(sound, {"vehicle": vehicle, "wheel": wheel}).processed()
    told = [note_text(note) for note in run.quality.notes if note.code == RunCode.OVERLOADED]
    assert len(told) == bool(said) and all(said in text for text in told)


@pytest.mark.parametrize(
    ("role", "unit", "first"),
    [("ground_speed", "km/h", False), ("wheel_speed", "rpm", True), ("wheel_speed", "deg/s", False)],
)
def test_a_unit_that_changes_within_the_run_is_found(role: str, unit: str, first: bool) -> None:
    """A wheel speed in rpm for a while passes as slip: no factor of a unit is taken up at once."""
    right = base_world("sandy", quiet=False, seed=101)
    run = partly_mistaken(right, f"unit:{role}={unit}", share=0.6, first=first).processed()
    [note] = [note for note in run.quality.notes if note.code in (RunCode.IMPLAUSIBLE, RunCode.WRONG_SIZE)]
    assert is_refused(run) and (note.values["role"], note.values["why"]) == (role, "changed")
    assert note.values["size"] == pytest.approx(0.6 * run.time_s[-1], abs=0.3)
    assert f"{role} changes to or from {unit} after 2" in note_text(note) and "export the run anew" in note_text(note)
    assert not is_refused(right.processed())


@pytest.mark.parametrize(
    ("way", "soft"),
    [
        pytest.param(way, soft, id=f"{way.__name__}-{soft}", marks=[pytest.mark.slow] * (soft != bool(number % 2)))
        for number, way in enumerate(WAYS)
        for soft in (False, True)
    ],
)
def test_a_sound_run_is_not_refused(way: Way, soft: bool) -> None:
    soil = SOILS["clay"] if soft else firm(SOILS["sandy_loam"])
    run = sound_world(np.random.default_rng(UNLISTED_SEED + 7), soil, way).processed()
    assert not is_refused(run)


def test_a_vehicle_that_reverses_is_sound(sound) -> None:  # type: ignore[no-untyped-def]
    """All four turned: that is how a vehicle drives backward."""
    evidence = evidence_of(sound.processed(), sound.vehicle)
    turned = {role: values if role == "vertical_load" else -values for role, values in evidence.channels.items()}
    backward = Evidence(turned, evidence.radius_m, evidence.mass_kg, evidence.against_track)
    assert judge(backward).sound == pytest.approx(judge(evidence).sound, abs=0.05)


def test_positions_decide_between_units_of_speed(sound) -> None:  # type: ignore[no-untyped-def]
    world = mistaken(sound, "unit:ground_speed=kt")
    evidence = evidence_of(world.processed(), world.vehicle)
    assert evidence.against_track["ground_speed"] == pytest.approx(3600 / 1852, rel=0.05)
    assert judge(evidence).mends[0][0].key == "unit:ground_speed=kt"
    without = judge(Evidence(evidence.channels, evidence.radius_m, evidence.mass_kg))
    assert without.mends[0][1] < judge(evidence).mends[0][1]


@pytest.mark.parametrize(
    "lacking",
    [
        *("driving_torque", "drawbar_pull", "vertical_load", "wheel_speed", "ground_speed"),
        *("vertical_load, driving_torque", "vertical_load, drawbar_pull"),
    ],
)
def test_a_channel_less_is_no_fault(sound, lacking: str) -> None:  # type: ignore[no-untyped-def]
    evidence = evidence_of(sound.processed(), sound.vehicle)
    fewer = {role: values for role, values in evidence.channels.items() if role not in lacking}
    ruling = judge(Evidence(fewer, evidence.radius_m, evidence.mass_kg, evidence.against_track))
    assert ruling.sound > 1e-3 and not ruling.refused
    assert all(role not in lacking for mend, _ in ruling.mends for role in mend.roles)


@pytest.mark.parametrize("slip", [0.0, 0.05])
def test_a_road_vehicle_without_forces(slip: float) -> None:
    rim = 10 + np.sin(np.arange(2000) / 100)
    speeds = {"ground_speed": rim * (1 - slip), "wheel_speed": rim / 0.33}
    assert not judge(Evidence(speeds, 0.33)).doubted
    wrong = speeds | {"ground_speed": speeds["ground_speed"] * 3.6}
    assert judge(Evidence(wrong, 0.33)).mends[0][0].key == "unit:ground_speed=km/h"


def test_nothing_to_judge_is_sound() -> None:
    assert judge(Evidence({}, 0.5)) == Ruling(1.0)
    standing = {"ground_speed": np.zeros(500), "wheel_speed": np.zeros(500)}
    assert judge(Evidence(standing, 0.5)).sound == 1.0


def test_what_is_named() -> None:
    first, second, third = MENDS[:3]
    sure = Ruling(1e-9, ((first, 0.995), (second, 0.005)))
    assert sure.named == (first,)
    open_ = Ruling(1e-9, ((first, 0.6), (second, 0.395), (third, 0.005)))
    assert open_.named == (first, second)
    assert Ruling(1.01e-3, ((first, 0.9),)).refused is False
    assert Ruling(0.99e-3, ((first, 0.9),)).refused is True
    assert Ruling(0.5, ((first, 0.4),)).doubted is False


def test_the_note_says_what_was_declared(sound) -> None:  # type: ignore[no-untyped-def]
    run = mistaken(sound, "sign:driving_torque").processed()
    [note] = [one for one in run.quality.notes if one.code == RunCode.IMPLAUSIBLE]
    assert note.severity == Severity.FAULT
    assert note.values["mends"] == ("sign:driving_torque",)
    assert note.values["radius_m"] == run.wheel_radius_m
    assert BY_KEY[note.values["mends"][0]].kind is Kind.SIGN


def test_a_speed_in_a_wrong_unit_spoils_no_force() -> None:
    """The inertia of the outboard parts is put back before a wheel speed in deg/s is judged."""
    sound = base_world("firm", quiet=True, seed=UNLISTED_SEED)
    wheel = {"radius_m": 0.47, "width_m": 0.318, "outboard_mass_kg": 75.0, "outboard_inertia_kgm2": 8.0}
    given = sound.vehicle.model_dump(exclude_unset=True) | {"wheel": wheel}
    heavy = World(sound.channels, VehicleConfig.model_validate(given))
    wrong = mistaken(heavy, "unit:wheel_speed=deg/s")
    raw = evidence_of(wrong.processed(), wrong.vehicle).channels["driving_torque"]
    light = mistaken(sound, "unit:wheel_speed=deg/s")
    np.testing.assert_allclose(raw, evidence_of(light.processed(), light.vehicle).channels["driving_torque"], atol=1e-6)


def test_a_pound_and_a_turn_per_minute_are_what_they_are() -> None:
    assert BY_KEY["unit:wheel_speed=rpm"].factors["wheel_speed"] == pytest.approx(2 * np.pi / 60)
    assert BY_KEY["unit:driving_torque=lbf ft"].factors["driving_torque"] == pytest.approx(1.3558179)
    assert BY_KEY["declared:ground_speed=kt"].factors["ground_speed"] == pytest.approx(1 / 0.514444, rel=1e-5)


def drive(traction: float, scale: float, resistance: float, lacking: tuple[str, ...]) -> Evidence:
    """A wheel that brakes and drives, without noise."""
    time = np.arange(400) / 20
    rim, slip = 3 + 1.5 * np.sin(time / 3), 0.1 + 0.2 * np.sin(time)
    load = 4000 + 300 * np.sin(2.1 * time)
    torque = traction * np.tanh(slip / scale) + 0.03 * np.sin(5 * time)
    pull = torque - resistance - 0.05 * slip + 0.02 * np.cos(4 * time)
    channels = {
        "ground_speed": rim * (1 - np.maximum(slip, 0)) / (1 + np.minimum(slip, 0)),
        "wheel_speed": rim / 0.47,
        "vertical_load": load,
        "drawbar_pull": pull * load,
        "driving_torque": torque * load * 0.47,
    }
    measured = {role: values for role, values in channels.items() if role not in lacking}
    return Evidence(measured, 0.47, None if lacking else 1700.0, {} if lacking else {"ground_speed": 1.01})


@pytest.mark.parametrize(
    ("ground", "lacking", "log_probabilities"),
    [
        (
            (0.3, 0.03, 0.03),
            (),
            {"unit:vertical_load=lbf": -16.2827, "unit:driving_torque=lbf ft": -20.8416}
            | {"unit:vertical_load=kN,drawbar_pull=kN,driving_torque=kNm": -18.8836}
            | {"unit:vertical_load=kgf": -23.7323, "unit:vertical_load=kN": -33.0407},
        ),
        (
            (0.5, 0.1, 0.15),
            (),
            {"unit:vertical_load=lbf": -18.0263, "unit:driving_torque=lbf ft": -29.5635},
        ),
        ((0.9, 0.3, 0.35), (), {"unit:vertical_load=kgf": -9.9555, "unit:driving_torque=lbf ft": -42.5441}),
        (
            (0.5, 0.1, 0.15),
            ("driving_torque",),
            {"unit:vertical_load=lbf": -6.6367, "unit:vertical_load=kN": -9.7185},
        ),
        ((0.5, 0.1, 0.15), ("vertical_load",), {"unit:driving_torque=lbf ft": -23.1438}),
        (
            (0.5, 0.1, 0.15),
            ("drawbar_pull", "driving_torque"),
            {"unit:vertical_load=lbf": -7.2136, "unit:ground_speed=kt": -11.8311}
            | {"declared:wheel_speed=rpm": -27.5914, "exchanged:ground_speed,wheel_speed": -44.8869},
        ),
    ],
    ids=str,
)
def test_every_density_counts(
    ground: tuple[float, float, float], lacking: tuple[str, ...], log_probabilities: dict[str, float]
) -> None:
    """Probabilities as they were on 2026-11-28: a constant or a sign that changes moves them."""
    ruling = judge(drive(*ground, lacking))
    found = {mend.key: np.log(probability) for mend, probability in ruling.mends}
    assert {key: found.get(key) for key in log_probabilities} == pytest.approx(log_probabilities, abs=5e-3)
    assert ruling.sound + sum(probability for _, probability in ruling.mends) == pytest.approx(1.0)


def test_half_the_prior_is_half_the_odds_of_every_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    def odds() -> dict[str, float]:
        ruling = judge(drive(0.5, 0.1, 0.15, ()))
        return {mend.key: probability / ruling.sound for mend, probability in ruling.mends}

    whole = odds()
    monkeypatch.setattr(densities, "MEND_PRIOR", densities.MEND_PRIOR / 2)
    assert odds() == pytest.approx({key: one / 2 for key, one in whole.items()}, rel=1e-9, abs=0)
