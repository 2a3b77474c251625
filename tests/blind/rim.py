"""Stresses on the rim and their resultants, by the trapezium rule after Sidi's transformation.

Nothing here is shared with the engine: it has Gauss-Legendre nodes on a power map and Newton on its own derivatives;
this has evenly spaced nodes, whose ends Sidi's sin^2 transformation makes vanish, and a secant on ln z.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq import FloatArray

Column = FloatArray | float

NODES = 40
_CHUNK = 1500


def _sidi(nodes: int) -> tuple[FloatArray, FloatArray]:
    """Return places on 0..1 and weights: phi(u) = u - sin(2 pi u)/(2 pi) on an even grid."""
    u = np.arange(1, nodes) / nodes
    return u - np.sin(2 * np.pi * u) / (2 * np.pi), (1 - np.cos(2 * np.pi * u)) / nodes


def janosi(j: FloatArray, modulus: Column) -> FloatArray:
    """Janosi and Hanamoto: the share of the shear strength, with the sign of j."""
    return np.sign(j) * -np.expm1(-np.abs(j) / modulus)


Shear = Callable[[FloatArray, Column], FloatArray]


@dataclass(frozen=True)
class Rim:
    """A wheel in soil, per sample (columns (n, 1) or scalars), SI.

    `ratio` is V/(r omega); `peak` and `exit_share` place theta_m = peak * theta_1 and
    theta_2 = -arccos(1 - exit_share * z/R), or `exit_angle` if that is not 0. `lug` lengthens the shear radius and the
    arm, `lug_arm` the arm alone; the normal stress does not exceed `most_pa`.
    """

    ratio: Column
    radius: Column
    width: float
    cohesion: Column
    friction: Column
    shear_modulus: Column
    stiffness: Column
    exponent: Column
    peak: Column = 0.0
    exit_share: Column = 0.0
    exit_angle: Column = 0.0
    lug: float = 0.0
    lug_arm: float = 0.0
    shear: Shear = janosi
    most_pa: float = np.inf

    def rows(self, chosen: slice | NDArray[np.intp]) -> Rim:
        """Return some of the samples."""
        cut = {
            name: value[chosen]
            for name in self.__dataclass_fields__
            if isinstance(value := getattr(self, name), np.ndarray)
        }
        return Rim(**{**{name: getattr(self, name) for name in self.__dataclass_fields__}, **cut})


@dataclass(frozen=True)
class Sums:
    """Resultants, shape (n, 1): what grows with the normal stress, and what cohesion adds."""

    load: FloatArray
    load_cohesion: FloatArray
    pull: FloatArray
    pull_cohesion: FloatArray
    torque: FloatArray
    torque_cohesion: FloatArray


def sums(rim: Rim, sinkage: FloatArray, nodes: int = NODES) -> Sums:
    """Integrate over the patch; `sinkage` is a column (n, 1)."""
    parts = []
    for start in range(0, len(sinkage), _CHUNK):
        rows = slice(start, start + _CHUNK)
        parts.append(_sums(rim.rows(rows), sinkage[rows], nodes))
    return Sums(*(np.concatenate([getattr(p, name) for p in parts]) for name in Sums.__dataclass_fields__))


def _sums(rim: Rim, sinkage: FloatArray, nodes: int) -> Sums:
    with np.errstate(invalid="ignore"):
        entry = np.arccos(1 - sinkage / rim.radius)
    exit_ = -np.arccos(1 - rim.exit_share * sinkage / rim.radius) + rim.exit_angle
    middle = rim.peak * entry
    cuts = [entry, middle, exit_] if np.any(middle != exit_) else [entry, middle]
    cuts = _with_turning_point(rim, entry, cuts)
    total = [0.0] * 6
    for upper, lower in itertools.pairwise(cuts):
        panel = _panel(rim, (entry, middle, exit_), upper, lower, nodes)
        total = [a + b for a, b in zip(total, panel, strict=True)]
    area, arm = rim.radius * rim.width, rim.radius + rim.lug_arm
    scale = (area, area, area, area, area * arm, area * arm)
    return Sums(*(np.asarray(a * b) for a, b in zip(scale, total, strict=True)))


def _with_turning_point(rim: Rim, entry: FloatArray, cuts: list[FloatArray]) -> list[FloatArray]:
    """Add the angle where a braked rim's j changes its sign, by bisection from the far end."""
    if not np.any(rim.ratio > 1):
        return cuts
    low, high = np.broadcast_to(cuts[-1], entry.shape).copy(), entry - 1e-6
    turns = (_displacement(rim, entry, low) < 0) & (_displacement(rim, entry, high) > 0)
    for _ in range(40):
        half = 0.5 * (low + high)
        negative = _displacement(rim, entry, half) < 0
        low, high = np.where(negative, half, low), np.where(negative, high, half)
    turning = np.where(turns, low, np.where(_displacement(rim, entry, cuts[-1]) < 0, 0.75 * entry, cuts[-1]))
    inner = [np.broadcast_to(cut, entry.shape) for cut in cuts[1:-1]]
    between = np.sort(np.concatenate([*inner, np.clip(turning, cuts[-1], entry)], axis=1), axis=1)[:, ::-1]
    return [entry, *(between[:, [i]] for i in range(between.shape[1])), cuts[-1]]


