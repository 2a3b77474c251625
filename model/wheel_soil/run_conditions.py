"""Conditions of every sample of processed runs, for effects: position on the line, time on the campaign clock, pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from daq import EARTH_RADIUS_M, ROLES, BoolArray, FloatArray, IndexArray, Note
from model.notes import DiagnosisCode
from model.wheel_soil.conditions import REFERENCE_INFLATION_KPA, USUAL_OUTBOARD_MASS_KG, Conditions
from model.wheel_soil.dual import Number, value_of, where
from processing import ProcessedRun

_LEAST_SAMPLES = 20
_LEAST_LENGTH_M = 5.0
LEAST_SPEED_MPS = 0.05  # of the ground at another moment


@dataclass(frozen=True)
class SpeedHistory:
    """Ground speed of a run, its acceleration and its jerk at any moment: in holes lines, beyond the ends the last.

    Attributes
    ----------
    measured : tuple of three arrays, shape (n,)
        NaN in holes.
    """

    measured: tuple[FloatArray, ...]
    rate_hz: float

    @cached_property
    def _joined(self) -> FloatArray:
        return np.stack([joined_across_holes(x) for x in self.measured])

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        beyond = np.pad(self._joined, ((0, 0), (1, 1)), mode="edge")
        return CubicSpline(np.arange(-1, beyond.shape[1] - 1), beyond, axis=1)

    def at(self, rows: IndexArray) -> FloatArray:
        """Return the three at samples, shape (3, *rows.shape)."""
        return np.asarray(np.take(self._joined, rows, axis=1, mode="clip"))

    def changes(self, rows: IndexArray, delay_s: float) -> FloatArray:
        """Return by how much the three change until so much later, and how fast then; shape (2, 3, *rows.shape)."""
        exact = rows + delay_s * self.rate_hz
        at = np.clip(exact, 0, self._joined.shape[1] - 1)
        rates = np.where(at == exact, self._spline(at, 1) * self.rate_hz, 0.0)
        return np.stack([self._spline(at) - self.at(rows), rates])


def joined_across_holes(x: FloatArray) -> FloatArray:
    """Return a history with lines in its holes; zeros of one that is nowhere known."""
    known = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(len(x)), known, x[known]) if len(known) else np.zeros(len(x))


@dataclass(frozen=True)
class RunConditions(Conditions):
    """Conditions of samples of runs, which know the ground speed of every other moment.

    Attributes
    ----------
    run, row : of each sample: index of its history, and its place there
    histories : tuple of SpeedHistory
    """

    run: Number = np.nan
    row: Number = np.nan
    histories: tuple[SpeedHistory, ...] = ()

    @classmethod
    def of_a_sample(cls) -> list[str]:
        """Return the fields that each sample has: all but what is of the runs."""
        return [name for name in super().of_a_sample() if name != "histories"]

    def at_delay(self, delay_s: Number) -> RunConditions:
        """Return the conditions with the ground speed that was measured so much later, and its derivatives."""
        run, row, shift_s = np.asarray(self.run), np.asarray(self.row, np.intp), float(value_of(delay_s))
        changes = np.zeros((2, 3, *row.shape))
        for i in np.unique(run):
            changes[..., run == i] = self.histories[int(i)].changes(row[run == i], shift_s)
        speed, acceleration, jerk = (x + (delay_s - shift_s) * rate for x, rate in zip(*changes, strict=True))
        speed = self.ground_speed_mps + speed
        return replace(
            self.with_ground_speed(where(value_of(speed) > LEAST_SPEED_MPS, speed, LEAST_SPEED_MPS)),
            ground_acceleration_mps2=self.ground_acceleration_mps2 + acceleration,
            ground_jerk_mps3=self.ground_jerk_mps3 + jerk,
            ground_speed_shift_s=delay_s,
            miscompensated_n=-self.compensated_mass_kg * acceleration,
        )


def joined_conditions(conditions: Sequence[RunConditions], rows: Sequence[BoolArray | IndexArray]) -> RunConditions:
    """Return the conditions of some samples of each run of `conditions_of`, one after the other."""
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(of_run, name)[own] for of_run, own in zip(conditions, rows, strict=True)])
        for name in RunConditions.of_a_sample()
    }
    return replace(conditions[0], **joined)


def line_positions(runs: Sequence[ProcessedRun]) -> tuple[list[FloatArray], tuple[Note, ...]]:
    """Return x of every sample of every run, from -1 to 1 along the campaign's line.

    "out" starts at -1 and "back" at 1; where all runs go one way, the ends are those of what was driven. The shape of a
    run is its distance, which is smooth; where it lies comes from the positions of the whole run, whose noise that
    averages out. Without positions the line is as long as the longest run. x is NaN in gaps of the ground speed. The
    notes say what was not known; there are none where positions were.
    """
    sides = [-1.0 if run.run.direction == "back" else 1.0 for run in runs]
    starts, notes = _starts_by_position(runs, sides)
    if starts is None:
        length = max((_length(run) for run in runs), default=0.0)
        starts = [0.0 if side > 0 else length for side in sides]
    along = [start + side * run.distance_m for start, side, run in zip(starts, sides, runs, strict=True)]
    low, high = _ends(starts, sides, along)
    return [2.0 * (x - low) / max(high - low, 1e-9) - 1.0 for x in along], notes


def _ends(starts: list[float], sides: list[float], along: list[FloatArray]) -> tuple[float, float]:
    """Return where the line starts and ends, m."""
    known = [x[np.isfinite(x)] for x in along]
    driven = np.concatenate([*known, np.zeros(0)])
    if not len(driven):
        return 0.0, 1.0
    out, back = ([at for at, side in zip(starts, sides, strict=True) if side == way] for way in (1.0, -1.0))
    low, high = (float(np.median(at)) if at else None for at in (out, back))
    if low is not None and high is not None and high > low:
        return low, high
    return float(driven.min()), float(driven.max())


def campaign_times(runs: Sequence[ProcessedRun]) -> list[FloatArray]:
    """Return the campaign's clock of every sample, from -1/2 at its first to 1/2 at its last; shape (n,) each."""
    first = min((run.start_ns for run in runs), default=0)
    seconds = [(run.start_ns - first) * 1e-9 + run.time_s for run in runs]
    span = max((float(at[-1]) for at in seconds if len(at)), default=0.0)
    return [at / span - 0.5 if span > 0 else np.zeros(len(at)) for at in seconds]


