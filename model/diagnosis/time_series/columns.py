"""Everything that is whitened together: residual, soil, causes, catch-all, and what is one value a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import BoolArray, FloatArray
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.basis import basis, no_basis
from model.diagnosis.time_series.grams import CauseColumn
from model.diagnosis.time_series.linearise import Linear, Simulation
from model.diagnosis.time_series.noise import constants, loading
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.standstills import AT_REST


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
                form=effect.form,
                kind=effect.kind,
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
