"""What the referee looks at in a processed run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import inf, isfinite, log, nan
from typing import Any

import numpy as np

from daq import (
    CHANNELS,
    EARTH_RADIUS_M,
    ROLES,
    STANDARD_GRAVITY_MPS2,
    BoolArray,
    FloatArray,
    Note,
    Severity,
    Use,
    VehicleConfig,
    find_unit,
    known_units,
)
from processing import ProcessedRun, RunCode
from processing.referee.judgement import Evidence, Ruling, is_judged, judge
from processing.referee.mends import BY_KEY, JUDGED_ROLES

_WINDOW_S = 2.0
_LEAST_CHORD_M = 2.0
_LEAST_WINDOWS = 3
_ABOVE_GROUND_M, _LIGHT, _LIKE = 0.02, 0.48, 0.2
"""A sinkage this far above ground is turned; a wheel carries less than half of its share of a mass in pounds."""
_PIECES, _LEAST_MOVED_M, _NEAR = 40, 5.0, 3.0  # of a run; for positions; within this factor distances are alike
_AT_ONCE = ((0, "ground_speed", "km/h", 0.06), (1, "wheel_speed", "rpm", 0.25), (1, "wheel_speed", "deg/s", 0.25))
_EDGE, _EXACT, _CRAWL_MPS = 0.8, 0.06, 0.2
"""Units so large that no vehicle takes up their factor at once, and by how much ln of the speeds may change before and
after (a receiver of 1 Hz has steps). Within so many periods of the filter's frequency, how exactly; slower stands."""
_HELD_S, _LEAST_LEFT = 2.0, 0.1
_ALIKE, _AT_REST = 1e-9, 0.001
"""Shares of a value within which the next is the same, and of the largest, below which one is at rest."""


def plausibility_of(run: ProcessedRun, vehicle: VehicleConfig) -> tuple[list[Note], dict[str, BoolArray]]:
    """Return a note where a mistake of vehicle.toml is more probable than none, and what is frozen in its place.

    The note is a fault where the run is impossible. A channel that keeps one value for seconds is what is impossible
    where the run is sound without them: then there is no note, but their rows, shape (n,), by role.
    """
    if changed := _changed(run):
        return changed, {}
    evidence = evidence_of(run, vehicle)
    ruling = judge(evidence)
    sized = [*_of_wrong_size(run, vehicle), *_stretched(run)]
    if not ruling.doubted:
        return [*sized, *_overloaded(run, vehicle)], {}
    held = _held_rows(evidence.channels, run)
    frozen, whole = _frozen(run, evidence, held)
    if frozen:
        return sized, frozen
    severity = Severity.FAULT if ruling.refused else Severity.DOUBT
    values = _values(run, vehicle, evidence, ruling)
    if whole:
        values |= {"held": whole}
    return [Note(RunCode.IMPLAUSIBLE, severity, values), *sized], {}


def _of_wrong_size(run: ProcessedRun, vehicle: VehicleConfig) -> Iterator[Note]:
    """Yield a note for each channel beyond what is possible; a fault where a model is fitted to it."""
    for channel in (known for known in CHANNELS if known.role in vehicle.signals and isfinite(known.possible[1])):
        least, most = channel.possible
        column = run.column(channel.field)
        size, why = _quantile(np.abs(column), 0.9), ""
        if channel.role == "sinkage" and _quantile(column, 0.9) < -_ABOVE_GROUND_M:
            why = "turned"
        elif channel.role == "latitude" and _in_radians(run):
            why = "radians"
        if why or (isfinite(size) and size and not least <= size <= most):
            stated = find_unit(vehicle.signals[channel.role].unit or "", channel.quantities)
            units = [find_unit(unit, channel.quantities) for unit in known_units(channel.quantities[0])]
            fits = [u.symbol for u in units if u and stated and least <= size * u.factor / stated.factor <= most]
            values = {"role": channel.role, "size": size, "least": least, "most": most, "units": tuple(fits)}
            values |= {"why": why, "signal": vehicle.signals[channel.role].signal}
            yield Note(RunCode.WRONG_SIZE, Severity.FAULT if channel.use is Use.OUTPUT else Severity.DOUBT, values)


