"""What the channels read at standstill: zeros, cross-talk, drift and slope show there without any soil.

A zero of the lifted wheel that was taken off the runs is a standstill, too: without load, with a reading of 0 that is
as well known as the zero was determined. Runs that share a determination know it once. Before and after the runs, and
interpolated between, it is the zero of all of them, by file or by hand; determined once, it may have drifted until they
were driven. So may that of a static test, in which a known pull or torque acts on the lifted wheel.

**Coasting.** A wheel that rolls on firm ground without its drive carries the torque of its bearings and brake pads
alone, and has no slip: the radius of free rolling is what ISO 8855 defines slip by. Both are readings that no soil
enters. On firm ground a tyre rolls on a radius by up to `ROLLING_RADIUS_SHARE` other than on soil.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, sqrt

import numpy as np

from daq import REACTIONS, ROLES, BoolArray, DataError, FloatArray, IndexArray, StaticTest, number
from model.diagnosis.core.campaign import Campaign
from model.diagnosis.core.result import Corrected
from model.effects.catalogue import EFFECTS
from model.wheel_soil.conditions import REFERENCE_INFLATION_KPA, USUAL_OUTBOARD_MASS_KG, Conditions
from processing import ProcessedRun, Segment, Standstill
from processing.pipeline import slip_of

AT_REST = tuple(REACTIONS)
"""What is measured at standstill."""
READ = (*AT_REST, "slip")
"""What is read without soil, in the order of arrays over it: at standstill, and of a wheel that coasts."""
ROLLING_RADIUS_SHARE = 0.005
"""By how much a tyre's rolling radius on firm ground may differ from that on soil."""
_PARTS, _LEAST_COASTED_S, _FINEST_MPS = 10, 20.0, 1e-4
"""Parts of a coasted run between which its speeds scatter, how long all of them are at least, and the least scatter."""
_CUT_S = 0.8
"""Left out at an end of a standstill that a motion follows or precedes: the wheel is seen to turn only after the first
tooth of its ring, and forces are there before."""
_AT_AN_END_S = 0.3
_Z95 = 1.96
NO_LOAD_N = 1e-9
"""On a lifted wheel."""


@dataclass(frozen=True)
class Standstills:
    """Standstills of all runs with released brakes; arrays of shape (n,).

    With held brakes the hub carries an unknown share of the weight along the ground, what the rut keeps, and the torque
    of both: neither zero shows.

    Attributes
    ----------
    conditions : Conditions
        Load, direction, time and place; slip and speeds are 0.
    measured : mapping "dp", "t", "slip" -> array
        Mean over the standstill without its ends; NaN where not measured. The slip is of a wheel that coasts.
    spread : mapping "dp", "t" -> array
        Standard deviation about it.
    duration_s : array
        Of what the mean is over.
    wheel_angle_rad : array
        Rolled since the start of the run.
    lifted_sigma : mapping "dp", "t", "slip" -> array
        One-sigma of the reading of the wheel lifted or coasting; NaN where it stood, none where it always did.
    bracketed : bool array
        Whether a reading of the lifted wheel is of before and after the runs; none where the wheel never was lifted.
    applied : mapping "dp", "t" -> array
        Known pull and torque on the lifted wheel; none where the wheel never was lifted.
    """

    run: IndexArray
    conditions: Conditions
    measured: dict[str, FloatArray]
    spread: dict[str, FloatArray]
    duration_s: FloatArray
    wheel_angle_rad: FloatArray
    lifted_sigma: dict[str, FloatArray] = field(default_factory=dict)
    bracketed: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    applied: dict[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.run)

    @property
    def lifted(self) -> BoolArray:
        """Whether the wheel was lifted, or coasted on firm ground; shape (n,)."""
        known = (np.isfinite(sigma) for sigma in self.lifted_sigma.values())
        return np.asarray(np.logical_or.reduce([np.zeros(len(self), bool), *known]))

    @property
    def tested(self) -> BoolArray:
        """Whether a known force acted, shape (n,)."""
        return np.asarray(np.logical_or.reduce([np.zeros(len(self), bool), *(x != 0.0 for x in self.applied.values())]))


