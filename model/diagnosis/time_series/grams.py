"""Whitened cross products of one linearisation: all that the evidence, the gain and the sets are made of.

Columns of each run's Gram matrix, in this order: the residual (1), the soils' parameters in units of their prior's
one-sigma and uncorrelated in it (q), the causes' parameters in units of their prior scale (k), the catch-all basis (b).
The linear model of a run, whitened, is r = S beta + X gamma + noise, beta ~ N(0, I), gamma ~ N(0, I), or half of
that where one-sided. Run-to-run scatter of the soil is part of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.core.shapes import Shape


@dataclass(frozen=True)
class CauseColumn:
    """One parameter of one effect.

    Attributes
    ----------
    key : str
        Of the effect in the library.
    family, form, kind : of the effect
    scale : float
        Prior one-sigma; a coefficient of 1 is this size. Negative where only values below neutral are plausible
        (`Parameter.towards`), so that the coefficient of a one-sided parameter is never negative.
    centre : float
        Value of the parameter at which the columns were linearised; the coefficient is (value - neutral)/scale.
    lower, upper : float
        Bounds of the parameter.
    """

    key: str
    family: str
    form: str
    kind: str
    parameter: str
    unit: str
    scale: float
    centre: float
    neutral: float
    lower: float
    upper: float
    one_sided: bool


@dataclass(frozen=True)
class Grams:
    """Gram matrices of all runs of all campaigns.

    Attributes
    ----------
    matrices : array, shape (runs, m, m), m = 1 + q + k + b
    log_determinants : array, shape (runs,)
        ln det of each run's noise covariance (for comparing noise models; the same for every set of causes).
    samples : int array, shape (runs,)
        Whitened numbers in each run.
    soil : tuple of str
        Labels of the q soil columns.
    basis : tuple of Shape
        What the b catch-all columns are.
    """

    matrices: FloatArray
    log_determinants: FloatArray
    samples: IndexArray
    run_names: tuple[str, ...]
    soil: tuple[str, ...]
    causes: tuple[CauseColumn, ...]
    basis: tuple[Shape, ...]

    @property
    def soil_columns(self) -> slice:
        """Position of the soil's columns."""
        return slice(1, 1 + len(self.soil))

    @property
    def cause_columns(self) -> slice:
        """Position of the causes' columns."""
        start = 1 + len(self.soil)
        return slice(start, start + len(self.causes))

    @property
    def basis_columns(self) -> slice:
        """Position of the catch-all columns."""
        start = 1 + len(self.soil) + len(self.causes)
        return slice(start, start + len(self.basis))

    def columns_of(self, key: str) -> tuple[int, ...]:
        """Return the positions in a matrix of an effect's parameters."""
        start = self.cause_columns.start
        return tuple(start + i for i, column in enumerate(self.causes) if column.key == key)

    def total(self, weights: FloatArray | None = None) -> FloatArray:
        """Return the sum over runs, shape (m, m), each run counted `weights` times."""
        return np.asarray(self.matrices.sum(axis=0) if weights is None else np.tensordot(weights, self.matrices, 1))

    def chosen(self, runs: BoolArray) -> Grams:
        """Return the Grams of some runs only."""
        return replace(
            self,
            matrices=self.matrices[runs],
            log_determinants=self.log_determinants[runs],
            samples=self.samples[runs],
            run_names=tuple(name for name, keep in zip(self.run_names, runs, strict=True) if keep),
        )
