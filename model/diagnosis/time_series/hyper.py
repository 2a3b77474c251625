r"""Hyper-parameters of the noise by marginal likelihood.

The likelihood is that of the saturated model: soil, every cause and the catch-all are columns with their priors, so
that an effect which nobody has named yet does not pass for noise and hide itself. Shapes that only one run may show
are not among them: what has no pattern over the runs is noise, and with 2 % of the load as their prior they would take
what varies over a long time or distance, which would then be missing from the noise. With V the covariance of a run's
noise, X the columns, :math:`A = I + \sum_{runs} X'V^{-1}X`, :math:`P = V^{-1} - V^{-1}XA^{-1}X'V^{-1}`:

.. math:: -2 \ln L = \ln\det V + \ln\det A + r'Pr, \qquad
          \frac{\partial}{\partial\theta}(-2 \ln L) = \mathrm{tr}(P \dot V) - r'P \dot V P r.

Maximised by scoring with the average information :math:`\tfrac12 r'P\dot V_i P \dot V_j P r`, in logarithms, with
log-normal priors (docs/decisions/one-newton.md). Covariances, and their derivatives by every hyper-parameter, are
formed in blocks of a run, so that the cost is linear in its length.

Source: Patterson & Thompson (1971), Biometrika 58:545; Gilmour, Thompson & Cullis (1995), Biometrics 51:1440.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from daq import BoolArray, FloatArray, IndexArray
from model.compiled import NoiseAt, NoiseProcesses
from model.core_library import library
from model.cores import Ask, spread
from model.diagnosis.time_series.columns import Columns
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.noise import (
    HyperPrior,
    Noise,
    Process,
    constants,
    known_variance,
    loading,
    named,
    processes,
    rest_variance,
    slope_loading,
)
from model.diagnosis.time_series.samples import Samples, block_steps
from model.diagnosis.time_series.standstills import AT_REST

LONGEST = 200
"""Samples whose covariance is formed at once."""
MOST = 1500
"""Samples that tell the hyper-parameters well enough: of a longer campaign about so many are taken, from every run."""
_SHORTEST = 60
_SAME_SITE = 0.25
"""Of a block: sites that are nearer are one."""


@dataclass(frozen=True)
class Block:
    """Part of a run; rows are numbers that were measured, drives first, then standstills; shape (m,).

    Attributes
    ----------
    columns : array, shape (m, 1 + q + k + b)
        Residual first.
    seconds, metres : array, shape (sites, sites)
        Distance in time and along the track of two sites: samples, and what is a block before or behind one.
    processes : tuple of (Process, sparse array of shape (sites, m))
        With what each row sees of it: at the row's sample, and of a slope a block later and a block before.
    constants : tuple of (hyper-parameter, array of shape (m,))
    white : tuple of (hyper-parameter, bool array of shape (m,))
    fixed : array, shape (m,)
        Variances that no hyper-parameter moves.
    """

    columns: FloatArray
    seconds: FloatArray
    metres: FloatArray
    processes: tuple[tuple[Process, scipy.sparse.csr_array], ...]
    constants: tuple[tuple[str, FloatArray], ...]
    white: tuple[tuple[str, BoolArray], ...]
    fixed: FloatArray

    @cached_property
    def compiled(self) -> NoiseProcesses:
        """Processes as the compiled core takes them."""
        over_distance = [process.over_distance for process, _ in self.processes]
        lags = np.stack([self.seconds, self.metres])
        return NoiseProcesses([loads for _, loads in self.processes], lags, over_distance)


def blocks_of(
    samples: Samples, linear: Linear, columns: Columns, speed_variance: FloatArray, values: Mapping[str, float]
) -> list[Block]:
    """Cut a campaign into blocks.

    The hyper-parameters in `values` say how well a standstill's level is known from its own length.
    """
    found = []
    resting = rest_variance(linear, samples, {**values, **{named(c, "at_rest"): 0.0 for c in AT_REST}})
    second = known_variance(linear, speed_variance)
    seen, elapsed_s = _seen(samples, linear), np.cumsum(block_steps(samples))
    for run in range(samples.runs):
        own = np.flatnonzero((samples.run == run) & columns.present.any(axis=0))
        rest = np.flatnonzero((samples.rests.run == run) & ~samples.rests.lifted)
        for i, piece in enumerate(_pieces(own, len(own) * MOST // max(len(samples), MOST), run)):
            here = rest if i == 0 else rest[:0]
            if len(piece) or len(here):
                found.append(_block(samples, linear, columns, second, resting, piece, here, seen, elapsed_s))
    return found


def _pieces(own: IndexArray, most: int, first: int) -> list[IndexArray]:
    """Cut a run, and keep about `most` of its samples in whole pieces, beginning at another one in each run."""
    most = max(most, _SHORTEST)
    pieces = np.array_split(own, max(1, -(-len(own) // min(LONGEST, most))))
    apart = max(1, round(len(own) / most))
    return pieces[first % apart :: apart] or pieces[:1]


Seen = Sequence[tuple[Process, Sequence[tuple[int, FloatArray]]]]
"""Of each process: at which places a sample sees it (itself, a block later, a block before), and how, shape (c, n)."""


def _seen(samples: Samples, linear: Linear) -> Seen:
    by_slope = slope_loading(linear, samples)
    slope = [(1, by_slope), (2, -by_slope)]
    return [
        (p, [(0, loading(linear, samples, p.loading)), *(slope if p.has_slope else [])])
        for p in processes(linear.channels)
    ]


def _block(
    samples: Samples,
    linear: Linear,
    columns: Columns,
    second: FloatArray,
    resting: FloatArray,
    piece: IndexArray,
    rest: IndexArray,
    seen: Seen,
    elapsed_s: FloatArray,
) -> Block:
    channels = linear.channels
    sample, channel = np.nonzero(columns.present[:, piece].T)
    at = piece[sample]
    row, standing = np.nonzero(columns.rests_present[:, rest])
    standing = rest[standing]
    drives = len(at)
    both = np.concatenate([columns.rows[channel, at], columns.rests[row, standing]])

    def of_drive(x: FloatArray) -> FloatArray:
        return np.asarray(x[channel, at])

    ticks = elapsed_s[piece] + samples.block_s * np.array([[0.0], [1.0], [-1.0]])
    _, first, site = np.unique(np.round(ticks / (_SAME_SITE * samples.block_s)), return_index=True, return_inverse=True)
    site = site.reshape(ticks.shape)
    seconds, metres = ticks.ravel()[first], np.tile(samples.distance_m[piece], 3)[first]

    def by_site(places: Sequence[tuple[int, FloatArray]]) -> scipy.sparse.csr_array:
        values = np.concatenate([of_drive(x) for _, x in places])
        at = np.concatenate([site[place, sample] for place, _ in places]), np.tile(np.arange(drives), len(places))
        found = scipy.sparse.csr_array((values, at), shape=(len(seconds), len(both)))
        found.eliminate_zeros()
        return found

    turning = both[:, columns.varying :]
    white = []
    for i, c in enumerate(channels):
        white.append((named(c, "white"), np.concatenate([channel == i, np.zeros(len(row), bool)])))
        if c != "z":
            mine = row == AT_REST.index(c)
            white.append((named(c, "at_rest"), np.concatenate([np.zeros(drives, bool), mine])))
    return Block(
        columns=both[:, : columns.shared],
        seconds=np.abs(seconds[:, None] - seconds),
        metres=np.abs(metres[:, None] - metres),
        processes=tuple((p, by_site(places)) for p, places in seen),
        constants=tuple((name, turning[:, i]) for i, (name, _) in enumerate(constants(channels))),
        white=tuple(white),
        fixed=np.concatenate([of_drive(second), resting[row, standing]]),
    )


class _Processes:
    """Covariance of a block's processes, and its derivatives, by numpy.

    A process is kept over samples, since a row for each channel would repeat its kernel.
    """

    def __init__(self, block: Block, values: Mapping[str, float]) -> None:
        self._listed = []
        for process, loads in block.processes:
            by_time, kernel = None, np.eye(len(block.seconds))
            if process.time is not None:
                lag = (block.metres if process.over_distance else block.seconds) / values[process.time]
                kernel = np.exp(-lag)
                by_time = lag * kernel
            scaled = values[process.deviation] * loads
            self._listed.append((scaled, scaled.T.tocsr(), kernel, (by_time, 2.0 * kernel)))

    def add_to(self, covariance: FloatArray) -> None:
        """See `model.compiled.NoiseAt`, also of the others."""
        for _, back, kernel, _ in self._listed:
            covariance += back @ (back @ kernel).T

    def slope_products(self, x: FloatArray) -> FloatArray:
        found = np.zeros((len(self._listed), 2, len(x)))
        for own, (loads, back, _, slopes) in zip(found, self._listed, strict=True):
            by_sample = loads @ x
            for i, slope in enumerate(slopes):
                if slope is not None:
                    own[i] = back @ (slope @ by_sample)
        return found

    def slope_traces(self, other: FloatArray) -> FloatArray:
        found = np.zeros((len(self._listed), 2))
        for own, (loads, _, _, slopes) in zip(found, self._listed, strict=True):
            seen = loads @ (loads @ other).T
            own[:] = [0.0 if slope is None else np.vdot(seen, slope) for slope in slopes]
        return found


class _Covariance:
    """Covariance of a block's noise (m, m), and its derivatives by the logarithms of h hyper-parameters."""

    def __init__(self, block: Block, values: Mapping[str, float], names: Sequence[str]) -> None:
        place = {name: i for i, name in enumerate(names)}
        self._fixed = block.fixed
        listed = [process for process, _ in block.processes]
        self._processes: _Processes | NoiseAt
        if core := library():
            times = np.array([values[p.time] if p.time else 0.0 for p in listed])
            self._processes = block.compiled.at(core, times, np.array([values[p.deviation] for p in listed]))
        else:
            self._processes = _Processes(block, values)
        self._of_process = np.array([[place.get(p.time or "", -1), place[p.deviation]] for p in listed])
        self._constants = np.column_stack([values[name] * loads for name, loads in block.constants])
        self._of_constant = np.array([place[name] for name, _ in block.constants])
        self._white = np.column_stack([values[name] ** 2 * chosen for name, chosen in block.white])
        self._of_white = np.array([place[name] for name, _ in block.white])
        self._count = len(names)

    def matrix(self) -> FloatArray:
        """Return it."""
        found = np.asarray(self._constants @ self._constants.T)
        self._processes.add_to(found)
        found[np.diag_indices_from(found)] += self._fixed + self._white.sum(axis=1)
        return found

    def slopes_times(self, x: FloatArray) -> FloatArray:
        """Return the product of each derivative with a vector (m,), shape (m, h)."""
        found = np.zeros((self._count, len(x)))
        self._add(found, self._processes.slope_products(x))
        np.add.at(found, self._of_constant, 2.0 * self._constants.T * (x @ self._constants)[:, None])
        np.add.at(found, self._of_white, 2.0 * self._white.T * x)
        return found.T

    def slope_traces(self, other: FloatArray) -> FloatArray:
        """Return the trace of each derivative's product with a symmetric matrix (m, m), shape (h,)."""
        found = np.zeros(self._count)
        self._add(found, self._processes.slope_traces(other))
        np.add.at(found, self._of_constant, 2.0 * (self._constants * (other @ self._constants)).sum(axis=0))
        np.add.at(found, self._of_white, 2.0 * np.diag(other) @ self._white)
        return found

    def _add(self, found: FloatArray, by_process: FloatArray) -> None:
        """Add what is by ln time and ln sigma of each process, (P, 2, ...), to what is by hyper-parameter, (h, ...)."""
        there = self._of_process >= 0
        np.add.at(found, self._of_process[there], by_process[there])


