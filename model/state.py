"""What effects see of a wheel on soil, and what they give back."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.conditions import Conditions
from model.dual import Number


@dataclass(frozen=True)
class SoilState:
    """The soil's parameters under given conditions, as columns or scalars in SI units.

    ``interface`` multiplies tan phi where soil shears on the rim; the soil itself keeps its friction.
    """

    cohesion: Number
    tan_phi: Number
    shear_modulus: Number
    exponent: Number
    cohesive_modulus: Number
    frictional_modulus: Number
    interface: Number = 1.0

    def stiffer(self, factor: Number) -> SoilState:
        """Return the soil with k of Eq. 2 multiplied by a factor."""
        return replace(
            self,
            cohesive_modulus=self.cohesive_modulus * factor,
            frictional_modulus=self.frictional_modulus * factor,
        )


@dataclass(frozen=True)
class WheelState:
    """Where the wheel is, once the balance is found; columns (n, 1) or scalars, SI.

    Attributes
    ----------
    conditions : Conditions
        The true inputs.
    soil : SoilState
    radius, width : m
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
