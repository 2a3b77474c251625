"""Columns of a campaign to whitened Gram matrices, run by run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.columns import Columns
from model.diagnosis.kalman import StateSpace, smoothed, whiten
from model.diagnosis.linearise import Linear
from model.diagnosis.noise import loading, processes, rest_variance, white_variance
from model.diagnosis.places import Places, places_of, steps_of
from model.diagnosis.samples import Samples

FloatArray = NDArray[np.float64]


def state_space(
    samples: Samples,
    linear: Linear,
    present: NDArray[np.bool_],
    values: Mapping[str, float],
    speed_variance: FloatArray,
) -> StateSpace:
    """Return the noise of a campaign's runs.

    Parameters
    ----------
    samples : Samples
    linear : Linear
    present : bool array, shape (c, n)
    values : mapping
        Hyper-parameters.
    speed_variance : array, shape (n,)
        Variance of the ground speed's error about the point.
    """
    at = places_of(samples)
    listed = processes(linear.channels)
    loadings = np.stack([loading(linear, samples, p.loading) for p in listed], axis=-1)
    loadings = np.where(present[..., None], loadings, 0.0)
    step_s, step_m = (steps_of(x, samples.run) for x in (samples.time_s, samples.distance_m))
    decay = np.zeros((len(samples), len(listed)))
    for i, p in enumerate(listed):
        if p.time is not None:
            decay[:, i] = np.exp(-(step_m if p.over_distance else step_s) / values[p.time])
    white = np.where(present, white_variance(linear, values, speed_variance), 1.0)
    return StateSpace(
        loadings=at.padded(loadings),
        decay=at.padded(decay[None])[:, :, 0],
        variance=np.array([values[p.deviation] ** 2 for p in listed]),
        white=at.padded(white, fill=1.0),
    )


@dataclass(frozen=True)
class RunGrams:
    """Runs of one campaign with their constants integrated out.

    Attributes
    ----------
    matrices : array, shape (runs, m, m)
    log_determinants : array, shape (runs,)
    samples : int array, shape (runs,)
        Whitened numbers.
    constants : array, shape (runs, l, m)
        Means of the constants, in units of their deviations, by each column.
    """

    matrices: FloatArray
    log_determinants: FloatArray
    samples: NDArray[np.intp]
    constants: FloatArray


def whitened_rows(
    samples: Samples, linear: Linear, columns: Columns, values: Mapping[str, float], speed_variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return whitened rows of every run, shape (runs, rows, columns), padded with zeros, and ln det, shape (runs,).

    Standstills come last. Constants of a run are columns still, scaled to one-sigma 1.
    """
    at = places_of(samples)
    space = state_space(samples, linear, columns.present, values, speed_variance)
    found = whiten(space, at.padded(columns.rows))
    rests, log_determinants = _rests(samples, linear, columns, values)
    rows = np.concatenate([found.columns, rests], axis=1)
    rows[..., columns.shared :] *= np.array([values[name] for name in columns.constants])
    return rows, found.log_determinants + log_determinants


def _rests(
    samples: Samples, linear: Linear, columns: Columns, values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the standstills' whitened rows, shape (runs, rows, columns), and their ln det."""
    variance = rest_variance(linear, samples, values)
    variance = np.where(columns.rests_present, variance, 1.0)
    run = samples.rests.run
    counts = np.bincount(run, minlength=samples.runs)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    at = Places(run, np.arange(len(run)) - first[run], samples.runs, int(counts.max(initial=0)))
    rows = at.padded(columns.rests / np.sqrt(variance)[..., None])
    log_determinants = np.zeros(samples.runs)
    np.add.at(log_determinants, run, np.log(variance).sum(axis=0))
    return rows.reshape(samples.runs, -1, rows.shape[-1]), log_determinants


def run_grams(
    samples: Samples, linear: Linear, columns: Columns, values: Mapping[str, float], speed_variance: FloatArray
) -> RunGrams:
    """Return each run's Gram matrix with what is one value a run integrated out."""
    rows, log_determinants = whitened_rows(samples, linear, columns, values, speed_variance)
    full = rows.swapaxes(1, 2) @ rows
    keep = columns.shared
    inner = np.eye(full.shape[-1] - keep) + full[:, keep:, keep:]
    across = full[:, keep:, :keep]
    means = np.asarray(np.linalg.solve(inner, across))
    matrices = full[:, :keep, :keep] - across.swapaxes(1, 2) @ means
    counts = np.bincount(samples.run, columns.present.sum(axis=0), minlength=samples.runs)
    counts += np.bincount(samples.rests.run, columns.rests_present.sum(axis=0), minlength=samples.runs)
    return RunGrams(matrices, log_determinants + np.linalg.slogdet(inner)[1], counts.astype(np.intp), means)


def smoothed_speed(
    samples: Samples,
    linear: Linear,
    columns: Columns,
    values: Mapping[str, float],
    speed_variance: FloatArray,
    coefficients: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the error of the measured ground speed that the data ask for, and its variance; shape (n,) each.

    Parameters
    ----------
    coefficients : array, shape (runs, 1 + q + k + b + l)
        Of the columns: 1 for the residual, minus the estimate for the others.
    """
    at = places_of(samples)
    space = state_space(samples, linear, columns.present, values, speed_variance)
    left = np.einsum("cnm,nm->cn", columns.rows, coefficients[samples.run])
    means, covariances = smoothed(space, at.padded(left))
    own = np.array([float(p.loading == "speed") for p in processes(linear.channels)])
    return at.flat(means @ own), at.flat(covariances @ own @ own)
