"""How a cause is put into the truth: at which hook, with which size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from blind.ground import Ground
from blind.rim import Column
from blind.wheel import YANG, Moments, Physics, Reading

from daq import FloatArray


@dataclass(frozen=True)
class Hidden:
    """One way to be wrong.

    Attributes
    ----------
    key : str
        Of the form in the engine's library, or of the variant.
    family, parameter : str
        As in the engine's answer; `parameter` is empty where the engine's has another meaning.
    scale : float
        A plausible size, in the parameter's unit.
    limits : (low, high)
    both : bool
        Either sign.
    formula : str
        For the table of what was hidden.
    put : (Physics, size) -> Physics
    variant : bool
    outside : bool
        Of no family that the library knows.
    length : bool
        The size is a length; scale and limits are those at Yang's wheel.
    """

    key: str
    family: str
    parameter: str
    scale: float
    limits: tuple[float, float]
    formula: str
    put: Callable[[Physics, float], Physics]
    both: bool = False
    variant: bool = False
    outside: bool = False
    length: bool = False

    def plausible(self, radius_m: float) -> tuple[float, tuple[float, float]]:
        """Return scale and limits at a wheel; lengths go with its radius."""
        share = radius_m / YANG.radius_m if self.length else 1.0
        return share * self.scale, (share * self.limits[0], share * self.limits[1])


def also(physics: Physics, **hooks: object) -> Physics:
    return replace(physics, **hooks)  # type: ignore[arg-type]


def softer(factor: Callable[[Moments, float], FloatArray]) -> Callable[[Physics, float], Physics]:
    """Return a cause that multiplies the stiffness."""

    def put(physics: Physics, size: float) -> Physics:
        before = physics.ground

        def ground(soil: Ground, m: Moments) -> Ground:
            return before(soil, m).changed({"stiffness": np.log(factor(m, size))})

        return also(physics, ground=ground)

    return put


def reads(change: Callable[[Reading, Moments, float], Reading]) -> Callable[[Physics, float], Physics]:
    """Return a cause that lies in the sensors."""

    def put(physics: Physics, size: float) -> Physics:
        before = physics.read
        return also(physics, read=lambda reading, m: change(before(reading, m), m, size))

    return put


def at_hub(more: Callable[[Moments, FloatArray, Ground, float], tuple[Column, Column]]):
    """Return a cause that adds a force and a torque at the hub."""

    def put(physics: Physics, size: float) -> Physics:
        before = physics.hub

        def hub(m: Moments, z: FloatArray, soil: Ground) -> tuple[Column, Column]:
            pull, torque = before(m, z, soil) if before else (0.0, 0.0)
            more_pull, more_torque = more(m, z, soil, size)
            return pull + more_pull, torque + more_torque

        return also(physics, hub=hub)

    return put


def sinks(law: Callable[[FloatArray, FloatArray, float], FloatArray]) -> Callable[[Physics, float], Physics]:
    """Return a cause that moves the sinkage; laws of two causes are applied one after the other."""

    def put(physics: Physics, size: float) -> Physics:
        before = physics.sinkage

        def sinkage(z: FloatArray, slip: FloatArray) -> FloatArray:
            return law(z if before is None else before(z, slip), slip, size)

        return also(physics, sinkage=sinkage)

    return put


def driving_part(slip: FloatArray) -> FloatArray:
    return np.maximum(slip, 0.0)


def braking_part(slip: FloatArray) -> FloatArray:
    return np.maximum(-slip, 0.0)
