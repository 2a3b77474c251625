"""What a campaign draws: spectra of its noise, ranges of its world, and foreign wheels."""

from __future__ import annotations

import itertools
from csv import DictReader
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from blind.colour import REAL_FORCES, REAL_SPEED, Colour, drawn_forces, drawn_speed
from blind.field import driven, field_day
from blind.folders import terrain_config
from blind.foreign import FOREIGN, ResistiveWheel, by_table, resistive_stress
from blind.granular import LOADS_N, RADIUS_M, GranularWheel, soil_of_terrain
from blind.ground import LABORATORY
from blind.mix import Case, with_outboard_mass
from blind.sensors import drawn_noise
from blind.standing import towed
from blind.test_blind_rim import moments
from blind.wheel import YANG, Physics, Vehicle, soil_forces
from blind.world import World, carried, drawn_world
from scipy.signal import welch
from support import data_dir

THREE = Colour(((0.5, 0.1), (0.3, 1.0), (0.15, 5.0), (0.05, 0.0)))


@cache
def worlds() -> list[World]:
    return [drawn_world(np.random.default_rng(seed)) for seed in range(300)]


def correlation_of(noise: np.ndarray, lags: list[int]) -> np.ndarray:
    """Return the correlation of a long record with mean 0."""
    return np.array([np.mean(noise[: len(noise) - lag] * noise[lag:]) for lag in lags])


@pytest.mark.parametrize("colour", [Colour(((1.0, 0.3),)), THREE, REAL_FORCES, REAL_SPEED])
def test_noise_has_the_variance_and_the_correlation_of_its_colour(colour: Colour) -> None:
    rate_hz = 100.0
    noise = np.concatenate([colour.drawn(200_000, rate_hz, np.random.default_rng(seed)) for seed in range(3)])
    lags = [5, 20, 50, 100, 300]
    assert np.var(noise) == pytest.approx(1.0, abs=0.05)
    expected = colour.correlation(np.array(lags) / rate_hz)
    assert np.allclose(correlation_of(noise, lags), expected, atol=0.05)
    assert colour.correlation(np.zeros(1))[0] == pytest.approx(1.0 - colour.white)


@pytest.mark.parametrize("colour", [REAL_FORCES, REAL_SPEED])
def test_real_spectra_come_out_of_the_noise(colour: Colour) -> None:
    noise = colour.drawn(400_000, 100.0, np.random.default_rng(1))
    frequency, power = welch(noise, 100.0, nperseg=8192)
    known, expected = np.array(colour.spectrum[:-1]).T  # the last is the edge
    found = np.exp(np.interp(np.log(known), np.log(frequency[1:]), np.log(power[1:])))
    ratio = found / expected
    assert np.allclose(ratio / np.median(ratio), 1.0, atol=0.35)
    assert power[frequency > 1.8 * known[-1]].max(initial=0.0) < 1e-3 * power[1:].max()


def test_memories_are_two_or_three_and_white_and_their_shares_are_one() -> None:
    drawn = [drawn_forces(np.random.default_rng(seed)) for seed in range(200)]
    assert 0.15 < sum(colour == REAL_FORCES for colour in drawn) / 200 < 0.35
    mixed = [colour.memories for colour in drawn if colour.memories]
    assert {len(memories) for memories in mixed} == {3, 4}
    for memories in mixed:
        assert sum(share for share, _ in memories) == pytest.approx(1.0)
        for (_, memory), (low, high) in zip(memories[:-1], ((0.05, 0.2), (0.5, 1.5), (3.0, 8.0)), strict=False):
            assert low <= memory <= high
        assert memories[-1][1] == 0.0
    speeds = [drawn_speed(np.random.default_rng(seed)) for seed in range(200)]
    memories_s = [colour.memories[0][1] for colour in speeds if colour.memories]
    assert min(memories_s) < 0.15
    assert 3.5 < max(memories_s) <= 4.0


def test_students_noise_has_heavy_tails_and_the_same_variance() -> None:
    rng = np.random.default_rng(2)
    plain, heavy = (
        np.concatenate([drawn_noise(THREE, 4000, 100.0, 2.0, rng, tails) for _ in range(60)]) for tails in (0.0, 4.0)
    )
    assert np.std(plain) == pytest.approx(2.0, rel=0.1)
    assert np.std(heavy) == pytest.approx(2.0, rel=0.2)
    assert np.mean(np.abs(heavy) > 8) > 5 * np.mean(np.abs(plain) > 8)


@pytest.mark.slow
def test_worlds_fill_the_ranges_that_the_study_asks_for() -> None:
    radii = [world.vehicle.radius_m for world in worlds()]
    assert 0.15 <= min(radii) < 0.18
    assert 0.57 < max(radii) <= 0.6
    assert {world.runs for world in worlds()} == set(range(3, 13))
    assert min(world.duration_s for world in worlds()) == 15
    assert max(world.duration_s for world in worlds()) == 60
    assert {world.soil for world in worlds()} == set(LABORATORY)
    assert {world.tails for world in worlds()} == {0.0, 4.0}
    assert 0.025 < max(world.lost for world in worlds()) <= 0.03
    assert min(world.lost for world in worlds()) == 0.0
    masses = [world.vehicle.outboard_kg for world in worlds()]
    assert 0.15 < sum(mass == 0 for mass in masses) / len(masses) < 0.35
    assert 120 < max(masses) <= 150


