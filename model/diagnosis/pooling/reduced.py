r"""One campaign's information, reduced to what it may share with others, and to its soil.

What belongs to the campaign alone is integrated out with its prior: the soil, and the causes about which it was
linearised that are not the transducer's. With G its cross products, n these columns, m those that are kept:

.. math:: \Lambda = G_{mm} - G_{mn} (I + G_{nn})^{-1} G_{nm},\quad h = G_{mr} - G_{mn} (I + G_{nn})^{-1} G_{nr}

so that the log likelihood of these parameters is :math:`h'\theta - \tfrac12\theta'\Lambda\theta`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from daq import FloatArray
from model.diagnosis.core.information import Information
from model.diagnosis.time_series.linearise import SENSORS, coordinate_of
from model.effects.catalogue import EFFECTS

OF_THE_TRANSDUCER = tuple(key for key, effect in EFFECTS.items() if effect.of_the_transducer())
"""Effects that go with a transducer from campaign to campaign; each has one parameter."""
_NOTHING = 1e-9


@dataclass(frozen=True)
class Observation:
    """A campaign of a transducer.

    Attributes
    ----------
    years : float
        When it was driven, since any moment that is the same for all.
    wheel : str
        That it was at, where there are several.
    """

    campaign: str
    years: float
    information: Information
    wheel: str = ""


@dataclass(frozen=True)
class Reduced:
    """Information on k parameters in units of their scales: `OF_THE_TRANSDUCER`, then what campaigns may share.

    Attributes
    ----------
    moments : array, shape (1 + k, 1 + k)
        Score in the first row and column, precision in the rest; zero for a parameter that the campaign does not show.
    """

    years: float
    moments: FloatArray

    @property
    def precision(self) -> FloatArray:
        """Return Lambda, shape (k, k)."""
        return self.moments[1:, 1:]

    @property
    def score(self) -> FloatArray:
        """Return h, shape (k,)."""
        return self.moments[1:, 0]


Shared = tuple[str, str]
"""Effect and parameter of what is not the transducer's and yet may be the same in all campaigns."""


def may_be_shared(observations: Sequence[Observation]) -> list[Shared]:
    """Return what the campaigns show of wheel, soil and speed, in its order."""
    shown = dict.fromkeys(
        pair
        for observation in observations
        for pair in zip(observation.information.effects, observation.information.parameters, strict=True)
        if pair[0] not in OF_THE_TRANSDUCER
    )
    return list(shown)


def reduced(observation: Observation, shared: Sequence[Shared] = ()) -> Reduced:
    """Return what a campaign says of its transducer, and of what it may share with others."""
    information, first = observation.information, 1 + len(observation.information.soil)
    alone, kept, places = list(range(1, first)), [], []
    for at, (key, parameter) in enumerate(zip(information.effects, information.parameters, strict=True), first):
        if key in OF_THE_TRANSDUCER:
            kept.append(at)
            places.append(1 + OF_THE_TRANSDUCER.index(key))
        elif key in information.about:
            alone.append(at)
        elif (key, parameter) in shared:
            kept.append(at)
            places.append(1 + len(OF_THE_TRANSDUCER) + shared.index((key, parameter)))
    precision, score = _without(information.matrix, alone, kept)
    size = 1 + len(OF_THE_TRANSDUCER) + len(shared)
    out = Reduced(observation.years, np.zeros((size, size)))
    out.moments[np.ix_(places, places)] = precision
    out.moments[0, places] = out.moments[places, 0] = score
    return out


def _without(matrix: FloatArray, nuisance: Sequence[int], kept: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    n, m = np.array(nuisance, np.intp), np.array(kept, np.intp)
    prior = np.eye(n.size) + matrix[np.ix_(n, n)]
    solved = np.linalg.solve(prior, matrix[np.ix_(n, np.r_[m, 0])])
    across = matrix[np.ix_(m, n)]
    return matrix[np.ix_(m, m)] - across @ solved[:, :-1], matrix[m, 0] - across @ solved[:, -1]


@dataclass(frozen=True)
class SoilDeparture:
    """How far a campaign's soil is from its laboratory.

    Attributes
    ----------
    sigmas : mapping coordinate -> float
        Posterior mean in the laboratory's one-sigma.
    p_value : float
        That a soil of the laboratory would be as far.
    """

    campaign: str
    sigmas: dict[str, float]
    p_value: float
    wheel: str = ""


def soil_departure(observation: Observation, known: Mapping[str, float] | None = None) -> SoilDeparture:
    r"""Compare a campaign's soil with its laboratory.

    Of all wheels of a vehicle together, where they have one soil, an error of one transducer that they were linearised
    about is integrated out as other causes are.

    Parameters
    ----------
    known : mapping effect -> float, optional
        Sizes of the transducer's errors, of all wheels together ``effect@wheel``; none are off by default.

    Notes
    -----
    With the laboratory's prior :math:`u \sim N(0, I)` the score h of the soil has the covariance
    :math:`\Lambda + \Lambda^2`; the statistic is :math:`h'(\Lambda + \Lambda^2)^+h`.
    """
    information, first = observation.information, 1 + len(observation.information.soil)
    names = [coordinate_of(label) for label in information.soil]
    soil = [at for at, name in enumerate(names, 1) if name not in SENSORS]
    others = [at for at in range(1, first) if at not in soil]
    others += [
        first + i
        for i, key in enumerate(information.effects)
        if key in information.about and key not in OF_THE_TRANSDUCER
    ]
    matrix = information.matrix
    if known:
        sizes = [
            known.get(key, 0.0) / scale for key, scale in zip(information.effects, information.scales, strict=True)
        ]
        shift = np.r_[np.zeros(first), sizes]
        matrix = matrix.copy()
        matrix[:, 0] -= matrix @ shift
    precision, score = _without(matrix, others, soil)
    size, axes = np.linalg.eigh(precision)
    seen = size > _NOTHING * max(float(size[-1]), 1.0)
    along = axes.T @ score
    statistic = float(np.sum(along[seen] ** 2 / (size[seen] + size[seen] ** 2)))
    mean = np.linalg.solve(np.eye(len(soil)) + precision, score)
    p_value = float(scipy.special.chdtrc(int(seen.sum()), statistic)) if seen.any() else 1.0
    sigmas = {names[at - 1]: float(x) for at, x in zip(soil, mean, strict=True)}
    return SoilDeparture(observation.campaign, sigmas, p_value, observation.wheel)


def scales_of(observations: Sequence[Observation]) -> tuple[FloatArray, tuple[str, ...], tuple[str, ...]]:
    """Return scale, parameter and unit of each of the transducer's parameters; NaN and empty for one nobody shows."""
    scales = np.full(len(OF_THE_TRANSDUCER), np.nan)
    names, units = [""] * len(scales), [""] * len(scales)
    for observation in observations:
        for i, key in enumerate(observation.information.effects):
            if key in OF_THE_TRANSDUCER:
                at = OF_THE_TRANSDUCER.index(key)
                scales[at] = observation.information.scales[i]
                names[at], units[at] = observation.information.parameters[i], observation.information.units[i]
    return scales, tuple(names), tuple(units)
