"""Errors of the speeds and of the radius from which the slip is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from model.effects.base import Correction, Effect, FirstEstimate, Needs, Parameter, Remedy, Signals, Values
from model.wheel_soil import Conditions, Reaction, WheelState, value_of, where

STANDSTILL_MPS = 0.05
"""Below it a receiver holds its speed at zero, so that no bias shows."""


class WheelRadius(Effect):
    """True r (1 + e) in the slip, not in the stresses: true V/(r omega) = measured V/(r omega) / (1 + e)."""

    name = "wheel_radius"
    kind = "measurement"
    summary = (
        "The rolling radius from which the slip is computed is wrong by a share: slip is not zero where it should be."
    )
    each_wheel = True
    source = "Yang et al. (2016), Eq. 6; the effective radius of a tyre changes by 1 to 3 % with load and wear"
    error_text = "Slip is shifted: the rolling radius is {percent} {larger/smaller} than stated"
    abscissa = "slip"
    shows = ("wheel_speed",)
    parameters = (
        Parameter("relative", "1", 0.0, 0.02, -0.2, 0.2, 0.03, "effective rolling radius against the declared one"),
    )
    remedy = Remedy(
        "Measure the rolling radius on firm ground; these runs suggest the value below for vehicle.toml.",
        (Correction("rolling_radius_m", share_of="rolling_m", form=".4f"),),
    )

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the slip of the true radius."""
        return conditions.with_speed_ratio_times(1.0 / (1.0 + values["relative"]))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the wheel speed of the larger wheel: slower at the same speed of its rim."""
        return replace(signals, wheel_speed_radps=signals.wheel_speed_radps / (1.0 + values["relative"]))


class SpeedLatency(Effect):
    """The speed shown at t is that of t - L: V(t) = V_m + L a + L^2/2 da/dt; L > 0 where it is late.

    Conditions that know the speed of other moments are shifted by L, others may be by a part of it
    (`ground_speed_shift_s`). The series is for the rest, and for derivatives: it holds while that rest is short against
    changes of the acceleration.
    """

    name = "speed_latency"
    kind = "measurement"
    summary = (
        "The ground speed is measured later (or, if negative, earlier) than declared: slip is wrong while speeding up."
    )
    source = "Taylor's series; Racelogic (2014), VBOX data sheets: 4 to 42 ms, 160 ms of a receiver at 5 Hz"
    error_text = "The ground speed comes {size} {later/earlier} than declared"
    abscissa = "acceleration"
    shows = ("ground_speed",)
    parameters = (
        Parameter("extra_delay_s", "s", 0.0, 0.1, -0.6, 0.6, 0.2, "receivers' data sheets; undeclared filter delays"),
    )
    needs = Needs(conditions=("ground_speed_mps", "ground_acceleration_mps2", "ground_jerk_mps3"))
    starts = (-1.0, -0.4, 0.4, 1.0)
    first_estimate = FirstEstimate("residual_latency_s", notable=0.06)
    remedy = Remedy(
        "Check the delay of the ground speed; these runs suggest the value below for vehicle.toml.",
        (Correction("latency_s", role="ground_speed", form=".3f"),),
    )

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with ground speed and acceleration of the moment itself."""
        conditions = conditions.at_delay(values["extra_delay_s"])
        delay = values["extra_delay_s"] - conditions.ground_speed_shift_s
        a, jerk = conditions.ground_acceleration_mps2, conditions.ground_jerk_mps3
        speed = conditions.ground_speed_mps + delay * a + 0.5 * delay * delay * jerk
        return replace(conditions.with_ground_speed(speed), ground_acceleration_mps2=a + delay * jerk)

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the drawbar pull as it was compensated, by the acceleration of the late speed."""
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + state.conditions.miscompensated_n)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the ground speed of an earlier moment; before the first sample it is constant."""
        shown = np.interp(signals.time_s - values["extra_delay_s"], signals.time_s, signals.ground_speed_mps)
        return replace(signals, ground_speed_mps=shown)


DELAY = SpeedLatency.parameter_keys()["extra_delay_s"]
"""Name of the ground speed's delay among the parameters of a model."""


class SpeedBias(Effect):
    """V_m = V + b, but not at standstill."""

    name = "speed_bias"
    kind = "measurement"
    summary = "The ground speed is off by a constant: slip is wrong by more, the slower the vehicle goes."
    source = "Racelogic (2014), VBOX data sheets: 0.1 km/h as a mean of four samples"
    error_text = "The ground speed reads {size} {too much/too little}"
    abscissa = "speed"
    shows = ("ground_speed",)
    parameters = (Parameter("offset_mps", "m/s", 0.0, 0.05, -0.5, 0.5, 0.10, "receivers' data sheets"),)
    needs = Needs(conditions=("ground_speed_mps",))
    remedy = Remedy("Compare ground speed with rim speed where the wheel rolls freely, and repeat the diagnosis.")
    stage = 4

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true ground speed."""
        shown = conditions.ground_speed_mps
        moving = value_of(shown) > STANDSTILL_MPS
        return conditions.with_ground_speed(where(moving, shown - values["offset_mps"], shown))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the ground speed with its offset."""
        speed = signals.ground_speed_mps
        shown = where(speed > STANDSTILL_MPS, (speed + values["offset_mps"]).clip(min=0.0), speed)
        return replace(signals, ground_speed_mps=shown)