def test_the_soil_carries_the_wheel_in_every_world() -> None:
    for world in worlds()[::10]:
        ground, vehicle = LABORATORY[world.soil], world.vehicle
        most = carried(ground, vehicle.radius_m, vehicle.width_m, 0.3 * vehicle.radius_m)
        least = carried(ground, vehicle.radius_m, vehicle.width_m, 0.03 * vehicle.radius_m)
        assert least - 1 < vehicle.loads_n[0] < most + 1
        assert vehicle.loads_n[1] / vehicle.loads_n[0] == pytest.approx(1.375, rel=1e-3)
        assert vehicle.outboard_kg <= 0.18 * vehicle.loads_n[0] / 9.8
        assert np.isfinite(towed(ground, vehicle.loads_n[2], vehicle)).all()


def test_a_seed_draws_one_world_and_another_seed_another() -> None:
    assert Case("null", 3).world == Case("null", 3).world
    assert Case("null", 3).world != Case("null", 4).world


def test_a_wheel_that_may_hide_a_slope_has_an_outboard_mass() -> None:
    bare = replace(World(), vehicle=replace(YANG, outboard_kg=0.0, outboard_kgm2=0.0))
    heavier = with_outboard_mass(bare).vehicle
    assert 40 < heavier.outboard_kg < 60
    assert heavier.outboard_kgm2 > 0
    assert with_outboard_mass(World()) == World()


def test_short_runs_are_driven_braked_and_stand_at_both_ends() -> None:
    world = World("dry sand", Vehicle(0.3, 0.2, 0.0, 0.0, 1100.0, (2500.0, 3400.0, 4100.0), 0.9), 3, 15.0)
    for seed in range(5):
        day = field_day("dry sand", (4, seed), world=world)
        assert len(day.plans) == 3
        for m in day.moments:
            assert len(m.time_s) == 15 * 200
            assert (m.speed[:200] == 0).all()
            assert (m.speed[-100:] == 0).all()
            rolling = m.slip[m.speed > 0.3]
            assert rolling.max() > 0.75
            assert rolling.min() < -0.1
            assert np.abs(m.acceleration).max() < 4.0


def test_frames_are_lost_together_and_as_often_as_drawn() -> None:
    day = field_day("clay", (6, 1), world=World(runs=1, duration_s=30.0, lost=0.03))
    [channels] = driven(day, [])
    [whole] = driven(replace(day, world=World(runs=1, duration_s=30.0)), [])
    pull, load = channels["drawbar_pull"], channels["vertical_load"]
    assert np.array_equal(pull.time_ns, load.time_ns)
    assert 1 - len(pull.time_ns) / len(whole["drawbar_pull"].time_ns) == pytest.approx(0.03, abs=0.006)


def test_forces_and_noise_go_with_the_vehicles_size() -> None:
    vehicle = replace(YANG, radius_m=0.235, loads_n=(2000.0, 2750.0, 3250.0))
    day = field_day("clay", (6, 1), "fjord")
    small = World(vehicle=vehicle).instruments(day.vendor.suite)
    own = World().instruments(day.vendor.suite)
    assert small.pull_n == pytest.approx(own.pull_n / 4)
    assert small.torque_nm == pytest.approx(own.torque_nm / 8)
    assert small.speed_mps == own.speed_mps


def test_resistive_stress_is_one_straight_down_and_greater_for_a_face_that_leads() -> None:
    drag, lift = resistive_stress(np.array([0.0]), np.array([np.pi / 2]))
    assert lift[0] == pytest.approx(1.0)
    assert drag[0] == pytest.approx(0.0, abs=1e-12)
    leading, trailing = (resistive_stress(np.array([tilt]), np.array([np.pi / 4]))[0][0] for tilt in (0.7, -0.7))
    assert leading > 5 * abs(trailing)


def test_a_resistive_wheel_carries_its_load_and_gains_no_energy() -> None:
    wheel = ResistiveWheel(0.3, 0.2, 1e6)
    sinkages = []
    for slip in (-0.4, -0.1, 0.05, 0.3, 0.6, 0.9):
        pull, torque, sinkage = wheel.resultants(slip, 1500.0)
        assert wheel._forces(slip, sinkage)[1] == pytest.approx(1500.0, rel=1e-6)
        ratio = 1 / (1 + slip) if slip < 0 else 1 - slip
        assert torque - pull * ratio * 0.3 > 0  # T omega - Dp V, over omega
        sinkages.append(sinkage)
    assert sinkages[-1] > 1.15 * min(sinkages)  # it digs in


