"""A processed run as named columns with units, for Parquet and CSV."""

from __future__ import annotations

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


def to_columns(run: ProcessedRun) -> tuple[dict[str, Column], dict[str, str]]:
    """Return the run's columns, all of one length, and the unit of each.

    ``time_ns`` (UTC) and ``time_s`` (since the first sample) first; quantities that were not measured are left out;
    ``segment`` and ``reason`` are names.
    """
    columns: dict[str, Column] = {
        "time_ns": run.start_ns + np.round(run.time_s * 1e9).astype(np.int64),
        "time_s": run.time_s,
    }
    units = {"time_ns": "ns", "time_s": "s"}
    for name, unit in UNITS.items():
        values = getattr(run, name)
        if np.isnan(values).all():
            continue
        for column in (name, _SIGMAS.get(name)):
            if column:
                columns[column] = np.ascontiguousarray(getattr(run, column))
                units[column] = unit
    for name, kind in (("segment", Segment), ("reason", Reason)):
        columns[name] = np.array([member.name.lower() for member in kind])[getattr(run, name)]
        units[name] = ""
    return columns, units
