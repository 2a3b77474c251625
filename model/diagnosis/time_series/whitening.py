r"""Whitening of many columns at once by a Kalman filter, linear in the number of samples; Gram matrices, run by run.

The noise of a run is a sum of independent first-order Markov processes with known loadings, and white noise:

.. math:: y_{ic} = \sum_s h_{ics} x_{is} + w_{ic}, \qquad
          x_{is} = a_{is} x_{i-1,s} + \sqrt{1 - a_{is}^2}\, \sigma_s u_{is},

stationary from the start. The filter's innovations over their deviations are independent and of unit variance, and they
are a linear map of the data: applied to residual and columns alike it is multiplication by the inverse Cholesky factor
of the covariance, to rounding. Channels are taken one after the other within a sample, so that no matrix is inverted.
Runs are a leading axis. Runs of different length are padded; what is not there has no loading, unit white noise and
zeros in every column, and so counts for nothing.

Source: Durbin & Koopman (2012), Time Series Analysis by State Space Methods, 4.3, 4.4 and 6.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from ctypes import CDLL
from dataclasses import dataclass, replace

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray, IndexArray
from model import compiled
from model.core_library import library
from model.diagnosis.time_series.basis import RunShapes
from model.diagnosis.time_series.columns import Columns, OwnGram
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.noise import loading, processes, rest_variance, slope_loading, white_variance
from model.diagnosis.time_series.samples import Places, Samples, block_steps, places_of, steps_of


@dataclass(frozen=True)
class Neighbours:
    """Processes of which a sample sees the values a block later and a block before, too.

    Each has three states: its value a block later, which moves on as any process does, now, and a block before.

    Attributes
    ----------
    later, now, before : int array, shape (L,)
        Positions of the states.
    shares : array, shape (R, N, 3, L)
        What a step leaves of the states: of "later" now, of "later" a block before, and of "now" a block before.
    block_decay : array, shape (L,)
        a of one block.
    """

    later: IndexArray
    now: IndexArray
    before: IndexArray
    shares: FloatArray
    block_decay: FloatArray


@dataclass(frozen=True)
class StateSpace:
    """Noise of R runs of up to N samples in C channels by S states.

    Attributes
    ----------
    loadings : array, shape (R, N, C, S)
        Zero where a channel is missing.
    decay : array, shape (R, N, S)
        a of the step to a sample from the one before; of the first sample it does not matter.
    variance : array, shape (S,)
        Stationary variances.
    white : array, shape (R, N, C)
        Variances of the white noise; 1 where a channel is missing.
    neighbours : Neighbours, optional
    """

    loadings: FloatArray
    decay: FloatArray
    variance: FloatArray
    white: FloatArray
    neighbours: Neighbours | None = None

    def near(self) -> Neighbours:
        """Return the processes whose slope is seen; none of them where there are none."""
        nobody = np.zeros(0, np.intp)
        return self.neighbours or Neighbours(
            nobody, nobody, nobody, np.zeros((*self.decay.shape[:2], 3, 0)), np.zeros(0)
        )

    def runs(self, first: int, last: int) -> StateSpace:
        """Return the noise of the runs from `first` to before `last`."""
        own, near = slice(first, last), self.neighbours
        near = replace(near, shares=near.shares[own]) if near else None
        return StateSpace(self.loadings[own], self.decay[own], self.variance, self.white[own], near)

    def compiled(self, core: CDLL) -> compiled.StateSpace:
        """Return it as the compiled core takes it."""
        near = self.near()
        positions = (near.later, near.now, near.before, near.shares)
        return compiled.StateSpace(core, (self.loadings, self.decay, self.stationary(), self.white), positions)

    def stationary(self) -> FloatArray:
        """Return the covariance of the states before any data, shape (S, S)."""
        found = np.diag(self.variance)
        if near := self.neighbours:
            for first, second, blocks in (
                (near.later, near.now, 1),
                (near.now, near.before, 1),
                (near.later, near.before, 2),
            ):
                found[first, second] = found[second, first] = near.block_decay**blocks * self.variance[near.now]
        return found

    def moved(self, x: FloatArray, i: int) -> FloatArray:
        """Return what is left at sample i of the states at the one before, shape (R, S, M)."""
        out = x * self.decay[:, i, :, None]
        if near := self.neighbours:
            of_later, before_of_later, before_of_now = np.moveaxis(near.shares[:, i, :, :, None], 1, 0)
            later = x[:, near.later]
            out[:, near.before] = before_of_later * later + before_of_now * x[:, near.now]
            out[:, near.now] = of_later * later
        return np.asarray(out)

    def ahead(self, covariance: FloatArray, stationary: FloatArray, i: int) -> FloatArray:
        """Return the states' covariance at sample i from that at the one before, shape (R, S, S)."""
        half = self.moved(covariance - stationary, i)
        return stationary + self.moved(half.swapaxes(1, 2), i)


