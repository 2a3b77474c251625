"""The instrumented wheels of a vehicle as one: sums of pull and load, efficiency, load transfer, slip side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from math import nan

import numpy as np
import scipy

from daq import BoolArray, DataError, Fault, FloatArray, IntArray, VehicleConfig
from processing import ProcessedRun
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.key_figures import KeyFigure
from wheelsoil.workflows.traction import SURE_SIGMAS, highest, pull_at

_MEAN_OVER_S = 1.0
"""One observation of the load transfer: the loads swing on the road faster than that."""
_MOST_SECONDS, _FEWEST_MEANS = 1_000_000, 10
_TOGETHER = 0.98
"""Correlation of pull and acceleration from which on no transfer can be given to one of them."""
AT = "at_mean_slip_0.2"
_LATE_S, _LATEST_S, _ALIKE, _BETTER = 0.1, 1.0, 0.8, 0.05
"""A wheel is late from the first to at most the second; how alike the accelerations are then, and more than at none."""
_TIMED: Mapping[str, tuple[str, Callable[[ProcessedRun], FloatArray]]] = {
    "wheel_speed": ("speed", lambda run: run.wheel_acceleration_radps2),
    "driving_torque": ("torque", lambda run: np.diff(run.driving_torque_nm, prepend=run.driving_torque_nm[:1])),
}
"""What changes at all wheels at one time, by the role that measures it: a transducer may be on a bus of its own."""
_TURNING_RADPS, _FEWEST_TURNING, _TOGETHER_TURNING = 0.03, 100, 0.7
"""Yaw rate, number of samples and correlation from which on a curve tells left from right."""


@dataclass(frozen=True)
class Place:
    """Where a wheel is: its axle, from 1 at the front, its side, "left" or "right", and both in words."""

    axle: int
    side: str
    name: str = ""


@dataclass(frozen=True)
class Vehicle:
    """What the instrumented wheels measured at one time, where the samples of all are used; the runs in one.

    Attributes
    ----------
    places : mapping wheel -> Place
        In the order of the rows.
    runs : tuple of str
        Ids of the runs that all wheels have.
    share : float
        Samples used at all wheels, of those used at any.
    run, time_s, acceleration_mps2 : shape (n,)
        Number of the run, time since its start, acceleration of the ground speed at the first wheel.
    slip, slip_sigma, drawbar_pull_n, vertical_load_n, output_w, input_w : float64 arrays, shape (wheels, n)
        Output is drawbar pull times ground speed, input torque times wheel speed; NaN of what a wheel did not measure.
    """

    places: Mapping[str, Place]
    runs: tuple[str, ...]
    share: float
    run: IntArray
    time_s: FloatArray
    acceleration_mps2: FloatArray
    slip: FloatArray
    slip_sigma: FloatArray
    drawbar_pull_n: FloatArray
    vertical_load_n: FloatArray
    output_w: FloatArray
    input_w: FloatArray

    @cached_property
    def mean_slip(self) -> FloatArray:
        """Mean slip of the instrumented wheels, shape (n,)."""
        return np.asarray(self.slip.mean(axis=0))

    @cached_property
    def pull_n(self) -> FloatArray:
        """Sum of their drawbar pulls, shape (n,)."""
        return np.asarray(self.drawbar_pull_n.sum(axis=0))

    @cached_property
    def coefficient(self) -> FloatArray:
        """Sum of pulls over sum of loads, shape (n,)."""
        load = self.vertical_load_n.sum(axis=0)
        return np.asarray(self.pull_n / np.where(load > 0, load, nan))

    @cached_property
    def efficiency(self) -> FloatArray:
        """Sum of outputs over sum of inputs, shape (n,); NaN without torque, and where the wheels are not driven.

        Source: Wong, Theory of Ground Vehicles, section 2.6, of each wheel's powers.
        """
        given = self.input_w.sum(axis=0)
        return np.asarray(self.output_w.sum(axis=0) / np.where(given > 0, given, nan))

    @property
    def axle_loads_n(self) -> dict[int, FloatArray]:
        """Sum of the instrumented wheels' loads by the axle, each of shape (n,)."""
        axles = [place.axle for place in self.places.values()]
        return {axle: self.vertical_load_n[np.equal(axles, axle)].sum(axis=0) for axle in sorted(set(axles))}

    @cached_property
    def _seconds(self) -> tuple[IntArray, IntArray]:
        """First sample of each second of driving, and the number of the second of each sample."""
        second = np.floor(self.time_s / _MEAN_OVER_S).astype(np.int64) + _MOST_SECONDS * self.run.astype(np.int64)
        return np.unique(second, return_index=True, return_inverse=True)[1:]

    def second_means(self, values: FloatArray, *, level: bool = True) -> FloatArray:
        """Return means over 1 s, shape (seconds,); with `level` less the mean of each run, plus that of all.

        Runs differ in added load, and what an axle gains does not depend on it.
        """
        if level:
            values = values - (np.bincount(self.run, values) / np.bincount(self.run))[self.run] + values.mean()
        return np.asarray(np.bincount(self._seconds[1], values) / np.bincount(self._seconds[1]))

    @cached_property
    def transfer(self) -> dict[str, tuple[float, tuple[float, float]]] | None:
        """Load that goes from the first to the last instrumented axle, with its 95 % interval, by means over 1 s.

        "acceleration" in N per m/s2, at one pull, and "pull" in N per N of the sum of pulls, at one acceleration, by
        least squares with a level for each run; half of what the one axle gains on the other. None on one axle, with
        too few samples, or where pull and acceleration go together.
        """
        loads, first = list(self.axle_loads_n.values()), self._seconds[0]
        free = len(first) - len(self.runs) - 2
        slopes = [self.second_means(values, level=False) for values in (self.acceleration_mps2, self.pull_n)]
        gained = self.second_means(0.5 * (loads[-1] - loads[0]))
        design = np.stack([*slopes, *(self.run[first] == i for i in range(len(self.runs)))], axis=1, dtype=np.float64)
        if (
            len(loads) < 2
            or free < _FEWEST_MEANS
            or not (np.isfinite(design).all() and np.isfinite(gained).all())
            or np.ptp(slopes, axis=1).min() == 0
            or abs(np.corrcoef(slopes[0], slopes[1])[0, 1]) > _TOGETHER
        ):
            return None
        inverse = np.linalg.pinv(design.T @ design)
        found = inverse @ design.T @ gained
        half = scipy.special.stdtrit(free, 0.975) * np.sqrt(
            np.sum((gained - design @ found) ** 2) / free * np.diag(inverse)
        )
        return {
            name: (float(value), (float(value - width), float(value + width)))
            for name, value, width in zip(("acceleration", "pull"), found[:2], half[:2], strict=True)
        }

    @cached_property
    def slip_differences(self) -> dict[str, FloatArray]:
        """Slip of the left less the right wheels, and of the first less the last axle, each of shape (n,).

        "left_right" of the axles with both sides instrumented, "front_rear" of the sides with both axles; no other.
        """
        places = list(self.places.values())
        ends = tuple(of(place.axle for place in places) for of in (min, max))
        every = [(i, j, a, b) for i, a in enumerate(places) for j, b in enumerate(places)]
        pairs = {
            "left_right": [
                (i, j) for i, j, a, b in every if a.axle == b.axle and (a.side, b.side) == ("left", "right")
            ],
            "front_rear": [(i, j) for i, j, a, b in every if a.side == b.side and (a.axle, b.axle) == ends and i != j],
        }
        return {
            name: np.mean([self.slip[i] - self.slip[j] for i, j in found], axis=0)
            for name, found in pairs.items()
            if found
        }


