"""What the channels read at standstill: zeros, cross-talk, drift and slope show there without any soil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import REACTIONS, FloatArray, IndexArray
from model.diagnosis.core.campaign import Campaign
from model.wheel_soil.conditions import REFERENCE_INFLATION_KPA, USUAL_OUTBOARD_MASS_KG, Conditions
from processing import ProcessedRun, Standstill

AT_REST = tuple(REACTIONS)
"""What is measured at standstill, in the order of arrays over it."""
_CUT_S = 0.8
"""Left out at an end of a standstill that a motion follows or precedes: the wheel is seen to turn only after the first
tooth of its ring, and forces are there before."""
_AT_AN_END_S = 0.3


@dataclass(frozen=True)
class Standstills:
    """Standstills of all runs with released brakes; arrays of shape (n,).

    With held brakes the hub carries an unknown share of the weight along the ground, what the rut keeps, and the torque
    of both: neither zero shows.

    Attributes
    ----------
    conditions : Conditions
        Load, direction, time and place; slip and speeds are 0.
    measured : mapping "dp", "t" -> array
        Mean over the standstill without its ends; NaN where not measured.
    spread : mapping "dp", "t" -> array
        Standard deviation about it.
    duration_s : array
        Of what the mean is over.
    wheel_angle_rad : array
        Rolled since the start of the run.
    """

    run: IndexArray
    conditions: Conditions
    measured: dict[str, FloatArray]
    spread: dict[str, FloatArray]
    duration_s: FloatArray
    wheel_angle_rad: FloatArray

    def __len__(self) -> int:
        return len(self.run)


def standstills_of(
    campaign: Campaign, channels: tuple[str, ...], clocks: list[FloatArray], positions: list[FloatArray]
) -> Standstills:
    """Collect the standstills of a campaign that show zeros.

    Parameters
    ----------
    channels : of "dp", "t"
    clocks, positions : list of array
        See `model.wheel_soil.run_conditions`.
    """
    rows = []
    for index, (run, clock, x) in enumerate(zip(campaign.runs, clocks, positions, strict=True)):
        angle = np.cumsum(np.nan_to_num(run.wheel_speed_radps)) / run.rate_hz
        for rest in (r for r in run.quality.standstills if r.released):
            inside = _inside(run, rest)
            load = _mean(run.vertical_load_n[inside])
            if not load > 0:
                continue
            i = (inside.start + inside.stop) // 2
            row = {
                "run": float(index),
                "load": load,
                "clock": float(clock[i]),
                "x": float(x[i]),
                "direction": -1.0 if run.run.direction == "back" else 1.0,
                "pass": float(run.run.pass_number),
                "kpa": run.run.inflation_kpa or REFERENCE_INFLATION_KPA,
                "duration": (inside.stop - inside.start) / run.rate_hz,
                "angle": float(angle[i]),
            }
            for c in channels:
                values = getattr(run, REACTIONS[c].field)[inside]
                row |= {
                    c: _mean(values),
                    f"{c} spread": float(np.nanstd(values)) if np.isfinite(values).any() else np.nan,
                }
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
        wheel_jerk_radps3=nothing,
        ground_speed_shift_s=nothing,
        line_position=table["x"],
        campaign_time=table["clock"],
        direction=table["direction"],
        pass_number=table["pass"],
        inflation_kpa=table["kpa"],
        unit_weight_n_m3=np.full(len(rows), campaign.soil.unit_weight_n_m3),
        compensated_mass_kg=np.full(len(rows), campaign.outboard_mass_kg),
        compensated_inertia_kgm2=np.full(len(rows), campaign.outboard_inertia_kgm2),
        outboard_mass_kg=np.full(len(rows), campaign.outboard_mass_kg or USUAL_OUTBOARD_MASS_KG),
    )
    return Standstills(
        run=table["run"].astype(np.intp),
        conditions=conditions,
        measured={c: table[c] for c in channels},
        spread={c: table[f"{c} spread"] for c in channels},
        duration_s=table["duration"],
        wheel_angle_rad=table["angle"],
    )


def _inside(run: ProcessedRun, rest: Standstill) -> slice:
    """Return the rows of a standstill without its ends: torque builds up before a wheel is seen to move."""
    first, last = (round(at * run.rate_hz) for at in (rest.start_s, rest.start_s + rest.duration_s))
    cut = min(round(_CUT_S * run.rate_hz), (last - first) // 3)
    moved_before = first > _AT_AN_END_S * run.rate_hz
    moves_after = last < len(run) - _AT_AN_END_S * run.rate_hz
    return slice(first + cut * moved_before, last + 1 - cut * moves_after)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _empty(channels: tuple[str, ...]) -> list[str]:
    own = ["run", "load", "clock", "x", "direction", "pass", "kpa", "duration", "angle", *channels]
    return own + [f"{c} spread" for c in channels]
