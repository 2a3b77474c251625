"""Runs that could be driven next, made from one that was: its samples under other conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import STANDARD_GRAVITY_MPS2, BoolArray, FloatArray, Note
from model.diagnosis.time_series.samples import Instants, Samples
from model.diagnosis.time_series.standstills import Standstills
from model.notes import StepCode
from model.wheel_soil.conditions import Conditions
from model.wheel_soil.stresses import slip_of_ratio, speed_ratio

_HEAVIER, _LIGHTER = 1.3, 0.75
_WORTH_UNLOADING = 0.05
"""Share of the load below which taking ballast off changes little."""
_BRAKE_SHARE, _MOST_BRAKING = 0.7, 0.6
_STANDSTILLS, _STANDSTILL_S = 4, 10.0
_SAME_LOAD = 1e-9
"""Relative: loads that differ by rounding are the same."""
_SINKAGE_SIGMA_M = 0.003
_RUT_READINGS, _RUT_SIGMA_M = 5, 0.005
"""By a ruler, over the slips of the run."""
_TORQUE_SIGMA_NM = 15.0


@dataclass(frozen=True)
class Manoeuvre:
    """A run that could be driven.

    Attributes
    ----------
    step : Note
        What to do otherwise than before: one of `model.StepCode`.
    samples : Samples
        Of that one run; what it measures is not known, only which channels.
    """

    step: Note
    samples: Samples


def manoeuvres(samples: Samples, added_kg: Sequence[float] = ()) -> tuple[Manoeuvre, ...]:
    """Return what could be driven next, from the typical run of a campaign; the first is one more run like it.

    `samples` are of the runs that were driven. `added_kg` is what each was ballasted with: no lighter run than without
    it is offered.
    """
    typical = typical_run(samples)
    return tuple(Manoeuvre(step, made) for step, made in _variants(typical, samples, added_kg) if len(made))


def unballasted_load_n(loads_n: FloatArray, added_kg: FloatArray) -> float:
    """Return the load of a wheel without ballast, N, from runs with some; the least of them where it does not show.

    The loads are the means on the wheel, the ballast is that of the vehicle; shape (runs,) both.
    """
    least = float(loads_n.min())
    if len(added_kg) != len(loads_n) or not np.ptp(added_kg) > 0.0:
        return least
    share, at_none = np.polyfit(added_kg, loads_n, 1)
    return min(float(at_none), least) if share > 0.0 else least


def typical_run(samples: Samples) -> Samples:
    """Return the run whose mean load is nearest to the median of the runs with at least half the usual samples."""
    count = np.bincount(samples.run, minlength=samples.runs)
    enough = np.flatnonzero(count >= 0.5 * np.median(count[count > 0]))
    loads = np.array([np.mean(samples.conditions.vertical_load_n[samples.run == r]) for r in enough])
    away = np.abs(loads - np.median(loads))
    nearest = away <= away.min() + _SAME_LOAD * np.abs(loads).max()  # of two that are equally near, the first
    return only_run(samples, int(enough[np.argmax(nearest)]))


def only_run(samples: Samples, run: int) -> Samples:
    """Return one run as a campaign of its own that is driven after all others, on the campaign's clock."""
    found = samples[samples.run == run]
    rests = _some_rests(samples.rests, samples.rests.run == run)
    return replace(
        found,
        run=np.zeros(len(found), np.intp),
        run_names=(samples.run_names[run],),
        conditions=_at_end(found.conditions),
        moments=found.moments[:0],
        rests=replace(rests, run=np.zeros(len(rests), np.intp), conditions=_at_end(rests.conditions)),
    )