def place_of(vehicle: VehicleConfig) -> Place:
    """Return where the one wheel of a vehicle is; its transducer says the side where no ``y_m`` does."""
    wheel = vehicle.wheel
    y_m, axle, name = (wheel.y_m, wheel.axle or 1, wheel.position) if wheel else (None, 1, "")
    side = ("left" if y_m > 0 else "right") if y_m else vehicle.transducer.side
    return Place(axle, side, name or f"axle {axle}, {side}")


def vehicle_of(processed: Mapping[str, Processed]) -> Vehicle:
    """Return what the wheels of a vehicle measured at the same times.

    `processed` has the runs of each instrumented wheel, which are on one time base; runs that not all have are not
    used. `DataError` where the samples of all wheels are used at no time.
    """
    by_id = [{run.id: processed_run for run, processed_run in of_wheel} for of_wheel in processed.values()]
    runs = [[of_wheel[name] for of_wheel in by_id] for name in by_id[0] if all(name in of_wheel for of_wheel in by_id)]
    found = [(wheels, *_rows_used_by_all(wheels)) for wheels in runs]
    there = [(wheels, rows) for wheels, rows, _ in found if len(rows[0])]
    if not there:
        raise DataError.of(
            "at no time are the samples of all wheels used",
            found=", ".join(processed),
            next_step="look at the exclusion reasons of each wheel in its own report",
        )

    def stacked(values: Callable[[ProcessedRun], FloatArray]) -> FloatArray:
        pieces = [np.stack([values(run)[i] for run, i in zip(wheels, rows, strict=True)]) for wheels, rows in there]
        return np.concatenate(pieces, axis=1)

    first = [(wheels[0], rows[0]) for wheels, rows in there]
    return Vehicle(
        places={wheel: place_of(of_wheel[0][0].vehicle) for wheel, of_wheel in processed.items()},
        runs=tuple(wheels[0].run.id for wheels, _ in there),
        share=sum(len(rows) for _, rows in first) / sum(used for *_, used in found),
        run=np.repeat(np.arange(len(there)), [len(at) for _, at in first]),
        time_s=np.concatenate([run.time_s[at] for run, at in first]),
        acceleration_mps2=np.concatenate([run.ground_acceleration_mps2[at] for run, at in first]),
        slip=stacked(lambda run: run.slip),
        slip_sigma=stacked(lambda run: run.slip_sigma),
        drawbar_pull_n=stacked(lambda run: run.drawbar_pull_n),
        vertical_load_n=stacked(lambda run: run.vertical_load_n),
        output_w=stacked(lambda run: run.drawbar_pull_n * run.ground_speed_mps),
        input_w=stacked(lambda run: run.driving_torque_nm * run.wheel_speed_radps),
    )