def standstills_of(
    campaign: Campaign, channels: tuple[str, ...], clocks: list[FloatArray], positions: list[FloatArray]
) -> Standstills:
    """Collect the standstills of a campaign that show zeros.

    The channels are of "dp" and "t"; see `model.wheel_soil.run_conditions` for clocks and positions.
    """
    rows = [*_lifted(campaign, channels, clocks, positions), *_static(campaign, channels, clocks, positions)]
    for index, (run, clock, x) in enumerate(zip(campaign.runs, clocks, positions, strict=True)):
        angle = np.cumsum(np.nan_to_num(run.wheel_speed_radps)) / run.rate_hz
        for rest in (r for r in run.quality.standstills if r.released):
            inside = _inside(run, rest)
            load = _mean(run.vertical_load_n[inside])
            if not load > 0:
                continue
            i = (inside.start + inside.stop) // 2
            row = _row(run, index, load, float(clock[i]), float(x[i]))
            row |= {"duration": (inside.stop - inside.start) / run.rate_hz, "angle": float(angle[i])}
            for c in channels:
                values = getattr(run, REACTIONS[c].field)[inside]
                row |= {
                    c: _mean(values),
                    f"{c} spread": float(np.nanstd(values)) if np.isfinite(values).any() else np.nan,
                    f"{c} sigma": np.nan,
                }
            rows.append(row)
    blank = _without_load(campaign.runs[0], 0, clocks, positions, {}, channels)
    table = {key: np.array([row[key] for row in rows], float) for key in blank}
    nothing = np.zeros(len(rows))
    conditions = Conditions(
        slip=np.nan_to_num(table["slip"]),
        vertical_load_n=table["load"],
        ground_speed_mps=table["speed"],
        wheel_speed_radps=table["spin"],
        ground_acceleration_mps2=table["acceleration"],
        ground_jerk_mps3=nothing,
        wheel_acceleration_radps2=nothing,
        wheel_jerk_radps3=nothing,
        ground_speed_shift_s=nothing,
        miscompensated_n=nothing,
        line_position=table["x"],
        campaign_time=table["clock"],
        direction=table["direction"],
        pass_number=table["pass"],
        inflation_kpa=table["kpa"],
        unit_weight_n_m3=np.full(len(rows), campaign.soil.unit_weight_n_m3),
        compensated_mass_kg=np.full(len(rows), campaign.outboard_mass_kg),
        compensated_inertia_kgm2=np.full(len(rows), campaign.outboard_inertia_kgm2),
        outboard_mass_kg=np.full(len(rows), campaign.outboard_mass_kg or USUAL_OUTBOARD_MASS_KG),
        body_pitch_rad=nothing,
    )
    return Standstills(
        run=table["run"].astype(np.intp),
        conditions=conditions,
        measured={c: table[c] for c in (*channels, "slip")},
        spread={c: table[f"{c} spread"] for c in channels},
        duration_s=table["duration"],
        wheel_angle_rad=table["angle"],
        lifted_sigma={c: table[f"{c} sigma"] for c in (*channels, "slip")},
        bracketed=table["bracketed"] > 0.0,
        applied={c: table[_of_applied(c)] for c in AT_REST},
    )


def _lifted(
    campaign: Campaign, channels: tuple[str, ...], clocks: list[FloatArray], positions: list[FloatArray]
) -> Iterator[dict[str, float]]:
    """Yield each determination of the lifted wheel's zeros, at the clock of the run that is nearest to it."""
    nearest: dict[tuple[str, ...], tuple[float, int]] = {}
    for index, run in enumerate(campaign.runs):
        for zero in run.quality.zeros.values() if len(run) else ():
            age = min(map(abs, zero.ages_s), default=np.inf)
            nearest[zero.recordings] = min(nearest.get(zero.recordings, (np.inf, index)), (age, index))
    for recordings, (_, index) in nearest.items():
        if any(set(recordings) < set(other) for other in nearest):
            continue
        run = campaign.runs[index]
        zeros = {c: run.quality.zeros.get(REACTIONS[c].role) for c in channels}
        readings = {
            c: (0.0, own.systematic_sigma)
            for c, own in zeros.items()
            if own and own.is_known and own.recordings == recordings
        }
        if not readings:
            continue
        yield _without_load(run, index, clocks, positions, readings, channels) | {"bracketed": len(recordings) > 1}


