"""Probabilities that runs drawn anew would repeat: the mean of posteriors over resampled runs.

A noise model that is a little wrong makes a posterior too sure of one of two look-alikes. Drawing as many runs with
replacement as there are, and averaging the posteriors, makes it as unsure as another campaign would: no noise model
stands behind the drawing. It costs no more than weights on the runs' Gram matrices. Whether anything is at work at all
is not a choice between look-alikes: there resampled runs, in which chance counts twice, would cry wolf, and the
probability of "none" is that of the runs as they are.

Source: Buehlmann (2014), Stat. Sci. 29:91; Huggins & Miller (2023), Bayesian Analysis 18:79 (BayesBag).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.diagnosis.evidence import Posterior, posterior, probabilities, weighed, without_soil
from model.diagnosis.grams import Grams

REPLICATES = 64
FEWEST_RUNS = 3
"""Runs below which drawing anew says nothing."""
BEAM = 40
"""Pairs whose sets of three are weighed; sets of three of which no pair is among them are taken as nothing."""


def bagged(
    grams: Grams,
    rng: np.random.Generator,
    excluded: frozenset[str] = frozenset(),
    most: int = 3,
    excess: float = 1.0,
    replicates: int = REPLICATES,
) -> Posterior:
    """Return probabilities of sets of causes, averaged over resampled runs.

    Parameters
    ----------
    grams : Grams
    rng : Generator
    excluded : set of str
        Families or keys that leave no trace.
    most : int
        Causes in the largest set.
    excess : float
        Factor on the noise's variance (`model.diagnosis.adequacy.excess`).
    replicates : int

    Returns
    -------
    Posterior
        With ``resampled`` 0 where there are too few runs: then the noise model is taken at its word.
    """
    grams = replace(grams, matrices=grams.matrices / excess)
    runs = len(grams.run_names)
    if runs < FEWEST_RUNS:
        return posterior(grams, excluded, most)
    weights = rng.multinomial(runs, np.full(runs, 1.0 / runs), size=replicates).astype(float)
    weights = np.concatenate([np.ones((1, runs)), weights])
    width = grams.cause_columns.stop
    totals = np.tensordot(weights, grams.matrices[:, :width, :width], 1)
    listed, found = weighed(grams, without_soil(grams, totals), excluded, most, BEAM)
    each = probabilities(found, listed.log_prior)
    mean = each[1:].mean(axis=0)
    mean[1:] *= (1.0 - each[0, 0]) / max(mean[1:].sum(), 1e-300)
    mean[0] = each[0, 0]
    return Posterior(listed, found[0], mean, replicates)
