r"""Hyper-parameters of the noise by marginal likelihood.

The likelihood is that of the saturated model: soil, every cause and the catch-all are columns with their priors, so
that an effect which nobody has named yet does not pass for noise and hide itself. With V the covariance of a run's
noise, X the columns, :math:`A = I + \sum_{runs} X'V^{-1}X`, :math:`P = V^{-1} - V^{-1}XA^{-1}X'V^{-1}`:

.. math:: -2 \ln L = \ln\det V + \ln\det A + r'Pr, \qquad
          \frac{\partial}{\partial\theta}(-2 \ln L) = \mathrm{tr}(P \dot V) - r'P \dot V P r.

Maximised by scoring with the average information :math:`\tfrac12 r'P\dot V_i P \dot V_j P r`, in logarithms, with
log-normal priors (docs/decisions/one-newton.md). Covariances, and their derivatives by every hyper-parameter, are
formed in blocks of a run, so that the cost is linear in its length; shapes of single runs are integrated out run by
run.

Source: Patterson & Thompson (1971), Biometrika 58:545; Gilmour, Thompson & Cullis (1995), Biometrics 51:1440.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.time_series.columns import Columns
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.noise import (
    HyperPrior,
    Noise,
    Process,
    constants,
    loading,
    named,
    processes,
    rest_variance,
    second_order_variance,
)
from model.diagnosis.time_series.samples import AT_REST, Samples

LONGEST = 200
"""Samples whose covariance is formed at once."""
MOST = 1500
"""Samples that tell the hyper-parameters well enough: of a longer campaign about so many are taken, from every run."""
_SHORTEST = 60


@dataclass(frozen=True)
class Block:
    """Part of a run; rows are numbers that were measured, drives first, then standstills; shape (m,).

    Attributes
    ----------
    run : int
    columns : array, shape (m, 1 + q + k + b)
        Residual first.
    own : array, shape (m, o)
        Of the shapes that only this run may show.
    seconds, metres : array, shape (samples, samples)
        Distance of two samples in time and along the track.
    sample : int array, shape (driving rows,)
        Sample of each driving row.
    processes : tuple of (Process, array of shape (driving rows,))
        With what each row sees of it.
    constants : tuple of (hyper-parameter, array of shape (m,))
    white : tuple of (hyper-parameter, bool array of shape (m,))
    fixed : array, shape (m,)
        Variances that no hyper-parameter moves.
    """

    run: int
    columns: FloatArray
    own: FloatArray
    seconds: FloatArray
    metres: FloatArray
    sample: IndexArray
    processes: tuple[tuple[Process, FloatArray], ...]
    constants: tuple[tuple[str, FloatArray], ...]
    white: tuple[tuple[str, BoolArray], ...]
    fixed: FloatArray


def blocks_of(
    samples: Samples, linear: Linear, columns: Columns, speed_variance: FloatArray, values: Mapping[str, float]
) -> list[Block]:
    """Cut a campaign into blocks.

    Parameters
    ----------
    values : mapping
        Hyper-parameters that say how well a standstill's level is known from its own length.
    """
    found = []
    resting = rest_variance(linear, samples, {**values, **{named(c, "at_rest"): 0.0 for c in AT_REST}})
    second = second_order_variance(linear, speed_variance)
    for run in range(samples.runs):
        own = np.flatnonzero((samples.run == run) & columns.present.any(axis=0))
        rest = np.flatnonzero(samples.rests.run == run)
        for i, piece in enumerate(_pieces(own, len(own) * MOST // max(len(samples), MOST), run)):
            here = rest if i == 0 else rest[:0]
            if len(piece) or len(here):
                found.append(_block(samples, linear, columns, second, resting, run, piece, here))
    return found


def _pieces(own: IndexArray, most: int, first: int) -> list[IndexArray]:
    """Cut a run, and keep about `most` of its samples in whole pieces, beginning at another one in each run."""
    most = max(most, _SHORTEST)
    pieces = np.array_split(own, max(1, -(-len(own) // min(LONGEST, most))))
    apart = max(1, round(len(own) / most))
    return pieces[first % apart :: apart] or pieces[:1]


def _block(
    samples: Samples,
    linear: Linear,
    columns: Columns,
    second: FloatArray,
    resting: FloatArray,
    run: int,
    piece: IndexArray,
    rest: IndexArray,
) -> Block:
    channels = linear.channels
    sample, channel = np.nonzero(columns.present[:, piece].T)
    at = piece[sample]
    row, standing = np.nonzero(columns.rests_present[:, rest])
    standing = rest[standing]
    drives, shared = len(at), columns.shared
    both = np.concatenate([columns.rows[channel, at], columns.rests[row, standing]])

    def of_drive(x: FloatArray) -> FloatArray:
        return np.asarray(x[channel, at])

    turning = both[:, columns.varying :]
    white = []
    for i, c in enumerate(channels):
        white.append((named(c, "white"), np.concatenate([channel == i, np.zeros(len(row), bool)])))
        if c != "z":
            mine = row == AT_REST.index(c)
            white.append((named(c, "at_rest"), np.concatenate([np.zeros(drives, bool), mine])))
    return Block(
        run=run,
        columns=both[:, :shared],
        own=both[:, shared : shared + len(columns.catch_all.of_run[run].shapes)],
        seconds=np.abs(samples.time_s[piece, None] - samples.time_s[piece]),
        metres=np.abs(samples.distance_m[piece, None] - samples.distance_m[piece]),
        sample=sample,
        processes=tuple((p, of_drive(loading(linear, samples, p.loading))) for p in processes(channels)),
        constants=tuple((name, turning[:, i]) for i, (name, _) in enumerate(constants(channels))),
        white=tuple(white),
        fixed=np.concatenate([of_drive(second), resting[row, standing]]),
    )


class Slope(Protocol):
    """Derivative of a block's covariance by the logarithm of a hyper-parameter."""

    @property
    def name(self) -> str:
        """Of the hyper-parameter."""
        ...

    def trace_with(self, other: FloatArray) -> float:
        """Return the trace of its product with a symmetric matrix, shape (m, m)."""
        ...

    def times(self, x: FloatArray) -> FloatArray:
        """Return its product with a vector, shape (m,)."""
        ...