@dataclass(frozen=True)
class Whitened:
    """Columns of shape (R, N C, M) with independent noise of unit variance, and ln det of each run's covariance."""

    columns: FloatArray
    log_determinants: FloatArray


def whiten(space: StateSpace, columns: FloatArray) -> Whitened:
    """Whiten columns of shape (R, N, C, M), zero where a channel is missing."""
    runs, count, channels, width = columns.shape
    states, stationary = len(space.variance), space.stationary()
    if core := library():
        out, log_determinants = space.compiled(core).whiten(columns)
        return Whitened(out.reshape(runs, count * channels, width), log_determinants)
    covariance = np.repeat(stationary[None], runs, axis=0)
    state = np.zeros((runs, states, width))
    out = np.zeros_like(columns)
    log_determinants = np.zeros(runs)
    for i in range(count):
        if i:
            state = space.moved(state, i)
            covariance = space.ahead(covariance, stationary, i)
        for c in range(channels):
            h = space.loadings[:, i, c]
            loaded = (covariance @ h[:, :, None])[..., 0]
            variance = (loaded * h).sum(axis=-1) + space.white[:, i, c]
            gain = loaded / variance[:, None]
            innovation = columns[:, i, c] - (h[:, None, :] @ state)[:, 0]
            state = state + gain[:, :, None] * innovation[:, None, :]
            covariance = covariance - gain[:, :, None] * loaded[:, None, :]
            out[:, i, c] = innovation / np.sqrt(variance)[:, None]
            log_determinants += np.log(variance)
    return Whitened(out.reshape(runs, count * channels, width), log_determinants)


