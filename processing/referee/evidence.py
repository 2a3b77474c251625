"""What the referee looks at in a processed run."""

from __future__ import annotations

import numpy as np

from daq import ROLES, FloatArray, VehicleConfig
from processing.processed_run import ProcessedRun
from processing.referee.judgement import Evidence
from processing.referee.mends import JUDGED_ROLES

_WINDOW_S = 2.0
_LEAST_CHORD_M = 2.0
_LEAST_WINDOWS = 3
_EARTH_RADIUS_M = 6_371_008.8


def evidence_of(run: ProcessedRun, vehicle: VehicleConfig) -> Evidence:
    """Return the channels of a run as they are declared, and what else it says of them."""
    channels = {role: np.asarray(getattr(run, ROLES[role].field)) for role in JUDGED_ROLES}
    channels = {role: values for role, values in channels.items() if np.isfinite(values).any()}
    mass_kg = vehicle.vehicle.mass_kg
    if mass_kg is not None:
        mass_kg += max(run.run.added_load_kg, 0.0)
    return Evidence(channels, run.wheel_radius_m, mass_kg, _against_track(run, channels))


def _against_track(run: ProcessedRun, channels: dict[str, FloatArray]) -> dict[str, float]:
    """Return the median of each channel's size over the speed of the positions, in windows in which these move."""
    step = max(round(_WINDOW_S * run.rate_hz), 1)
    latitude, longitude = np.deg2rad(run.latitude_deg[::step]), np.deg2rad(run.longitude_deg[::step])
    if len(latitude) < 2 or not np.isfinite(latitude).any():
        return {}
    north, east = np.diff(latitude), np.diff(longitude) * np.cos(latitude[:-1])
    chord_m = _EARTH_RADIUS_M * np.hypot(north, east)
    far = chord_m > _LEAST_CHORD_M
    if far.sum() < _LEAST_WINDOWS:
        return {}
    far &= chord_m >= np.median(chord_m[far])
    found = {}
    for role, values in channels.items():
        sizes = np.abs(values[: len(chord_m) * step].reshape(len(chord_m), step)).mean(axis=1)
        ratios = (sizes * step / run.rate_hz / chord_m)[far]
        if np.isfinite(ratios).any():
            found[role] = float(np.nanmedian(ratios))
    return found
