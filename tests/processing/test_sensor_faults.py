"""Values that are no measurement are found, named and excluded; sound channels, coarse and held ones too, keep all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fault_support import LOADS, NODE_NS, ROLES, RUNS, facts_of, found, recording
from hypothesis import given
from hypothesis import strategies as st
from referee_world import sound_world
from synthetic_run import RADIUS_M, channel, forces, speeds, vehicle

from daq import BoolArray, Channel, FloatArray
from daq.config import TransducerSection
from processing import ProcessedRun, Reason, RunCode
from processing.pipeline import process
from processing.pipeline.fault_gate import FaultGate
from processing.pipeline.sensor_faults import moving_at, values_apart
from wheelsoil.wording.notes import note_text

LARGEST = dict(zip(ROLES, (337.0, 68.6, 131_070.0, 131_070.0, 32_767.5), strict=True))
"""65535 (the wheel speed: 32767) times the factor in the DBC of the recordings."""
Damage = Callable[[np.random.Generator, str, FloatArray, FloatArray], BoolArray]
"""Changes values in place; returns which."""


def moving(channels: dict[str, Channel], role: str) -> BoolArray:
    """Return where the vehicle, or for other roles the wheel, moves: at a standstill nothing is hidden."""
    at = channels[role].time_ns.astype(float)
    ground, wheel = (
        np.interp(at, channels[one].time_ns.astype(float), channels[one].values)
        for one in ("ground_speed", "wheel_speed")
    )
    return (ground if role == "ground_speed" else np.maximum(ground, wheel * RADIUS_M)) > 0.7


def drop(rng: np.random.Generator, _: str, time_s: FloatArray, values: FloatArray) -> BoolArray:
    bad = (time_s + rng.uniform(0, 2)) % 2 < 0.5
    values[bad] = 0.0
    return bad


def freeze(rng: np.random.Generator, _: str, time_s: FloatArray, values: FloatArray) -> BoolArray:
    """Hold the last value for 2.5 s in every 10 s."""
    phase = (time_s + rng.uniform(0, 10)) % 10
    bad = phase < 2.5
    last = np.maximum.accumulate(np.where(bad & (np.diff(bad, prepend=False)), np.arange(len(values)), 0))
    values[bad] = values[last[bad]]
    return bad


def clip(_rng: np.random.Generator, _: str, _time_s: FloatArray, values: FloatArray) -> BoolArray:
    """Clip a third at the end that is further from 0."""
    sign = 1.0 if values.max() > -values.min() else -1.0
    limit = np.quantile(sign * values, 0.67)
    bad = sign * values >= limit
    values[bad] = sign * limit
    return bad


def mark(rng: np.random.Generator, role: str, _time_s: FloatArray, values: FloatArray) -> BoolArray:
    bad = rng.random(len(values)) < 1 / 37
    values[bad] = rng.choice([-99999.0, LARGEST[role]])
    return bad


def two_marks(rng: np.random.Generator, role: str, _time_s: FloatArray, values: FloatArray) -> BoolArray:
    bad = rng.random(len(values)) < 1 / 37
    values[bad] = rng.choice([-99999.0, LARGEST[role]], int(bad.sum()))
    return bad


def long_mark(rng: np.random.Generator, _: str, time_s: FloatArray, values: FloatArray) -> BoolArray:
    bad = np.abs(time_s - rng.uniform(5, 30)) < 1.0
    values[bad] = -99999.0
    return bad


def stick(rng: np.random.Generator, _: str, time_s: FloatArray, values: FloatArray) -> BoolArray:
    """Hold the last value for 0.5 s in every 2 s."""
    bad = (time_s + rng.uniform(0, 2)) % 2 < 0.5
    last = np.maximum.accumulate(np.where(bad & ~np.diff(bad, prepend=False), 0, np.arange(len(values))))
    values[:] = values[last]
    return bad


FAULTS = [
    ("dropped", drop, ("ground_speed",)),
    ("frozen", stick, ROLES[:4]),
    ("frozen", freeze, ROLES[:4]),
    ("clipped", clip, LOADS),
    ("mark", mark, ROLES),
    ("mark", two_marks, ROLES),
    ("mark", long_mark, ROLES),
]


@pytest.mark.parametrize(("soil", "number"), RUNS)
def test_a_sound_recording_keeps_all(soil: str, number: int) -> None:
    run, channels = recording(soil, number)
    bad, faults = found(channels, run.vehicle)
    assert not faults and not any(rows.any() for rows in bad.values())


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("kind", "damage", "role"), [(kind, damage, role) for kind, damage, roles in FAULTS for role in roles]
)
def test_faults_are_found_and_sound_samples_kept(kind: str, damage: Damage, role: str, every: int) -> None:
    """Shares over a third of the recordings, or all."""
    counts = np.zeros(4, int)
    for seed in range(0, len(RUNS), every):
        run, channels = recording(*RUNS[seed])
        one = channels[role]
        values = one.values.astype(float)
        wrong = damage(np.random.default_rng(seed), role, (one.time_ns - one.time_ns[0]) * 1e-9, values)
        counted = wrong if kind == "mark" else wrong & moving(channels, role) & (one.values != 0)
        bad, faults = found(channels | {role: replace(one, values=values)}, run.vehicle)
        assert faults <= {(role, kind), (role, "frozen")}
        counts += (int((bad[role] & counted).sum()), int(counted.sum()), int((bad[role] & ~wrong).sum()), len(wrong))
    share, lost = counts[0] / counts[1], counts[2] / counts[3]
    print(f"{damage.__name__} {role}: {share:.1%} of {counts[1]} found, {lost:.2%} of sound samples lost")
    assert share >= 0.95 and lost <= 0.01


def held_for(seconds: float, one: Channel, begin_s: float, step: float) -> Channel:
    """Return a channel, in steps of so much, that keeps one value for some seconds."""
    at = (one.time_ns - one.time_ns[0]) * 1e-9
    values = np.round(one.values / step) * step if step else one.values
    first = int(np.searchsorted(at, begin_s))
    return replace(one, values=np.where((at >= at[first]) & (at < at[first] + seconds), values[first], values))


def frozen_for(seconds: float, role: str, step: float = 0.0) -> ProcessedRun:
    """Return a run of 40 s in which a channel is frozen."""
    run, channels = recording("sandy", 1)
    held = held_for(seconds, channels[role], min(14.0, 39.9 - seconds), step)
    return process(channels | {role: held}, run.vehicle, run.info)


@pytest.mark.parametrize("seconds", [3.0, 8.0, 15.0, 26.0])
@pytest.mark.parametrize("role", ROLES)
def test_what_is_frozen_is_excluded_and_is_no_unit(role: str, seconds: float) -> None:
    run = frozen_for(seconds, role)
    assert list(facts_of(run)) == [(role, "frozen")]
    assert RunCode.IMPLAUSIBLE not in {note.code for note in run.quality.notes}
    assert run.quality.shares["SENSOR_FAULT"] > 0.95 * seconds / 40


def test_a_coarse_torque_that_makes_a_run_impossible_is_frozen() -> None:
    """It has no noise to miss: it is kept, unless the run is sound without it."""
    assert not facts_of(frozen_for(3.0, "driving_torque", 300.0))
    run = frozen_for(26.0, "driving_torque", 300.0)
    assert facts_of(run)["driving_torque", "frozen"]["time_s"] == pytest.approx(26.0, abs=1.0)
    assert RunCode.IMPLAUSIBLE not in {note.code for note in run.quality.notes}
    assert not run.used[(run.time_s > 15) & (run.time_s < 39)].any()


@pytest.mark.parametrize(
    "steps", [{"ground_speed": 0.5, "wheel_speed": 1.0}, {"drawbar_pull": 600.0, "driving_torque": 300.0}]
)
def test_two_coarse_channels_that_only_together_make_a_run_impossible_are_frozen(steps: dict[str, float]) -> None:
    run, channels = recording("sandy", 1)
    (first, second), (one, other) = steps, steps.values()
    held = {first: held_for(15.0, channels[first], 5.0, one), second: held_for(17.0, channels[second], 22.0, other)}
    processed = process(channels | held, run.vehicle, run.info)
    assert list(facts_of(processed)) == [(first, "frozen"), (second, "frozen")]
    assert RunCode.IMPLAUSIBLE not in {note.code for note in processed.quality.notes}


@pytest.mark.parametrize("speed_mps", [0.0, 1.8])
def test_a_speed_that_is_frozen_all_the_time_is_named_first(speed_mps: float) -> None:
    config, channels = recording("sandy", 1)
    one = channels["ground_speed"]
    run = process(channels | {"ground_speed": replace(one, values=np.full(len(one), speed_mps))}, config.vehicle)
    [note] = [note for note in run.quality.notes if note.code == RunCode.IMPLAUSIBLE]
    assert note.values["held"] == {"ground_speed": pytest.approx(40, abs=1)}
    assert "ground speed stays the same for 40" in note_text(note) and "check the sensor" in note_text(note)


# A wheel that bogs down: the ground speed is 0, for a while, while the wheel turns on.
RECEIVERS = {
    "20 Hz": (20.0, 0.0, 0.0),
    "4 Hz": (4.0, 0.0, 0.0),
    "1 Hz, repeated at 10 Hz": (10.0, 1.0, 0.0),
    "1 Hz, repeated at 100 Hz": (100.0, 1.0, 0.0),
    "5 Hz, repeated at 100 Hz": (100.0, 5.0, 0.0),
    "10 Hz, in bursts of 1 s": (10.0, 0.0, 1.0),
    "50 Hz, in bursts of 0.2 s": (50.0, 0.0, 0.2),
    "2 Hz, in bursts of 3 s": (2.0, 0.0, 3.0),
    "1 Hz, repeated, in bursts": (10.0, 1.0, 2.0),
}
"""Samples/s, values/s (0: as many), seconds between bursts (0: none)."""


def bogged(rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, ground and rim speed of a vehicle that bogs down and frees itself, again and again."""
    usual = rng.uniform(0.6, 3.0)
    knots, now = [(0.0, usual)], 0.0
    while now < 40.0:
        for lasting_s, speed in (
            (rng.uniform(1.5, 5.0), usual * rng.uniform(0.8, 1.2)),
            (max(rng.uniform(0.15, 2.0), usual / 4.0), 0.0),
            (rng.uniform(0.3, 5.0), 0.0),
            (max(rng.uniform(0.2, 2.0), usual / 4.0), usual),
        ):
            now += lasting_s
            knots.append((now, speed))
    time_s = np.arange(0, 40.0, 0.01)
    ground = np.interp(time_s, *zip(*knots, strict=True))
    rim = usual * 1.3 + 0.2 * np.sin(0.8 * time_s) + 0.05 * rng.standard_normal(len(time_s))
    return time_s, ground, np.maximum(rim, ground)


