"""The check that comes before any fit: rows that break a bound that no soil can break."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from model.bound import BoundRows, bound_rows_of_runs, bound_rows_of_table, inconsistent
from model.diagnosis.campaign import Bench, Campaign
from model.diagnosis.result import Inconsistent


def inconsistencies(parts: Sequence[Campaign | Bench]) -> tuple[Inconsistent, ...]:
    """Return what breaks T/r - Dp <= W tan(theta_1), per campaign or table; nothing where torque or sinkage is missing.

    Parameters
    ----------
    parts : sequence of Campaign or Bench
    """
    found = [(part.name, item) for part in parts for item in inconsistent(_rows(part))]
    if len(parts) == 1:
        return tuple(item for _, item in found)
    return tuple(replace(item, why=f"{name}: {item.why}") for name, item in found)


def _rows(part: Campaign | Bench) -> BoundRows:
    lugged = part.tyre == "lugged"
    if isinstance(part, Campaign):
        return bound_rows_of_runs(part.runs, lugged=lugged)
    rows = bound_rows_of_table(part.rows, part.wheel.radius_m, lugged=lugged)

    def sigma(channel: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.full(len(rows), part.sigmas.get(channel, 0.0))

    return replace(
        rows, drawbar_pull_sigma_n=sigma("dp"), driving_torque_sigma_nm=sigma("t"), sinkage_sigma_m=sigma("z")
    )
