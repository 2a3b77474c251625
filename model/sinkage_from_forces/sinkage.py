r"""Sinkage of a driven wheel from load, drawbar pull, torque and radius alone: no soil parameter, no sinkage sensor.

Where the normal stress has the shape :math:`(\cos\theta-\cos\theta_1)^n` in front of its peak and the same, mirrored,
behind it, and the shear stress is a share m of it, the two ratios Dp/W and T/(r W) fix m and the entry angle. With
C, S and F the integrals of the shape against cos, sin and 1:

.. math:: t = T/(rW) = mF/(C+mS), \qquad Dp/W = (mC-S)/(C+mS), \qquad Z = r(1-\cos\theta_1)

What is not known of the shape is drawn from published ranges (`ShapeRanges`). How the shear stress is spread along
the patch hardly matters: where it builds up over K of .01 to .11 r and has a cohesive part of up to .3 of the peak
stress, a known shape gives the sinkage to .9 % (rms of 800 random wheels, 6 % at worst); `ShapeRanges.spread` has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import BoolArray, FloatArray
from model.wheel_soil.contact import rule
from model.wheel_soil.stresses import geometry

_NODES, _POWER = 12, 3
_STEPS = 40
_CLOSE = 1e-6
_LEAST = 1e-9
_LEAST_ANGLE, _MOST_ANGLE = 1e-4, 0.5 * np.pi

_ONE = np.ones(1)


@dataclass(frozen=True)
class ShapeRanges:
    """What is published of the stress under a wheel, each evenly likely within its range.

    Attributes
    ----------
    peak_at_slip_0 : (low, high)
        c1 of theta_m = (c1 + c2 s) theta_1: published .18 to .43, and .05 less, since both ends are soils; .58 to .82
        in granular simulations.
    peak_with_slip : c2, the same in every soil
    peak_at_bottom : float
        Probability that the peak stays at the bottom instead (c1 = c2 = 0), as in Yang et al. (2016); wheels whose
        stress was measured have it ahead.
    exponent : (low, high)
        n, of natural soils (`model.wheel_soil.soils.SOILS`, and .47 to 1.15 in Wong and Reece's sands).
    exit : (low, high)
        Angle of exit behind the bottom, as a share of theta_1.
    no_exit : probability that contact ends at the bottom at slip 0 instead, as in both papers
    exit_with_slip : (low, high)
        By how much the angle of exit grows from slip 0 to 1, as a share of theta_1, where the peak is ahead: .75 in two
        granular simulations (material points, a rough rigid wheel of .15 m), from .05-.3 to .7-.8 at slip .8.
    no_exit_growth : probability that it is the same at every slip there, too, as published models have it
    radius_sigma : relative one-sigma of the wheel's radius
    spread : relative one-sigma of the sinkage that the shape of the shear stress leaves open
    bow_wave : (low, high)
        Share of the resistance T/r - Dp that soil pushed in front of the wheel gives, and not the stress under it.
    no_bow_wave : probability that there is none
    wheel_sigma : relative one-sigma of the sinkage from what else differs, alike in all rows of a wheel

    Notes
    -----
    With a peak up to .48, the exponent and a constant exit alone 20 of 23 rows of four wheels' tests are in the band,
    and all that are not are below it. `bow_wave` is after Ishigami et al. (2007); up to .4 puts those rows into the
    band. A peak up to .65 and an exit that grows with slip do so with the 16 driven rows of a granular simulation
    (studies/granular). `wheel_sigma` is the scatter of the wheels' mean ln(measured / median), .125, widened for the
    four that it comes from (docs/sinkage.md).

    Source: Wong & Reece (1967), J. Terramechanics 4(1):81-98 (c1 .18 loose sand, .43 compact sand, c2 .32); Wong,
    Theory of Ground Vehicles (2008), for n; exit angles of natural soil after Ishigami et al. (2007); studies/granular
    for exit angles that grow with slip.
    """

    peak_at_slip_0: tuple[float, float] = (0.13, 0.65)
    peak_with_slip: float = 0.32
    peak_at_bottom: float = 1 / 3
    exponent: tuple[float, float] = (0.5, 1.4)
    exit: tuple[float, float] = (0.0, 0.2)
    no_exit: float = 0.5
    radius_sigma: float = 0.01
    spread: float = 0.01
    bow_wave: tuple[float, float] = (0.0, 0.4)
    no_bow_wave: float = 0.5
    wheel_sigma: float = 0.2
    exit_with_slip: tuple[float, float] = (0.0, 0.8)
    no_exit_growth: float = 0.5


@dataclass(frozen=True)
class Shapes:
    """Drawn shapes of the normal stress; every array has shape (m, 1).

    Attributes
    ----------
    peak_at_slip_0, peak_with_slip : c1, c2
    exit, exit_with_slip : theta_2 = -(exit + exit_with_slip slip) theta_1
    radius_factor : true over declared radius
    sinkage_factor : for what the shape of the shear stress leaves open, and what else differs from wheel to wheel
    bow_wave : share of the resistance that is in front of the wheel
    lug_share : share of the height of declared lugs at which torque acts outside the radius
    """

    peak_at_slip_0: FloatArray
    peak_with_slip: FloatArray
    exponent: FloatArray
    exit: FloatArray
    radius_factor: FloatArray
    sinkage_factor: FloatArray
    bow_wave: FloatArray
    lug_share: FloatArray
    exit_with_slip: FloatArray

    def __len__(self) -> int:
        return len(self.exponent)

    @property
    def peak_stays(self) -> BoolArray:
        """Whether the peak stays at the bottom, shape (m,)."""
        return np.asarray(self.peak_with_slip[:, 0] == 0.0)


def _alone(value: float) -> FloatArray:
    return np.full((1, 1), value)


CENTRAL = Shapes(*map(_alone, (0.305, 0.32, 1.0, 0.0, 1.0, 1.0, 0.0, 0.5, 0.0)))
"""One shape in the middle of what is published, to carry noise through."""


def draw_shapes(ranges: ShapeRanges, count: int, rng: np.random.Generator) -> Shapes:
    """Draw shapes of the stress from their ranges."""
    moves = rng.permutation(count) >= round(ranges.peak_at_bottom * count)
    leaves = rng.permutation(count) >= round(ranges.no_exit * count)

    def column(values: FloatArray) -> FloatArray:
        return np.asarray(values, np.float64)[:, None]

    peak = np.where(moves, rng.uniform(*ranges.peak_at_slip_0, count), 0.0)
    exponent = rng.uniform(*ranges.exponent, count)
    exit = np.where(leaves, rng.uniform(*ranges.exit, count), 0.0)
    radius = np.exp(ranges.radius_sigma * rng.standard_normal(count))
    factor = np.exp(np.hypot(ranges.spread, ranges.wheel_sigma) * rng.standard_normal(count))
    grows = rng.uniform(*ranges.exit_with_slip, count)
    pushes = rng.permutation(count) >= round(ranges.no_bow_wave * count)
    return Shapes(
        column(peak),
        column(np.where(moves, ranges.peak_with_slip, 0.0)),
        column(exponent),
        column(exit),
        column(radius),
        column(factor),
        column(np.where(pushes, rng.uniform(*ranges.bow_wave, count), 0.0)),
        column(rng.uniform(0.0, 1.0, count)),
        column(np.where(moves & (rng.permutation(count) >= round(ranges.no_exit_growth * count)), grows, 0.0)),
    )


def entry_angle_of_forces(
    pull_ratio: FloatArray, torque_ratio: FloatArray, peak: FloatArray, exponent: FloatArray, exit: FloatArray
) -> FloatArray:
    """Return theta_1 in rad for the two ratios Dp/W and T/(r W), of shapes that broadcast.

    `peak` is theta_m/theta_1, 0 to below 1, and `exit` is -theta_2/theta_1. The angle is 0 where the forces leave no
    resistance to motion, pi/2 where the wheel would be in beyond its axle; NaN where an input is.
    """
    pull_ratio, torque_ratio, peak, exponent, exit = np.broadcast_arrays(
        *(np.asarray(x, np.float64) for x in (pull_ratio, torque_ratio, peak, exponent, exit))
    )

    def excess(angle: FloatArray) -> FloatArray:
        return pull_of(angle, torque_ratio, peak, exponent, exit) - pull_ratio

    low = np.full(pull_ratio.shape, _LEAST_ANGLE)
    high = np.full(pull_ratio.shape, _MOST_ANGLE)
    at_low, at_high = excess(low), excess(high)
    shallow, deep = at_low <= 0.0, at_high >= 0.0
    angle = 0.5 * (low + high)
    for _ in range(_STEPS):
        # regula falsi after Illinois: an end that stays counts half
        between = np.where(shallow | deep, 1.0, at_high - at_low)
        angle = np.clip((low * at_high - high * at_low) / between, _LEAST_ANGLE, _MOST_ANGLE)
        value = excess(angle)
        below = value > 0.0
        at_high = np.where(below, np.where(low == angle, at_high, 0.5 * at_high), value)
        at_low = np.where(below, value, 0.5 * at_low)
        low, high = np.where(below, angle, low), np.where(below, high, angle)
        if not np.any(np.abs(np.where(shallow | deep, 0.0, value)) > _CLOSE):
            break
    found = np.where(shallow, 0.0, np.where(deep, _MOST_ANGLE, angle))
    return np.where(np.isfinite(pull_ratio + torque_ratio), found, np.nan)


def shear_share(pull_ratio: FloatArray, torque_ratio: FloatArray) -> FloatArray:
    """Return m, shear over normal stress, that the forces ask for with the `CENTRAL` shape at slip 0.

    Very large where no such share turns the wheel.
    """
    shape = (CENTRAL.peak_at_slip_0[0], CENTRAL.exponent[0], CENTRAL.exit[0])
    angle = np.maximum(entry_angle_of_forces(pull_ratio, torque_ratio, *shape), _LEAST_ANGLE)
    against_cos, against_sin, against_one = _integrals(angle, *shape)
    return _share(np.asarray(torque_ratio), against_cos, against_sin, against_one)


def _share(
    torque_ratio: FloatArray, against_cos: FloatArray, against_sin: FloatArray, against_one: FloatArray
) -> FloatArray:
    left = np.maximum(against_one - torque_ratio * against_sin, _LEAST * against_one)
    return np.asarray(torque_ratio * against_cos / left)


def pull_of(
    entry_angle: FloatArray, torque_ratio: FloatArray, peak: FloatArray, exponent: FloatArray, exit: FloatArray
) -> FloatArray:
    """Return Dp/W of a wheel in at an angle that turns with a torque; see `entry_angle_of_forces`."""
    against_cos, against_sin, against_one = _integrals(entry_angle, peak, exponent, exit)
    share = _share(torque_ratio, against_cos, against_sin, against_one)
    return (share * against_cos - against_sin) / (against_cos + share * against_sin)


def sinkage_of_forces(
    slip: FloatArray,
    pull_ratio: FloatArray,
    torque_ratio: FloatArray,
    radius_m: float,
    shapes: Shapes,
    lug_height_m: float = 0.0,
) -> FloatArray:
    """Return the sinkage in m for every drawn shape, shape (m, n).

    Parameters
    ----------
    slip : float64 array, shape (n,)
    pull_ratio, torque_ratio : float64 arrays that broadcast to (m, n)
        Dp/W and T/(r W) with the declared radius.
    radius_m : as declared
    lug_height_m : as declared; torque acts at the radius and a part of it
    """
    arm = shapes.radius_factor + shapes.lug_share * lug_height_m / radius_m
    in_front = shapes.bow_wave * np.maximum(torque_ratio / arm - pull_ratio, 0.0)
    angle = entry_angle_of_forces(
        pull_ratio + in_front,
        torque_ratio / arm,
        shapes.peak_at_slip_0 + shapes.peak_with_slip * slip,
        shapes.exponent,
        shapes.exit + shapes.exit_with_slip * slip,
    )
    deepest = np.minimum(2.0 * np.sin(0.5 * angle) ** 2 * shapes.sinkage_factor, 1.0)
    return np.asarray(radius_m * shapes.radius_factor * deepest)


def _integrals(
    entry: FloatArray, peak: FloatArray, exponent: FloatArray, exit: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the integrals of the stress's shape against cos, sin and 1.

    In front of the peak and behind it the stress has the same values at the same share of the way from where it
    vanishes, so that both parts take one set of nodes.
    """
    nodes = rule(_NODES, _POWER, "start")
    at, weights = nodes.at, nodes.weights
    entry, peak, exponent, exit = (x[..., None] for x in np.broadcast_arrays(entry, peak, exponent, exit))
    front, rear = entry * (1.0 - peak), entry * (peak + exit)
    stress = weights * np.exp(exponent * np.log(geometry(entry, front * at)[0]))
    before, behind = entry - front * at, rear * at - entry * exit

    def total(of_front: FloatArray, of_rear: FloatArray) -> FloatArray:
        return np.asarray(np.sum(stress * (front * of_front + rear * of_rear), axis=-1))

    return total(np.cos(before), np.cos(behind)), total(np.sin(before), np.sin(behind)), total(_ONE, _ONE)
