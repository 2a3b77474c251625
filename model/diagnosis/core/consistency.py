r"""Rows that break a bound that no soil can break, T/r - Dp <= W tan(theta_1); checked before any fit.

With normal stress :math:`\sigma` and shear stress :math:`\tau` on the rim, :math:`T/r - D_p = rb\int\sigma\sin\theta +
\tau(1-\cos\theta)\,d\theta` and :math:`W = rb\int\sigma\cos\theta + \tau\sin\theta\,d\theta`. Between the bottom and
the entry :math:`\sin\theta \le \tan\theta_1\cos\theta` and :math:`1-\cos\theta \le \tan\theta_1\sin\theta`, so that
the bound holds for any :math:`\sigma, \tau \ge 0`, wherever the stress peaks.

It needs a driven wheel (tau >= 0), a rigid rim, and no soil in front of the entry that the sinkage gives (no bow
wave). On lugs T acts at r + h: with T/r instead, up to h/(r + h) T/r more is allowed. Behind the bottom, at an angle
phi, normal stress only helps, and the bound holds as long as :math:`\tau \le \sigma\,\sin(\theta_1+\varphi) /
(2\sin(\theta_1+\varphi/2)\sin(\varphi/2))`, about sigma/phi: friction never breaks it (that would take
tan phi_s > 5 at phi = .2), cohesion alone on a long rear patch could.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from daq import INPUTS, OUTPUTS, FloatArray, IndexArray, Note
from daq.series import WheelTable
from model.diagnosis.core.campaign import Bench, Campaign
from model.diagnosis.core.result import Inconsistent
from model.fit.observations import Observations
from model.notes import SinkageCode
from model.sinkage_from_forces.force_cells import driven_samples
from model.sinkage_from_forces.sinkage import shear_share
from processing import ProcessedRun

SIGMAS = 4.0
"""One-sigmas by which a row may be over the bound."""
RADIUS_SIGMA = 0.01
"""Relative one-sigma of the wheel's radius."""
_STEEPEST = 1.0
"""Mean of shear over normal stress that no natural soil exceeds by much: a friction angle of 45 degrees."""
_SCALE_OFF = 0.05
"""Share by which the rim's speed of a hardly slipping wheel must be off for its radius to be suspected."""
_HIGHEST_LUG = 0.1
"""In radii."""
_MOST_NAMED = 200
"""Rows of which those that break the bound are named one by one; of more the range of slip is."""
_MOST_SUSPECTS = 500
"""Rows, the worst ones, from which changes are computed."""

_SIGMA_OF = {channel.field: channel.sigma_field for channel in (INPUTS["w"], *OUTPUTS.values())}
_MEASURED = (*_SIGMA_OF, *_SIGMA_OF.values())


@dataclass(frozen=True)
class BoundRows:
    """Driven rows with measured sinkage; arrays of shape (n,), SI; a sigma of 0 where none is known.

    Attributes
    ----------
    torque_at_rest_nm : float array, shape (n,)
        What the torque of the row's run reads at standstill with released brakes; NaN where that is not known.
    lugged : bool
        The rim has lugs: torque may act a tenth of the radius further out.
    speed_scale : float
        Ground speed over rim speed where the wheel hardly slips; NaN where that is not known.
    slip : float array, shape (n,); empty where it is not known
    lines : int array, shape (n,)
        Lines in a table's file; empty where the rows are of none.
    lug_share : float
        Height of lugs in radii; of a lugged rim.
    """

    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    sinkage_m: FloatArray
    vertical_load_sigma_n: FloatArray
    drawbar_pull_sigma_n: FloatArray
    driving_torque_sigma_nm: FloatArray
    sinkage_sigma_m: FloatArray
    torque_at_rest_nm: FloatArray
    radius_m: float
    lugged: bool = False
    speed_scale: float = np.nan
    slip: FloatArray = field(default_factory=lambda: np.zeros(0))
    lines: IndexArray = field(default_factory=lambda: np.zeros(0, np.intp))
    lug_share: float = _HIGHEST_LUG

    def __len__(self) -> int:
        return len(self.sinkage_m)

    def __getitem__(self, rows: IndexArray) -> BoundRows:
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in _MEASURED},
            torque_at_rest_nm=self.torque_at_rest_nm[rows],
            slip=self.slip[rows] if len(self.slip) else self.slip,
            lines=self.lines[rows] if len(self.lines) else self.lines,
        )

    @property
    def is_series(self) -> bool:
        """Whether they are samples of runs, too many to be named one by one."""
        return len(self) > _MOST_NAMED

    @property
    def excess_n(self) -> FloatArray:
        """T/r - Dp - W tan(theta_1): what is left over."""
        arm_m = self.radius_m * (1.0 + self.lug_share * self.lugged)
        resistance = self.driving_torque_nm / arm_m - self.drawbar_pull_n
        return resistance - self.vertical_load_n * _tangent(self.sinkage_m, self.radius_m)

    @property
    def sigma_n(self) -> FloatArray:
        """One-sigma of the excess, from every channel and the radius."""
        tangent = _tangent(self.sinkage_m, self.radius_m)
        deeper = _tangent(self.sinkage_m + self.sinkage_sigma_m, self.radius_m)
        parts = (
            self.driving_torque_sigma_nm / self.radius_m,
            self.drawbar_pull_sigma_n,
            self.vertical_load_sigma_n * tangent,
            self.vertical_load_n * (deeper - tangent),
            RADIUS_SIGMA * self.driving_torque_nm / self.radius_m,
        )
        return np.sqrt(sum((part**2 for part in parts), np.zeros(len(self))))