def received(
    rng: np.random.Generator, time_s: FloatArray, ground: FloatArray, receiver: str, dead_band: float
) -> Channel:
    """Return a ground speed as a receiver gives it: exactly 0 at rest and within its dead band."""
    rate, own, burst_s = RECEIVERS[receiver]
    at = np.arange(0, time_s[-1], 1 / rate)
    measured = np.floor(at * own) / own if own else at
    noise = 0.02 * rng.standard_normal(len(at))[np.unique(measured, return_inverse=True)[1]]
    values = np.interp(measured, time_s, ground)
    values = np.round(np.where(values > 0, np.maximum(values + noise, 0), 0), 2)
    values[values < dead_band] = 0.0
    turn = np.floor(at / burst_s + 1e-9) if burst_s else 0.0
    return channel("ground_speed", (turn + 1) * burst_s + 0.02 * (at - turn * burst_s) if burst_s else at, values)


@pytest.mark.parametrize("receiver", RECEIVERS)
@pytest.mark.parametrize("dead_band", [0.0, 0.1, 0.3, 0.8])
def test_a_wheel_that_bogs_down_loses_nothing(receiver: str, dead_band: float) -> None:
    for seed in range(8):
        rng = np.random.default_rng(seed)
        time_s, ground, rim = bogged(rng)
        channels = {"ground_speed": received(rng, time_s, ground, receiver, dead_band)}
        if seed % 4:
            channels["wheel_speed"] = channel("wheel_speed", time_s, np.round(rim / RADIUS_M, 2))
        if seed % 2:
            channels |= forces(40.0, 200.0, rng)
        bad, faults = found(channels, vehicle())
        assert not faults and not any(rows.any() for rows in bad.values()), (seed, faults)


