"""Inputs of the wheel-soil model, sample by sample, and the values that effects read and give back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from daq import BoolArray, IndexArray
from model.wheel_soil import Number, SoilState, value_of, where
from model.wheel_soil.stresses import slip_of_ratio, speed_ratio

REFERENCE_INFLATION_KPA = 340.0
"""Of a tyre whose pressure is not stated."""
USUAL_OUTBOARD_MASS_KG = 75.0
"""Of a wheel of 37 inches: rim, tyre and the outer half of the transducer, where it is not stated."""


@dataclass(frozen=True)
class Wheel:
    """A rigid wheel.

    Attributes
    ----------
    radius_m : r of Eq. 1
    width_m : b of Eq. 2 and 7: width of the contact patch
    """

    radius_m: float
    width_m: float


@dataclass(frozen=True)
class Conditions:
    """Inputs of the model; arrays of shape (n,), or scalars where one value holds for all.

    Only slip and load are always there. What else an effect needs stands in its ``needs``; NaN: not known.

    Attributes
    ----------
    slip : Eq. 6 when driving, (r omega - V)/V when braking.
    vertical_load_n : > 0
    ground_speed_mps, wheel_speed_radps : V and omega
    ground_acceleration_mps2, ground_jerk_mps3, wheel_acceleration_radps2, wheel_jerk_radps3 : their derivatives
    ground_speed_shift_s : the ground speed and its derivatives are those that were measured so much later
    line_position : x from -1 to 1 along the campaign's line, -1 where "out" starts
    campaign_time : from -1/2 to 1/2 over the campaign's clock
    direction : 1 "out", -1 "back"
    pass_number : of the wheels that have driven over the soil, from 1; see `ProcessedRun.passage`
    inflation_kpa : of the tyre
    unit_weight_n_m3 : of the soil
    compensated_mass_kg : outboard mass whose acceleration, by the ground speed, was added to the measured drawbar pull
    compensated_inertia_kgm2 : outboard inertia whose acceleration was taken off the measured torque
    miscompensated_n : added to the measured drawbar pull, since the acceleration was not that of the moment
    body_pitch_rad : of the body under acceleration, positive nose up; NaN where pitch is not measured
    outboard_mass_kg : between transducer and soil; NaN where an accelerometer took its weight along a slope off
    """

    slip: Number
    vertical_load_n: Number
    ground_speed_mps: Number = np.nan
    wheel_speed_radps: Number = np.nan
    ground_acceleration_mps2: Number = np.nan
    ground_jerk_mps3: Number = np.nan
    wheel_acceleration_radps2: Number = np.nan
    wheel_jerk_radps3: Number = np.nan
    ground_speed_shift_s: Number = 0.0
    line_position: Number = np.nan
    campaign_time: Number = np.nan
    direction: Number = np.nan
    pass_number: Number = 1.0
    inflation_kpa: Number = np.nan
    unit_weight_n_m3: Number = 16_500.0
    compensated_mass_kg: Number = 0.0
    compensated_inertia_kgm2: Number = 0.0
    outboard_mass_kg: Number = USUAL_OUTBOARD_MASS_KG
    body_pitch_rad: Number = np.nan
    miscompensated_n: Number = 0.0

    @property
    def driving_slip(self) -> Number:
        """max(s, 0): the slip-sinkage laws hold for a driven wheel."""
        return where(value_of(self.slip) > 0.0, self.slip, 0.0)

    @property
    def braking_slip(self) -> Number:
        """min(s, 0): for laws of a braked wheel."""
        return where(value_of(self.slip) < 0.0, self.slip, 0.0)

    def with_ground_speed(self, ground_speed_mps: Number) -> Self:
        """Return the conditions with another ground speed, and the slip that belongs to it."""
        return replace(
            self.with_speed_ratio_times(ground_speed_mps / self.ground_speed_mps), ground_speed_mps=ground_speed_mps
        )

    def with_speed_ratio_times(self, factor: Number) -> Self:
        """Return the conditions with V/(r omega), and so the slip, changed by a factor."""
        return replace(self, slip=slip_of_ratio(speed_ratio(self.slip) * factor))

    def at_delay(self, delay_s: Number) -> Conditions:
        """Return the conditions with the ground speed measured so much later; as they are where it is not known."""
        return self

    def rows(self, rows: slice | IndexArray | BoolArray) -> Self:
        """Return the conditions of some samples."""
        return self.map(lambda x: x[rows] if np.ndim(x) else x)

    @classmethod
    def of_a_sample(cls) -> list[str]:
        """Return the fields that each sample has."""
        return [field.name for field in fields(cls)]

    def map(self, function: Callable[[Number], Number]) -> Self:
        """Return the conditions with `function` applied to every field of a sample."""
        return replace(self, **{name: function(getattr(self, name)) for name in self.of_a_sample()})


@dataclass(frozen=True)
class WheelState:
    """Where the wheel is, once the balance is found; columns (n, 1) or scalars, SI.

    Attributes
    ----------
    conditions : Conditions
        The true inputs.
    sinkage : m, Z
    entry_angle : rad, theta_1
    """

    conditions: Conditions
    soil: SoilState
    radius: Number
    width: Number
    sinkage: Number
    entry_angle: Number


@dataclass(frozen=True)
class Reaction:
    """Forces in the wheel's plane: drawbar pull in N and torque in N m, columns (n, 1)."""

    drawbar_pull: Number
    driving_torque: Number
