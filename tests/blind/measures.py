"""L, d, d_sep and the oracle (diagnosis.md 12): from the generator's truth alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from blind.causes import ALL, FAMILIES, KNOWN, RIVALS
from blind.field import FieldDay
from blind.noise import instrument_covariance, run_covariance
from blind.sight import Sight, sight_of, soil_columns
from scipy.linalg import cholesky, solve_triangular
from scipy.special import log_ndtr, logsumexp

from daq import FloatArray

NO_CAUSE_SHARE = 0.25
"""Share of campaigns without a cause, of the mix that the oracle knows."""
_DRAWS = 400
_SIZES, _BINS = (0.35, 7.0), 24


class Yardstick:
    """One campaign's measure of signatures.

    Parameters
    ----------
    day : FieldDay
    """

    def __init__(self, day: FieldDay) -> None:
        self.day = day
        self.sight: Sight = sight_of(day)
        self._inverse = np.linalg.inv(instrument_covariance(day, self.sight))
        self._roots = []
        for index in range(len(day.plans)):
            covariance, rows = run_covariance(day, self.sight, index)
            self._roots.append((cholesky(covariance, lower=True), rows))
        soil = np.stack([self.whitened(column) for column in soil_columns(self.sight)], axis=1)
        self._soil = soil
        self._inner = np.linalg.inv(np.eye(soil.shape[1]) + soil.T @ soil)

    def loudness(self, change: FloatArray) -> float:
        """Return L: the root mean square of a change over the instruments' noise, while it rolls."""
        delta = change[:, self.sight.rolls]
        return float(np.sqrt(np.mean(np.einsum("in,nij,jn->n", delta, self._inverse[self.sight.rolls], delta))))

    def whitened(self, change: FloatArray) -> FloatArray:
        """Return a change in units of the noise, all runs in one column."""
        parts = [solve_triangular(root, change[:, rows].ravel(), lower=True) for root, rows in self._roots]
        return np.concatenate(parts)

    def gram(self, columns: FloatArray) -> FloatArray:
        """Return inner products of whitened columns with the laboratory's soil projected out."""
        cross = self._soil.T @ columns
        return columns.T @ columns - cross.T @ self._inner @ cross

    def size_for(self, key: str, loudness: float, sign: float = 1.0) -> tuple[float, float]:
        """Return the size of a cause with this L, and the L that was reached within the cause's limits."""
        scale, limits = ALL[key].plausible(self.day.world.vehicle.radius_m)
        limit = abs(limits[1] if sign * np.sign(scale) > 0 else limits[0])
        size, power = min(abs(scale), 0.5 * limit), 1.0
        before = None
        for _ in range(12):
            reached = self.loudness(self.sight.change([(key, sign * np.sign(scale) * size)]))
            if not np.isfinite(reached):  # the soil no longer carries the wheel
                limit, size = size, 0.5 * size
                continue
            if abs(reached / loudness - 1) < 0.01 or (size >= limit and reached < loudness):
                break
            if before is not None and size != before[0]:
                seen = np.log(reached / before[1]) / np.log(size / before[0])
                power = float(np.clip(seen, 0.3, 2.0)) if np.isfinite(seen) else 1.0
            before = size, reached
            size = min(size * np.clip((loudness / max(reached, 1e-9)) ** (1 / power), 0.05, 20.0), limit)
        return float(sign * np.sign(scale) * size), reached

    @cached_property
    def signatures(self) -> Mapping[str, FloatArray]:
        """Whitened signature of every known cause, scaled to L = 1."""
        out = {}
        for key in KNOWN:
            scale, _ = ALL[key].plausible(self.day.world.vehicle.radius_m)
            while not np.isfinite(change := self.sight.change([(key, scale)])).all():
                scale *= 0.5
            out[key] = self.whitened(change / max(self.loudness(change), 1e-12))
        return out


@dataclass(frozen=True)
class Told:
    """What the data can tell of one hidden cause.

    Attributes
    ----------
    loudness, detectability, separability : L, d, d_sep
    rival : str
        The family that leaves least of it.
    """

    loudness: float
    detectability: float
    separability: float
    rival: str