def test_a_bogged_run_is_processed_as_it_is() -> None:
    rng = np.random.default_rng(3)
    time_s, ground, rim = bogged(rng)
    channels = forces(40.0, 200.0, rng) | {"wheel_speed": channel("wheel_speed", time_s, rim / RADIUS_M)}
    channels["ground_speed"] = received(rng, time_s, ground, "1 Hz, repeated at 10 Hz", 0.3)
    run = process(channels, vehicle())
    assert not facts_of(run) and "SENSOR_FAULT" not in run.quality.shares
    assert np.nanmax(run.slip) > 0.9 and run.used[run.slip > 0.9].mean() > 0.5


def test_a_dropout_that_lasts_is_kept() -> None:
    channels = speeds(40.0, 0.1)
    for lasting_s, kinds in ((1.9, {("ground_speed", "dropped")}), (2.2, set())):
        at = (channels["ground_speed"].time_ns - channels["ground_speed"].time_ns[0]) * 1e-9
        values = np.where((at > 9) & (at < 9 + lasting_s), 0.0, channels["ground_speed"].values)
        lost = channels | {"ground_speed": replace(channels["ground_speed"], values=values)}
        assert found(lost, vehicle())[1] == kinds


def test_a_tenth_of_the_usual_largest_speed_is_motion() -> None:
    at_ns, speed = np.arange(100), np.where(np.arange(100) < 50, 5.0, np.where(np.arange(100) < 75, 0.6, 0.4))
    assert np.flatnonzero(~moving_at(at_ns, [(at_ns, speed)])).tolist() == list(range(75, 100))


