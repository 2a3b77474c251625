"""Gain of the extension on held-out runs, and probabilities of causes averaged over resampled runs.

**Gain**, on runs which neither the choice of the causes nor the fit has used.
Every run is held out once. The others choose the causes anew and fit soil and causes; the run is then predicted twice,
by the base model (soil re-calibrated within its prior, no cause) and by the extended one. Its density is exact for the
model linearised at each set's fit. R0, M0 and R2 are of the whole model at what the other runs estimate, at the
measured slip, over the samples at or above the paper's slip threshold: near zero and in braking the measured slip's own
error, times the steep slope there, is several times what any cause does, so that a cause of the braked wheel shows in
the density only. R0 that soil and noise alone would give is of the same samples: by the noise model with the slopes of
the base, and by the soil's uncertainty from the other runs. Noise hyper-parameters and points of linearisation have
seen every run.

**Probabilities**: the mean of posteriors over resampled runs.
A noise model that is a little wrong makes a posterior too sure of one of two confounded causes. Drawing as many runs
with replacement as there are, and averaging the posteriors, makes it as uncertain as another campaign would; this needs
no noise model. It costs no more than weights on the runs' Gram matrices. What is drawn is another campaign of the same
design: runs that measure the same channels in the same direction stand for each other, and one with later passes has
some. Else the only run with a reading of the sinkage, or the way back that shows a slope, would be left out of a third
of them. Whether any cause acts at all is not a choice between confounded causes: there resampled runs, in which chance
counts twice, would raise false alarms, so that the probability of "none" is that of the runs as they are.

Source: Buehlmann (2014), Stat. Sci. 29:91; Huggins & Miller (2023), Bayesian Analysis 18:79 (BayesBag).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from daq import OUTPUTS, FloatArray, IndexArray, Note
from model.cores import in_parallel
from model.diagnosis.core.gain import HeldOutPrediction, gain_of
from model.diagnosis.core.hypotheses import Posterior, probabilities
from model.diagnosis.core.naming import LEAST_NATS, REMAINDER
from model.diagnosis.core.result import Gain
from model.diagnosis.findings.adequacy import excess
from model.diagnosis.findings.set_fit import SetFit, fit_sets
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import (
    BEAM,
    estimate,
    log_likelihood_of_run,
    posterior,
    weighed,
    without_soil,
)
from model.diagnosis.time_series.joining import runs_of
from model.diagnosis.time_series.linearise import Point
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.effects.catalogue import EFFECTS
from model.fit.result import FitOptions
from model.notes import DiagnosisCode, LackCode

REPLICATES = 64
FEWEST_RUNS = 3
"""Runs below which drawing anew says nothing."""


def bagged(
    grams: Grams,
    rng: np.random.Generator,
    excluded: frozenset[str] = frozenset(),
    most: int = 3,
    excess: float = 1.0,
    replicates: int = REPLICATES,
) -> Posterior:
    """Return probabilities of sets of causes, averaged over resampled runs.

    Families or keys that are `excluded` leave no trace; the largest set has `most` causes; `excess` is a factor on the
    noise's variance (`model.diagnosis.findings.adequacy.excess`). The result is not ``calibrated`` where there are too
    few runs: then the noise model is taken at its word.
    """
    grams = replace(grams, matrices=grams.matrices / excess, own=())
    runs = len(grams.run_names)
    if runs < FEWEST_RUNS:
        return posterior(grams, excluded, most)
    weights = np.concatenate([np.ones((1, runs)), drawn_anew(design_of(grams), replicates, rng)])
    totals = np.tensordot(weights, grams.matrices, 1) + grams.static
    listed, found = weighed(grams, without_soil(grams, totals), excluded, most, BEAM)
    each = probabilities(found, listed.log_prior)
    mean = each[1:].mean(axis=0)
    mean[1:] *= (1.0 - each[0, 0]) / max(mean[1:].sum(), 1e-300)
    mean[0] = each[0, 0]
    return Posterior(listed, found[0], mean, calibrated=True)


def design_of(grams: Grams) -> IndexArray:
    """Return what the design of a campaign is of its runs, shape (runs, 3): alike where it is not known."""
    return np.zeros((len(grams.run_names), 3), np.intp) if grams.design is None else grams.design


def kinds_of(design: IndexArray) -> IndexArray:
    """Return which runs stand for each other, shape (runs,): all, where no two are alike."""
    kinds = np.unique(design[:, :2], axis=0, return_inverse=True)[1].ravel()
    return kinds if np.bincount(kinds).max() > 1 else np.zeros_like(kinds)


def drawn_anew(design: IndexArray, replicates: int, rng: np.random.Generator) -> FloatArray:
    """Return how often each run is among those drawn with replacement, shape (replicates, runs).

    By `design`, shape (runs, 3), as `Grams` has it, only runs of one kind stand for each other; where there are later
    passes, some are drawn.
    """
    kinds, passes = kinds_of(design), design[:, 2] == np.unique(design[:, 2])[:, None]
    found = np.zeros((replicates, len(kinds)))
    lacking = np.arange(replicates)
    while lacking.size:
        for kind in np.unique(kinds):
            own = np.flatnonzero(kinds == kind)
            share = np.full(own.size, 1.0 / own.size)
            found[np.ix_(lacking, own)] = rng.multinomial(own.size, share, size=lacking.size)
        lacking = np.flatnonzero((found @ passes.T == 0.0).any(axis=1))
    return found


Keys = tuple[str, ...]


def held_out(
    linearised: LinearisedCampaign,
    fits: Mapping[Keys, SetFit] | None = None,
) -> tuple[Gain | None, tuple[Note, ...]]:
    """Measure the gain of the extension by leaving out one run at a time; None with one run.

    The notes say what few runs do to it; `fits` are sets that are fitted already.
    """
    count = len(linearised.grams.run_names)
    if count < 2:
        return None, (Note(DiagnosisCode.ONE_RUN),)
    known = dict(fits or {})
    chosen = tuple(_chosen(linearised, run) for run in range(count))
    known |= fit_sets(linearised, [keys for keys in dict.fromkeys(((), *chosen)) if keys not in known], starts="one")
    grams = {keys: known[keys].grams() for keys in {(), *chosen}}

    def predicted(run: int) -> tuple[HeldOutPrediction, HeldOutPrediction]:
        keys = chosen[run]
        base = predict_held_out(linearised, known[()], run, grams[()])
        return base, predict_held_out(linearised, known[keys], run, grams[keys]) if keys else base

    base, extended = zip(*in_parallel(predicted, range(count), rows=linearised.rows), strict=True)
    channel = next(c for c in OUTPUTS if any(c in run.measured for run in base))
    return gain_of(base, extended, chosen, channel), (Note(DiagnosisCode.TWO_RUNS),) * (count == 2)


def _chosen(linearised: LinearisedCampaign, run: int) -> Keys:
    """Return the causes that all runs but one ask for."""
    known = linearised.grams.without(run)
    first = posterior(known, linearised.excluded, linearised.most_causes).best()
    wider = known.scaled(1.0 / excess(known, first))
    return posterior(wider, linearised.excluded, linearised.most_causes).best()


def predict_held_out(
    linearised: LinearisedCampaign, fit: SetFit, run: int, grams: Grams | None = None
) -> HeldOutPrediction:
    """Predict a run, of several wheels at each of them, from all others by a set of causes.

    `fit` is that of the set to all runs: where the model is linearised. `run` counts all runs of the Gram matrices;
    `grams` are those of the fit, where they are known already.
    """
    grams = grams or fit.grams()
    members = runs_of([(data.campaign, data.samples) for data in linearised.campaigns])[run]
    found = estimate(grams.without(run), fit.keys)
    points = fit.problem.points(np.r_[found.soil, found.coefficients[list(found.columns)]])
    each = [_predicted(linearised, fit, at, points[at], found.covariance, number) for at, number in members]
    return HeldOutPrediction(
        log_likelihood=log_likelihood_of_run(grams, run, fit.keys),
        numbers=int(grams.samples[run]),
        **(each[0] if len(each) == 1 else _together(each)),
    )


def _predicted(
    linearised: LinearisedCampaign, fit: SetFit, at: int, point: Point, covariance: FloatArray, run: int
) -> dict[str, Any]:
    """Return what is measured and predicted of a run of one campaign, as `HeldOutPrediction` has it."""
    samples, part = linearised.campaigns[at].samples, fit.problem.parts[at]
    own = samples.run == run
    samples = samples[own]
    slip, soil = np.asarray(samples.conditions.slip), part.frozen.soil[:, own]
    of_soil = np.einsum("cni,ij,cnj->cn", soil, covariance[np.ix_(part.soil, part.soil)], soil)
    return {
        "measured": {c: samples.measured[c] for c in part.frozen.channels},
        "predicted": dict(zip(part.frozen.channels, part.at_measured_slip(point, own), strict=True)),
        "judged": slip >= FitOptions().threshold_on(linearised.campaigns[at].campaign.soil),
        "slip": slip,
        "variance": dict(zip(part.frozen.channels, part.noise_variance[:, own] + of_soil, strict=True)),
    }


def _together(wheels: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the samples of several wheels one behind the other; a channel that a wheel lacks is NaN there."""
    channels = dict.fromkeys(c for wheel in wheels for c in wheel["measured"])

    def of_channel(key: str, channel: str) -> FloatArray:
        return np.concatenate([wheel[key].get(channel, np.full(len(wheel["slip"]), np.nan)) for wheel in wheels])

    plain = {key: np.concatenate([wheel[key] for wheel in wheels]) for key in ("judged", "slip")}
    return plain | {key: {c: of_channel(key, c) for c in channels} for key in ("measured", "predicted", "variance")}


