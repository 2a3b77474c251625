"""Cohesion, friction angle and K from shear tests at several normal stresses.

    tau = (c + sigma tan phi) (1 - exp(-j/K))

Each test enters by the logarithms of its strength and of its K (`model.bevameter.joint`), so that tests scatter by a
share of the strength.

Source: Janosi & Hanamoto (1961), 1st International Conference on Terrain-Vehicle Systems; Wong (1980), J.
Terramechanics 17(1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import ConfigError, DataError, FloatArray, Note, every_error_as
from daq.series import ShearTest
from model.bevameter.joint import JointFit, fit_jointly
from model.bevameter.window import (
    MIN_POINTS,
    each_fitted,
    refuse_unfitted,
    root_mean_square,
    shape_notes,
    widened_covariance,
)
from model.fit.gauss_newton import StopReason, gauss_newton
from model.fit.linear_step import ResidualAndJacobian
from model.notes import BevameterCode

LAW = "tau = tau_max (1 - exp(-j/K))"
HUMP_LIMIT = 0.9
"""Last over largest shear stress, below which a curve has a hump."""

SEPARATE = ("cohesion_pa", "tan_phi", "shear_modulus_m")
TOGETHER = ("strength_pa", "shear_modulus_m")
"""Where all tests were at one normal stress."""
ASSUMED_SCATTER = (0.10, 0.20)
"""Relative one-sigma of the strength and of K between tests of one terrain."""
_TINY_PA = 100.0  # strength of a soil that is rather in kPa
_SAME_STRESS = 0.01  # share of the largest normal stress


@dataclass(frozen=True)
class ShearFit:
    """tau = tau_max (1 - exp(-j/K)) of one test.

    Attributes
    ----------
    normal_stress_pa, strength_pa, shear_modulus_m : sigma, tau_max, K
    covariance : shape (2, 2)
        Of (ln tau_max, ln K), from the scatter of the points alone.
    rms_pa : misfit
    points : samples that count: displacement from 0 to `to_m`
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
    warnings: tuple[Note, ...] = ()


