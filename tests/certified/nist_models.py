"""The 27 nonlinear regression models of NIST StRD as the headers of the files state them, and a reader of the files."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
"""Real or complex: the models are differentiated by complex steps."""


def _bennett(b: Array, x: Array) -> Array:
    return b[0] * (b[1] + x) ** (-1 / b[2])


def _box(b: Array, x: Array) -> Array:
    return b[0] * (1 - np.exp(-b[1] * x))


def _chwirut(b: Array, x: Array) -> Array:
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


def _danwood(b: Array, x: Array) -> Array:
    return b[0] * x ** b[1]


def _enso(b: Array, x: Array) -> Array:
    def wave(cosine: Array, sine: Array, period: Array | float) -> Array:
        angle = 2 * np.pi * x / period
        return cosine * np.cos(angle) + sine * np.sin(angle)

    return b[0] + wave(b[1], b[2], 12) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])


def _eckerle(b: Array, x: Array) -> Array:
    return (b[0] / b[1]) * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2)


def _gauss(b: Array, x: Array) -> Array:
    def peak(height: Array, middle: Array, width: Array) -> Array:
        return height * np.exp(-((x - middle) ** 2) / width**2)

    return b[0] * np.exp(-b[1] * x) + peak(b[2], b[3], b[4]) + peak(b[5], b[6], b[7])


def _cubic_over_cubic(b: Array, x: Array) -> Array:
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def _kirby(b: Array, x: Array) -> Array:
    return (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2)


def _lanczos(b: Array, x: Array) -> Array:
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def _mgh09(b: Array, x: Array) -> Array:
    return b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3])


def _mgh10(b: Array, x: Array) -> Array:
    return b[0] * np.exp(b[1] / (x + b[2]))


def _mgh17(b: Array, x: Array) -> Array:
    return b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4])


def _misra1b(b: Array, x: Array) -> Array:
    return b[0] * (1 - (1 + b[1] * x / 2) ** -2)


def _misra1c(b: Array, x: Array) -> Array:
    return b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5)


def _misra1d(b: Array, x: Array) -> Array:
    return b[0] * b[1] * x / (1 + b[1] * x)


def _nelson(b: Array, x: Array) -> Array:
    return b[0] - b[1] * x[0] * np.exp(-b[2] * x[1])


def _rat42(b: Array, x: Array) -> Array:
    return b[0] / (1 + np.exp(b[1] - b[2] * x))


def _rat43(b: Array, x: Array) -> Array:
    return b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3])


def _roszman(b: Array, x: Array) -> Array:
    return b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi


MODELS: dict[str, Callable[[Array, Array], Array]] = {
    "Bennett5": _bennett,
    "BoxBOD": _box,
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": _danwood,
    "ENSO": _enso,
    "Eckerle4": _eckerle,
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubic_over_cubic,
    "Kirby2": _kirby,
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": _mgh09,
    "MGH10": _mgh10,
    "MGH17": _mgh17,
    "Misra1a": _box,
    "Misra1b": _misra1b,
    "Misra1c": _misra1c,
    "Misra1d": _misra1d,
    "Nelson": _nelson,
    "Rat42": _rat42,
    "Rat43": _rat43,
    "Roszman1": _roszman,
    "Thurber": _cubic_over_cubic,
}


@dataclass(frozen=True)
class StrdSet:
    """One file: starts, shape (2, p), certified values and standard deviations, shape (p,), and the data."""

    name: str
    starts: NDArray[np.float64]
    certified: NDArray[np.float64]
    deviations: NDArray[np.float64]
    sum_of_squares: float
    y: NDArray[np.float64]
    x: NDArray[np.float64]

    def residual_and_jacobian(self, b: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        model = MODELS[self.name]
        jacobian = np.empty((self.y.size, b.size))
        for k in range(b.size):
            shifted = b.astype(complex)
            shifted[k] += 1e-30j
            jacobian[:, k] = model(shifted, self.x).imag / 1e-30
        return model(b, self.x) - self.y, jacobian


def read_strd(path: Path) -> StrdSet:
    """Read a file; where its model is of log[y] the logarithm is taken."""
    lines = path.read_text(encoding="ascii").splitlines()
    rows = [re.match(r"\s*b\d+\s*=\s*(.*)", line) for line in lines]
    numbers = np.array([[float(word) for word in row.group(1).split()] for row in rows if row])
    squares = next(line for line in lines if line.startswith("Residual Sum of Squares"))
    first = max(i for i, line in enumerate(lines) if line.startswith("Data:")) + 1
    data = np.array([[float(word) for word in line.split()] for line in lines[first:] if line.strip()])
    y, x = data[:, 0], data[:, 1:].T
    if any("log[y]" in line for line in lines):
        y = np.log(y)
    return StrdSet(
        name=path.stem,
        starts=numbers[:, :2].T,
        certified=numbers[:, 2],
        deviations=numbers[:, 3],
        sum_of_squares=float(squares.split()[-1]),
        y=y,
        x=x[0] if len(x) == 1 else x,
    )
