"""A processed run as named columns with units, for Parquet and CSV."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from processing.processed_run import ProcessedRun, Reason, Segment

Column = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.str_]

UNITS = {
    "slip": "1",
    "ground_speed_mps": "m/s",
    "wheel_speed_radps": "rad/s",
    "vertical_load_n": "N",
    "drawbar_pull_n": "N",
    "driving_torque_nm": "Nm",
    "sinkage_m": "m",
    "ground_acceleration_mps2": "m/s^2",
    "wheel_acceleration_radps2": "rad/s^2",
    "distance_m": "m",
    "latitude_deg": "deg",
    "longitude_deg": "deg",
}
_SIGMAS = {
    "slip": "slip_sigma",
    "ground_speed_mps": "ground_speed_sigma_mps",
    "wheel_speed_radps": "wheel_speed_sigma_radps",
    "vertical_load_n": "vertical_load_sigma_n",
    "drawbar_pull_n": "drawbar_pull_sigma_n",
    "driving_torque_nm": "driving_torque_sigma_nm",
    "sinkage_m": "sinkage_sigma_m",
}
_NAMED: dict[str, type[Segment] | type[Reason]] = {"segment": Segment, "reason": Reason}


def units_of(run: ProcessedRun) -> dict[str, str]:
    """Return the names of the run's columns and their units.

    ``time_ns`` (UTC) and ``time_s`` (since the first sample) first; quantities that were not measured are left out;
    ``segment`` and ``reason`` are names.
    """
    units = {"time_ns": "ns", "time_s": "s"}
    for name, unit in UNITS.items():
        if not np.isnan(getattr(run, name)).all():
            units |= {column: unit for column in (name, _SIGMAS.get(name)) if column}
    return units | dict.fromkeys(_NAMED, "")


def block_of(run: ProcessedRun, names: Iterable[str], rows: slice) -> dict[str, Column]:
    """Return some rows of some columns; NaN for a quantity that was not measured."""
    return {name: _column(run, name, rows) for name in names}


def _column(run: ProcessedRun, name: str, rows: slice) -> Column:
    if name == "time_ns":
        return run.start_ns + np.round(run.time_s[rows] * 1e9).astype(np.int64)
    if name in _NAMED:
        words: NDArray[np.str_] = np.array([member.name.lower() for member in _NAMED[name]])
        return np.asarray(words[getattr(run, name)[rows]])
    return np.ascontiguousarray(getattr(run, name)[rows])
