"""Whether soil and listed causes explain the data, or something that nobody lists does; and where a simulation is off.

**Whether**: a posterior probability.
Beside each set of causes, the empty one too, stand hypotheses of what the formulas leave: only the error of form
(`model.diagnosis.time_series.basis.FORM_ERROR`); or shapes of one kind (over slip, load, speed, place, direction, rate,
time in one run, an error of an input) that are larger, by something that no cause describes. The coefficients of such a
kind are N(0, s^2), with s one of `SCALES` alike. That one kind is larger has the probability `UNLISTED`, whatever the
causes; kinds share it alike, runs that of the times in a run. All are weighed with all sets at once: a misfit that
a set explains as well speaks for neither. With shapes of all kinds larger at once, 140 of them, only a misfit of
hundreds of nats would be seen; one kind at a time sees what a test of its worst kind would.

**Where**: residuals by channel, slip, load, speed, place, time and direction. The catch-all's shapes are tested one
after the other: the one that stands out most is reported and taken out, and the rest are tested again, so that one
misfit is not reported five times. A size is the regression height of the shape: its coefficient, the soil re-calibrated
and the shapes found before taken out, times the largest value of the shape. It is not the mean of measured less
simulated there. A statistic is that height over its one-sigma by the noise model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from daq import INPUTS, OUTPUTS, FloatArray, IndexArray
from model.diagnosis.core.result import Adequacy, Finding, LackOfFit
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import log_evidence_of_sets
from model.diagnosis.time_series.joining import runs_of
from model.diagnosis.time_series.start import CampaignData

UNLISTED = 0.02
"""Probability that something acts that no cause of the library describes (docs/decisions/diagnosis-adequacy.md)."""
SCALES = (0.1, 0.3, 1.0)
"""One-sigma of the coefficients of a kind of shape then: shares of `basis.AMPLITUDE`, 2 % of the load."""
LIMIT = 0.5
"""Probability of something unlisted from which on nothing is explained."""
DOUBTFUL = 0.1
"""Probability from which several models of the noise are asked: a name needs nine in ten."""
MOST_EXCESS = 2.0


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


@dataclass(frozen=True)
class Unlisted:
    """What no cause describes, as far as shapes of one kind show it.

    Attributes
    ----------
    log_odds : float
        That something of any kind acts.
    shapes : int array
        Positions of the most probable kind's among the shapes that every run may show, or among a run's own.
    run : int or None
        Whose own shapes they are.
    scale : float
        One-sigma of their coefficients, the most probable one.
    """

    log_odds: float
    shapes: IndexArray
    run: int | None
    scale: float

    @property
    def probability(self) -> float:
        """That something of any kind acts."""
        return float(scipy.special.expit(self.log_odds))


def unlisted(grams: Grams, excluded: frozenset[str] = frozenset(), most: int = 3) -> Unlisted:
    """Weigh what no cause describes against all sets of causes, the noise model taken at its word.

    Families or keys that are `excluded` leave no trace; the largest set has `most` causes.
    """
    return over_noises([(grams, 0.0)], excluded, most)


def over_noises(
    weighted: Iterable[tuple[Grams, float]], excluded: frozenset[str] = frozenset(), most: int = 3
) -> Unlisted:
    """Weigh it over several models of the noise, one at least; see `unlisted`.

    `weighted` is the cross products whitened by each, and the logarithm of the prior density of its hyper-parameters.
    """
    kinds: list[tuple[IndexArray, int | None, float]] = []
    each, priors = [], []
    for grams, log_prior in weighted:
        kinds = kinds or list(_kinds(grams))
        if not kinds:
            return Unlisted(-np.inf, np.arange(0), None, SCALES[0])
        each.append(_log_weights(grams, kinds, excluded, most))
        priors.append(log_prior)
    found = scipy.special.logsumexp([larger + p for (larger, _), p in zip(each, priors, strict=True)], axis=0)
    against = scipy.special.logsumexp([listed + p for (_, listed), p in zip(each, priors, strict=True)])
    kind, scale = np.unravel_index(int(np.argmax(found)), found.shape)
    shapes, run, _ = kinds[int(kind)]
    return Unlisted(float(scipy.special.logsumexp(found) - against), shapes, run, SCALES[int(scale)])


def _log_weights(
    grams: Grams, kinds: Sequence[tuple[IndexArray, int | None, float]], excluded: frozenset[str], most: int
) -> tuple[FloatArray, float]:
    """Return evidence times prior where shapes of each kind are larger, by each of `SCALES`, and where none are."""
    sums = {"samples": grams.samples.sum(keepdims=True), "log_determinants": grams.log_determinants.sum(keepdims=True)}
    grams = replace(grams, matrices=grams.total[None], static=0.0, run_names=("all",), **sums)

    def evidence(of: Grams) -> float:
        return log_evidence_of_sets(of, excluded, most)

    larger = [
        [evidence(_with_larger(grams, shapes, run, scale)) + share for scale in SCALES] for shapes, run, share in kinds
    ]
    return np.log(UNLISTED / len(SCALES)) + np.array(larger), evidence(replace(grams, own=())) + np.log1p(-UNLISTED)


def _kinds(grams: Grams) -> Iterator[tuple[IndexArray, int | None, float]]:
    """Yield the shapes of each kind, the run whose own they are, and the logarithm of the kind's share of all."""
    groups = [shapes for shapes in kinds_of(grams.basis) if not grams.basis[shapes[0]].cause]
    runs = [run for run, gram in enumerate(grams.own) if len(gram.inner)]
    share = -float(np.log(max(len(groups) + bool(runs), 1)))
    for shapes in groups:
        yield shapes, None, share
    for run in runs:
        yield np.arange(len(grams.own[run].inner)), run, share - float(np.log(len(runs)))


