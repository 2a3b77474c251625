r"""What a set of runs can tell apart: signatures of the causes, once the soil has been re-calibrated.

A whitened column :math:`x` of a cause is seen only as far as the soil cannot imitate it. With the soil's whitened
columns :math:`S` and its prior :math:`N(0, I)`,

.. math:: P = (I + S S')^{-1} = I - S (I + S'S)^{-1} S', \qquad d^2 = \delta' P \delta

for an effect :math:`\delta = X \gamma`. All of it comes from the Gram matrix. What a rival :math:`j` of any size (on
its own side of neutral) leaves of it is :math:`d_{sep}^2 = \min_\beta |\delta - X_j \beta|_P^2`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from daq import BoolArray, FloatArray
from model.diagnosis.core.bayes_factors import Direction, minimum_detectable
from model.diagnosis.core.result import Detectable
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import hypotheses, without_soil

CONFOUNDED_COSINE = 0.95
"""Cosine of two signatures, the soil projected out, from which on causes count as confounded."""
DETECTABLE_D = 5.0
"""d from which on an effect is detectable, and d_sep from which on it is separable from its rivals."""
_NOTHING = 1e-12


def detectable_in_runs(
    grams: Grams, excluded: frozenset[str] = frozenset(), name_at: float = 0.9, excess: float = 1.0
) -> dict[str, Detectable]:
    """Return the smallest size of every effect that these runs show; see `model.diagnosis.core.bayes_factors`.

    Of `grams` only what was driven counts, not what was measured. Families or keys that are `excluded` leave no trace;
    `name_at` is the probability asked for, `excess` a factor on the noise's variance.
    """
    listed = hypotheses(grams, excluded, 1)
    information = np.diag(without_soil(grams, grams.total))[1:] / excess
    directions = {
        key: [
            Direction(c.parameter, c.unit, c.neutral, c.scale, c.one_sided, float(information[i]))
            for i, c in enumerate(grams.causes)
            if c.key == key
        ]
        for key in listed.effects
    }
    return minimum_detectable(listed, directions, name_at)


@dataclass(frozen=True)
class Projected:
    """Cross products of the residual and the causes with the soil projected out.

    Attributes
    ----------
    information : array, shape (k, k)
        X'PX of the causes' columns.
    raw : array, shape (k, k)
        X'X: the same before the soil is re-calibrated.
    score : array, shape (k,)
        X'Pr.
    """

    information: FloatArray
    raw: FloatArray
    score: FloatArray


def projected_without_soil(grams: Grams, matrix: FloatArray | None = None) -> Projected:
    """Project the soil out of a Gram matrix, as far as its prior lets it move.

    `matrix`, shape (m, m), is another sum over runs than that of all.
    """
    total = grams.without_form(grams.total if matrix is None else matrix)
    causes = grams.cause_columns
    kept = [0, *range(causes.start, causes.stop)]
    soil = grams.soil_columns
    cross = total[soil, kept]
    left = total[np.ix_(kept, kept)]
    if cross.size:
        left = left - cross.T @ np.linalg.solve(np.eye(len(cross)) + total[soil, soil], cross)
    left = 0.5 * (left + left.T)
    return Projected(left[1:, 1:], total[causes, causes], left[1:, 0])


@dataclass(frozen=True)
class Isolability:
    """Detectable and separable causes of a campaign; k effects.

    Attributes
    ----------
    sizes : mapping key -> array, shape (parameters,)
        In units of the prior scale, from neutral.
    cosine : array, shape (k, k)
        Largest |cos| between what two causes can do, after the soil was projected out; 0 for one that does nothing.
    left : array, shape (k,)
        Share of the signature's length that the re-calibrated soil leaves.
    deviation : array, shape (k,)
        d at those sizes.
    separation : array, shape (k,)
        d_sep at those sizes.
    rivals : tuple of str
        The other family's effect that leaves least; empty where there is none.
    """

    keys: tuple[str, ...]
    families: tuple[str, ...]
    sizes: dict[str, FloatArray]
    cosine: FloatArray
    left: FloatArray
    deviation: FloatArray
    separation: FloatArray
    rivals: tuple[str, ...]

    def confounded(self, at: float = CONFOUNDED_COSINE) -> tuple[tuple[str, ...], ...]:
        """Return groups of families that are linked by |cos| of `at` or more, largest first; loners are left out."""
        group = {family: {family} for family in self.families}
        for i, j in combinations(range(len(self.keys)), 2):
            a, b = self.families[i], self.families[j]
            if self.cosine[i, j] >= at and group[a] is not group[b]:
                group[a] |= group[b]
                for member in group[b]:
                    group[member] = group[a]
        groups = {id(members): members for members in group.values() if len(members) > 1}.values()
        order = list(dict.fromkeys(self.families))
        return tuple(
            sorted((tuple(sorted(g, key=order.index)) for g in groups), key=lambda g: (-len(g), order.index(g[0])))
        )


def isolability(grams: Grams, sizes: Mapping[str, Sequence[float]] | None = None) -> Isolability:
    """Say which causes the runs behind `grams` can tell apart.

    The sizes are coefficients in units of the prior scale; by default one prior one-sigma for each parameter.
    """
    projected = projected_without_soil(grams)
    keys = tuple(dict.fromkeys(column.key for column in grams.causes))
    where = {key: own_columns(grams, key) for key in keys}
    families = tuple(grams.causes[where[key][0]].family for key in keys)
    chosen = {key: np.ones(len(where[key])) for key in keys}
    chosen |= {key: np.asarray(size, float) for key, size in (sizes or {}).items() if key in where}
    roots = [_inverse_root(projected.information[np.ix_(where[key], where[key])]) for key in keys]
    cosine = np.eye(len(keys))
    for i, j in combinations(range(len(keys)), 2):
        across = projected.information[np.ix_(where[keys[i]], where[keys[j]])]
        cosine[i, j] = cosine[j, i] = _cosine(roots[i].T @ across @ roots[j])
    apart = [_apart(grams, projected, key, chosen[key]) for key in keys]
    deviation = np.array([_length(projected.information, where[key], chosen[key]) for key in keys])
    raw = np.array([_length(projected.raw, where[key], chosen[key]) for key in keys])
    left = np.divide(deviation, raw, out=np.zeros(len(keys)), where=raw > 0)
    separation = np.array([min([d, *others.values()]) for d, others in zip(deviation, apart, strict=True)])
    rivals = tuple(min(others, key=others.__getitem__, default="") for others in apart)
    return Isolability(keys, families, chosen, cosine, left, deviation, separation, rivals)


def _apart(grams: Grams, projected: Projected, key: str, size: FloatArray) -> dict[str, float]:
    """Return what each effect of another family leaves of an effect."""
    family = next(column.family for column in grams.causes if column.key == key)
    others = dict.fromkeys(column.key for column in grams.causes if column.family != family)
    return {other: separation_of(grams, projected, key, size, other) for other in others}


def own_columns(grams: Grams, key: str) -> list[int]:
    """Return the positions of an effect's parameters among the causes."""
    return [i for i, column in enumerate(grams.causes) if column.key == key]


