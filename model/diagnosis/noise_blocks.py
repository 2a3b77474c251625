"""The covariance of the noise of part of a run, and how every hyper-parameter changes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.columns import Columns
from model.diagnosis.linearise import Linear
from model.diagnosis.noise import (
    Process,
    constants,
    loading,
    named,
    processes,
    rest_variance,
    second_order_variance,
)
from model.diagnosis.rests import AT_REST
from model.diagnosis.samples import Samples

FloatArray = NDArray[np.float64]

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
    columns : array, shape (m, 1 + q + k + b)
        Residual first.
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

    columns: FloatArray
    seconds: FloatArray
    metres: FloatArray
    sample: NDArray[np.intp]
    processes: tuple[tuple[Process, FloatArray], ...]
    constants: tuple[tuple[str, FloatArray], ...]
    white: tuple[tuple[str, NDArray[np.bool_]], ...]
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
                found.append(_block(samples, linear, columns, second, resting, piece, here))
    return found


def _pieces(own: NDArray[np.intp], most: int, first: int) -> list[NDArray[np.intp]]:
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
    piece: NDArray[np.intp],
    rest: NDArray[np.intp],
) -> Block:
    channels = linear.channels
    sample, channel = np.nonzero(columns.present[:, piece].T)
    at = piece[sample]
    row, standing = np.nonzero(columns.rests_present[:, rest])
    standing = rest[standing]
    drives, keep = len(at), columns.shared

    def of_drive(x: FloatArray) -> FloatArray:
        return np.asarray(x[channel, at])

    turning = np.concatenate([columns.rows[channel, at, keep:], columns.rests[row, standing, keep:]])
    white = []
    for i, c in enumerate(channels):
        white.append((named(c, "white"), np.concatenate([channel == i, np.zeros(len(row), bool)])))
        if c != "z":
            mine = row == AT_REST.index(c)
            white.append((named(c, "at_rest"), np.concatenate([np.zeros(drives, bool), mine])))
    return Block(
        columns=np.concatenate([columns.rows[channel, at, :keep], columns.rests[row, standing, :keep]]),
        seconds=np.abs(samples.time_s[piece, None] - samples.time_s[piece]),
        metres=np.abs(samples.distance_m[piece, None] - samples.distance_m[piece]),
        sample=sample,
        processes=tuple((p, of_drive(loading(linear, samples, p.loading))) for p in processes(channels)),
        constants=tuple((name, turning[:, i]) for i, (name, _) in enumerate(constants(channels))),
        white=tuple(white),
        fixed=np.concatenate([of_drive(second), resting[row, standing]]),
    )


@dataclass(frozen=True)
class Slope:
    """Derivative of a covariance by the logarithm of a hyper-parameter.

    Attributes
    ----------
    name : str
    rows : int array
        To which it is confined.
    part : array
        Of shape (rows, rows); or of shape (rows,): its diagonal, or where `outer` what it is the outer product of.
    outer : bool
    """

    name: str
    rows: NDArray[np.intp]
    part: FloatArray
    outer: bool = False

    def trace_with(self, other: FloatArray) -> float:
        """Return the trace of its product with a symmetric matrix."""
        if self.part.ndim == 1 and not self.outer:
            return float(other[self.rows, self.rows] @ self.part)
        own = other if len(self.rows) == len(other) else other[np.ix_(self.rows, self.rows)]
        if self.outer:
            return float(self.part @ own @ self.part)
        return float(own.ravel() @ self.part.ravel())

    def times(self, x: FloatArray) -> FloatArray:
        """Return its product with a vector."""
        own = x[self.rows]
        out = np.zeros(len(x))
        if self.outer:
            out[self.rows] = self.part * float(self.part @ own)
        else:
            out[self.rows] = self.part * own if self.part.ndim == 1 else self.part @ own
        return out


def derivatives(block: Block, values: Mapping[str, float]) -> tuple[FloatArray, list[Slope]]:
    """Return the covariance, shape (m, m), and its derivatives."""
    covariance = np.diag(block.fixed)
    slopes: list[Slope] = []
    for process, seen in block.processes:
        rows = np.flatnonzero(seen)
        at = block.sample[rows]
        lag: FloatArray | None = None
        if process.time is None:
            part = (at[:, None] == at).astype(float)
        else:
            lag = (block.metres if process.over_distance else block.seconds).take(at, 0).take(at, 1)
            lag /= values[process.time]
            part = np.exp(-lag)
        scaled = values[process.deviation] * seen[rows]
        part *= scaled
        part *= scaled[:, None]
        covariance[np.ix_(rows, rows)] += part
        if lag is not None and process.time is not None:
            lag *= part
            slopes.append(Slope(process.time, rows, lag))
        part *= 2.0
        slopes.append(Slope(process.deviation, rows, part))
    for name, seen in block.constants:
        rows = np.flatnonzero(seen)
        scaled = values[name] * seen[rows]
        covariance[np.ix_(rows, rows)] += np.outer(scaled, scaled)
        slopes.append(Slope(name, rows, np.sqrt(2.0) * scaled, outer=True))
    for name, chosen in block.white:
        rows = np.flatnonzero(chosen)
        covariance[rows, rows] += values[name] ** 2
        slopes.append(Slope(name, rows, np.full(len(rows), 2.0 * values[name] ** 2)))
    return covariance, slopes
