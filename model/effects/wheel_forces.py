"""Forces on the wheel beside the stresses under it: pushed soil, slope and inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daq import STANDARD_GRAVITY_MPS2
from model.effects.base import Correction, Effect, Needs, Parameter, Remedy, Values
from model.wheel_soil.conditions import USUAL_OUTBOARD_MASS_KG, Reaction, WheelState

MASS_KG = USUAL_OUTBOARD_MASS_KG
INERTIA_KGM2 = 8.0


class Bulldozing(Effect):
    """Dp -= a b (gamma Z^2 Kp/2 + 2 c sqrt(Kp) Z): passive earth pressure on a wall of height Z.

    sqrt(Kp) = tan(45 deg + phi/2) = tan phi + sqrt(1 + tan^2 phi). A part a of it only: compaction is in Eq. 8 already.
    """

    name = "bulldozing"
    summary = (
        "The wheel pushes soil in front of it: a share of the passive earth pressure on a wall as high as it is sunk."
    )
    source = "Rankine (1857), passive earth pressure; Wong (2008), Theory of Ground Vehicles, on bulldozing"
    shows = ("drawbar_pull",)
    parameters = (
        Parameter("fraction", "1", 0.0, 0.2, 0.0, 3.0, 0.6, "the whole would count compaction twice", side=1),
    )
    needs = Needs(conditions=("unit_weight_n_m3",), channels=("drawbar_pull",), two_loads=True)

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces less what the wedge takes."""
        soil, depth = state.soil, state.sinkage
        root = soil.tan_phi + np.sqrt(1.0 + soil.tan_phi * soil.tan_phi)
        weight = 0.5 * state.conditions.unit_weight_n_m3 * depth * root
        wedge = state.width * depth * root * (weight + 2.0 * soil.cohesion)
        return replace(reaction, drawbar_pull=reaction.drawbar_pull - values["fraction"] * wedge)


class Slope(Effect):
    """Dp -= direction m_o g sin a; uphill on "out" is positive, and on "back" it is downhill.

    A transducer between rim and hub reads the soil's pull in the vehicle's axes, whatever the slope; only the weight of
    what is outboard of it hangs on the soil and not on the hub.
    """

    name = "slope"
    summary = (
        "The track is not level: the soil holds the weight of rim and tyre along it, and the hub does not feel it."
    )
    source = "Newton (1687), statics of what is outboard of a transducer between rim and hub"
    shows = ("drawbar_pull",)
    parameters = (Parameter("angle_rad", "rad", 0.0, 0.02, -0.3, 0.3, 0.03, "a field that looks level: 1 to 2 deg"),)
    needs = Needs(conditions=("direction", "outboard_mass_kg"), channels=("drawbar_pull",), both_directions=True)

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces without the outboard weight along the slope."""
        share = state.conditions.direction * np.sin(values["angle_rad"])
        pull = reaction.drawbar_pull - state.conditions.outboard_mass_kg * STANDARD_GRAVITY_MPS2 * share
        return replace(reaction, drawbar_pull=pull)


class WheelInertia(Effect):
    """Dp -= q 75 kg dV/dt and T += q 8 kg m2 domega/dt, on top of what the vehicle file declares and takes off."""

    name = "wheel_inertia"
    summary = "Mass and inertia outside the transducer are not declared: speeding up and braking show in its readings."
    source = "Newton (1687), second law, for rim and tyre outside the transducer's bridges"
    error_text = "The {channel} follows the wheel's acceleration: outboard mass and inertia are not declared"
    abscissa = "rim acceleration"
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
    remedy = Remedy(
        "Weigh what is outside the transducer; these runs suggest the values below for vehicle.toml.",
        (Correction("outboard_mass_kg", MASS_KG), Correction("outboard_inertia_kgm2", INERTIA_KGM2)),
    )

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces with what moves rim and tyre."""
        push = MASS_KG * state.conditions.ground_acceleration_mps2
        spin = INERTIA_KGM2 * state.conditions.wheel_acceleration_radps2
        return replace(
            reaction,
            drawbar_pull=reaction.drawbar_pull - values["scale"] * push,
            driving_torque=reaction.driving_torque + values["scale"] * spin,
        )