def kinds_of(shapes: Sequence[Shape]) -> list[IndexArray]:
    """Return the positions of the shapes of each kind; every campaign and every cause's formula has its own.

    What no cause describes shows at all wheels of a vehicle: theirs are of one kind.
    """
    groups: dict[tuple[str, str, str], list[int]] = {}
    for i, shape in enumerate(shapes):
        groups.setdefault((shape.kind, shape.vehicle or shape.campaign, shape.cause), []).append(i)
    return [np.array(positions, np.intp) for positions in groups.values()]


def _with_larger(grams: Grams, shapes: IndexArray, run: int | None, scale: float) -> Grams:
    """Return the Gram matrices where some shapes are larger than the error of form; other runs' own are left out."""
    if run is None:
        form = np.array(np.broadcast_to(grams.form, len(grams.basis)))
        form[shapes] = np.maximum(form[shapes], scale)
        return replace(grams, own=(), form=form)
    own = grams.own[run]
    inner, across = np.eye(len(own.inner)) + scale**2 * own.inner, scale * own.across
    taken = across.T @ np.linalg.solve(inner, across)
    more = float(np.linalg.slogdet(inner)[1])
    return replace(grams, own=(), matrices=grams.matrices - taken, log_determinants=grams.log_determinants + more)


def adequacy(grams: Grams, keys: tuple[str, ...], found: Unlisted) -> Adequacy:
    """Judge whether causes of the library explain the data; where no shape could show that none does, none does.

    The keys are those of the most probable set's effects.
    """
    if not left_over(grams, keys).information.any():
        return Adequacy(float("nan"), float("nan"), ok=False, measure="probability")
    return Adequacy(found.probability, LIMIT, ok=found.probability <= LIMIT, measure="probability")


def lack_of_fit(
    grams: Grams, campaigns: tuple[CampaignData, ...], keys: tuple[str, ...], found: Unlisted, excess: float = 1.0
) -> LackOfFit:
    """Return what the most probable kind of unlisted shapes says is left, fitted all together.

    The shapes' columns are those of the campaigns. The keys are of the set of causes that leaves it; `excess` is a
    factor on the noise's variance.
    """
    shapes, left = grams.all_shapes()[0], left_over(grams, keys)
    first = 0 if found.run is None else len(grams.basis) + sum(len(gram.inner) for gram in grams.own[: found.run])
    ranks = grams.places[first + found.shapes]
    information = left.information[np.ix_(ranks, ranks)] / excess
    covariance = np.linalg.inv(information + np.eye(ranks.size) / found.scale**2)
    size = covariance @ left.score[ranks] / excess
    heights = np.concatenate([data.columns.heights(data.samples.run) for data in campaigns])[ranks]
    statistic = size / np.sqrt(np.diag(covariance))
    worst = np.argsort(-np.abs(statistic))[:_WORST]
    return LackOfFit(
        tuple(
            Finding(_role(shapes[ranks[i]]), shapes[ranks[i]], float(size[i] * heights[i]), float(statistic[i]))
            for i in worst
        ),
        _rms(campaigns, found, size),
    )


def _role(shape: Shape) -> str:
    return {**INPUTS, **OUTPUTS}[shape.channel].role


