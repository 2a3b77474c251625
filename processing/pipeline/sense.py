"""Whether the roles make sense: speeds against each other, forces against the mass, and time spent standing.

A wrong signal, unit or sign shows as a factor that no soil makes. Nothing here changes a value.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

import numpy as np

from daq import LEAST_LOAD_SHARE, STANDARD_GRAVITY_MPS2, BoolArray, FloatArray, Note, Severity, VehicleConfig
from processing.notes import RunCode
from processing.pipeline.kinematics import least_slip_speed, pace_of
from processing.processed_run import ProcessedRun, Segment

_ROLLING = (0.8, 1.25)
_LEAST_SAMPLES = 50
_LITTLE_TRACTION = 0.1
"""Share of the load below which a wheel without much slip rolls."""
_FAST_QUANTILE = 0.75
_STEADY = 1.5
"""A ratio whose 90 % quantile is more than this times its 10 % quantile is no unit: gears change it."""
_LIKELY = 0.07
"""How near a ratio must be to a factor between units to name it."""
_UNIT_FACTORS = {
    "km/h for m/s": 3.6,
    "m/s for km/h": 1 / 3.6,
    "mph for m/s": 2.23694,
    "m/s for mph": 1 / 2.23694,
    "km/h for mph": 1.609344,
    "knots for m/s": 1.943844,
    "rpm for rad/s": 60 / (2 * np.pi),
    "rad/s for rpm": 2 * np.pi / 60,
    "turns for rad": 1 / (2 * np.pi),
    "deg for rad": 180 / np.pi,
}
_MOST_FORCE = 1.5
"""Drawbar pull, or torque over the radius, in loads: no soil and no road gives more."""
_MOSTLY = 0.5


def sense_notes(run: ProcessedRun, vehicle: VehicleConfig) -> list[Note]:
    """Return notes on roles that cannot be what they are called."""
    notes = [*_rolling(run), *_load(run, vehicle), *_forces(run)]
    standing = float(np.mean(run.segment == Segment.STANDSTILL))
    if standing > _MOSTLY:
        notes.append(Note(RunCode.MOSTLY_STANDING, values={"share": standing}))
    return notes


def _rolling(run: ProcessedRun) -> list[Note]:
    rim, ground = run.wheel_radius_m * run.wheel_speed_radps, run.ground_speed_mps
    least = least_slip_speed(pace_of(ground, ground))
    rows = (np.abs(ground) > least) & np.isfinite(rim)
    forces = (run.driving_torque_nm / run.wheel_radius_m, run.drawbar_pull_n)
    measured = [bool(np.isfinite(force).any()) for force in forces]
    if all(measured):
        rows &= _little(run, forces)
    elif any(measured):  # without torque or without pull nobody can tell slip from a wrong unit
        return []
    elif rows.any():  # a wheel slips least where the vehicle is fastest
        rows &= ground > np.quantile(ground[rows], _FAST_QUANTILE)
    if rows.sum() < _LEAST_SAMPLES:
        return []
    low, ratio, high = np.quantile(rim[rows] / ground[rows], (0.1, 0.5, 0.9))
    if _ROLLING[0] <= ratio <= _ROLLING[1]:
        return []
    steady = low > 0 and high < _STEADY * low
    unit = next((name for name, factor in _UNIT_FACTORS.items() if abs(ratio / factor - 1) < _LIKELY), "")
    values = {"ratio": float(ratio), "low": float(low), "high": float(high), "steady": bool(steady)}
    severity = Severity.FAULT if all(measured) else Severity.DOUBT
    return [Note(RunCode.ROLLING_RATIO, severity, values | {"unit": unit if steady else ""})]


def _little(run: ProcessedRun, forces: Sequence[FloatArray]) -> BoolArray:
    """Return where none of the forces is much of the load (of its own usual size, where there is no load)."""
    load = _usual(run.vertical_load_n)
    scales = [load if load > 0 else _usual(np.abs(force)) for force in forces]
    small = [np.abs(force) < _LITTLE_TRACTION * scale for force, scale in zip(forces, scales, strict=True)]
    return np.asarray(small[0] & small[1])


def _load(run: ProcessedRun, vehicle: VehicleConfig) -> list[Note]:
    load, mass_kg = _usual(run.vertical_load_n), vehicle.vehicle.mass_kg
    if mass_kg is None or not load > 0:
        return []
    share = load / ((mass_kg + max(run.run.added_load_kg, 0.0)) * STANDARD_GRAVITY_MPS2)
    if LEAST_LOAD_SHARE <= share <= 1:
        return []
    return [Note(RunCode.LOAD_AGAINST_MASS, Severity.FAULT, {"load_n": load, "mass_kg": mass_kg, "share": share})]


def _forces(run: ProcessedRun) -> list[Note]:
    load = _usual(run.vertical_load_n)
    forces = {"drawbar_pull": run.drawbar_pull_n, "driving_torque": run.driving_torque_nm / run.wheel_radius_m}
    notes = []
    for role, force in forces.items():
        known = np.abs(force[np.isfinite(force)])
        share = float(np.quantile(known, 0.95)) / load if len(known) and load > 0 else 0.0
        if share > _MOST_FORCE:
            notes.append(Note(RunCode.FORCE_AGAINST_LOAD, Severity.FAULT, {"role": role, "share": share}))
    return notes


def _usual(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else nan
