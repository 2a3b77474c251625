"""How far a damped Gauss-Newton step may go: a radius that learns from the steps tried.

Source: More (1978), The Levenberg-Marquardt algorithm, Lecture Notes in Math. 630, section 4 and 7.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.bounded_problem import BoundedProblem

FloatArray = NDArray[np.float64]

_KEPT_GAIN = 1e-4  # share of the foretold gain that a step must bring to be kept


class TrustRadius:
    """The radius within which the linearised residual is believed, and the unit D it is measured in.

    Parameters
    ----------
    initial_radius : float
        Radius of the first damped step, in units of the scaled start.
    problem : BoundedProblem
    """

    def __init__(self, initial_radius: float, problem: BoundedProblem) -> None:
        self._first_radius = initial_radius
        self._size = np.maximum(np.abs(problem.start), problem.scale) * problem.free
        self._norms = np.zeros(problem.start.size)
        self._untried = True
        self.radius = np.inf

    def norms_seen(self, jacobian: FloatArray) -> FloatArray:
        """Return D: the largest column norms so far; 1 for a column that was always zero."""
        self._norms = np.maximum(self._norms, np.linalg.norm(jacobian, axis=0))
        return np.where(self._norms > 0, self._norms, 1.0)

    def keeps(self, ratio: float, length: float) -> bool:
        """Set the radius by the ratio of seen to foretold gain of a step; return whether the step is kept."""
        if self._untried:
            self._untried = False
            first = self._first_radius * float(np.linalg.norm(self._norms * self._size)) or np.inf
            if abs(ratio - 1) <= 0.25:
                self.radius = max(first, length)
                return True
            self.radius = min(first, length / 2)
            return False
        if ratio < 0.25:
            self.radius = min(self.radius, length) * (0.25 if ratio > -1e3 else 0.1)
        elif ratio > 0.75:
            self.radius = max(self.radius, 2 * length)
        return ratio > _KEPT_GAIN
