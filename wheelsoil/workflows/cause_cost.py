"""What the causes of a verdict cost: pull, torque and tractive efficiency with and without them, all else equal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, isclose, isfinite, nan
from typing import NamedTuple

import numpy as np

from daq import BoolArray, DataError, FloatArray
from model import ExtendedModel, extended_model
from model.diagnosis import Cause, Diagnosis, SoilEstimate
from model.wheel_soil import Conditions, Reading, Soil, Wheel, conditions_of
from processing import ProcessedRun
from wheelsoil.workflows.traction import PullAtSlip, Traction, median_of_passes, near_usual_slip, traction_of

USUAL_SLIP = 0.2
_SLIPS = np.round(np.linspace(0.02, 0.95, 94), 2)
_USUAL = int(np.argmin(np.abs(_SLIPS - USUAL_SLIP)))
_QUANTITIES = (("drawbar_pull", "N"), ("driving_torque", "N m"), ("sinkage", "m"), ("tractive_efficiency", "1"))
_BEYOND = 1.2
"""Of the highest load: what is said of loads that were not driven."""


@dataclass(frozen=True)
class Cost:
    """A quantity at one slip with and without the causes.

    Attributes
    ----------
    difference95 : (float, float)
        With less without, the soil held; NaN where the causes' intervals are not known. Each cause alone is moved to
        the ends of its 95 % interval; the half widths of several are put together by root sum of squares per side.
    """

    quantity: str
    unit: str
    slip: float
    without: float
    with_causes: float
    difference95: tuple[float, float]

    @property
    def difference(self) -> float:
        """With less without."""
        return self.with_causes - self.without


class Driving(NamedTuple):
    """How a wheel is driven steadily: its load (N), ground speed (m/s), and which passage over the soil it is."""

    load_n: float
    speed_mps: float
    passage: float = 1.0


@dataclass(frozen=True)
class CausesCost:
    """What the causes of a `named` verdict cost; `best_slip` is that of the highest efficiency without them."""

    causes: tuple[Cause, ...]
    costs: tuple[Cost, ...]
    driving: Driving
    best_slip: float


def cost_of_verdict(
    found: Diagnosis, driving: Driving, wheel: Wheel, laboratory: Soil, reading: Reading, *, highest_slip: float
) -> CausesCost:
    """Return what the named causes cost in a driving, up to the highest slip that was driven.

    `DataError` where no cause is named, or the model has no answer.
    """
    if found.verdict != "named" or not found.soils:
        raise DataError("no cause is named")
    costs, best_slip = costs_of(
        found.causes, wheel, laboratory, found.soils[0], driving, reading, highest_slip=highest_slip
    )
    return CausesCost(found.causes, tuple(costs), driving, best_slip)


def pull_beyond(
    found: Diagnosis, highest_load_n: float, wheel: Wheel, laboratory: Soil, reading: Reading, driving: Driving
) -> tuple[float, Cost, float]:
    """Return a load (N) above the highest that was driven, and the pull at slip 0.2 there, and what would be read.

    The pull is that with and without the causes of soil and wheel; the reading has the errors of the measurement too.
    All else is as in the usual `driving`. Of a verdict without a name all are the calibrated soil's. `DataError` where
    the model has no answer.
    """
    load_n = float(f"{_BEYOND * highest_load_n:.2g}")
    causes = found.causes if found.verdict == "named" else ()
    soil = found.soils[0] if found.soils else SoilEstimate("", {}, {})
    physical, whole = (
        costs_of(chosen, wheel, laboratory, soil, driving._replace(load_n=load_n), reading)[0][0]
        for chosen in ([cause for cause in causes if cause.kind == "physical"], causes)
    )
    return load_n, physical, whole.with_causes


def costs_of(
    causes: Sequence[Cause],
    wheel: Wheel,
    laboratory: Soil,
    soil: SoilEstimate,
    driving: Driving,
    reading: Reading = "balanced",
    *,
    highest_slip: float = nan,
) -> tuple[list[Cost], float]:
    """Return what causes change at slip 0.2, at that of the highest tractive efficiency without them, and at the end.

    The end is the highest slip that was driven, where it is given. The slip of the highest efficiency is returned, too.
    `soil` is as calibrated with the causes; it is the same with and without them. `DataError` where the model has no
    answer for this load. What differs by rounding only, less than 1e-9 of its value, does not differ.
    """

    def curves(chosen: Sequence[Cause]) -> dict[str, FloatArray]:
        return _curves(extended_model(wheel, laboratory, soil, tuple(chosen), reading), driving)

    without, complete = curves(()), curves(causes)
    known = _known(causes)
    moved = [[curves(_with_one_at(causes, i, end)) for end in (0, 1)] for i in range(len(causes))] if known else []
    if not np.isfinite(without["tractive_efficiency"]).any():
        raise DataError("the model has no answer for this load")
    best = int(np.nanargmax(without["tractive_efficiency"]))
    found = []
    last = [int(np.searchsorted(_SLIPS, highest_slip, "right")) - 1] if highest_slip > _SLIPS[_USUAL] else []
    for row in dict.fromkeys((_USUAL, best, *last)):
        for quantity, unit in _QUANTITIES:
            base, whole = float(without[quantity][row]), float(complete[quantity][row])
            whole = base if isclose(base, whole, rel_tol=1e-9) else whole
            changes = np.array([[float(end[quantity][row]) - whole for end in of_cause] for of_cause in moved])
            changes *= np.abs(changes) > 1e-9 * abs(whole)
            below, above = _half_widths(changes.reshape(-1, 2)) if known else (nan, nan)
            interval = (whole - base - below, whole - base + above)
            found.append(Cost(quantity, unit, float(_SLIPS[row]), base, whole, interval))
    return found, float(_SLIPS[best])


def steady_traction(
    found: Diagnosis | None, runs: Sequence[ProcessedRun], wheel: Wheel, laboratory: Soil, reading: Reading
) -> Traction:
    """Return the traction of steady driving in the usual driving of the runs.

    Under a `named` verdict all is the recommended model's, without the errors of the measurement that it names. The
    interval of the pull at slip 0.2 is as wide as the median residual there with its interval may be to either side,
    put together with the intervals of the named errors. Otherwise that pull is the calibrated soil's, or without a
    diagnosis the laboratory's, plus the median residual, and the rest is measured. Where the model has no answer, all
    is as `traction_of` returns it.
    """
    measured = traction_of(tuple(runs))
    if measured.pull is None:
        return measured
    soil = found.soils[0] if found is not None and found.soils else SoilEstimate("", {}, {})
    causes = found.causes if found is not None and found.verdict == "named" and found.soils else ()
    driving = usual_driving(runs)
    load_n, speed_mps, _ = driving

    def model_of(chosen: Sequence[Cause]) -> ExtendedModel:
        return extended_model(wheel, laboratory, soil, tuple(chosen), reading)

    def pull_of(chosen: Sequence[Cause]) -> float:
        return float(_curves(model_of(chosen), driving)["drawbar_pull"][_USUAL])

    curves = _curves(model_of([cause for cause in causes if cause.kind == "physical"]), driving)
    pull_n, left = float(curves["drawbar_pull"][_USUAL]), _residual(model_of(causes), runs)
    if not isfinite(pull_n) or left is None:
        return measured
    low, high = left.interval95
    if not causes:
        ends, shifted_n = (pull_n + low, pull_n + high), pull_n + left.pull_n
        pull = PullAtSlip(USUAL_SLIP, shifted_n, ends, load_n, left.passes, speed_mps)
        return replace(measured, pull=pull, model="calibrated_soil" if soil.values else "laboratory_soil")
    errors = [i for i, cause in enumerate(causes) if cause.kind != "physical"] if _known(causes) else []
    moved = [[pull_of(_with_one_at(causes, i, end)) for end in (0, 1)] for i in errors]
    below, above = _half_widths(np.reshape(moved, (-1, 2)) - pull_of(causes))
    bias = max(abs(low), abs(high))
    ends = (pull_n - hypot(bias, above), pull_n + hypot(bias, below))
    driven = highest_slip_of(runs) >= _SLIPS
    coefficient, efficiency = (
        _peak(curves[name] / by, driven) for name, by in (("drawbar_pull", load_n), ("tractive_efficiency", 1.0))
    )
    pull = PullAtSlip(USUAL_SLIP, pull_n, ends, load_n, left.passes, speed_mps)
    return Traction(pull, *coefficient, *efficiency, model="recommended")


def _half_widths(changes: FloatArray) -> tuple[float, float]:
    """Return what the causes' changes, shape (causes, 2), put together go below and above zero."""
    below, above = np.minimum(changes.min(axis=1), 0), np.maximum(changes.max(axis=1), 0)
    return float(np.linalg.norm(below)), float(np.linalg.norm(above))