@dataclass(frozen=True)
class _Diagonal:
    """A slope with `values` on the diagonal, at some rows."""

    name: str
    rows: IndexArray
    values: FloatArray

    def trace_with(self, other: FloatArray) -> float:
        return float(other[self.rows, self.rows] @ self.values)

    def times(self, x: FloatArray) -> FloatArray:
        return _spread(self.values * x[self.rows], self.rows, len(x))


@dataclass(frozen=True)
class _Outer:
    """A slope that is the outer product of `values` at some rows."""

    name: str
    rows: IndexArray
    values: FloatArray

    def trace_with(self, other: FloatArray) -> float:
        return float(self.values @ _square_of(other, self.rows) @ self.values)

    def times(self, x: FloatArray) -> FloatArray:
        return _spread(self.values * float(self.values @ x[self.rows]), self.rows, len(x))


@dataclass(frozen=True)
class _Process:
    """A slope, or a covariance, of a process: loads_i K(sample_i, sample_j) loads_j at some rows.

    Only the kernel over samples is kept: a row for each channel repeats it.
    """

    name: str
    rows: IndexArray
    sample: IndexArray
    loads: FloatArray
    kernel: FloatArray

    def over_rows(self) -> FloatArray:
        """Return it over its rows."""
        return np.asarray(self._kernel() * self.loads * self.loads[:, None])

    def trace_with(self, other: FloatArray) -> float:
        return float(self.loads @ (_square_of(other, self.rows) * self._kernel()) @ self.loads)

    def times(self, x: FloatArray) -> FloatArray:
        by_sample = np.bincount(self.sample, self.loads * x[self.rows], minlength=len(self.kernel))
        return _spread(self.loads * (self.kernel @ by_sample)[self.sample], self.rows, len(x))

    def _kernel(self) -> FloatArray:
        return self.kernel.take(self.sample, 0).take(self.sample, 1)


def _square_of(matrix: FloatArray, rows: IndexArray) -> FloatArray:
    return matrix if len(rows) == len(matrix) else matrix[np.ix_(rows, rows)]


def _spread(values: FloatArray, rows: IndexArray, length: int) -> FloatArray:
    out = np.zeros(length)
    out[rows] = values
    return out


