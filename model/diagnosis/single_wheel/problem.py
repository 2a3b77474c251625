"""Many hypotheses about the same rows, evaluated at once: what the model says, and its slopes.

A hypothesis is a set of causes, each on all tables or on one of them only. Its coordinates have a standard normal
prior (`model.diagnosis.single_wheel.coordinates`): first those of every soil, then those of its causes.
Hypotheses with fewer coordinates than others are padded with ones that nothing depends on: they change no evidence.
The rows of many hypotheses are columns of one model: parameters with their slopes, row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray, IndexArray
from model.diagnosis.core.campaign import Bench
from model.diagnosis.single_wheel.coordinates import CauseCoordinate, SoilCoordinates
from model.diagnosis.single_wheel.noise import ChannelNoise, FormError, groups_of_rows
from model.effects.base import Effect
from model.effects.catalogue import EFFECTS
from model.wheel_soil.conditions import Conditions
from model.wheel_soil.dual import Dual, Number, value_of
from model.wheel_soil.wheel_soil_model import Reading, WheelSoilModel

_LUG_SPREAD = 0.5
"""One-sigma of the height at which soil shears, over the height that is expected of declared lugs."""


@dataclass(frozen=True)
class CauseUse:
    """A cause in a hypothesis.

    Attributes
    ----------
    key : str
        Of the effect in the library.
    table : int or None
        Position of the only table that it acts on, with a value of its own; None: on all, with one value.
    usual : bool
        Expected at what soils usually have, instead of at neutral.
    """

    key: str
    table: int | None = None
    usual: bool = False


Hypothesis = tuple[CauseUse, ...]

_SPLIT_ROWS = 400
"""Rows of all hypotheses from which on those that cost more are evaluated apart from the others."""


@dataclass(frozen=True)
class Columns:
    """Rows of all hypotheses, one hypothesis after the other, as columns of the model."""

    problem: BenchProblem
    hypotheses: tuple[Hypothesis, ...]
    standard: FloatArray
    slopes: bool

    @property
    def count(self) -> int:
        """Rows of all hypotheses."""
        return len(self.hypotheses) * len(self.problem.slip)

    def of_rows(self, values: FloatArray) -> FloatArray:
        """Return a quantity of every row, (n,), as a column for all hypotheses."""
        return np.tile(values, len(self.hypotheses))[:, None]

    def parameters(self, model: WheelSoilModel) -> dict[str, Number]:
        """Return every parameter of the model, as a column where rows differ in it."""
        wheels = [table.wheel for table in self.problem.tables]
        sizes = {name: np.array([getattr(w, name) for w in wheels]) for name in ("radius_m", "width_m")}
        alike = all(np.ptp(size) == 0 for size in sizes.values())
        columns: dict[str, Number] = {
            name: float(size[0]) if alike else self.of_rows(size[self.problem.table]) for name, size in sizes.items()
        }
        return columns | self._soils() | self._causes(model)

    def _soils(self) -> dict[str, Number]:
        problem, n = self.problem, len(self.problem.slip)
        parts: dict[str, list[FloatArray]] = {}
        partials: dict[str, list[FloatArray]] = {}
        for i, soil in enumerate(problem.soils):
            start, stop = problem.soil_offsets[i : i + 2]
            values, by = soil.values(self.standard[:, start:stop])
            width = problem.tables[problem.soil_of.index(i)].wheel.width_m
            natural = soil.soil_parameters(values, width)
            through = {
                "cohesion_pa": by[:, 0],
                "tan_phi": by[:, 1],
                "shear_modulus_m": by[:, 2] * natural["shear_modulus_m"][:, None],
                "sinkage_exponent": by[:, 3],
                "cohesive_modulus": by[:, 4] * natural["cohesive_modulus"][:, None],
                "frictional_modulus": by[:, 4] * natural["frictional_modulus"][:, None],
            }
            for name, value in natural.items():
                parts.setdefault(name, []).append(value)
                padded = np.zeros((len(value), 5))
                padded[:, : stop - start] = through[name]
                partials.setdefault(name, []).append(padded)
        of_row = np.array(problem.soil_of)[problem.table]
        columns: dict[str, Number] = {}
        for name, values_of_soils in parts.items():
            value = np.stack(values_of_soils, axis=1)[:, of_row].reshape(-1, 1)
            if not self.slopes:
                columns[name] = value
                continue
            slope = np.stack(partials[name], axis=1)[:, of_row].reshape(len(self.hypotheses) * n, 5)
            used = {f"u{j}": slope[:, j : j + 1] for j in range(5) if slope[:, j].any()}
            columns[name] = Dual(value, used) if used else value
        return columns

    def _causes(self, model: WheelSoilModel) -> dict[str, Number]:
        problem = self.problem
        shape = (len(self.hypotheses), len(problem.slip))
        values = {
            key: np.full(shape, p.neutral)
            for effect in model.effects
            for key, p in zip(effect.parameter_keys().values(), effect.parameters, strict=True)
        }
        partials: dict[str, dict[str, FloatArray]] = {key: {} for key in values}
        for (name, key, table, slot), (coordinate, members) in self._slots().items():
            rows = problem.acts_on(CauseUse(key, table))
            value, slope = coordinate.values(self.standard[members, problem.soil_offsets[-1] + slot])
            block = np.ix_(np.array(members), rows)
            values[name][block] = value[:, None]
            partials[name].setdefault(f"c{slot}", np.zeros(shape))[block] = slope[:, None]
        if not self.slopes:
            return {key: value.reshape(-1, 1) for key, value in values.items()}
        return {
            key: Dual(value.reshape(-1, 1), {name: s.reshape(-1, 1) for name, s in partials[key].items()})
            for key, value in values.items()
        }

    def _slots(self) -> dict[tuple[str, str, int | None, int], tuple[CauseCoordinate, list[int]]]:
        """Return which hypotheses have which parameter of the model in which of their own coordinates."""
        found: dict[tuple[str, str, int | None, int], tuple[CauseCoordinate, list[int]]] = {}
        alike: dict[Hypothesis, list[int]] = {}
        for member, hypothesis in enumerate(self.hypotheses):
            alike.setdefault(hypothesis, []).append(member)
        for hypothesis, members in alike.items():
            slot = 0
            for use in hypothesis:
                names = EFFECTS[use.key].parameter_keys().values()
                for name, coordinate in zip(names, self.problem.coordinates(use), strict=True):
                    found.setdefault((name, use.key, use.table, slot), (coordinate, []))[1].extend(members)
                    slot += 1
        # a table's own value replaces the value for all
        return dict(sorted(found.items(), key=lambda item: item[0][2] is not None))

    def of_each(self, output: Number) -> FloatArray:
        """Return a column of the model as one row for each hypothesis, shape (B, n)."""
        shape = (len(self.hypotheses), len(self.problem.slip))
        return np.array(np.broadcast_to(value_of(output), (self.count, 1))).reshape(shape)

    def scattered(self, output: Number) -> FloatArray:
        """Return the derivatives by the hypotheses' coordinates, shape (B, n, p)."""
        problem, shape = self.problem, (len(self.hypotheses), len(self.problem.slip))
        out = np.zeros((*shape, self.standard.shape[1]))
        partials: dict[str, Any] = output.partials if isinstance(output, Dual) else {}
        of_row = np.array(problem.soil_of)[problem.table]
        for name, partial in partials.items():
            slope = np.broadcast_to(partial, (self.count, 1)).reshape(shape)
            number = int(name[1:])
            if name[0] == "c":
                out[:, :, problem.soil_offsets[-1] + number] = slope
                continue
            for i, start in enumerate(problem.soil_offsets[:-1]):
                if start + number < problem.soil_offsets[i + 1]:
                    rows = of_row == i
                    out[:, rows, start + number] = slope[:, rows]
        return out


