"""Samples of a diagnosis: block means of the driven part of every run, and what its channels read at standstill.

A run comes at 100 Hz through the common filter, whose cut-off is 4 or 5 Hz: neighbours hold the same thing. Means over
0.2 s (longer where the filter is slower) lose nothing of what a cause does, which is slow, and average the coloured
noise of the transducer, of which every fifth of a second alone would waste a quarter. What a mean costs is that the
model is not linear in slip: the mean of its values is not its value at the mean. So every sample carries three
instants whose spread is that of block and filter together, and the model is averaged over them
(`model.diagnosis.time_series.linearise`). Derivatives are taken at 100 Hz, before.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from daq import CHANNELS, OUTPUTS, REACTIONS, BoolArray, FloatArray, IndexArray, Note, Use
from model.diagnosis.core.campaign import BLOCK_S, Campaign, Coverage
from model.diagnosis.time_series.standstills import Standstills, standstills_of
from model.wheel_soil.conditions import REFERENCE_INFLATION_KPA, USUAL_OUTBOARD_MASS_KG, Conditions
from model.wheel_soil.run_conditions import (
    LEAST_SPEED_MPS,
    SpeedHistory,
    body_pitch,
    campaign_times,
    joined_across_holes,
    line_positions,
)
from processing import ProcessedRun, Reason
from processing.pipeline import kernel_sigma_s, slip_of

FEWEST = 50
"""Usable samples below which nothing can be said."""
LITTLE_SLIP = 0.05
"""Below this size of slip forces are steep in it, and a false latency confirms itself."""
_QUICK_SLIP = 0.25
_CALMING_OF_JERK_S = 0.4
"""One-sigma of the kernel that the change of the acceleration passes: its noise goes against that of the speed itself,
so that any latency seems right."""
STENCIL = (1 / 6, 2 / 3, 1 / 6)
"""Weights of the three instants of a sample."""
SHIFTS_S = np.linspace(-0.6, 0.6, 25)
"""Times by which `Samples.moments` moves the ground speed: as far as its delay may go (`SpeedLatency`)."""


@dataclass(frozen=True)
class Instants:
    """Ground speed, wheel speed and load at three instants of each sample, shape (3, n); their means are the sample's.

    Averaged with `STENCIL`, a function of them is what the block and the filter leave of it, to second order.
    """

    ground_speed_mps: FloatArray
    wheel_speed_radps: FloatArray
    vertical_load_n: FloatArray


@dataclass(frozen=True)
class Samples:
    """Samples of all runs of a campaign, run after run; arrays of shape (n,).

    Attributes
    ----------
    run : int array
        Index of the run.
    time_s : within the run
    conditions : Conditions
        Means, with every field an array; an unknown inflation pressure is 340 kPa.
    measured : mapping "dp", "t", "z" -> array
        Only channels that were measured; NaN where not.
    sigma : mapping "dp", "t", "z" -> float
        Typical one-sigma of a filtered sample.
    speed_sigma_mps, load_sigma_n : float
        The same of ground speed and load.
    distance_m : along the track, within the run
    wheel_angle_rad : rolled since the start of the run
    moments : array, shape (len(SHIFTS_S), 5, n)
        Ground speed at the three instants, its acceleration and its jerk, each measured `SHIFTS_S` later.
    rests : Standstills
        What the channels read at standstill.
    block_s : float
        Length of a block.
    excluded : mapping str -> int
        Blocks that were not used, by reason.
    least_speed_mps : array, shape (n,)
        Of each sample's run: larger of the measured speeds below which nothing is used.
    """

    run: IndexArray
    run_names: tuple[str, ...]
    time_s: FloatArray
    conditions: Conditions
    measured: dict[str, FloatArray]
    sigma: dict[str, float]
    speed_sigma_mps: float
    load_sigma_n: float
    distance_m: FloatArray
    wheel_angle_rad: FloatArray
    instants: Instants
    moments: FloatArray
    rests: Standstills
    wheel_radius_m: float
    block_s: float
    excluded: dict[str, int]
    least_speed_mps: FloatArray
    notes: tuple[Note, ...] = ()

    def __len__(self) -> int:
        return len(self.run)

    @property
    def runs(self) -> int:
        """Number of runs, also of those without a sample."""
        return len(self.run_names)

    def __getitem__(self, rows: BoolArray) -> Samples:
        return replace(
            self,
            run=self.run[rows],
            time_s=self.time_s[rows],
            conditions=self.conditions.map(lambda x: x[rows]),
            measured={c: x[rows] for c, x in self.measured.items()},
            distance_m=self.distance_m[rows],
            wheel_angle_rad=self.wheel_angle_rad[rows],
            least_speed_mps=self.least_speed_mps[rows],
            instants=Instants(*(getattr(self.instants, f)[:, rows] for f in Instants.__dataclass_fields__)),
            moments=self.moments[..., rows],
        )

    def with_delay(self, delay_s: float) -> Samples:
        """Return the samples with the ground speed that was measured `delay_s` later; what was left out stays so.

        Forces near s = 0 are too steep for a series about the measured speed: a delay of 0.45 s leaves it.
        """
        if not delay_s or not self.moments.size:
            return self
        from scipy.interpolate import CubicSpline

        *speeds, acceleration, jerk = CubicSpline(SHIFTS_S, self.moments)(np.clip(delay_s, *SHIFTS_S[[0, -1]]))
        at = np.maximum(np.stack(speeds), LEAST_SPEED_MPS)
        mean, radius = np.array(STENCIL) @ at, self.wheel_radius_m
        conditions = replace(
            self.conditions,
            ground_speed_mps=mean,
            ground_acceleration_mps2=acceleration,
            ground_jerk_mps3=jerk,
            ground_speed_shift_s=np.full(len(self), delay_s),
            slip=slip_of(radius * np.asarray(self.conditions.wheel_speed_radps), mean, 0.0),
        )
        return replace(self, conditions=conditions, instants=replace(self.instants, ground_speed_mps=at))


def samples_of(campaign: Campaign, channels: tuple[str, ...] = tuple(OUTPUTS)) -> Samples:
    """Return the samples of a campaign.

    Parameters
    ----------
    channels : of "dp", "t", "z"
        To use where they were measured.
    """
    positions, notes = line_positions(campaign.runs)
    clocks = campaign_times(campaign.runs)
    excluded: Counter[str] = Counter()
    parts = [
        _blocks(run, x, clock, campaign, excluded)
        for run, x, clock in zip(campaign.runs, positions, clocks, strict=True)
    ]
    names = tuple(run.run.id or f"run {i + 1}" for i, run in enumerate(campaign.runs))

    def joined(key: str) -> FloatArray:
        return np.concatenate([part[key] for part in parts], axis=-1) if parts else np.zeros(0)

    measured = {key: joined(channel.field) for key, channel in OUTPUTS.items() if key in channels}
    measured = {c: x for c, x in measured.items() if np.isfinite(x).any()}
    return Samples(
        run=np.repeat(np.arange(len(parts)), [len(part["time_s"]) for part in parts]),
        run_names=names,
        time_s=joined("time_s"),
        conditions=Conditions(**{name: joined(name) for name in Conditions.__dataclass_fields__}),
        measured=measured,
        sigma={c: _typical([getattr(run, OUTPUTS[c].sigma_field) for run in campaign.runs]) for c in measured},
        speed_sigma_mps=_typical([run.ground_speed_sigma_mps for run in campaign.runs]),
        load_sigma_n=_typical([run.vertical_load_sigma_n for run in campaign.runs]),
        distance_m=joined("distance_m"),
        wheel_angle_rad=joined("wheel_angle_rad"),
        least_speed_mps=joined("least_speed_mps"),
        instants=Instants(*(joined(f"instants.{f}") for f in Instants.__dataclass_fields__)),
        moments=joined("moments"),
        rests=standstills_of(campaign, tuple(c for c in measured if c in REACTIONS), clocks, positions),
        wheel_radius_m=campaign.runs[0].rolling_m,
        block_s=max((block_seconds(run, campaign) for run in campaign.runs), default=BLOCK_S),
        excluded=dict(excluded),
        notes=notes,
    )


_SOME = 20
"""Samples below which the wheel was hardly ever driven, or braked."""


def coverage_of(campaign: Campaign, samples: Samples) -> Coverage:
    """Return what a campaign covers.

    Parameters
    ----------
    samples : Samples
        Of it.
    """
    runs, slip = [run.run for run in campaign.runs], np.asarray(samples.conditions.slip)
    load = np.asarray(samples.conditions.vertical_load_n)
    medians = [float(np.median(load[samples.run == i])) for i in range(samples.runs) if (samples.run == i).any()]
    measured = [
        c for c, name in OUTPUTS.items() if any(np.isfinite(getattr(r, name.field)).any() for r in campaign.runs)
    ]
    names = samples.conditions.__dataclass_fields__
    return Coverage(
        conditions=frozenset(name for name in names if not np.isnan(getattr(samples.conditions, name)).any()),
        channels=frozenset(OUTPUTS[c].role for c in samples.measured),
        unused_channels=frozenset(OUTPUTS[c].role for c in measured if c not in samples.measured),
        load_spread=float(np.ptp(medians) / np.mean(medians)) if medians else 0.0,
        both_directions=len({run.direction for run in runs}) > 1,
        several_passes=len({run.passage for run in campaign.runs}) > 1,
        several_runs=len(runs) > 1,
        pressures=any(run.inflation_kpa for run in runs),
        standstill=not samples.rests.lifted.all(),
        driven=int(np.count_nonzero(slip > 0)) >= _SOME,
        braked=int(np.count_nonzero(slip < 0)) >= _SOME,
        largest_slip=float(np.max(slip, initial=0.0)),
        tyre=campaign.tyre,
        roles=frozenset(_shared_extras(campaign.runs)),
        commanded_slip=campaign.commanded_slip,
        lifted=frozenset(
            OUTPUTS[c].role for c, x in samples.rests.lifted_sigma.items() if c in OUTPUTS and np.isfinite(x).any()
        ),
    )


def _shared_extras(runs: Sequence[ProcessedRun]) -> Iterator[str]:
    """Yield the roles of channels that no model takes and every run carries."""
    for channel in CHANNELS:
        if runs and channel.use is Use.EXTRA and all(channel.field in run.extras for run in runs):
            yield channel.role


def block_seconds(run: ProcessedRun, campaign: Campaign) -> float:
    """Return the length of a block: 0.2 s, or longer where the common filter of the run, or of a vehicle, is slow."""
    least = campaign.of_vehicle.block_s if campaign.of_vehicle else BLOCK_S
    return max(least, 0.8 / run.cutoff_hz) if np.isfinite(run.cutoff_hz) else least


def on_common_blocks(campaigns: Sequence[Campaign]) -> list[Campaign]:
    """Return the campaigns with the longest block of a vehicle's runs for all of its wheels."""
    longest: dict[str, float] = {}
    for campaign in campaigns:
        if vehicle := campaign.of_vehicle:
            own = max((block_seconds(run, campaign) for run in campaign.runs), default=BLOCK_S)
            longest[vehicle.campaign] = max(longest.get(vehicle.campaign, BLOCK_S), own)
    return [
        replace(c, of_vehicle=replace(c.of_vehicle, block_s=longest[c.of_vehicle.campaign])) if c.of_vehicle else c
        for c in campaigns
    ]


