from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_run import channel, stamps

from daq.config import TransducerSection
from processing.pipeline import wheel_angle
from processing.pipeline.wheel_frames import interpolate_angle, rotate, to_vehicle_axes

angles = st.floats(-20.0, 20.0)
force = st.floats(-2e4, 2e4)
sides = st.sampled_from(["left", "right"])
directions = st.sampled_from([1, -1])


def _in_wheel_axes(
    fx: np.ndarray, fz: np.ndarray, rolled: np.ndarray, transducer: TransducerSection
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return F_x', F_z' and the encoder's reading of forces that act on the wheel."""
    x = fx * np.cos(rolled) - fz * np.sin(rolled)
    z = fx * np.sin(rolled) + fz * np.cos(rolled)
    reading = transducer.angle_direction * rolled + np.radians(transducer.angle_offset_deg)
    return (-x if transducer.side == "right" else x), z, np.mod(reading, 2 * np.pi)


@given(force, force, angles, sides, directions, st.floats(-360, 360))
def test_round_trip(fx: float, fz: float, rolled: float, side: str, direction: int, offset: float) -> None:
    transducer = TransducerSection(frame="wheel", side=side, angle_direction=direction, angle_offset_deg=offset)
    turned = _in_wheel_axes(np.array([fx]), np.array([fz]), np.array([rolled]), transducer)
    back = rotate(*turned, transducer)
    np.testing.assert_allclose(np.ravel(back), [fx, fz], atol=1e-8)
    np.testing.assert_allclose(np.cos(wheel_angle(turned[2], transducer)), np.cos(rolled), atol=1e-9)


def test_a_quarter_turn_forward_brings_x_prime_down() -> None:
    transducer = TransducerSection(frame="wheel")
    fx, fz = rotate(np.array([0.0, 100.0]), np.array([0.0, 0.0]), np.array([0.0, np.pi / 2]), transducer)
    np.testing.assert_allclose(fx, 0.0, atol=1e-12)
    np.testing.assert_allclose(fz, [0.0, -100.0])


def test_angles_are_interpolated_the_short_way_round() -> None:
    at = np.array([0.0, 0.01, 0.02])
    angle = np.mod(np.array([6.2, 6.4, 6.6]), 2 * np.pi)
    between = interpolate_angle(np.array([0.005, 0.015]), at, angle)
    np.testing.assert_allclose(np.mod(between, 2 * np.pi), np.mod([6.3, 6.5], 2 * np.pi))


def _stream(pieces: int, seed: int, transducer: TransducerSection, lost: slice | None = None):
    """Return chunks of a rotating transducer whose angle and F_z' come in another message, and the truth."""
    rng = np.random.default_rng(seed)
    at = stamps(6.0, 1000.0, rng, 0.3)
    later = at + 0.0002
    fx, fz = (lambda t: 900 * np.sin(0.7 * t)), (lambda t: 8000 + 300 * np.sin(0.9 * t))
    rolled = lambda t: 12.0 * t  # noqa: E731
    x_prime, _, _ = _in_wheel_axes(fx(at), fz(at), rolled(at), transducer)
    _, z_prime, reading = _in_wheel_axes(fx(later), fz(later), rolled(later), transducer)
    whole = {"drawbar_pull": (at, x_prime), "vertical_load": (later, z_prime), "wheel_angle": (later, reading)}
    if lost:
        whole["wheel_angle"] = tuple(np.delete(column, lost) for column in whole["wheel_angle"])
    cuts = np.sort(rng.uniform(0, 6, pieces - 1))
    bounds = [-1.0, *cuts, 7.0]
    chunks = []
    for low, high in pairwise(bounds):
        inside = {role: (t >= low) & (t < high) for role, (t, _) in whole.items()}
        chunks.append({role: channel(role, t[inside[role]], v[inside[role]]) for role, (t, v) in whole.items()})
    return chunks, at, fx(at), fz(at)


@given(st.integers(1, 9), st.integers(0, 2**32), sides, directions)
@settings(max_examples=25, deadline=None)
def test_chunks_give_back_the_forces_wherever_they_are_cut(pieces: int, seed: int, side: str, direction: int) -> None:
    transducer = TransducerSection(frame="wheel", side=side, angle_direction=direction, angle_offset_deg=82.09)
    chunks, at, fx, fz = _stream(pieces, seed, transducer)
    out = list(to_vehicle_axes(chunks, transducer))
    for role, truth in (("drawbar_pull", fx), ("vertical_load", fz)):
        values = np.concatenate([chunk[role].values for chunk in out if role in chunk])
        assert len(values) == len(at)
        np.testing.assert_allclose(values[1:-2], truth[1:-2], atol=1.0)  # linear interpolation over 1 ms at 12 rad/s


def test_forces_are_not_rotated_by_an_angle_from_across_a_hole() -> None:
    transducer = TransducerSection(frame="wheel")
    chunks, at, _, _ = _stream(3, 1, transducer, lost=slice(2000, 2100))
    values = np.concatenate(
        [chunk["drawbar_pull"].values for chunk in to_vehicle_axes(chunks, transducer) if "drawbar_pull" in chunk]
    )
    inside = (at > 2.002) & (at < 2.098)
    assert np.isnan(values[inside]).all()
    assert np.isfinite(values[(at < 1.99) | (at > 2.11)][1:-2]).all()


@given(st.integers(0, 2**32), st.floats(-30.0, 30.0))
@settings(max_examples=25, deadline=None)
def test_readings_that_arrive_late_and_in_bursts_make_no_holes(seed: int, speed_radps: float) -> None:
    rng = np.random.default_rng(seed)
    due = stamps(5.0, 1000.0)
    late = np.where(rng.uniform(size=len(due)) < 0.01, rng.uniform(0.005, 0.03, len(due)), 0.0)
    arrived = np.unique(np.maximum.accumulate(due + late))
    at = np.sort(rng.uniform(arrived[0], arrived[-1], 5000))
    found = interpolate_angle(at, arrived, np.mod(speed_radps * arrived, 2 * np.pi))
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * speed_radps * at), atol=1e-9)