_MOST_STEPS = 12
_LARGEST_STEP = 1.0
_ENOUGH = 0.05
"""Gain of log likelihood by a step, nats, that is not worth it."""


@dataclass(frozen=True)
class Objective:
    """Minus the log posterior, and what returns its gradient and information by the logarithms of hyper-parameters.

    They cost as much again, and are asked for only of a step that is taken, before the next is tried.
    """

    value: float
    slopes: Callable[[], tuple[FloatArray, FloatArray]]


def estimated(
    blocks: Sequence[Block], hyper_priors: Mapping[str, HyperPrior], start: Mapping[str, float] | None = None
) -> Noise:
    """Return the most probable hyper-parameters; of those of few values the root mean square.

    By default it starts at the priors' centres; there is one of every hyper-parameter.
    """
    names = list(hyper_priors)
    centre = np.log([hyper_priors[name].centre for name in names])
    weight = np.array([hyper_priors[name].log_sigma for name in names]) ** -2.0
    at = np.log([start[name] for name in names]) if start else centre
    with spread([Piece(block) for block in blocks], rows=sum(len(block.columns) for block in blocks)) as pieces:
        found = _posterior(pieces, names, at, centre, weight)
        gradient, information = found.slopes()
        damping = 0.0
        for _ in range(_MOST_STEPS):
            step = -np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
            if -0.5 * float(step @ gradient) < _ENOUGH:
                break
            step *= min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-300))
            tried = _posterior(pieces, names, at + step, centre, weight)
            if tried.value <= found.value:
                at, found, damping = at + step, tried, damping / 4.0
                gradient, information = found.slopes()
            else:
                damping = max(4.0 * damping, 0.5)
    log_sigmas = np.sqrt(np.diag(np.linalg.inv(information)))
    of_few = np.array([hyper_priors[name].of_few for name in names])
    values = np.exp(at + np.where(of_few, log_sigmas**2, 0.0))
    return Noise(
        {name: float(x) for name, x in zip(names, values, strict=True)},
        {name: float(s) for name, s in zip(names, log_sigmas, strict=True)},
    )


