"""Many hypotheses about the same rows, evaluated at once: what the model says, and its slopes.

A hypothesis is a set of causes, each on all benches or on one of them only. Its coordinates are standard normal
beforehand (`model.diagnosis.bench_coordinates`): first those of every soil, then those of its causes. Hypotheses with
fewer coordinates than others are padded with ones that nothing depends on: they change no evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.diagnosis.bench_columns import CauseUse, Columns, Hypothesis
from model.diagnosis.bench_coordinates import CauseCoordinate, SoilCoordinates
from model.diagnosis.bench_noise import ChannelNoise, groups_of_rows
from model.diagnosis.campaign import Bench, DiagnosisOptions
from model.effects import EFFECTS
from model.wheel_soil import Reading, WheelSoilModel

FloatArray = NDArray[np.float64]

FIELDS = {"dp": "drawbar_pull_n", "t": "driving_torque_nm", "z": "sinkage_m"}
"""Channels of a bench, and what they are called elsewhere."""


@dataclass(frozen=True)
class BenchProblem:
    """The rows of some benches, and what is known beforehand.

    Attributes
    ----------
    benches : tuple of Bench
    soils : tuple of SoilCoordinates
    soil_of : tuple of int
        Which of the soils each bench is on.
    slip, load_n : arrays, shape (n,)
        Of all rows, one bench after the other.
    bench : int array, shape (n,)
        Which bench a row is of.
    group : int array, shape (n,)
        Rows of one group are repeats.
    noises : tuple of ChannelNoise
        One for each channel that is used.
    rows : tuple of int arrays
        Rows of each channel.
    reading : "balanced" or "literal"
    """

    benches: tuple[Bench, ...]
    soils: tuple[SoilCoordinates, ...]
    soil_of: tuple[int, ...]
    slip: FloatArray
    load_n: FloatArray
    bench: NDArray[np.intp]
    group: NDArray[np.intp]
    noises: tuple[ChannelNoise, ...]
    rows: tuple[NDArray[np.intp], ...]
    reading: Reading

    @staticmethod
    def of(benches: Sequence[Bench], options: DiagnosisOptions) -> BenchProblem:
        """Return the problem; benches with the same laboratory soil stand on one soil.

        Raises
        ------
        ConfigError
            See `SoilCoordinates.of`.
        """
        soils: list[Bench] = []
        soil_of = []
        for bench in benches:
            same = [i for i, other in enumerate(soils) if _same_soil(bench, other)]
            soil_of.append(same[0] if same else len(soils))
            if not same:
                soils.append(bench)
        slip, load = (np.concatenate([getattr(b.rows, name) for b in benches]) for name in ("slip", "vertical_load_n"))
        index = np.repeat(np.arange(len(benches)), [len(b.rows) for b in benches])
        groups: list[NDArray[np.intp]] = []
        for b in benches:
            first = groups[-1].max() + 1 if groups else 0
            groups.append(first + groups_of_rows(b.rows.run, b.rows.slip, b.rows.vertical_load_n))
        problem = BenchProblem(
            tuple(benches),
            tuple(SoilCoordinates.of(b) for b in soils),
            tuple(soil_of),
            slip,
            load,
            index,
            np.concatenate(groups),
            (),
            (),
            options.reading,
        )
        return problem._with_noise(options.channels)

    def _with_noise(self, channels: Sequence[str]) -> BenchProblem:
        noises, rows = [], []
        slopes = self._input_slopes() if any(_uncertain(b) for b in self.benches) else None
        for channel in channels:
            measured = self.measured(channel)
            chosen = np.flatnonzero(np.isfinite(measured))
            if not len(chosen):
                continue
            carried = np.zeros(len(chosen)) if slopes is None else slopes[channel][chosen]
            known = [b.sigmas.get(channel) for b in self.benches]
            sigma = None if any(s is None for s in known) else float(np.mean([s for s in known if s is not None]))
            group = np.unique(self.group[chosen], return_inverse=True)[1]
            form = ChannelNoise.usual_form(measured[chosen], group, sigma, self.size_of(channel))
            noises.append(ChannelNoise.of(channel, measured[chosen], group, carried, form, sigma))
            rows.append(chosen)
        return replace(self, noises=tuple(noises), rows=tuple(rows))

    def measured(self, channel: str) -> FloatArray:
        """Return the measured values of a channel in all rows, NaN where not measured."""
        return np.concatenate([getattr(b.rows, FIELDS[channel]) for b in self.benches])

    def size_of(self, channel: str) -> float:
        """Return what a channel is measured against: W, W r or r."""
        radius = float(np.mean([b.wheel.radius_m for b in self.benches]))
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
            wheel, load_n = self.benches[use.bench or 0].wheel, self.typical_load_n
            parameters = EFFECTS[use.key].parameters
            self._coordinates[use] = tuple(CauseCoordinate.of(p, wheel, load_n) for p in parameters)
        return self._coordinates[use]

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
        hypotheses : sequence of B
        standard : array, shape (B, p)
            Coordinates; p at least the largest hypothesis' size.
        slopes : bool
            Whether derivatives are wanted.

        Returns
        -------
        said : mapping channel ("dp", "t", "z") -> array, shape (B, n)
            NaN where the model has no answer.
        slopes : mapping channel -> array, shape (B, n, p)
            Empty unless wanted.
        """
        columns = Columns(self, tuple(hypotheses), standard, slopes)
        weight = np.array([b.soil.unit_weight_n_m3 for b in self.benches])[self.bench]
        conditions = Conditions(
            columns.of_rows(self.slip), columns.of_rows(self.load_n), unit_weight_n_m3=columns.of_rows(weight)
        )
        keys = dict.fromkeys(use.key for hypothesis in hypotheses for use in hypothesis)
        first = self.benches[0]
        model = WheelSoilModel(first.wheel, first.soil, [EFFECTS[key] for key in keys], self.reading)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            said = model.evaluate(conditions, columns.parameters(model))
        values = {channel: columns.of_each(said[name]) for channel, name in FIELDS.items()}
        if not slopes:
            return values, {}
        return values, {c: columns.scattered(said[name]) for c, name in FIELDS.items()}

    def _input_slopes(self) -> dict[str, FloatArray]:
        """Return the variances that slip's and load's errors carry into each channel, at the laboratory's soil."""
        found: dict[str, list[FloatArray]] = {channel: [] for channel in FIELDS}
        for bench in self.benches:
            said = WheelSoilModel(bench.wheel, bench.soil, reading=self.reading).predict(
                Conditions(bench.rows.slip, bench.rows.vertical_load_n), wrt=("slip", "vertical_load_n")
            )
            for channel, name in FIELDS.items():
                by_slip, by_load = (getattr(said.sensitivities[x], name) for x in ("slip", "vertical_load_n"))
                variance = (by_slip * bench.rows.slip_sigma) ** 2 + (by_load * bench.rows.vertical_load_sigma_n) ** 2
                found[channel].append(np.nan_to_num(variance))
        return {channel: np.concatenate(parts) for channel, parts in found.items()}


def _same_soil(a: Bench, b: Bench) -> bool:
    return a.soil == b.soil and bool(
        np.array_equal(a.soil_prior.mean, b.soil_prior.mean)
        and np.array_equal(a.soil_prior.covariance, b.soil_prior.covariance)
    )


def _uncertain(bench: Bench) -> bool:
    return bool(np.any(bench.rows.slip_sigma > 0) or np.any(bench.rows.vertical_load_sigma_n > 0))