def _typical(arrays: list[FloatArray]) -> float:
    """Return the median of what is known; NaN where nothing is."""
    known = [float(np.median(x[np.isfinite(x)])) for x in arrays if np.isfinite(x).any()]
    return float(np.median(known)) if known else float("nan")


def _blocks(
    run: ProcessedRun, position: FloatArray, clock: FloatArray, campaign: Campaign, excluded: Counter[str]
) -> dict[str, FloatArray]:
    """Return the block means of one run by the names of `Conditions` and of the channels, and its instants."""
    step = max(1, round(block_seconds(run, campaign) * run.rate_hz))
    starts = _starts(run.used, step) if campaign.of_vehicle is None else _on_clock(run, step)
    excluded.update({why.name.lower(): int(n) for why, n in _unused(run, step)})
    rows = starts[:, None] + np.arange(step)
    angle = np.cumsum(np.nan_to_num(run.wheel_speed_radps)) / run.rate_hz
    acceleration = _across_block(run, step)
    compensated_kg = 0.0 if run.has_accelerometer else campaign.outboard_mass_kg
    calmer = np.nan_to_num(acceleration - run.ground_acceleration_mps2)
    slow = _calmed(run.ground_acceleration_mps2, _CALMING_OF_JERK_S * run.rate_hz)
    jerk = _rate(slow, run.rate_hz)
    of_run = {
        "vertical_load_n": run.vertical_load_n,
        "ground_speed_mps": run.ground_speed_mps,
        "wheel_speed_radps": run.wheel_speed_radps,
        "ground_acceleration_mps2": acceleration,
        "ground_jerk_mps3": jerk,
        "wheel_acceleration_radps2": run.wheel_acceleration_radps2,
        "wheel_jerk_radps3": _rate(run.wheel_acceleration_radps2, run.rate_hz),
        "line_position": position,
        "campaign_time": clock,
        "body_pitch_rad": body_pitch(run),
        "time_s": run.time_s,
        "distance_m": run.distance_m,
        "wheel_angle_rad": angle,
        "drawbar_pull_n": run.drawbar_pull_n + compensated_kg * calmer,
        "driving_torque_nm": run.driving_torque_nm,
        "sinkage_m": run.sinkage_m,
    }
    found = {name: np.asarray(x)[rows].mean(axis=1) for name, x in of_run.items()}
    info = run.run
    if info.rut:
        found["sinkage_m"] = _of_known(run.sinkage_m[rows])
    for name, value in (
        ("direction", -1.0 if info.direction == "back" else 1.0),
        ("pass_number", float(run.passage)),
        ("inflation_kpa", info.inflation_kpa or REFERENCE_INFLATION_KPA),
        ("unit_weight_n_m3", campaign.soil.unit_weight_n_m3),
        ("ground_speed_shift_s", 0.0),
        ("miscompensated_n", 0.0),
        ("least_speed_mps", run.least_speed_mps),
        ("compensated_mass_kg", compensated_kg),
        ("compensated_inertia_kgm2", campaign.outboard_inertia_kgm2),
        ("outboard_mass_kg", np.nan if run.has_accelerometer else campaign.outboard_mass_kg or USUAL_OUTBOARD_MASS_KG),
    ):
        found[name] = np.full(len(starts), value)
    found |= _instants(run, starts, step, found)
    found["moments"] = _moments(run, starts, step, acceleration, jerk)
    found["slip"] = slip_of(run.rolling_m * found["wheel_speed_radps"], found["ground_speed_mps"], 0.0)
    keep = _kept(run, found, excluded)
    return {name: x[..., keep] for name, x in found.items()}


