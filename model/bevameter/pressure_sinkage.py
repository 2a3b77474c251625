"""Bekker's k_c, k_phi and n from pressure-sinkage tests with plates of several widths.

With b the smaller side of a rectangular plate, the radius of a round one,

    p = (k_c/b + k_phi) z^n = (C/b + A) (z/z_r)^n,   k_c = C z_r^-n,   k_phi = A z_r^-n,

and z_r a sinkage that all tests reached: C/b + A is a pressure, nearly independent of n, while k_c and k_phi change
their unit with n. Each test enters by ln p(z_r) and n (`model.bevameter.joint`). k_c is not kept from being negative:
plates that carry more pressure the larger they are contradict the law, and the user must see it.

One curve, p = k z^n, is reduced to the pressure at a reference sinkage and n, which are nearly independent of each
other; k = p at 1 m is not, and its unit depends on n.

Source: Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (1980), J. Terramechanics 17(1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import ConfigError, DataError, FloatArray, Note, every_error_as
from daq.series import PlateTest
from model.bevameter.joint import JointFit, fit_jointly
from model.bevameter.window import (
    FITTED_ZERO_RANGE,
    Window,
    WindowOptions,
    each_fitted,
    refuse_unfitted,
    root_mean_square,
    shape_notes,
    widened_covariance,
    windowed,
)
from model.fit.gauss_newton import GaussNewtonResult, StopReason, gauss_newton
from model.fit.linear_step import ResidualAndJacobian
from model.notes import BevameterCode

LAW = "p = k z^n"
_DEEP = 0.7  # reference sinkage over the largest one: where the fit fixes the pressure best

SEPARATE = ("cohesive_modulus", "frictional_modulus", "sinkage_exponent")
"""k_c in N/m^(n+1), k_phi in N/m^(n+2), n."""
TOGETHER = ("stiffness", "sinkage_exponent")
"""k in Pa/m^n at the one width tested, n."""
ASSUMED_SCATTER = (0.10, 0.04)
"""Relative one-sigma of the pressure at a given sinkage, and one-sigma of n, between tests of one terrain."""
_SAME_WIDTH = 1.01
_ALIKE = 0.99  # correlation of C and A from which on the widths are too alike


@dataclass(frozen=True)
class PlateFit:
    """p = k z^n of one plate.

    Attributes
    ----------
    width_m : b
    stiffness : k, Pa/m^n
    exponent : n
    reference_sinkage_m, reference_pressure_pa : the point of the fitted curve that it fixes best
    covariance : shape (2, 2)
        Of (ln reference pressure, n), from the scatter of the points alone.
    rms_pa : misfit
    window : Window
        Zero and samples that count.
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
    warnings: tuple[Note, ...] = ()

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
        warnings=(*window.notes, *_zero_notes(window, result), *shape_notes(rms, highest, LAW)),
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


def _zero_notes(window: Window, result: GaussNewtonResult) -> list[Note]:
    return [Note(BevameterCode.ZERO_NOT_FIXED)] if window.zero == "fitted" and result.at_bound[2] else []


@dataclass(frozen=True)
class PressureSinkage:
    """What plate tests say of a terrain.

    Attributes
    ----------
    plates : tuple of PlateFit
        Each test by itself.
    joint : JointFit
        Of `SEPARATE`, or of `TOGETHER` where only one width was tested.
    widths_m : tuple of float
        Tested, each once, increasing.
    reference_sinkage_m : z_r, at which ``joint.scatter`` is that of (ln pressure, n)
    warnings : tuple of Note
        Of all tests together; each test has its own.
    """

    plates: tuple[PlateFit, ...]
    joint: JointFit
    widths_m: tuple[float, ...]
    reference_sinkage_m: float
    warnings: tuple[Note, ...]

    @property
    def separate(self) -> bool:
        """Whether k_c and k_phi are separable."""
        return "cohesive_modulus" in self.joint


@every_error_as(DataError, "the plate tests cannot be fitted", str, "check the numbers of the table and their units")
def fit_pressure_sinkage(tests: Sequence[PlateTest], options: WindowOptions | None = None) -> PressureSinkage:
    """Fit k_c, k_phi and n to plate tests of one terrain.

    Parameters
    ----------
    tests : sequence of PlateTest
        Of two or more widths; of one width only k and n are found.
    options : WindowOptions, optional
        Zero and window, for every test.

    Raises
    ------
    ConfigError
        No test, a plate without a size, or an empty window.
    DataError
        Curves that cannot be fitted, all at once.

    Source
    ------
    Bekker (1969); Yang et al. (2016), Eq. 2 and Tab. 1.
    """
    if not tests:
        raise ConfigError.of("there is no plate test", next_step="give at least one; two widths part k_c from k_phi")
    if any(not test.width_m > 0 for test in tests):
        raise ConfigError.of("a plate's width must be positive", found=str([test.width_m for test in tests]))
    options = options or WindowOptions()
    if not options.from_m < options.to_m:
        raise ConfigError.of("the window is empty", found=f"from {options.from_m:g} to {options.to_m:g} m")
    plates = each_fitted(tests, lambda test: fit_plate(test, options))
    reference = float(np.median([plate.reference_sinkage_m for plate in plates]))
    widths = _distinct([plate.width_m for plate in plates])
    joint = _of_several(plates, reference) if len(widths) > 1 else _of_one(plates, reference)
    notes = _sign_notes(joint, widths) if len(widths) > 1 else [_one_width(joint, widths[0])]
    return PressureSinkage(plates, joint, widths, reference, (*notes, *joint.warnings))


