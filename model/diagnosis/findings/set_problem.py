"""The nonlinear least-squares problem of one set of causes, whitened as the evidence is.

What does not belong to the set is held constant while Gauss-Newton runs, and updated after it: the slopes that whiten,
and what averaging over the instants of a sample adds to the model's value at its mean. So residual and derivatives
are consistent. What is one value a run is projected out of every run with its prior.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from model.diagnosis.time_series.columns import CauseColumn, Columns, Grams, columns_of
from model.diagnosis.time_series.evidence import box, prior_information
from model.diagnosis.time_series.joining import OfCampaign, groups_of, joined, shared_values, turn_of, vehicle_rows
from model.diagnosis.time_series.linearise import (
    SENSORS,
    Linear,
    Point,
    Simulation,
    at_point,
    at_rest,
    at_speed,
    derivatives,
    linearise,
    simulated,
)
from model.diagnosis.time_series.noise import variance
from model.diagnosis.time_series.start import CampaignData, soil_places_of
from model.diagnosis.time_series.whitening import whitened_rows

_NEAR_NEUTRAL = 0.01
"""Least coefficient of an effect whose derivative at neutral is infinite."""


@dataclass(frozen=True)
class Part:
    """One campaign of the problem.

    Attributes
    ----------
    simulation : Simulation
        With the set's effects only.
    frozen : Linear
        Whose slopes whiten.
    soil : int array, shape (q,)
        Places of this campaign's soil in x.
    causes : tuple of int
        Which of the set's causes each of this campaign's cause columns is.
    """

    data: CampaignData
    simulation: Simulation
    frozen: Linear
    soil: IndexArray
    causes: tuple[int, ...]

    @cached_property
    def noise_variance(self) -> FloatArray:
        """Variance of measured - predicted by the noise model, shape (c, n)."""
        data = self.data
        return variance(self.frozen, data.samples, data.noise.values, data.speed_variance)

    def at_measured_slip(self, point: Point, rows: BoolArray | None = None) -> FloatArray:
        """Return what the model says of the samples, or of some of them, at the measured slip, shape (c, n).

        Errors of sensors that all runs share are in it: a delay of the wheel speed, the zero of the sinkage.
        """
        rows, sensors = np.ones(len(self.data.samples), bool) if rows is None else rows, slice(-len(SENSORS), None)
        samples = self.data.samples[rows]
        measured = replace(point, speed_mps=np.zeros(len(samples)), acceleration_mps2=0.0)
        by_sensors = self.frozen.soil[:, rows, sensors] @ point.soil[sensors]
        return np.asarray(simulated(self.simulation, samples, measured) + by_sensors)

    def columns(self, linear: Linear, *, catch_all: bool = False) -> Columns:
        """Return the columns about a point."""
        data = self.data
        freed = data.columns.catch_all.freed
        return columns_of(self.simulation, data.samples, linear, data.speed_variance, catch_all=catch_all, freed=freed)

    def of_campaign(self, values: Mapping[str, float], columns: Columns) -> OfCampaign:
        """Return columns with what whitens them."""
        data = self.data
        return OfCampaign(data.campaign, data.samples, self.frozen, columns, values, data.speed_variance)

    def moved(self, point: Point) -> Linear:
        """Return the model at another point, with the slopes that whiten as they are."""
        frozen = self.frozen
        samples = at_point(self.data.samples, frozen.point)  # nearby a delay acts by its series, as derivatives have it
        soil = self.simulation.space.values(point.soil)
        values: Mapping[str, float] = {**soil, **point.causes}
        found = derivatives(self.simulation, at_speed(samples, point), values, frozen.channels)
        by_sensors = frozen.soil[..., -len(SENSORS) :]
        by_soil = self.simulation.space.columns(found["soil"], by_sensors, point.soil)
        rest_value, rest_causes = at_rest(self.simulation, samples, values)
        value = found["value"] + frozen.value - frozen.centre
        value = value + by_sensors @ (point.soil - frozen.point.soil)[-len(SENSORS) :]
        return replace(
            frozen,
            point=point,
            value=value,
            soil=by_soil,
            causes=found["causes"],
            rest_value=rest_value,
            rest_causes=rest_causes,
            usable=np.isfinite(np.concatenate([value[..., None], by_soil, found["causes"]], axis=2)).all(axis=(0, 2)),
        )


@dataclass(frozen=True)
class SetProblem:
    """Whitened residuals of a set of causes; x holds the soils' coordinates and then the causes' coefficients.

    Attributes
    ----------
    soil : tuple of str
        Labels of the soils' q coordinates.
    causes : tuple of CauseColumn
        The set's, c of them.
    prior : array, shape (q + c,)
        Its information on x.
    """

    parts: tuple[Part, ...]
    soil: tuple[str, ...]
    causes: tuple[CauseColumn, ...]
    prior: FloatArray

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Least and largest x; soils have none."""
        free = np.full(len(self.soil), np.inf)
        lower, upper = box(self.causes)
        return np.r_[-free, lower], np.r_[free, upper]

    def points(self, x: FloatArray) -> tuple[Point, ...]:
        """Return where x puts each campaign's model."""
        return tuple(self._point(part, x) for part in self.parts)

    def residual_and_jacobian(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened residuals, run after run and priors last, and their derivatives; NaN without an answer."""
        prior = np.sqrt(self.prior)[:, None] * np.concatenate([x[:, None], np.eye(len(x))], axis=1)
        stacked = np.concatenate([*self.runs(x), prior])
        return stacked[:, 0], stacked[:, 1:]

    def runs(self, x: FloatArray) -> list[FloatArray]:
        """Return whitened residual (first column) and derivatives of each run; NaN without an answer."""
        linears = [part.moved(self._point(part, x)) for part in self.parts]
        columns = [part.columns(linear) for part, linear in zip(self.parts, linears, strict=True)]
        lost = [np.any(part.frozen.usable & ~new.usable) for part, new in zip(self.parts, linears, strict=True)]
        values = [part.data.noise.values for part in self.parts]
        found: list[FloatArray] = []
        for group in self.groups:
            rows = self._whitened(group, columns, x, values)
            found += [np.full_like(run, np.nan) for run in rows] if any(lost[i] for i in group) else rows
        return found

    @cached_property
    def groups(self) -> list[list[int]]:
        """Places of the parts that are whitened together."""
        return groups_of([part.data.campaign for part in self.parts])

    def refrozen(self, x: FloatArray) -> SetProblem:
        """Return the problem with the whitening of another point."""
        parts = [
            replace(part, frozen=linearise(part.simulation, part.data.samples, self._point(part, x)))
            for part in self.parts
        ]
        return replace(self, parts=tuple(parts))

    def grams(self) -> Grams:
        """Return the Gram matrices about the point whose slopes whiten."""
        return joined(
            [part.of_campaign(part.data.noise.values, part.columns(part.frozen, catch_all=True)) for part in self.parts]
        )

    def _point(self, part: Part, x: FloatArray) -> Point:
        moved = {}
        for (effect, _, key), i in zip(part.simulation.parameters, part.causes, strict=True):
            cause, size = self.causes[i], float(x[len(self.soil) + i])
            if effect.secant:
                size = max(size, _NEAR_NEUTRAL)
            if size != 0.0:
                moved[key] = cause.neutral + size * cause.scale
        return replace(part.data.linear.point, soil=x[part.soil], causes=moved)

    def _whitened(
        self, group: Sequence[int], columns: Sequence[Columns], x: FloatArray, values: Sequence[Mapping[str, float]]
    ) -> list[FloatArray]:
        """Return residual and derivatives of each run of a campaign, or of each drive of a vehicle, as x has them."""
        found: list[FloatArray] = []
        of = [self.parts[i].of_campaign(values[i], columns[i]) for i in group]
        width = 1 + self.size
        turns = [turn_of(columns[i].causes, self.parts[i].soil, self.causes, len(self.soil), width) for i in group]
        first = of[0]
        alone = len(group) == 1
        rows = whitened_rows(*first.whitening) if alone else vehicle_rows(of, turns)
        for whitened, _ in rows:
            own = _without_constants(whitened, first.columns.shared if alone else 1 + len(x))
            out = -(own @ turns[0] if alone else own)
            out[..., 0] = out[..., 1:] @ x - out[..., 0]
            found += list(out)
        return found

    @property
    def size(self) -> int:
        """Length of x."""
        return len(self.soil) + len(self.causes)

    def score_changes(self, x: FloatArray) -> FloatArray:
        """Return by how much J'r changes when each hyper-parameter grows by its own one-sigma, shape (h, p)."""
        found = []
        columns = [part.columns(part.moved(self._point(part, x))) for part in self.parts]
        values = [part.data.noise.values for part in self.parts]
        for group in self.groups:
            plain = _score(self._whitened(group, columns, x, values))
            for moving, name, sigma in self._hyper_parameters(group):
                moved = [*values]
                for i in moving:
                    moved[i] = {**values[i], name: values[i][name] * float(np.exp(sigma))}
                found.append(_score(self._whitened(group, columns, x, moved)) - plain)
        return np.array(found).reshape(len(found), len(x))

    def _hyper_parameters(self, group: Sequence[int]) -> Iterator[tuple[Sequence[int], str, float]]:
        """Yield the parts that a hyper-parameter is of, its name and its own one-sigma; what wheels share is one."""
        noises = {i: self.parts[i].data.noise.log_sigmas for i in group}
        shared = shared_values(self.parts[group[0]].frozen.channels) if len(group) > 1 else ()
        for name in shared:
            yield group, name, float(np.mean([sigmas[name] for sigmas in noises.values()]))
        for i, sigmas in noises.items():
            yield from (([i], name, sigma) for name, sigma in sigmas.items() if name not in shared)


def _score(rows: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(sum((run[:, 1:].T @ run[:, 0] for run in rows), np.zeros(rows[0].shape[1] - 1)))


def _without_constants(rows: FloatArray, keep: int) -> FloatArray:
    """Project out the columns behind `keep`, N(0, 1) each in every run; rows of shape (runs, n, m)."""
    shared, constants = rows[..., :keep], rows[..., keep:]
    power, axes = np.linalg.eigh(constants.swapaxes(-1, -2) @ constants)
    across, root = constants @ axes, np.sqrt(1.0 + np.maximum(power, 0.0))
    share = 1.0 / (root * (1.0 + root))
    return np.asarray(shared - across @ (share[..., None] * (across.swapaxes(-1, -2) @ shared)))


def set_problem(campaigns: Sequence[CampaignData], grams: Grams, keys: tuple[str, ...]) -> SetProblem:
    """Return the problem of a set of causes, whitened as at the last linearisation.

    `grams` are of the same linearisation; the keys are of the set's effects.
    """
    causes = tuple(c for key in keys for c in grams.causes if c.key == key)
    names = [(c.key, c.parameter) for c in causes]
    parts = []
    for data, soil in zip(campaigns, soil_places_of(campaigns), strict=True):
        effects = {e.key(): e for e in data.simulation.effects}
        simulation = replace(data.simulation, effects=tuple(effects[key] for key in keys if key in effects))
        positions = tuple(names.index((e.key(), e.parameters[i].name)) for e, i, _ in simulation.parameters)
        parts.append(Part(data, simulation, data.linear, soil, positions))
    return SetProblem(tuple(parts), grams.soil, causes, prior_information(grams, keys))
