"""Isolated values that nothing on wheels can reach are found, named and excluded; what is sound is kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fault_support import LOADS, ROLES, facts_of, found, recording
from referee_world import WAYS, World, sound_world
from synthetic_run import RADIUS_M, channel, forces, speeds, stamps, vehicle

from daq import BoolArray, Channel, FloatArray
from processing.pipeline import process
from processing.pipeline.spikes import spikes
from wheelsoil.wording.notes import note_text
from wheelsoil.workflows.grading import doubted_runs

SPEEDS_MPS = (0.5, 1.0, 2.0, 4.0, 8.0, 15.0)
SHARE = 0.003


def spiked(rng: np.random.Generator, values: FloatArray, size: float) -> tuple[FloatArray, BoolArray]:
    """Return values with 0.3 % of spikes of a size, and which."""
    bad = rng.random(len(values)) < SHARE
    bad[[0, -1]] = False
    bad[rng.integers(1, len(values) - 1)] = True
    return np.where(bad, size * rng.uniform(1, 1.1, len(values)), values), bad


def size_of(role: str, values: FloatArray, radius_m: float, speed_mps: float) -> float:
    """20 m/s, or twice as fast as the vehicle; of a force three times its usual size."""
    fast = max(20.0, 2 * speed_mps)
    return {"ground_speed": fast, "wheel_speed": fast / radius_m}.get(
        role, -3 * float(np.quantile(np.abs(values), 0.98))
    )


def counted(worlds: list[tuple[World, float]], role: str) -> tuple[int, int, int, int]:
    """Return spikes found, spikes, sound samples lost, and samples; no other channel loses any."""
    counts = np.zeros(4, int)
    for seed, (world, speed_mps) in enumerate(worlds):
        one, wheel = world.channels[role], world.vehicle.wheel
        assert wheel is not None
        size = size_of(role, one.values, wheel.radius_m, speed_mps)
        values, wrong = spiked(np.random.default_rng(seed), one.values, size)
        bad, faults = found(world.channels | {role: replace(one, values=values)}, world.vehicle)
        assert faults <= {(role, "spike")}, (seed, faults)
        assert not any(rows.any() for other, rows in bad.items() if other != role)
        counts += ((bad[role] & wrong).sum(), wrong.sum(), (bad[role] & ~wrong).sum(), len(wrong))
    return tuple(counts.tolist())


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize(
    "speed_mps", [pytest.param(v, marks=[pytest.mark.slow] * (v not in (0.5, 4.0))) for v in SPEEDS_MPS]
)
def test_spikes_are_found_at_every_speed(role: str, speed_mps: float) -> None:
    """Every way of driving; 1 Hz channels held are among them."""
    worlds = [
        (sound_world(np.random.default_rng(500 + seed), way=way, speed_mps=speed_mps), speed_mps)
        for seed, way in enumerate(WAYS)
    ]
    right, spikes_there, lost, samples = counted(worlds, role)
    print(f"{role} at {speed_mps} m/s: {right} of {spikes_there} found, {lost} of {samples} sound lost")
    assert right >= 0.95 * spikes_there and lost <= 0.01 * samples


@pytest.mark.parametrize("role", ROLES)
def test_spikes_are_found_in_recordings(role: str) -> None:
    worlds = []
    for soil, number in (("clay", 0), ("sandy", 1), ("sandy", 4)):
        run, channels = recording(soil, number)
        worlds.append((World(channels, run.vehicle), 4.0))
    right, spikes_there, lost, samples = counted(worlds, role)
    assert right >= 0.95 * spikes_there and lost <= 0.01 * samples


@pytest.mark.parametrize("role", ["ground_speed", "wheel_speed"])
def test_spikes_do_not_move_the_slip(role: str) -> None:
    """It was -0.003 for 0.035 with 20 m/s in 0.3 % of the samples."""
    run, channels = recording("clay", 0)
    one = channels[role]
    values, wrong = spiked(np.random.default_rng(1), one.values, 20.0 if role == "ground_speed" else 20.0 / RADIUS_M)
    sound = process(channels, run.vehicle, run.info)
    changed = process(channels | {role: replace(one, values=values)}, run.vehicle, run.info)
    [note] = [note for note in changed.quality.notes if note.code == "sensor_fault"]
    assert facts_of(changed)[role, "spike"]["share"] == pytest.approx(wrong.mean(), rel=0.1)
    assert "jumps and comes back at once" in note_text(note)
    both = sound.used & changed.used
    assert np.median(changed.slip[both]) == pytest.approx(np.median(sound.slip[both]), abs=0.001)
    assert both.sum() > 0.9 * sound.used.sum()


@pytest.mark.parametrize("count", [3, 12])
def test_isolated_values_are_said_of_every_run(count: int) -> None:
    """Also by `diagnose`, which prints what is doubted; of values that stand apart one is named, not their middle."""
    run, channels = recording("clay", 0)
    one = channels["vertical_load"]
    values = one.values.copy()
    values[np.linspace(100, len(values) - 100, count).astype(int)] = np.resize([-52090.0, 68370.0], count)
    found = process(channels | {"vertical_load": replace(one, values=values)}, run.vehicle, run.info)
    assert doubted_runs([found]) == ["run-1: isolated values excluded of vertical_load"]
    facts = [facts for (_, kind), facts in facts_of(found).items() if kind in ("mark", "spike")]
    assert sum(int(str(each["count"])) for each in facts) == count
    assert all(each["value"] in (-52090.0, 68370.0) for each in facts)


def test_a_spike_beside_an_invalid_fix_is_found() -> None:
    """The receiver's own word comes first: then its speed is looked at when all of it is there."""
    channels = speeds(40.0, 0.1)
    one = channels["ground_speed"]
    at = np.arange(len(one))
    values = np.where(at % 100 == 50, 20.0 + 1e-3 * at, np.where(at % 200 == 101, 0.0, one.values))
    channels |= {"ground_speed": replace(one, values=values)}
    channels["ground_speed_valid"] = replace(one, name="ground_speed_valid", values=1.0 * (at % 200 != 101))
    run = process(channels, vehicle())
    assert facts_of(run)["ground_speed", "spike"]["value"] == pytest.approx(20.4, abs=0.1)
    assert facts_of(run)["ground_speed", "spike"]["share"] == pytest.approx(0.01)
    assert np.nanmax(run.ground_speed_mps) < 6


