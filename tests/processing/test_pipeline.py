"""The room's promises, on synthetic channels: delays, one transfer function, gaps, reasons, shares."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from property_settings import examples
from synthetic_run import RADIUS_M, START_NS, channel, driven_speed, forces, speeds, stamps, vehicle

from daq import Channel, RunInfo
from daq.config import SensorSection
from processing import ProcessedRun, ProcessOptions, Reason, Segment
from processing.pipeline import process
from processing.pipeline.inputs import MODEL_ROLES
from wheelsoil.wording.notes import texts_of

ARRAYS = [f.name for f in fields(ProcessedRun) if f.name not in ("run", "quality", "extras")]


def _delayed(channels: dict[str, Channel], delays_ms: dict[str, int]) -> dict[str, Channel]:
    return {
        role: Channel(role, c.unit, c.time_ns + delays_ms.get(role, 0) * 1_000_000, c.values)
        for role, c in channels.items()
    }


@given(st.dictionaries(st.sampled_from(MODEL_ROLES), st.integers(-200, 900), max_size=5))
@examples(20, gate=4)
def test_declared_delays_are_removed_exactly(delays_ms: dict[str, int]) -> None:
    channels = speeds(12.0, 0.2, rng=np.random.default_rng(1), jitter=0.3) | forces(12.0)
    plain = process(channels, vehicle())
    latencies = {role: ms * 1e-3 for role, ms in delays_ms.items()}
    late = process(_delayed(channels, delays_ms), vehicle(latencies))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(late, name), getattr(plain, name), err_msg=name)


def test_an_undeclared_delay_shows_in_the_slip() -> None:
    run = process(speeds(12.0, 0.2, delay_s=0.1), vehicle())
    assert np.std(run.slip[run.used]) > 0.02


@given(st.floats(-0.6, 0.8), st.sampled_from([10.0, 20.0, 50.0, 100.0]), st.integers(0, 2**32))
@examples(25, gate=8)
def test_a_constant_slip_stays_constant_through_accelerations(slip: float, rate: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    run = process(speeds(20.0, slip, rng=rng, jitter=0.2, ground_rate_hz=rate), vehicle())
    assert run.used.mean() > 0.9
    np.testing.assert_allclose(run.slip[run.used], slip, atol=2e-3)
    assert np.ptp(run.ground_acceleration_mps2[run.used]) > 1.5


@given(st.integers(0, 2**32), st.sampled_from(MODEL_ROLES), st.floats(3.0, 14.0), st.floats(0.15, 3.0))
@example(0, "ground_speed", 5.01, 0.1)
@examples(25, gate=5)
def test_nothing_crosses_a_gap_and_the_gap_says_so(seed: int, role: str, start: float, length: float) -> None:
    rng = np.random.default_rng(seed)
    channels = speeds(20.0, 0.1, rng=rng, jitter=0.3) | forces(20.0)
    cut = channels[role]
    at = (cut.time_ns - START_NS) * 1e-9
    keep = (at < start) | (at > start + length)
    moved = np.where(at > start, 1.5 * cut.values + 1.0, cut.values)
    one, other = (
        process(channels | {role: Channel(role, cut.unit, cut.time_ns[keep], v[keep])}, vehicle())
        for v in (cut.values, moved)
    )
    time = one.time_s + (one.start_ns - START_NS) * 1e-9
    before = time < start - 0.1
    name = {"ground_speed": "ground_speed_mps", "wheel_speed": "wheel_speed_radps", "vertical_load": "vertical_load_n"}
    column = name.get(role, {"drawbar_pull": "drawbar_pull_n"}.get(role, "driving_torque_nm"))
    np.testing.assert_array_equal(getattr(one, column)[before], getattr(other, column)[before])
    last, first = at[keep][at[keep] < start][-1], at[keep][at[keep] > start][0]
    inside = (time > last) & (time < first)
    assert np.isnan(getattr(one, column)[inside]).all()
    assert (one.reason[inside] == Reason.GAP).all()
    assert one.quality.sensors[role].gaps == 1
    near = (np.abs(time - start) < 0.05) & ~inside & (one.reason != Reason.GAP)
    assert (one.reason[near & (time < last)] == Reason.FILTER_EDGE).all()


def _messy(seed: int) -> dict[str, Channel]:
    """Return a run with everything wrong at once: gaps, NaN, invalid fixes, standstill, negative load, disorder."""
    rng = np.random.default_rng(seed)

    def speed(at: np.ndarray) -> np.ndarray:
        return np.maximum(driven_speed(at) - 2.2, 0.0)

    channels = speeds(30.0, 0.3, rng=rng, jitter=0.3, speed=speed) | forces(30.0, rng=rng)
    out = {}
    for role, c in channels.items():
        values, time_ns = c.values.copy(), c.time_ns
        low = int(rng.integers(0, len(values)))
        values[low : low + len(values) // 20] = rng.choice([np.nan, np.inf, -1.0, 0.0])
        keep = np.ones(len(values), np.bool_)
        low = int(rng.integers(0, len(values)))
        keep[low : low + len(values) // 30] = False
        order = np.arange(len(values))
        swap = int(rng.integers(1, len(values)))
        order[[swap - 1, swap]] = order[[swap, swap - 1]]
        out[role] = Channel(role, c.unit, time_ns[order][keep[order]], values[order][keep[order]])
    valid = (rng.random(len(out["ground_speed"])) > 0.02).astype(float)
    return out | {"ground_speed_valid": Channel("v", "", out["ground_speed"].time_ns, valid)}


@given(st.integers(0, 2**32))
@examples(30, gate=8)
def test_every_sample_is_used_or_has_a_reason(seed: int) -> None:
    run = process(_messy(seed), vehicle())
    assert sum(run.quality.shares.values()) == pytest.approx(1.0, abs=1e-12)
    assert set(np.unique(run.reason)) <= set(Reason)
    assert run.quality.shares[Reason.USED.name] == pytest.approx(np.mean(run.used))
    for column in ("slip", "slip_sigma", "ground_speed_mps", "wheel_speed_radps", "vertical_load_n"):
        assert np.isfinite(getattr(run, column)[run.used]).all(), column
    for column in ("drawbar_pull_n", "driving_torque_nm", "ground_acceleration_mps2", "distance_m"):
        assert np.isfinite(getattr(run, column)[run.used]).all(), column
    assert (np.abs(run.slip[run.used]) <= 1).all()
    assert (run.vertical_load_n[run.used] > 0).all()
    assert (np.abs(run.ground_speed_sigma_mps) > 0).all()
    for array in ARRAYS:
        value = getattr(run, array)
        assert not isinstance(value, np.ndarray) or value.shape == run.time_s.shape
    standing = run.segment[run.reason == Reason.STANDSTILL]
    assert (standing == Segment.STANDSTILL).all()


def test_each_reason_is_given_where_it_holds() -> None:
    at = stamps(40.0, 100.0)
    speed = np.where(at < 5, 0.0, np.minimum((at - 5) * 0.5, 4.0))
    rim = np.where(at < 35, speed * 1.1, -4.0)
    load = np.where((at > 20) & (at < 22), -50.0, 8000.0)
    pull = np.where((at > 24) & (at < 26), np.nan, 100.0)
    valid = ((at < 28) | (at > 30)).astype(float)
    channels = {
        "ground_speed": channel("v", at, speed),
        "ground_speed_valid": channel("f", at, valid),
        "wheel_speed": channel("w", at, rim / RADIUS_M),
        "vertical_load": channel("W", at, load),
        "drawbar_pull": channel("D", at, pull),
    }
    keep = (at < 32) | (at > 33)
    channels["wheel_speed"] = channel("w", at[keep], rim[keep] / RADIUS_M)
    run = process(channels, vehicle())
    expected = [
        (2.0, Reason.STANDSTILL),
        (5.75, Reason.TOO_SLOW),
        (15.0, Reason.USED),
        (21.0, Reason.NEGATIVE_LOAD),
        (25.0, Reason.NOT_MEASURED),
        (29.0, Reason.INVALID_FIX),
        (32.5, Reason.GAP),
        (33.02, Reason.FILTER_EDGE),
        (37.0, Reason.SLIP_OUT_OF_RANGE),
    ]
    for time, reason in expected:
        assert run.reason[np.searchsorted(run.time_s, time)] == reason, (time, reason)


def test_fixes_that_the_receiver_calls_invalid_leave_no_trace() -> None:
    channels = speeds(20.0, 0.1)
    speed = channels["ground_speed"]
    bad = (np.arange(len(speed)) > 150) & (np.arange(len(speed)) < 190)
    flags = Channel("v", "", speed.time_ns, (~bad).astype(float))
    wild = Channel("s", "", speed.time_ns, np.where(bad, 99.0, speed.values))
    run = process(channels | {"ground_speed": wild, "ground_speed_valid": flags}, vehicle())
    assert np.nanmax(run.ground_speed_mps) < 6.0
    assert run.quality.shares["INVALID_FIX"] == pytest.approx(41 / 400, abs=0.01)
    np.testing.assert_allclose(run.slip[run.used], 0.1, atol=3e-3)


def test_a_run_without_any_valid_fix_is_a_result_not_an_exception() -> None:
    channels = speeds(10.0)
    speed = channels["ground_speed"]
    flags = Channel("v", "", speed.time_ns, np.zeros(len(speed)))
    run = process(channels | {"ground_speed_valid": flags}, vehicle())
    assert not run.used.any()
    assert run.quality.shares["INVALID_FIX"] > 0.95
    assert any("ground_speed" in note for note in texts_of(run.quality.notes))


def test_roles_that_are_not_there_are_not_measured() -> None:
    run = process(speeds(10.0), vehicle(), RunInfo(id="r1"))
    assert run.run.id == "r1"
    for column in ("vertical_load_n", "drawbar_pull_n", "driving_torque_nm", "sinkage_m", "latitude_deg"):
        assert np.isnan(getattr(run, column)).all()
    assert set(run.quality.sensors) == {"ground_speed", "wheel_speed"}
    assert run.used.mean() > 0.9


def test_a_dead_optional_channel_does_not_take_the_run_with_it() -> None:
    at = stamps(10.0, 100.0)
    dead = {"driving_torque": channel("T", at, np.full(len(at), np.nan))}
    run = process(speeds(10.0) | dead, vehicle())
    assert run.used.mean() > 0.9
    assert any(note.startswith("driving_torque: never") for note in texts_of(run.quality.notes))


def test_the_slowest_channel_sets_the_bandwidth_of_all_and_the_run_says_so() -> None:
    run = process(speeds(60.0, ground_rate_hz=2.0), vehicle())
    assert run.cutoff_hz == pytest.approx(0.4)
    assert any("ground_speed comes at 2 Hz" in note for note in texts_of(run.quality.notes))
    asked = process(speeds(60.0, ground_rate_hz=2.0), vehicle(), options=ProcessOptions(cutoff_hz=3.0))
    assert asked.cutoff_hz == pytest.approx(0.4)
    assert any("instead of 3 Hz" in note for note in texts_of(asked.quality.notes))
    assert process(speeds(20.0, ground_rate_hz=100.0), vehicle()).cutoff_hz == 5.0


def test_declared_sigma_goes_into_the_slip() -> None:
    channels = speeds(20.0, 0.2)
    config = vehicle(sensors={"ground_speed": SensorSection(sigma=0.05)})
    run = process(channels, config)
    expected = 0.05 / (run.wheel_speed_radps[run.used] * RADIUS_M)
    np.testing.assert_allclose(run.slip_sigma[run.used], expected, rtol=0.1)
    assert run.quality.sensors["ground_speed"].sigma_source == "declared"


def test_position_and_distance() -> None:
    at = stamps(20.0, 10.0)
    channels = speeds(20.0)
    longitude = np.mod(179.9999 + 1e-5 * at + 180, 360) - 180  # over the date line
    channels |= {"latitude": channel("lat", at, 45 + 1e-5 * at), "longitude": channel("lon", at, longitude)}
    run = process(channels, vehicle())
    time = run.time_s + (run.start_ns - START_NS) * 1e-9
    inside = np.isfinite(run.latitude_deg)
    assert inside.mean() > 0.98
    np.testing.assert_allclose(run.latitude_deg[inside], 45 + 1e-5 * time[inside], atol=1e-9)
    assert np.abs(run.longitude_deg[inside]).min() > 179.9
    speed = driven_speed(time)
    driven = np.concatenate([[0.0], np.cumsum(np.diff(time) * 0.5 * (speed[1:] + speed[:-1]))])
    seen = np.isfinite(run.distance_m)
    assert seen.mean() > 0.99
    np.testing.assert_allclose(run.distance_m[seen], driven[seen], atol=0.03)


def test_no_fix_at_null_island() -> None:
    at = stamps(20.0, 10.0)
    none = (at > 5) & (at < 8)
    channels = speeds(20.0) | {
        "latitude": channel("lat", at, np.where(none, 0.0, 45.0)),
        "longitude": channel("lon", at, np.where(none, 0.0, 7.0)),
    }
    run = process(channels, vehicle())
    assert np.nanmin(run.latitude_deg) > 44
    assert np.isnan(run.latitude_deg).sum() == pytest.approx(310, abs=12)


def test_distance_goes_on_behind_a_gap_and_the_run_says_by_how_much() -> None:
    channels = speeds(30.0, speed=lambda t: np.full_like(t, 2.0))
    speed = channels["ground_speed"]
    keep = np.abs(np.arange(len(speed)) - 300) > 50
    channels["ground_speed"] = Channel("s", "", speed.time_ns[keep], speed.values[keep])
    run = process(channels, vehicle())
    seen = np.isfinite(run.distance_m)
    assert (~seen).sum() > 490
    np.testing.assert_allclose(run.distance_m[seen], 2.0 * run.time_s[seen], atol=0.05)
    assert any("10.2 m were not seen" in note or "10.1 m were not seen" in note for note in texts_of(run.quality.notes))


def test_a_slow_sinkage_sensor_does_not_slow_the_rest() -> None:
    at = stamps(30.0, 2.0)
    run = process(speeds(30.0) | {"sinkage": channel("z", at, 0.1 + 0.002 * at)}, vehicle())
    time = run.time_s + (run.start_ns - START_NS) * 1e-9
    assert run.cutoff_hz == pytest.approx(4.0)
    there = np.isfinite(run.sinkage_m)
    assert there.mean() > 0.97
    np.testing.assert_allclose(run.sinkage_m[there], 0.1 + 0.002 * time[there], atol=1e-6)
    assert run.used.mean() > 0.9


def test_gnss_time_takes_the_jitter_of_arrival_off_the_ground_speed() -> None:
    rng = np.random.default_rng(5)
    at = stamps(60.0, 20.0)
    arrival = at + 0.03 * rng.random(len(at)) ** 3
    channels = speeds(60.0, 0.2)
    jittery = {"ground_speed": channel("s", arrival, driven_speed(at), "m/s")}
    fix = {"gnss_time": channel("t", arrival, 43_200 + at)}
    without, with_time = (process(channels | jittery | extra, vehicle()) for extra in ({}, fix))
    assert with_time.quality.clock["residual_s"] < 0.01
    assert abs(with_time.quality.clock["drift_ppm"]) < 20
    scatter = [np.std(np.diff(run.slip[run.used])) for run in (without, with_time)]
    assert scatter[1] < 0.35 * scatter[0]
    assert without.quality.clock == {}
