r"""Wheel axes to vehicle axes for a transducer that rotates with the wheel; outboard weight and inertia.

The rotation mixes the forces at wheel frequency, so that it is done at the transducer's own rate and before any filter:

.. math:: F_x = F_x' \cos\psi + F_z' \sin\psi, \qquad F_z = -F_x' \sin\psi + F_z' \cos\psi ,

with psi counted in the sense in which the wheel rolls forward and zero where x' points forward and z' up. On the right
side of the vehicle the y axis of a transducer points outward all the same, so that x' and the torque count the other
way; both are turned round first.

The transducer measures less than the soil gives: weight and inertia of the declared parts between transducer and soil
(mass m_o, inertia I_o about the axle) are added:

.. math:: F_{x,soil} = F_{x,wft} + m_o \dot V, \qquad T_{soil} = T_{wft} - I_o \dot\omega, \qquad
          W_{soil} = W_{wft} + m_o g \ \text{after a spin zero}.

A zero taken with the wheel lifted has the outboard weight in it already, so that W_wft is the ground load; a spin zero
takes the bridges' offsets only. A determination of `wheelsoil zero` that was taken off the run says itself which of the
two it is (`processing.transducer_zero`), whatever ``transducer.zero`` declares of the transducer's own zero.
The derivatives come from the filter at the rate of the time base, before any averaging: after it they would be too
small. Where the run carries an accelerometer, its reading takes the place of dV/dt (`processing.pipeline.motion`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from math import hypot, sqrt
from typing import Literal

import numpy as np

from daq import (
    BRIDGED_INTERVALS,
    STANDARD_GRAVITY_MPS2,
    Channel,
    FloatArray,
    IntArray,
    Note,
    TransducerSection,
    WheelSection,
    sampling_of,
)
from processing import RunCode, in_order, interpolate, merge_equal_stamps, seconds_since
from processing.pipeline.motion import ACCELEROMETERS
from processing.pipeline.resampling import OnBase
from processing.processed_run import GROUND_SPEED, Reason

_ROTATING = ("drawbar_pull", "vertical_load", "wheel_angle")
_LONGEST_TURN_S = 0.05
_QUARTER_RAD = np.pi / 2
_JOIN_FORCE_S = 0.02
"""Longest hole, at the least, that F_z' is joined across; at 10 rad/s a line is wrong by 0.5 % of the force."""
_PATIENCE_NS = 5_000_000_000
"""How long one of the three channels may be away before the others stop waiting for it."""


def at_soil(
    roles: dict[str, OnBase],
    wheel: WheelSection,
    kernel_s: float,
    zero: Literal["lifted", "spin", "none"],
    outboard_role: str = GROUND_SPEED,
) -> tuple[dict[str, OnBase], str, list[Note]]:
    """Return the roles with drawbar pull, torque and load carried from the transducer to the soil, and by which role.

    A force without the speed that it needs stays as the transducer feels it, and a note says so. The slopes of
    ``ground_speed`` and ``wheel_speed`` are the accelerations; that of the outboard mass, which `wheel` declares, comes
    from `outboard_role`: ``ground_speed``, or an accelerometer. The noise of a derivative is that of the value over
    sqrt(2) `kernel_s`, the standard deviation of the filter's kernel. Only after the zero "spin" the outboard weight is
    missing from the zero of the vertical load.
    """
    moved, notes = dict(roles), []
    if "drawbar_pull" not in roles or not wheel.outboard_mass_kg:
        outboard_role = GROUND_SPEED
    if outboard_role != GROUND_SPEED:
        notes.append(Note(RunCode.OUTBOARD_BY_ACCELEROMETER, values={"role": outboard_role}))
    for role, factor, source in (
        ("drawbar_pull", wheel.outboard_mass_kg, outboard_role),
        ("driving_torque", -wheel.outboard_inertia_kgm2, "wheel_speed"),
    ):
        if role not in roles or not factor:
            continue
        if source not in roles:
            notes.append(Note(RunCode.INERTIA_LEFT, values={"role": role, "speed": source}))
            continue
        moved[role] = _compensated(roles[role], factor, roles[source], source, kernel_s)
    if "vertical_load" in roles and zero == "spin":
        load = roles["vertical_load"]
        moved["vertical_load"] = replace(load, values=load.values + wheel.outboard_mass_kg * STANDARD_GRAVITY_MPS2)
    return moved, outboard_role, notes