def cancelling(linearised: LinearisedCampaign) -> Note | None:
    """Return which two causes of the most probable set cancel each other where one of them less would do as well.

    As well means that held-out runs lose less than `LEAST_NATS` without it.
    """
    grams, keys = linearised.grams, linearised.best.keys
    if len(keys) < 2:
        return None
    found = estimate(grams, keys)
    inner = without_soil(grams, grams.total)[1 : 1 + len(grams.causes), 1 : 1 + len(grams.causes)]
    parts = {key: np.where([c.key == key for c in grams.causes], found.coefficients, 0.0) for key in keys}

    def size(part: FloatArray) -> float:
        return float(np.sqrt(part @ inner @ part))

    for first, second in combinations(keys, 2):
        if size(parts[first] + parts[second]) > REMAINDER * min(size(parts[first]), size(parts[second])):
            continue
        for key in (first, second):
            fewer = tuple(kept for kept in keys if kept != key)
            if _held_out_score(grams, keys) - _held_out_score(grams, fewer) < LEAST_NATS:
                facts = {"families": tuple(EFFECTS[k].name for k in (first, second)), "without": EFFECTS[key].name}
                return Note(LackCode.PARTS_CANCEL, values=facts)
    return None


def _held_out_score(grams: Grams, keys: Keys) -> float:
    return sum(log_likelihood_of_run(grams, run, keys) for run in range(len(grams.run_names)))