def _rows_used_by_all(runs: Sequence[ProcessedRun]) -> tuple[list[IntArray], int]:
    """Return the rows of each wheel's run at the times at which all are used, and at how many times any is."""
    steps = [
        np.round(((run.start_ns - runs[0].start_ns) * 1e-9 + run.time_s[run.used]) * run.rate_hz).astype(np.int64)
        for run in runs
    ]
    common = reduce(np.intersect1d, steps)
    rows = [np.flatnonzero(run.used)[np.searchsorted(step, common)] for run, step in zip(runs, steps, strict=True)]
    return rows, len(np.unique(np.concatenate(steps)))


def doubts_of_wheels(processed: Mapping[str, Processed]) -> list[Fault]:
    """Return what makes it doubtful that the wheels have one clock, or stand where they are said to.

    `processed` has the runs of each instrumented wheel.
    """
    places = {name: place_of(runs[0][0].vehicle) for name, runs in processed.items()}
    sides = [
        (left, right)
        for left, at in places.items()
        for right, beside in places.items()
        if at.axle == beside.axle and (at.side, beside.side) == ("left", "right")
    ]
    first, *others = processed
    late = [_late(first, other, _shared_rows(processed[first], processed[other])) for other in others]
    exchanged = [_exchanged(pair, _shared_rows(*(processed[name] for name in pair))) for pair in sides]
    return [fault for fault in (*late, *exchanged) if fault is not None]


Shared = Sequence[tuple[ProcessedRun, IntArray, ProcessedRun, IntArray]]


def _shared_rows(first: Processed, second: Processed) -> Shared:
    """Return the runs that two wheels have, with the rows at the times that both have."""
    others, found = {run.id: done for run, done in second}, []
    for run, this in first:
        if (other := others.get(run.id)) is not None:
            shift = round((other.start_ns - this.start_ns) * 1e-9 * this.rate_hz)
            rows = np.arange(max(0, shift), min(len(this), len(other) + shift))
            found.append((this, rows, other, rows - shift))
    return found


def _late(first: str, name: str, shared: Shared) -> Fault | None:
    """Return that the speed of a wheel, else that its torque, comes later or earlier than that of the first one."""
    return next(filter(None, (_lateness(role, first, name, shared) for role in _TIMED)), None)


def _lateness(role: str, first: str, name: str, shared: Shared) -> Fault | None:
    """Return that what a role measures at a wheel comes later or earlier than at the first one."""
    if not shared:
        return None
    what, change = _TIMED[role]
    reach, rate = round(_LATEST_S * shared[0][0].rate_hz), shared[0][0].rate_hz
    products, powers = np.zeros(2 * reach + 1), np.zeros(2)
    for this, rows, other, there in shared:
        a, b = np.nan_to_num(change(this)[rows]), np.nan_to_num(change(other)[there])
        if len(a) > 2 * reach:
            products += np.correlate(b, a[reach:-reach], "valid")
            powers += [float(a @ a), float(b @ b)]
    alike = products / np.sqrt(powers.prod()) if powers.all() else products
    best = int(np.argmax(alike))
    if abs(best - reach) < _LATE_S * rate or alike[best] < _ALIKE or alike[best] - alike[reach] < _BETTER:
        return None
    later = "later" if best > reach else "earlier"
    return Fault(
        f"the {what} of wheel {name} comes {abs(best - reach) / rate:.2f} s {later} than that of wheel {first}",
        expected="wheels on one clock",
        next_step=f"check latency_s of {role}, and the clocks that stamp its frames; until then rely on each wheel by "
        "itself (--apart)",
    )


