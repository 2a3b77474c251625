"""One pressure-sinkage curve: p = k z^n.

The curve is reduced to the pressure at a reference sinkage and n, which are nearly independent of each other; k = p at
1 m is not, and its unit depends on n.

Source: Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (1980), J. Terramechanics 17(1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.bench_tables import PlateTest
from model.bevameter.curve_checks import refuse_unfitted, root_mean_square, shape_words, widened_covariance
from model.bevameter.window import FITTED_ZERO_RANGE, Window, WindowOptions, windowed
from model.bounded_problem import ResidualAndJacobian
from model.gauss_newton import GaussNewtonResult, StopReason, gauss_newton

FloatArray = NDArray[np.float64]

LAW = "p = k z^n"
_DEEP = 0.7  # reference sinkage over the largest one: where the fit fixes the pressure best


@dataclass(frozen=True)
class PlateFit:
    """p = k z^n of one plate.

    Attributes
    ----------
    name : str
    width_m : float
        b.
    stiffness : float
        k, Pa/m^n.
    exponent : float
        n.
    reference_sinkage_m, reference_pressure_pa : float
        The point of the fitted curve that it fixes best.
    covariance : shape (2, 2)
        Of (ln reference pressure, n), from the scatter of the points alone.
    rms_pa : float
        Misfit.
    window : Window
        Zero and samples that count.
    stop_reason : StopReason
    warnings : tuple of str
    """

    name: str
    width_m: float
    stiffness: float
    exponent: float
    reference_sinkage_m: float
    reference_pressure_pa: float
    covariance: FloatArray
    rms_pa: float
    window: Window
    stop_reason: StopReason
    warnings: tuple[str, ...] = ()

    def at(self, sinkage_m: float) -> tuple[FloatArray, FloatArray]:
        """Return (ln pressure at a sinkage, n), shape (2,), and their covariance, shape (2, 2)."""
        turn = np.array([[1.0, float(np.log(sinkage_m / self.reference_sinkage_m))], [0.0, 1.0]])
        value = turn @ np.array([np.log(self.reference_pressure_pa), self.exponent])
        return value, turn @ self.covariance @ turn.T


def fit_plate(test: PlateTest, options: WindowOptions | None = None) -> PlateFit:
    """Fit k and n to one curve, every point with the same error in pressure.

    Raises
    ------
    DataError
        Too few usable samples, or a curve that the law cannot follow.

    Source
    ------
    Bekker (1969); Yang et al. (2016), Eq. 2.
    """
    z, p, window = windowed(test, options or WindowOptions())
    reference, highest = _DEEP * float(z.max()), float(p.max())
    reach = FITTED_ZERO_RANGE * float(z.max()) if window.zero == "fitted" else 0.0
    result = gauss_newton(
        _power_law(z, p, reference),
        [np.log(_DEEP * highest), 1.0, -reach / 2],
        lower=[-np.inf, 0.01, -reach],
        upper=[np.inf, 8.0, 0.0],
        scale=[1.0, 1.0, reference],
        names=["ln p", "n", "zero"],
    )
    refuse_unfitted(test.name, result, LAW)
    log_pressure, exponent, zero = (float(x) for x in result.estimate)
    if window.zero == "fitted":
        window = replace(window, zero_m=window.zero_m + zero, to_m=window.to_m - zero)
    rms = root_mean_square(result.residual)
    return PlateFit(
        name=test.name,
        width_m=test.width_m,
        stiffness=float(np.exp(log_pressure - exponent * np.log(reference))),
        exponent=exponent,
        reference_sinkage_m=reference,
        reference_pressure_pa=float(np.exp(log_pressure)),
        covariance=widened_covariance(result),
        rms_pa=rms,
        window=window,
        stop_reason=result.stop_reason,
        warnings=(*window.notes, *_zero_words(window, result), *shape_words(rms, highest, LAW)),
    )


def _power_law(z: FloatArray, p: FloatArray, reference: float) -> ResidualAndJacobian:
    """Return the residual of p = exp(x0) ((z - x2)/reference)^x1, 0 above the zero x2, and its sensitivities."""

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        under = z > x[2]
        depth = np.where(under, z - x[2], reference)
        log = np.log(depth / reference)
        fitted = np.where(under, np.exp(x[0] + x[1] * log), 0.0)
        return fitted - p, np.column_stack([fitted, fitted * log, -x[1] * fitted / depth])

    return residual


def _zero_words(window: Window, result: GaussNewtonResult) -> list[str]:
    if window.zero != "fitted" or not result.at_bound[2]:
        return []
    return ["the fitted zero ended at the limit of its range: the curve does not fix it; prefer the contact"]
