"""A rigid wheel on soil by plain sums over its rim: shares nothing with the model's quadrature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import FloatArray


@dataclass(frozen=True)
class StressedWheel:
    """A driven wheel in at theta_1; `peak` and `exit` are shares of theta_1, `cohesion` one of the peak stress."""

    entry: float
    slip: float
    radius: float = 0.47
    width: float = 0.3
    exponent: float = 1.0
    peak: float = 0.0
    exit: float = 0.0
    stiffness: float = 500e3
    tan_phi: float = 0.6
    cohesion: float = 0.0
    shear_modulus: float = 0.025

    def stresses(self, points: int = 20_000) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the angle, normal and shear stress at midpoints of the patch."""
        first = -self.exit * self.entry
        step = (self.entry - first) / points
        angle = first + step * (np.arange(points) + 0.5)
        top = self.peak * self.entry
        behind = angle < top
        width = max(top - first, 1e-12)
        alike = np.where(behind, self.entry - (angle - first) / width * (self.entry - top), angle)
        depth = self.radius * (np.cos(alike) - np.cos(self.entry))
        normal = self.stiffness * np.maximum(depth, 0.0) ** self.exponent
        slid = self.radius * ((self.entry - angle) - (1 - self.slip) * (np.sin(self.entry) - np.sin(angle)))
        strength = self.cohesion * normal.max() + self.tan_phi * normal
        return angle, normal, strength * -np.expm1(-slid / self.shear_modulus)

    def forces(self) -> tuple[float, float, float]:
        """Return load and drawbar pull in N and torque in N m."""
        angle, normal, shear = self.stresses()
        area = self.radius * self.width * (angle[1] - angle[0])
        load = float(area * np.sum(normal * np.cos(angle) + shear * np.sin(angle)))
        pull = float(area * np.sum(shear * np.cos(angle) - normal * np.sin(angle)))
        return load, pull, float(area * self.radius * np.sum(shear))

    @property
    def sinkage(self) -> float:
        """Z in m."""
        return float(self.radius * (1 - np.cos(self.entry)))