def _exchanged(pair: tuple[str, str], shared: Shared) -> Fault | None:
    """Return that the yaw rate contradicts which of two wheels of an axle is the left one."""
    turned, slower = [np.zeros(0)], [np.zeros(0)]
    for this, rows, other, there in shared:
        if (yaw := this.extras.get("yaw_rate_radps")) is not None:
            both = this.used[rows] & other.used[there] & (np.abs(yaw[rows]) > _TURNING_RADPS)
            turned.append(yaw[rows][both])
            slower.append((other.wheel_speed_radps[there] - this.wheel_speed_radps[rows])[both])
    curve, behind = np.concatenate(turned), np.concatenate(slower)
    if len(curve) < _FEWEST_TURNING or np.corrcoef(curve, behind)[0, 1] > -_TOGETHER_TURNING:
        return None
    return Fault(
        f"in curves to the left wheel {pair[0]} rolls faster than wheel {pair[1]}",
        found=f"{pair[0]} on the left, {pair[1]} on the right",
        expected="the inner wheel slower",
        next_step="exchange the two in vehicle.toml, or turn the sign of yaw_rate",
    )


def figures_of_vehicle(vehicle: Vehicle) -> dict[str, KeyFigure]:
    """Return what page, JSON and terminal show of a vehicle, by its key; each measured, with the loads as driven.

    At mean slip 0.2 the pulls of the wheels (``wheel.ID.pull_...``) add up to that of the vehicle, as do the loads.
    """
    figures = [*_at_mean_slip("vehicle", vehicle, np.ones(len(vehicle.places), bool))]
    for i, wheel in enumerate(vehicle.places):
        figures += _at_mean_slip(f"wheel.{wheel}", vehicle, np.arange(len(vehicle.places)) == i)
    # The ground speed's error is of all wheels: their mean slip is no surer than one of them.
    least_slip = SURE_SIGMAS * vehicle.slip_sigma.mean(axis=0)
    efficiency = np.where(vehicle.mean_slip > least_slip, vehicle.efficiency, nan)
    best = [highest(vehicle.mean_slip, values)[0] for values in (vehicle.coefficient, efficiency)]
    driven = vehicle.mean_slip > 0
    figures += [
        KeyFigure("vehicle.drawbar_coefficient", best[0], "", "three decimals"),
        KeyFigure("vehicle.tractive_efficiency", best[1], "", "percent"),
        *(
            KeyFigure(f"vehicle.transfer_by_{name}", scale * value, unit, interval95=(scale * low, scale * high))
            for name, scale, unit in (("acceleration", 1.0, "N/(m/s²)"), ("pull", 1e3, "N/kN"))
            for value, (low, high) in ([vehicle.transfer[name]] if vehicle.transfer else [])
        ),
        *(
            KeyFigure(f"vehicle.slip_{name}", float(np.median(difference[driven])), "", "three decimals")
            for name, difference in vehicle.slip_differences.items()
            if driven.any()
        ),
    ]
    return {figure.key: figure for figure in figures if figure.value == figure.value}


def _at_mean_slip(whose: str, vehicle: Vehicle, wheels: BoolArray) -> Iterator[KeyFigure]:
    """Return slip, pull, load, their ratio and efficiency of some wheels at mean slip 0.2 of all."""
    load_n = vehicle.vertical_load_n[wheels].sum(axis=0)
    slip, pull, output, given = (
        pull_at(vehicle.mean_slip, values, load_n, vehicle.time_s, vehicle.run)
        for values in (
            vehicle.slip[wheels].mean(axis=0),
            *(each[wheels].sum(axis=0) for each in (vehicle.drawbar_pull_n, vehicle.output_w, vehicle.input_w)),
        )
    )
    if slip is not None and pull is not None:
        yield KeyFigure(f"{whose}.slip_{AT}", slip.pull_n, "", "three decimals")
        yield KeyFigure(f"{whose}.pull_{AT}", pull.pull_n, "N", interval95=pull.interval95)
        yield KeyFigure(f"{whose}.load_{AT}", pull.load_n, "N")
        yield KeyFigure(f"{whose}.drawbar_coefficient_{AT}", pull.pull_n / pull.load_n, "", "three decimals")
    if output is not None and given is not None:
        yield KeyFigure(f"{whose}.tractive_efficiency_{AT}", output.pull_n / given.pull_n, "", "percent")
