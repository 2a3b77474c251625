r"""The load that is likeliest, given the measured one.

The load is measured, and its noise makes a line of force over load look flatter than it is: flatter about the middle
of the data, so that the zeros of load, torque and drawbar pull seem to be off where the soil cannot take it up
(docs/decisions/torque-zero-bias.md). So every run's load is drawn towards its mean as far as noise and movement say,

.. math:: \hat W = \mathrm{E}[W \mid W_m], \qquad W_m = W + e,

with W and e two first-order Markov processes: e that of the noise model, W what is left of the measured covariance.

Source: regression calibration; Carroll, Ruppert, Stefanski & Crainiceanu (2006), Measurement Error in Nonlinear Models,
ch. 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.kalman import StateSpace, smoothed
from model.diagnosis.places import places_of, steps_of
from model.diagnosis.samples import Samples

FloatArray = NDArray[np.float64]

_LEAST_SHARE = 0.1
"""Of the measured variance, that is taken for movement whatever the noise."""
_LEAST_PAIRS = 10
_STEADY_N = 0.1
"""One-sigma of a load that does not move: nothing to be drawn anywhere."""


def with_likely_load(samples: Samples, values: Mapping[str, float]) -> Samples:
    """Return samples with the load's expectation instead of its measured value.

    Parameters
    ----------
    samples : Samples
        As measured.
    values : mapping
        Hyper-parameters of the noise.
    """
    measured = np.asarray(samples.conditions.vertical_load_n)
    counts = np.bincount(samples.run, minlength=samples.runs)
    means = np.bincount(samples.run, measured, minlength=samples.runs) / np.maximum(counts, 1)
    swing = measured - means[samples.run]
    step_s = steps_of(samples.time_s, samples.run)
    near = np.flatnonzero((step_s > 0) & (step_s < 1.5 * samples.block_s))
    if len(near) < _LEAST_PAIRS:
        return samples
    noise, memory = values["load_noise_n"] ** 2, np.exp(-samples.block_s / values["load_noise_time_s"])
    total = float(np.mean(swing**2))
    if total <= _STEADY_N**2:
        return samples
    moving = max(total - noise, _LEAST_SHARE * total)
    kept = (float(np.mean(swing[near] * swing[near - 1])) - noise * memory) / moving
    kept = float(np.clip(kept, 0.01, 0.99))
    at = places_of(samples)
    decay = np.stack([kept ** (step_s / samples.block_s), memory ** (step_s / samples.block_s)], axis=-1)
    present = at.padded(np.ones((1, len(samples))))
    space = StateSpace(
        loadings=np.repeat(present[..., None], 2, axis=-1),
        decay=at.padded(decay[None])[:, :, 0],
        variance=np.array([moving, noise]),
        white=np.where(present > 0, 1e-4 * noise, 1.0),
    )
    means_of, _ = smoothed(space, at.padded(swing[None]))
    shift = at.flat(means_of[..., 0]) - swing
    return replace(
        samples,
        conditions=replace(samples.conditions, vertical_load_n=measured + shift),
        instants=replace(samples.instants, vertical_load_n=samples.instants.vertical_load_n + shift),
    )