def _compensated(force: OnBase, factor: float, of: OnBase, source: str, kernel_s: float) -> OnBase:
    """Return a force with `factor` times an acceleration: an accelerometer's reading, or the slope of a speed."""
    read = source in ACCELEROMETERS
    noise = abs(factor) * of.facts.sigma / (1.0 if read else sqrt(2.0) * kernel_s)
    facts = replace(force.facts, sigma=hypot(force.facts.sigma, noise))
    reason = np.where(force.reason == Reason.USED, of.reason, force.reason) if read else force.reason
    return replace(force, values=force.values + factor * (of.values if read else of.slope), reason=reason, facts=facts)


def rotate(
    force_x: FloatArray, force_z: FloatArray, angle_rad: FloatArray, transducer: TransducerSection
) -> tuple[FloatArray, FloatArray]:
    """Turn forces in wheel axes into vehicle axes: forward and up, in N, shape (n,).

    F_x' and F_z' are as the transducer gives them. `transducer` has the side, the angle offset (the encoder's reading
    at psi = 0) and the direction (1: the reading grows when rolling forward).
    """
    psi = wheel_angle(angle_rad, transducer)
    forward = -force_x if transducer.side == "right" else force_x
    cos, sin = np.cos(psi), np.sin(psi)
    return forward * cos + force_z * sin, force_z * cos - forward * sin


def wheel_angle(angle_rad: FloatArray, transducer: TransducerSection) -> FloatArray:
    """Return psi in rad from the encoder's reading."""
    return np.asarray(transducer.angle_direction * (angle_rad - np.radians(transducer.angle_offset_deg)))