def _static(
    campaign: Campaign, channels: tuple[str, ...], clocks: list[FloatArray], positions: list[FloatArray]
) -> Iterator[dict[str, float]]:
    """Yield each static test, less the zero that was taken off the runs; of the same zero it says nothing more.

    What all tests of a coasting wheel err by, drag or tyre, does not average out: repeated, or of several wheels of a
    vehicle, they count as one.
    """
    driven = next((i for i, run in enumerate(campaign.runs) if len(run)), None)
    if driven is None:
        return
    run = campaign.runs[driven]
    zeros = {c: zero for c in channels if (zero := run.quality.zeros.get(REACTIONS[c].role))}
    dragged = sqrt(sum(test.drag_nm is not None for test in campaign.static))
    for test, later in _in_pairs(campaign.static):
        read = {c: _halfway(own, later.readings[c]) if later else own for c, own in test.readings.items()}
        readings = {
            c: (reading - (zeros[c].offset if c in zeros else 0.0), sigma if test.drag_nm is None else dragged * sigma)
            for c, (reading, sigma) in read.items()
            if c in channels and not (test.test == "lifted" and c in zeros and zeros[c].is_known)
        }
        rolled = _rolled(test, campaign, run.rolling_m)
        if readings or rolled:
            known = {"bracketed": float(later is not None), **{_of_applied(c): test.applied[c] for c in AT_REST}}
            yield _without_load(run, driven, clocks, positions, readings, channels) | known | rolled


def _in_pairs(static: Sequence[StaticTest]) -> Iterator[tuple[StaticTest, StaticTest | None]]:
    """Yield each test; a zero that was read before the runs with one of the same channels after them."""
    after = [test for test in static if test.when == "after"]
    for test in (each for each in static if each.when != "after"):
        later = next((each for each in after if test.when and each.readings.keys() == test.readings.keys()), None)
        after = [other for other in after if other is not later]
        yield test, later
    yield from ((test, None) for test in after)


def _halfway(before: tuple[float, float], after: tuple[float, float]) -> tuple[float, float]:
    """Return a zero between two readings, and one-sigma: by theirs, and by how far it moved evenly."""
    (first, sigma), (last, other) = before, after
    moved = max((last - first) ** 2 - sigma**2 - other**2, 0.0)
    return 0.5 * (first + last), sqrt((sigma**2 + other**2) / 4.0 + moved / 12.0)


def _rolled(test: StaticTest, campaign: Campaign, radius_m: float) -> dict[str, float]:
    """Return the speeds of a wheel that coasted, and the slip that they show; nothing without them."""
    speed, spin, sigma = test.ground_speed_mps, test.wheel_speed_radps, test.ground_speed_sigma_mps
    of_vehicle = campaign.of_vehicle.coasted if campaign.of_vehicle else 1
    alike = of_vehicle * sum(other.wheel_speed_radps is not None for other in campaign.static)
    if not (speed and spin and sigma):
        return {}
    return {
        "speed": speed,
        "spin": spin,
        "acceleration": test.ground_acceleration_mps2 or 0.0,
        "slip": float(slip_of(np.array(radius_m * spin), np.array(speed), 0.0)),
        "slip sigma": sqrt(alike) * hypot(sigma / speed, ROLLING_RADIUS_SHARE),
    }


