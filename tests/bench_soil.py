"""A laboratory on the computer: plate and shear tests of a known terrain, with scatter between tests and of points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.series import PlateTest, ShearTest

REFERENCE_M = 0.02


def coloured(rng: np.random.Generator, size: int, neighbour: float = 0.8) -> NDArray[np.float64]:
    """Return noise of unit variance whose neighbours are correlated."""
    noise = rng.normal(size=size)
    for i in range(1, size):
        noise[i] = neighbour * noise[i - 1] + np.sqrt(1 - neighbour**2) * noise[i]
    return noise


def plate_tests(
    rng: np.random.Generator,
    *,
    k_c: float = 13.19e3,
    k_phi: float = 692.15e3,
    n: float = 0.8,
    widths_m: Sequence[float] = (0.03, 0.05, 0.08),
    repeats: int = 3,
    scatter: tuple[float, float] = (0.0, 0.0),
    noise: float = 0.0,
    points: int = 60,
) -> list[PlateTest]:
    """Return tests of a terrain; `scatter` between tests of (ln pressure at `REFERENCE_M`, n), `noise` of points."""
    tests = []
    z = np.linspace(0.0005, 0.03, points)
    for width in widths_m:
        for repeat in range(repeats):
            level, change = np.array(scatter) * rng.normal(size=2)
            pressure = (k_c / width + k_phi) * REFERENCE_M**n * np.exp(level)
            curve = pressure * (z / REFERENCE_M) ** (n + change) + noise * pressure * coloured(rng, points)
            tests.append(PlateTest(z, curve, width, f"{width:g} m, {repeat + 1}"))
    return tests


def shear_tests(
    rng: np.random.Generator,
    *,
    cohesion_pa: float = 4140.0,
    tan_phi: float = 0.4,
    modulus_m: float = 0.012,
    normal_stresses_pa: Sequence[float] = (10e3, 30e3, 60e3),
    repeats: int = 3,
    scatter: tuple[float, float] = (0.0, 0.0),
    noise: float = 0.0,
    points: int = 60,
) -> list[ShearTest]:
    """Return tests of a terrain; `scatter` between tests of (ln strength, ln K), `noise` of points."""
    tests = []
    j = np.linspace(0.0, 0.08, points)
    for stress in normal_stresses_pa:
        for repeat in range(repeats):
            level, change = np.array(scatter) * rng.normal(size=2)
            strength = (cohesion_pa + stress * tan_phi) * np.exp(level)
            curve = strength * (1 - np.exp(-j / (modulus_m * np.exp(change))))
            curve = curve + noise * strength * coloured(rng, points)
            tests.append(ShearTest(j, curve, stress, f"{stress / 1e3:g} kPa, {repeat + 1}"))
    return tests