def derivatives(block: Block, values: Mapping[str, float]) -> tuple[FloatArray, list[Slope]]:
    """Return the covariance, shape (m, m), and its derivatives."""
    covariance = np.diag(block.fixed)
    slopes: list[Slope] = []
    for process, loads in block.processes:
        rows = np.flatnonzero(loads)
        scaled, kernel = values[process.deviation] * loads[rows], np.eye(len(block.seconds))
        if process.time is not None:
            lag = (block.metres if process.over_distance else block.seconds) / values[process.time]
            kernel = np.exp(-lag)
            slopes.append(_Process(process.time, rows, block.sample[rows], scaled, lag * kernel))
        own = _Process(process.deviation, rows, block.sample[rows], scaled, kernel)
        covariance[np.ix_(rows, rows)] += own.over_rows()
        slopes.append(replace(own, kernel=2.0 * kernel))
    for name, loads in block.constants:
        rows = np.flatnonzero(loads)
        scaled = values[name] * loads[rows]
        covariance[np.ix_(rows, rows)] += np.outer(scaled, scaled)
        slopes.append(_Outer(name, rows, np.sqrt(2.0) * scaled))
    for name, chosen in block.white:
        rows = np.flatnonzero(chosen)
        covariance[rows, rows] += values[name] ** 2
        slopes.append(_Diagonal(name, rows, np.full(len(rows), 2.0 * values[name] ** 2)))
    return covariance, slopes


OF_FEW = (
    *("_run_to_run", "_at_rest_n", "_at_rest_nm", "_standing_n", "_standing_nm"),
    *("_of_run_n", "_of_run_nm", "_of_run_m"),
)
"""Ends of the names of deviations that are estimated from as few values as there are runs or standstills.

Their estimate is the posterior root mean square, not the mode, which would underestimate what differs between runs.
"""
_MOST_STEPS = 12
_LARGEST_STEP = 1.0
_ENOUGH = 0.05
"""Gain of log likelihood by a step, nats, that is not worth it."""


@dataclass(frozen=True)
class Objective:
    """Minus the log posterior, its gradient and information by the logarithms of the hyper-parameters."""

    value: float
    gradient: FloatArray
    information: FloatArray


def estimated(
    blocks: Sequence[Block], hyper_priors: Mapping[str, HyperPrior], start: Mapping[str, float] | None = None
) -> Noise:
    """Return the most probable hyper-parameters; of those in `OF_FEW` the root mean square.

    Parameters
    ----------
    hyper_priors : mapping name -> Belief
        Of every hyper-parameter.
    start : mapping, optional
        Where to start; the priors' centres by default.
    """
    names = list(hyper_priors)
    centre = np.log([hyper_priors[name].centre for name in names])
    weight = np.array([hyper_priors[name].log_sigma for name in names]) ** -2.0
    at = np.log([start[name] for name in names]) if start else centre
    found = _posterior(blocks, names, at, centre, weight)
    damping = 0.0
    for _ in range(_MOST_STEPS):
        step = -np.linalg.solve(found.information + damping * np.diag(np.diag(found.information)), found.gradient)
        if -0.5 * float(step @ found.gradient) < _ENOUGH:
            break
        step *= min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-300))
        tried = _posterior(blocks, names, at + step, centre, weight)
        if tried.value <= found.value:
            at, found, damping = at + step, tried, damping / 4.0
        else:
            damping = max(4.0 * damping, 0.5)
    spread = np.sqrt(np.diag(np.linalg.inv(found.information)))
    of_few = np.array([name.endswith(OF_FEW) for name in names])
    values = np.exp(at + np.where(of_few, spread**2, 0.0))
    return Noise(
        {name: float(x) for name, x in zip(names, values, strict=True)},
        {name: float(s) for name, s in zip(names, spread, strict=True)},
    )


def _posterior(
    blocks: Sequence[Block], names: list[str], at: FloatArray, centre: FloatArray, weight: FloatArray
) -> Objective:
    values = {name: float(np.exp(x)) for name, x in zip(names, at, strict=True)}
    data = likelihood(blocks, values, names)
    off = at - centre
    return Objective(
        data.value + 0.5 * float(weight @ off**2),
        data.gradient + weight * off,
        data.information + np.diag(weight),
    )