def separation_of(grams: Grams, projected: Projected, key: str, size: FloatArray, rival: str) -> float:
    """Return what a rival leaves of an effect of a given size, both signs of it where both are possible; d units.

    Of a rival that is one-sided nowhere both signs leave the same.
    """
    own, other = own_columns(grams, key), own_columns(grams, rival)
    sided = np.array([grams.causes[i].one_sided for i in other])
    signs = (1.0,) if any(grams.causes[i].one_sided for i in own) or not sided.any() else (1.0, -1.0)
    return min(least_left(projected.information, own, sign * size, other, sided) for sign in signs)


def least_left(
    information: FloatArray, own: Sequence[int], size: FloatArray, other: Sequence[int], one_sided: BoolArray
) -> float:
    """Return min over b of |X_own size - X_other b|_P, b >= 0 where one-sided."""
    power = float(size @ information[np.ix_(own, own)] @ size)
    cross = information[np.ix_(other, own)] @ size
    best = power
    for count in range(1, len(other) + 1):
        for free in map(list, combinations(range(len(other)), count)):
            rows = [other[i] for i in free]
            b = _solved(information[np.ix_(rows, rows)], cross[free])
            if not np.any((b < 0) & one_sided[free]):
                best = min(best, power - float(cross[free] @ b))
    return float(np.sqrt(max(best, 0.0)))


def _solved(matrix: FloatArray, side: FloatArray) -> FloatArray:
    """Return the least-squares solution of a symmetric system; most are of one number."""
    if len(side) == 1:
        return np.asarray(side / matrix[0] if matrix[0, 0] > 0.0 else np.zeros(1))
    return np.asarray(np.linalg.pinv(matrix, rcond=_NOTHING, hermitian=True) @ side)


def _length(information: FloatArray, own: Sequence[int], size: FloatArray) -> float:
    return float(np.sqrt(max(float(size @ information[np.ix_(own, own)] @ size), 0.0)))


def _cosine(across: FloatArray) -> float:
    """Return the largest canonical correlation between two sets of columns, from their whitened cross products."""
    singular = np.linalg.svd(across, compute_uv=False)
    return float(min(singular[0], 1.0)) if singular.size else 0.0


def _inverse_root(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(matrix)
    kept = values > max(_NOTHING * values[-1], np.finfo(float).tiny)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))
