"""What shapes the contact patch and its stresses: peak and exit, friction at the rim, softening, lugs, a flat tyre."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil import (
    REFERENCE_INFLATION_KPA,
    Conditions,
    Number,
    Patch,
    Reaction,
    SoilState,
    WheelState,
    value_of,
    where,
)

FOREMOST = 0.95
"""Of theta_1: the peak stays behind the entry."""

SMALLEST = 0.01
"""Below it theta_2 runs into zero with a slope instead of as a root, whose derivative at neutral is infinite."""

REFERENCE_LOAD_N = 10e3


class StressPeakShift(Effect):
    """theta_m = (c1 + c2 max(s, 0)) theta_1; behind it the stress falls as it rose in front (Wong & Reece).

    sigma(theta) = k r^n [cos(theta_1 - (theta - theta_2)/(theta_m - theta_2) (theta_1 - theta_m)) - cos theta_1]^n.
    """

    name = "stress_peak_shift"
    summary = "The pressure under the wheel peaks ahead of its lowest point, and farther ahead the more it slips."
    source = "Wong & Reece (1967), J. Terramechanics 4(1):81-98"
    parameters = (
        Parameter(
            *("c1", "1", 0.0, 0.2, 0.0, 0.9, 0.3, "Wong & Reece (1967): .18 loose, .43 compact sand"),
            side=1,
            usual=(0.30, 0.12),
        ),
        Parameter("c2", "1", 0.0, 0.2, 0.0, 0.9, 0.3, "Wong & Reece (1967): .32", side=1, usual=(0.32, 0.15)),
    )

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with its peak."""
        share = values["c1"] + values["c2"] * conditions.driving_slip
        share = where(value_of(share) < FOREMOST, share, FOREMOST)
        return replace(patch, peak_angle=share * patch.entry_angle)


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
        return replace(patch, exit_angle=patch.exit_angle - 2.0 * np.arcsin(half))


class ExitGrowth(Effect):
    """theta_2 = -growth max(s, 0) theta_1; the stress behind theta_m is that of `ExitAngle`.

    Tables name a gain of drawbar pull instead without it. Runs do not: they are unexplained.
    """

    name = "exit_angle"
    form = "exit_growth"
    summary = "Slip carries soil behind the wheel, which pushes it."
    source = "two granular simulations (2026), studies/granular"
    parameters = (Parameter("growth", "1", 0.0, 0.2, 0.0, 1.0, 0.4, ".7 to .8 theta_1 at slip .8", side=1),)
    needs = Needs(largest_slip=0.15)
    of_tables = True

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with its exit."""
        grown = values["growth"] * conditions.driving_slip * patch.entry_angle
        return replace(patch, exit_angle=patch.exit_angle - grown)


def _root(share: Number) -> Number:
    """Return sqrt(share), below `SMALLEST` the parabola through 0 that goes on without a kink."""
    small = value_of(share) < SMALLEST
    ratio = share * (1.0 / SMALLEST)
    return where(small, sqrt(SMALLEST) * ratio * (1.5 - 0.5 * ratio), np.sqrt(where(small, SMALLEST, share)))


class InterfaceFriction(Effect):
    """tan delta = mu tan phi in Eq. 4; mu < 1, so ln mu < 0. Soil that is pushed or carried keeps its tan phi."""

    name = "interface_friction"
    summary = "Soil slides on the wheel before it shears in itself: friction at the rim is below that of the soil."
    source = "Potyondy (1961), Geotechnique 11:339-353 (friction between soils and construction materials)"
    parameters = (Parameter("ln_mu", "1", 0.0, -0.3, -2.0, 0.0, 0.4, "Potyondy (1961): delta/phi .54 to .98", side=-1),)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil with the friction of its interface."""
        return replace(soil, interface=soil.interface * np.exp(values["ln_mu"]))


class ShearSoftening(Effect):
    """tau (1 - q (1 - exp(-|j| / 0.15 m))) in place of tau of Eq. 4; at q = 0 Janosi & Hanamoto's curve."""

    name = "shear_softening"
    summary = "Shear stress falls again with displacement once its peak is passed: the residual strength is lower."
    source = "after Oida (1979) and Wong (2008), whose humped curves do not contain Eq. 4 as a limit; this form does"
    parameters = (
        Parameter("fraction", "1", 0.0, 0.2, 0.0, 0.95, 0.3, "Oida (1979): residual .4 to .9 of the peak", side=1),
    )

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with softening soil."""
        return replace(patch, softening=patch.softening + values["fraction"])


class Grouser(Effect):
    """Soil shears at r + h and torque acts there: j = (r + h)(theta_1 - theta) - (V/omega)(sin theta_1 - sin theta)."""

    name = "grouser"
    summary = "Lugs hold the soil between them: it shears on a circle larger than the wheel, with a longer arm."
    source = "Wong (2008), Theory of Ground Vehicles; Ding et al. (2011), J. Terramechanics 48:27-45"
    parameters = (
        Parameter("height_m", "m", 0.0, 0.01, 0.0, 0.2, 0.02, "lugs of 5 to 20 mm; about half of them counts", side=1),
    )
    needs = Needs(lugs=True)
    like_radius = "height_m"

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with lugs."""
        return replace(patch, lug_height=patch.lug_height + values["height_m"])


class TyreFlattening(Effect):
    """The contact has the radius r (1 + a W/10 kN 340 kPa/p): of stresses and sinkage, not of slip and torque.

    A tread that runs along its contact at r omega gives the soil the power r omega times the shear force, so that the
    arm of the torque is r: T omega is then what goes into pull, sinkage and slip, and nothing more.
    """

    name = "tyre_flattening"
    summary = (
        "The tyre flattens under load: its contact is longer and flatter than a rigid wheel's, more at low pressure."
    )
    each_wheel = True
    source = "larger substitute circle, as in Harnisch et al. (2005), Vehicle System Dynamics 43, suppl. 1"
    parameters = (Parameter("radius_gain", "1", 0.0, 0.1, 0.0, 2.0, 0.15, "10 to 20 % at 340 kPa and 10 kN", side=1),)
    needs = Needs(conditions=("inflation_kpa",), pressures=True)

    def contact_radius(self, radius: Number, conditions: Conditions, values: Values) -> Number:
        """Return the radius of the substitute circle."""
        return radius * _larger(conditions, values)

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces with the torque of the rolling radius."""
        return replace(reaction, driving_torque=reaction.driving_torque / _larger(state.conditions, values))


def _larger(conditions: Conditions, values: Values) -> Number:
    """Return the radius of the substitute circle over the wheel's."""
    load = conditions.vertical_load_n * (1.0 / REFERENCE_LOAD_N)
    return 1.0 + values["radius_gain"] * load * REFERENCE_INFLATION_KPA / conditions.inflation_kpa
