r"""The smallest size of every cause that the data would have shown.

One parameter of information :math:`\lambda = x'Px` (soil integrated out) and size a has, if it is alone, the expected
log Bayes factor over nothing

.. math:: \tfrac12 \frac{a^2\lambda^2 + \lambda}{1 + \lambda} - \tfrac12\ln(1 + \lambda) + [\ln 2]

with ln 2 where it is one-sided. It is detected where that makes the odds against "none" as long as a name asks for.
Which family it is may still be open: `one_of`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt

from model.diagnosis.core.prior import Hypotheses
from model.diagnosis.core.result import Detectable

_LEAST_INFORMATION = 1e-6


@dataclass(frozen=True)
class Direction:
    """One parameter of an effect, and what the data say of it.

    Attributes
    ----------
    scale : float
        Prior one-sigma, with the sign of the plausible side.
    information : float
        On its coefficient, in units of the scale, with the soil integrated out.
    """

    parameter: str
    unit: str
    neutral: float
    scale: float
    one_sided: bool
    information: float


def minimum_detectable(
    listed: Hypotheses, directions: Mapping[str, Sequence[Direction]], name_at: float
) -> dict[str, Detectable]:
    """Return the smallest detectable size of every effect, by its key; the parameter that shows first.

    A size beyond the parameter's bounds says that nothing plausible would be seen.

    Parameters
    ----------
    listed : Hypotheses
        With every effect alone, for the prior.
    directions : mapping effect -> sequence of Direction
    name_at : float
        Probability asked for.
    """
    found = {}
    for key, own in directions.items():
        wanted = log(name_at / (1.0 - name_at)) + listed.log_prior[0] - listed.log_prior[listed.index_of((key,))]
        sizes = [(least_coefficient(d.information, d.one_sided, wanted), d) for d in own]
        coefficient, first = min(sizes, key=lambda pair: pair[0])
        found[key] = Detectable(first.parameter, first.neutral + coefficient * first.scale, first.unit)
    return found


def least_coefficient(information: float, one_sided: bool, wanted: float) -> float:
    """Return the coefficient whose expected log Bayes factor is `wanted`; infinite where nothing shows.

    Parameters
    ----------
    wanted : float
        Nats.
    """
    if information < _LEAST_INFORMATION:
        return float("inf")
    needed = wanted + 0.5 * log(1.0 + information) - (log(2.0) if one_sided else 0.0)
    square = (2.0 * needed * (1.0 + information) - information) / information**2
    return sqrt(max(square, 0.0))