def fit_shear(test: ShearTest, *, to_m: float = float("inf")) -> ShearFit:
    """Fit strength and K to one curve, every point with the same error in stress.

    Parameters
    ----------
    to_m : largest displacement that counts

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
        warnings=(*shape_notes(rms, highest, LAW), *_hump_notes(j, tau), *_range_notes(j, modulus)),
    )


def _counted(test: ShearTest, to_m: float) -> tuple[FloatArray, FloatArray]:
    j, tau = np.asarray(test.displacement_m, float), np.asarray(test.shear_stress_pa, float)
    if j.ndim != 1 or j.shape != tau.shape or not (np.isfinite(j).all() and np.isfinite(tau).all()):
        raise DataError.of("displacement and shear stress must be lists of numbers of the same length", test.name)
    counted = (j >= 0) & (j <= to_m)
    if counted.sum() < MIN_POINTS or not tau[counted].max() > 0 or not j[counted].max() > 0:
        raise DataError.of(
            "too few samples with shear stress in the window",
            test.name,
            found=f"{counted.sum()} samples",
            expected=f"at least {MIN_POINTS} with displacement from 0 to {to_m:g} m",
            next_step="check the signs of displacement and stress, and the window",
        )
    return j[counted], tau[counted]


def _exponential(j: FloatArray, tau: FloatArray) -> ResidualAndJacobian:
    """Return the residual of exp(x0) (1 - exp(-j/exp(x1))) and its sensitivities."""

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        strength, relative = np.exp(x[0]), j * np.exp(-x[1])
        left = np.exp(-relative)
        return strength * (1 - left) - tau, strength * np.column_stack([1 - left, -relative * left])

    return residual


def _hump_notes(j: FloatArray, tau: FloatArray) -> list[Note]:
    last = float(np.mean(tau[-max(1, tau.size // 20) :]) / tau.max())
    if last >= HUMP_LIMIT:
        return []
    return [Note(BevameterCode.HUMP, values={"share": last, "peak_m": float(j[np.argmax(tau)])})]


def _range_notes(j: FloatArray, modulus: float) -> list[Note]:
    spacing = float(np.median(np.abs(np.diff(j))))
    if modulus < spacing:
        return [Note(BevameterCode.MODULUS_UNRESOLVED, values={"modulus_m": modulus, "spacing_m": spacing})]
    if j.max() >= 2 * modulus:
        return []
    return [Note(BevameterCode.SHORT_SHEAR, values={"reach_m": float(j.max()), "modulus_m": modulus})]


@dataclass(frozen=True)
class ShearStrength:
    """What shear tests say of a terrain.

    Attributes
    ----------
    shears : tuple of ShearFit
        Each test by itself.
    joint : JointFit
        Of `SEPARATE`, or of `TOGETHER` where there was only one normal stress.
    normal_stresses_pa : (float, float)
        Smallest and largest.
    warnings : tuple of Note
        Of all tests together; each test has its own.
    """

    shears: tuple[ShearFit, ...]
    joint: JointFit
    normal_stresses_pa: tuple[float, float]
    warnings: tuple[Note, ...]

    @property
    def separate(self) -> bool:
        """Whether c and phi are separable."""
        return "cohesion_pa" in self.joint


@every_error_as(DataError, "the shear tests cannot be fitted", str, "check the numbers of the table and their units")
def fit_shear_strength(tests: Sequence[ShearTest], *, to_m: float = float("inf")) -> ShearStrength:
    """Fit c, tan phi and K to shear tests of one terrain.

    Parameters
    ----------
    tests : sequence of ShearTest
        At two or more normal stresses; at one only the strength and K are found.
    to_m : largest displacement that counts

    Raises
    ------
    ConfigError
        No test.
    DataError
        Curves that cannot be fitted, all at once; or a strength that falls with the normal stress.

    Source
    ------
    Janosi & Hanamoto (1961); Yang et al. (2016), Eq. 4 and Tab. 1.
    """
    if not tests:
        raise ConfigError.of(
            "there is no shear test", next_step="give at least one; two normal stresses part c and phi"
        )
    shears = each_fitted(tests, lambda test: fit_shear(test, to_m=to_m))
    stress = np.array([shear.normal_stress_pa for shear in shears])
    if np.ptp(stress) <= _SAME_STRESS * stress.max():
        joint = _fit(shears, None, [_mean_strength(shears)], ("strength_pa",))
        values = {"stress_pa": float(stress.mean()), "strength_pa": joint["strength_pa"]}
        notes = [Note(BevameterCode.ONE_STRESS, values=values)]
    else:
        joint, notes = _of_several(shears, stress)
    if (strongest := max(shear.strength_pa for shear in shears)) < _TINY_PA:
        notes.append(Note(BevameterCode.STRESSES_TINY, values={"strength_pa": strongest}))
    return ShearStrength(shears, joint, (float(stress.min()), float(stress.max())), (*notes, *joint.warnings))


def _of_several(shears: Sequence[ShearFit], stress: FloatArray) -> tuple[JointFit, list[Note]]:
    lines = np.column_stack([np.ones_like(stress), stress])
    strengths = np.array([shear.strength_pa for shear in shears])
    start, *_ = np.linalg.lstsq(lines / strengths[:, None], np.ones_like(stress))
    if (lines @ start).min() < 0.05 * strengths.min():
        start = np.array([_mean_strength(shears), 0.0])
    joint = _fit(shears, lines, start.tolist(), SEPARATE[:2])
    if joint["tan_phi"] <= 0:
        raise DataError.of(
            "the strength does not rise with the normal stress",
            found=f"tan phi = {joint['tan_phi']:.3g}",
            next_step="check the normal stresses of the tests; a purely cohesive soil has no friction angle",
        )
    if joint["cohesion_pa"] >= 0:
        return joint, []
    without = _fit(shears, lines[:, 1:], [_mean_strength(shears) / float(stress.mean())], SEPARATE[1:2])
    values = np.concatenate([[0.0], without.values])
    alone = {"cohesion_pa": joint["cohesion_pa"], "interval95": tuple(joint.interval95[0].tolist())}
    return replace(joint, values=values), [Note(BevameterCode.COHESION_NEGATIVE, values=alone)]


def _fit(shears: Sequence[ShearFit], lines: FloatArray | None, start: list[float], names: tuple[str, ...]) -> JointFit:
    """Fit ``strength = lines @ x[:-1]`` (a constant where there are no lines) and K = x[-1]."""
    rows = np.ones((len(shears), 1)) if lines is None else lines
    estimates = [(np.log([s.strength_pa, s.shear_modulus_m]), s.covariance) for s in shears]

    def common(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        strength = rows @ x[:-1]
        slopes = np.zeros((len(shears), 2, x.size))
        slopes[:, 0, :-1] = rows / strength[:, None]
        slopes[:, 1, -1] = 1 / x[-1]
        return np.column_stack([np.log(strength), np.full(len(shears), np.log(x[-1]))]), slopes

    modulus = float(np.exp(np.mean([np.log(shear.shear_modulus_m) for shear in shears])))
    joint, _ = fit_jointly(
        estimates,
        common,
        [*start, modulus],
        names=(*names, "shear_modulus_m"),
        parameters=(rows.shape[1], 1),
        assumed_scatter=ASSUMED_SCATTER,
    )
    return joint


def _mean_strength(shears: Sequence[ShearFit]) -> float:
    return float(np.exp(np.mean([np.log(shear.strength_pa) for shear in shears])))
