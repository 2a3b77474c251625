"""Columns of the linear model of a campaign, before whitening and as whitened cross products (Gram matrices).

All that the evidence, the gain and the sets need is in the Gram matrices. Columns of each run's, in this order: the
residual (1), the soils' parameters in units of their prior's one-sigma and uncorrelated in it (q), the causes'
parameters in units of their prior scale (k), the catch-all basis (b). The linear model of a run, whitened, is
r = S beta + X gamma + noise, beta ~ N(0, I), gamma ~ N(0, I), or half of that where one-sided. Run-to-run scatter of
the soil is part of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.basis import basis, no_basis
from model.diagnosis.time_series.linearise import Linear, Simulation
from model.diagnosis.time_series.noise import constants, loading
from model.diagnosis.time_series.samples import AT_REST, Samples


@dataclass(frozen=True)
class CauseColumn:
    """One parameter of one effect.

    Attributes
    ----------
    key : str
        Of the effect in the library.
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

    def total(self) -> FloatArray:
        """Return the sum over runs, shape (m, m)."""
        return np.asarray(self.matrices.sum(axis=0))

    def chosen(self, runs: BoolArray) -> Grams:
        """Return the Grams of some runs only."""
        return replace(
            self,
            matrices=self.matrices[runs],
            log_determinants=self.log_determinants[runs],
            samples=self.samples[runs],
            run_names=tuple(name for name, keep in zip(self.run_names, runs, strict=True) if keep),
        )


@dataclass(frozen=True)
class Columns:
    """Columns of one campaign before whitening: residual (1), soil (q), causes (k), catch-all (b), constants (l).

    Attributes
    ----------
    rows : array, shape (c, n, 1 + q + k + b + l)
        Zero where a channel is missing.
    present : bool array, shape (c, n)
    rests : array, shape (2, m, 1 + q + k + b + l)
        Of drawbar pull and torque at standstill.
    rests_present : bool array, shape (2, m)
    input_heights : array, shape (b,)
        Of the catch-all's shapes, see `model.diagnosis.time_series.basis`: NaN but for errors of an input.
    constants : tuple of str
        Hyper-parameter that scales each of the last columns.
    """

    rows: FloatArray
    present: BoolArray
    rests: FloatArray
    rests_present: BoolArray
    soil: tuple[str, ...]
    causes: tuple[CauseColumn, ...]
    basis: tuple[Shape, ...]
    input_heights: FloatArray
    constants: tuple[str, ...]

    @property
    def shared(self) -> int:
        """Number of columns before the constants."""
        return 1 + len(self.soil) + len(self.causes) + len(self.basis)

    @property
    def heights(self) -> FloatArray:
        """Largest value of each shape where it was measured, in the channel's unit; of an input the largest error."""
        block = self.rows[..., self.shared - len(self.basis) : self.shared]
        largest = np.maximum(block.max(axis=(0, 1), initial=0.0), -block.min(axis=(0, 1), initial=0.0))
        return np.where(np.isnan(self.input_heights), largest, self.input_heights)


def cause_columns(simulation: Simulation, causes: dict[str, float]) -> tuple[CauseColumn, ...]:
    """Return what each cause's column is, linearised at the given values."""
    found = []
    for effect, i, key in simulation.parameters:
        p = effect.parameters[i]
        found.append(
            CauseColumn(
                key=effect.key(),
                family=effect.name,
                parameter=p.name,
                unit=p.unit,
                scale=p.towards(simulation.wheel),
                centre=causes.get(key, p.neutral),
                neutral=p.neutral,
                lower=p.lower,
                upper=p.upper,
                one_sided=p.one_sided,
            )
        )
    return tuple(found)


def columns_of(simulation: Simulation, samples: Samples, linear: Linear, *, catch_all: bool = True) -> Columns:
    """Put the columns together.

    The model is y = f + S (u - u0) + X (c - c0) + f' (e - e0) + ..., so that what is whitened is
    y - f + S u0 + X c0 + f' e0: coefficients are counted from the laboratory's soil and from neutral.

    Parameters
    ----------
    catch_all : bool
        Whether to take up the catch-all's shapes.
    """
    causes = cause_columns(simulation, linear.point.causes)
    scale = np.array([c.scale for c in causes])
    at = np.array([(c.centre - c.neutral) / c.scale for c in causes])
    shapes = basis(samples, linear) if catch_all else no_basis(samples, linear)
    measured = np.stack([samples.measured[c] for c in linear.channels])
    own = linear.causes * scale
    residual = measured - linear.value + linear.soil @ linear.point.soil
    residual += own @ at + linear.speed * linear.point.speed_mps
    present = np.isfinite(residual) & linear.usable
    by_run = constants(linear.channels)
    turning = [loading(linear, samples, name) for _, name in by_run]
    rows = np.concatenate([residual[..., None], linear.soil, own, shapes.columns, np.stack(turning, axis=-1)], axis=-1)
    rests, rests_present = _at_rest(samples, linear, scale, at, shapes.rests, rows.shape[-1])
    return Columns(
        rows=np.where(present[..., None], rows, 0.0),
        present=present,
        rests=rests,
        rests_present=rests_present,
        soil=simulation.space.labels,
        causes=causes,
        basis=shapes.shapes,
        input_heights=shapes.input_heights,
        constants=tuple(name for name, _ in by_run),
    )


def _at_rest(
    samples: Samples, linear: Linear, scale: FloatArray, at: FloatArray, shapes: FloatArray, width: int
) -> tuple[FloatArray, BoolArray]:
    """Return the standstills' columns: only causes, zeros of every kind and what turns with the wheel show there.

    A torque about the wheel's own axis has no zero that turns; what it does once a turn, it does while it rolls.
    """
    rests = samples.rests
    count = len(rests)
    out = np.zeros((2, count, width))
    present = np.zeros((2, count), bool)
    own = linear.rest_causes * scale
    start = 1 + linear.soil.shape[-1]
    by_run = constants(linear.channels)
    for row, channel in enumerate(AT_REST):
        if channel not in rests.measured or channel not in linear.channels:
            continue
        residual = rests.measured[channel] - linear.rest_value[row] + own[row] @ at
        present[row] = np.isfinite(residual)
        out[row, :, 0] = residual
        out[row, :, start : start + own.shape[-1] + shapes.shape[-1]] = np.concatenate([own[row], shapes[row]], axis=-1)
        for i, (_, name) in enumerate(by_run):
            if channel == "dp" and name in ("cos dp", "sin dp"):
                turn = np.cos if name.startswith("cos") else np.sin
                out[row, :, width - len(by_run) + i] = turn(rests.wheel_angle_rad)
            elif name == f"zero {channel}":
                out[row, :, width - len(by_run) + i] = 1.0
    return np.where(present[..., None], out, 0.0), present
