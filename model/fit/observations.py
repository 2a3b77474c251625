"""What a fit sees: the driven, usable samples of some runs or of a bench table, thinned to what the filter left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray, IndexArray
from model.wheel_soil.conditions import Conditions
from model.wheel_soil.run_conditions import RunConditions, joined_conditions
from processing import ProcessedRun


@dataclass(frozen=True)
class Measured:
    """What predictions are held to: samples one after the other; every array has shape (n,), NaN: not measured."""

    slip: FloatArray
    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    sinkage_m: FloatArray

    def __len__(self) -> int:
        return len(self.slip)

    def measured(self, channel: str) -> FloatArray:
        """Return the measured values of "dp", "t" or "z"."""
        values: FloatArray = getattr(self, OUTPUTS[channel].field)
        return values


@dataclass(frozen=True)
class Observations(Measured):
    """Measured samples of one terrain, one after the other; every array has shape (n,).

    Attributes
    ----------
    slip, vertical_load_n, drawbar_pull_n, driving_torque_nm, sinkage_m : measured; NaN where not measured.
    slip_sigma, vertical_load_sigma_n : one-sigma of a sample; 0 where unknown.
    time_s : within the run.
    run : index of the run a sample is from.
    names : of the runs.
    readings : whether sinkage is of rut readings: at single samples, independent of each other.
    independent : whether samples are independent of each other (rows of a bench table), or a time series.
    given : Conditions, optional
        Where effects ask for more than slip and load.
    drives : tuple of int
        Which drive each run is of: wheels that are driven together have a run each. Empty: no two are.
    """

    slip_sigma: FloatArray
    vertical_load_sigma_n: FloatArray
    time_s: FloatArray
    run: IndexArray
    names: tuple[str, ...]
    independent: bool = False
    readings: bool = False
    given: Conditions | None = None
    drives: tuple[int, ...] = ()

    def __getitem__(self, rows: BoolArray | slice) -> Observations:
        arrays: dict[str, Any] = {n: value[rows] for n, value in vars(self).items() if isinstance(value, np.ndarray)}
        return replace(self, **arrays, given=self.given and self.given.rows(rows))

    @property
    def drive(self) -> IndexArray:
        """Index of the drive that each sample is of, shape (n,)."""
        return np.array(self.drives, np.intp)[self.run] if self.drives else self.run

    @property
    def conditions(self) -> Conditions:
        """What the wheel was put through, as a model takes it."""
        return self.given or Conditions(self.slip, self.vertical_load_n)


def observations_of(
    runs: Sequence[ProcessedRun], *, conditions: Sequence[RunConditions] = (), drives: Sequence[int] = ()
) -> Observations:
    """Collect the usable samples of processed runs, thinned.

    Only every k-th sample is kept, so that the rate is still 2.5 times the filter's cutoff: what is excluded holds no
    information that its neighbours do not have. Samples with a rut reading are all kept. `conditions` are those of
    every sample of each run (`model.wheel_soil.run_conditions.conditions_of`), for effects that ask for more than slip
    and load. The times of `drives` (see `Observations`) are of one clock.
    """
    chosen = [np.flatnonzero(run.used & _thinned(run)) for run in runs]
    place = np.repeat(np.arange(len(runs)), [len(rows) for rows in chosen])
    own = drives or range(len(runs))
    begin_ns = [min(run.start_ns for run, of in zip(runs, own, strict=True) if of == drive) for drive in own]

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(run, name)[rows] for run, rows in zip(runs, chosen, strict=True)])

    return Observations(
        slip=joined("slip"),
        vertical_load_n=joined("vertical_load_n"),
        drawbar_pull_n=joined("drawbar_pull_n"),
        driving_torque_nm=joined("driving_torque_nm"),
        sinkage_m=joined("sinkage_m"),
        slip_sigma=np.nan_to_num(joined("slip_sigma")),
        vertical_load_sigma_n=np.nan_to_num(joined("vertical_load_sigma_n")),
        time_s=joined("time_s") + 1e-9 * (np.array([run.start_ns for run in runs]) - begin_ns)[place],
        run=place,
        names=tuple(run.run.id or f"run {i + 1}" for i, run in enumerate(runs)),
        readings=any(run.run.rut for run in runs),
        given=joined_conditions(conditions, chosen) if conditions else None,
        drives=tuple(drives),
    )


def measured_of(runs: Sequence[ProcessedRun], rows: Sequence[IndexArray]) -> Measured:
    """Collect some rows of each processed run."""
    chosen = list(zip(runs, rows, strict=True))
    return Measured(*(np.concatenate([getattr(run, f.name)[own] for run, own in chosen]) for f in fields(Measured)))


def _thinned(run: ProcessedRun) -> BoolArray:
    kept = np.arange(len(run)) % _step(run) == 0
    return np.asarray(kept | np.isfinite(run.sinkage_m)) if run.run.rut else kept


def _step(run: ProcessedRun) -> int:
    return max(1, int(run.rate_hz / (2.5 * run.cutoff_hz))) if np.isfinite(run.cutoff_hz) else 1
