"""Rows of many hypotheses as columns of one model: parameters with their slopes, row by row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_coordinates import CauseCoordinate
from model.dual import Dual, Number, value_of
from model.effects import EFFECTS
from model.wheel_soil import WheelSoilModel

if TYPE_CHECKING:
    from model.diagnosis.bench_problem import BenchProblem

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CauseUse:
    """A cause in a hypothesis.

    Attributes
    ----------
    key : str
        Of the effect in the library.
    bench : int or None
        Position of the only bench that it acts on, with a value of its own; None: on all, with one value.
    """

    key: str
    bench: int | None = None


Hypothesis = tuple[CauseUse, ...]


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
        wheels = [bench.wheel for bench in self.problem.benches]
        sizes = {name: np.array([getattr(w, name) for w in wheels]) for name in ("radius_m", "width_m")}
        alike = all(np.ptp(size) == 0 for size in sizes.values())
        columns: dict[str, Number] = {
            name: float(size[0]) if alike else self.of_rows(size[self.problem.bench]) for name, size in sizes.items()
        }
        return columns | self._soils() | self._causes(model)

    def _soils(self) -> dict[str, Number]:
        problem, n = self.problem, len(self.problem.slip)
        parts: dict[str, list[FloatArray]] = {}
        partials: dict[str, list[FloatArray]] = {}
        for i, soil in enumerate(problem.soils):
            start, stop = problem.soil_offsets[i : i + 2]
            values, by = soil.values(self.standard[:, start:stop])
            width = problem.benches[problem.soil_of.index(i)].wheel.width_m
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
        of_row = np.array(problem.soil_of)[problem.bench]
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
        for (key, bench, slot), (coordinate, members) in self._slots().items():
            rows = np.ones(shape[1], bool) if bench is None else problem.bench == bench
            value, slope = coordinate.values(self.standard[members, problem.soil_offsets[-1] + slot])
            block = np.ix_(np.array(members), rows)
            values[key][block] = value[:, None]
            partials[key].setdefault(f"c{slot}", np.zeros(shape))[block] = slope[:, None]
        if not self.slopes:
            return {key: value.reshape(-1, 1) for key, value in values.items()}
        return {
            key: Dual(value.reshape(-1, 1), {name: s.reshape(-1, 1) for name, s in partials[key].items()})
            for key, value in values.items()
        }

    def _slots(self) -> dict[tuple[str, int | None, int], tuple[CauseCoordinate, list[int]]]:
        """Return which hypotheses have which parameter of the model in which of their own coordinates."""
        found: dict[tuple[str, int | None, int], tuple[CauseCoordinate, list[int]]] = {}
        alike: dict[Hypothesis, list[int]] = {}
        for member, hypothesis in enumerate(self.hypotheses):
            alike.setdefault(hypothesis, []).append(member)
        for hypothesis, members in alike.items():
            slot = 0
            for use in hypothesis:
                names = EFFECTS[use.key].parameter_keys().values()
                for name, coordinate in zip(names, self.problem.coordinates(use), strict=True):
                    found.setdefault((name, use.bench, slot), (coordinate, []))[1].extend(members)
                    slot += 1
        # a bench's own value replaces the value for all
        return dict(sorted(found.items(), key=lambda item: item[0][1] is not None))

    def of_each(self, said: Number) -> FloatArray:
        """Return a column of the model as one row for each hypothesis, shape (B, n)."""
        shape = (len(self.hypotheses), len(self.problem.slip))
        return np.array(np.broadcast_to(value_of(said), (self.count, 1))).reshape(shape)

    def scattered(self, said: Number) -> FloatArray:
        """Return the derivatives by the hypotheses' coordinates, shape (B, n, p)."""
        problem, shape = self.problem, (len(self.hypotheses), len(self.problem.slip))
        out = np.zeros((*shape, self.standard.shape[1]))
        partials: dict[str, Any] = said.partials if isinstance(said, Dual) else {}
        of_row = np.array(problem.soil_of)[problem.bench]
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
