r"""Exact evidence of every set of causes from whitened cross products, and of a run given other runs.

With :math:`r = S\beta + X_M\gamma + \epsilon`, :math:`\beta \sim N(0, I)` and :math:`\gamma \sim N(0, w^2 I)`, the
soil is integrated out by

.. math:: \tilde G = G - G_{\cdot S} (I + G_{SS})^{-1} G_{S\cdot}

and the log evidence of a set M, less that of the empty set, is

.. math:: \tfrac12 b'A^{-1}b - \tfrac12 \ln\det w^2 A + \ln\frac{P(\gamma \in B \mid r)}{P(\gamma \in B)}, \quad
    A = w^{-2} I + \tilde G_{MM},\; b = \tilde G_{Mr},

averaged over w = 1 and, of a cause alone, `LARGE`, with B the box of bounds and one-sided priors. The probability of a
box is taken one coordinate after the other: each is cut to its interval, and the others are taken as normal again, with
the mean and covariance that the cut leaves them. That is exact for one coordinate; for several the error of the
logarithm is a few hundredths where the box holds much of the mass, and some tenths far out
(`tests/model/test_evidence_box.py` compares it with sampling).

The prediction of a run b from runs A is a difference of evidences, in which the uncertainty of everything that A does
not determine is counted:

.. math:: \ln p(r_b \mid r_A, M) = \ln p(r_{A \cup b} \mid M) - \ln p(r_A \mid M).

Source: MacKay (1992), Neural Computation 4:415; Kass & Raftery (1995), J. Am. Stat. Assoc. 90:773; of the box Mendell &
Elston (1974), Biometrics 30:41, and Joe (1995), J. Am. Stat. Assoc. 90:957.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from daq import FloatArray, IntArray
from model import compiled
from model.core_library import library
from model.diagnosis.core.hypotheses import Hypotheses, Posterior, listed_sets, probabilities, with_triples
from model.diagnosis.time_series.columns import CauseColumn, Grams
from model.fit.linear_step import bounded_least_squares

_LOG_SQRT_2PI = 0.5 * float(np.log(2.0 * np.pi))
_FAR = 30.0


def log_box_probability(mean: FloatArray, covariance: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the log probability of a box; its bounds, shape (m, ...), are infinite where there is none.

    The mean has that shape, too, and the covariance (m, m, ...).
    """
    mean, covariance = mean.copy(), covariance.copy()
    total = np.zeros(mean.shape[1:])
    for i in range(len(mean)):
        sigma = np.sqrt(covariance[i, i])
        a, b = (lower[i] - mean[i]) / sigma, (upper[i] - mean[i]) / sigma
        log_p, shift, variance = _interval(a, b)
        total += log_p
        gain = covariance[i, i + 1 :] / sigma
        mean[i + 1 :] += gain * shift
        covariance[i + 1 :, i + 1 :] -= gain[:, None] * gain[None, :] * (1.0 - variance)
    return total


