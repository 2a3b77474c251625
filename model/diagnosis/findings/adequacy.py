r"""Whether soil and causes leave more than noise: what the catch-all shapes still explain, all together and by kind.

With soil and the set's causes integrated out, shapes of one kind (over slip, load, speed, place, time, direction,
rate, an error of an input) have score v and information K, and

.. math:: T = v'(I + K)^{-1}v, \qquad T \sim \sum_i w_i \chi^2_1, \quad w_i = \lambda_i/(1 + \lambda_i)

if the noise model holds, with :math:`\lambda_i` the eigenvalues of K: a shape that the data can hardly show counts for
little. Each T is taken over a far quantile of its own distribution; the statistic is the largest of these ratios. What
noise makes of it is drawn for the campaign at hand; the threshold is a high quantile of that, times what a noise model
that was itself estimated is off by (`SLACK`). A formula that is right in kind may miss nature's by `FORM` of its size:
that share of what the causes take off each T is no lack of fit.

`SLACK` is from campaigns of a generator that shares no numerics with this engine: see docs/diagnosis.md.

Whether the runs of a campaign were driven on one soil: a campaign of two terrains explains nothing well.

The evidence of two groups of runs, each with a soil of its own from the laboratory's prior, against one soil for all.
Every pair of groups is asked where there are few runs, else they are parted one run at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import gammaincinv

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.core.result import Adequacy
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.grams import Grams

LEAST = 20.0
"""Nats by which two soils must be likelier than one."""
_FEW = 8


def two_soils(grams: Grams) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the runs of the one soil and of the other, the smaller group first; None where one soil will do.

    Parameters
    ----------
    grams : Grams
        Of one campaign.
    """
    count = len(grams.run_names)
    if count < 2 or not grams.soil:
        return None
    together = _evidence(grams, np.ones(count, bool))
    best, group = max(((_gain(grams, own) - together, own.tolist()) for own in _groups(grams, count)), key=_first)
    if best < LEAST:
        return None
    names = np.array(grams.run_names)
    one, other = names[group], names[~np.array(group)]
    return tuple(one.tolist()), tuple(other.tolist())


def _first(pair: tuple[float, list[bool]]) -> float:
    return pair[0]


def _gain(grams: Grams, own: BoolArray) -> float:
    return _evidence(grams, own) + _evidence(grams, ~own)


