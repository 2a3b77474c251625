"""What the channels read while the wheel stands: zeros, cross-talk, drift and slope show there without any soil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.diagnosis.campaign import Campaign
from model.effects.tyre_flattening import REFERENCE_KPA

FloatArray = NDArray[np.float64]

_ROLES = {"dp": "drawbar_pull", "t": "driving_torque"}


@dataclass(frozen=True)
class Rests:
    """Standstills of all runs; arrays of shape (n,).

    Attributes
    ----------
    run : int array
    conditions : Conditions
        Load, direction, time and place; slip and speeds are 0.
    measured, sigma : mapping "dp", "t" -> array
        Median over the standstill and its one-sigma; NaN where not measured.
    duration_s : array
    wheel_angle_rad : array
        Rolled since the start of the run.
    """

    run: NDArray[np.intp]
    conditions: Conditions
    measured: dict[str, FloatArray]
    sigma: dict[str, FloatArray]
    duration_s: FloatArray
    wheel_angle_rad: FloatArray

    def __len__(self) -> int:
        return len(self.run)


def rests_of(
    campaign: Campaign, channels: tuple[str, ...], clocks: list[FloatArray], positions: list[FloatArray]
) -> Rests:
    """Collect the standstills of a campaign.

    Parameters
    ----------
    campaign : Campaign
    channels : of "dp", "t"
    clocks, positions : list of array
        See `model.diagnosis.positions`.
    """
    rows = []
    for index, (run, clock, x) in enumerate(zip(campaign.runs, clocks, positions, strict=True)):
        angle = np.cumsum(np.nan_to_num(run.wheel_speed_radps)) / run.rate_hz
        for rest in run.quality.standstills:
            if not rest.levels.get("vertical_load", 0.0) > 0:
                continue
            i = min(round((rest.start_s + 0.5 * rest.duration_s) * run.rate_hz), len(run) - 1)
            row = {
                "run": float(index),
                "load": rest.levels["vertical_load"],
                "clock": float(clock[i]),
                "x": float(x[i]),
                "direction": -1.0 if run.run.direction == "back" else 1.0,
                "pass": float(run.run.pass_number),
                "kpa": run.run.inflation_kpa or REFERENCE_KPA,
                "duration": rest.duration_s,
                "angle": float(angle[i]),
            }
            for c in channels:
                row[c], row[f"{c} sigma"] = (kind.get(_ROLES[c], np.nan) for kind in (rest.levels, rest.sigmas))
            rows.append(row)
    table = {key: np.array([row[key] for row in rows], float) for key in (rows[0] if rows else _empty(channels))}
    nothing = np.zeros(len(rows))
    conditions = Conditions(
        slip=nothing,
        vertical_load_n=table["load"],
        ground_speed_mps=nothing,
        wheel_speed_radps=nothing,
        ground_acceleration_mps2=nothing,
        ground_jerk_mps3=nothing,
        wheel_acceleration_radps2=nothing,
        line_position=table["x"],
        campaign_time=table["clock"],
        direction=table["direction"],
        pass_number=table["pass"],
        inflation_kpa=table["kpa"],
        unit_weight_n_m3=np.full(len(rows), campaign.soil.unit_weight_n_m3),
    )
    return Rests(
        run=table["run"].astype(np.intp),
        conditions=conditions,
        measured={c: table[c] for c in channels},
        sigma={c: table[f"{c} sigma"] for c in channels},
        duration_s=table["duration"],
        wheel_angle_rad=table["angle"],
    )


def _empty(channels: tuple[str, ...]) -> list[str]:
    own = ["run", "load", "clock", "x", "direction", "pass", "kpa", "duration", "angle"]
    return own + [name for c in channels for name in (c, f"{c} sigma")]