def told(yardstick: Yardstick, hidden: Sequence[tuple[str, float]], member: int = 0, without: str = "") -> Told:
    """Return L, d and d_sep of one member of what is hidden; the other members are projected out.

    Parameters
    ----------
    yardstick : Yardstick
    hidden : sequence of (key, size)
    member : int
    without : str
        A family that is no rival (it was taken out of the library).
    """
    sight = yardstick.sight
    own = ALL[hidden[member][0]].family
    others = [one for i, one in enumerate(hidden) if i != member]
    change = sight.change(hidden) - (sight.change(others) if others else 0.0)
    partners = [yardstick.whitened(sight.change([one])) for one in others]
    columns = np.stack([yardstick.whitened(change), *partners, *yardstick.signatures.values()], axis=1)
    gram = _projected(yardstick.gram(columns), range(1, 1 + len(partners)))
    keys = list(yardstick.signatures)
    least, rival = gram[0, 0], ""
    no_rivals = {own, without} | {ALL[key].family for key, _ in others}
    for forms in RIVALS:
        if ALL[forms[0]].family in no_rivals:
            continue
        left = gram[0, 0] - explained(gram, [1 + len(partners) + keys.index(key) for key in forms], forms)
        if left < least:
            least, rival = left, ALL[forms[0]].family
    return Told(yardstick.loudness(change), _root(gram[0, 0]), _root(least), rival)


def _projected(gram: FloatArray, positions: Iterable[int]) -> FloatArray:
    for p in positions:
        if gram[p, p] > 1e-9:
            gram = gram - np.outer(gram[:, p], gram[p]) / gram[p, p]
    return gram


def explained(gram: FloatArray, positions: Sequence[int], forms: Sequence[str]) -> float:
    """Return how much of the first column some others explain; one-sided causes have a sign to keep."""
    best = 0.0
    for count in range(1, len(positions) + 1):
        for chosen in combinations(range(len(positions)), count):
            at = [positions[i] for i in chosen]
            inner, cross = gram[np.ix_(at, at)], gram[at, 0]
            if np.min(np.diag(inner)) < 1e-9:
                continue
            sizes = np.linalg.lstsq(inner, cross, rcond=1e-10)[0]
            if all(ALL[forms[i]].both or size >= 0 for i, size in zip(chosen, sizes, strict=True)):
                best = max(best, float(sizes @ cross))
    return best


def _root(x: float) -> float:
    return float(np.sqrt(max(x, 0.0)))


def forms_apart(yardstick: Yardstick, hidden: Sequence[tuple[str, float]], member: int = 0) -> float:
    """Return what is left of one member when the best other form of its family explains it; 0 without such."""
    key = hidden[member][0]
    change = yardstick.sight.change([hidden[member]])
    others = [
        other
        for other, known in KNOWN.items()
        if known.family == ALL[key].family and other != key and not known.variant
    ]
    if not others or ALL[key].variant:
        return 0.0
    columns = np.stack([yardstick.whitened(change), *(yardstick.signatures[other] for other in others)], axis=1)
    gram = yardstick.gram(columns)
    return min(_root(gram[0, 0] - explained(gram, [i], [other])) for i, other in enumerate(others, 1))


def left_by_three(yardstick: Yardstick, hidden: Sequence[tuple[str, float]], without: str = "") -> float:
    """Return what is left of a change when up to three listed causes, the best ones in turn, may explain it.

    Parameters
    ----------
    yardstick : Yardstick
    hidden : sequence of (key, size)
    without : str
        A family that may not (it was taken out of the library).
    """
    columns = np.stack([yardstick.whitened(yardstick.sight.change(hidden)), *yardstick.signatures.values()], axis=1)
    gram = yardstick.gram(columns)
    barred = np.array([True, *(ALL[key].variant or ALL[key].family == without for key in yardstick.signatures)])
    for _ in range(3):
        diagonal = np.diag(gram)
        gain = np.where(barred | (diagonal < 1e-6), 0.0, gram[0] ** 2 / np.maximum(diagonal, 1e-6))
        gram = _projected(gram, [int(np.argmax(gain))])
    return _root(gram[0, 0])


@dataclass(frozen=True)
class Oracle:
    """How often a choice with everything known but the cause finds it.

    Attributes
    ----------
    right, right_forced : float
        Share of noise draws in which the true family comes first; forced: "none" is no answer.
    verdicts : mapping (verdict, holds the truth) -> float
        Share of noise draws with this verdict, by the engine's levels: "none" above .2 is nothing, a family above .9
        is named, else the shortest set of families of 95 %.
    """

    right: float
    right_forced: float
    verdicts: Mapping[str, float]