def _rate(x: FloatArray, rate_hz: float) -> FloatArray:
    return np.gradient(x) * rate_hz if len(x) > 1 else np.zeros(len(x))


def _of_known(x: FloatArray) -> FloatArray:
    """Return the mean of what is known in each row; NaN where nothing is."""
    known = np.isfinite(x)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, x, 0.0).sum(axis=1) / known.sum(axis=1))


def _calmed(x: FloatArray, sigma: float) -> FloatArray:
    """Return a smoothed history, NaN where it was; `sigma` in samples."""
    from scipy.ndimage import gaussian_filter1d

    known = np.isfinite(x)
    weight = gaussian_filter1d(known.astype(float), sigma, mode="nearest")
    smooth = gaussian_filter1d(np.where(known, x, 0.0), sigma, mode="nearest")
    return np.where(known, smooth / np.maximum(weight, 1e-9), np.nan)


def _across_block(run: ProcessedRun, step: int) -> FloatArray:
    """Return the acceleration by the speeds a block later and a block before: what its noise is, the model knows."""
    speed, at = joined_across_holes(run.ground_speed_mps), np.arange(len(run))
    later, before = (speed[np.clip(at + way * step, 0, max(len(run) - 1, 0))] for way in (1, -1))
    found = (later - before) * run.rate_hz / (2.0 * step)
    return np.where(np.isfinite(run.ground_acceleration_mps2), found, np.nan)