@pytest.mark.parametrize(
    ("role", "usual", "spike"),
    [
        ("sinkage", 0.08, 0.5),
        ("tyre_pressure", 2e5, 1e6),
        ("yaw_rate", 0.2, 3.0),
        ("pitch", 0.05, -0.6),
        ("steering_angle", 0.2, 1.5),
        ("longitudinal_acceleration", 1.0, 90.0),
    ],
)
def test_spikes_of_other_channels_are_found(role: str, usual: float, spike: float) -> None:
    rng = np.random.default_rng(2)
    at = stamps(40.0, 50.0)
    values = usual * (1 + 0.2 * np.sin(at) + 0.02 * rng.standard_normal(len(at)))
    values, wrong = spiked(rng, values, spike)
    bad, faults = found(speeds(40.0, 0.1) | {role: channel(role, at, values)}, vehicle())
    assert faults == {(role, "spike")}
    assert (bad[role] == wrong).all()


@pytest.mark.parametrize("role", LOADS)
@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 1000.0])
def test_spikes_of_forces_are_found_at_every_rate(role: str, rate_hz: float) -> None:
    rng = np.random.default_rng(3)
    channels = speeds(40.0, 0.1) | forces(40.0, rate_hz, rng)
    values, wrong = spiked(rng, channels[role].values, 5e4)
    bad, _ = found(channels | {role: replace(channels[role], values=values)}, vehicle())
    assert (bad[role] == wrong).all()


def test_a_shock_beyond_what_throws_a_wheel_up_is_no_shock() -> None:
    rng = np.random.default_rng(4)
    channels: dict[str, Channel] = speeds(40.0, 0.1) | forces(40.0, 200.0, rng)
    for role in (*LOADS, "driving_torque"):
        values = channels[role].values.copy()
        values[[1000, 3000]] = [1e6, -1e6]
        channels[role] = replace(channels[role], values=values)
    assert {role for role, kind in found(channels, vehicle())[1] if kind == "spike"} == {*LOADS, "driving_torque"}


@pytest.mark.parametrize(("lasting", "is_spike"), [(1, True), (20, False)])
def test_a_wheel_may_spin_for_a_while(lasting: int, is_spike: bool) -> None:
    """In 10 ms no rim gains and loses 5 m/s, in 0.2 s it does."""
    channels = speeds(40.0, 0.1)
    values = channels["wheel_speed"].values.copy()
    values[2000 : 2000 + lasting] += 5.0 / RADIUS_M
    wheel = replace(channels["wheel_speed"], values=values)
    assert spikes({"wheel_speed": (wheel.time_ns, values)}, RADIUS_M)["wheel_speed"].any() == is_spike


def test_brakes_of_a_slow_receiver_are_sound() -> None:
    """At 1 Hz a vehicle may lose 6 m/s and gain them again between three samples."""
    at = np.arange(60.0)
    values = 8 + 0.1 * np.sin(at)
    for size, is_spike in ((-5.0, False), (-7.5, True)):
        changed = np.where(at == 30, values + size, values)
        one = channel("ground_speed", at, changed)
        assert spikes({"ground_speed": (one.time_ns, changed)}, RADIUS_M)["ground_speed"].any() == is_spike


def test_samples_of_one_instant_are_kept() -> None:
    values = np.sin(np.arange(50.0)) + 100.0 * (np.arange(50) == 20)
    series = {role: (np.full(50, 10**18), values) for role in ROLES}
    assert set(spikes(series, RADIUS_M)) == set(ROLES)
