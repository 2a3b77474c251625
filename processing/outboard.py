r"""What the transducer feels less than the soil does: weight and inertia of the declared parts outboard of it.

Newton for the parts between transducer and soil (mass m_o, inertia I_o about the axle):

.. math:: F_{x,soil} = F_{x,wft} + m_o \dot V, \qquad T_{soil} = T_{wft} - I_o \dot\omega, \qquad
          W_{soil} = W_{wft} + m_o g \ \text{after a spin zero}.

A zero taken with the wheel lifted has the outboard weight in it already, so that W_wft is the ground load; a spin zero
takes the bridges' offsets only. A determination of `wheelsoil zero` that was taken off the run says itself which of the
two it is (`processing.transducer_zero`), whatever ``transducer.zero`` declares of the transducer's own zero.
The derivatives come from the filter at the rate of the time base, before any averaging: after it they would be too
small.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from math import hypot, sqrt
from typing import Literal

from daq.config import VehicleConfig
from processing.on_base import OnBase

STANDARD_GRAVITY_MPS2 = 9.80665


def at_soil(
    roles: dict[str, OnBase], vehicle: VehicleConfig, kernel_s: float, zero: Literal["lifted", "spin", "none"]
) -> dict[str, OnBase]:
    """Return the roles with drawbar pull, torque and load carried from the transducer to the soil.

    Parameters
    ----------
    roles : mapping role -> OnBase
        The slopes of ``ground_speed`` and ``wheel_speed`` are the accelerations; a force without the one that it needs
        stays as it is.
    vehicle : VehicleConfig
        Its declared outboard mass and inertia.
    kernel_s : float
        Standard deviation of the filter's kernel: the noise of a derivative is that of the value over sqrt(2) kernel_s.
    zero : "lifted", "spin" or "none"
        What the zero of the vertical load holds: only after "spin" the outboard weight is missing from it.
    """
    wheel = vehicle.wheel
    if wheel is None:
        return roles
    moved = dict(roles)
    for role, factor, speed in (
        ("drawbar_pull", wheel.outboard_mass_kg, roles.get("ground_speed")),
        ("driving_torque", -wheel.outboard_inertia_kgm2, roles.get("wheel_speed")),
    ):
        if role in roles and factor and speed is not None:
            noise = abs(factor) * speed.facts.sigma / (sqrt(2.0) * kernel_s)
            facts = replace(roles[role].facts, sigma=hypot(roles[role].facts.sigma, noise))
            moved[role] = replace(roles[role], values=roles[role].values + factor * speed.slope, facts=facts)
    if "vertical_load" in roles and zero == "spin":
        load = roles["vertical_load"]
        moved["vertical_load"] = replace(load, values=load.values + wheel.outboard_mass_kg * STANDARD_GRAVITY_MPS2)
    return moved


def not_carried(roles: Collection[str], vehicle: VehicleConfig) -> list[str]:
    """Return sentences on forces that `at_soil` leaves as the transducer feels them, for their speed is missing."""
    wheel = vehicle.wheel
    if wheel is None:
        return []
    return [
        f"{role}: the inertia of the parts outboard of the transducer is left in it, for {speed} is missing"
        for role, declared, speed in (
            ("drawbar_pull", wheel.outboard_mass_kg, "ground_speed"),
            ("driving_torque", wheel.outboard_inertia_kgm2, "wheel_speed"),
        )
        if declared and role in roles and speed not in roles
    ]
