r"""Gram matrices of several campaigns as one; wheels of one vehicle are whitened together.

The wheels of a vehicle are driven together: a run is the drive of all of them. They see one ground speed, so that its
error is one process, seen by all channels of all wheels; and the soil of a run is one. What is left is of each wheel:
its transducer's noise, its load, the soil within its track. So the channels of all wheels stand side by side on the
blocks of one clock, and the filter of `model.diagnosis.time_series.whitening` takes them as it takes those of one.
Hyper-parameters of what they share are the geometric means of what each wheel says by itself.

Where a wheel rolls a little faster or slower than its sensor says, it has a speed error of its own: a small share of
that of all (`OWN_SPEED`). The linearisation begins as if each wheel had all of it for itself: wheels that miss the same
cause would agree on a wrong ground speed, and its points lead away from that cause. Once it rests, it goes on with the
smallest share, and then with another one at which all data are more probable, over all sets of causes. The point has
one ground speed then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from daq import OUTPUTS, FloatArray, IndexArray
from model.diagnosis.core.campaign import Campaign
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.basis import RunShapes
from model.diagnosis.time_series.columns import CauseColumn, Columns, Grams, OwnGram, soil_places
from model.diagnosis.time_series.linearise import Linear, labelled
from model.diagnosis.time_series.noise import Loading, constants, processes, rest_variance
from model.diagnosis.time_series.samples import Places, Samples, places_of
from model.diagnosis.time_series.start import CampaignData
from model.diagnosis.time_series.whitening import (
    Neighbours,
    RunGrams,
    StateSpace,
    grams_of,
    run_design,
    run_grams,
    smoothed,
    some_runs,
    state_space,
    whiten,
)

OWN_SPEED = "own_speed_share"
"""Name among the noise's values."""
APART = 0.99
"""That share while the wheels are linearised as if each had a receiver."""
OWN_SHARES = (0.001, 0.002, 0.004, 0.01, 0.03, 0.1, 0.3)
_SEEN = ("value", "speed", "curvature", "load", "acceleration", "stiffness", "friction", "cohesion")
"""Fields of `Linear` by which the noise is seen."""


@dataclass(frozen=True)
class OfCampaign:
    """Columns of one campaign and what whitens them.

    Attributes
    ----------
    values : mapping
        Hyper-parameters of the noise.
    speed_variance : array, shape (n,)
        Of the ground speed's error about the point.
    """

    campaign: Campaign
    samples: Samples
    linear: Linear
    columns: Columns
    values: Mapping[str, float]
    speed_variance: FloatArray

    @property
    def whitening(self) -> tuple[Samples, Linear, Columns, Mapping[str, float], FloatArray]:
        """What `run_grams` takes."""
        return self.samples, self.linear, self.columns, self.values, self.speed_variance


def part_of(data: CampaignData) -> OfCampaign:
    """Return the columns of a linearised campaign and what whitens them."""
    return OfCampaign(data.campaign, data.samples, data.linear, data.columns, data.noise.values, data.speed_variance)


def groups_of(campaigns: Sequence[Campaign]) -> list[list[int]]:
    """Return which campaigns are whitened together, by their places: wheels of one vehicle, else each by itself."""
    groups: dict[object, list[int]] = {}
    for i, campaign in enumerate(campaigns):
        groups.setdefault(campaign.of_vehicle.campaign if campaign.of_vehicle else i, []).append(i)
    return list(groups.values())


def drives_of(names: Sequence[tuple[str, ...]]) -> dict[str, list[tuple[int, int]]]:
    """Return the drives of several wheels: for each name of a run the wheels that have it, and their number of it."""
    found: dict[str, list[tuple[int, int]]] = {}
    for wheel, runs in enumerate(names):
        for i, name in enumerate(runs):
            found.setdefault(name, []).append((wheel, i))
    return found


def _drives(wheels: Sequence[OfCampaign]) -> dict[str, list[tuple[int, int]]]:
    return drives_of([wheel.samples.run_names for wheel in wheels])


