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
from model.diagnosis.samples import Samples

FloatArray = NDArray[np.float64]

LONGEST = 200
"""Samples whose covariance is formed at once."""


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
    resting = rest_variance(linear, samples, {**values, **{named(c, "at_rest"): 0.0 for c in ("dp", "t")}})
    second = second_order_variance(linear, speed_variance)
    for run in range(samples.runs):
        own = np.flatnonzero((samples.run == run) & columns.present.any(axis=0))
        rest = np.flatnonzero(samples.rests.run == run)
        pieces = np.array_split(own, max(1, -(-len(own) // LONGEST)))
        for i, piece in enumerate(pieces):
            here = rest if i == 0 else rest[:0]
            if len(piece) or len(here):
                found.append(_block(samples, linear, columns, second, resting, piece, here))
    return found


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
            mine = row == ("dp", "t").index(c)
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


def derivatives(
    block: Block, values: Mapping[str, float], names: list[str]
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """Return the covariance, shape (m, m), and its derivative by the logarithm of each hyper-parameter."""
    place = {name: i for i, name in enumerate(names)}
    count, drives = len(block.fixed), len(block.sample)
    covariance = np.diag(block.fixed)
    slopes: dict[int, FloatArray] = {}

    def add(name: str, part: FloatArray, rows: int) -> None:
        slope = slopes.setdefault(place[name], np.zeros((count, count)))
        slope[:rows, :rows] += part

    pick = np.ix_(block.sample, block.sample)
    for process, seen in block.processes:
        if process.time is None:
            lag, of_lag = None, np.eye(len(block.seconds))
        else:
            lag = (block.metres if process.over_distance else block.seconds) / values[process.time]
            of_lag = np.exp(-lag)
        part = of_lag[pick] * (values[process.deviation] * seen)
        part *= (values[process.deviation] * seen)[:, None]
        covariance[:drives, :drives] += part
        add(process.deviation, 2.0 * part, drives)
        if lag is not None and process.time is not None:
            add(process.time, part * lag[pick], drives)
    for name, seen in block.constants:
        part = np.outer(values[name] * seen, values[name] * seen)
        covariance += part
        add(name, 2.0 * part, count)
    for name, rows in block.white:
        part = np.diag(values[name] ** 2 * rows)
        covariance += part
        add(name, 2.0 * part, count)
    return covariance, slopes
