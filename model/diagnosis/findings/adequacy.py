r"""Lack of fit: whether soil and causes leave more than noise, and where the simulation is off.

**Whether**: what the catch-all's shapes still explain, all together and by kind.
With soil and the set's causes integrated out, shapes of one kind (over slip, load, speed, place, time, direction,
rate, an error of an input) have score v and information K, and

.. math:: T = v'(I + K)^{-1}v, \qquad T \sim \sum_i w_i \chi^2_1, \quad w_i = \lambda_i/(1 + \lambda_i)

if the noise model holds, with :math:`\lambda_i` the eigenvalues of K: a shape that the data can hardly show counts for
little. Each T is taken over a far quantile of its own distribution; the statistic is the largest of these ratios. What
noise makes of it is drawn for the campaign at hand; the threshold is a high quantile of that, times what a noise model
that was itself estimated is off by (`SLACK`). A formula that is right in kind may miss nature's by `FORM` of its size:
that share of what the causes take off each T is no lack of fit.

`SLACK` is from campaigns of a generator that shares no numerics with this engine: see docs/diagnosis.md.

**Where**: residuals by channel, slip, load, speed, place, time and direction. The catch-all's shapes are tested one
after the other: the one that stands out most is reported and taken out, and the rest are tested again, so that one
misfit is not reported five times. A size is the regression height of the shape: its coefficient, the soil re-calibrated
and the shapes found before taken out, times the largest value of the shape. It is not the mean of measured less
simulated there. A statistic is that height over its one-sigma by the noise model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincinv

from daq import INPUTS, OUTPUTS, FloatArray, IndexArray
from model.diagnosis.core.result import Adequacy, Finding
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.start import CampaignData

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
        return np.asarray((own @ self.inverse * own).sum(axis=-1))


def left_over(grams: Grams, keys: tuple[str, ...] = ()) -> LeftOver:
    """Integrate soil and a set of causes out of the catch-all's cross products; its shapes by rank."""
    _, total = grams.all_shapes()
    out = _uncertain(grams, keys)
    kept = np.r_[0, grams.cause_columns.stop : len(total)]
    across = total[np.ix_(out, kept)]
    inner = total[np.ix_(out, out)] + np.eye(out.size)
    found = total[np.ix_(kept, kept)] - across.T @ np.linalg.solve(inner, across)
    return LeftOver(float(found[0, 0]), found[1:, 0], found[1:, 1:])


def _uncertain(grams: Grams, keys: tuple[str, ...]) -> IndexArray:
    """Return the positions of the columns of the soil and of a set's causes."""
    return np.array([*range(1, 1 + len(grams.soil)), *(p for key in keys for p in grams.columns_of(key))], np.intp)


def adequacy(grams: Grams, keys: tuple[str, ...], rng: np.random.Generator) -> Adequacy:
    """Judge whether a set of causes is an explanation; where no shape could show that it is none, it is none.

    Parameters
    ----------
    keys : tuple of str
        Of the set's effects.
    rng : Generator
        For the threshold.
    """
    left = left_over(grams, keys)
    if not left.information.any():
        return Adequacy(float("nan"), float("nan"), ok=False)
    spread = _spread(grams, left.information)
    kinds = [_kind(left.information, spread, shapes) for shapes in _kinds(grams.all_shapes()[0])]
    ratios = _ratios(grams, keys, left, kinds)
    values, vectors = np.linalg.eigh(spread)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T  # whatever signs a processor gives the vectors
    drawn = rng.normal(size=(_DRAWS, values.size)) @ root
    largest = np.max([k.statistic(drawn) / k.far for k in kinds], axis=0)
    threshold = SLACK * float(np.quantile(largest, LEVEL))
    return Adequacy(max(ratios), threshold, ok=max(ratios) <= threshold)


def _ratios(grams: Grams, keys: tuple[str, ...], left: LeftOver, kinds: Sequence[_Kind]) -> list[float]:
    """Return T of each kind over its far quantile and what the causes' formulas may miss."""
    before = left_over(grams)
    form = FORM / max(len(keys), 1)
    ratios = []
    for kind in kinds:
        found = float(kind.statistic(left.score))
        alone = replace(kind, inverse=_inverse(before.information, kind.shapes))
        explained = float(alone.statistic(before.score)) - found
        ratios.append(found / (kind.far + form**2 * max(explained, 0.0)))
    return ratios


def lack_of_fit(
    grams: Grams, campaigns: tuple[CampaignData, ...], keys: tuple[str, ...], excess: float = 1.0
) -> tuple[Finding, ...]:
    """Return the three largest members of the kind of shapes by which a set of causes fails most.

    Parameters
    ----------
    campaigns : tuple of CampaignData
        For the shapes' heights.
    excess : float
        Factor on the noise's variance.
    """
    shapes, left = grams.all_shapes()[0], left_over(grams, keys)
    if not shapes:
        return ()
    spread = _spread(grams, left.information)
    kinds = [_kind(left.information, spread, group) for group in _kinds(shapes)]
    worst = kinds[int(np.argmax(_ratios(grams, keys, left, kinds)))].shapes
    heights = np.concatenate([data.columns.heights(data.samples.run) for data in campaigns])
    own = LeftOver(left.misfit, left.score[worst], left.information[np.ix_(worst, worst)])
    return tuple(found_in(own, tuple(shapes[i] for i in worst), heights[worst], excess, least=0.0, most=3))