def runs_of(campaigns: Sequence[tuple[Campaign, Samples]]) -> list[list[tuple[int, int]]]:
    """Return what each run of `joined` is of: places of campaigns, and the number of the run in each."""
    found: list[list[tuple[int, int]]] = []
    for group in groups_of([campaign for campaign, _ in campaigns]):
        if campaigns[group[0]][0].of_vehicle:
            drives = drives_of([campaigns[i][1].run_names for i in group])
            found += [[(group[wheel], run) for wheel, run in members] for members in drives.values()]
        else:
            found += [[(i, run)] for i in group for run in range(campaigns[i][1].runs)]
    return found


@dataclass(frozen=True)
class Layout:
    """Columns of several campaigns: residual, soils, causes, each campaign's shapes.

    Attributes
    ----------
    soil : tuple of str
        Labels.
    turns : tuple of array, shape (m, width)
        What takes each campaign's shared columns to these.
    ranks : tuple of int
        Shapes of the campaigns before, those of single runs too.
    """

    soil: tuple[str, ...]
    causes: tuple[CauseColumn, ...]
    turns: tuple[FloatArray, ...]
    ranks: tuple[int, ...]


def layout_of(parts: Sequence[OfCampaign]) -> Layout:
    """Return how the columns of campaigns stand together."""
    causes: dict[tuple[str, str], CauseColumn] = {}
    for part in parts:
        for cause in part.columns.causes:
            causes.setdefault((cause.key, cause.parameter), cause)
    places = soil_places([(part.campaign.of_vehicle, part.columns.soil) for part in parts])
    soil = {
        int(at): labelled(part.campaign.name, label) if len(parts) > 1 else label
        for part, own in zip(parts, places, strict=True)
        for at, label in zip(own, part.columns.soil, strict=True)
    }
    every, first = tuple(causes.values()), 1 + len(soil) + len(causes)
    width = first + sum(len(part.columns.catch_all.shapes) for part in parts)
    turns, ranks = [], [0]
    for part, own in zip(parts, places, strict=True):
        count = len(part.columns.catch_all.shapes)
        shapes = np.eye(count, width, first)
        turns.append(np.concatenate([turn_of(part.columns.causes, own, every, len(soil), width), shapes]))
        first += count
        ranks.append(ranks[-1] + len(part.columns.catch_all.by_rank))
    return Layout(tuple(soil[at] for at in sorted(soil)), every, tuple(turns), tuple(ranks))


def joined(parts: Sequence[OfCampaign], alone: Sequence[RunGrams | None] = ()) -> Grams:
    """Put the Gram matrices of several campaigns into one.

    A cause that one campaign cannot show has a column of zeros there. A scale that goes with the wheel is that of the
    first campaign that has the cause. `alone` are those of each campaign by itself, where they are known; those of the
    wheels of a vehicle are not used.
    """
    several, layout = len(parts) > 1, layout_of(parts)
    turns, ranks = layout.turns, layout.ranks
    found: list[RunGrams] = []
    names: list[str] = []
    groups = groups_of([part.campaign for part in parts])
    for group in groups:
        part = parts[group[0]]
        if part.campaign.of_vehicle:
            wheels = [parts[i] for i in group]
            found.append(_of_vehicle(wheels, [turns[i] for i in group], [ranks[i] for i in group]))
            runs = tuple(_drives(wheels))
        else:
            grams = (alone[group[0]] if alone else None) or run_grams(*part.whitening)
            found.append(_turned(grams, part.campaign, turns[group[0]], ranks[group[0]], several))
            runs = part.samples.run_names
        names += [labelled(part.campaign.ground, run) if len(groups) > 1 else run for run in runs]
    return Grams(
        matrices=np.concatenate([g.matrices for g in found]) if len(found) > 1 else found[0].matrices,
        log_determinants=np.concatenate([g.log_determinants for g in found]),
        samples=np.concatenate([g.samples for g in found]),
        run_names=tuple(names),
        soil=layout.soil,
        causes=layout.causes,
        basis=tuple(s for part in parts for s in _of_campaign(part.campaign, part.columns.catch_all.shapes, several)),
        design=np.concatenate([g.design for g in found]),
        static=np.sum([g.static for g in found], axis=0),
        order=np.concatenate([part.columns.catch_all.order + rank for part, rank in zip(parts, ranks, strict=False)]),
        own=tuple(own for g in found for own in g.own),
        form=np.concatenate([part.columns.catch_all.form for part in parts]),
        constants=found[0].constants if len(found) == 1 else None,
    )