@dataclass
class _RunColumns:
    """Cross products of a run's own shapes (o) with each other, with the shared columns (s) and with the residual."""

    inner: FloatArray
    across: FloatArray
    side: FloatArray

    def add(self, own: FloatArray, solved: FloatArray, solved_own: FloatArray) -> None:
        """Add those of a block, given its columns times the inverse of its covariance."""
        self.inner += own.T @ solved_own
        self.across += own.T @ solved[:, 1:]
        self.side += own.T @ solved[:, 0]


def likelihood(blocks: Sequence[Block], values: Mapping[str, float], names: list[str]) -> Objective:
    """Return minus the log marginal likelihood, and its gradient and information by the logarithms of `names`.

    The shapes of a single run are integrated out run by run, so that the cost is linear in the number of runs.
    """
    width = blocks[0].columns.shape[1] - 1 if blocks else 0
    inner, side, square, log_determinant = np.eye(width), np.zeros(width), 0.0, 0.0
    own: dict[int, _RunColumns] = {}
    parts = []
    for block in blocks:
        covariance, slopes = derivatives(block, values)
        inverse, log_det = _inverse(covariance)
        solved, solved_own = inverse @ block.columns, inverse @ block.own
        inner += block.columns[:, 1:].T @ solved[:, 1:]
        side += block.columns[:, 1:].T @ solved[:, 0]
        square += float(block.columns[:, 0] @ solved[:, 0])
        log_determinant += log_det
        o = block.own.shape[1]
        mine = own.setdefault(block.run, _RunColumns(np.eye(o), np.zeros((o, width)), np.zeros(o)))
        mine.add(block.own, solved, solved_own)
        parts.append((block.run, slopes, inverse, solved, solved_own))
    for mine in own.values():
        inner -= mine.across.T @ np.linalg.solve(mine.inner, mine.across)
        side -= mine.across.T @ np.linalg.solve(mine.inner, mine.side)
        square -= float(mine.side @ np.linalg.solve(mine.inner, mine.side))
        log_determinant += np.linalg.slogdet(mine.inner)[1]
    root = np.linalg.cholesky(inner)
    best = np.linalg.solve(inner, side)
    back = np.linalg.inv(root).T
    place = {name: i for i, name in enumerate(names)}
    gradient, information = np.zeros(len(names)), np.zeros((len(names), len(names)))
    across = np.zeros((width, len(names)))
    moved_own: dict[int, FloatArray] = {}
    for run, slopes, inverse, solved, solved_own in parts:
        mine = own[run]
        determined = np.linalg.solve(mine.inner, np.c_[mine.side - mine.across @ best, mine.across])
        shared = solved[:, 1:] - solved_own @ determined[:, 1:]
        left = solved[:, 0] - solved[:, 1:] @ best - solved_own @ determined[:, 0]
        moved = np.zeros((len(left), len(names)))
        for slope in slopes:
            moved[:, place[slope.name]] += slope.times(left)
        information += 0.5 * moved.T @ inverse @ moved
        across += solved[:, 1:].T @ moved
        moved_own[run] = moved_own.get(run, 0.0) + solved_own.T @ moved
        inverse -= _square(shared @ back)
        inverse -= _square(solved_own @ np.linalg.inv(np.linalg.cholesky(mine.inner)).T)
        inverse -= np.outer(left, left)
        for slope in slopes:
            gradient[place[slope.name]] += 0.5 * slope.trace_with(inverse)
    for run, moved in moved_own.items():
        mine = own[run]
        information -= 0.5 * moved.T @ np.linalg.solve(mine.inner, moved)
        across -= mine.across.T @ np.linalg.solve(mine.inner, moved)
    information -= 0.5 * across.T @ np.linalg.solve(inner, across)
    value = 0.5 * (log_determinant + 2.0 * float(np.log(np.diag(root)).sum()) + square - float(side @ best))
    return Objective(value, gradient, information)


def _square(x: FloatArray) -> FloatArray:
    return np.asarray(x @ x.T)


def _inverse(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Return the inverse of a covariance, and its log determinant."""
    from scipy.linalg.lapack import dpotrf, dpotri

    root, failed = dpotrf(covariance.T, lower=1)
    if failed:
        raise np.linalg.LinAlgError("a covariance of the noise is not positive definite")
    inverse, _ = dpotri(root, lower=1)
    lower = np.tril(inverse, -1)
    return lower + lower.T + np.diag(np.diag(inverse)), 2.0 * float(np.log(np.diag(root)).sum())