def _posterior(pieces: Ask, names: list[str], at: FloatArray, centre: FloatArray, weight: FloatArray) -> Objective:
    values = {name: float(np.exp(x)) for name, x in zip(names, at, strict=True)}
    data = likelihood(pieces, values, names)
    off = at - centre

    def slopes() -> tuple[FloatArray, FloatArray]:
        gradient, information = data.slopes()
        return gradient + weight * off, information + np.diag(weight)

    return Objective(data.value + 0.5 * float(weight @ off**2), slopes)


@dataclass(frozen=True)
class _Sums:
    """What a block adds to the likelihood: of the columns and the residual."""

    inner: FloatArray
    side: FloatArray
    square: float
    log_determinant: float


class Piece:
    """A block at the hyper-parameters that were given last."""

    def __init__(self, block: Block) -> None:
        self._columns = block.columns
        self._block = block

    def sums(self, values: Mapping[str, float], names: Sequence[str]) -> _Sums:
        """Return what it adds to the likelihood."""
        self._covariance = _Covariance(self._block, values, names)
        self._root = _root(self._covariance.matrix())
        self._white = _solved(self._root, self._columns, transposed=False)
        total = self._white.T @ self._white
        log_determinant = 2.0 * float(np.log(np.diag(self._root)).sum())
        return _Sums(total[1:, 1:], total[1:, 0], float(total[0, 0]), log_determinant)

    def slopes(self, best: FloatArray, back: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what it adds to gradient (h,) and information (h, h), and the slopes seen by the columns (w, h).

        `best`, shape (w,), are the columns' coefficients; the square of `back`, shape (w, w), is their covariance.
        """
        inverse, solved = _inverse(self._root), _solved(self._root, self._white, transposed=True)
        left = solved @ np.r_[1.0, -best]
        moved = self._covariance.slopes_times(left)
        information = 0.5 * moved.T @ inverse @ moved
        across = solved[:, 1:].T @ moved
        inverse -= _square(np.column_stack([solved[:, 1:] @ back, left]))
        return 0.5 * self._covariance.slope_traces(inverse), information, across


def likelihood(pieces: Ask, values: Mapping[str, float], names: Sequence[str]) -> Objective:
    """Return minus the log marginal likelihood, as of gradient and information by the logarithms of `names`.

    The pieces are those of all blocks, spread over processes.
    """
    found: list[_Sums] = pieces("sums", values, names)
    width = len(found[0].side) if found else 0
    inner = sum((sums.inner for sums in found), np.eye(width))
    side = sum((sums.side for sums in found), np.zeros(width))
    root = np.linalg.cholesky(inner)
    best = np.linalg.solve(inner, side)
    log_determinant = sum(sums.log_determinant for sums in found) + 2.0 * float(np.log(np.diag(root)).sum())
    square = sum(sums.square for sums in found) - float(side @ best)

    def slopes() -> tuple[FloatArray, FloatArray]:
        gradient, information = np.zeros(len(names)), np.zeros((len(names), len(names)))
        across = np.zeros((width, len(names)))
        for of_gradient, of_information, of_across in pieces("slopes", best, np.linalg.inv(root).T):
            gradient += of_gradient
            information += of_information
            across += of_across
        return gradient, information - 0.5 * across.T @ np.linalg.solve(inner, across)

    return Objective(0.5 * (log_determinant + square), slopes)


def _square(x: FloatArray) -> FloatArray:
    return np.asarray(x @ x.T)


def _root(covariance: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor of a covariance."""
    from scipy.linalg.lapack import dpotrf

    root, failed = dpotrf(covariance.T, lower=1)
    if failed:
        raise np.linalg.LinAlgError("a covariance of the noise is not positive definite")
    return np.asarray(root)


def _solved(root: FloatArray, columns: FloatArray, *, transposed: bool) -> FloatArray:
    """Return columns divided by a lower factor, or by its transpose."""
    from scipy.linalg.lapack import dtrtrs

    return np.asarray(dtrtrs(root, columns, lower=1, trans=int(transposed))[0])


def _inverse(root: FloatArray) -> FloatArray:
    """Return the inverse of the covariance of a lower factor."""
    from scipy.linalg.lapack import dpotri

    lower, _ = dpotri(root, lower=1)
    inverse = np.asarray(lower + lower.T)
    inverse[np.diag_indices_from(inverse)] *= 0.5
    return inverse