def bound_rows_of_runs(runs: Sequence[ProcessedRun], *, lugged: bool = False) -> BoundRows:
    """Return the driven samples of runs of one wheel that carry torque and sinkage; at least one run."""
    rows = [driven_samples(run) & np.isfinite(run.sinkage_m) for run in runs]

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(run, name)[chosen] for run, chosen in zip(runs, rows, strict=True)])

    rests = [np.full(int(chosen.sum()), _torque_at_rest(run)) for run, chosen in zip(runs, rows, strict=True)]
    scales = [run.quality.speed_scale for run in runs if np.isfinite(run.quality.speed_scale)]
    columns: dict[str, Any] = {name: np.nan_to_num(joined(name)) for name in _MEASURED}
    return BoundRows(
        **columns,
        torque_at_rest_nm=np.concatenate(rests),
        radius_m=runs[0].wheel_radius_m,
        lugged=lugged,
        speed_scale=float(np.median(scales)) if scales else np.nan,
        slip=joined("slip"),
    )


def bound_rows_of_table(
    table: WheelTable | Observations,
    radius_m: float,
    *,
    lugged: bool = False,
    lug_height_m: float | None = None,
    lines: Sequence[int] = (),
) -> BoundRows:
    """Return the driven rows of a bench table that hold torque and sinkage.

    Sigmas are those that a `WheelTable` states; of `Observations` only that of the load is known.

    Parameters
    ----------
    lug_height_m : float, optional
        Where it is declared; else a tenth of the radius is allowed for.
    lines : sequence of int
        Of the rows of `Observations` in their file; a `WheelTable` has its own.
    """
    rows = (table.slip > 0.0) & np.isfinite(table.driving_torque_nm + table.sinkage_m)
    stated = table.sigma if isinstance(table, WheelTable) else {"vertical_load_n": table.vertical_load_sigma_n}
    columns = {name: getattr(table, name)[rows] for name in _SIGMA_OF}
    for name, sigma in _SIGMA_OF.items():
        columns[sigma] = np.nan_to_num(stated[name][rows]) if name in stated else np.zeros(int(rows.sum()))
    at_rest = np.full(int(rows.sum()), np.nan)
    numbers = np.array(table.lines if isinstance(table, WheelTable) else lines, np.intp)
    return BoundRows(
        **columns,
        torque_at_rest_nm=at_rest,
        radius_m=radius_m,
        lugged=lugged,
        slip=table.slip[rows],
        lines=numbers[rows] if len(numbers) else numbers,
        lug_share=_HIGHEST_LUG if lug_height_m is None else lug_height_m / radius_m,
    )


def inconsistent(rows: BoundRows) -> tuple[Inconsistent, ...]:
    """Return what breaks the bound by more than noise: nothing, or one entry that names the channel to suspect.

    Torque, if its reading at standstill is large enough to explain it. Torque or radius, if the forces by themselves
    ask for more friction than soil has: the radius, if the rim's speed is off too. Else the sinkage: the forces agree
    with each other, but not with it.
    """
    over = rows.excess_n - SIGMAS * rows.sigma_n
    broken = int((over > 0.0).sum())
    if not broken:
        return ()
    worst = np.argsort(-over)[: min(broken, _MOST_SUSPECTS)]
    seen = rows[worst]
    change = _change(seen)
    channel, code, found = _suspect(seen, change["less_torque_nm"])
    excess = float(rows.excess_n[worst[0]])
    places = rows[np.flatnonzero(over > 0.0)]
    slips = np.sort(places.slip) if rows.is_series else places.slip
    where: dict[str, tuple[Any, ...]] = {
        "lines": tuple(places.lines.tolist()),
        "slips": tuple((slips[[0, -1]] if rows.is_series and len(slips) else slips).tolist()),
    }
    values = {
        "campaign": "",
        "broken": broken,
        "rows": len(rows),
        "excess_n": excess,
        "sigmas": excess / max(float(rows.sigma_n[worst[0]]), 1e-9),
    }
    why = Note(code, values={**values, **where, **found, **change})
    return (Inconsistent(channel, broken, why, **where),)


