"""Load, drawbar pull and torque of a driven wheel, averaged over short ranges of slip within a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import BoolArray, FloatArray, IndexArray
from daq.series import WheelTable
from model.sinkage_from_forces.sinkage import CENTRAL, sinkage_of_forces
from processing import ProcessedRun

LEAST_SLIP = 0.05
"""Below it a wheel whose slip is measured may as well be braked."""
BIN_WIDTH = 0.1
BLOCK_S = 0.2
_FEWEST_BLOCKS = 5
_CORRELATED = 2.0
"""Blocks that noise and swinging load make one: neighbours are not independent."""


@dataclass(frozen=True)
class Forces:
    """What a wheel shows, arrays of shape (n,); SI."""

    slip: FloatArray
    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray

    def ratios(self, radius_m: float) -> tuple[FloatArray, FloatArray]:
        """Return Dp/W and T/(r W)."""
        load = self.vertical_load_n
        return self.drawbar_pull_n / load, self.driving_torque_nm / (radius_m * load)

    def central_m(self, radius_m: float, lug_height_m: float = 0.0) -> FloatArray:
        """Return the sinkage with the `CENTRAL` shape of the stress."""
        drawn = sinkage_of_forces(self.slip, *self.ratios(radius_m), radius_m, CENTRAL, lug_height_m)
        return np.asarray(drawn[0], np.float64)

    def change_m(self, radius_m: float, lug_height_m: float = 0.0, **more: FloatArray) -> FloatArray:
        """Return how the central sinkage changes with more of a channel."""
        moved = replace(self, **{name: getattr(self, name) + np.nan_to_num(by) for name, by in more.items()})
        return moved.central_m(radius_m, lug_height_m) - self.central_m(radius_m, lug_height_m)


@dataclass(frozen=True)
class ForceCells:
    """Mean forces of a driven wheel; every array has shape (n,).

    Attributes
    ----------
    bin : int array
        Range of slip: it starts at ``LEAST_SLIP + BIN_WIDTH * bin``. Of a table: the row.
    group : int array
        Run, or group of a table; see `names`.
    samples : int array
        Behind each cell: blocks of `BLOCK_S`, or one row.
    noise_m : float array
        One-sigma of the sinkage from noise, with the `CENTRAL` shape; 0 where not known.
    pull_zero_m, torque_zero_m : float arrays
        What one sigma of a zero adds to the sinkage, alike in all cells of a group; 0 where not known.
    measured_m : float array
        Sinkage; NaN where it was not measured.
    lug_height_m : float
        As declared: torque acts at the radius and a part of it.
    """

    forces: Forces
    bin: IndexArray
    group: IndexArray
    samples: IndexArray
    noise_m: FloatArray
    pull_zero_m: FloatArray
    torque_zero_m: FloatArray
    measured_m: FloatArray
    names: tuple[str, ...]
    radius_m: float
    lug_height_m: float = 0.0

    @property
    def central_m(self) -> FloatArray:
        """Sinkage of every cell with the `CENTRAL` shape of the stress."""
        return self.forces.central_m(self.radius_m, self.lug_height_m)

    def __len__(self) -> int:
        return len(self.bin)


def cells_of_runs(runs: Sequence[ProcessedRun], lug_height_m: float = 0.0) -> ForceCells:
    """Average the driven samples of runs that carry a torque, per run and range of slip.

    Parameters
    ----------
    runs : sequence of ProcessedRun
        Of one wheel, at least one.
    lug_height_m : float
        As declared.
    """
    radius_m = runs[0].wheel_radius_m
    parts = [part for i, run in enumerate(runs) for part in _cells(i, run, _blocks(run), lug_height_m)]

    def column(name: str) -> FloatArray:
        return np.array([part[name] for part in parts], np.float64)

    forces = Forces(**{name: column(name) for name in Forces.__dataclass_fields__})
    return ForceCells(
        forces=forces,
        bin=column("bin").astype(np.intp),
        group=column("group").astype(np.intp),
        samples=column("samples").astype(np.intp),
        noise_m=column("noise_m"),
        pull_zero_m=forces.change_m(radius_m, lug_height_m, drawbar_pull_n=column("pull_zero_n")),
        torque_zero_m=forces.change_m(radius_m, lug_height_m, driving_torque_nm=column("torque_zero_nm")),
        measured_m=column("sinkage_m"),
        names=tuple(run.run.id or f"run {i + 1}" for i, run in enumerate(runs)),
        radius_m=radius_m,
        lug_height_m=lug_height_m,
    )


def cells_of_table(table: WheelTable, radius_m: float, lug_height_m: float = 0.0) -> ForceCells:
    """Return the driven rows of a bench table that have a torque, each a cell of its own.

    Noise is what the table's sigma columns state.
    """
    driven = (table.slip > 0.0) & np.isfinite(table.driving_torque_nm)
    rows = np.flatnonzero(driven)
    forces = Forces(*(getattr(table, name)[rows] for name in Forces.__dataclass_fields__))
    changes = [
        forces.change_m(radius_m, lug_height_m, **{name: table.sigma[name][rows]})
        for name in ("vertical_load_n", "drawbar_pull_n", "driving_torque_nm")
        if name in table.sigma
    ]
    nothing = np.zeros(len(rows))
    return ForceCells(
        forces=forces,
        bin=rows,
        group=table.group[rows],
        samples=np.ones(len(rows), np.intp),
        noise_m=np.sqrt(sum((change**2 for change in changes), nothing)),
        pull_zero_m=nothing,
        torque_zero_m=nothing,
        measured_m=table.sinkage_m[rows],
        names=table.group_names,
        radius_m=radius_m,
        lug_height_m=lug_height_m,
    )


def driven_samples(run: ProcessedRun) -> BoolArray:
    """Return which samples of a run are usable and surely driven, with a torque."""
    return np.asarray(run.used & (run.slip >= LEAST_SLIP) & np.isfinite(run.driving_torque_nm))


def _blocks(run: ProcessedRun) -> dict[str, FloatArray]:
    """Return means over blocks of `BLOCK_S` that are driven throughout."""
    length = max(1, round(BLOCK_S * run.rate_hz))
    count = len(run) // length
    driven = driven_samples(run)[: count * length].reshape(count, length).all(axis=1)

    def means(name: str) -> FloatArray:
        values: FloatArray = getattr(run, name)[: count * length].reshape(count, length)[driven]
        return np.asarray(values.mean(axis=1))

    found = {name: means(name) for name in Forces.__dataclass_fields__}
    sinkage = run.sinkage_m[: count * length].reshape(count, length)[driven]
    return {**found, "sinkage_m": np.array([_of_known(block) for block in sinkage])}


def _of_known(sinkage_m: FloatArray) -> float:
    """Return the mean of what is known, as rut readings are at single samples; NaN where nothing is."""
    known = np.isfinite(sinkage_m)
    return float(sinkage_m[known].mean()) if known.any() else float("nan")


def _cells(
    group: int, run: ProcessedRun, blocks: dict[str, FloatArray], lug_height_m: float
) -> Iterator[dict[str, float]]:
    """Average blocks of one run over ranges of slip; noise is the scatter of their sinkage."""
    forces = Forces(*(blocks[name] for name in Forces.__dataclass_fields__))
    sinkage = forces.central_m(run.wheel_radius_m, lug_height_m)
    bins = np.floor((forces.slip - LEAST_SLIP) / BIN_WIDTH + 1e-9).astype(np.intp)
    zeros = {role: _zero_sigma(run, role) for role in ("drawbar_pull", "driving_torque")}
    for number in np.unique(bins).tolist():
        inside = bins == number
        count = int(inside.sum())
        if count < _FEWEST_BLOCKS:
            continue
        yield {
            **{name: float(blocks[name][inside].mean()) for name in Forces.__dataclass_fields__},
            "sinkage_m": _of_known(blocks["sinkage_m"][inside]),
            "bin": number,
            "group": group,
            "samples": count,
            "noise_m": float(np.std(sinkage[inside], ddof=1) / np.sqrt(count / _CORRELATED)),
            "pull_zero_n": zeros["drawbar_pull"],
            "torque_zero_nm": zeros["driving_torque"],
        }


def _zero_sigma(run: ProcessedRun, role: str) -> float:
    facts = run.quality.sensors.get(role)
    return facts.systematic_sigma if facts is not None and np.isfinite(facts.systematic_sigma) else 0.0