def _known(causes: Sequence[Cause]) -> bool:
    return all(
        isfinite(parameter.value) for cause in causes for end in (0, 1) for parameter in _at_end(cause, end).parameters
    )


def _with_one_at(causes: Sequence[Cause], row: int, end: int) -> list[Cause]:
    return [_at_end(cause, end) if i == row else cause for i, cause in enumerate(causes)]


def _at_end(cause: Cause, end: int) -> Cause:
    """Return a cause at an end of its interval; where only a sum has one, its terms change in proportion."""
    first, *others = cause.parameters
    scale = first.interval95[end] / first.value if first.value else nan
    ends = [first.interval95[end]]
    ends += [
        parameter.interval95[end] if isfinite(parameter.interval95[end]) else scale * parameter.value
        for parameter in others
    ]
    moved = (replace(parameter, value=value) for parameter, value in zip(cause.parameters, ends, strict=True))
    return replace(cause, parameters=tuple(moved))


def highest_slip_of(runs: Sequence[ProcessedRun]) -> float:
    """Return the highest slip of the used samples, 0 where none is driven."""
    return max(float(np.nanmax(run.slip[run.used], initial=0.0)) for run in runs)


def usual_driving(runs: Sequence[ProcessedRun]) -> Driving:
    """Return the median load and ground speed of the used samples, and the middle passage of the runs."""
    load_n, speed_mps = (
        float(np.nanmedian(np.concatenate([getattr(run, name)[run.used] for run in runs])))
        for name in ("vertical_load_n", "ground_speed_mps")
    )
    return Driving(load_n, speed_mps, float(np.ceil(np.median([run.passage for run in runs]))))


