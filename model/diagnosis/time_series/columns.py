"""Columns of the linear model of a campaign, before whitening and as whitened cross products (Gram matrices).

All that the evidence, the gain and the sets need is in the Gram matrices. Columns of each run's, in this order: the
residual (1), the soils' parameters in units of their prior's one-sigma and uncorrelated in it (q), the causes'
parameters in units of their prior scale (k), the catch-all basis (b). The linear model of a run, whitened, is
r = S beta + X gamma + noise, beta ~ N(0, I), gamma ~ N(0, I), or half of that where one-sided. Run-to-run scatter of
the soil is part of the noise. Shapes of the catch-all that only one run may show are kept with that run, so that memory
and time grow with the number of runs, not with its square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.core.campaign import OfVehicle
from model.diagnosis.core.shapes import Shape
from model.diagnosis.time_series.basis import CatchAll, Freed, RunShapes, basis, no_basis
from model.diagnosis.time_series.linearise import SENSORS, Linear, Simulation
from model.diagnosis.time_series.noise import constants, loading
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.standstills import READ


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
class Integrated:
    """What integrating out a run's own shapes does to cross products with the m other columns.

    With C the cross products of own and other columns and D those of the own with their prior added:

    Attributes
    ----------
    taken : array, shape (m, m)
        C' D^-1 C: comes off the run's Gram matrix.
    spread : array, shape (m, m)
        C' D^-2 C.
    freedom : float
        o - tr D^-1: how many of the o shapes the run determines.
    """

    taken: FloatArray
    spread: FloatArray
    freedom: float


@dataclass(frozen=True)
class OwnGram:
    """Cross products of the o shapes that only one run may show.

    Attributes
    ----------
    shapes : RunShapes
    across : array, shape (o, m)
        With the other columns.
    inner : array, shape (o, o)
        With each other.
    """

    shapes: RunShapes
    across: FloatArray
    inner: FloatArray

    @cached_property
    def integrated(self) -> Integrated:
        """What integrating them out does."""
        inverse = np.linalg.inv(np.eye(len(self.inner)) + self.inner)
        solved = inverse @ self.across
        freedom = len(inverse) - float(np.trace(inverse))
        return Integrated(self.across.T @ solved, solved.T @ solved, freedom)


@dataclass(frozen=True)
class Grams:
    """Gram matrices of all runs of all campaigns; of wheels of one vehicle a run is the drive of all of them.

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
    order : int array, shape (b,), optional
        Ranks of these shapes among all, those of single runs included; in their order by default.
    own : tuple of OwnGram
        Shapes of single runs.
    form : array, shape (b,), or float
        One-sigma of the coefficient of each of the b columns where they are the error of form.
    design : int array, shape (runs, 3), optional
        Of each run a number for the channels that it has, one for its direction, and one for first or later passes.
    static : array, shape (m, m), optional
        Cross products of what the lifted wheel read, which belongs to no run.
    constants : array, shape (runs, l, at least m), optional
        Means of what is one value a run by each column, of one campaign or one vehicle, whitened as it is.
    """

    matrices: FloatArray
    log_determinants: FloatArray
    samples: IndexArray
    run_names: tuple[str, ...]
    soil: tuple[str, ...]
    causes: tuple[CauseColumn, ...]
    basis: tuple[Shape, ...]
    order: IndexArray | None = None
    own: tuple[OwnGram, ...] = ()
    form: FloatArray | float = 0.0
    design: IndexArray | None = None
    static: FloatArray | float = 0.0
    constants: FloatArray | None = None

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

    @cached_property
    def total(self) -> FloatArray:
        """Sum over runs, and what the lifted wheel read, shape (m, m)."""
        return np.asarray(self.of_runs + self.static)

    @cached_property
    def of_runs(self) -> FloatArray:
        """Sum over runs, shape (m, m)."""
        return np.asarray(self.matrices.sum(axis=0))

    @cached_property
    def net(self) -> FloatArray:
        """Sum over runs with the error of form integrated out, shape (1 + q + k, same)."""
        return self.without_form(self.total)

    def without_form(self, total: FloatArray) -> FloatArray:
        """Integrate the error of form out of sums over runs: shape (..., m, m) to (..., 1 + q + k, same)."""
        kept, shapes = slice(0, self.cause_columns.stop), self.basis_columns
        inner, across = self._form_precision(total), self._form_sigma[:, None] * total[..., shapes, kept]
        return np.asarray(total[..., kept, kept] - np.swapaxes(across, -1, -2) @ np.linalg.solve(inner, across))

    @property
    def form_log_determinant(self) -> float:
        """Ln det of what the error of form adds to the covariance of all data."""
        return float(np.linalg.slogdet(self._form_precision(self.total))[1])

    def _form_precision(self, total: FloatArray) -> FloatArray:
        shapes = self.basis_columns
        scale = self._form_sigma
        return np.asarray(np.eye(len(self.basis)) + scale[:, None] * scale * total[..., shapes, shapes])

    @property
    def _form_sigma(self) -> FloatArray:
        return np.broadcast_to(self.form, len(self.basis))

    def chosen(self, runs: BoolArray) -> Grams:
        """Return the Grams of some runs only."""
        return replace(
            self,
            matrices=self.matrices[runs],
            log_determinants=self.log_determinants[runs],
            samples=self.samples[runs],
            run_names=tuple(compress(self.run_names, runs)),
            own=tuple(compress(self.own, runs)),
            design=None if self.design is None else self.design[runs],
        )

    def without(self, run: int) -> Grams:
        """Return the Grams of all runs but one, put together as one run."""
        return replace(
            self,
            matrices=(self.of_runs - self.matrices[run])[None],
            log_determinants=self.log_determinants.sum(keepdims=True) - self.log_determinants[run],
            samples=self.samples.sum(keepdims=True) - self.samples[run],
            run_names=(f"all but {self.run_names[run]}",),
            own=self.own[:run] + self.own[run + 1 :],
            design=None,
        )

    def scaled(self, factor: float) -> Grams:
        """Return the Grams with all cross products times a factor."""
        own = tuple(replace(gram, across=factor * gram.across, inner=factor * gram.inner) for gram in self.own)
        return replace(self, matrices=factor * self.matrices, own=own)

    def all_shapes(self) -> tuple[tuple[Shape, ...], FloatArray]:
        """Return every shape of the catch-all by rank, those of single runs too, and the total with them.

        The total has the shape (1 + q + k + all shapes, same).
        """
        start, shared = self.cause_columns.stop, len(self.basis)
        place = start + self.places
        shapes = (*self.basis, *(shape for gram in self.own for shape in gram.shapes.shapes))
        total = np.zeros((start + len(shapes),) * 2)
        kept = np.r_[np.arange(start), place[:shared]]
        total[np.ix_(kept, kept)] = self.total
        at = shared
        for gram in self.own:
            rows = place[at : at + len(gram.inner)]
            total[np.ix_(rows, kept)] = gram.across
            total[np.ix_(kept, rows)] = gram.across.T
            total[np.ix_(rows, rows)] = gram.inner
            at += len(gram.inner)
        return tuple(shapes[i] for i in np.argsort(self.places)), total

    @property
    def places(self) -> IndexArray:
        """Places of all shapes by rank: the shared ones, then those of single runs."""
        order = np.arange(len(self.basis)) if self.order is None else self.order
        ranks = np.concatenate([order, *(gram.shapes.order for gram in self.own)])
        return np.argsort(np.argsort(ranks))


@dataclass(frozen=True)
class Columns:
    """Columns of one campaign before whitening.

    In this order: residual (1), soil (q), causes (k), catch-all (b), its shapes of single runs (o), constants (l).

    Attributes
    ----------
    rows : array, shape (c, n, 1 + q + k + b + o + l)
        Zero where a channel is missing.
    present : bool array, shape (c, n)
    rests : array, shape (3, m, 1 + q + k + b + o + l)
        Of drawbar pull and torque at standstill.
    rests_present : bool array, shape (3, m)
    constants : tuple of str
        Hyper-parameter that scales each of the last columns.
    """

    rows: FloatArray
    present: BoolArray
    rests: FloatArray
    rests_present: BoolArray
    soil: tuple[str, ...]
    causes: tuple[CauseColumn, ...]
    catch_all: CatchAll
    constants: tuple[str, ...]

    @property
    def shared(self) -> int:
        """Number of columns before those of single runs."""
        return 1 + len(self.soil) + len(self.causes) + len(self.catch_all.shapes)

    @property
    def varying(self) -> int:
        """Number of columns before the constants."""
        return int(self.rows.shape[-1]) - len(self.constants)

    def heights(self, run: IndexArray) -> FloatArray:
        """Return the largest value of each shape where it was measured, by rank; of an input the largest error.

        `run`, shape (n,), is that of each sample. The result, shape (all shapes,), is in the channel's unit, m/s or N.
        """
        inputs, of_run = self.catch_all.input_heights, self.catch_all.of_run
        shared = _largest(self.rows[..., self.shared - len(inputs) : self.shared])
        own = self.rows[..., self.shared : self.varying]
        single = [_largest(own[:, run == i, : len(run_shapes.shapes)]) for i, run_shapes in enumerate(of_run)]
        ranks = np.concatenate([self.catch_all.order, *(run_shapes.order for run_shapes in of_run)])
        heights = np.concatenate([np.where(np.isnan(inputs), shared, inputs), *single])
        return np.asarray(heights[np.argsort(ranks)])


def _largest(columns: FloatArray) -> FloatArray:
    """Return the largest absolute value of each column, shape (c, n, b) to (b,)."""
    return np.asarray(np.maximum(columns.max(axis=(0, 1), initial=0.0), -columns.min(axis=(0, 1), initial=0.0)))


def soil_places(soils: Sequence[tuple[OfVehicle | None, tuple[str, ...]]]) -> tuple[IndexArray, ...]:
    """Return where the soil's columns of each campaign stand among those of all.

    Wheels of one vehicle have one soil; each has `SENSORS` of its own.
    """
    known: dict[tuple[object, str], int] = {}
    found = []
    for i, (vehicle, labels) in enumerate(soils):
        keys = [(vehicle.campaign if vehicle and label not in SENSORS else i, label) for label in labels]
        found.append(np.array([known.setdefault(key, len(known)) for key in keys], np.intp))
    return tuple(found)


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


def columns_of(
    simulation: Simulation,
    samples: Samples,
    linear: Linear,
    speed_variance: FloatArray,
    *,
    catch_all: bool = True,
    freed: Freed = frozenset(),
) -> Columns:
    """Put the columns together.

    The model is y = f + S (u - u0) + X (c - c0) + f' (e - e0) + ..., so that what is whitened is y - f + S u0 + X c0 +
    f' e0: coefficients are counted from the laboratory's soil and from neutral. Where the model bends in the ground
    speed, the mean over what is left of the speed's error, of variance P, is f + f'' P / 2. P, shape (n,), is
    `speed_variance`. `catch_all` is whether to take up the catch-all's shapes; `freed` says of which effects the
    formulas are set free, and over what.
    """
    causes = cause_columns(simulation, linear.point.causes)
    scale = np.array([c.scale for c in causes])
    at = np.array([(c.centre - c.neutral) / c.scale for c in causes])
    changes = _changes(causes, linear) if freed else {}
    by_run = constants(linear.channels)
    soils = slice(1, 1 + linear.soil.shape[-1])
    beside = (soils.stop + len(causes), len(by_run))
    shapes = basis(samples, linear, changes, freed, beside) if catch_all else no_basis(samples, linear, beside)
    measured = np.stack([_compensated(samples, linear) if c == "dp" else samples.measured[c] for c in linear.channels])
    residual = measured - linear.value - 0.5 * linear.curvature * speed_variance + linear.soil @ linear.point.soil
    residual += (linear.causes * scale) @ at + linear.speed * linear.point.speed_mps
    residual += linear.acceleration * linear.point.acceleration_mps2
    present = np.isfinite(residual) & linear.usable
    rows = shapes.rows
    rows[..., 0], rows[..., soils], rows[..., soils.stop : beside[0]] = residual, linear.soil, linear.causes * scale
    for i, (_, seen) in enumerate(by_run):
        rows[..., i - len(by_run)] = loading(linear, samples, seen)
    rows[~present] = 0.0
    rests, rests_present = _at_rest(samples, linear, scale, at, shapes.rests, rows.shape[-1])
    return Columns(
        rows=rows,
        present=present,
        rests=rests,
        rests_present=rests_present,
        soil=simulation.space.labels,
        causes=causes,
        catch_all=shapes.catch_all,
        constants=tuple(name for name, _ in by_run),
    )


def _changes(causes: tuple[CauseColumn, ...], linear: Linear) -> dict[str, FloatArray]:
    """Return what each effect at the point changes in every channel, to first order, shape (c, n)."""
    found: dict[str, FloatArray] = {}
    for i, cause in enumerate(causes):
        if (size := cause.centre - cause.neutral) != 0.0:
            found[cause.key] = found.get(cause.key, 0.0) + linear.causes[..., i] * size
    return found


def _compensated(samples: Samples, linear: Linear) -> FloatArray:
    """Return the drawbar pull, with the outboard mass accelerated as at the point and not as measured; shape (n,)."""
    mass = np.asarray(samples.conditions.compensated_mass_kg)
    measured, at_point = (np.asarray(at.ground_acceleration_mps2) for at in (samples.conditions, linear.conditions))
    return samples.measured["dp"] + np.where(mass > 0.0, mass * (at_point - measured), 0.0)


def _at_rest(
    samples: Samples, linear: Linear, scale: FloatArray, at: FloatArray, shapes: FloatArray, width: int
) -> tuple[FloatArray, BoolArray]:
    """Return the standstills' columns: only causes, zeros of every kind and what turns with the wheel show there.

    A torque about the wheel's own axis has no zero that turns; what it does once a turn, it does while it rolls.
    """
    rests = samples.rests
    count = len(rests)
    out = np.zeros((len(READ), count, width))
    present = np.zeros((len(READ), count), bool)
    own = linear.rest_causes * scale
    start = 1 + linear.soil.shape[-1]
    by_run, angle = constants(linear.channels), rests.wheel_angle_rad
    weight = np.asarray(rests.conditions.vertical_load_n) / np.median(samples.conditions.vertical_load_n)
    same = {"zero": np.ones(count), "rest": np.ones(count)}
    shown = {"dp": same | {"rest": weight, "cos": np.cos(angle), "sin": np.sin(angle)}, "t": same}
    for row, channel in enumerate(READ):
        if channel not in rests.measured or channel not in (*linear.channels, "slip"):
            continue
        residual = rests.measured[channel] - linear.rest_value[row] + own[row] @ at
        present[row] = np.isfinite(residual)
        out[row, :, 0] = residual
        out[row, :, start : start + own.shape[-1] + shapes.shape[-1]] = np.concatenate([own[row], shapes[row]], axis=-1)
        for i, (_, seen) in enumerate(by_run):
            if seen.channel == channel:
                out[row, :, i - len(by_run)] = shown[channel].get(seen.how, 0.0)
    out[:, rests.lifted, width - len(by_run) :] = 0.0  # no run's constants: it belongs to none
    return np.where(present[..., None], out, 0.0), present