def smoothed(space: StateSpace, data: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the processes' means given all the data of a run, and their covariances.

    The data, shape (R, N, C), are zero where a channel is missing; the results have the shapes (R, N, S) and (R, N, S,
    S). The fixed-interval smoother of Rauch, Tung & Striebel (1965).
    """
    if core := library():
        return space.compiled(core).smooth(data)
    runs, count, channels = data.shape
    states, stationary = len(space.variance), space.stationary()
    mean, covariance = np.zeros((runs, states)), np.repeat(stationary[None], runs, axis=0)
    means, covariances = np.zeros((count, runs, states)), np.zeros((count, runs, states, states))
    for i in range(count):
        if i:
            mean = space.moved(mean[..., None], i)[..., 0]
            covariance = space.ahead(covariance, stationary, i)
        for c in range(channels):
            h = space.loadings[:, i, c]
            loaded = (covariance @ h[:, :, None])[..., 0]
            gain = loaded / ((loaded * h).sum(axis=-1) + space.white[:, i, c])[:, None]
            mean = mean + gain * (data[:, i, c] - (h * mean).sum(axis=-1))[:, None]
            covariance = covariance - gain[:, :, None] * loaded[:, None, :]
        means[i], covariances[i] = mean, covariance
    for i in range(count - 2, -1, -1):
        ahead = space.ahead(covariances[i], stationary, i + 1)
        back = np.linalg.solve(ahead, space.moved(covariances[i], i + 1)).swapaxes(1, 2)
        means[i] += (back @ (means[i + 1][..., None] - space.moved(means[i][..., None], i + 1)))[..., 0]
        covariances[i] += back @ (covariances[i + 1] - ahead) @ back.swapaxes(1, 2)
    return means.swapaxes(0, 1), covariances.swapaxes(0, 1)


def state_space(
    samples: Samples,
    linear: Linear,
    present: BoolArray,
    values: Mapping[str, float],
    speed_variance: FloatArray,
) -> StateSpace:
    """Return the noise of a campaign's runs, by the hyper-parameters in `values`; `present` has the shape (c, n).

    `speed_variance`, shape (n,), is that of the ground speed's error about the point.
    """
    at = places_of(samples.run, samples.runs)
    listed = processes(linear.channels)
    sloped = [i for i, p in enumerate(listed) if p.has_slope]
    own = [loading(linear, samples, p.loading) for p in listed]
    by_slope = slope_loading(linear, samples)
    loadings = np.stack([*own, *(own[i] for i in sloped), *(-by_slope for _ in sloped)], axis=-1)
    loadings[..., sloped] = by_slope[..., None]
    loadings = np.where(present[..., None], loadings, 0.0)
    step_s, step_m = block_steps(samples), steps_of(samples.distance_m, samples.run)
    decay = np.zeros((len(samples), loadings.shape[-1]))
    for i, p in enumerate(listed):
        if p.time is not None:
            decay[:, i] = np.exp(-(step_m if p.over_distance else step_s) / values[p.time])
    near = np.arange(len(sloped)) + len(listed)
    memories = np.array([values[p.time] if (p := listed[i]).time else 0.0 for i in sloped])
    decay[:, sloped], shares, block_decay = _steps(memories, step_s[:, None], samples.block_s)
    variance = np.array([values[p.deviation] ** 2 for p in listed])
    white = np.where(present, white_variance(linear, values, speed_variance), 1.0)
    return StateSpace(
        loadings=at.padded(loadings),
        decay=at.padded(decay[None])[:, :, 0],
        variance=np.r_[variance, variance[sloped], variance[sloped]],
        white=at.padded(white, fill=1.0),
        neighbours=Neighbours(
            np.array(sloped, np.intp), near, near + len(sloped), at.padded(shares[None])[:, :, 0], block_decay
        ),
    )


def _steps(memories_s: FloatArray, step_s: FloatArray, block_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the decay of "later", shape (n, L), `Neighbours.shares`, (n, 3, L), and the decay of one block, (L,).

    A memory, shape (L,), of 0 is white. A step, shape (n, 1), is to each sample from the one before: one block, or a
    gap, behind which "before" follows from "later".
    """

    def decay(seconds: FloatArray) -> FloatArray:
        return np.where(memories_s > 0.0, np.exp(-seconds / np.maximum(memories_s, 1e-9)), seconds < _SAME_S)

    next_door = step_s < 1.5 * block_s
    gap, block = decay(np.maximum(step_s - 2.0 * block_s, 0.0)), decay(np.full(1, block_s))
    later = np.where(next_door, block, gap * block**2)
    shares = (np.where(next_door, 1.0, gap * block), np.where(next_door, 0.0, gap), np.where(next_door, 1.0, 0.0 * gap))
    return later, np.stack(np.broadcast_arrays(*shares), axis=1), block


@dataclass(frozen=True)
class RunGrams:
    """Runs of one campaign with their constants integrated out.

    Attributes
    ----------
    matrices : array, shape (runs, m, m)
    log_determinants : array, shape (runs,)
    samples : int array, shape (runs,)
        Whitened numbers.
    constants : array, shape (runs, l, m + o)
        Means of the constants, in units of their deviations, by each column.
    own : tuple of OwnGram
        Cross products of each run's own shapes.
    design : int array, shape (runs, 3)
        See `run_design`.
    static : array, shape (m, m)
        Of what the lifted wheel read.
    """

    matrices: FloatArray
    log_determinants: FloatArray
    samples: IndexArray
    constants: FloatArray
    own: tuple[OwnGram, ...]
    design: IndexArray
    static: FloatArray

    def runs(self, count: int) -> RunGrams:
        """Return the first runs only."""
        return replace(
            self,
            matrices=self.matrices[:count],
            log_determinants=self.log_determinants[:count],
            constants=self.constants[:count],
        )


_SAME_S = 1e-6
RUNS_AT_ONCE, BY_NUMPY = 4, 16
"""Runs of a wheel whose columns are padded and whitened together: what bounds the memory of a long campaign."""


def some_runs(runs: int, wheels: int = 1) -> Iterator[tuple[int, int]]:
    """Yield the first run and that behind the last of those that are whitened together."""
    step = max((RUNS_AT_ONCE if library() else BY_NUMPY) // wheels, 1)
    yield from ((first, min(first + step, runs)) for first in range(0, runs, step))


def whitened_rows(
    samples: Samples, linear: Linear, columns: Columns, values: Mapping[str, float], speed_variance: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield whitened rows of some runs after the other, shape (runs, rows, columns), and ln det, shape (runs,).

    Rows are padded with zeros, standstills come last. Constants of a run are columns still, scaled to one-sigma 1.
    Where the wheel was lifted, that comes last of all, as if it were a run.
    """
    at = places_of(samples.run, samples.runs)
    space = state_space(samples, linear, columns.present, values, speed_variance)
    variance = np.where(columns.rests_present, rest_variance(linear, samples, values), 1.0)
    lifted = samples.rests.lifted
    resting, of_run = columns.rests / np.sqrt(variance)[..., None], samples.rests.run[~lifted]
    rest_at = places_of(of_run, samples.runs)
    log_determinants = np.zeros(samples.runs)
    np.add.at(log_determinants, of_run, np.log(variance[:, ~lifted]).sum(axis=0))
    sigmas = np.array([values[name] for name in columns.constants])
    for first, last in some_runs(samples.runs):
        found = whiten(space.runs(first, last), at.padded_runs(columns.rows, first, last))
        rests = rest_at.padded_runs(resting[:, ~lifted], first, last)
        rows = np.concatenate([found.columns, rests.reshape(last - first, -1, rests.shape[-1])], axis=1)
        rows[..., columns.varying :] *= sigmas
        yield rows, found.log_determinants + log_determinants[first:last]
    if lifted.any():
        rows = resting[:, lifted].reshape(1, -1, resting.shape[-1])
        yield rows, np.array([np.log(variance[:, lifted]).sum()])


def run_grams(
    samples: Samples, linear: Linear, columns: Columns, values: Mapping[str, float], speed_variance: FloatArray
) -> RunGrams:
    """Return each run's Gram matrix with what is one value a run integrated out."""
    rows = whitened_rows(samples, linear, columns, values, speed_variance)
    lifted = samples.rests.lifted
    found = grams_of(rows, columns.varying, columns.shared, columns.catch_all.of_run)
    static = np.zeros((columns.shared, columns.shared))
    if lifted.any():
        static, found = found.matrices[-1], found.runs(samples.runs)
    counts = np.bincount(samples.run, columns.present.sum(axis=0), minlength=samples.runs)
    standing = columns.rests_present[:, ~lifted].sum(axis=0)
    counts += np.bincount(samples.rests.run[~lifted], standing, minlength=samples.runs)
    design = run_design(samples, linear, columns)
    return replace(found, samples=counts.astype(np.intp), design=design, static=static)


def grams_of(
    rows: Iterable[tuple[FloatArray, FloatArray]], keep: int, shared: int, of_run: Sequence[RunShapes]
) -> RunGrams:
    """Return the Gram matrices of whitened rows, with what is one value a run integrated out.

    The rows are of some runs after the other, with their log determinants (`whitened_rows`). `keep` and `shared` are
    how many columns stand before the constants, and before the shapes of single runs.
    """
    own: list[OwnGram] = []
    matrices, log_determinants, means = [], [], []
    for some, log_dets in rows:
        full = some.swapaxes(1, 2) @ some
        inner = np.eye(full.shape[-1] - keep) + full[:, keep:, keep:]
        across = full[:, keep:, :keep]
        solved = np.asarray(np.linalg.solve(inner, across))
        varying = full[:, :keep, :keep] - across.swapaxes(1, 2) @ solved
        for matrix, shapes in zip(varying, of_run[len(own) :], strict=False):
            end = shared + len(shapes.shapes)
            own.append(OwnGram(shapes, matrix[shared:end, :shared].copy(), matrix[shared:end, shared:end].copy()))
        matrices.append(varying[:, :shared, :shared].copy())
        log_determinants.append(log_dets + np.linalg.slogdet(inner)[1])
        means.append(solved)
    nothing = np.zeros(0, np.intp)
    return RunGrams(
        np.concatenate(matrices),
        np.concatenate(log_determinants),
        nothing,
        np.concatenate(means),
        tuple(own),
        np.zeros((0, 3), np.intp),
        np.zeros((shared, shared)),
    )


def run_design(samples: Samples, linear: Linear, columns: Columns) -> IndexArray:
    """Return which channels each run has, a bit for each; its direction; whether its pass is a later one; (runs, 3)."""
    found = np.zeros((samples.runs, 3), np.intp)
    for channel, present in zip(linear.channels, columns.present, strict=True):
        found[np.unique(samples.run[present]), 0] |= 1 << tuple(OUTPUTS).index(channel)
    passes = np.asarray(samples.conditions.pass_number)
    found[samples.run, 1:] = np.stack([samples.conditions.direction, passes > passes.min(initial=np.inf)], axis=1)
    return found


@dataclass(frozen=True)
class Remainder:
    """What an estimate leaves of the residual.

    Attributes
    ----------
    places : Places
        Of the samples.
    space : StateSpace
        The noise.
    values : array, shape (runs, longest, c)
    """

    places: Places
    space: StateSpace
    values: FloatArray


def remainder(
    samples: Samples,
    linear: Linear,
    columns: Columns,
    values: Mapping[str, float],
    speed_variance: FloatArray,
    coefficients: FloatArray,
) -> Remainder:
    """Return what an estimate leaves of the residual.

    `coefficients`, shape (runs, 1 + q + k + b + o + l), are of the columns: 1 for the residual, minus the estimate for
    the others.
    """
    at = places_of(samples.run, samples.runs)
    space = state_space(samples, linear, columns.present, values, speed_variance)
    return Remainder(at, space, at.padded(np.einsum("cnm,nm->cn", columns.rows, coefficients[samples.run])))


def smoothed_speed(left: Remainder, block_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the error of the measured ground speed that the data ask for, its slope, and its variance; (n,) each."""
    now, slope = np.zeros(len(left.space.variance)), np.zeros(len(left.space.variance))
    if near := left.space.neighbours:
        now[near.now] = 1.0
        slope[near.later], slope[near.before] = 0.5 / block_s, -0.5 / block_s
    found = []
    for first, last in some_runs(len(left.values)):
        means, covariances = smoothed(left.space.runs(first, last), left.values[first:last])
        found.append(np.stack([means @ now, means @ slope, covariances @ now @ now], axis=-1))
    speed, rate, variance = np.ascontiguousarray(left.places.flat(np.concatenate(found)).T)
    return speed, rate, variance


def innovations(left: Remainder) -> FloatArray:
    """Return the largest whitened residual of each sample over its channels, in one-sigma, shape (n,)."""
    found = whiten(left.space, left.values[..., None]).columns.reshape(left.values.shape)
    return np.asarray(np.abs(left.places.flat(found)).max(axis=-1))
