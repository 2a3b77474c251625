"""A driven wheel in the granular simulation: one case is one slip and one load, from touch-down to the steady state."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, radians, tan

import numpy as np

from daq import FloatArray
from studies.granular.mpm import BINS, WHEEL, Bed, Body, Record, Soil

RADIUS_M, WIDTH_M = 0.15, 0.1
FASTER_MPS = 0.3
"""The larger of rim speed and ground speed."""
SMALL_BED_M, LARGE_BED_M = (0.12, 0.24, 0.11, 0.06), (0.16, 0.26, 0.133, 0.084)
"""The bed that moves with the axle: behind and ahead of it, below and above the undisturbed surface."""
SMALL_BED_SLIP = 0.5
"""Up to this slip, sinkage is small and so is the bed."""
BLOCKS = 8
_EDGE = 0.05
"""Share of the largest normal stress that counts as contact."""


@dataclass(frozen=True)
class Case:
    """Slip (r omega - V over the larger of both), vertical load (N on the wheel's width), cell size (m)."""

    slip: float
    load_n: float
    cell_m: float

    @property
    def speeds(self) -> tuple[float, float]:
        """Ground speed (m/s) and angular speed (rad/s)."""
        if self.slip >= 0:
            return FASTER_MPS * (1 - self.slip), FASTER_MPS / RADIUS_M
        return FASTER_MPS, FASTER_MPS * (1 + self.slip) / RADIUS_M

    @property
    def bed_m(self) -> tuple[float, float, float, float]:
        """Bed behind and ahead of the axle, below and above the surface."""
        return SMALL_BED_M if self.slip <= SMALL_BED_SLIP else LARGE_BED_M

    @property
    def durations_s(self) -> tuple[float, float]:
        """Time before the steady state and in it: 0.22 m and 0.14 m of travel, but 2.4 s and 0.8 s at most."""
        ground = self.speeds[0]
        return min(0.22 / ground, 2.4), min(0.14 / ground, 0.8)


@dataclass(frozen=True)
class Steady:
    """Steady state of a case, for the wheel's whole width.

    Attributes
    ----------
    drawbar_pull_n, driving_torque_nm, carried_load_n, sinkage_m : means
    pull_sigma_n, torque_sigma_nm, load_sigma_n, sinkage_sigma_m : one-sigma of the means from `BLOCKS` blocks
    sinkage_growth_m : second half less first half of the steady state
    entry_rad : acos(1 - z/r), where the wheel meets the undisturbed surface
    front_rad, peak_rad, rear_rad : front end of the contact, largest normal stress, rear end (positive behind the axle)
    peak_pa : largest normal stress
    """

    drawbar_pull_n: float
    pull_sigma_n: float
    driving_torque_nm: float
    torque_sigma_nm: float
    carried_load_n: float
    load_sigma_n: float
    sinkage_m: float
    sinkage_sigma_m: float
    sinkage_growth_m: float
    entry_rad: float
    front_rad: float
    peak_rad: float
    rear_rad: float
    peak_pa: float


def drive(case: Case, soil: Soil) -> tuple[Steady, Record]:
    """Return the steady state of a case and the record of it (per metre of width)."""
    ground, omega = case.speeds
    behind, ahead, depth, room = case.bed_m
    bed = Bed(soil, case.cell_m, behind + ahead, depth, room)
    axle = np.array([bed.left_m + behind, bed.surface_m + RADIUS_M, ground, 0.0, omega])
    friction = tan(radians(soil.friction_angle_deg))
    wheel = Body(WHEEL, np.array([RADIUS_M, 0.0, 0.0, 0.0]), axle, friction, case.load_n / WIDTH_M)
    before, during = case.durations_s
    _roll(bed, wheel, before, behind)
    record = _roll(bed, wheel, during, behind)
    return steady(record, bed.surface_m), record


def _roll(bed: Bed, wheel: Body, duration_s: float, behind_m: float) -> Record:
    """Advance with a bed that follows the axle."""
    step = bed.cell_m / wheel.state[2]
    records = []
    for _ in range(max(1, round(duration_s / step))):
        records.append(bed.run(wheel, step, every_s=min(step, 5e-3)))
        if wheel.state[0] >= bed.left_m + behind_m + bed.cell_m:
            bed.shift(wheel)
    rows = np.concatenate([record.rows for record in records])
    normal, shear = (np.mean([getattr(record, name) for record in records], axis=0) for name in ("normal", "shear"))
    return Record(rows, normal, shear)


def steady(record: Record, surface_m: float) -> Steady:
    """Return means, uncertainties and contact angles of a record in the steady state."""
    sinkage = surface_m - (record.rows[:, 5] - RADIUS_M)
    pull, load, torque = (record.rows[:, column] * WIDTH_M for column in (1, 2, 3))
    half = len(sinkage) // 2
    front, peak, rear, pressure = contact_angles(record.normal)
    depth = float(np.mean(sinkage))
    return Steady(
        drawbar_pull_n=float(np.mean(pull)),
        pull_sigma_n=block_sigma(pull),
        driving_torque_nm=float(np.mean(torque)),
        torque_sigma_nm=block_sigma(torque),
        carried_load_n=float(np.mean(load)),
        load_sigma_n=block_sigma(load),
        sinkage_m=depth,
        sinkage_sigma_m=block_sigma(sinkage),
        sinkage_growth_m=float(np.mean(sinkage[half:]) - np.mean(sinkage[:half])),
        entry_rad=acos(1 - depth / RADIUS_M),
        front_rad=front,
        peak_rad=peak,
        rear_rad=rear,
        peak_pa=pressure,
    )


def block_sigma(values: FloatArray) -> float:
    """Return the one-sigma of the mean from the scatter of block means."""
    means = [float(np.mean(block)) for block in np.array_split(values, BLOCKS)]
    return float(np.std(means, ddof=1) / np.sqrt(BLOCKS))


def contact_angles(normal: FloatArray) -> tuple[float, float, float, float]:
    """Return front end, place of the largest stress, rear end (positive behind) and that stress.

    The stress is smoothed over 7.5 degrees: fewer points than that touch the wheel at a time.
    """
    smooth = np.convolve(normal, np.ones(5) / 5, mode="same")
    angle = (np.arange(BINS) + 0.5) * np.pi / BINS - np.pi / 2
    top = int(np.argmax(smooth))
    touching = np.flatnonzero(smooth > _EDGE * smooth[top])
    near = slice(max(top - 4, 0), top + 5)
    peak = _vertex(angle[near], smooth[near])
    return float(angle[touching[-1]]), peak, float(-angle[touching[0]]), float(smooth[top])


def _vertex(x: FloatArray, y: FloatArray) -> float:
    """Return where the parabola through the points is largest, within them."""
    a, b, _ = np.polyfit(x - x.mean(), y, 2)
    return float(np.clip(x.mean() - b / (2 * a), x[0], x[-1])) if a < 0 else float(x[np.argmax(y)])