def test_a_wheel_by_its_table_interpolates_and_scales_with_the_soil() -> None:
    physics = by_table(lambda s, w: (w * s, 0.3 * w * s, 0.1 * w**0.5), np.array([500.0, 1000.0, 2000.0]))
    m = moments(np.array([-0.1, 0.25, 0.6]), load_n=1200.0)
    pull, torque, _ = soil_forces(physics, LABORATORY["clay"], m)
    assert np.allclose(pull, 1200.0 * m.slip, rtol=1e-9)
    assert np.allclose(torque, 360.0 * m.slip, rtol=1e-9)
    _, _, twice = soil_forces(physics, LABORATORY["clay"].changed({"stiffness": np.log(1.2 * np.ones(3))}), m)
    _, _, lighter = soil_forces(physics, LABORATORY["clay"], moments(m.slip, load_n=1000.0))
    assert np.allclose(twice, lighter)


def test_a_pressure_limit_makes_the_wheel_sink_until_it_carries_the_load() -> None:
    m = moments(np.array([0.1, 0.4]))
    _, _, rigid = soil_forces(Physics(), LABORATORY["clay"], m)
    _, _, elastic = soil_forces(Physics(most_pa=60e3), LABORATORY["clay"], m)
    assert (elastic > 1.2 * rigid).all()


def test_a_granular_wheel_is_driven_by_its_table() -> None:
    day = Case("foreign", 2, (("granular", 0.0, 1.0),)).day
    assert day.world.vehicle.radius_m == RADIUS_M
    assert min(LOADS_N) < min(day.world.vehicle.loads_n) < max(day.world.vehicle.loads_n) < max(LOADS_N)
    assert min(m.slip.min() for m in day.moments) > GranularWheel.BRAKING_LIMIT - 1e-9
    assert max(m.slip.max() for m in day.moments) < 0.8 + 1e-9
    soil = terrain_config(day.laboratory).soil
    known, _ = soil_of_terrain()
    assert {key: getattr(soil, key) for key in known} == pytest.approx(known)
    at = day.moments[0].at(slice(3000, 3001))
    slip, load = day.moments[0].slip[3000], day.moments[0].load[3000]
    found = soil_forces(day.foreign or Physics(), day.ground, at)
    factor = float(np.asarray(day.ground.factor))  # a stiffer patch carries more at the same shape
    pull, torque, sinkage = GranularWheel().resultants([slip], [load / factor])
    for [value], expected in zip(found, (factor * pull, factor * torque, sinkage), strict=True):
        assert value == pytest.approx(float(expected[0]), rel=0.03, abs=0.3)


@pytest.mark.parametrize(
    "key",
    [pytest.param(key, marks=[pytest.mark.slow] * (key == "resistive_force")) for key in FOREIGN if key != "granular"],
)
def test_foreign_wheels_are_driven_and_are_not_wongs(key: str) -> None:
    campaign = FOREIGN[key].drawn(np.random.default_rng(3))
    vehicle = campaign.world.vehicle
    m = replace(moments(np.array([0.1, 0.3, 0.6, 0.85]), load_n=vehicle.loads_n[1]), vehicle=vehicle)
    m = replace(m, omega=m.omega * YANG.radius_m / vehicle.radius_m)
    own, foreign = (soil_forces(physics, campaign.laboratory, m) for physics in (Physics(), campaign.physics))
    assert all(np.isfinite(values).all() for values in foreign)
    assert np.abs(foreign[0] - own[0]).max() > 0.02 * vehicle.loads_n[1]
    day = Case("foreign", 1, ((key, 0.0, 1.0),)).day
    assert day.foreign is not None


def test_the_spectrum_of_real_forces_is_that_of_the_recordings() -> None:
    folder = data_dir("cmu-terramech-testbed", "pressure_sinkage")
    with (folder / "index.csv").open() as file:
        windows = {row["run"]: (float(row["window_start_s"]), float(row["window_end_s"])) for row in DictReader(file)}
    edges = np.geomspace(0.176, 50.0, 13)
    found = []
    for path in sorted(folder.glob("*_ft.csv")):
        table = np.genfromtxt(path, delimiter=",", names=True)
        first, last = windows[path.stem.removesuffix("_ft")]
        rows = (table["t_s"] >= first) & (table["t_s"] <= last)
        for name in [one for one in table.dtype.names if one[:2] in ("Fx", "Fy")]:
            at = np.linspace(-1, 1, int(rows.sum()))
            force = table[name][rows] - np.polynomial.Legendre.fit(at, table[name][rows], 4)(at)
            frequency, power = welch(force, 100.0, nperseg=512, detrend="linear")
            bands = [power[(frequency >= a) & (frequency < b)].mean() for a, b in itertools.pairwise(edges)]
            found.append(np.array(bands) / np.sum(bands * np.diff(edges)))
    assert len(found) == 30
    expected = np.array(REAL_FORCES.spectrum)[:, 1]
    assert np.allclose(np.median(found, axis=0), expected, rtol=0.25)
