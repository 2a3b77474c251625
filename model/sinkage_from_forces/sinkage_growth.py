"""Sinkage from forces with its band, and how it grows with slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from daq import BoolArray, FloatArray, IndexArray, Note
from model.notes import SinkageCode
from model.sinkage_from_forces.force_cells import ForceCells
from model.sinkage_from_forces.sinkage import ShapeRanges, Shapes, draw_shapes, sinkage_of_forces

DRAWS = 400
WITHOUT_FORCES = (0.034, 0.454)
"""95 % band of Z/r of all published wheels with measured sinkage and torque (docs/sinkage.md): known without forces."""
_USUAL_LN = (float(np.mean(np.log(WITHOUT_FORCES))), float(np.ptp(np.log(WITHOUT_FORCES))) / 3.92 * 1.55)
"""Mean and one-sigma of ln(Z/r) of the next wheel: wider, by Student's t of the five wheels that it comes from."""
_SHALLOW = 1e-3
"""Of the radius: as good as no sinkage."""
_LEAST_SPAN = 0.2
_OWN_SHARE = 0.02
"""Share of a sinkage by which cells differ beyond their noise: keeps quiet cells from deciding a slope alone."""


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval; NaN where there is none."""

    value: float
    interval95: tuple[float, float]


@dataclass(frozen=True)
class Growth:
    """Growth of sinkage from no slip to full slip, in metres.

    Attributes
    ----------
    from_forces : Estimate
        Whatever the shape of the stress.
    if_peak_stays, if_peak_moves : Estimate
        Given that the stress peaks at the bottom; given that its peak moves forward with slip. A moving peak needs
        less sinkage for the same forces, so that these differ.
    measured : Estimate
        Of the measured sinkage.
    reason : Note, optional
        Why there is none.
    """

    from_forces: Estimate
    if_peak_stays: Estimate
    if_peak_moves: Estimate
    measured: Estimate
    reason: Note | None = None

    @property
    def contradicted(self) -> bool:
        """Whether the measured growth lies outside what forces allow, by both intervals."""
        (low, high), (least, most) = self.from_forces.interval95, self.measured.interval95
        return bool(most < low or least > high)


@dataclass(frozen=True)
class SlipBin:
    """Cells of one range of slip together.

    Attributes
    ----------
    slip, vertical_load_n : means
    sinkage_m : Estimate
        From forces.
    if_peak_stays_m, if_peak_moves_m : medians, given where the stress peaks; see `Growth`
    noise_m : one-sigma from noise of the channels alone
    tells : whether the band is narrower than what is known without forces, `WITHOUT_FORCES`
    """

    slip: float
    vertical_load_n: float
    sinkage_m: Estimate
    if_peak_stays_m: float
    if_peak_moves_m: float
    noise_m: float
    measured_m: float
    samples: int
    tells: bool = True


@dataclass(frozen=True)
class ForceSinkage:
    """Sinkage from forces.

    Attributes
    ----------
    draws_m : float64 array, shape (m, n)
        Sinkage of every cell in every draw of shape, noise and zeros.
    as_usual : int array, shape (m,)
        Draws, each as often as wheels are as deep as in it. The growth counts every draw once.
    """

    cells: ForceCells
    draws_m: FloatArray
    shapes: Shapes
    as_usual: IndexArray

    def bins(self) -> list[SlipBin]:
        """Return the sinkage per range of slip (of a table: per row), by slip."""
        found = [self._bin(self.cells.bin == number) for number in np.unique(self.cells.bin)]
        return sorted(found, key=lambda slip_bin: slip_bin.slip)

    def _bin(self, inside: BoolArray) -> SlipBin:
        cells, weights = self.cells, self.cells.samples[inside].astype(np.float64)
        share = weights / weights.sum()
        draws, stays = (self.draws_m[:, inside] @ share)[self.as_usual], self.shapes.peak_stays[self.as_usual]
        found = estimate(draws)
        width = found.interval95[1] - found.interval95[0]
        return SlipBin(
            slip=float(cells.forces.slip[inside] @ share),
            vertical_load_n=float(cells.forces.vertical_load_n[inside] @ share),
            sinkage_m=found,
            if_peak_stays_m=estimate(draws[stays]).value,
            if_peak_moves_m=estimate(draws[~stays]).value,
            noise_m=float(np.sqrt(np.sum((share * cells.noise_m[inside]) ** 2))),
            measured_m=_of_known(cells.measured_m[inside], share),
            samples=int(weights.sum()),
            tells=bool(width < (WITHOUT_FORCES[1] - WITHOUT_FORCES[0]) * cells.radius_m),
        )

    def growth(self) -> Growth:
        """Return the growth with slip: one slope for all groups, each with a level of its own."""
        levels, reason = _levels(self.cells)
        stays = self.shapes.peak_stays
        slopes = _slopes(self.cells, levels, self.draws_m)
        return Growth(
            from_forces=estimate(slopes),
            if_peak_stays=estimate(slopes[stays]),
            if_peak_moves=estimate(slopes[~stays]),
            measured=_measured_growth(self.cells, levels),
            reason=reason,
        )


def sinkage_from_forces(
    cells: ForceCells, rng: np.random.Generator, ranges: ShapeRanges | None = None, draws: int = DRAWS
) -> ForceSinkage:
    """Return the sinkage that the forces of a wheel ask for.

    Parameters
    ----------
    draws : of the shape of the stress; noise and zeros are drawn along
    """
    shapes = draw_shapes(ranges or ShapeRanges(), draws, rng)
    forces = cells.forces
    ratios = forces.ratios(cells.radius_m)
    plain = sinkage_of_forces(forces.slip, *ratios, cells.radius_m, shapes, cells.lug_height_m)
    groups = len(cells.names)
    error = cells.noise_m * rng.standard_normal((draws, len(cells)))
    for zero in (cells.pull_zero_m, cells.torque_zero_m):
        error = error + zero * rng.standard_normal((draws, groups))[:, cells.group]
    central = cells.central_m
    share = np.divide(error, central, out=np.zeros_like(error), where=central > 0.0)
    return ForceSinkage(cells, np.maximum(plain * (1.0 + share), 0.0), shapes, _as_usual(plain, cells.radius_m))


def _as_usual(sinkage_m: FloatArray, radius_m: float) -> IndexArray:
    """Return draws of shape (m, n), each as often as wheels are as deep as in its mean.

    ln(Z/r) is normal, see `_USUAL_LN`.
    """
    mean = np.nansum(sinkage_m, axis=1) / max(sinkage_m.shape[1], 1) / radius_m
    off = (np.log(np.maximum(mean, _SHALLOW)) - _USUAL_LN[0]) / _USUAL_LN[1]
    total = np.cumsum(np.exp(-0.5 * (off**2 - np.min(off**2))))
    return np.asarray(np.searchsorted(total, total[-1] * (np.arange(len(total)) + 0.5) / len(total)))


def estimate(draws: FloatArray) -> Estimate:
    """Return the median and the 95 % interval of draws; NaN without any."""
    known = draws[np.isfinite(draws)]
    if not len(known):
        return Estimate(np.nan, (np.nan, np.nan))
    low, middle, high = (float(x) for x in np.percentile(known, [2.5, 50.0, 97.5]))
    return Estimate(middle, (low, high))


def _levels(cells: ForceCells) -> tuple[IndexArray, Note | None]:
    """Return which cells share a level, and why the growth is not identifiable (None where it is)."""
    slip, group = cells.forces.slip, cells.group
    spans = [np.ptp(slip[group == g]) for g in np.unique(group)]
    if len(slip) > 2 and max(spans) >= _LEAST_SPAN:
        return group, None
    if len(slip) > 2 and np.ptp(slip) >= _LEAST_SPAN:
        return np.zeros_like(group), None
    return group, Note(SinkageCode.GROWTH_UNKNOWN, values={"slip_span": _LEAST_SPAN})


def _slopes(cells: ForceCells, levels: IndexArray, values: FloatArray) -> FloatArray:
    """Return the slope over slip of every row of values (m, n), each level having its own height; shape (m,)."""
    slip = cells.forces.slip
    central = cells.central_m
    weights = np.where(central > 0.0, 1.0, 0.0) / (cells.noise_m**2 + (_OWN_SHARE * central) ** 2 + 1e-12)
    centred = slip.copy()
    for level in np.unique(levels):
        inside = levels == level
        if weights[inside].sum() > 0.0:
            centred[inside] -= np.average(slip[inside], weights=weights[inside])
    leverage = weights * centred
    bottom = float(leverage @ centred)
    if len(slip) < 3 or bottom <= 0.0 or np.ptp(centred) < 0.5 * _LEAST_SPAN:
        return np.full(len(values), np.nan)
    return np.asarray(values @ leverage / bottom)


def _of_known(measured_m: FloatArray, share: FloatArray) -> float:
    """Return the weighted mean of the cells with measured sinkage; NaN where there is none."""
    known = np.isfinite(measured_m)
    if known.all() or not known.any():
        return float(measured_m @ share)
    return float(measured_m[known] @ share[known] / share[known].sum())


def _measured_growth(cells: ForceCells, levels: IndexArray) -> Estimate:
    """Return the slope of the measured sinkage; its interval from what it leaves."""
    there = np.isfinite(cells.measured_m)
    slip, measured, level = cells.forces.slip[there], cells.measured_m[there], levels[there]
    columns = np.column_stack([slip, *(level == number for number in np.unique(level))])
    freedom = len(slip) - columns.shape[1]
    if freedom < 1 or np.ptp(slip) < _LEAST_SPAN or np.linalg.matrix_rank(columns) < columns.shape[1]:
        return Estimate(np.nan, (np.nan, np.nan))
    found = np.linalg.lstsq(columns, measured, rcond=None)[0]
    left = measured - columns @ found
    variance = np.linalg.inv(columns.T @ columns)[0, 0] * (left @ left) / freedom
    half = float(scipy.special.stdtrit(freedom, 0.975) * np.sqrt(variance))
    return Estimate(float(found[0]), (float(found[0]) - half, float(found[0]) + half))