def _variants(run: Samples, all_runs: Samples, added_kg: Sequence[float]) -> Iterator[tuple[Note, Samples]]:
    driven = np.unique(all_runs.run)
    load = float(np.mean(run.conditions.vertical_load_n))
    means = np.array([np.mean(all_runs.conditions.vertical_load_n[all_runs.run == r]) for r in driven] or [load])
    bare = unballasted_load_n(means, np.asarray(added_kg, float)[driven] if len(added_kg) else np.zeros(0))
    heavy, light = _HEAVIER * float(means.max()), max(_LIGHTER * float(means.min()), bare)
    yield Note(StepCode.LIKE_OTHERS), run
    yield _loaded(StepCode.MORE_LOAD, heavy, float(means.max())), with_load_times(run, heavy / load)
    if light < (1.0 - _WORTH_UNLOADING) * means.min():
        yield _loaded(StepCode.LESS_LOAD, light, float(means.min())), with_load_times(run, light / load)
    pressure = float(np.median(run.conditions.inflation_kpa)) if len(run) else float("nan")
    if np.isfinite(pressure):
        half = 0.5 * pressure
        yield Note(StepCode.HALF_PRESSURE, values={"inflation_kpa": half}), with_pressure(run, half)
    yield Note(StepCode.OTHER_DIRECTION, values={"outward": not _outward(run)}), turned(run)
    yield Note(StepCode.BRAKING, values={"slip": -_MOST_BRAKING}), braked(run)
    yield Note(StepCode.SLOWER_RAMPS), slower_ramps(run)
    yield Note(StepCode.HALF_SPEED), with_speed_times(run, 0.5)
    yield Note(StepCode.SECOND_PASS), with_pass(run, float(np.max(run.conditions.pass_number)) + 1.0)
    standing = {"count": _STANDSTILLS, "duration_s": _STANDSTILL_S}
    yield Note(StepCode.STANDSTILLS, values=standing), with_standstills(run)
    if "z" not in run.measured:
        yield Note(StepCode.RUT, values={"count": _RUT_READINGS}), with_rut(run)
        yield Note(StepCode.SINKAGE), with_channel(run, "z", _SINKAGE_SIGMA_M)
    if "t" not in run.measured:
        yield Note(StepCode.TORQUE), with_channel(run, "t", _TORQUE_SIGMA_NM)


def _loaded(code: StepCode, load_n: float, so_far_n: float) -> Note:
    """Return a load on the wheel with the mass there that makes it, beside the most or the least so far."""
    return Note(code, values={"load_n": load_n, "added_kg": (load_n - so_far_n) / STANDARD_GRAVITY_MPS2})


def with_load_times(run: Samples, factor: float) -> Samples:
    """Return the run with every load multiplied."""
    return _changed(
        run,
        conditions=lambda c: replace(c, vertical_load_n=factor * np.asarray(c.vertical_load_n)),
        instants=lambda at: replace(at, vertical_load_n=factor * at.vertical_load_n),
    )


def with_pressure(run: Samples, inflation_kpa: float) -> Samples:
    """Return the run with another inflation pressure."""
    return _changed(run, conditions=lambda c: replace(c, inflation_kpa=np.full(np.shape(c.slip), inflation_kpa)))


def with_pass(run: Samples, pass_number: float) -> Samples:
    """Return the run as another pass in the same rut."""
    return _changed(run, conditions=lambda c: replace(c, pass_number=np.full(np.shape(c.slip), pass_number)))


def turned(run: Samples) -> Samples:
    """Return the run in the other direction, along the same line."""
    return _changed(
        run,
        conditions=lambda c: replace(c, direction=-np.asarray(c.direction), line_position=-np.asarray(c.line_position)),
    )


def with_speed_times(run: Samples, factor: float) -> Samples:
    """Return the run with all speeds and their rates multiplied; slip stays."""
    names = (
        "ground_speed_mps",
        "wheel_speed_radps",
        "ground_acceleration_mps2",
        "ground_jerk_mps3",
        "wheel_acceleration_radps2",
        "wheel_jerk_radps3",
        "body_pitch_rad",
    )
    return _changed(
        run,
        conditions=lambda c: replace(c, **{name: factor * np.asarray(getattr(c, name)) for name in names}),
        instants=lambda at: replace(
            at,
            ground_speed_mps=factor * at.ground_speed_mps,
            wheel_speed_radps=factor * at.wheel_speed_radps,
        ),
    )


def slower_ramps(run: Samples) -> Samples:
    """Return the run with everything changing half as fast, and so twice as many samples."""

    def calmer(c: Conditions) -> Conditions:
        return replace(
            c,
            ground_acceleration_mps2=0.5 * np.asarray(c.ground_acceleration_mps2),
            ground_jerk_mps3=0.25 * np.asarray(c.ground_jerk_mps3),
            wheel_acceleration_radps2=0.5 * np.asarray(c.wheel_acceleration_radps2),
            wheel_jerk_radps3=0.25 * np.asarray(c.wheel_jerk_radps3),
            body_pitch_rad=0.5 * np.asarray(c.body_pitch_rad),
        )

    def nearer(values: FloatArray) -> FloatArray:
        middle = values.mean(axis=0)
        return np.asarray(middle + 0.5 * (values - middle))

    calm = replace(
        run,
        conditions=calmer(run.conditions),
        instants=Instants(*(nearer(getattr(run.instants, f)) for f in Instants.__dataclass_fields__)),
    )
    twice = calm[np.repeat(np.arange(len(run)), 2)]
    half = np.tile([0.0, run.block_s], len(run))
    return replace(twice, time_s=2.0 * twice.time_s + half, distance_m=2.0 * twice.distance_m)


