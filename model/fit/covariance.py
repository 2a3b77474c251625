"""Covariance of a least-squares estimate, and the parameters that are not separable.

With a residual ``r(x)`` whose entries are independent with variance ``v``, and sensitivities ``J = dr/dx`` at the
minimum, the estimate has the covariance ``v (J' J)^-1``. It is taken from the singular values of ``J`` with its
columns scaled to unit length, ``J = A C``, ``A = U S V'``::

    (J' J)^-1 = C^-1 V S^-2 V' C^-1

so that no normal equations are squared and the rank does not depend on the units of the parameters. A singular value
that is zero to rounding is a combination of parameters that does not move the residual at all: every parameter that
takes part in it has an infinite variance. Short of that, two parameters with a correlation near 1 in size fix one
combination only; which one, and how much better, is noted in `Covariance.warnings`.

Source: Golub & Van Loan, Matrix Computations, 5.5; Bates & Watts (1988), Nonlinear Regression Analysis, 2.2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from daq import BoolArray, FloatArray, Note
from model.notes import FitCode

_STRONG = 0.99  # size of a correlation from which on there is a warning
_INVOLVED = 1e-6  # share of a null direction from which on a parameter takes part in it


@dataclass(frozen=True)
class Covariance:
    """Covariance of an estimate.

    Attributes
    ----------
    matrix : shape (p, p)
        Infinite variance where the data do not determine a parameter, NaN for one that is held at a bound.
    correlation : shape (p, p)
        NaN where a variance is not finite or zero.
    condition_number : float
        Largest over smallest singular value of the sensitivities with columns of unit length; 1 is ideal.
        Its square is the condition number of the correlation matrix.
    rank : number of combinations that the data determine
    warnings : tuple of Note
        Parameters that are not separable, with the numbers.
    """

    matrix: FloatArray
    correlation: FloatArray
    condition_number: float
    rank: int
    warnings: tuple[Note, ...] = ()


def covariance(
    jacobian: FloatArray,
    variance: float = 1.0,
    *,
    names: Sequence[str] | None = None,
    held: BoolArray | None = None,
) -> Covariance:
    """Return the covariance of an estimate from the residual's sensitivities at it, shape (m, p).

    `variance` is that of one entry of the residual: 1 where the residual is already divided by its sigma. The names are
    for the warnings. Parameters that are `held` at a bound have no variance (NaN) and do not widen that of the others.

    Source: Bates & Watts (1988), Nonlinear Regression Analysis, eq. 2.17.
    """
    count = jacobian.shape[1]
    free = np.ones(count, bool) if held is None else ~held
    labels = tuple(names) if names else tuple(f"x{i}" for i in range(1, count + 1))
    labels = tuple(label for label, is_free in zip(labels, free, strict=True) if is_free)
    matrix = np.full((count, count), np.nan)
    inner = _of_free(jacobian[:, free], variance, labels)
    matrix[np.ix_(free, free)] = inner.matrix
    correlation = np.full((count, count), np.nan)
    correlation[np.ix_(free, free)] = inner.correlation
    return Covariance(matrix, correlation, inner.condition_number, inner.rank, inner.warnings)


def _of_free(jacobian: FloatArray, variance: float, names: tuple[str, ...]) -> Covariance:
    count = jacobian.shape[1]
    if count == 0:
        return Covariance(np.zeros((0, 0)), np.zeros((0, 0)), 1.0, 0)
    length = np.linalg.norm(jacobian, axis=0)
    length[length == 0] = 1.0
    triangle = np.asarray(np.linalg.qr(jacobian / length, mode="r"))
    singular, vt = _singular_values(triangle, count)
    kept = singular > singular[0] * np.finfo(float).eps * max(jacobian.shape) if singular[0] > 0 else singular > 0
    inverse = (vt[kept].T / singular[kept] ** 2) @ vt[kept]
    matrix = variance * inverse / np.outer(length, length)
    unknown = np.any(np.abs(vt[~kept]) > _INVOLVED, axis=0)
    matrix[unknown, :] = matrix[:, unknown] = np.nan
    matrix[unknown, unknown] = np.inf
    deviation = np.sqrt(np.diag(matrix))
    usable = np.isfinite(deviation) & (deviation > 0)
    deviation = np.where(usable, deviation, np.nan)
    correlation = np.asarray(matrix / np.outer(deviation, deviation))
    multiple = np.sqrt(np.clip(1.0 - 1.0 / np.maximum(np.diag(inverse), 1.0), 0.0, 1.0))
    multiple[unknown] = np.nan
    condition = singular[0] / singular[-1] if kept.all() else np.inf
    warnings = (
        *(_null_note(direction, names) for direction in vt[~kept]),
        *_pair_notes(matrix, correlation, names),
        *_group_notes(correlation, multiple, names, condition),
    )
    return Covariance(matrix, correlation, float(condition), int(kept.sum()), warnings)


def _singular_values(triangle: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return all `count` singular values, padded with zeros where there are fewer rows than columns."""
    _, singular, vt = np.linalg.svd(triangle, full_matrices=True)
    return np.concatenate([singular, np.zeros(count - singular.size)]), vt