def _length(run: ProcessedRun) -> float:
    known = run.distance_m[np.isfinite(run.distance_m)]
    return float(known.max()) if len(known) else 0.0


def _starts_by_position(
    runs: Sequence[ProcessedRun], sides: list[float]
) -> tuple[list[float] | None, tuple[Note, ...]]:
    """Return where on the line each run starts, m, from its fixes; None where they do not tell."""
    fixed = [np.isfinite(run.latitude_deg) & np.isfinite(run.longitude_deg) for run in runs]
    if not runs or any(np.count_nonzero(seen) < _LEAST_SAMPLES for seen in fixed):
        return None, (Note(DiagnosisCode.NO_POSITIONS),)
    east, north = _plane(runs)
    points = np.concatenate([np.column_stack([e[s], n[s]]) for e, n, s in zip(east, north, fixed, strict=True)])
    spread = points - points.mean(axis=0)
    axis = np.linalg.svd(spread[:: max(1, len(spread) // 5000)], full_matrices=False)[2][0]
    along = [e * axis[0] + n * axis[1] for e, n in zip(east, north, strict=True)]
    turned = sum(side * _travel(x, run) for x, side, run in zip(along, sides, runs, strict=True))
    if max(abs(_travel(x, run)) for x, run in zip(along, runs, strict=True)) < _LEAST_LENGTH_M:
        return None, (Note(DiagnosisCode.POSITIONS_STILL),)
    along = [x if turned > 0 else -x for x in along]
    return [_start(x, side * run.distance_m) for x, side, run in zip(along, sides, runs, strict=True)], ()


def _start(along: FloatArray, way: FloatArray) -> float:
    """Return where a run starts; of one whose way is not known, the first fix."""
    starts = along - way
    known = starts if np.isfinite(starts).any() else along[np.isfinite(along)][:1]
    return float(np.nanmedian(known))


def _travel(along: FloatArray, run: ProcessedRun) -> float:
    """Return how far a run went along the axis, m, signed."""
    rows = np.flatnonzero(np.isfinite(along) & np.isfinite(run.distance_m))
    if len(rows) < 2:
        return 0.0
    distance = run.distance_m[rows] - run.distance_m[rows].mean()
    scale = float(distance @ distance)
    return float(distance @ along[rows]) / scale * float(np.ptp(distance)) if scale > 0 else 0.0


def _plane(runs: Sequence[ProcessedRun]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return east and north of the first fix, m."""
    latitude = np.concatenate([run.latitude_deg for run in runs])
    longitude = np.concatenate([run.longitude_deg for run in runs])
    first = int(np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))[0])
    lat0, lon0 = latitude[first], longitude[first]
    east = [
        np.radians((run.longitude_deg - lon0 + 180.0) % 360.0 - 180.0) * EARTH_RADIUS_M * np.cos(np.radians(lat0))
        for run in runs
    ]
    return east, [np.radians(run.latitude_deg - lat0) * EARTH_RADIUS_M for run in runs]


def conditions_of(runs: Sequence[ProcessedRun], unit_weight_n_m3: float) -> list[RunConditions]:
    """Return the conditions of every sample of every run of one campaign; every field has shape (n,).

    The slip is NaN where a sample is not usable, so that a model has no answer there.

    Parameters
    ----------
    unit_weight_n_m3 : of the soil
    """
    positions, _ = line_positions(runs)
    clocks = campaign_times(runs)
    found = [
        _of_run(run, position, clock, unit_weight_n_m3)
        for run, position, clock in zip(runs, positions, clocks, strict=True)
    ]
    histories = tuple(
        SpeedHistory((run.ground_speed_mps, run.ground_acceleration_mps2, np.asarray(c.ground_jerk_mps3)), run.rate_hz)
        for run, c in zip(runs, found, strict=True)
    )
    return [
        replace(c, run=np.broadcast_to(float(i), np.shape(c.row)), histories=histories) for i, c in enumerate(found)
    ]


def body_pitch(run: ProcessedRun) -> FloatArray:
    """Return by how much the body pitches on its springs, rad, nose up, shape (n,); NaN where pitch is not measured.

    The measured pitch has the slope of the ground and the mounting of its sensor in it, too. A straight line over the
    distance, fitted beside the acceleration, takes both off.
    """
    pitch = run.extras.get(ROLES["pitch"].field)
    if pitch is None:
        return np.full(len(run), np.nan)
    line = np.column_stack([np.ones(len(run)), run.distance_m])
    basis = np.column_stack([line, run.ground_acceleration_mps2])
    known = run.used & np.isfinite(pitch) & np.isfinite(basis).all(axis=1)
    if np.count_nonzero(known) < _LEAST_SAMPLES:
        return np.full(len(run), np.nan)
    found = np.linalg.lstsq(basis[known], pitch[known], rcond=None)[0]
    return np.asarray(pitch - line @ found[:2])


def _of_run(run: ProcessedRun, position: FloatArray, clock: FloatArray, unit_weight_n_m3: float) -> RunConditions:
    def everywhere(value: float) -> FloatArray:
        return np.broadcast_to(np.float64(value), len(run))

    def slope(x: FloatArray) -> FloatArray:
        return np.gradient(x) * run.rate_hz if len(run) > 1 else everywhere(0.0)

    return RunConditions(
        slip=np.where(run.used, run.slip, np.nan),
        vertical_load_n=run.vertical_load_n,
        ground_speed_mps=run.ground_speed_mps,
        wheel_speed_radps=run.wheel_speed_radps,
        ground_acceleration_mps2=run.ground_acceleration_mps2,
        ground_jerk_mps3=slope(run.ground_acceleration_mps2),
        wheel_acceleration_radps2=run.wheel_acceleration_radps2,
        wheel_jerk_radps3=slope(run.wheel_acceleration_radps2),
        line_position=position,
        campaign_time=clock,
        direction=everywhere(-1.0 if run.run.direction == "back" else 1.0),
        pass_number=everywhere(float(run.passage)),
        inflation_kpa=everywhere(run.run.inflation_kpa or REFERENCE_INFLATION_KPA),
        unit_weight_n_m3=everywhere(unit_weight_n_m3),
        ground_speed_shift_s=everywhere(0.0),
        compensated_mass_kg=everywhere(0.0 if run.has_accelerometer else run.outboard_mass_kg),
        compensated_inertia_kgm2=everywhere(run.outboard_inertia_kgm2),
        outboard_mass_kg=everywhere(
            np.nan if run.has_accelerometer else run.outboard_mass_kg or USUAL_OUTBOARD_MASS_KG
        ),
        body_pitch_rad=body_pitch(run),
        row=np.arange(len(run), dtype=np.int32),
        miscompensated_n=everywhere(0.0),
    )