def braked(run: Samples) -> Samples:
    """Return the run with the wheel braked wherever it was driven, at the same ground speed."""
    driven = np.asarray(run.conditions.slip) > 0
    slip = np.maximum(-_BRAKE_SHARE * np.asarray(run.conditions.slip), -_MOST_BRAKING)
    radius = run.wheel_radius_m
    ratio = np.where(
        driven,
        1.0 / speed_ratio(slip),
        radius * np.asarray(run.conditions.wheel_speed_radps) / np.asarray(run.conditions.ground_speed_mps),
    )  # r omega / V
    omega = ratio * np.asarray(run.conditions.ground_speed_mps) / radius
    share = omega / np.asarray(run.conditions.wheel_speed_radps)
    conditions = replace(
        run.conditions,
        wheel_speed_radps=omega,
        wheel_acceleration_radps2=share * np.asarray(run.conditions.wheel_acceleration_radps2),
        slip=slip_of_ratio(1.0 / ratio),
    )
    instants = replace(run.instants, wheel_speed_radps=ratio * run.instants.ground_speed_mps / radius)
    return replace(run, conditions=conditions, instants=instants)


def with_standstills(run: Samples) -> Samples:
    """Return the run with some standstills with released brakes instead of those that it has."""
    now, count = run.rests, _STANDSTILLS
    load = float(np.mean(run.conditions.vertical_load_n))
    rows = np.linspace(0, len(run) - 1, count).round().astype(np.intp)
    nothing = np.zeros(count)
    at = run.conditions.map(lambda x: np.asarray(x)[rows])
    conditions = replace(
        at,
        slip=nothing,
        vertical_load_n=np.full(count, load),
        ground_speed_mps=nothing,
        wheel_speed_radps=nothing,
        ground_acceleration_mps2=nothing,
        ground_jerk_mps3=nothing,
        wheel_acceleration_radps2=nothing,
        wheel_jerk_radps3=nothing,
        body_pitch_rad=nothing,
    )
    return replace(
        run,
        rests=Standstills(
            run=np.zeros(count, np.intp),
            conditions=conditions,
            measured=dict.fromkeys(now.measured, nothing),
            spread={c: np.full(count, np.nan) for c in now.measured},
            duration_s=np.full(count, _STANDSTILL_S),
            wheel_angle_rad=run.wheel_angle_rad[rows],
        ),
    )


def with_channel(run: Samples, channel: str, sigma: float) -> Samples:
    """Return the run with one channel more."""
    rests = run.rests
    if channel != "z":
        known = {c: np.zeros(len(rests)) for c in (channel,)}
        unknown = {c: np.full(len(rests), np.nan) for c in (channel,)}
        rests = replace(rests, measured=rests.measured | known, spread=rests.spread | unknown)
    return replace(
        run,
        measured=run.measured | {channel: np.zeros(len(run))},
        sigma=run.sigma | {channel: sigma},
        rests=rests,
    )


def with_rut(run: Samples) -> Samples:
    """Return the run with the depth of its rut read at some places, from the least slip to the largest."""
    read = with_channel(run, "z", _RUT_SIGMA_M)
    order = np.argsort(np.asarray(run.conditions.slip), kind="stable")
    depth = np.full(len(run), np.nan)
    depth[order[np.linspace(0, len(run) - 1, _RUT_READINGS).round().astype(np.intp)]] = 0.0
    return replace(read, measured=read.measured | {"z": depth})


def _outward(run: Samples) -> bool:
    return bool(len(run) == 0 or np.mean(run.conditions.direction) > 0)


def _at_end(conditions: Conditions) -> Conditions:
    return replace(conditions, campaign_time=np.full(np.shape(conditions.slip), 0.5))


def _some_rests(rests: Standstills, rows: BoolArray) -> Standstills:
    return Standstills(
        run=rests.run[rows],
        conditions=rests.conditions.map(lambda x: np.asarray(x)[rows]),
        measured={c: x[rows] for c, x in rests.measured.items()},
        spread={c: x[rows] for c, x in rests.spread.items()},
        duration_s=rests.duration_s[rows],
        wheel_angle_rad=rests.wheel_angle_rad[rows],
        lifted_sigma={c: x[rows] for c, x in rests.lifted_sigma.items()},
        bracketed=rests.bracketed[rows] if rests.bracketed.size else rests.bracketed,
        applied={c: x[rows] for c, x in rests.applied.items()},
    )


def _changed(
    run: Samples,
    conditions: Callable[[Conditions], Conditions],
    instants: Callable[[Instants], Instants] = lambda at: at,
) -> Samples:
    """Return the run with changed conditions, also at its standstills."""
    return replace(
        run,
        conditions=conditions(run.conditions),
        instants=instants(run.instants),
        rests=replace(run.rests, conditions=conditions(run.rests.conditions)),
    )