def test_a_stop_is_no_dropout() -> None:
    channels = speeds(40.0, 0.1)
    stopped = {}
    for role, one in channels.items():
        at = (one.time_ns - one.time_ns[0]) * 1e-9
        stopped[role] = replace(one, values=np.where((at > 15) & (at < 16.5), 0.0, one.values))
    assert not found(stopped, vehicle())[1]


@pytest.mark.parametrize(
    ("role", "held"),
    [("driving_torque", 0.0), ("driving_torque", 900.0), ("vertical_load", 0.0), ("drawbar_pull", 0.0)],
)
def test_a_torque_may_be_constant_and_a_force_exactly_0(role: str, held: float) -> None:
    """A clutch is open, a limiter holds, a wheel is lifted, a hitch is slack."""
    rng = np.random.default_rng(5)
    channels = speeds(40.0, 0.1, rng=rng) | forces(40.0, 200.0, rng)
    one = channels[role]
    at = (one.time_ns - one.time_ns[0]) * 1e-9
    for values in (one.values, np.abs(one.values), np.minimum(one.values, held or np.inf)):
        channels[role] = replace(one, values=np.where(at % 8 < 3, held, values))
        assert not found(channels, vehicle())[1]


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("how", ["coarse", "held", "cruise", "smooth"])
def test_coarse_and_held_channels_are_sound(role: str, how: str) -> None:
    """A cruise: accelerated and shaken first, then calm for seconds, so that coarse channels are constant."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        channels = cruise(rng) if how == "cruise" else speeds(40.0, 0.1, rng=rng) | forces(40.0, 200.0, rng)
        if how == "smooth":
            channels = speeds(40.0, 0.1) | forces(40.0, 200.0)
        one = channels[role]
        at, values = (one.time_ns - one.time_ns[0]) * 1e-9, one.values
        step = float(np.std(values)) * rng.uniform(0.02, 0.3)
        if how == "held":
            values = values[np.searchsorted(at, np.floor(at))]
        else:
            values = values + rng.uniform(0, 2) * step * rng.standard_normal(len(values)) * (how == "coarse")
            values = np.round(values / step) * step
        bad, faults = found(channels | {role: replace(one, values=values)}, vehicle())
        assert not faults and not bad[role].any(), (seed, faults)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
@pytest.mark.parametrize("held_s", [0.0, 3.0])
def test_an_interpolated_ground_speed_that_is_frozen_is_found(rate_hz: float, held_s: float) -> None:
    """Between two samples of the receiver it has no noise: its noise is in every fifth value, or every tenth."""
    run, channels = recording("clay", 0)
    one = channels["ground_speed"]
    at_ns = np.arange(one.time_ns[0], one.time_ns[-1], round(1e9 / rate_hz))
    values = np.round(np.interp(at_ns, one.time_ns, one.values), 4)
    at = (at_ns - at_ns[0]) * 1e-9
    values = np.where((at > 15) & (at < 15 + held_s), values[np.searchsorted(at, 15)], values)
    changed = process(channels | {"ground_speed": replace(one, time_ns=at_ns, values=values)}, run.vehicle, run.info)
    found_s = {role: facts["time_s"] for (role, _), facts in facts_of(changed).items()}
    assert found_s == ({"ground_speed": pytest.approx(held_s, abs=0.2)} if held_s else {})


def cruise(rng: np.random.Generator) -> dict[str, Channel]:
    """Return channels that are shaken for 5 s and calm for 5 s, again and again."""
    channels = speeds(40.0, 0.1, rng=rng) | forces(40.0, 200.0, rng)
    for role, one in channels.items():
        at = (one.time_ns - one.time_ns[0]) * 1e-9
        shaken = np.clip(4 - np.abs(at % 10 - 3), 0.02, 1)
        slow = np.std(one.values) * (np.sin(0.7 * at) + 0.5 * rng.standard_normal(len(at)))
        channels[role] = replace(one, values=np.mean(one.values) + shaken * slow)
    return channels


@pytest.mark.parametrize("end", [False, True])
def test_a_coarse_force_at_rest_is_sound(end: bool) -> None:
    """Shaken, its noise is more than its resolution; at rest it is one value, or flickers at the end of its range."""
    rng = np.random.default_rng(9)
    channels = speeds(40.0, 0.1, rng=rng) | forces(40.0, 200.0, rng)
    for role in ("ground_speed", "wheel_speed", "drawbar_pull"):
        one = channels[role]
        at = (one.time_ns - one.time_ns[0]) * 1e-9
        values = one.values
        if role == "drawbar_pull":
            quiet = np.round(1200 - np.abs(rng.normal(0, 1, len(at)))) * 10 if end else np.full(len(at), 5000.0)
            values = np.where(at < 15, quiet, np.round(5000 + values / 10 + rng.normal(0, 30, len(at)), -1))
        channels[role] = replace(one, values=values * (at >= 15) if role != "drawbar_pull" else values)
    assert not found(channels, vehicle())[1]


def test_a_coarse_cruise_is_sound() -> None:
    """Many steps while the speed changes, none in a cruise, in which the slip changes."""
    at = np.arange(0, 60, 0.01)
    rim = np.interp(at % 15, [0, 4, 7, 12, 15], [1, 4, 4, 1, 1])
    ground = rim * (1 - 0.2 * (1 + np.sin(at))) + 0.01 * np.random.default_rng(4).standard_normal(len(at))
    coarse = channel("wheel_speed", at, np.round(rim / RADIUS_M, 1))
    assert not found({"wheel_speed": coarse, "ground_speed": channel("ground_speed", at, ground)}, vehicle())[1]


def test_a_channel_below_4_hz_is_never_frozen() -> None:
    for rate_hz, kinds in ((3.0, set()), (6.0, {("ground_speed", "frozen")})):
        rng = np.random.default_rng(8)
        channels = speeds(80.0, 0.1, ground_rate_hz=rate_hz)
        one = channels["ground_speed"]
        values = one.values + 0.1 * rng.standard_normal(len(one))
        still = np.abs(np.arange(len(one)) / rate_hz - 42.0) < 3.0
        values[still] = values[still][0]
        assert found(channels | {"ground_speed": replace(one, values=values)}, vehicle())[1] == kinds


@pytest.mark.parametrize("seed", range(6))
def test_a_sound_world_loses_nothing(seed: int) -> None:
    world = sound_world(np.random.default_rng(400 + seed))
    bad, faults = found(world.channels, world.vehicle)
    assert not faults and not any(rows.any() for rows in bad.values())


@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_shock_is_no_mark(times: int) -> None:
    """It shakes every force, the sender repeats it, and another one follows."""
    rng = np.random.default_rng(times)
    channels = speeds(40.0, 0.1, rng=rng) | forces(40.0, 200.0, rng)
    for role, size in (("vertical_load", 9e4), ("drawbar_pull", 9e3), ("driving_torque", 9e3)):
        values = channels[role].values.copy()
        values[1000 : 1000 + times] = values[3000 : 3000 + times] = size
        channels[role] = replace(channels[role], values=values)
    assert not found(channels, vehicle())[1]


@given(st.lists(st.floats(20, 50), min_size=10, max_size=50, unique=True), st.integers(1, 3))
def test_only_values_far_from_all_others_stand_apart(values: list[float], times: int) -> None:
    assert values_apart(np.array(values)) == []
    several = np.array([*values, *[-99999.0] * times, *[65535.0] * times])
    assert set(values_apart(several)) == {-99999.0, 65535.0}
    assert values_apart(np.array([*values[:9], -99999.0, -99999.0])) == []


def test_a_piece_of_marks_only_and_positions() -> None:
    rng = np.random.default_rng(7)
    values = np.round(rng.normal(8000, 100, 210_000))
    values[::50] = values[70_000:140_000] = -99999.0
    load = channel("vertical_load", np.arange(210_000) * 1e-3, values)
    position = replace(load, name="latitude")
    gate = FaultGate(NODE_NS, vehicle())
    pieces = [
        {role: replace(one, time_ns=one.time_ns[cut], values=one.values[cut]) for role, one in channels.items()}
        for channels in ({"vertical_load": load, "latitude": position},)
        for cut in (slice(0, 70_000), slice(70_000, 140_000), slice(140_000, 210_000))
    ]
    sound = list(gate.without_faults(pieces))
    assert [int((one["vertical_load"].values < 0).sum()) for one in sound] == [0, 0, 0]
    assert sum(len(one["vertical_load"]) for one in sound) == int((values > 0).sum())
    assert sum(len(one["latitude"]) for one in sound) == len(values)


def test_what_is_apart_at_rest_may_be_measured_later() -> None:
    rng = np.random.default_rng(7)
    rest = np.abs(np.round(rng.normal(0, 0.05, 70_000), 2))
    rest[[100, 200, 300, 400]] = 5.0
    speed = channel("wheel_speed", np.arange(140_000) * 1e-3, np.append(rest, np.round(rng.uniform(3, 8, 70_000), 2)))
    pieces = [
        {"wheel_speed": replace(speed, time_ns=speed.time_ns[cut], values=speed.values[cut])}
        for cut in (slice(0, 70_000), slice(70_000, 140_000))
    ]
    assert [len(one["wheel_speed"]) for one in FaultGate(NODE_NS, vehicle()).without_faults(pieces)] == [69_996, 70_000]


@pytest.mark.parametrize("frame", ["vehicle", "wheel"])
def test_marks_are_found_before_axes_are_turned(frame: str) -> None:
    rng = np.random.default_rng(7)
    channels = speeds(30.0, 0.1, rng=rng) | forces(30.0, 1000.0, rng)
    pull = channels["drawbar_pull"]
    at = (pull.time_ns - pull.time_ns[0]) * 1e-9
    channels["wheel_angle"] = channel("wheel_angle", at, np.mod(7.0 * at, 2 * np.pi))
    wrong = (rng.random(len(at)) < 0.02) | (np.abs(at - 15) < 0.6)
    bad = channels | {"drawbar_pull": replace(pull, values=np.where(wrong, -99999.0, pull.values))}
    config = vehicle(transducer=TransducerSection.model_validate({"frame": frame}))
    whole, run = process(channels, config), process(bad, config)
    assert set(facts_of(run)) == {("drawbar_pull", "mark")}
    assert set(run.reason[np.abs(run.time_s - 15) < 0.4]) == {Reason.SENSOR_FAULT}
    for name in ("drawbar_pull_n", "vertical_load_n"):
        assert np.abs(getattr(run, name) - getattr(whole, name))[run.used].max() < 100.0


def test_invalid_fixes_are_the_receivers_word() -> None:
    """Marks that the receiver calls invalid are no fault; it may give one that it calls valid."""
    run, channels = recording("clay", 1)
    speed = channels["ground_speed"]
    flags = np.ones(len(speed))
    values = speed.values.copy()
    flags[100:200], values[100:200] = 0.0, LARGEST["ground_speed"]
    valid = channels | {
        "ground_speed": replace(speed, values=values),
        "ground_speed_valid": replace(speed, name="ground_speed_valid", values=flags),
    }
    processed = process(valid, run.vehicle, run.info)
    assert not facts_of(processed) and "INVALID_FIX" in processed.quality.shares
    values[300:700:20] = LARGEST["ground_speed"]
    processed = process(valid, run.vehicle, run.info)
    assert facts_of(processed)["ground_speed", "mark"]["share"] == pytest.approx(20 / len(speed))


@pytest.mark.parametrize(
    ("role", "kind", "damage"),
    [("ground_speed", "dropped", drop), ("vertical_load", "clipped", clip), ("drawbar_pull", "frozen", freeze)],
)
def test_a_fault_is_noted_and_what_is_left_was_measured(role: str, kind: str, damage: Damage) -> None:
    run, channels = recording("clay", 0)
    one = channels[role]
    values = one.values.astype(float)
    wrong = damage(np.random.default_rng(0), role, (one.time_ns - one.time_ns[0]) * 1e-9, values)
    sound = process(channels, run.vehicle, run.info)
    processed = process(channels | {role: replace(one, values=values)}, run.vehicle, run.info)
    [facts] = facts_of(processed).values()
    assert (facts["role"], facts["kind"]) == (role, kind)
    share = float(np.mean(wrong & moving(channels, role)))
    assert 0.95 * share < float(str(facts["share"])) < 1.01 * np.mean(wrong)
    assert facts["time_s"] == pytest.approx(40.0 * float(str(facts["share"])), rel=0.02)
    [note] = [n for n in processed.quality.notes if n.code is RunCode.SENSOR_FAULT]
    assert role in note_text(note) and "excluded" in note_text(note)
    assert processed.quality.shares["SENSOR_FAULT"] > 0.4 * share
    used = processed.used & sound.used
    assert used.sum() > 0.4 * sound.used.sum()
    field = {"ground_speed": "ground_speed_mps", "vertical_load": "vertical_load_n", "drawbar_pull": "drawbar_pull_n"}
    before, after = (getattr(which, field[role]) for which in (sound, processed))
    assert np.quantile(np.abs(after - before)[used], 0.9) < 0.1 * np.std(before[sound.used])
