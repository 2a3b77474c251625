r"""How the vehicle moves: the accelerometer of the outboard mass, and the ground speed at the wheel in a curve.

An accelerometer that points forward reads the specific force f = dV/dt + g sin(theta), with theta positive nose up: at
rest with its nose up, +g sin(theta). That is what the parts outboard of the transducer need of it, slope included,

.. math:: F_{x,soil} = F_{x,wft} + m_o (\dot V + g \sin\theta) = F_{x,wft} + m_o f ,

so that its reading is taken as it is: without pitch taken off, and without a zero.

The antenna of a receiver of ground speed is at (x_a, y_a), z_a above the wheel's centre, the wheel at (x_w, y_w); x
forward, y left. With the yaw rate r, positive to the left, and the rate of pitch, positive nose up, the rigid vehicle
has at a wheel that is not steered and does not slide sideways

.. math:: V_w = \sqrt{V_a^2 - r^2 (x_a - x_w)^2} - r (y_w - y_a) + \dot\theta z_a .

A front wheel (axle 1) that is steered, and rolls where it points, goes sideways at (V_w + r y_w) tan(delta) besides,
where V_w is its part along the vehicle and delta the steering angle in the middle between the front wheels.

Source: rigid-body kinematics, v_w = v_a + omega x (r_w - r_a); ISO 8855 for axes. Pitch is counted against its y axis.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from math import hypot, isfinite, nan, radians, sqrt

import numpy as np

from daq import BoolArray, FloatArray, Note, SensorSection, Severity, VehicleConfig, WheelSection
from processing.notes import RunCode
from processing.pipeline.blending import blended
from processing.pipeline.filters import CUTOFF_PER_RATE
from processing.pipeline.resampling import OnBase
from processing.processed_run import GROUND_SPEED, Reason
from processing.robust import block_covariance, robust_linear

ON_THE_BODY = "longitudinal_acceleration"
ACCELEROMETERS = ("wheel_acceleration_x", ON_THE_BODY)
"""Roles that can compensate the outboard mass, the one at the hub first."""
STEERED_RADPS = 0.05
"""Yaw rate from which a stretch is steered: a metre of lever arm is 0.05 m/s, the noise of a receiver."""
STEERED_RAD = radians(3.0)
"""Angle of the steered wheels that turns a vehicle of 3 m wheelbase at that rate at 3 m/s."""
_NEARLY = 0.95
"""A rate is known no better."""
_ROWS = 3000
_LEAST_ROWS = 100
_MOST_RATIO, _LEAST_RATIO, _SURE = 3.0, -0.5, 4.0
"""Hills and coasting put dV/dt between these shares of what a right accelerometer reads."""


def usable_accelerometers(roles: Mapping[str, OnBase], cutoff_hz: float) -> tuple[tuple[str, ...], list[Note]]:
    """Return the accelerometers to use, the one at the hub first, and a note on each that is not.

    One that is too slow for the common filter, or contradicts the ground speed, is not used. `cutoff_hz` is that of the
    common filter.
    """
    usable, notes = [], []
    for role in ACCELEROMETERS:
        rate_hz = roles[role].facts.rate_hz if role in roles else nan
        if not isfinite(rate_hz):
            continue
        ratio, sigma = _speed_over(roles[role], roles.get(GROUND_SPEED))
        if rate_hz * CUTOFF_PER_RATE < _NEARLY * cutoff_hz:
            facts = {"role": role, "rate_hz": rate_hz, "least_hz": cutoff_hz / CUTOFF_PER_RATE}
            notes.append(Note(RunCode.ACCELEROMETER_SLOW, Severity.DOUBT, facts))
        elif ratio - _SURE * sigma > _MOST_RATIO or ratio + _SURE * sigma < _LEAST_RATIO:
            facts = {"role": role, "ratio": ratio, "sigma": sigma}
            notes.append(Note(RunCode.ACCELEROMETER_DOUBTED, Severity.DOUBT, facts))
        else:
            usable.append(role)
    return tuple(usable), notes


def _speed_over(accelerometer: OnBase, speed: OnBase | None) -> tuple[float, float]:
    """Return the slope of the ground speed over the accelerometer's reading, and its one-sigma; NaN where unknown."""
    nothing = (nan, nan)
    if speed is None:
        return nothing
    rows = np.flatnonzero((accelerometer.reason == Reason.USED) & (speed.reason == Reason.USED))
    rows = rows[:: max(1, -(-len(rows) // _ROWS))]
    if len(rows) < _LEAST_ROWS:
        return nothing
    matrix = np.column_stack([accelerometer.values[rows], np.ones(len(rows))])
    fit = robust_linear(matrix, speed.slope[rows])
    return float(fit.coefficients[0]), sqrt(block_covariance(matrix, speed.slope[rows], fit.weights)[0, 0])


def speed_at_wheel(
    roles: dict[str, OnBase],
    vehicle: VehicleConfig,
    time_s: FloatArray,
    rate_hz: float,
    kernel_s: float,
    accelerometers: Collection[str],
) -> tuple[dict[str, OnBase], BoolArray | None, list[Note]]:
    """Return the roles with the ground speed carried from the antenna to the wheel, where it could not be, and notes.

    Between the two steps, with ``pitch``, it is blended with an accelerometer (`usable_accelerometers`), which is on
    the body as the antenna is. Where a rate of the vehicle is not known, the speed stays as it was received, and its
    reason is that of the rate. The roles are on `time_s`, with the slope of ``pitch``; `kernel_s` is the standard
    deviation of the filter's kernel.

    The second result, shape (n,), is where the vehicle is steered and the speed is that of the antenna; None where that
    is not known or not so.
    """
    speed, antenna = roles.get(GROUND_SPEED), vehicle.sensors.get(GROUND_SPEED, SensorSection())
    if speed is None:
        return roles, None, []
    needed = {"yaw_rate": antenna.x_m, "pitch": antenna.z_m}
    rates = tuple(role for role, place in needed.items() if role in roles and place is not None)
    steered = None if "yaw_rate" in rates else _steered(roles)
    notes = [Note(RunCode.SPEED_AT_WHEEL, values={"roles": rates})] * bool(rates)
    if steered is not None and steered.any():
        lacking = "places" if "yaw_rate" in roles else "yaw_rate"
        notes.append(Note(RunCode.STEERED, values={"share": float(steered.mean()), "lacking": lacking}))
    if "pitch" in rates:
        speed = _without_nodding(speed, roles["pitch"], antenna.z_m or 0.0, rate_hz, kernel_s)
    if "pitch" in roles and ON_THE_BODY in accelerometers:
        before, speed = speed, blended(speed, roles[ON_THE_BODY], roles["pitch"], time_s, rate_hz, kernel_s)
        values = {"before_mps": before.facts.sigma, "sigma_mps": speed.facts.sigma}
        notes += [Note(RunCode.SPEED_BLENDED, values=values)] * (speed is not before)
    if "yaw_rate" in rates:
        speed = _at_wheel(speed, roles["yaw_rate"], roles.get("steering_angle"), antenna, vehicle.wheel, rate_hz)
    return (roles if speed is roles[GROUND_SPEED] else roles | {GROUND_SPEED: speed}), steered, notes


def _without_nodding(speed: OnBase, pitch: OnBase, height_m: float, rate_hz: float, kernel_s: float) -> OnBase:
    """Return the speed at the height of the wheel's centre."""
    sigma = height_m * pitch.facts.sigma / (sqrt(2.0) * kernel_s)
    return _changed(speed, height_m * pitch.slope, sigma, pitch, rate_hz)


def _at_wheel(
    speed: OnBase,
    turning: OnBase,
    steering: OnBase | None,
    antenna: SensorSection,
    wheel: WheelSection | None,
    rate_hz: float,
) -> OnBase:
    """Return the speed at the wheel in a curve; the steering turns the front wheels only."""
    at = ((wheel.x_m or 0.0), (wheel.y_m or 0.0)) if wheel else (0.0, 0.0)
    ahead_m, left_m = (antenna.x_m or 0.0) - at[0], (antenna.y_m or 0.0) - at[1]
    tangent = np.zeros(1)
    if steering is not None and wheel and wheel.axle == 1:
        turning = replace(turning, reason=np.where(turning.reason == Reason.USED, steering.reason, turning.reason))
        tangent = np.tan(steering.values)
    change = _in_a_curve(speed.values, turning.values, ahead_m, left_m, tangent, at[1])
    return _changed(speed, change, left_m * turning.facts.sigma, turning, rate_hz)


def _changed(speed: OnBase, change_mps: FloatArray, sigma_mps: float, rate: OnBase, rate_hz: float) -> OnBase:
    """Return the speed with a change that a rate of the vehicle gives; excluded where that is not known."""
    known = np.where(np.isfinite(change_mps), change_mps, 0.0)
    return OnBase(
        speed.values + known,
        speed.slope + np.gradient(known) * rate_hz,
        np.where(speed.reason == Reason.USED, rate.reason, speed.reason),
        replace(speed.facts, sigma=hypot(speed.facts.sigma, sigma_mps)),
    )


def _in_a_curve(
    speed_mps: FloatArray,
    yaw_rate_radps: FloatArray,
    ahead_m: float,
    left_m: float,
    tangent: FloatArray,
    wheel_left_m: float,
) -> FloatArray:
    """Return the speed at which the wheel rolls less that of the antenna, so far ahead of it and to its left.

    `tangent` is that of the steering angle. Of the antenna, forward - r l and forward t + r d are the two parts.
    """
    d, over = ahead_m + wheel_left_m * tangent, 1 + tangent**2
    root = np.sqrt(np.maximum(over * speed_mps**2 - (yaw_rate_radps * (d + tangent * left_m)) ** 2, 0.0))
    forward = (np.sign(speed_mps) * root + yaw_rate_radps * (left_m - tangent * d)) / over
    rolling = np.hypot(forward, (forward + yaw_rate_radps * wheel_left_m) * tangent)
    return np.asarray(np.copysign(rolling, forward) - speed_mps)


def _steered(roles: Mapping[str, OnBase]) -> BoolArray | None:
    found = [
        np.abs(roles[role].values) > least
        for role, least in (("yaw_rate", STEERED_RADPS), ("steering_angle", STEERED_RAD))
        if role in roles
    ]
    return np.logical_or.reduce(found) if found else None
