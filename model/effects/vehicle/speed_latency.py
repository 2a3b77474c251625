"""The ground speed arrives later than the vehicle file declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, FirstEstimate, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Conditions


class SpeedLatency(Effect):
    """The speed shown at t is that of t - L: V(t) = V_m + L a + L^2/2 da/dt; L > 0 where it is late.

    The series stands for the shift as long as L is short against the changes of the acceleration.
    """

    name = "speed_latency"
    kind = "measurement"
    summary = (
        "The ground speed is measured later (or, if negative, earlier) than declared: slip is wrong while speeding up."
    )
    source = "Taylor's series; Racelogic (2014), VBOX data sheets: 4 to 42 ms, 160 ms of a receiver at 5 Hz"
    shows = ("ground_speed",)
    parameters = (
        Parameter("extra_delay_s", "s", 0.0, 0.1, -0.6, 0.6, 0.2, "receivers' data sheets; undeclared filter delays"),
    )
    needs = Needs(conditions=("ground_speed_mps", "ground_acceleration_mps2", "ground_jerk_mps3"))
    starts = (-1.0, -0.4, 0.4, 1.0)
    first_estimate = FirstEstimate("residual_latency_s", notable=0.06)

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with ground speed and acceleration of the moment itself."""
        delay, a, jerk = values["extra_delay_s"], conditions.ground_acceleration_mps2, conditions.ground_jerk_mps3
        speed = conditions.ground_speed_mps + delay * a + 0.5 * delay * delay * jerk
        return replace(conditions.with_ground_speed(speed), ground_acceleration_mps2=a + delay * jerk)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the ground speed of an earlier moment; before the first sample it is constant."""
        shown = np.interp(signals.time_s - values["extra_delay_s"], signals.time_s, signals.ground_speed_mps)
        return replace(signals, ground_speed_mps=shown)
