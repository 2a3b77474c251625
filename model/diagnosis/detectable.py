r"""The smallest size of every cause that these runs would have shown.

One parameter of information :math:`\lambda = x'Px` (soil integrated out) and size a has, if it is alone, the expected
log Bayes factor over nothing

.. math:: \tfrac12 \frac{a^2\lambda^2 + \lambda}{1 + \lambda} - \tfrac12\ln(1 + \lambda) + [\ln 2]

with ln 2 where it is one-sided. It is detected where that makes the odds against "none" as long as a name asks for.
Which family it is may still be open: `one_of`.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import without_soil
from model.diagnosis.grams import CauseColumn, Grams
from model.diagnosis.prior import Hypotheses, hypotheses
from model.diagnosis.result import Detectable

FloatArray = NDArray[np.float64]

_LEAST_INFORMATION = 1e-6


def minimum_detectable(
    grams: Grams, excluded: frozenset[str] = frozenset(), name_at: float = 0.9, excess: float = 1.0
) -> dict[str, Detectable]:
    """Return the smallest detectable size of every effect, by its key; the parameter that shows first.

    A size beyond the parameter's bounds says that nothing plausible would be seen.

    Parameters
    ----------
    grams : Grams
        Only what was driven counts, not what was measured.
    excluded : set of str
        Families or keys that leave no trace.
    name_at : float
        Probability asked for.
    excess : float
        Factor on the noise's variance.
    """
    listed = hypotheses(grams, excluded, 1)
    information = np.diag(without_soil(grams, grams.total()))[1:] / excess
    found = {}
    for i, key in enumerate(listed.effects):
        wanted = log(name_at / (1.0 - name_at)) + listed.log_prior[0] - listed.log_prior[listed.index_of((key,))]
        sizes = [
            (_least_coefficient(float(information[c]), grams.causes[c].one_sided, wanted), grams.causes[c])
            for c in _columns(listed, i)
        ]
        coefficient, cause = min(sizes, key=lambda pair: pair[0])
        found[key] = _detectable(coefficient, cause)
    return found


def _columns(listed: Hypotheses, effect: int) -> list[int]:
    return [int(c) for c in listed.columns[effect] if c >= 0]


def _detectable(coefficient: float, cause: CauseColumn) -> Detectable:
    return Detectable(cause.parameter, cause.neutral + coefficient * cause.scale, cause.unit)


def _least_coefficient(information: float, one_sided: bool, wanted: float) -> float:
    """Return the coefficient whose expected log Bayes factor is `wanted`; infinite where nothing shows."""
    if information < _LEAST_INFORMATION:
        return float("inf")
    needed = wanted + 0.5 * log(1.0 + information) - (log(2.0) if one_sided else 0.0)
    square = (2.0 * needed * (1.0 + information) - information) / information**2
    return sqrt(max(square, 0.0))
