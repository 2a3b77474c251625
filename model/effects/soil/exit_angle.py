"""Soil rebounds and stays in contact behind the bottom of the wheel."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, Parameter, Values
from model.wheel_soil.dual import Number, value_of, where

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.contact import Patch

SMALLEST = 0.01
"""Below it theta_2 runs into zero with a slope instead of as a root, whose derivative at neutral is infinite."""


class ExitAngle(Effect):
    """theta_2 = -acos(1 - lambda Z/r), with lambda Z the height of the rebound.

    Behind theta_m (0, unless stress_peak_shift moves it) the stress falls to zero at theta_2 as in stress_peak_shift.
    """

    name = "exit_angle"
    summary = "The soil springs back behind the wheel and pushes it: contact ends behind the lowest point."
    source = "Ishigami et al. (2007), J. Field Robotics 24(3):233-250 (wheel sinkage ratio); Wong & Reece (1967)"
    parameters = (
        Parameter("lambda", "1", 0.0, 0.1, 0.0, 0.9, 0.25, "0 to .2 on natural soil; up to .9 in rover codes", side=1),
    )
    secant = True

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with its exit; 1 - cos x = 2 sin^2(x/2) on both sides."""
        half = _root(values["lambda"]) * np.sin(patch.entry_angle * 0.5)
        return replace(patch, exit_angle=-2.0 * np.arcsin(half))


def _root(share: Number) -> Number:
    """Return sqrt(share), below `SMALLEST` the parabola through 0 that goes on without a kink."""
    small = value_of(share) < SMALLEST
    ratio = share * (1.0 / SMALLEST)
    return where(small, sqrt(SMALLEST) * ratio * (1.5 - 0.5 * ratio), np.sqrt(where(small, SMALLEST, share)))