def turn_of(
    own: Sequence[CauseColumn], soil: IndexArray, causes: Sequence[CauseColumn], soils: int, width: int
) -> FloatArray:
    """Return what takes residual, soil and causes of one campaign to those of all, shape (1 + q + k, width).

    `own` are the causes of the campaign, `causes` those of all; a scale may go with the wheel. `soil`, shape (q,), are
    the places of the campaign's soil, `soils` is how many columns the soils of all have.
    """
    turn = np.zeros((1 + len(soil) + len(own), width))
    turn[0, 0] = 1.0
    turn[1 + np.arange(len(soil)), 1 + soil] = 1.0
    index = {(cause.key, cause.parameter): i for i, cause in enumerate(causes)}
    for row, cause in enumerate(own, 1 + len(soil)):
        at = index[cause.key, cause.parameter]
        turn[row, 1 + soils + at] = causes[at].scale / cause.scale
    return turn


def _turned(grams: RunGrams, campaign: Campaign, turn: FloatArray, rank: int, several: bool) -> RunGrams:
    """Return a campaign's Gram matrices in the columns of all."""
    own = []
    for gram in grams.own:
        shapes = RunShapes(tuple(_of_campaign(campaign, gram.shapes.shapes, several)), gram.shapes.order + rank)
        own.append(OwnGram(shapes, gram.across @ turn, gram.inner))
    matrices = turn.T @ grams.matrices @ turn if several else grams.matrices
    return replace(grams, matrices=matrices, own=tuple(own), static=turn.T @ grams.static @ turn)


def _of_campaign(campaign: Campaign, shapes: tuple[Shape, ...], several: bool) -> Iterator[Shape]:
    """Yield shapes with their campaign's name."""
    of = campaign.of_vehicle
    vehicle, wheel = (of.campaign, of.wheel) if of else ("", "")
    yield from (
        replace(shape, campaign=campaign.name, vehicle=vehicle, wheel=wheel) if several else shape for shape in shapes
    )


def _of_vehicle(wheels: Sequence[OfCampaign], turns: Sequence[FloatArray], ranks: Sequence[int]) -> RunGrams:
    """Return the Gram matrices of each drive of the wheels of one vehicle, in the columns of all."""
    drives = _drives(wheels)
    found = _integrated(wheels, turns, ranks)
    counts, design = np.zeros(len(drives), np.intp), np.zeros((len(drives), 3), np.intp)
    static = found.matrices[len(drives) :].sum(axis=0)
    for i, wheel in enumerate(wheels):
        at = np.array([list(drives).index(name) for name in wheel.samples.run_names], np.intp)
        rests, lifted = wheel.samples.rests, wheel.samples.rests.lifted
        np.add.at(counts, at[wheel.samples.run], wheel.columns.present.sum(axis=0))
        np.add.at(counts, at[rests.run[~lifted]], wheel.columns.rests_present[:, ~lifted].sum(axis=0))
        channels, design[at, 1], design[at, 2] = run_design(wheel.samples, wheel.linear, wheel.columns).T
        design[at, 0] += channels << len(OUTPUTS) * (len(wheels) - 1 - i)  # alike for all vehicles
    return replace(found.runs(len(drives)), samples=counts, design=design, static=static)


def _integrated(wheels: Sequence[OfCampaign], turns: Sequence[FloatArray], ranks: Sequence[int]) -> RunGrams:
    """Return the Gram matrices of each drive, without its counts and what the lifted wheels read."""
    width = turns[0].shape[1]
    drives = _drives(wheels)
    of_run = [_shapes_of_drive(wheels, ranks, members) for members in drives.values()]
    return grams_of(vehicle_rows(wheels, turns), width + sum(map(_own, wheels)), width, of_run)


