"""Calls of the compiled core (model/compiled.c), which believes what it is given.

So the type, size and order of every array are checked here, and every position that it uses as an index.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from daq import FloatArray, IndexArray

RESULTANTS, ENTRIES = 6, 13
"""Numbers of a patch: what is integrated, and what decides it."""


def contact(
    core: ctypes.CDLL, entries: Sequence[Any], count: int, rules: FloatArray, wanted: int
) -> tuple[FloatArray, FloatArray]:
    """Return Eq. 7-9 of patches, shape (6, n), and their derivatives, shape (wanted entries, 6, n).

    The 13 entries, in the order of `Patch`, are numbers or arrays of shape (n, 1); bit i of `wanted` asks for the
    derivatives by entry i. `rules`, shape (27 * nodes,), has nodes, what is left of them to 1, and weights, of the
    rules (start, end, none): first of so many nodes, then of twice as many. `ValueError` for a wrong size or type.
    """
    if not 0 <= wanted < 1 << ENTRIES:
        raise ValueError(f"expected derivatives by some of {ENTRIES} entries, got {wanted:b}")
    arrays, strides = _columns(entries, count)
    pointers = _pointers(arrays)
    values = np.empty((RESULTANTS, count))
    derivatives = np.empty((wanted.bit_count(), RESULTANTS, count))
    core.contact(
        count,
        pointers.ctypes.data,
        strides.ctypes.data,
        _nodes(rules),
        _sized(rules, rules.shape),
        wanted,
        values.ctypes.data,
        derivatives.ctypes.data,
    )
    return values, derivatives


def balance(
    core: ctypes.CDLL,
    entries: Sequence[Any],
    rules: FloatArray,
    load: FloatArray,
    start: FloatArray,
    limits: tuple[float, float, float],
) -> FloatArray:
    """Return the sinkage at which each patch carries its load, shape (n, 1); NaN where none does.

    Entries and rules are those of `contact`; the entry angle is not used. The load is in N, the start a first guess in
    m, shape (n, 1) both. The limits are the tolerance of ln W, the share of the radius where to start without a guess,
    and the deepest, as a share. `ValueError` for a wrong size or type.
    """
    count = len(load)
    arrays, strides = _columns(entries, count)
    load, start = np.ascontiguousarray(load, float), np.ascontiguousarray(start, float)
    pointers = _pointers(arrays)
    found = np.empty((count, 1))
    core.balance(
        count,
        pointers.ctypes.data,
        strides.ctypes.data,
        _nodes(rules),
        _sized(rules, rules.shape),
        *limits,
        _sized(load, (count, 1)),
        _sized(start, (count, 1)),
        found.ctypes.data,
    )
    return found


def weigh(
    core: ctypes.CDLL, precision: FloatArray, side: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return what decides the evidence of R replicates of S sets with m columns, shape (3, R, S).

    That is ln det of the precision, the fall of the residual's square, and the log probability of the bounds' box. The
    precision has the shape (m, m, R, S), `side` (m, R, S), and the bounds of the coefficients (m, S). `ValueError` for
    a wrong size or type.
    """
    shape = columns, replicates, sets = side.shape
    side, lower, upper = (np.ascontiguousarray(x, float) for x in (side, lower, upper))
    found, work = np.empty((3, replicates, sets)), np.empty(columns * columns + columns)
    core.weigh(
        *shape,
        _sized(precision, (columns, *shape)),
        _sized(side, shape),
        _sized(lower, (columns, sets)),
        _sized(upper, (columns, sets)),
        *(x.ctypes.data for x in found),
        work.ctypes.data,
    )
    return found


