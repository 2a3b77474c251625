"""Runs that could be driven next, made from one that was: its samples under other conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from daq import BoolArray, FloatArray
from model.diagnosis.time_series.samples import Instants, Samples
from model.diagnosis.time_series.standstills import Standstills
from model.wheel_soil.conditions import Conditions
from model.wheel_soil.stresses import slip_of_ratio, speed_ratio
from processing.pipeline import STANDARD_GRAVITY_MPS2

LIKE_OTHERS = "one more run like the others"
_HEAVIER, _LIGHTER = 1.3, 0.75
_BRAKE_SHARE, _MOST_BRAKING = 0.7, 0.6
_STANDSTILLS, _STANDSTILL_S = 4, 10.0
_SAME_LOAD = 1e-9
"""Relative: loads that differ by rounding are the same."""
_SINKAGE_SIGMA_M = 0.003
_TORQUE_SIGMA_NM = 15.0


@dataclass(frozen=True)
class Manoeuvre:
    """A run that could be driven.

    Attributes
    ----------
    change : str
        What to do otherwise than before, for people.
    samples : Samples
        Of that one run; what it measures is not known, only which channels.
    """

    change: str
    samples: Samples


def manoeuvres(samples: Samples) -> tuple[Manoeuvre, ...]:
    """Return what could be driven next, from the typical run of a campaign; the first is one more run like it.

    Parameters
    ----------
    samples : Samples
        Of the runs that were driven.
    """
    typical = typical_run(samples)
    return tuple(Manoeuvre(change, made) for change, made in _variants(typical, samples) if len(made))


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


def _variants(run: Samples, all_runs: Samples) -> Iterator[tuple[str, Samples]]:
    load = float(np.mean(run.conditions.vertical_load_n))
    means = [
        float(np.mean(all_runs.conditions.vertical_load_n[all_runs.run == r])) for r in np.unique(all_runs.run)
    ] or [load]
    heavy, light = _HEAVIER * max(means), _LIGHTER * min(means)
    yield LIKE_OTHERS, run
    yield f"a run with more load: {_load_words(heavy, max(means))}", with_load_times(run, heavy / load)
    yield f"a run with less load: {_load_words(light, min(means))}", with_load_times(run, light / load)
    pressure = float(np.median(run.conditions.inflation_kpa)) if len(run) else float("nan")
    if np.isfinite(pressure):
        yield f"a run at half the inflation pressure: {pressure / 2:.0f} kPa", with_pressure(run, pressure / 2)
    yield f"a run {'back' if _outward(run) else 'out'}, the other direction", turned(run)
    yield f"a run with braking, down to a slip of {-_MOST_BRAKING:.1f}", braked(run)
    yield "a run with slip ramps half as fast, twice as long", slower_ramps(run)
    yield "a run at half the speed", with_speed_times(run, 0.5)
    yield "a second pass in the same rut", with_pass(run, float(np.max(run.conditions.pass_number)) + 1.0)
    yield f"a run with {_STANDSTILLS} standstills of {_STANDSTILL_S:.0f} s, brakes released", with_standstills(run)
    if "z" not in run.measured:
        yield "a run with a sinkage sensor, or the depth of the rut", with_channel(run, "z", _SINKAGE_SIGMA_M)
    if "t" not in run.measured:
        yield "a run with the torque channel", with_channel(run, "t", _TORQUE_SIGMA_NM)


def _load_words(load_n: float, so_far_n: float) -> str:
    """Return a load on the wheel and the mass that makes it, counted from the most or the least so far."""
    mass_kg = (load_n - so_far_n) / STANDARD_GRAVITY_MPS2
    change = f"{float(f'{abs(mass_kg):.2g}'):g} kg {'more' if mass_kg > 0 else 'less'}"
    return f"about {load_n / 1e3:.1f} kN on the wheel, {change} there than so far"


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