def _displacement(rim: Rim, entry: FloatArray, theta: FloatArray) -> FloatArray:
    away = entry - theta
    return (rim.radius + rim.lug) * away - rim.ratio * rim.radius * 2 * np.cos((entry + theta) / 2) * np.sin(away / 2)


def _panel(
    rim: Rim, angles: tuple[FloatArray, ...], upper: FloatArray, lower: FloatArray, nodes: int
) -> tuple[FloatArray, ...]:
    entry, middle, exit_ = angles
    place, weight = _sidi(nodes)
    theta = upper - (upper - lower) * place
    felt = theta
    if np.any(middle != exit_):
        width = np.where(middle - exit_ > 1e-12, middle - exit_, 1.0)
        felt = np.where(theta < middle, entry - (theta - exit_) / width * (entry - middle), theta)
    depth = rim.radius * 2 * np.sin((entry + felt) / 2) * np.sin((entry - felt) / 2)
    sigma = np.minimum(rim.stiffness * np.maximum(depth, 1e-300) ** rim.exponent, rim.most_pa)
    share = rim.shear(_displacement(rim, entry, theta), rim.shear_modulus)
    sin, cos, by = np.sin(theta), np.cos(theta), weight * (upper - lower)
    tau = rim.friction * sigma * share

    def over(integrand: FloatArray) -> FloatArray:
        return np.sum(integrand * by, axis=1, keepdims=True)

    return (
        over(sigma * cos + tau * sin),
        over(rim.cohesion * share * sin),
        over(tau * cos - sigma * sin),
        over(rim.cohesion * share * cos),
        over(tau),
        over(rim.cohesion * share),
    )


def settled(rim: Rim, load: FloatArray, start: FloatArray | None = None, nodes: int = NODES) -> FloatArray:
    """Return the sinkage (n, 1) at which the patch carries the load: a secant on ln z, bisection where that fails."""
    power = np.broadcast_to(np.asarray(rim.exponent) + 0.5, load.shape)
    z = _bekker(rim, load) if start is None else start.copy()
    top = 0.98 * np.broadcast_to(rim.radius, load.shape)
    before, slope = z, power
    miss_before = np.full(load.shape, np.nan)
    open_ = np.ones(len(load), bool)
    for _ in range(12):
        found = sums(rim.rows(np.flatnonzero(open_)), z[open_], nodes)
        miss = np.full(load.shape, np.nan)
        miss[open_] = np.log(np.maximum(found.load + found.load_cohesion, 1.0) / load[open_])
        if np.isfinite(miss_before).any():
            step = np.log(z / before)
            with np.errstate(invalid="ignore", divide="ignore"):
                secant = (miss - miss_before) / step
            slope = np.where(np.isfinite(secant) & (secant > 0.3) & (np.abs(step) > 1e-9), secant, slope)
        before, miss_before = np.where(open_[:, None], z, before), np.where(open_[:, None], miss, miss_before)
        change = np.where(open_[:, None], np.clip(-miss / slope, -0.7, 0.7), 0.0)
        z = np.minimum(z * np.exp(change), top)
        open_ &= ~(np.abs(np.nan_to_num(miss[:, 0])) < 1e-9)
        if not open_.any():
            return z
    z[open_] = _bisected(rim.rows(np.flatnonzero(open_)), load[open_], top[open_])
    return z


def _bisected(rim: Rim, load: FloatArray, top: FloatArray) -> FloatArray:
    low, high = np.full(load.shape, 1e-4), top.copy()
    for _ in range(45):
        half = np.sqrt(low * high)
        found = sums(rim, half)
        less = found.load + found.load_cohesion < load
        low, high = np.where(less, half, low), np.where(less, high, half)
    return np.where(high < 0.999 * top, np.sqrt(low * high), np.nan)


def _bekker(rim: Rim, load: FloatArray) -> FloatArray:
    n = np.asarray(rim.exponent)
    z = (3 * load / ((3 - n) * rim.stiffness * rim.width * np.sqrt(2 * rim.radius))) ** (2 / (2 * n + 1))
    return np.minimum(z, 0.8 * np.broadcast_to(rim.radius, load.shape))
