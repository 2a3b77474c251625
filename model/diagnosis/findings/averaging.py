r"""The average of the sets of causes that remain possible: their fits, and its gain on held-out runs.

Each set is fitted with the whole model to everything. A held-out run is predicted by every set from the others, and the
predictions are averaged by the probabilities that the others give; its density is
:math:`\sum_k p_k\, p(y \mid k)`. Which sets are listed has seen every run, as have the noise model's hyper-parameters.

The covariance of a set is that of its parameters within it: the noise model's, widened by the scatter from run to run
(`model.diagnosis.findings.set_fit`), and by the error of form. What the choice of the set moves is left to the average.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from daq import OUTPUTS, FloatArray
from model.cores import in_parallel
from model.diagnosis.core.average import Average, FittedSet
from model.diagnosis.core.gain import HeldOutPrediction, gain_of
from model.diagnosis.core.hypotheses import Posterior, cause_of, probable_sets
from model.diagnosis.core.result import Gain
from model.diagnosis.findings.adequacy import excess
from model.diagnosis.findings.explained import Fits, Keys
from model.diagnosis.findings.held_out import bagged, predict_held_out
from model.diagnosis.findings.set_fit import SetFit, of_soils, parameters_within, soils_with, spread_within
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.effects.catalogue import EFFECTS
from model.wheel_soil.soils import SOIL_PARAMETERS

MOST_SETS = 12
"""Sets that are kept, at most; "none" is one of them."""
_REPLICATES = 16
"""Resampled runs of each fold."""


def average_of(fits: Fits, found: Posterior, seed: int, named: Sequence[str] = ()) -> Average | None:
    """Fit the most probable sets, and measure what their average is worth; None where there is none.

    A set whose spread the data leave undetermined is left to the rest. `found` is averaged over resampled runs; the
    seed is that of the resampling in each fold. Every set holds the families of `named`; the others are left to the
    rest, too.
    """
    linearised, kept = fits.linearised, probable_sets(found, MOST_SETS, tuple(named))
    fits.fit((), *kept)
    own = {keys: fits[keys] for keys in kept}
    sets = list(in_parallel(lambda keys: _fitted(linearised, own[keys], found, kept[keys]), kept))
    known = [all(np.isfinite(matrix).all() for matrix in fitted.covariances) for fitted in sets]
    own = {keys: own[keys] for keys, fine in zip(kept, known, strict=True) if fine or not keys}
    sets = [fitted for fitted, fine in zip(sets, known, strict=True) if fine or not fitted.causes]
    rest = max(1.0 - sum(fitted.probability for fitted in sets), 0.0)
    return Average(tuple(sets), rest, _gain(linearised, fits[()], own, found, seed)) if sets else None


def _fitted(linearised: LinearisedCampaign, fit: SetFit, found: Posterior, probability: float) -> FittedSet:
    spread = spread_within(fit.problem, fit.estimate, linearised, fit.keys)
    parameters = parameters_within(fit, spread)
    causes = tuple(cause_of(found, EFFECTS[key].name, key, parameters[key]) for key in fit.keys)
    of_causes = [EFFECTS[c.key].parameter_keys()[c.parameter] for c in fit.problem.causes]
    return FittedSet(
        probability=probability,
        causes=causes,
        soils=soils_with(fit, linearised, spread),
        names=(*SOIL_PARAMETERS, *of_causes),
        covariances=tuple(_covariance(fit, spread, index) for index in of_soils(linearised)),
    )


def _covariance(fit: SetFit, covariance: FloatArray, index: int) -> FloatArray:
    """Return the covariance of one campaign's soil and of the causes, SI units, shape (6 + c, 6 + c)."""
    part, causes = fit.problem.parts[index], fit.problem.causes
    first = len(fit.problem.soil)
    to_si = np.zeros((len(SOIL_PARAMETERS) + len(causes), len(fit.estimate)))
    to_si[: len(SOIL_PARAMETERS), part.soil] = part.simulation.space.jacobian(fit.estimate[part.soil])
    for i, cause in enumerate(causes):
        to_si[len(SOIL_PARAMETERS) + i, first + i] = cause.scale
    return np.asarray(to_si @ covariance @ to_si.T)


def _gain(
    linearised: LinearisedCampaign, no_cause: SetFit, fits: Mapping[Keys, SetFit], found: Posterior, seed: int
) -> Gain | None:
    """Return the gain of the average on held-out runs over that without a cause; None with one run."""
    count = len(linearised.grams.run_names)
    if count < 2:
        return None
    every: dict[Keys, SetFit] = {(): no_cause, **fits}
    grams = {keys: fit.grams() for keys, fit in every.items()}

    def predicted(run: int) -> tuple[HeldOutPrediction, HeldOutPrediction]:
        each = {keys: predict_held_out(linearised, fit, run, grams[keys]) for keys, fit in every.items()}
        weights = _weights(linearised, run, tuple(fits), found, seed)
        return each[()], averaged([each[keys] for keys in fits], weights)

    base, average = zip(*in_parallel(predicted, range(count), rows=linearised.rows), strict=True)
    channel = next(c for c in OUTPUTS if any(c in run.measured for run in base))
    return gain_of(base, average, (found.best(),) * count, channel)


def _weights(linearised: LinearisedCampaign, run: int, sets: Sequence[Keys], found: Posterior, seed: int) -> FloatArray:
    """Return the sets' probabilities by all runs but one; sum 1."""
    known = linearised.grams.without(run)
    rng = np.random.default_rng([seed, run])
    factor = excess(known, linearised.best.keys)
    others = bagged(known, rng, linearised.excluded, linearised.most_causes, factor, _REPLICATES)
    listed = others.hypotheses.position
    weights = np.array([others.probability[at] if (at := listed(keys)) is not None else 0.0 for keys in sets])
    if not weights.sum() > 0:
        weights = np.array([found.probability[found.hypotheses.index_of(keys)] for keys in sets])
    return np.asarray(weights / weights.sum())


def averaged(each: Sequence[HeldOutPrediction], weights: FloatArray) -> HeldOutPrediction:
    """Return the average of predictions of one run by weights whose sum is 1.

    A sample without an answer of a set is averaged over the others.
    """
    first = each[0]
    alike = [prediction.numbers == first.numbers for prediction in each]
    likelihood = scipy.special.logsumexp(
        [prediction.log_likelihood for prediction in each], b=np.where(alike, weights, 0.0)
    )
    predicted = {}
    for channel in first.predicted:
        values = np.stack([prediction.predicted[channel] for prediction in each])
        known = np.isfinite(values)
        share = weights @ known
        mean = weights @ np.where(known, values, 0.0) / np.where(share > 0, share, np.nan)
        predicted[channel] = np.asarray(mean)
    return replace(first, log_likelihood=float(likelihood), predicted=predicted)
