r"""How likely a run is, given other runs: exact for the linear model of `model.diagnosis.grams`.

The evidence of a set M of causes in runs A is the probability density of their data with soil and sizes integrated
out. What the runs A foretell of another run b is therefore a difference,

.. math:: \ln p(r_b \mid r_A, M) = \ln p(r_{A \cup b} \mid M) - \ln p(r_A \mid M),

in which the uncertainty of everything that A has not settled is counted, bounds and one-sided priors included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import box, log_evidences, without_soil
from model.diagnosis.grams import Grams
from model.diagnosis.prior import hypotheses

FloatArray = NDArray[np.float64]


def log_evidence(grams: Grams, keys: tuple[str, ...] = ()) -> float:
    """Return the log density of all whitened data under a set of causes, constants included; nats."""
    total = grams.total()
    soil = grams.soil_columns
    inner = total[soil, soil] + np.eye(len(grams.soil))
    reduced = without_soil(grams, total)
    constant = float(grams.samples.sum()) * np.log(2 * np.pi) + float(grams.log_determinants.sum())
    base = float(-0.5 * (reduced[0, 0] + np.linalg.slogdet(inner)[1] + constant))
    if not keys:
        return base
    listed = hypotheses(grams, frozenset(c.key for c in grams.causes if c.key not in keys), len(keys))
    lower, upper = box(grams.causes)
    return base + float(log_evidences(reduced, listed, lower, upper)[listed.index_of(keys)])


def log_likelihood_of_run(grams: Grams, run: int, keys: tuple[str, ...] = ()) -> float:
    """Return the log density of one run, given all the others and a set of causes; nats."""
    return log_evidence(grams, keys) - log_evidence(others(grams, run), keys)


def others(grams: Grams, run: int) -> Grams:
    """Return the Grams without one run."""
    return grams.chosen(np.arange(len(grams.run_names)) != run)