def test_an_angle_is_unknown_where_the_wheel_may_have_turned_too_far() -> None:
    usual = np.arange(100) * 0.001
    for apart_s, step_rad, known in ((0.04, 1.0, True), (0.04, 1.6, False), (0.06, 0.1, False)):
        at = np.concatenate([usual, usual + usual[-1] + apart_s])
        reading = np.concatenate([np.zeros(100), np.full(100, step_rad)])
        found = interpolate_angle(np.array([0.0, 0.0505, usual[-1] + apart_s / 2, at[100], at[-1] + 1e-6]), at, reading)
        assert np.isfinite(found).tolist() == [True, True, known, True, False]


def test_an_angle_that_stops_does_not_hold_the_rest_back() -> None:
    transducer = TransducerSection(frame="wheel")
    at = stamps(30.0, 1000.0)
    chunks = []
    for k in range(30):
        part = at[k * 1000 : (k + 1) * 1000]
        chunk = {role: channel(role, part, np.ones(1000)) for role in ("drawbar_pull", "vertical_load")}
        if k < 10:
            chunk["wheel_angle"] = channel("wheel_angle", part, np.zeros(1000))
        chunks.append(chunk)
    out = list(to_vehicle_axes(chunks, transducer))
    last = max(k for k, chunk in enumerate(out[:30]) if "drawbar_pull" in chunk)
    assert last == 29
    assert sum(len(chunk["drawbar_pull"]) for chunk in out if "drawbar_pull" in chunk) == 30_000


def test_torque_turns_round_on_the_right() -> None:
    at = stamps(1.0, 100.0)
    chunk = {"driving_torque": channel("driving_torque", at, np.full(100, 5.0))}
    for side, sign in (("left", 1), ("right", -1)):
        out = next(to_vehicle_axes([chunk], TransducerSection(frame="wheel", side=side)))
        assert out["driving_torque"].values == pytest.approx(sign * 5.0)
