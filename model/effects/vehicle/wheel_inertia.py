"""Rim and tyre outside the transducer weigh more than the vehicle file says."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Reaction, WheelState

MASS_KG = 75.0
INERTIA_KGM2 = 8.0


class WheelInertia(Effect):
    """Dp -= q 75 kg dV/dt and T += q 8 kg m2 domega/dt, on top of what the vehicle file declares and takes off."""

    name = "wheel_inertia"
    summary = "Mass and inertia outside the transducer are not declared: speeding up and braking show in its readings."
    source = "Newton (1687), second law, for rim and tyre outside the transducer's bridges"
    parameters = (
        Parameter(
            "scale",
            "1",
            0.0,
            0.5,
            0.0,
            10.0,
            1.0,
            "60 to 90 kg and 8 to 12 kg m2 of a wheel of 37 inches, none declared: about 1",
            side=1,
        ),
    )
    needs = Needs(conditions=("ground_acceleration_mps2", "wheel_acceleration_radps2"))

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces with what moves rim and tyre."""
        push = MASS_KG * state.conditions.ground_acceleration_mps2
        spin = INERTIA_KGM2 * state.conditions.wheel_acceleration_radps2
        return replace(
            reaction,
            drawbar_pull=reaction.drawbar_pull - values["scale"] * push,
            driving_torque=reaction.driving_torque + values["scale"] * spin,
        )