def _null_note(direction: FloatArray, names: tuple[str, ...]) -> Note:
    share = np.abs(direction) / np.max(np.abs(direction))
    members = tuple(name for name, part in zip(names, share, strict=True) if part > _INVOLVED)
    return Note(FitCode.NO_INFLUENCE if len(members) == 1 else FitCode.ONLY_TOGETHER, values={"names": members})


def _pair_notes(matrix: FloatArray, correlation: FloatArray, names: tuple[str, ...]) -> Iterator[Note]:
    """Note which combination two parameters fix; where pairs form a chain, its members and its strongest pairs."""
    pairs = _strong_pairs(correlation)
    for chain in _chains(pairs):
        inside = sorted((pair for pair in pairs if pair[0] in chain), key=lambda pair: -abs(correlation[pair]))
        if len(chain) == 2:
            yield _of_two(inside[0], matrix, correlation, names)
        else:
            members = tuple(names[i] for i in sorted(chain))
            strongest = [(names[i], names[j], float(correlation[i, j])) for i, j in inside[:3]]
            yield Note(FitCode.CORRELATED_CHAIN, values={"names": members, "pairs": strongest})


def _of_two(pair: tuple[int, int], matrix: FloatArray, correlation: FloatArray, names: tuple[str, ...]) -> Note:
    """Note ``first -+ ratio second``, the combination in which the two errors cancel, and its standard deviation."""
    i, j = pair
    rho = float(correlation[i, j])
    first, second = float(np.sqrt(matrix[i, i])), float(np.sqrt(matrix[j, j]))
    ratio = first / second
    if 0.8 < ratio < 1.25:
        ratio = 1.0
    left = np.sqrt(max(first**2 + (ratio * second) ** 2 - 2 * abs(rho) * ratio * first * second, 0.0))
    values = {
        "names": (names[i], names[j]),
        "correlation": rho,
        "ratio": ratio,
        "sigma": float(left),
        "singly": (first, second),
    }
    return Note(FitCode.CORRELATED_PAIR, values=values)


def _strong_pairs(correlation: FloatArray) -> list[tuple[int, int]]:
    rows, columns = np.nonzero(np.triu(np.abs(np.nan_to_num(correlation)) > _STRONG, k=1))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _chains(pairs: list[tuple[int, int]]) -> list[set[int]]:
    """Join pairs that share a member."""
    chains: list[set[int]] = []
    for pair in pairs:
        touched = [chain for chain in chains if chain & set(pair)]
        chains = [chain for chain in chains if chain not in touched]
        chains.append(set(pair).union(*touched))
    return chains


def _group_notes(
    correlation: FloatArray, multiple: FloatArray, names: tuple[str, ...], condition: float
) -> Iterator[Note]:
    """Note which parameters are a combination of several others although no pair alone shows it."""
    paired = {index for pair in _strong_pairs(correlation) for index in pair}
    members = [i for i, value in enumerate(multiple) if value > _STRONG and i not in paired]
    if members:
        values = {
            "names": tuple(names[i] for i in members),
            "correlations": multiple[members].tolist(),
            "condition_number": float(condition),
        }
        yield Note(FitCode.COMBINATION, values=values)
