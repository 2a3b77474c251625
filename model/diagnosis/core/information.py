"""What one campaign says of soil and causes together, as numbers that campaigns can be pooled by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import FloatArray
from model.inference_data import Normal


@dataclass(frozen=True)
class Information:
    r"""Cross products of a campaign's linear model, whitened by its noise: information and score.

    With :math:`r = S\beta + X\gamma + \epsilon`, :math:`\epsilon \sim N(0, I)`, the log likelihood of any soil and
    causes near the point of linearisation is :math:`-\tfrac12 |r - S\beta - X\gamma|^2`, which `matrix` gives.
    Verdicts cannot be pooled; these can, by adding what is shared and integrating out what is not.

    Attributes
    ----------
    soil : tuple of q str
        Coordinates of the soil, each N(0, 1) by the laboratory and counted from its values, and of sensors' errors.
        Of all wheels of a vehicle together each stands behind a wheel's name, see `linearise.coordinate_of`.
    effects, parameters, units : tuple of k str
        Of the causes' columns: the effect's key, its parameter, the parameter's unit.
    scales, neutrals : tuple of k float
        A coefficient of 1 is the value neutral + scale.
    one_sided : tuple of k bool
        Whether no negative coefficient is plausible.
    matrix : array, shape (1 + q + k, 1 + q + k)
        Cross products of residual, soil's and causes' columns, over the noise's variance with its excess.
    samples : int
        Whitened numbers.
    about : tuple of str
        Effects in the model about which was linearised.
    """

    soil: tuple[str, ...]
    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    scales: tuple[float, ...]
    neutrals: tuple[float, ...]
    one_sided: tuple[bool, ...]
    matrix: FloatArray
    samples: int
    about: tuple[str, ...]

    def posterior_and_prior(self) -> tuple[Normal, Normal]:
        """Return the soil, in one-sigma of its prior, and the causes of `about`, each as ``effect.parameter``."""
        q = len(self.soil)
        causes = [i for i, key in enumerate(self.effects) if key in self.about]
        units = dict.fromkeys(self.soil, "prior one-sigma")
        units |= {f"{self.effects[i]}.{self.parameters[i]}": self.units[i] for i in causes}
        neutral = np.array([0.0] * q + [self.neutrals[i] for i in causes])
        scale = np.diag([1.0] * q + [self.scales[i] for i in causes])
        at = np.array([*range(1, 1 + q), *(1 + q + i for i in causes)], np.intp)
        covariance = np.linalg.inv(np.eye(at.size) + self.matrix[np.ix_(at, at)])
        mean = neutral + scale @ covariance @ self.matrix[at, 0]
        return Normal(units, mean, scale @ covariance @ scale), Normal(units, neutral, scale @ scale)