def _distinct(widths: Sequence[float]) -> tuple[float, ...]:
    distinct: list[float] = []
    for width in sorted(widths):
        if not distinct or width > _SAME_WIDTH * distinct[-1]:
            distinct.append(width)
    return tuple(distinct)


def _of_several(plates: Sequence[PlateFit], reference: float) -> JointFit:
    estimates = [plate.at(reference) for plate in plates]
    inverse_width = np.array([1 / plate.width_m for plate in plates])

    def common(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        pressure = x[0] * inverse_width + x[1]
        slopes = np.zeros((len(plates), 2, 3))
        slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 1, 2] = inverse_width / pressure, 1 / pressure, 1.0
        return np.column_stack([np.log(pressure), np.full(len(plates), x[2])]), slopes

    joint, result = fit_jointly(
        estimates,
        common,
        _start(estimates, inverse_width),
        names=("k_c", "k_phi", "n"),
        parameters=(2, 1),
        assumed_scatter=ASSUMED_SCATTER,
    )
    alike = abs(float(result.correlation[0, 1]))
    notes = (Note(BevameterCode.WIDTHS_ALIKE, values={"correlation": alike}),) if alike > _ALIKE else ()
    return _in_moduli(replace(joint, warnings=(*notes, *joint.warnings)), reference)


def _start(estimates: Sequence[tuple[FloatArray, FloatArray]], inverse_width: FloatArray) -> FloatArray:
    """Return C, A and n by linear least squares of the pressures; C = 0 where that gives a negative pressure."""
    values = np.array([value for value, _ in estimates])
    pressure = np.exp(values[:, 0])
    line, *_ = np.linalg.lstsq(np.column_stack([inverse_width, np.ones_like(inverse_width)]), pressure)
    if (line[0] * inverse_width + line[1]).min() < 0.05 * pressure.min():
        line = np.array([0.0, np.exp(values[:, 0].mean())])
    return np.array([line[0], line[1], values[:, 1].mean()])


def _in_moduli(joint: JointFit, reference: float) -> JointFit:
    """Turn C, A, n into k_c, k_phi, n."""
    big_c, big_a, n = (float(x) for x in joint.values)
    power, log = reference**-n, float(np.log(reference))
    turn = np.array([[power, 0.0, -log * power * big_c], [0.0, power, -log * power * big_a], [0.0, 0.0, 1.0]])
    values = np.array([big_c * power, big_a * power, n])
    return replace(joint, names=SEPARATE, values=values, covariance=turn @ joint.covariance @ turn.T)


def _of_one(plates: Sequence[PlateFit], reference: float) -> JointFit:
    estimates = [plate.at(reference) for plate in plates]

    def same(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.tile(x, (len(plates), 1)), np.tile(np.eye(2), (len(plates), 1, 1))

    start = np.mean([value for value, _ in estimates], axis=0)
    joint, _ = fit_jointly(
        estimates, same, start, names=("ln p", "n"), parameters=(1, 1), assumed_scatter=ASSUMED_SCATTER
    )
    log_pressure, n = (float(x) for x in joint.values)
    stiffness = float(np.exp(log_pressure - n * np.log(reference)))
    turn = np.array([[stiffness, -stiffness * np.log(reference)], [0.0, 1.0]])
    covariance = turn @ joint.covariance @ turn.T
    return replace(joint, names=TOGETHER, values=np.array([stiffness, n]), covariance=covariance)


def _one_width(joint: JointFit, width: float) -> Note:
    return Note(BevameterCode.ONE_WIDTH, values={"width_m": width, "stiffness": joint["stiffness"]})


def _sign_notes(joint: JointFit, widths: Sequence[float]) -> list[Note]:
    k_c, k_phi = joint["cohesive_modulus"], joint["frictional_modulus"]
    common = {"k_c": k_c, "k_phi": k_phi, "widths_m": (widths[0], widths[-1])}
    notes = []
    if k_c < 0:
        values = {**common, "interval95": tuple(joint.interval95[0].tolist())}
        notes.append(Note(BevameterCode.K_C_NEGATIVE, values=values))
    if k_phi < 0:
        notes.append(Note(BevameterCode.K_PHI_NEGATIVE, values=common))
    return notes
