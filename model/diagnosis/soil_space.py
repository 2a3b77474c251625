"""The soil's parameters in units in which the laboratory knows them: independent, of one-sigma 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.soil_prior import SoilPrior
from model.soils import SOIL_PARAMETERS

FloatArray = NDArray[np.float64]

_LOGARITHMIC_UP_TO = 0.5
"""Relative one-sigma up to which a positive parameter is moved by factors instead of by steps: it stays positive."""
_NOTHING = 1e-12


@dataclass(frozen=True)
class SoilSpace:
    """x = mean + R u, or mean exp(R u) where logarithmic; u ~ N(0, I).

    Attributes
    ----------
    mean : array, shape (6,)
    logarithmic : bool array, shape (6,)
    root : array, shape (6, q)
    labels : tuple of str
        Of the q coordinates: the parameter that each is the first to move.
    """

    mean: FloatArray
    logarithmic: NDArray[np.bool_]
    root: FloatArray
    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)

    def values(self, u: FloatArray) -> dict[str, float]:
        """Return the soil's parameters at a point, SI units."""
        step = self.root @ u
        found = np.where(self.logarithmic, self.mean * np.exp(np.where(self.logarithmic, step, 0.0)), self.mean + step)
        return {name: float(x) for name, x in zip(SOIL_PARAMETERS, found, strict=True)}

    def jacobian(self, u: FloatArray) -> FloatArray:
        """Return dx/du, shape (6, q)."""
        at = np.array(list(self.values(u).values()))
        return np.where(self.logarithmic, at, 1.0)[:, None] * self.root


def soil_space(prior: SoilPrior) -> SoilSpace:
    """Return the coordinates that belong to a prior; an exactly known parameter has none."""
    sigma = np.sqrt(np.diag(prior.covariance))
    relative = sigma / np.where(prior.mean > 0, prior.mean, np.nan)
    logarithmic = np.nan_to_num(relative, nan=np.inf) <= _LOGARITHMIC_UP_TO
    unit = np.where(logarithmic, np.where(prior.mean > 0, prior.mean, 1.0), 1.0)
    scaled = sigma / unit
    known = np.flatnonzero(scaled > _NOTHING)
    correlation = prior.covariance[np.ix_(known, known)] / np.outer(sigma[known], sigma[known])
    root, kept = _triangle(correlation)
    full = np.zeros((len(sigma), len(kept)))
    full[known] = scaled[known, None] * root
    return SoilSpace(prior.mean, logarithmic, full, tuple(SOIL_PARAMETERS[known[i]] for i in kept))


def _triangle(correlation: FloatArray) -> tuple[FloatArray, list[int]]:
    """Return a lower triangle R with R R' the correlation, without the columns that would be zero."""
    left = correlation.copy()
    columns, kept = [], []
    for i in range(len(left)):
        if left[i, i] <= 1e-9:
            continue
        column = left[:, i] / np.sqrt(left[i, i])
        left = left - np.outer(column, column)
        columns.append(column)
        kept.append(i)
    return (np.stack(columns, axis=1) if columns else np.zeros((len(left), 0))), kept
