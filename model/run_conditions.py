"""Everything that effects may ask for, for every sample of processed runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.diagnosis.positions import campaign_times, line_positions
from processing.processed_run import ProcessedRun

FloatArray = NDArray[np.float64]


def conditions_of(runs: Sequence[ProcessedRun], unit_weight_n_m3: float) -> list[Conditions]:
    """Return the conditions of every sample of every run of one campaign; every field has shape (n,).

    The slip is NaN where a sample is not usable, so that a model has no answer there.

    Parameters
    ----------
    runs : sequence of ProcessedRun
    unit_weight_n_m3 : float
        Of the soil.
    """
    positions, _ = line_positions(runs)
    clocks = campaign_times(runs)
    return [
        _of_run(run, position, clock, unit_weight_n_m3)
        for run, position, clock in zip(runs, positions, clocks, strict=True)
    ]


def _of_run(run: ProcessedRun, position: FloatArray, clock: FloatArray, unit_weight_n_m3: float) -> Conditions:
    def everywhere(value: float) -> FloatArray:
        return np.full(len(run), value)

    acceleration = run.ground_acceleration_mps2
    return Conditions(
        slip=np.where(run.used, run.slip, np.nan),
        vertical_load_n=run.vertical_load_n,
        ground_speed_mps=run.ground_speed_mps,
        wheel_speed_radps=run.wheel_speed_radps,
        ground_acceleration_mps2=acceleration,
        ground_jerk_mps3=np.gradient(acceleration) * run.rate_hz if len(run) > 1 else everywhere(0.0),
        wheel_acceleration_radps2=run.wheel_acceleration_radps2,
        line_position=position,
        campaign_time=clock,
        direction=everywhere(-1.0 if run.run.direction == "back" else 1.0),
        pass_number=everywhere(float(run.run.pass_number)),
        inflation_kpa=everywhere(run.run.inflation_kpa or np.nan),
        unit_weight_n_m3=everywhere(unit_weight_n_m3),
    )
