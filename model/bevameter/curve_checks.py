"""What the fit of one curve has in common with the other: when it is refused, and how far its points can be trusted.

Neighbouring points of one curve are not independent. Their covariance is widened by the integrated autocorrelation of
the residual, (1 + rho)/(1 - rho) for a first-order process.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.errors import DataError, Fault
from model.gauss_newton import GaussNewtonResult

FloatArray = NDArray[np.float64]

MISFIT_LIMIT = 0.1
"""Root mean square misfit over the largest value, from which on a curve does not have the law's shape."""


def refuse_unfitted(name: str, result: GaussNewtonResult, law: str) -> None:
    """Raise DataError for a fit that did not converge, or whose first two parameters ran into a bound."""
    if result.converged and not result.at_bound[:2].any():
        return
    raise DataError(
        Fault(
            f"the curve does not follow {law}",
            name,
            found=f"stopped: {result.stop_reason}; {'; '.join(result.warnings) or 'no minimum'}",
            next_step="look at the curve; check its zero, its units and the window",
        )
    )


def widened_covariance(result: GaussNewtonResult) -> FloatArray:
    """Return the covariance of the first two parameters, shape (2, 2), widened for the residual's autocorrelation."""
    r = result.residual
    rho = float(r[1:] @ r[:-1]) / max(result.cost, float(np.finfo(float).tiny))
    rho = float(np.clip(rho, 0.0, 1.0 - 3.0 / r.size))
    return result.covariance[:2, :2] * (1 + rho) / (1 - rho)


def root_mean_square(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def shape_words(rms: float, highest: float, law: str) -> list[str]:
    """Say where a curve does not have the shape of the law."""
    if rms <= MISFIT_LIMIT * highest:
        return []
    return [f"misfit {rms / highest:.0%} of the largest value: the curve is not {law}; check zero and window"]