@dataclass(frozen=True)
class BenchProblem:
    """The rows of some tables, and the prior of the unknowns.

    Attributes
    ----------
    soil_of : tuple of int
        Which of the soils each table is on.
    slip, load_n : arrays, shape (n,)
        Of all rows, one table after the other.
    table : int array, shape (n,)
        Which table a row is of.
    group : int array, shape (n,)
        Rows of one group are repeats.
    noises : tuple of ChannelNoise
        One for each channel that is used.
    rows : tuple of int arrays
        Rows of each channel.
    """

    tables: tuple[Bench, ...]
    soils: tuple[SoilCoordinates, ...]
    soil_of: tuple[int, ...]
    slip: FloatArray
    load_n: FloatArray
    table: IndexArray
    group: IndexArray
    noises: tuple[ChannelNoise, ...]
    rows: tuple[IndexArray, ...]
    reading: Reading

    @staticmethod
    def of(
        tables: Sequence[Bench],
        channels: Sequence[str] = tuple(OUTPUTS),
        reading: Reading = "balanced",
        form_error: FormError | None = None,
    ) -> BenchProblem:
        """Return the problem; tables with the same laboratory soil stand on one soil.

        Parameters
        ----------
        channels : of "dp", "t", "z"
            To use where they were measured.

        Raises
        ------
        ConfigError
            See `SoilCoordinates.of`.
        """
        soils: list[Bench] = []
        soil_of = []
        for table in tables:
            same = [i for i, other in enumerate(soils) if _same_soil(table, other)]
            soil_of.append(same[0] if same else len(soils))
            if not same:
                soils.append(table)
        slip, load = (np.concatenate([getattr(b.rows, name) for b in tables]) for name in ("slip", "vertical_load_n"))
        index = np.repeat(np.arange(len(tables)), [len(b.rows) for b in tables])
        groups: list[IndexArray] = []
        for b in tables:
            first = groups[-1].max() + 1 if groups else 0
            groups.append(first + groups_of_rows(b.rows.run, b.rows.slip, b.rows.vertical_load_n))
        problem = BenchProblem(
            tuple(tables),
            tuple(SoilCoordinates.of(b) for b in soils),
            tuple(soil_of),
            slip,
            load,
            index,
            np.concatenate(groups),
            (),
            (),
            reading,
        )
        return problem._with_noise(channels, form_error or FormError())

    def with_form_error(self, form_error: FormError) -> BenchProblem:
        """Return the problem with another error of form in the channels where it is given or assumed."""
        return self._with_noise(self.channels, form_error)

    @property
    def form_is_taken(self) -> bool:
        """Whether an error of form was given or assumed, in any channel."""
        return any(noise.form_share is not None for noise in self.noises)

    def _with_noise(self, channels: Sequence[str], form_error: FormError) -> BenchProblem:
        noises, rows = [], []
        slopes = self._input_slopes() if any(_uncertain(b) for b in self.tables) else None
        for channel in channels:
            measured = self.measured(channel)
            chosen = np.flatnonzero(np.isfinite(measured))
            if not len(chosen):
                continue
            carried = np.zeros(len(chosen)) if slopes is None else slopes[channel][chosen]
            known = [b.sigmas.get(channel) for b in self.tables]
            sigma = None if any(s is None for s in known) else float(np.mean([s for s in known if s is not None]))
            group = np.unique(self.group[chosen], return_inverse=True)[1]
            form, share = ChannelNoise.usual_form(measured[chosen], group, sigma, self.size_of(channel), form_error)
            noises.append(ChannelNoise.of(channel, measured[chosen], group, carried, form, sigma, share))
            rows.append(chosen)
        return replace(self, noises=tuple(noises), rows=tuple(rows))

    def measured(self, channel: str) -> FloatArray:
        """Return the measured values of a channel in all rows, NaN where not measured."""
        return np.concatenate([getattr(b.rows, OUTPUTS[channel].field) for b in self.tables])

    def size_of(self, channel: str) -> float:
        """Return what a channel is measured against: W, W r or r."""
        radius = float(np.mean([b.wheel.radius_m for b in self.tables]))
        return {"dp": self.typical_load_n, "t": self.typical_load_n * radius, "z": radius}[channel]

    @cached_property
    def typical_load_n(self) -> float:
        """Median load of all rows."""
        return float(np.median(self.load_n))

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that are used."""
        return tuple(noise.channel for noise in self.noises)

    @cached_property
    def soil_offsets(self) -> tuple[int, ...]:
        """First coordinate of each soil, and the number of them all."""
        return tuple(np.cumsum([0, *(len(soil.names) for soil in self.soils)]).tolist())

    def coordinates(self, use: CauseUse) -> tuple[CauseCoordinate, ...]:
        """Return the coordinates of a cause."""
        if use not in self._coordinates:
            wheel, load_n = self.tables[use.table or 0].wheel, self.typical_load_n
            parameters, declared = EFFECTS[use.key].parameters, self._declared(use)
            self._coordinates[use] = tuple(
                CauseCoordinate.of(p, wheel, load_n, p.usual if use.usual else declared) for p in parameters
            )
        return self._coordinates[use]

    def _declared(self, use: CauseUse) -> tuple[float, float] | None:
        """Return centre and one-sigma of a cause's prior where the wheel's lugs are declared; else nothing."""
        if not EFFECTS[use.key].needs.lugs:
            return None
        tables = self.tables if use.table is None else (self.tables[use.table],)
        heights = [b.lugs.sheared_m(b.wheel.radius_m) for b in tables if b.lugs is not None]
        return (float(np.mean(heights)), _LUG_SPREAD * float(np.mean(heights))) if heights else None

    def acts_on(self, use: CauseUse) -> BoolArray:
        """Return on which rows a cause acts, shape (n,): on its own table or all, a lugged wheel's on no smooth one."""
        rows = np.ones(len(self.slip), bool) if use.table is None else self.table == use.table
        if EFFECTS[use.key].needs.lugs:
            rows = rows & np.array([b.tyre != "smooth" for b in self.tables])[self.table]
        return np.asarray(rows)

    @cached_property
    def _coordinates(self) -> dict[CauseUse, tuple[CauseCoordinate, ...]]:
        return {}

    def positions(self, hypothesis: Hypothesis) -> dict[CauseUse, slice]:
        """Return where the coordinates of each cause of a hypothesis are."""
        found, first = {}, self.soil_offsets[-1]
        for use in hypothesis:
            last = first + len(EFFECTS[use.key].parameters)
            found[use], first = slice(first, last), last
        return found

    def size(self, hypothesis: Hypothesis) -> int:
        """Return the number of coordinates."""
        return self.soil_offsets[-1] + sum(len(EFFECTS[use.key].parameters) for use in hypothesis)

    def evaluate(
        self, hypotheses: Sequence[Hypothesis], standard: FloatArray, *, slopes: bool = False
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return what the model says under every hypothesis.

        Parameters
        ----------
        standard : array, shape (B, p)
            Coordinates; p at least the largest hypothesis' size.
        slopes : bool
            Whether derivatives are wanted.

        Returns
        -------
        predicted : mapping channel ("dp", "t", "z") -> array, shape (B, n)
            NaN where the model has no answer.
        slopes : mapping channel -> array, shape (B, n, p)
            Empty unless wanted.
        """
        kinds = [_kind(hypothesis) for hypothesis in hypotheses]
        parts = [np.flatnonzero([kind == wanted for kind in kinds]) for wanted in dict.fromkeys(kinds)]
        if len(parts) == 1 or len(hypotheses) * len(self.slip) < _SPLIT_ROWS:
            return self._evaluated(hypotheses, standard, slopes=slopes)
        found = [self._evaluated([hypotheses[i] for i in p.tolist()], standard[p], slopes=slopes) for p in parts]
        back = np.argsort(np.concatenate(parts))
        values, by = (
            {key: np.concatenate([part[side][key] for part in found])[back] for key in found[0][side]}
            for side in (0, 1)
        )
        return values, by

    def _evaluated(
        self, hypotheses: Sequence[Hypothesis], standard: FloatArray, *, slopes: bool
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return what `evaluate` does, of hypotheses that cost alike."""
        columns = Columns(self, tuple(hypotheses), standard, slopes)
        weight = np.array([b.soil.unit_weight_n_m3 for b in self.tables])[self.table]
        conditions = Conditions(
            columns.of_rows(self.slip), columns.of_rows(self.load_n), unit_weight_n_m3=columns.of_rows(weight)
        )
        keys = dict.fromkeys(use.key for hypothesis in hypotheses for use in hypothesis)
        first = self.tables[0]
        model = WheelSoilModel(first.wheel, first.soil, [EFFECTS[key] for key in keys], self.reading)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            outputs = model.evaluate(conditions, columns.parameters(model))
        values = {key: columns.of_each(outputs[channel.field]) for key, channel in OUTPUTS.items()}
        if not slopes:
            return values, {}
        return values, {key: columns.scattered(outputs[channel.field]) for key, channel in OUTPUTS.items()}

    def _input_slopes(self) -> dict[str, FloatArray]:
        """Return the variances that slip's and load's errors carry into each channel, at the laboratory's soil."""
        found: dict[str, list[FloatArray]] = {channel: [] for channel in OUTPUTS}
        for table in self.tables:
            prediction = WheelSoilModel(table.wheel, table.soil, reading=self.reading).predict(
                Conditions(table.rows.slip, table.rows.vertical_load_n), wrt=("slip", "vertical_load_n")
            )
            for key, channel in OUTPUTS.items():
                by_slip, by_load = (
                    getattr(prediction.sensitivities[x], channel.field) for x in ("slip", "vertical_load_n")
                )
                variance = (by_slip * table.rows.slip_sigma) ** 2 + (by_load * table.rows.vertical_load_sigma_n) ** 2
                found[key].append(np.nan_to_num(variance))
        return {channel: np.concatenate(parts) for channel, parts in found.items()}


def _kind(hypothesis: Hypothesis) -> tuple[bool, bool]:
    """Return whether a hypothesis needs a contact behind the peak or with lugs, and a second sum of the stresses."""
    effects = [EFFECTS[use.key] for use in hypothesis]
    return any(e.patch is not Effect.patch for e in effects), any(e.moves_sinkage() for e in effects)


def _same_soil(a: Bench, b: Bench) -> bool:
    return a.soil == b.soil and bool(
        np.array_equal(a.soil_prior.mean, b.soil_prior.mean)
        and np.array_equal(a.soil_prior.covariance, b.soil_prior.covariance)
    )


def _uncertain(table: Bench) -> bool:
    return bool(np.any(table.rows.slip_sigma > 0) or np.any(table.rows.vertical_load_sigma_n > 0))
