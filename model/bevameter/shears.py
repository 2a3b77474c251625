"""One shear curve: tau = tau_max (1 - exp(-j/K)).

Source: Janosi & Hanamoto (1961), 1st International Conference on Terrain-Vehicle Systems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.bench_tables import ShearTest
from daq.errors import DataError, Fault
from model.bevameter.curve_checks import refuse_unfitted, root_mean_square, shape_words, widened_covariance
from model.bevameter.window import MIN_POINTS
from model.bounded_problem import ResidualAndJacobian
from model.gauss_newton import StopReason, gauss_newton

FloatArray = NDArray[np.float64]

LAW = "tau = tau_max (1 - exp(-j/K))"
HUMP_LIMIT = 0.9
"""Last over largest shear stress, below which a curve has a hump."""


@dataclass(frozen=True)
class ShearFit:
    """tau = tau_max (1 - exp(-j/K)) of one test.

    Attributes
    ----------
    name : str
    normal_stress_pa, strength_pa, shear_modulus_m : float
        sigma, tau_max, K.
    covariance : shape (2, 2)
        Of (ln tau_max, ln K), from the scatter of the points alone.
    rms_pa : float
        Misfit.
    points : int
        Samples that count: displacement from 0 to `to_m`.
    to_m : float
    stop_reason : StopReason
    warnings : tuple of str
    """

    name: str
    normal_stress_pa: float
    strength_pa: float
    shear_modulus_m: float
    covariance: FloatArray
    rms_pa: float
    points: int
    to_m: float
    stop_reason: StopReason
    warnings: tuple[str, ...] = ()


def fit_shear(test: ShearTest, *, to_m: float = float("inf")) -> ShearFit:
    """Fit strength and K to one curve, every point with the same error in stress.

    Parameters
    ----------
    test : ShearTest
    to_m : float
        Largest displacement that counts.

    Raises
    ------
    DataError
        Too few usable samples, or a curve that the law cannot follow.

    Source
    ------
    Janosi & Hanamoto (1961); Yang et al. (2016), Eq. 4.
    """
    j, tau = _counted(test, to_m)
    highest = float(tau.max())
    rise = float(j[np.argmax(tau >= 0.63 * highest)]) or float(j.max()) / 10
    result = gauss_newton(
        _exponential(j, tau),
        [np.log(highest), np.log(rise)],
        lower=[-np.inf, np.log(1e-4 * j.max())],
        upper=[np.log(highest) + 5, np.log(1e2 * j.max())],
        scale=[1.0, 1.0],
        names=["ln tau_max", "ln K"],
    )
    refuse_unfitted(test.name, result, LAW)
    rms, modulus = root_mean_square(result.residual), float(np.exp(result.estimate[1]))
    return ShearFit(
        name=test.name,
        normal_stress_pa=test.normal_stress_pa,
        strength_pa=float(np.exp(result.estimate[0])),
        shear_modulus_m=modulus,
        covariance=widened_covariance(result),
        rms_pa=rms,
        points=j.size,
        to_m=float(j.max()),
        stop_reason=result.stop_reason,
        warnings=(*shape_words(rms, highest, LAW), *_hump_words(j, tau), *_short_words(j, modulus)),
    )


def _counted(test: ShearTest, to_m: float) -> tuple[FloatArray, FloatArray]:
    j, tau = np.asarray(test.displacement_m, float), np.asarray(test.shear_stress_pa, float)
    if j.ndim != 1 or j.shape != tau.shape or not (np.isfinite(j).all() and np.isfinite(tau).all()):
        raise DataError(Fault("displacement and shear stress must be lists of numbers of the same length", test.name))
    counted = (j >= 0) & (j <= to_m)
    if counted.sum() < MIN_POINTS or not tau[counted].max() > 0 or not j[counted].max() > 0:
        raise DataError(
            Fault(
                "too few samples with shear stress in the window",
                test.name,
                found=f"{counted.sum()} samples",
                expected=f"at least {MIN_POINTS} with displacement from 0 to {to_m:g} m",
                next_step="check the signs of displacement and stress, and the window",
            )
        )
    return j[counted], tau[counted]


def _exponential(j: FloatArray, tau: FloatArray) -> ResidualAndJacobian:
    """Return the residual of exp(x0) (1 - exp(-j/exp(x1))) and its sensitivities."""

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        strength, relative = np.exp(x[0]), j * np.exp(-x[1])
        left = np.exp(-relative)
        return strength * (1 - left) - tau, strength * np.column_stack([1 - left, -relative * left])

    return residual


def _hump_words(j: FloatArray, tau: FloatArray) -> list[str]:
    last = float(np.mean(tau[-max(1, tau.size // 20) :]) / tau.max())
    if last >= HUMP_LIMIT:
        return []
    peak = float(j[np.argmax(tau)])
    return [f"the stress falls to {last:.0%} of its peak at {peak:.3g} m: Janosi-Hanamoto has no hump"]


def _short_words(j: FloatArray, modulus: float) -> list[str]:
    spacing = float(np.median(np.abs(np.diff(j))))
    if modulus < spacing:
        return [f"K {modulus:.3g} m is finer than the samples, {spacing:.3g} m apart: K is not resolved"]
    if j.max() >= 2 * modulus:
        return []
    return [f"sheared only to {j.max():.3g} m with K {modulus:.3g} m: strength and K are hardly separated"]
