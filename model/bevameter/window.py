"""Zero and window of a test curve: the samples that count, and the origin of sinkage and pressure.

A curve is refused where too few samples remain. Neighbouring points of one curve are not independent: their covariance
is widened by the integrated autocorrelation of the residual, (1 + rho)/(1 - rho) for a first-order process.

Source: Wong (1980), J. Terramechanics 17(1), on the evaluation of plate tests; the contact rule is ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from daq import BoolArray, DataError, Fault, FloatArray, Note
from daq.series import PlateTest
from model.fit.gauss_newton import GaussNewtonResult
from model.notes import BevameterCode

Test = TypeVar("Test")
Fit = TypeVar("Fit")
MISFIT_LIMIT = 0.1
"""Root mean square misfit over the largest value, from which on a curve does not have the law's shape."""

Zero = Literal["given", "contact", "fitted"]

MIN_POINTS = 8
"""Samples in the window below which a curve is not fitted."""
_RISEN = 0.02  # share of the largest pressure that ends the search for a baseline
_BASELINE = 10  # samples of one
_FLAT = 3.0  # standard errors that a baseline may slope
_ABOVE_NOISE = 5.0
_REBOUND = 0.005  # share of the largest sinkage that a plate may come back without it being unloading
FITTED_ZERO_RANGE = 0.1
"""Share of the depth above the contact within which a fitted zero is sought."""


@dataclass(frozen=True)
class FitFault(Fault):
    """A fit that failed, with what it noted of its parameters; `found` says only where it stopped."""

    notes: tuple[Note, ...] = ()


def refuse_unfitted(name: str, result: GaussNewtonResult, law: str) -> None:
    """Raise DataError for a fit that did not converge, or whose first two parameters ran into a bound."""
    if result.converged and not result.at_bound[:2].any():
        return
    raise DataError(
        FitFault(
            f"the curve does not follow {law}",
            name,
            found=f"stopped: {result.stop_reason}",
            next_step="look at the curve; check its zero, its units and the window",
            notes=result.warnings,
        )
    )


def each_fitted(tests: Iterable[Test], fit: Callable[[Test], Fit]) -> tuple[Fit, ...]:
    """Fit every test; raise DataError with the faults of all that cannot be fitted."""
    fits: list[Fit] = []
    faults: list[Fault] = []
    for test in tests:
        try:
            fits.append(fit(test))
        except DataError as error:
            faults.extend(error.faults)
    if faults:
        raise DataError(*faults)
    return tuple(fits)


def widened_covariance(result: GaussNewtonResult) -> FloatArray:
    """Return the covariance of the first two parameters, shape (2, 2), widened for the residual's autocorrelation."""
    r = result.residual
    rho = float(r[1:] @ r[:-1]) / max(result.cost, float(np.finfo(float).tiny))
    rho = float(np.clip(rho, 0.0, 1.0 - 3.0 / r.size))
    return result.covariance[:2, :2] * (1 + rho) / (1 - rho)