def log_interval_probability(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the log probability that a standard normal number lies between two bounds."""
    return _interval(np.asarray(lower, float), np.asarray(upper, float))[0]


def _interval(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the log probability of [a, b] under a standard normal, and mean and variance within."""
    flip = a > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    a, b = np.maximum(a, -_FAR * 100), np.minimum(b, _FAR)
    high, low = scipy.special.log_ndtr(b), scipy.special.log_ndtr(a)
    log_p = high + np.log1p(-np.exp(np.minimum(low - high, -1e-12)))
    at_a, at_b = (np.exp(-0.5 * x * x - _LOG_SQRT_2PI - log_p) for x in (a, b))
    mean = at_a - at_b
    variance = np.clip(1.0 + a * at_a - b * at_b - mean * mean, 1e-6, 1.0)
    return log_p, np.where(flip, -mean, mean), variance


LARGE, LARGE_SHARE = 4.0, 0.1
"""How much wider the prior of sizes is for some causes that act alone, and for what share of them.

Sizes of real faults have tails: a tyre was exchanged, a unit mistaken. A normal prior alone calls 15 % of a wheel's
radius impossible where 2 % is usual, and gives its name to two causes of usual sizes that fit far worse. Several causes
keep the normal prior: together, far larger than usual, they would imitate nearly anything.
"""
MANY = 40
"""Effects above which not every set of three is weighed, but those that hold one of the best pairs (several wheels)."""
BEAM_OF_MANY = 200
"""How many pairs that are."""
BEAM = 40
"""Pairs whose sets of three are weighed where sets of three of which no pair is among them are taken as nothing."""
KEEP = 3.0
"""Odds below which a set stays where it is, see `best_set`."""


@dataclass(frozen=True)
class SetEstimate:
    """The most probable values under one set of causes, within bounds.

    Attributes
    ----------
    columns : tuple of int
        Positions of the set's parameters among the causes' columns.
    coefficients : array, shape (k,)
        Of all causes' columns; 0 for those outside the set.
    soil : array, shape (q,)
    covariance : array, shape (q + c, q + c)
        Of the soil and the set's c parameters, bounds left aside.
    """

    keys: tuple[str, ...]
    columns: tuple[int, ...]
    coefficients: FloatArray
    soil: FloatArray
    covariance: FloatArray

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma of the set's coefficients, shape (c,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[len(self.soil) :]))


def box(causes: tuple[CauseColumn, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the least and largest coefficient of every cause's column, shape (k,) each."""
    scale = np.array([c.scale for c in causes])
    neutral = np.array([c.neutral for c in causes])
    bounds = np.array([[c.lower for c in causes], [c.upper for c in causes]])
    lower, upper = np.sort((bounds - neutral) / scale, axis=0)
    one_sided = np.array([c.one_sided for c in causes], bool)
    return np.where(one_sided, np.maximum(lower, 0.0), lower), upper


def without_soil(grams: Grams, total: FloatArray) -> FloatArray:
    """Return cross products of residual and causes with soil and error of form integrated out.

    `total`, shape (..., m, m), has sums over runs; the result has the shape (..., 1 + k, 1 + k).
    """
    total = grams.net if total is grams.total else grams.without_form(total)
    soil = grams.soil_columns
    others = np.r_[0, soil.stop : total.shape[-1]]
    inner = total[..., soil, soil] + np.eye(len(grams.soil))
    across = total[..., soil, :][..., others]
    kept = total[..., others[:, None], others]
    return np.asarray(kept - np.swapaxes(across, -1, -2) @ np.linalg.solve(inner, across))


def hypotheses(grams: Grams, excluded: frozenset[str] = frozenset(), most: int = 3, triples: bool = True) -> Hypotheses:
    """List the sets of up to `most` causes of the columns; see `model.diagnosis.core.hypotheses.listed_sets`.

    Families or keys that are `excluded` are those that the data do not allow to tell.
    """
    kept = {c.key: c.family for c in grams.causes if c.family not in excluded and c.key not in excluded}
    return listed_sets(kept, most, triples)


def set_columns(grams: Grams, listed: Hypotheses) -> IntArray:
    """Return the positions of each set's columns among the causes' columns, shape (n, widest), -1 behind the last."""
    own = [[i for i, c in enumerate(grams.causes) if c.key == key] for key in listed.effects]
    widest = max(map(len, own), default=1)
    table = np.array([*(columns + [-1] * (widest - len(columns)) for columns in own), [-1] * widest], np.intp)
    return np.asarray(np.sort(table[listed.members].reshape(len(listed), -1), axis=1)[:, ::-1])


def log_evidences(grams: Grams, reduced: FloatArray, listed: Hypotheses) -> FloatArray:
    """Return the log evidence of every set, less that of the empty set, shape (..., n).

    `grams` says what the columns are; `reduced`, shape (..., 1 + k, same), is that of `without_soil`.
    """
    products = np.moveaxis(reduced.reshape(-1, *reduced.shape[-2:]), 0, -1)
    columns = set_columns(grams, listed)
    lower, upper = box(grams.causes)
    mass = _prior_masses(lower, upper)
    sizes = (columns >= 0).sum(axis=1)
    found = np.zeros((products.shape[-1], len(listed)))
    for size in range(1, columns.shape[1] + 1):
        of_size = np.flatnonzero(sizes == size)
        if of_size.size:
            found[:, of_size] = _of_one_size(products, columns[of_size, :size].T, lower, upper, 1.0, mass[1.0])
            alone = of_size[(listed.members[of_size] >= 0).sum(axis=1) == 1]
            if alone.size:
                large = _of_one_size(products, columns[alone, :size].T, lower, upper, LARGE, mass[LARGE])
                found[:, alone] = np.logaddexp(found[:, alone] + np.log1p(-LARGE_SHARE), large + np.log(LARGE_SHARE))
    return found.reshape(*reduced.shape[:-2], len(listed))


def _prior_masses(lower: FloatArray, upper: FloatArray) -> dict[float, FloatArray]:
    """Return, for each width of the prior, the logarithm of its share within the bounds of each column, shape (k,)."""
    return {width: log_interval_probability(lower / width, upper / width) for width in (1.0, LARGE)}


def _of_one_size(
    products: FloatArray, columns: IntArray, lower: FloatArray, upper: FloatArray, width: float, mass: FloatArray
) -> FloatArray:
    """Return evidence and box probability of sets with equally many columns, shape (replicates, sets).

    `width` is the one-sigma of the coefficients' prior; `mass`, shape (k,), is that of `_prior_masses`.
    """
    at = columns + 1
    matrix = products[at[:, None], at[None, :]].swapaxes(-1, -2).copy()
    for i in range(len(at)):
        matrix[i, i] += width**-2.0
    side = products[0][at].swapaxes(-1, -2)
    if core := library():
        log_det, fall, inside = compiled.weigh(core, matrix, side, lower[columns], upper[columns])
    else:
        log_det = _invert(matrix)
        mean = np.einsum("ij...,j...->i...", matrix, side)
        fall = np.einsum("i...,i...->...", side, mean)
        inside = log_box_probability(mean, matrix, lower[columns][:, None, :], upper[columns][:, None, :])
    fit = 0.5 * fall - 0.5 * log_det - len(at) * np.log(width)
    prior_mass = mass[columns].sum(axis=0)
    return np.asarray(fit + inside - prior_mass)


def _invert(matrix: FloatArray) -> FloatArray:
    """Invert many small positive definite matrices in place, shape (m, m, ...); return their log determinants."""
    log_det = np.zeros(matrix.shape[2:])
    for k in range(len(matrix)):
        pivot = matrix[k, k].copy()
        log_det += np.log(pivot)
        matrix[k, k] = 1.0
        matrix[k] /= pivot
        for i in range(len(matrix)):
            if i != k:
                factor = matrix[i, k].copy()
                matrix[i, k] = 0.0
                matrix[i] -= factor * matrix[k]
    return log_det


def weighed(
    grams: Grams,
    reduced: FloatArray,
    excluded: frozenset[str] = frozenset(),
    most: int = 3,
    beam: int | None = None,
) -> tuple[Hypotheses, FloatArray]:
    """List the sets (see `hypotheses`) and weigh them: log evidences of shape (..., n).

    `grams` says what the columns are. `reduced`, shape (..., 1 + k, same), is that of `without_soil`; with leading axes
    the beam keeps the pairs that are best in any of them. It is how many pairs have their sets of three weighed; None:
    every set of three is.
    """
    if beam is None and len({c.key for c in grams.causes}) > MANY:
        beam = BEAM_OF_MANY
    listed = hypotheses(grams, excluded, most, triples=beam is None)
    found = log_evidences(grams, reduced, listed)
    if beam is None or most < 3:
        return listed, found
    two = np.flatnonzero((listed.members >= 0).sum(axis=1) == 2)
    if not two.size:
        return listed, found
    joint = (found + listed.log_prior)[..., two].reshape(-1, two.size).max(axis=0)
    wider = with_triples(listed, two[np.argsort(-joint, kind="stable")[:beam]])
    if len(wider) == len(listed):
        return listed, found
    triples = replace(wider, members=wider.members[len(listed) :], log_prior=wider.log_prior[len(listed) :])
    return wider, np.concatenate([found, log_evidences(grams, reduced, triples)], axis=-1)


def posterior(
    grams: Grams,
    excluded: frozenset[str] = frozenset(),
    most: int = 3,
    beam: int | None = None,
) -> Posterior:
    """Return the probabilities of all sets of causes, the noise model taken at its word.

    See `hypotheses` and `weighed`.
    """
    listed, found = weighed(grams, without_soil(grams, grams.total), excluded, most, beam)
    return Posterior(listed, found, probabilities(found, listed.log_prior))


def _size_precision(grams: Grams, keys: tuple[str, ...]) -> float:
    """Return the expected precision of the sizes' prior given the data: 1, of a cause alone down to that of `LARGE`."""
    if len(keys) != 1:
        return 1.0
    own = np.array([at - grams.cause_columns.start for at in grams.columns_of(keys[0])], np.intp)
    products, (lower, upper) = without_soil(grams, grams.total)[..., None], box(grams.causes)
    masses = _prior_masses(lower, upper).items()
    usual, large = (_of_one_size(products, own[:, None], lower, upper, *each).item() for each in masses)
    share = scipy.special.expit(large - usual + scipy.special.logit(LARGE_SHARE))
    return float(1.0 - share * (1.0 - LARGE**-2.0))


def prior_information(grams: Grams, keys: tuple[str, ...]) -> FloatArray:
    """Return the prior's information on soil and sizes of a set, shape (q + c,)."""
    count = sum(len(grams.columns_of(key)) for key in keys)
    return np.repeat([1.0, _size_precision(grams, keys)], [len(grams.soil), count])


def estimate(grams: Grams, keys: tuple[str, ...]) -> SetEstimate:
    """Return the most probable soil and parameters under one set of causes, within bounds."""
    start, soils = grams.cause_columns.start, len(grams.soil)
    own = tuple(position - start for key in keys for position in grams.columns_of(key))
    at = np.r_[grams.soil_columns, [start + c for c in own]].astype(np.intp)
    total = grams.net
    precision = total[np.ix_(at, at)] + np.diag(prior_information(grams, keys))
    lower, upper = (x[list(own)] for x in box(grams.causes))
    free = np.full(soils, np.inf)
    found = in_box(precision, total[at, 0], np.r_[-free, lower], np.r_[free, upper])
    coefficients = np.zeros(len(grams.causes))
    coefficients[list(own)] = found[soils:]
    return SetEstimate(keys, own, coefficients, found[:soils], np.asarray(np.linalg.inv(precision), float))


def in_box(precision: FloatArray, side: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the x within bounds that minimises x'precision x / 2 - side'x, shape (p,)."""
    if not side.size:
        return side
    root = np.asarray(np.linalg.cholesky(precision), float)
    target = np.asarray(np.linalg.solve(root, side), float)
    start = np.asarray(np.linalg.solve(root.T, target), float)
    if np.all((start >= lower) & (start <= upper)):
        return start
    return bounded_least_squares(root.T, target, lower, upper, start)


def best_set(
    grams: Grams, excluded: frozenset[str] = frozenset(), most: int = 3, held: tuple[str, ...] | None = None
) -> SetEstimate:
    """Return the most probable set of causes and its values: where the next linearisation belongs.

    The set `held` is kept while no other is `KEEP` times as likely: two forms of one cause would take turns for ever.
    """
    found = posterior(grams, excluded, most)
    keys = found.best()
    if held is not None and not set(held) & excluded and len(held) <= most:
        at = found.hypotheses.position(held)
        keys = held if at is not None and KEEP * found.probability[at] >= found.probability.max() else keys
    return estimate(grams, keys)


def log_evidence(grams: Grams, keys: tuple[str, ...] = ()) -> float:
    """Return the log density of all whitened data under a set of causes, constants included; nats."""
    reduced = without_soil(grams, grams.total)
    base = log_evidence_of_none(grams, reduced)
    if not keys:
        return base
    listed = listed_sets({c.key: c.family for c in grams.causes if c.key in keys}, len(keys))
    return base + float(log_evidences(grams, reduced, listed)[listed.index_of(keys)])


def log_evidence_of_none(grams: Grams, reduced: FloatArray) -> float:
    """Return the log density of all whitened data without a cause, constants included; nats.

    `reduced`, shape (1 + k, 1 + k), is that of `without_soil`, of the sum over all runs.
    """
    soil = grams.soil_columns
    inner = grams.net[soil, soil] + np.eye(len(grams.soil))
    constant = float(grams.samples.sum()) * np.log(2 * np.pi) + float(grams.log_determinants.sum())
    constant += grams.form_log_determinant
    return float(-0.5 * (reduced[0, 0] + np.linalg.slogdet(inner)[1] + constant))


def log_likelihood_of_run(grams: Grams, run: int, keys: tuple[str, ...] = ()) -> float:
    """Return the log density of one run, given all the others and a set of causes; nats."""
    return log_evidence(grams, keys) - log_evidence(grams.without(run), keys)


def log_evidence_of_sets(grams: Grams, excluded: frozenset[str], most: int, key: str | None = None) -> float:
    """Return the log density of all whitened data over all sets of causes by their prior, nats.

    With `key` only sets with that effect count.
    """
    reduced = without_soil(grams, grams.total)
    listed, found = weighed(grams, reduced, excluded, most, BEAM)
    among = np.ones(len(listed), bool) if key is None else listed.has_effect[:, listed.effects.index(key)]
    return log_evidence_of_none(grams, reduced) + float(scipy.special.logsumexp((found + listed.log_prior)[among]))