def _change(rows: BoundRows) -> dict[str, float]:
    """Return the least change of each channel, alike in all rows, that brings rows back under the bound."""
    pull_n = float(rows.excess_n.max())
    tangent = rows.excess_n / rows.vertical_load_n + _tangent(rows.sinkage_m, rows.radius_m)
    sinkage_m = float((rows.radius_m * (1.0 - np.cos(np.arctan(tangent))) - rows.sinkage_m).max())
    shares = np.linspace(-0.6, 2.0, 521)
    radii = rows.radius_m * (1.0 + shares[:, None])
    arms = radii * (1.0 + rows.lug_share * rows.lugged)
    resistance = rows.driving_torque_nm / arms - rows.drawbar_pull_n
    fine = (resistance - rows.vertical_load_n * _tangent(rows.sinkage_m, radii) <= 0.0).all(axis=1)
    return {
        "less_torque_nm": pull_n * rows.radius_m,
        "more_sinkage_m": sinkage_m,
        "larger_radius": float(min(shares[fine], key=abs)) if fine.any() else np.inf,
        "more_pull_n": pull_n,
    }


def _suspect(rows: BoundRows, less_torque_nm: float) -> tuple[str, SinkageCode, dict[str, float]]:
    """Return the channel to suspect, and why, with the values of the note."""
    rest = float(np.nan_to_num(rows.torque_at_rest_nm).max())
    if rest > 0.5 * less_torque_nm:
        return "driving_torque", SinkageCode.TORQUE_AT_REST, {"rest_nm": rest}
    friction = float(np.median(_friction(rows)))
    if friction <= _STEEPEST:
        return "sinkage", SinkageCode.SINKAGE_SUSPECT, {}
    if abs(rows.speed_scale - 1.0) > _SCALE_OFF:
        scale = {"friction": friction, "speed_scale": float(rows.speed_scale)}
        return "wheel_radius", SinkageCode.RADIUS_SUSPECT, scale
    return "driving_torque", SinkageCode.TORQUE_SUSPECT, {"friction": friction}


def _friction(rows: BoundRows) -> FloatArray:
    """Return the mean of shear over normal stress that the forces ask for."""
    pull, torque = rows.drawbar_pull_n / rows.vertical_load_n, rows.driving_torque_nm / rows.vertical_load_n
    return shear_share(pull, torque / rows.radius_m)


def _torque_at_rest(run: ProcessedRun) -> float:
    stops = [stop for stop in run.quality.standstills if stop.released]
    levels = [stop.levels["driving_torque"] for stop in stops if "driving_torque" in stop.levels]
    return float(np.median(levels)) if levels else np.nan


def _tangent(sinkage_m: FloatArray, radius_m: float | FloatArray) -> FloatArray:
    """Return tan(theta_1): 0 for a wheel above the ground, very large for one in to its axle."""
    cosine = np.clip(1.0 - sinkage_m / radius_m, 1e-9, 1.0)
    return np.asarray(np.sqrt(1.0 - cosine**2) / cosine)


def inconsistencies(parts: Sequence[Campaign | Bench]) -> tuple[Inconsistent, ...]:
    """Return what breaks the bound, per campaign or table; nothing where torque or sinkage is missing."""
    found = [(part.name, item) for part in parts for item in inconsistent(_rows(part))]
    if len(parts) == 1:
        return tuple(item for _, item in found)
    return tuple(
        replace(item, why=replace(item.why, values={**item.why.values, "campaign": name})) for name, item in found
    )


def _rows(part: Campaign | Bench) -> BoundRows:
    lugged = part.tyre == "lugged"
    if isinstance(part, Campaign):
        return bound_rows_of_runs(part.runs, lugged=lugged)
    height = part.lugs.height_m if part.lugs else None
    rows = bound_rows_of_table(part.rows, part.wheel.radius_m, lugged=lugged, lug_height_m=height, lines=part.lines)

    def sigma(channel: str) -> FloatArray:
        return np.full(len(rows), part.sigmas.get(channel, 0.0))

    return replace(
        rows, drawbar_pull_sigma_n=sigma("dp"), driving_torque_sigma_nm=sigma("t"), sinkage_sigma_m=sigma("z")
    )