def _groups(grams: Grams, count: int) -> list[BoolArray]:
    """Return the groups to ask: all of up to half of the runs, or what parting one run at a time goes through."""
    if count <= _FEW:
        sizes = range(1, count // 2 + 1)
        return [np.isin(np.arange(count), own) for size in sizes for own in combinations(range(count), size)]
    groups = [np.zeros(count, bool)]
    for _ in range(count // 2):
        larger = [groups[-1] | (np.arange(count) == run) for run in np.flatnonzero(~groups[-1])]
        groups.append(max(larger, key=lambda own: _gain(grams, own)))
    return groups[1:]


def _evidence(grams: Grams, own: BoolArray) -> float:
    """Return the log evidence of some runs with a soil of their own, up to a constant."""
    total = grams.matrices[own].sum(axis=0)
    soil = grams.soil_columns
    inner = np.eye(len(grams.soil)) + total[soil, soil]
    side = total[soil, 0]
    explained = float(side @ np.linalg.solve(inner, side))
    return 0.5 * (explained - float(total[0, 0])) - 0.5 * float(np.linalg.slogdet(inner)[1])


LEVEL = 0.995
"""Quantile of the statistic where the noise model is exact."""
SLACK = 1.3
"""Factor on that quantile."""
FORM = 0.1
"""Share of its size by which a cause's formula may miss nature's; of two causes half of it, of three a third: a formula
that is right in kind needs no others to make up for it."""
MOST_EXCESS = 2.0
_FAR = 0.9998
"""Quantile that each kind is measured in, so that kinds of few shapes and of many are alike."""
_DRAWS = 2000


@dataclass(frozen=True)
class LeftOver:
    """What the catch-all shapes see once soil and a set of causes are integrated out.

    Attributes
    ----------
    misfit : float
        r'Pr: whitened residual, whose expected value is the number of samples.
    score : array, shape (b,)
    information : array, shape (b, b)
    """

    misfit: float
    score: FloatArray
    information: FloatArray


@dataclass(frozen=True)
class _Kind:
    """Shapes of one kind: their places, (I + K)^-1, and the far quantile of T."""

    shapes: IndexArray
    inverse: FloatArray
    far: float

    def statistic(self, scores: FloatArray) -> FloatArray:
        """Return T of scores of shape (..., b)."""
        own = scores[..., self.shapes]
        return np.asarray(np.einsum("...i,ij,...j->...", own, self.inverse, own))


def left_over(grams: Grams, keys: tuple[str, ...] = ()) -> LeftOver:
    """Integrate soil and a set of causes out of the catch-all's cross products."""
    total = grams.total()
    out = np.r_[grams.soil_columns, [p for key in keys for p in grams.columns_of(key)]].astype(np.intp)
    kept = np.r_[0, grams.basis_columns]
    across = total[np.ix_(out, kept)]
    inner = total[np.ix_(out, out)] + np.eye(out.size)
    found = total[np.ix_(kept, kept)] - across.T @ np.linalg.solve(inner, across)
    return LeftOver(float(found[0, 0]), found[1:, 0], found[1:, 1:])


def adequacy(grams: Grams, keys: tuple[str, ...], rng: np.random.Generator) -> Adequacy:
    """Judge whether a set of causes is an explanation.

    Parameters
    ----------
    keys : tuple of str
        Of the set's effects.
    rng : Generator
        For the threshold.
    """
    left = left_over(grams, keys)
    if not left.score.size:
        return Adequacy(0.0, SLACK, ok=True)
    groups = _kinds(grams.basis)
    kinds = [_kind(left.information, shapes) for shapes in groups]
    before = left_over(grams)
    form = FORM / max(len(keys), 1)
    ratios = []
    for kind, shapes in zip(kinds, groups, strict=True):
        found = float(kind.statistic(left.score))
        explained = float(_kind(before.information, shapes).statistic(before.score)) - found
        ratios.append(found / (kind.far + form**2 * max(explained, 0.0)))
    values, vectors = np.linalg.eigh(left.information)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T  # whatever signs a processor gives the vectors
    drawn = rng.normal(size=(_DRAWS, values.size)) @ root
    largest = np.max([k.statistic(drawn) / k.far for k in kinds], axis=0)
    threshold = SLACK * float(np.quantile(largest, LEVEL))
    return Adequacy(max(ratios), threshold, ok=max(ratios) <= threshold)


def excess(grams: Grams, keys: tuple[str, ...]) -> float:
    """Return the factor on the noise's variance that the left-over asks for, where it is still taken as noise.

    A noise model that is a little too small shows in the catch-all, and would make every probability too sure of
    itself: the evidence is taken with a variance that is larger by this (Birge's ratio), up to `MOST_EXCESS`.
    """
    left = left_over(grams, keys)
    if not left.score.size:
        return 1.0
    whole = np.eye(left.score.size) + left.information
    expected = float(np.trace(np.linalg.solve(whole, left.information)))
    found = float(left.score @ np.linalg.solve(whole, left.score))
    return float(np.clip(found / max(expected, 1e-9), 1.0, MOST_EXCESS))


def _kinds(basis: tuple[Shape, ...]) -> list[IndexArray]:
    """Return the shapes of each kind, and all of them."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, shape in enumerate(basis):
        groups.setdefault(shape.group, []).append(i)
    several = list(groups.values()) if len(groups) > 1 else []
    return [np.array(shapes, np.intp) for shapes in [*several, list(range(len(basis)))]]


def _kind(information: FloatArray, shapes: IndexArray) -> _Kind:
    own = information[np.ix_(shapes, shapes)]
    inverse = np.asarray(np.linalg.inv(np.eye(shapes.size) + own))
    weights = inverse @ own
    mean, variance = float(np.trace(weights)), 2.0 * float(np.sum(weights * weights.T))
    shape = mean**2 / max(variance, 1e-12)
    far = variance / max(mean, 1e-12) * float(gammaincinv(shape, _FAR)) if mean > 0 else np.inf
    return _Kind(shapes, inverse, far if far > 0 else np.inf)