def excess(grams: Grams, keys: tuple[str, ...]) -> float:
    """Return the factor on the noise's variance that the left-over asks for, where it is still taken as noise.

    A noise model that is a little too small shows in the catch-all, and would make every probability too sure of
    itself: the evidence is taken with a variance that is larger by this (Birge's ratio), up to `MOST_EXCESS`.
    """
    if not grams.basis and not any(len(one.inner) for one in grams.own):
        return 1.0
    own = [one.integrated for one in grams.own]
    taken = sum((one.taken for one in own), np.zeros_like(grams.total))
    spread = sum((one.spread for one in own), np.zeros_like(grams.total))
    causes, shared = _uncertain(grams, keys), np.r_[grams.basis_columns].astype(np.intp)
    both, left = np.r_[causes, shared], grams.total - taken
    inverse = np.linalg.inv(np.eye(both.size) + left[np.ix_(both, both)])
    kept = np.arange(causes.size, both.size)
    known = np.diag(inverse)[kept]
    expected = kept.size - float(known.sum())
    across, inner = grams.total[np.ix_(causes, shared)], grams.total[np.ix_(causes, causes)] + np.eye(causes.size)
    information = np.diag(grams.total[np.ix_(shared, shared)] - across.T @ np.linalg.solve(inner, across))
    expected += float(np.sum(np.square(grams.form) * (information - 1.0 + known)))
    expected += sum(one.freedom for one in own) - float(np.sum(inverse * spread[np.ix_(both, both)]))
    without = grams.total[causes, 0] @ np.linalg.solve(
        np.eye(causes.size) + grams.total[np.ix_(causes, causes)], grams.total[causes, 0]
    )
    found = float(left[both, 0] @ inverse @ left[both, 0] + taken[0, 0] - without)
    return float(np.clip(found / max(expected, 1e-9), 1.0, MOST_EXCESS))


def _kinds(basis: tuple[Shape, ...]) -> list[IndexArray]:
    """Return the shapes of each kind, and all of them."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, shape in enumerate(basis):
        groups.setdefault(shape.group, []).append(i)
    several = list(groups.values()) if len(groups) > 1 else []
    return [np.array(shapes, np.intp) for shapes in [*several, list(range(len(basis)))]]


def _spread(grams: Grams, information: FloatArray) -> FloatArray:
    """Return the covariance of the scores of a right model: noise, and the error of form of the shared shapes."""
    shared = grams.shared_places
    return information + np.square(grams.form) * information[:, shared] @ information[shared]


def _inverse(information: FloatArray, shapes: IndexArray) -> FloatArray:
    return np.asarray(np.linalg.inv(np.eye(shapes.size) + information[np.ix_(shapes, shapes)]))


def _kind(information: FloatArray, spread: FloatArray, shapes: IndexArray) -> _Kind:
    inverse = _inverse(information, shapes)
    weights = inverse @ spread[np.ix_(shapes, shapes)]
    mean, variance = float(np.trace(weights)), 2.0 * float(np.sum(weights * weights.T))
    shape = mean**2 / max(variance, 1e-12)
    far = variance / max(mean, 1e-12) * float(gammaincinv(shape, _FAR)) if mean > 0 else np.inf
    return _Kind(shapes, inverse, far if far > 0 else np.inf)


LEAST = 3.5
"""Size of a statistic from which on a shape is said: one of 140 shapes exceeds it by chance in one of 15 campaigns."""
MOST = 8
_LEAST_SHARE_LEFT = 0.05
"""Share of a shape's information that soil and earlier findings must have left."""


def findings(
    grams: Grams,
    campaigns: tuple[CampaignData, ...],
    keys: tuple[str, ...] = (),
    excess: float = 1.0,
    *,
    inputs: bool = False,
) -> list[Finding]:
    """Return where the simulation with a set of causes is off, worst first.

    Parameters
    ----------
    campaigns : tuple of CampaignData
        For the shapes' heights.
    keys : tuple of str
        Causes that the simulation has.
    excess : float
        Factor on the noise's variance.
    inputs : bool
        Ask for errors of ground speed and load, too. What a missing cause leaves looks like many of them: where there
        is a name for it, they are not asked for.
    """
    heights = np.concatenate([data.columns.heights(data.samples.run) for data in campaigns])
    shapes, _ = grams.all_shapes()
    asked = [i for i, shape in enumerate(shapes) if inputs or shape.channel not in INPUTS]
    left = left_over(grams, keys)
    left = LeftOver(left.misfit, left.score[asked], left.information[np.ix_(asked, asked)])
    return found_in(left, tuple(shapes[i] for i in asked), heights[asked], excess)


def found_in(
    left: LeftOver,
    shapes: tuple[Shape, ...],
    height: FloatArray,
    excess: float = 1.0,
    *,
    least: float = LEAST,
    most: int = MOST,
) -> list[Finding]:
    """Return the shapes that stand out, one after the other.

    Parameters
    ----------
    height : array, shape (b,)
        Of each shape with a coefficient of 1, in the unit of its channel or input.
    excess : float
        Factor on the noise's variance.
    least, most
        Smallest statistic and largest number of shapes.
    """
    score, information = left.score.copy(), left.information.copy()
    whole = np.maximum(np.diag(information), 1e-12)
    found: list[Finding] = []
    for _ in range(min(most, len(shapes))):
        own = np.diag(information)
        known = own > _LEAST_SHARE_LEFT * whole
        z = np.where(known, score / np.sqrt(np.where(known, own * excess, 1.0)), 0.0)
        worst = int(np.argmax(np.abs(z)))
        if abs(z[worst]) < least or not known[worst]:
            break
        shape = shapes[worst]
        size = float(score[worst] / own[worst] * height[worst])
        found.append(Finding({**INPUTS, **OUTPUTS}[shape.channel].role, shape, size, float(z[worst])))
        column = information[:, worst] / own[worst]
        score = score - column * score[worst]
        information = information - np.outer(column, information[worst])
    return sorted(found, key=lambda f: -abs(f.statistic))