def coasted(run: ProcessedRun, wheel: str = "") -> StaticTest:
    """Return the speeds of a run on firm ground while hardly any torque acted at the wheel.

    The one-sigma is by the scatter of `_PARTS` parts. No torque is read: whether the drive was engaged does not show.
    Where no torque is measured, a wheel coasts by its slip, which says nothing of its radius: no such part counts.

    Raises
    ------
    DataError
        It hardly coasted by its torque.
    """
    rows = np.flatnonzero((run.segment == Segment.COAST) & run.used & np.isfinite(run.driving_torque_nm))
    if len(rows) < _LEAST_COASTED_S * run.rate_hz:
        raise DataError.of(
            "a run on firm ground that hardly coasts shows no rolling radius",
            f"run {run.run.id}",
            f"{len(rows) / run.rate_hz:.0f} s with a measured torque of about zero; mean torque while it turned "
            f"{number(_mean(run.driving_torque_nm[run.used & (run.segment != Segment.STANDSTILL)]))} N m",
            f"at least {_LEAST_COASTED_S:g} s",
            'coast longer, measure driving_torque and check its zero, or take out ground = "firm" of a run on soil',
        )
    speed, spin, acceleration = (
        float(x[rows].mean()) for x in (run.ground_speed_mps, run.wheel_speed_radps, run.ground_acceleration_mps2)
    )
    off = np.array_split((run.ground_speed_mps - speed / spin * run.wheel_speed_radps)[rows], _PARTS)
    return StaticTest(
        test="coasting",
        run=run.run.id,
        wheel=wheel,
        ground_speed_mps=speed,
        ground_speed_sigma_mps=max(float(np.std([part.mean() for part in off], ddof=1)) / sqrt(_PARTS), _FINEST_MPS),
        wheel_speed_radps=spin,
        ground_acceleration_mps2=acceleration,
    )


def rolled(test: StaticTest) -> tuple[float, float] | None:
    """Return the radius on which a wheel coasted, m, and its one-sigma as that on soil; None of another test."""
    speed, spin, sigma = test.ground_speed_mps, test.wheel_speed_radps, test.ground_speed_sigma_mps
    return (speed / spin, hypot(sigma, ROLLING_RADIUS_SHARE * speed) / spin) if speed and spin and sigma else None


def _row(run: ProcessedRun, index: int, load: float, clock: float, x: float) -> dict[str, float]:
    """Return what every standstill has, whatever it reads."""
    return {
        "run": float(index),
        "load": load,
        "clock": clock,
        "x": x,
        "direction": -1.0 if run.run.direction == "back" else 1.0,
        "pass": float(run.passage),
        "kpa": run.run.inflation_kpa or REFERENCE_INFLATION_KPA,
        "duration": 0.0,
        "angle": 0.0,
        "bracketed": 0.0,
        "speed": 0.0,
        "spin": 0.0,
        "acceleration": 0.0,
        "slip": np.nan,
        "slip sigma": np.nan,
        **dict.fromkeys(map(_of_applied, AT_REST), 0.0),
    }


def _of_applied(channel: str) -> str:
    return f"{channel} applied"


def _without_load(
    run: ProcessedRun,
    index: int,
    clocks: list[FloatArray],
    positions: list[FloatArray],
    readings: Mapping[str, tuple[float, float]],
    channels: tuple[str, ...],
) -> dict[str, float]:
    row = _row(run, index, NO_LOAD_N, *(float(x[index][0]) if len(x[index]) else 0.0 for x in (clocks, positions)))
    for c in channels:
        reading, sigma = readings.get(c, (np.nan, np.nan))
        row |= {c: reading, f"{c} spread": np.nan, f"{c} sigma": sigma}
    return row


def corrected_zeros(runs: Sequence[ProcessedRun]) -> tuple[Corrected, ...]:
    """Return the zeros of the lifted wheel that were taken off, by the family that each would be."""
    found = []
    for role, family in {e.needs.zero_of: e.name for e in EFFECTS.values() if e.needs.zero_of}.items():
        zeros = [zero for run in runs if (zero := run.quality.zeros.get(role)) and zero.is_known]
        if not zeros:
            continue
        value = float(np.mean([zero.offset for zero in zeros]))
        reach = _Z95 * max(zero.systematic_sigma for zero in zeros)
        sources = tuple(dict.fromkeys(name for zero in zeros for name in zero.recordings))
        found.append(Corrected(family, value, ROLES[role].unit_text, (value - reach, value + reach), sources))
    return tuple(found)


def _inside(run: ProcessedRun, rest: Standstill) -> slice:
    """Return the rows of a standstill without its ends: torque builds up before a wheel is seen to move."""
    first, last = (round(at * run.rate_hz) for at in (rest.start_s, rest.start_s + rest.duration_s))
    cut = min(round(_CUT_S * run.rate_hz), (last - first) // 3)
    moved_before = first > _AT_AN_END_S * run.rate_hz
    moves_after = last < len(run) - _AT_AN_END_S * run.rate_hz
    return slice(first + cut * moved_before, last + 1 - cut * moves_after)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
