"""Bekker's k_c, k_phi and n from pressure-sinkage tests with plates of several widths.

With b the smaller side of a rectangular plate, the radius of a round one,

    p = (k_c/b + k_phi) z^n = (C/b + A) (z/z_r)^n,   k_c = C z_r^-n,   k_phi = A z_r^-n,

and z_r a sinkage that all tests reached: C/b + A is a pressure, nearly independent of n, while k_c and k_phi change
their unit with n. Each test enters by ln p(z_r) and n (`model.bevameter.joint`). k_c is not kept from being negative:
plates that carry more pressure the larger they are contradict the law, and the user must see it.

Source: Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (1980), J. Terramechanics 17(1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.bench_tables import PlateTest
from daq.errors import ConfigError, DataError, Fault
from model.bevameter.joint import JointFit, fit_jointly
from model.bevameter.plates import PlateFit, fit_plate
from model.bevameter.window import WindowOptions

FloatArray = NDArray[np.float64]

SEPARATE = ("cohesive_modulus", "frictional_modulus", "sinkage_exponent")
"""k_c in N/m^(n+1), k_phi in N/m^(n+2), n."""
TOGETHER = ("stiffness", "sinkage_exponent")
"""k in Pa/m^n at the one width tested, n."""
ASSUMED_SCATTER = (0.10, 0.04)
"""Relative one-sigma of the pressure at a given sinkage, and one-sigma of n, between tests of one terrain."""
_SAME_WIDTH = 1.01
_ALIKE = 0.99  # correlation of C and A from which on the widths are too alike


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
    reference_sinkage_m : float
        z_r, at which ``joint.scatter`` is that of (ln pressure, n).
    warnings : tuple of str
    """

    plates: tuple[PlateFit, ...]
    joint: JointFit
    widths_m: tuple[float, ...]
    reference_sinkage_m: float
    warnings: tuple[str, ...]

    @property
    def separate(self) -> bool:
        """Whether k_c and k_phi could be told apart."""
        return "cohesive_modulus" in self.joint


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
        raise ConfigError(
            Fault("there is no plate test", next_step="give at least one; two widths part k_c from k_phi")
        )
    if any(not test.width_m > 0 for test in tests):
        raise ConfigError(Fault("a plate's width must be positive", found=str([test.width_m for test in tests])))
    options = options or WindowOptions()
    if not options.from_m < options.to_m:
        raise ConfigError(Fault("the window is empty", found=f"from {options.from_m:g} to {options.to_m:g} m"))
    plates = _each(tests, options)
    reference = float(np.median([plate.reference_sinkage_m for plate in plates]))
    widths = _distinct([plate.width_m for plate in plates])
    joint = _of_several(plates, reference) if len(widths) > 1 else _of_one(plates, reference)
    words = [f"{plate.name}: {text}" for plate in plates for text in plate.warnings]
    words += _sign_words(joint, widths) if len(widths) > 1 else [_one_width(joint, widths[0])]
    return PressureSinkage(plates, joint, widths, reference, (*words, *joint.warnings))


def _each(tests: Sequence[PlateTest], options: WindowOptions) -> tuple[PlateFit, ...]:
    plates: list[PlateFit] = []
    faults: list[Fault] = []
    for test in tests:
        try:
            plates.append(fit_plate(test, options))
        except DataError as error:
            faults.extend(error.faults)
    if faults:
        raise DataError(*faults)
    return tuple(plates)


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
    words = (_too_alike(alike),) if alike > _ALIKE else ()
    return _in_moduli(replace(joint, warnings=(*words, *joint.warnings)), reference)


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


def _one_width(joint: JointFit, width: float) -> str:
    return (
        f"one plate width (b = {width:.4g} m) fixes k = k_c/b + k_phi = {joint['stiffness'] / 1e3:.4g} kPa/m^n at that "
        "width, not k_c and k_phi singly; test a second plate, at least 1.5 times as wide"
    )


def _sign_words(joint: JointFit, widths: Sequence[float]) -> list[str]:
    tested = f"the tested widths ({widths[0]:.4g} to {widths[-1]:.4g} m)"
    k_c, k_phi = joint["cohesive_modulus"], joint["frictional_modulus"]
    words = []
    if k_c < 0:
        low, high = joint.interval95[0] / 1e3
        sure = "" if high < 0 else "; the interval contains 0, so that these plates show no cohesive part"
        words.append(
            f"k_c = {k_c / 1e3:.4g} kN/m^(n+1), 95 % interval {low:.4g} to {high:.4g}, is negative: at the same "
            f"sinkage larger plates carry more pressure, which contradicts k = k_c/b + k_phi{sure}. It is reported as "
            f"it is; k is positive only for b > {-k_c / k_phi:.3g} m. Use it within {tested}, or take k of the plate "
            "nearest to the wheel"
        )
    if k_phi < 0:
        words.append(
            f"k_phi = {k_phi / 1e3:.4g} kN/m^(n+2) is negative: k is positive only for b < {-k_c / k_phi:.3g} m. Use "
            f"it within {tested}, or test wider plates"
        )
    return words


def _too_alike(correlation: float) -> str:
    return (
        f"k_c and k_phi: correlation -{correlation:.4f} at a given n; the plate widths are too alike to part them: "
        "test one at least 1.5 times as wide"
    )