def _stretched(run: ProcessedRun) -> list[Note]:
    """Return a fault where a vehicle drives a thousand or a million times as far as its positions move."""
    moved_m = float(np.nansum(_chords(run, max(len(run.ground_speed_mps) // _PIECES, 1))[1]))
    ratio = float(np.nansum(np.abs(run.ground_speed_mps))) / run.rate_hz / moved_m if moved_m > _LEAST_MOVED_M else nan
    return [
        Note(
            RunCode.WRONG_SIZE, Severity.FAULT, {"role": "ground_speed", "size": ratio, "units": (unit,), "why": "time"}
        )
        for unit, factor in (("ms", 1e3), ("us", 1e6))
        if 1 / _NEAR < ratio / factor < _NEAR
    ]


def _changed(run: ProcessedRun) -> list[Note]:
    """Return a fault where one speed jumps by the factor of a unit and the other does not, both steady around it."""
    reach = round(_EDGE * run.rate_hz / run.cutoff_hz)
    size = np.abs(np.array([run.ground_speed_mps, run.rim_speed_mps], np.float32))  # half the memory of a long run
    logs = np.log(np.where(size > _CRAWL_MPS, size, nan))
    steps = logs[:, reach:] - logs[:, :-reach]
    jumps = steps[:, reach:-reach] - (steps[:, : -2 * reach] + steps[:, 2 * reach :]) / 2
    unsteady = np.abs([steps[:, : -2 * reach], steps[:, 2 * reach :]]).max(axis=(0, 1))
    return [
        Note(RunCode.WRONG_SIZE, Severity.FAULT, {"role": role, "size": time_s, "units": (unit,), "why": "changed"})
        for row, role, unit, most in _AT_ONCE
        for jump in [np.abs(jumps[row]) + log(BY_KEY[f"unit:{role}={unit}"].factors[role])]
        for at in [np.flatnonzero((unsteady < most) & (np.abs([jump, jumps[1 - row]]) < _EXACT).all(axis=0))]
        if len(at) and reach <= run.rate_hz
        for time_s in [float(run.time_s[at[len(at) // 2] + reach * 3 // 2])]
    ]


def _overloaded(run: ProcessedRun, vehicle: VehicleConfig) -> list[Note]:
    """Return a note where a wheel carries more than the vehicle weighs, or hardly anything: no mend may be known."""
    mass_kg, added_kg = vehicle.vehicle.mass_kg or inf, run.run.added_load_kg
    load_n = _quantile(np.abs(run.vertical_load_n[run.used]), 0.5)
    weight_n = (mass_kg + max(added_kg, 0.0)) * STANDARD_GRAVITY_MPS2
    values = {"load_n": load_n, "weight_n": weight_n, "mass_kg": mass_kg, "added_kg": added_kg}
    usual_n = weight_n / 2 / (vehicle.vehicle.axles or 2)
    light = isfinite(weight_n) and load_n < _LIGHT * usual_n
    return [Note(RunCode.OVERLOADED, Severity.DOUBT, values)] if load_n > weight_n or light else []


def _held_rows(channels: Mapping[str, FloatArray], run: ProcessedRun) -> dict[str, BoolArray]:
    """Return where a channel, and not all of them, has one value for seconds, not 0; the filter rounds its ends."""
    found = {}
    edge = round(run.rate_hz / run.cutoff_hz)
    for role, values in channels.items():
        alike = np.abs(np.diff(values)) <= _ALIKE * np.abs(values[1:])
        bounds = np.flatnonzero(np.diff(np.concatenate([[False], alike, [False]]).astype(np.int8)))
        rows = np.zeros(len(values), np.bool_)
        least = _AT_REST * float(np.nanmax(np.abs(values)))
        for first, last in bounds.reshape(-1, 2):
            if last - first >= _HELD_S * run.rate_hz and abs(values[first]) >= least:
                rows[max(first - edge, 0) : last + 1 + edge] = True
        found[role] = rows
    every = np.all([*found.values()], axis=0)  # then it is the run that does not change
    return {role: rows & ~every for role, rows in found.items() if (rows & ~every).any()}


def _frozen(
    run: ProcessedRun, evidence: Evidence, held: Mapping[str, BoolArray]
) -> tuple[dict[str, BoolArray], dict[str, float]]:
    """Return the held rows without which the run is sound; and seconds by role where too little is left to judge."""
    alone = [{role: rows} for role, rows in sorted(held.items(), key=lambda item: -int(item[1].sum()))]
    whole: dict[str, float] = {}
    for some in [*alone, *([dict(held)] if len(held) > 1 else [])]:
        channels = {
            role: np.where(some[role], nan, values) if role in some else values
            for role, values in evidence.channels.items()
        }
        left = replace(evidence, channels=channels, against_track=_against_track(run, channels))
        rest = int(np.isfinite([*channels.values()]).all(axis=0).sum())
        if not is_judged(left) or rest < _LEAST_LEFT * sum(int(rows.sum()) for rows in some.values()):
            whole |= {role: float(rows.sum()) / run.rate_hz for role, rows in some.items() if len(some) == 1}
        elif not judge(left).doubted:
            return some, {}
    return {}, whole


def _values(run: ProcessedRun, vehicle: VehicleConfig, evidence: Evidence, ruling: Ruling) -> dict[str, Any]:
    shares = dict(ruling.mends)
    usual = _quantile(np.abs(run.vertical_load_n), 0.5) or nan
    weight = nan if evidence.mass_kg is None else evidence.mass_kg * STANDARD_GRAVITY_MPS2
    declared = {role: vehicle.signals[role] for role in JUDGED_ROLES if role in vehicle.signals}
    return {
        "sound": ruling.sound,
        "mends": tuple(mend.key for mend in ruling.named),
        "shares": tuple(shares[mend] for mend in ruling.named),
        "slip": _quantile(run.slip, 0.5),
        "traction": _quantile(np.abs(run.driving_torque_nm), 0.9) / run.wheel_radius_m / usual,
        "pull": _quantile(np.abs(run.drawbar_pull_n), 0.9) / usual,
        "load_share": usual / weight,
        "track": evidence.against_track.get("ground_speed", nan),
        "radius_m": run.wheel_radius_m,
        "signals": {role: name.signal for role, name in declared.items()},
        "units": {role: name.unit or "" for role, name in declared.items()},
        "signs": {role: name.sign for role, name in declared.items()},
    }


def _quantile(values: FloatArray, share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else nan


def evidence_of(run: ProcessedRun, vehicle: VehicleConfig) -> Evidence:
    """Return the channels of a run as they are declared, and what else it says of them."""
    channels = {role: np.asarray(getattr(run, ROLES[role].field)) for role in JUDGED_ROLES}
    # as at the hub: an acceleration in a wrong unit must not spoil the force that it corrects
    for role, parts, acceleration in (
        ("drawbar_pull", -run.outboard_mass_kg, run.outboard_acceleration_mps2),
        ("driving_torque", run.outboard_inertia_kgm2, run.wheel_acceleration_radps2),
    ):
        channels[role] = channels[role] + np.nan_to_num(parts * acceleration)
    channels = {role: values for role, values in channels.items() if np.isfinite(values).any()}
    mass_kg = vehicle.vehicle.mass_kg
    if mass_kg is not None:
        mass_kg += max(run.run.added_load_kg, 0.0)
    return Evidence(channels, run.rolling_m, mass_kg, _against_track(run, channels))


def _against_track(run: ProcessedRun, channels: dict[str, FloatArray]) -> dict[str, float]:
    """Return the median of each channel's size over the speed of the positions, in windows in which these move."""
    step, chord_m = _chords(run)
    far = chord_m > _LEAST_CHORD_M
    if far.sum() < _LEAST_WINDOWS:
        return {}
    far &= chord_m >= np.median(chord_m[far])
    found = {}
    for role, values in channels.items():
        sizes = np.abs(values[: len(chord_m) * step].reshape(len(chord_m), step)).mean(axis=1)
        ratios = sizes[far] * step / run.rate_hz / chord_m[far]
        if np.isfinite(ratios).any():
            found[role] = float(np.nanmedian(ratios))
    return found


def _chords(run: ProcessedRun, step: int = 0) -> tuple[int, FloatArray]:
    """Return how many samples a window has (2 s of them), and how far the positions are apart at its ends, (k,)."""
    step = step or max(round(_WINDOW_S * run.rate_hz), 1)
    latitude, longitude = np.deg2rad(run.latitude_deg[::step]), np.deg2rad(run.longitude_deg[::step])
    north, east = np.diff(latitude), np.diff(longitude) * np.cos(latitude[:-1])
    return step, EARTH_RADIUS_M * np.hypot(north, east)


def _in_radians(run: ProcessedRun) -> bool:
    """Whether the positions move as far in radians as the ground speed says, and not in degrees."""
    step, chord_m = _chords(run)
    driven_m = np.abs(run.ground_speed_mps[: len(chord_m) * step]).reshape(-1, step).mean(axis=1) * step / run.rate_hz
    known = np.isfinite(driven_m + chord_m)
    moved_m = np.degrees(chord_m[known].sum())
    return bool(moved_m > 0 and abs(driven_m[known].sum() / moved_m - 1) < _LIKE)