def _starts(used: BoolArray, step: int) -> IndexArray:
    """Return the first rows of blocks of `step` used rows, laid end to end in every stretch of used rows."""
    edges = np.flatnonzero(np.diff(np.r_[False, used, False].astype(np.int8)))
    pieces = [np.arange(a, b - step + 1, step) for a, b in edges.reshape(-1, 2)]
    return np.concatenate(pieces) if pieces else np.zeros(0, np.intp)


def _on_clock(run: ProcessedRun, step: int) -> IndexArray:
    """Return the first rows of blocks that are used as a whole, on a clock that the wheels of a vehicle share.

    A block of one wheel that is a tenth of a second later than another's sees another error of the ground speed.
    """
    first = -round(run.start_ns * 1e-9 * run.rate_hz) % step
    starts, used = np.arange(first, len(run) - step + 1, step), np.cumsum(np.r_[0, run.used])
    return np.asarray(starts[used[starts + step] - used[starts] == step])


def _unused(run: ProcessedRun, step: int) -> list[tuple[Reason, int]]:
    counts = np.bincount(run.reason, minlength=len(Reason))
    return [(why, round(counts[why] / step)) for why in Reason if why is not Reason.USED and counts[why] >= step / 2]


def _instants(run: ProcessedRun, starts: IndexArray, step: int, means: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return three instants whose spread is that of block and filter, moved so that they average to the mean."""
    reach, middle = _reach(run, step), starts + step // 2
    rows = np.clip(np.stack([middle - reach, middle, middle + reach]), 0, len(run) - 1)
    weights = np.array(STENCIL)[:, None]
    out = {}
    for name in Instants.__dataclass_fields__:
        at = getattr(run, name)[rows]
        at = np.where(np.isfinite(at).all(axis=0), at, means[name])
        out[f"instants.{name}"] = at + means[name] - (weights * at).sum(axis=0)
    return out


def _reach(run: ProcessedRun, step: int) -> int:
    """Return how far the outer instants of a block are from its middle, in rows."""
    kernel_s = kernel_sigma_s(run.cutoff_hz) if np.isfinite(run.cutoff_hz) else 0.0
    return round(sqrt(3.0 * ((step / run.rate_hz) ** 2 / 12.0 + kernel_s**2)) * run.rate_hz)


def _moments(
    run: ProcessedRun, starts: IndexArray, step: int, acceleration: FloatArray, jerk: FloatArray
) -> FloatArray:
    """Return `Samples.moments`."""
    history = SpeedHistory((run.ground_speed_mps, acceleration, jerk), run.rate_hz)
    reach, weights = np.array([[-1], [0], [1]]) * _reach(run, step), np.array(STENCIL)
    out = np.empty((len(SHIFTS_S), 5, len(starts)))
    for found, shift in zip(out, SHIFTS_S, strict=True):
        first = starts + round(shift * run.rate_hz)
        mean, *rates = history.at(first[:, None] + np.arange(step)).mean(axis=2)
        at = history.at(first + step // 2 + reach)[0]
        found[:] = [*(at + mean - weights @ at), *rates]
    return out


def _kept(run: ProcessedRun, found: dict[str, FloatArray], excluded: Counter[str]) -> BoolArray:
    """Return which blocks are used: not where the slip is small, or changes too fast within a block.

    Nor where ground or wheel stand: a receiver that lags behind a stop looks like a locked wheel.
    """
    size = np.abs(found["slip"])
    at = slip_of(run.rolling_m * found["instants.wheel_speed_radps"], found["instants.ground_speed_mps"], 0.0)
    with np.errstate(invalid="ignore"):
        small = size < LITTLE_SLIP
        stands = (~(found[f"instants.{name}"] > 0).all(axis=0) for name in ("ground_speed_mps", "wheel_speed_radps"))
        quick = np.logical_or.reduce([np.ptp(at, axis=0) > _QUICK_SLIP, *stands])
        odd = ~(size <= 1.0) | ~(found["vertical_load_n"] > 0)
    odd |= _at_a_hole(found["ground_jerk_mps3"])
    excluded.update({"little_slip": int(small.sum()), "slip_changes_fast": int((quick & ~small).sum())})
    return np.asarray(~(small | quick | odd))


def _at_a_hole(derivative: FloatArray) -> BoolArray:
    """Return the blocks whose derivative looks into a hole; none where the derivative is not known anywhere."""
    known = np.isfinite(derivative)
    return np.asarray(~known & known.any())


@dataclass(frozen=True)
class Places:
    """Where each sample stands in an array of runs padded to one length; arrays of shape (n,)."""

    run: IndexArray
    place: IndexArray
    runs: int
    longest: int

    def padded(self, x: FloatArray, fill: float = 0.0) -> FloatArray:
        """Return (c, n, ...) as (runs, longest, c, ...)."""
        return self.padded_runs(x, 0, self.runs, fill)

    def padded_runs(self, x: FloatArray, first: int, last: int, fill: float = 0.0) -> FloatArray:
        """Return what `padded` does of some runs only, from `first` to before `last`."""
        start, stop = np.searchsorted(self.run, (first, last))
        moved = np.moveaxis(x[:, start:stop], 0, 1)
        out = np.full((last - first, self.longest, *moved.shape[1:]), fill)
        out[self.run[start:stop] - first, self.place[start:stop]] = moved
        return out

    def flat(self, x: FloatArray) -> FloatArray:
        """Return (runs, longest, ...) as (n, ...)."""
        return np.asarray(x[self.run, self.place])


def places_of(run: IndexArray, runs: int) -> Places:
    """Return the places of samples that stand run after run, by the index of their run."""
    counts = np.bincount(run, minlength=runs)
    first = np.cumsum(counts) - counts
    return Places(run, np.arange(len(run)) - first[run], runs, int(counts.max(initial=0)))


def steps_of(x: FloatArray, run: IndexArray) -> FloatArray:
    """Return the step to each sample from the one before in its run; 0 for the first."""
    step = np.diff(x, prepend=x[:1])
    step[np.diff(run, prepend=-1) != 0] = 0.0
    return np.maximum(np.nan_to_num(step), 0.0)


def block_steps(samples: Samples) -> FloatArray:
    """Return the seconds to each sample from the one before in its run, shape (n,): one block, or two at least."""
    step, block = steps_of(samples.time_s, samples.run), samples.block_s
    return np.where(step < 1.5 * block, np.minimum(step, block), np.maximum(step, 2.0 * block))