def smoothed_speeds(
    parts: Sequence[OfCampaign], coefficients: Sequence[FloatArray], constants: FloatArray | None = None
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the error of the ground speed that all wheels of a vehicle ask for, its slope and variance, at each wheel.

    It is one for all of them, but while they are linearised apart. What a wheel has for itself is left to the noise:
    about different speeds the wheels would not agree, since the model bends, and so would ask for ever more of it.
    `coefficients` are of each wheel's shared columns, shape (m,): 1 for the residual, minus the estimate for the
    others. `constants` are those of the `Grams` of these wheels, where they are known.
    """
    layout = layout_of(parts)
    together = np.zeros(layout.turns[0].shape[1])
    for turn, own in zip(layout.turns, coefficients, strict=True):
        row, column = np.nonzero(turn)
        together[column] = own[row] / turn[row, column]
    wheels = _with_common_values(parts)
    known = _integrated(parts, layout.turns, layout.ranks).constants if constants is None else constants
    constants_of = known[..., : len(together)] @ together
    drives = list(_drives(wheels))
    aligned, places = _on_one_clock(wheels, drives)
    space = _space(aligned)
    at = places_of(aligned[0].samples.run, len(drives))
    left = []
    for i, (wheel, own) in enumerate(zip(aligned, coefficients, strict=True)):
        columns = wheel.columns
        value = columns.rows[..., : columns.shared] @ own
        index = [list(_constants(aligned)).index(label) for label in _labels(wheel.linear.channels, i)]
        scale = np.array([wheel.values[name] for name in columns.constants])
        of_runs = -constants_of[:, index] * scale
        value += np.einsum("cnl,nl->cn", columns.rows[..., columns.varying :], of_runs[wheel.samples.run])
        left.append(at.padded(value))
    return _of_wheels(space, np.concatenate(left, axis=2), at, parts, places)


def _of_wheels(
    space: StateSpace, left: FloatArray, at: Places, parts: Sequence[OfCampaign], places: Sequence[IndexArray]
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return what `smoothed_speeds` does from what is left of all channels, shape (drives, blocks, channels)."""
    near, own = space.near(), len(parts)
    count = len(near.now) // (own + 1)
    common, block_s = np.zeros((3, len(space.variance))), parts[0].samples.block_s
    for row, states in enumerate((near.now, near.later, near.before)):
        common[row, states[own * count :]] = 1.0
    alone = np.zeros((own, *common.shape))
    for i in range(own):
        for row, states in enumerate((near.now, near.later, near.before)):
            alone[i, row, states[i * count : (i + 1) * count]] = 1.0
    apart = parts[0].values[OWN_SPEED] >= APART
    found: list[list[FloatArray]] = [[] for _ in parts]
    for first, last in some_runs(len(left), own):
        means, covariances = smoothed(space.runs(first, last), left[first:last])
        for of, mine in zip(found, alone, strict=True):
            now, later, before = common + mine if apart else common
            both = common[0] + mine[0]
            variance = covariances @ both @ both + (means @ (both - now)) ** 2
            of.append(np.stack([means @ now, means @ (later - before) * 0.5 / block_s, variance], axis=-1))
    flat = [at.flat(np.concatenate(of)) for of in found]
    return [tuple(x[own].T) for x, own in zip(flat, places, strict=True)]


def _space(aligned: Sequence[OfCampaign]) -> StateSpace:
    """Return the noise of all wheels on one clock."""
    spaces = [state_space(w.samples, w.linear, w.columns.present, w.values, w.speed_variance) for w in aligned]
    return side_by_side(spaces, aligned[0].values[OWN_SPEED])


def _own(wheel: OfCampaign) -> int:
    """Return how many columns a wheel's shapes of single runs have."""
    return wheel.columns.varying - wheel.columns.shared


def _shapes_of_drive(
    wheels: Sequence[OfCampaign], ranks: Sequence[int], members: Sequence[tuple[int, int]]
) -> RunShapes:
    """Return the shapes that only one drive may show, of all its wheels."""
    shapes: list[Shape] = []
    order = [np.zeros(0, np.intp)]
    for i, run in members:
        own = wheels[i].columns.catch_all.of_run[run]
        shapes += _of_campaign(wheels[i].campaign, own.shapes, several=True)
        order.append(own.order + ranks[i])
    return RunShapes(tuple(shapes), np.concatenate(order))


def vehicle_rows(wheels: Sequence[OfCampaign], turns: Sequence[FloatArray]) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield whitened rows of some drives of one vehicle after the other, and ln det, as `whitened_rows` does.

    Where a wheel was lifted, that comes last. Each of `turns`, shape (m, width), takes a wheel's shared columns to
    those of all.

    Rows have the shape (drives, rows, width + o + l). Behind the columns of all are the shapes of single runs of one
    wheel after the other, without a gap in each drive; then what is one value a run, scaled to one-sigma 1.
    """
    drives = _drives(wheels)
    aligned, _ = _on_one_clock(_with_common_values(wheels), list(drives))
    space = _space(aligned)
    own = [_own(wheel) for wheel in wheels]
    sizes = np.zeros((len(drives), len(wheels)), np.intp)
    for drive, members in enumerate(drives.values()):
        for i, run in members:
            sizes[drive, i] = len(wheels[i].columns.catch_all.of_run[run].shapes)
    at, resting_of = places_of(aligned[0].samples.run, len(drives)), [_resting(wheel) for wheel in aligned]
    for first, last in some_runs(len(drives), len(wheels)):
        rows, rests, log_determinants = [], [], np.zeros(last - first)
        for i, (wheel, turn, (resting, logs)) in enumerate(zip(aligned, turns, resting_of, strict=True)):
            into = _embedded(aligned, i, turn, own, sizes[first:last])
            rows.append(_times(at.padded_runs(wheel.columns.rows, first, last), into))
            standing, of_run = ~wheel.samples.rests.lifted, wheel.samples.rests.run
            rest_at = places_of(of_run[standing], wheel.samples.runs)
            padded = _times(rest_at.padded_runs(resting[:, standing], first, last), into)
            rests.append(padded.reshape(last - first, -1, padded.shape[-1]))
            inside = standing & (of_run >= first) & (of_run < last)
            np.add.at(log_determinants, of_run[inside] - first, logs[:, inside].sum(axis=0))
        found = whiten(space.runs(first, last), np.concatenate(rows, axis=2))
        yield np.concatenate([found.columns, *rests], axis=1), found.log_determinants + log_determinants
    if any(wheel.samples.rests.lifted.any() for wheel in wheels):
        yield _lifted(wheels, turns, found.columns.shape[-1])


def _lifted(wheels: Sequence[OfCampaign], turns: Sequence[FloatArray], width: int) -> tuple[FloatArray, FloatArray]:
    """Return what the lifted wheels read as if it were a drive, shape (1, rows, width), and ln det."""
    rows, logs = [], 0.0
    for wheel, turn in zip(wheels, turns, strict=True):
        lifted, (resting, of_variance) = wheel.samples.rests.lifted, _resting(wheel)
        read = resting[:, lifted, : len(turn)].reshape(-1, len(turn)) @ turn
        rows.append(np.pad(read, ((0, 0), (0, width - turn.shape[1]))))
        logs += float(of_variance[:, lifted].sum())
    return np.concatenate(rows)[None], np.array([logs])


def _times(rows: FloatArray, into: FloatArray) -> FloatArray:
    """Return (drives, n, c, m) times (drives, m, width)."""
    return np.asarray(rows @ into[:, None])


def _embedded(
    wheels: Sequence[OfCampaign], i: int, turn: FloatArray, own: Sequence[int], sizes: IndexArray
) -> FloatArray:
    """Return what takes all columns of a wheel to those of the vehicle, for each of some drives, shape (d, m, width).

    `turn` is for the shared columns, `own` is how many columns each wheel has for shapes of single runs, and `sizes`,
    shape (d, wheels), how many of these each drive has.
    """
    columns, width = wheels[i].columns, turn.shape[1]
    keep = width + sum(own)
    at = {name: keep + place for place, name in enumerate(_constants(wheels))}
    out = np.zeros((len(sizes), columns.varying + len(columns.constants), keep + len(at)))
    out[:, : columns.shared, :width] = turn
    for drive, size in enumerate(sizes):
        begin = width + int(size[:i].sum())
        out[drive, columns.shared : columns.shared + size[i], begin : begin + size[i]] = np.eye(size[i])
    for row, label in enumerate(_labels(wheels[i].linear.channels, i), columns.varying):
        out[:, row, at[label]] = wheels[i].values[columns.constants[row - columns.varying]]
    return out


@cache
def _labels(channels: tuple[str, ...], i: int) -> tuple[tuple[int, Loading], ...]:
    """Return what each value of a run is of, of a wheel with these channels: the soil's of all, others of the wheel."""
    return tuple((i if seen.channel else -1, seen) for _, seen in constants(channels))


def _constants(wheels: Sequence[OfCampaign]) -> dict[tuple[int, Loading], None]:
    """Return the values of a run of all wheels, in their order."""
    return dict.fromkeys(label for i, wheel in enumerate(wheels) for label in _labels(wheel.linear.channels, i))


def _resting(wheel: OfCampaign) -> tuple[FloatArray, FloatArray]:
    """Return whitened rows at standstill, shape (3, m, columns), and ln of their variances."""
    columns = wheel.columns
    variance = np.where(columns.rests_present, rest_variance(wheel.linear, wheel.samples, wheel.values), 1.0)
    return columns.rests / np.sqrt(variance)[..., None], np.log(variance)


def shared_values(channels: tuple[str, ...]) -> list[str]:
    """Return the names of the hyper-parameters of what the wheels of a vehicle share."""
    shared = [p for p in processes(channels) if p.has_slope]
    of_runs = dict.fromkeys(name for name, seen in constants(channels) if not seen.channel)
    return [*(name for p in shared for name in (p.deviation, p.time) if name), *of_runs]


def _with_common_values(wheels: Sequence[OfCampaign]) -> list[OfCampaign]:
    """Return the wheels with one value of each hyper-parameter of what they share."""
    names = shared_values(wheels[0].linear.channels)
    common = {name: float(np.exp(np.mean([np.log(wheel.values[name]) for wheel in wheels]))) for name in names}
    return [replace(wheel, values={**wheel.values, **common}) for wheel in wheels]


def _on_one_clock(wheels: Sequence[OfCampaign], drives: Sequence[str]) -> tuple[list[OfCampaign], list[IndexArray]]:
    """Return the wheels on the blocks of one clock: a block that another wheel has is a sample without a channel.

    Also which block each of a wheel's samples is.
    """
    starts: dict[str, int] = {}
    for wheel in wheels:
        for name, run in zip(wheel.samples.run_names, wheel.campaign.runs, strict=True):
            starts[name] = min(starts.get(name, run.start_ns), run.start_ns)
    of_drives = [np.array([drives.index(name) for name in wheel.samples.run_names], np.intp) for wheel in wheels]
    ticks = [_ticks(wheel, starts) for wheel in wheels]
    span = 1 + max(int(tick.max(initial=0)) for tick in ticks)
    keys = [of[wheel.samples.run] * span + tick for wheel, of, tick in zip(wheels, of_drives, ticks, strict=True)]
    every = np.unique(np.concatenate(keys))
    clock = np.stack([every // span, every % span])
    places = [np.searchsorted(every, key) for key in keys]
    each = zip(wheels, places, of_drives, strict=True)
    return [_at_blocks(wheel, drives, clock, at, of) for wheel, at, of in each], places


def _ticks(wheel: OfCampaign, starts: Mapping[str, int]) -> IndexArray:
    """Return the number of each sample's block since the drive's start, shape (n,); it grows within a run."""
    samples = wheel.samples
    late = [
        1e-9 * (run.start_ns - starts[name]) for name, run in zip(samples.run_names, wheel.campaign.runs, strict=True)
    ]
    tick = np.rint((samples.time_s + np.array(late)[samples.run]) / samples.block_s).astype(np.intp)
    for run in range(samples.runs):
        own = samples.run == run
        count = np.arange(int(own.sum()))
        tick[own] = np.maximum.accumulate(tick[own] - count) + count
    return np.asarray(tick)


def _at_blocks(
    wheel: OfCampaign, drives: Sequence[str], clock: IndexArray, at: IndexArray, of_drives: IndexArray
) -> OfCampaign:
    """Return a wheel at every block of the clock.

    `clock`, shape (2, N), has drive and number of every block, `at`, shape (n,), the block of each of the wheel's
    samples, `of_drives`, shape (runs,), the drive of each of its runs.
    """
    samples, columns = wheel.samples, wheel.columns
    blocks = np.arange(clock.shape[1])

    def spread(x: FloatArray) -> FloatArray:
        out = np.zeros((len(x), len(blocks), *x.shape[2:]))
        out[:, at] = x
        return out

    present = np.zeros((len(columns.present), len(blocks)), bool)
    present[:, at] = columns.present
    seen: dict[str, Any] = {name: spread(getattr(wheel.linear, name)) for name in _SEEN}
    return replace(
        wheel,
        samples=replace(
            samples,
            run=clock[0],
            run_names=tuple(drives),
            time_s=np.asarray(clock[1] * samples.block_s, float),
            distance_m=np.interp(blocks, at, samples.distance_m),
            wheel_angle_rad=spread(samples.wheel_angle_rad[None])[0],
            rests=replace(samples.rests, run=of_drives[samples.rests.run]),
        ),
        linear=replace(wheel.linear, **seen),
        columns=replace(columns, rows=spread(columns.rows), present=present),
        speed_variance=spread(wheel.speed_variance[None])[0],
    )


def side_by_side(spaces: Sequence[StateSpace], own_share: float) -> StateSpace:
    """Return the noise of all wheels: the channels of one after the other, and the ground speed's error that all see.

    The spaces are of the same samples, the ground speed's error with the same values; each wheel has `own_share`, above
    0, of that error's variance for itself.
    """
    first = spaces[0].near()
    common = np.r_[first.later, first.now, first.before]
    channels = np.cumsum([0, *(space.white.shape[2] for space in spaces)])
    loadings, seen, variances, near = [], [], [], []
    state = 0
    for space, begin in zip(spaces, channels, strict=False):
        of = space.near()
        places = np.r_[of.later, of.now, of.before]
        variance = space.variance.copy()
        variance[places] *= own_share
        own = np.zeros((*space.decay.shape[:2], channels[-1], len(variance)))
        own[:, :, begin : begin + space.white.shape[2]] = space.loadings
        loadings.append(own)
        seen.append(space.loadings[..., places])
        variances.append(variance)
        near.append(state + places.reshape(3, -1))
        state += len(variance)
    near.append(state + np.arange(len(common)).reshape(3, -1))
    later, now, before = np.concatenate(near, axis=1)
    return StateSpace(
        loadings=np.concatenate([*loadings, np.concatenate(seen, axis=2)], axis=-1),
        decay=np.concatenate([*(space.decay for space in spaces), spaces[0].decay[..., common]], axis=-1),
        variance=np.concatenate([*variances, (1.0 - own_share) * spaces[0].variance[common]]),
        white=np.concatenate([space.white for space in spaces], axis=2),
        neighbours=Neighbours(
            later, now, before, np.tile(first.shares, len(near)), np.tile(first.block_decay, len(near))
        ),
    )


def most_probable_shares(parts: Sequence[OfCampaign], evidence: Callable[[Grams], float]) -> list[float | None]:
    """Return the share of the speed's error that each campaign's wheel has for itself; None where it is no vehicle's.

    `evidence` is the log density of all data of the wheels of a vehicle.
    """
    found: list[float | None] = [None] * len(parts)
    for group in groups_of([part.campaign for part in parts]):
        wheels = [parts[i] for i in group]
        if wheels[0].campaign.of_vehicle:
            share = _most_probable_share(wheels, evidence)
            for i in group:
                found[i] = share
    return found


def _most_probable_share(wheels: Sequence[OfCampaign], evidence: Callable[[Grams], float]) -> float:
    best, highest = OWN_SHARES[0], -np.inf
    for share in OWN_SHARES:
        found = evidence(joined([_with_share(wheel, share) for wheel in wheels]))
        if not found >= highest:
            break
        best, highest = share, found
    return best


def _with_share(wheel: OfCampaign, share: float) -> OfCampaign:
    return replace(wheel, values={**wheel.values, OWN_SPEED: share})