def oracle(yardstick: Yardstick, hidden: Sequence[tuple[str, float]], seed: int = 0) -> Oracle:
    """Choose among all families with noise covariance, soil spread and case mix known; linear and Gaussian.

    Sizes of the mix are log-uniform in L from .35 to 7, signs as likely as they are drawn, forms and variants alike.
    """
    signatures = dict(yardstick.signatures)
    truth = np.zeros_like(next(iter(signatures.values())))
    if hidden:
        change = yardstick.sight.change(hidden)
        truth = yardstick.whitened(change)
        if len(hidden) == 1 and hidden[0][0] in signatures:
            sign = np.sign(hidden[0][1] * ALL[hidden[0][0]].scale)
            signatures[hidden[0][0]] = sign * truth / max(yardstick.loudness(change), 1e-12)
    gram = yardstick.gram(np.stack([truth, *signatures.values()], axis=1))
    values, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = gram[:, [0]] + root @ np.random.default_rng(seed).standard_normal((len(gram), _DRAWS))
    evidence: dict[str, list[FloatArray]] = {family: [] for family in FAMILIES}
    for position, key in enumerate(signatures, 1):
        norm = max(gram[position, position], 1e-9)
        both = [_evidence(sign * draws[position], norm) for sign in ((1.0, -1.0) if ALL[key].both else (1.0,))]
        evidence[ALL[key].family].append(_log_mean(np.array(both)))
    score = np.array([_log_mean(np.array(forms)) for forms in evidence.values()])
    none = np.log(NO_CAUSE_SHARE) - np.log((1 - NO_CAUSE_SHARE) / len(FAMILIES))
    best = np.argmax(score, axis=0)
    said = np.where(score.max(axis=0) > none, best, -1)
    true = FAMILIES.index(ALL[hidden[0][0]].family) if hidden and ALL[hidden[0][0]].family else -1
    return Oracle(float(np.mean(said == true)), float(np.mean(best == true)), _verdicts(score, none, true))


def _verdicts(score: FloatArray, none: float, true: int) -> dict[str, float]:
    """Return how often each verdict comes, `right` and `wrong` by whether it holds the true family."""
    log_odds = np.vstack([score, np.full(score.shape[1], none)])
    chance = np.exp(log_odds - logsumexp(log_odds, axis=0))
    families = chance[:-1]
    order = np.argsort(-families, axis=0)
    before = np.cumsum(np.take_along_axis(families, order, axis=0), axis=0) - np.take_along_axis(
        families, order, axis=0
    )
    short = np.zeros(families.shape, dtype=bool)
    np.put_along_axis(short, order, before < 0.95 * families.sum(axis=0), axis=0)
    nothing, top = chance[-1] >= 0.2, families.max(axis=0)
    named = ~nothing & (top > 0.9)
    holds = short[true] if true >= 0 else np.zeros(len(nothing), dtype=bool)
    first = order[0] == true
    return {
        "nothing": float(np.mean(nothing)),
        "named right": float(np.mean(named & first)),
        "named wrong": float(np.mean(named & ~first)),
        "one_of right": float(np.mean(~nothing & ~named & holds)),
        "one_of wrong": float(np.mean(~nothing & ~named & ~holds)),
    }


def _evidence(match: FloatArray, norm: float) -> FloatArray:
    """Return the log of the mean likelihood ratio over sizes that are log-uniform in L."""
    edges = np.geomspace(*_SIZES, _BINS + 1)[:, None]
    best, width = match / norm, 1 / np.sqrt(norm)
    above = log_ndtr((edges - best) / width)
    below = log_ndtr(-(edges - best) / width)
    # a difference of tails, taken on the side where both are small
    upper = above[1:] + np.log(-np.expm1(np.minimum(above[:-1] - above[1:], -1e-300)))
    lower = below[:-1] + np.log(-np.expm1(np.minimum(below[1:] - below[:-1], -1e-300)))
    inside = np.where(edges[1:] < best, upper, lower)
    density = 0.5 * np.log(2 * np.pi) + np.log(width) - np.log(np.diff(edges, axis=0) * _BINS)
    return np.asarray(0.5 * match * best + logsumexp(inside + density, axis=0))


def _log_mean(x: FloatArray) -> FloatArray:
    top = x.max(axis=0)
    return np.asarray(top + np.log(np.mean(np.exp(x - top), axis=0)))
