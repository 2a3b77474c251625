"""Readings of the rut's depth: the sinkage at single places of a run in which no sensor measures it.

The wheel was deeper than the rut that it left: soil rises when it is unloaded. How far is an assumption of ours: no
published figure for ruts of wheels was found. It is of the order of p / k_u, the pressure over the stiffness of the
unloading soil. What differs from it between runs is a zero of the sinkage, which the diagnosis estimates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import cos, radians

import numpy as np

from daq import ConfigError, DataError, Fault, FloatArray, Note, RutReading
from processing import ProcessedRun, Reason, RunCode

REBOUND_M, REBOUND_SIGMA_M = 0.005, 0.003
"""Assumed, without a source: what is added to a rut's depth, and how much soils differ in it."""
_NEAR_M = 3.0
"""Distance of a position from the track below which it is on it: what GNSS receivers differ by."""
_DEGREE_M = 111_195.0


def with_ruts(run: ProcessedRun) -> ProcessedRun:
    """Return the run with its rut readings as sinkage at the nearest samples; NaN everywhere else.

    A reading at a sample that is excluded is noted. `ConfigError` for a reading beside a sinkage signal, or deeper than
    the wheel's radius; `DataError` for one before or behind the run, off its track, or of another pass.
    """
    if not run.run.rut:
        return run
    if np.isfinite(run.sinkage_m).any():
        raise ConfigError(
            Fault(
                "the run has both a sinkage signal and rut readings",
                _where(run),
                next_step="leave out [[run.rut]], or the signal sinkage in vehicle.toml",
            )
        )
    readings = list(enumerate(run.run.rut, 1))
    ConfigError.stop_if_any(fault for i, reading in readings for fault in _too_deep(run, reading, i))
    DataError.stop_if_any(fault for i, reading in readings for fault in _misplaced(run, reading, i))
    sinkage, sigma = np.full(len(run), np.nan), np.full(len(run), np.nan)
    notes = []
    for number, reading in readings:
        row = int(np.nanargmin(_distance_to(run, reading)))
        sinkage[row], sigma[row] = reading.depth_m + REBOUND_M, reading.sigma_m
        if run.reason[row] != Reason.USED:
            values = {"number": number, "time_s": float(run.time_s[row]), "reason": Reason(run.reason[row]).name}
            notes.append(Note(RunCode.RUT_NOT_USED, values=values))
    quality = replace(run.quality, notes=(*run.quality.notes, *notes))
    return replace(run, sinkage_m=sinkage, sinkage_sigma_m=sigma, quality=quality)


def _too_deep(run: ProcessedRun, reading: RutReading, number: int) -> Iterator[Fault]:
    """Yield what of a reading is more than the radius of the wheel that left the rut."""
    radius = run.wheel_radius_m
    for key, value in (("depth_m", reading.depth_m), ("sigma_m", reading.sigma_m)):
        if value > radius:
            metres = next((value * factor for factor in (1e-3, 1e-2) if value * factor <= radius), 0.0)
            unit = "mm" if metres == value * 1e-3 else "cm"
            yield Fault(
                f"{key} is larger than the wheel's radius",
                f"{_where(run)}, [[run.rut]] {number}",
                f"{value:g} m",
                f"at most {radius:g} m, the radius_m of vehicle.toml",
                f"{value:g} {unit} are {metres:.4g} m: write {key} = {metres:.4g}" if metres else "give it in metres",
            )


def _distance_to(run: ProcessedRun, reading: RutReading) -> FloatArray:
    """Return how far each sample is from a reading: seconds or metres; NaN where not known."""
    if reading.time_s is not None:
        return np.abs(run.time_s - reading.time_s)
    if reading.distance_m is not None:
        return np.abs(run.distance_m - reading.distance_m)
    latitude, longitude = reading.latitude_deg or 0.0, reading.longitude_deg or 0.0
    east_m = (run.longitude_deg - longitude) * _DEGREE_M * cos(radians(latitude))
    return np.hypot((run.latitude_deg - latitude) * _DEGREE_M, east_m)


def _misplaced(run: ProcessedRun, reading: RutReading, number: int) -> Iterator[Fault]:
    """Yield why a reading is none of this run."""
    where = f"{_where(run)}, [[run.rut]] {number}"
    if reading.after_pass is not None and reading.after_pass != run.run.pass_number:
        yield Fault(
            "the rut was read after another pass",
            where,
            f"after_pass = {reading.after_pass}",
            f"{run.run.pass_number}, the pass of this run",
            "give the reading to the run that made the pass",
        )
    away = _distance_to(run, reading)
    if not np.isfinite(away).any():
        yield Fault("the run has no positions", where, next_step="place the reading by time_s or distance_m")
    elif reading.time_s is not None and np.nanmin(away) > 1.0 / run.rate_hz:
        found, expected = f"time_s = {reading.time_s:g}", f"{run.time_s[0]:.1f} to {run.time_s[-1]:.1f} s"
        yield Fault("a rut reading is outside the run", where, found, expected, "give the time from the run's start")
    elif reading.time_s is None and np.nanmin(away) > _NEAR_M:
        found, expected = f"{np.nanmin(away):.0f} m from its track", f"{_NEAR_M:g} m or less"
        yield Fault("a rut reading is outside the run", where, found, expected, "check the place, and the run it is of")


def _where(run: ProcessedRun) -> str:
    return f"runs.toml: run {run.run.id or run.run.file!r}"