def _rms(campaigns: Sequence[CampaignData], found: Unlisted, size: FloatArray) -> dict[str, float]:
    """Return the root mean square of the fitted curve over the samples of the campaign that shows it most."""
    largest: dict[str, float] = {}
    for data, rows, first in _shown(campaigns, found.run):
        own = found.shapes - first
        mine = (own >= 0) & (own < rows.shape[-1])
        curve = rows[..., own[mine]] @ size[: len(own)][mine] if mine.any() else np.zeros((len(rows), 1))
        for channel, x in zip(data.linear.channels, curve, strict=True):
            role = OUTPUTS[channel].role
            largest[role] = max(largest.get(role, 0.0), float(np.sqrt(np.mean(x**2))))
    return {role: x for role, x in largest.items() if x > 0.0}


def _shown(campaigns: Sequence[CampaignData], run: int | None) -> Iterator[tuple[CampaignData, FloatArray, int]]:
    """Yield the shapes' columns of each campaign, or of one run only, and the number of the first among all."""
    first = 0
    if run is None:
        for data in campaigns:
            columns, count = data.columns, len(data.columns.catch_all.shapes)
            yield data, columns.rows[..., columns.shared - count : columns.shared], first
            first += count
        return
    for at, number in runs_of([(data.campaign, data.samples) for data in campaigns])[run]:
        data = campaigns[at]
        count = len(data.columns.catch_all.of_run[number].shapes)
        begin = data.columns.shared
        yield data, data.columns.rows[:, data.samples.run == number, begin : begin + count], first
        first += count


def excess(grams: Grams, keys: tuple[str, ...]) -> float:
    """Return the factor on the noise's variance that the left-over asks for, where it is still taken as noise.

    A noise model that is a little too small shows in the catch-all, and would make every probability too sure of
    itself: the evidence is taken with a variance that is larger by this (Birge's ratio), up to `MOST_EXCESS`.
    """
    if not grams.basis and not any(len(gram.inner) for gram in grams.own):
        return 1.0
    own = [gram.integrated for gram in grams.own]
    taken = sum((part.taken for part in own), np.zeros_like(grams.total))
    spread = sum((part.spread for part in own), np.zeros_like(grams.total))
    causes, shared = _uncertain(grams, keys), np.r_[grams.basis_columns].astype(np.intp)
    both, left = np.r_[causes, shared], grams.total - taken
    inverse = np.linalg.inv(np.eye(both.size) + left[np.ix_(both, both)])
    kept = np.arange(causes.size, both.size)
    known = np.diag(inverse)[kept]
    expected = kept.size - float(known.sum())
    across, inner = grams.total[np.ix_(causes, shared)], grams.total[np.ix_(causes, causes)] + np.eye(causes.size)
    information = np.diag(grams.total[np.ix_(shared, shared)] - across.T @ np.linalg.solve(inner, across))
    expected += float(np.sum(np.square(grams.form) * (information - 1.0 + known)))
    expected += sum(part.freedom for part in own) - float(np.sum(inverse * spread[np.ix_(both, both)]))
    without = grams.total[causes, 0] @ np.linalg.solve(
        np.eye(causes.size) + grams.total[np.ix_(causes, causes)], grams.total[causes, 0]
    )
    found = float(left[both, 0] @ inverse @ left[both, 0] + taken[0, 0] - without)
    return float(np.clip(found / max(expected, 1e-9), 1.0, MOST_EXCESS))


LEAST = 3.5
"""Size of a statistic from which on a shape is said: one of 140 shapes exceeds it by chance in one of 15 campaigns."""
MOST = 8
_WORST = 3
"""Shapes of lack of fit that are said."""
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

    The shapes' heights are those of the campaigns. The keys are of the causes that the simulation has; `excess` is a
    factor on the noise's variance. With `inputs` errors of ground speed and load are asked for, too. What a missing
    cause leaves looks like many of them: where there is a name for it, they are not asked for.
    """
    heights = np.concatenate([data.columns.heights(data.samples.run) for data in campaigns])
    shapes, _ = grams.all_shapes()
    asked = [i for i, s in enumerate(shapes) if not s.cause and (inputs or s.channel not in INPUTS)]
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

    `height`, shape (b,), is that of each shape with a coefficient of 1, in the unit of its channel or input; `excess`
    is a factor on the noise's variance; `least` is the smallest statistic and `most` the largest number of shapes.
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
        found.append(Finding(_role(shape), shape, size, float(z[worst])))
        column = information[:, worst] / own[worst]
        score = score - column * score[worst]
        information = information - np.outer(column, information[worst])
    return sorted(found, key=lambda f: -abs(f.statistic))