class StateSpace:
    """Noise of R runs of N samples in C channels by S states, as the compiled filter takes it.

    `noise` is the loadings (R, N, C, S), decay (R, N, S), stationary covariance (S, S) and white variance (R, N, C);
    `neighbours` is the positions of the states later, now and before (L,) and the shares (R, N, 3, L). `ValueError` for
    a wrong size or type, or a position outside the states.
    """

    def __init__(
        self,
        core: ctypes.CDLL,
        noise: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        neighbours: tuple[IndexArray, IndexArray, IndexArray, FloatArray],
    ) -> None:
        self._core = core
        self._shape = runs, samples, channels, states = noise[0].shape
        self._count = len(neighbours[0])
        self._numbers = [np.ascontiguousarray(x, float) for x in (*noise[1:3], neighbours[3], noise[0], noise[3])]
        shapes = (
            *((runs, samples, states), (states, states), (runs, samples, 3, self._count)),
            *(self._shape, (runs, samples, channels)),
        )
        self._decay, self._stationary, self._shares, self._loadings, self._white = (
            _sized(x, shape) for x, shape in zip(self._numbers, shapes, strict=True)
        )
        self._positions = [np.ascontiguousarray(x, np.int64) for x in neighbours[:3]]
        if any(x.shape != (self._count,) or np.any((x < 0) | (x >= states)) for x in self._positions):
            raise ValueError("a position is outside the states")
        self._near = tuple(x.ctypes.data for x in self._positions)

    def whiten(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened columns, shape (R, N, C, M), and ln det of each run's covariance, shape (R,)."""
        return self._filtered(columns, None, None)

    def smooth(self, data: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means, shape (R, N, S), and covariances, shape (R, N, S, S), of the states given data (R, N, C)."""
        runs, samples, _, states = self._shape
        means, covariances = np.zeros((runs, samples, states)), np.zeros((runs, samples, states, states))
        self._filtered(data[..., None], means, covariances)
        work, sizes = np.empty(4 * states * states + states), np.array([samples, states, self._count], np.int64)
        decay, _, shares, *_ = self._numbers
        for own in zip(decay, shares, means, covariances, strict=True):
            own_decay, own_shares, mean, covariance = (x.ctypes.data for x in own)
            given = (sizes.ctypes.data, own_decay, self._stationary, *self._near, own_shares)
            self._core.smooth_back(*given, mean, covariance, work.ctypes.data)
        return means, covariances

    def _filtered(
        self, columns: FloatArray, means: FloatArray | None, covariances: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        runs, samples, channels, states = self._shape
        columns = np.ascontiguousarray(columns, float)
        width = columns.shape[-1]
        given = _sized(columns, (runs, samples, channels, width))
        sizes = np.array([*self._shape, width, self._count], np.int64)
        out, log_determinants = np.empty_like(columns), np.empty(runs)
        work = np.empty(states * width + states * states + 2 * states)
        kept = (0 if x is None else x.ctypes.data for x in (means, covariances))
        noise = (self._loadings, self._decay, self._stationary, self._white, *self._near, self._shares)
        found = (out.ctypes.data, log_determinants.ctypes.data)
        self._core.whiten(sizes.ctypes.data, *noise, given, *found, *kept, work.ctypes.data)
        return out, log_determinants


class NoiseProcesses:
    """Processes of a noise over sites, and what each measured number sees of them.

    `loads` are sparse arrays (CSR) of shape (sites, m), one for each process. `lags`, shape (2, sites, sites), is the
    distance of two sites in time and along the track; `over_distance` says which of the two counts for each process.
    `ValueError` for a wrong size or type.
    """

    def __init__(self, loads: Sequence[Any], lags: FloatArray, over_distance: Sequence[bool]) -> None:
        sites, numbers = loads[0].shape
        if any(load.shape != (sites, numbers) for load in loads):
            raise ValueError("expected loads of the same sites and numbers")
        before = np.cumsum([0, *(load.nnz for load in loads)])
        self._lags = np.ascontiguousarray(lags, float)
        self._starts = np.concatenate([load.indptr + first for load, first in zip(loads, before, strict=False)])
        self._starts = self._starts.astype(np.int64)
        self._at = np.concatenate([load.indices for load in loads]).astype(np.int64)
        self._loads = np.concatenate([load.data for load in loads]).astype(float)
        self._over_distance = np.array(over_distance, np.int64)
        self._sizes = np.array([len(loads), sites, numbers], np.int64)
        inside = np.all((self._at >= 0) & (self._at < numbers)) and len(self._at) == len(self._loads) == before[-1]
        ordered = np.all(np.diff(self._starts) >= 0) and self._starts[0] == 0 and self._starts[-1] == before[-1]
        fits = len(self._starts) == len(loads) * (sites + 1) and len(over_distance) == len(loads)
        if not (inside and ordered and fits and set(self._over_distance) <= {0, 1}):
            raise ValueError("expected loads inside the numbers, and a distance for each process")
        _sized(self._lags, (2, sites, sites))

    def at(self, core: ctypes.CDLL, times: FloatArray, sigmas: FloatArray) -> NoiseAt:
        """Return them with correlation times (0: white) and deviations, shape (P,) each."""
        return NoiseAt(core, self, times, sigmas)


class NoiseAt:
    """Processes of a noise at given hyper-parameters: their covariance, and its derivatives by ln time and ln sigma."""

    def __init__(self, core: ctypes.CDLL, of: NoiseProcesses, times: FloatArray, sigmas: FloatArray) -> None:
        self._core, self._of = core, of
        self._count, self._sites, self._numbers = (int(x) for x in of._sizes)
        self._times, self._sigmas = (np.ascontiguousarray(x, float) for x in (times, sigmas))
        for x in (self._times, self._sigmas):
            _sized(x, (self._count,))
        self._kernels = np.empty((self._count, self._sites, self._sites))
        out, lags, which = self._kernels.ctypes.data, of._lags.ctypes.data, of._over_distance.ctypes.data
        core.kernels(self._count, self._sites, lags, which, self._times.ctypes.data, out)

    def add_to(self, covariance: FloatArray) -> None:
        """Add the processes' covariance in place, shape (m, m)."""
        work = np.empty((self._sites, self._numbers))
        to = _sized(covariance, (self._numbers, self._numbers))
        self._core.add_covariance(*self._seen(), to, work.ctypes.data)

    def slope_products(self, x: FloatArray) -> FloatArray:
        """Return the products of each derivative with a vector (m,), shape (P, 2, m): by ln time, by ln sigma."""
        x, out, work = np.ascontiguousarray(x, float), np.empty((self._count, 2, self._numbers)), np.empty(self._sites)
        given = _sized(x, (self._numbers,))
        self._core.slope_products(*self._seen(), *self._kernel_slopes(), given, out.ctypes.data, work.ctypes.data)
        return out

    def slope_traces(self, other: FloatArray) -> FloatArray:
        """Return the traces of each derivative's product with a symmetric matrix (m, m), shape (P, 2)."""
        other, out = np.ascontiguousarray(other, float), np.empty((self._count, 2))
        given, work = _sized(other, (self._numbers, self._numbers)), np.empty(self._numbers)
        self._core.slope_traces(*self._seen(), *self._kernel_slopes(), given, out.ctypes.data, work.ctypes.data)
        return out

    def _seen(self) -> tuple[int, ...]:
        of = self._of
        arrays = (of._sizes, of._starts, of._at, of._loads, self._kernels, self._sigmas)
        return tuple(x.ctypes.data for x in arrays)

    def _kernel_slopes(self) -> tuple[int, ...]:
        return tuple(x.ctypes.data for x in (self._of._lags, self._of._over_distance, self._times))


def _columns(entries: Sequence[Any], count: int) -> tuple[list[FloatArray], IndexArray]:
    """Return contiguous numbers of the entries of a patch, and 1 for a column, 0 for a number that serves all."""
    arrays = [np.ascontiguousarray(x, float) for x in entries]
    for array in arrays:
        if array.size != 1 and array.shape != (count, 1):
            raise ValueError(f"expected an entry of shape ({count}, 1), got {array.shape}")
    if len(arrays) != ENTRIES:
        raise ValueError(f"expected {ENTRIES} entries, got {len(arrays)}")
    return arrays, np.array([array.size != 1 for array in arrays], np.int64)


def _pointers(arrays: Sequence[FloatArray]) -> IndexArray:
    return np.array([array.ctypes.data for array in arrays], np.uintp).view(np.intp)


def _nodes(rules: FloatArray) -> int:
    nodes, rest = divmod(rules.size, 27)
    if rest or not nodes or rules.ndim != 1:
        raise ValueError(f"expected rules of 27 numbers a node, got {rules.shape}")
    return nodes


def _sized(array: FloatArray, shape: tuple[int, ...]) -> int:
    """Return the address of an array of this shape."""
    if array.shape != shape or array.dtype != np.float64 or not array.flags.c_contiguous:
        raise ValueError(f"expected float64 of shape {shape}, got {array.dtype} of shape {array.shape}")
    return int(array.ctypes.data)