def root_mean_square(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def shape_notes(rms: float, highest: float, law: str) -> list[Note]:
    """Note where a curve does not have the shape of the law."""
    if rms <= MISFIT_LIMIT * highest:
        return []
    return [Note(BevameterCode.MISFIT, values={"share": rms / highest, "law": law})]


@dataclass(frozen=True)
class WindowOptions:
    """Which part of a curve counts.

    Attributes
    ----------
    zero : "given", "contact" or "fitted"
        Sinkage 0 and pressure 0 as they are in the table; or where the pressure leaves a flat baseline for good; or a
        fitted parameter a little above that contact.
    from_m, to_m : sinkage, from the zero, between which samples count
    """

    zero: Zero = "given"
    from_m: float = 0.0
    to_m: float = float("inf")


@dataclass(frozen=True)
class Window:
    """The samples that count.

    Attributes
    ----------
    zero : "given", "contact" or "fitted"
    zero_m, pressure_offset_pa : what was taken off the table's sinkage and pressure
    from_m, to_m : smallest and largest sinkage that counts
    points, unloading, outside : int
        Samples that count; that are left out because the plate came back; and because they are not in the window.
    """

    zero: Zero
    zero_m: float
    pressure_offset_pa: float
    from_m: float
    to_m: float
    points: int
    unloading: int
    outside: int
    notes: tuple[Note, ...] = ()


def windowed(test: PlateTest, options: WindowOptions) -> tuple[FloatArray, FloatArray, Window]:
    """Return sinkage and pressure of the samples that count, shape (points,), and how they were chosen.

    With a fitted zero the sinkage is from the detected contact, and samples that may lie below the zero are included.
    `DataError` for values that are not numbers, or too few samples left.

    Source: Wong (1980), J. Terramechanics 17(1).
    """
    z, p = np.asarray(test.sinkage_m, float), np.asarray(test.pressure_pa, float)
    if z.ndim != 1 or z.shape != p.shape or not (np.isfinite(z).all() and np.isfinite(p).all()):
        raise DataError.of("sinkage and pressure must be lists of numbers of the same length", test.name)
    loading = _loading(z)
    unloading = z.size - int(loading.sum())
    z, p = z[loading], p[loading]
    if not z.size:
        raise DataError(_too_little(test, options, 0, 0.0))
    zero, offset, notes = (0.0, 0.0, ()) if options.zero == "given" else _contact(z, p)
    z, p = z - zero, p - offset
    depth = float(z.max())
    lowest = options.from_m - (FITTED_ZERO_RANGE * depth if options.zero == "fitted" else 0.0)
    inside = (z > lowest) & (z <= options.to_m)
    if inside.sum() < MIN_POINTS or not p[inside].max() > 0:
        raise DataError(_too_little(test, options, int(inside.sum()), depth))
    window = Window(
        zero=options.zero,
        zero_m=zero,
        pressure_offset_pa=offset,
        from_m=float(max(z[inside].min(), options.from_m)),
        to_m=float(z[inside].max()),
        points=int(inside.sum()),
        unloading=unloading,
        outside=int((~inside).sum()),
        notes=notes,
    )
    return z[inside], p[inside], window


def _loading(z: FloatArray) -> BoolArray:
    """Return the samples at which the plate goes where it has not been before."""
    if not z.size:
        return np.zeros(0, bool)
    deepest = z.size - 1 - int(np.argmax(z[::-1]))
    rebound = _REBOUND * float(np.ptp(z))
    return np.asarray((np.arange(z.size) <= deepest) & (z >= np.maximum.accumulate(z) - rebound))


def _contact(z: FloatArray, p: FloatArray) -> tuple[float, float, tuple[Note, ...]]:
    """Return the sinkage at which the pressure leaves its baseline for good, and the baseline."""
    risen = np.flatnonzero(p - np.median(p[:_BASELINE]) > _RISEN * np.ptp(p))
    quiet = int(risen[0]) // 2 if risen.size else 0
    if quiet < _BASELINE:
        return 0.0, 0.0, (Note(BevameterCode.CONTACT_TOO_EARLY),)
    baseline = p[:quiet]
    offset = float(np.median(baseline))
    noise = 1.4826 * float(np.median(np.abs(baseline - offset)))
    if _slopes(baseline, max(noise, float(np.std(baseline)))):
        return 0.0, 0.0, (Note(BevameterCode.NO_BASELINE),)
    below = np.flatnonzero(p - offset <= max(_ABOVE_NOISE * noise, 1e-3 * float(np.ptp(p))))
    return float(z[below[-1]]), offset, ()


def _slopes(values: FloatArray, noise: float) -> bool:
    """Return whether values rise by more than their noise explains (neighbours taken as dependent in tens)."""
    half = values.size // 2
    rise = float(np.median(values[-half:]) - np.median(values[:half]))
    return bool(rise > _FLAT * noise * np.sqrt(2 * min(10, half) / half))


def _too_little(test: PlateTest, options: WindowOptions, points: int, depth: float) -> Fault:
    return Fault(
        "too few loading samples with pressure in the window",
        test.name,
        found=f"{points} samples, sinkage up to {depth:.4g} m",
        expected=f"at least {MIN_POINTS} between {options.from_m:g} and {options.to_m:g} m",
        next_step="check that sinkage is positive downwards and pressure positive, and the window",
    )