def _curves(model: ExtendedModel, driving: Driving) -> dict[str, FloatArray]:
    """Return pull (N), torque (N m), sinkage (m) and tractive efficiency over `_SLIPS`."""
    found = model.predict(_steady(model.wheel, model.soil, driving))
    pull, torque, sinkage = (
        np.asarray(x, np.float64) for x in (found.drawbar_pull_n, found.driving_torque_nm, found.sinkage_m)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        efficiency = pull * model.wheel.radius_m * (1 - _SLIPS) / torque
    return {"drawbar_pull": pull, "driving_torque": torque, "sinkage": sinkage, "tractive_efficiency": efficiency}


def _peak(values: FloatArray, driven: BoolArray) -> tuple[float, float]:
    """Return the highest value among the slips that were driven, and its slip."""
    known = np.where(driven & np.isfinite(values), values, -np.inf)
    best = int(np.argmax(known))
    return (float(values[best]), float(_SLIPS[best])) if np.isfinite(known[best]) else (nan, nan)


def _residual(model: ExtendedModel, runs: Sequence[ProcessedRun]) -> PullAtSlip | None:
    """Return the median residual of the pull near slip 0.2; `pull_n` is the residual."""
    residuals = []
    for run, conditions in zip(runs, conditions_of(runs, model.soil.unit_weight_n_m3), strict=True):
        rows = np.flatnonzero(run.used & near_usual_slip(run.slip))
        residual = np.full(len(run), nan)
        if len(rows):
            residual[rows] = run.drawbar_pull_n[rows] - np.asarray(
                model.predict(conditions.rows(rows)).drawbar_pull_n, np.float64
            )
        residuals.append(residual)
    return median_of_passes(runs, residuals)


def _steady(wheel: Wheel, soil: Soil, driving: Driving) -> Conditions:
    def held(value: float) -> FloatArray:
        return np.full(len(_SLIPS), value)

    return Conditions(
        slip=_SLIPS,
        vertical_load_n=held(driving.load_n),
        ground_speed_mps=held(driving.speed_mps),
        wheel_speed_radps=driving.speed_mps / (1 - _SLIPS) / wheel.radius_m,
        ground_acceleration_mps2=held(0.0),
        ground_jerk_mps3=held(0.0),
        wheel_acceleration_radps2=held(0.0),
        line_position=held(0.0),
        campaign_time=held(0.5),
        direction=held(1.0),
        pass_number=held(driving.passage),
        inflation_kpa=held(nan),
        unit_weight_n_m3=held(soil.unit_weight_n_m3),
        body_pitch_rad=held(0.0),
    )