def interpolate_angle(at_s: FloatArray, time_s: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Interpolate an angle the short way round; NaN in holes and outside.

    A wheel that weighs something does not jump: what it did between two readings is known where they follow each other
    as usual (1.75 median intervals), or are at most 50 ms apart and differ by less than a quarter of a revolution the
    short way round. In 50 ms a wheel that speeds up by 50 rad/s2 is at most 0.02 rad off the line between them. Frames
    that arrive late, in bursts, so make no holes; lost ones do. Between two readings the wheel must turn less than
    half a revolution, and less than three quarters within 50 ms (94 rad/s): more is not distinguishable from less.

    The readings have shape (k,) and increasing stamps; the result has the shape of `at_s` and is unwrapped.
    """
    if not len(time_s):
        return np.full(len(at_s), np.nan)
    turned = np.unwrap(angle_rad)
    apart_s = np.diff(time_s)
    usual_s = float(np.median(apart_s)) if len(apart_s) else 0.0
    near = (apart_s <= _LONGEST_TURN_S) & (np.abs(np.diff(turned)) < _QUARTER_RAD)
    joined = np.concatenate([[False], near | (apart_s <= BRIDGED_INTERVALS * usual_s), [False]])
    after = np.searchsorted(time_s, at_s)
    known = joined[after] | (time_s[np.minimum(after, len(time_s) - 1)] == at_s)
    return np.where(known, np.interp(at_s, time_s, turned), np.nan)


def merged_angle(time_ns: IntArray, angle_rad: FloatArray) -> tuple[IntArray, FloatArray]:
    """Replace readings that carry the same stamp by their mean the short way round; the result is unwrapped."""
    return merge_equal_stamps(time_ns, np.unwrap(angle_rad))


def to_vehicle_axes(
    chunks: Iterable[Mapping[str, Channel]], transducer: TransducerSection
) -> Iterator[dict[str, Channel]]:
    """Rotate the forces of a stream of chunks; other roles pass through, ``wheel_angle`` ends here.

    The three channels may come in different messages: F_z' and the angle are interpolated at the stamps of F_x', never
    across a hole (of F_z': 20 ms, or 1.75 usual intervals; of the angle: see `interpolate_angle`); where one of them is
    missing the forces are NaN. What cannot be joined yet waits for the next chunk.
    """
    held: dict[str, tuple[IntArray, FloatArray]] = {role: (np.zeros(0, np.int64), np.zeros(0)) for role in _ROTATING}
    for chunk in chunks:
        passed = {role: channel for role, channel in chunk.items() if role not in _ROTATING}
        for role in _ROTATING:
            if role in chunk:
                held[role] = appended(held[role], chunk[role])
        if "driving_torque" in passed and transducer.side == "right":
            torque = passed["driving_torque"]
            passed["driving_torque"] = Channel(torque.name, torque.unit, torque.time_ns, -torque.values)
        newest = [int(time[-1]) if len(time) else 0 for time, _ in held.values()]
        ready_ns = max(min(newest), max(newest) - _PATIENCE_NS)
        passed |= _rotated(held, ready_ns, transducer)
        held = {role: _kept(pair, ready_ns, keep_last=role != "drawbar_pull") for role, pair in held.items()}
        yield passed
    yield _rotated(held, np.iinfo(np.int64).max, transducer)


def _rotated(
    held: dict[str, tuple[IntArray, FloatArray]], until_ns: int, transducer: TransducerSection
) -> dict[str, Channel]:
    """Return both forces at the stamps of F_x' up to `until_ns`."""
    time_ns, force_x = held["drawbar_pull"]
    ready = time_ns <= until_ns
    time_ns, force_x = time_ns[ready], force_x[ready]
    if not len(time_ns):
        return {}
    at_s = seconds_since(time_ns, int(time_ns[0]))
    z_time, force_z = _seconds(held["vertical_load"], int(time_ns[0]))
    a_time_ns, angle = merged_angle(*held["wheel_angle"])
    force_z = interpolate(at_s, z_time, force_z, _join_gap_s(held["vertical_load"][0]))
    angle = interpolate_angle(at_s, seconds_since(a_time_ns, int(time_ns[0])), angle)
    forces = rotate(force_x, force_z, angle, transducer)
    return {
        role: Channel(role, "N", time_ns, values)
        for role, values in zip(("drawbar_pull", "vertical_load"), forces, strict=True)
    }


def _join_gap_s(time_ns: IntArray) -> float:
    return max(BRIDGED_INTERVALS * float(np.nan_to_num(sampling_of(time_ns).spacing_s)), _JOIN_FORCE_S)


def appended(held: tuple[IntArray, FloatArray], channel: Channel) -> tuple[IntArray, FloatArray]:
    """Return stamps and values with the finite samples of a chunk added, in order."""
    finite = np.isfinite(channel.values)
    time_ns = np.concatenate([held[0], channel.time_ns[finite]])
    values = np.concatenate([held[1], channel.values[finite]])
    keep = in_order(time_ns)
    return time_ns[keep], values[keep]


def _kept(pair: tuple[IntArray, FloatArray], until_ns: int, keep_last: bool) -> tuple[IntArray, FloatArray]:
    """Drop what is used up; where `keep_last`, not the last of it: the next interpolation starts from it."""
    start = max(int(np.searchsorted(pair[0], until_ns, side="right")) - keep_last, 0)
    return pair[0][start:], pair[1][start:]


def _seconds(pair: tuple[IntArray, FloatArray], origin_ns: int) -> tuple[FloatArray, FloatArray]:
    time_ns, values = merge_equal_stamps(*pair)
    return seconds_since(time_ns, origin_ns), values
