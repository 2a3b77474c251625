"""Gauss-Newton against NIST's certified answers: 27 nonlinear regression problems, each from a far and a near start."""

from __future__ import annotations

import numpy as np
import pytest
from certified.nist_models import MODELS, StrdSet, read_strd
from numpy.typing import NDArray
from support import data_dir

from model.fit import StopReason
from model.fit.gauss_newton import GaussNewtonResult, gauss_newton

FAR, NEAR = 0, 1
DIGITS = 6


def _digits(found: NDArray[np.float64], certified: NDArray[np.float64]) -> float:
    error = np.max(np.abs(found - certified) / np.abs(certified))
    return float(-np.log10(max(error, 1e-16)))


def _fit(problem: StrdSet, start: int) -> GaussNewtonResult:
    return gauss_newton(problem.residual_and_jacobian, problem.starts[start])


def _all() -> list[StrdSet]:
    return [read_strd(path) for path in sorted(data_dir("nist-strd").glob("*.dat"))]


def test_every_file_has_its_model() -> None:
    assert sorted(problem.name for problem in _all()) == sorted(MODELS)
    assert len(MODELS) == 27


@pytest.mark.parametrize("name", sorted(MODELS))
def test_models_give_the_certified_sum_of_squares(name: str) -> None:
    problem = read_strd(data_dir("nist-strd", f"{name}.dat"))
    residual, _ = problem.residual_and_jacobian(problem.certified)
    # 11 certified digits of the parameters leave a residual of about 1e-11 of y
    assert residual @ residual == pytest.approx(problem.sum_of_squares, rel=1e-8, abs=1e-20 * problem.y.size)


@pytest.mark.parametrize(("start", "at_least"), [(NEAR, 27), (FAR, 25)])
def test_certified_parameters_are_reached(start: int, at_least: int) -> None:
    fits = {problem.name: (problem, _fit(problem, start)) for problem in _all()}
    reached = {name for name, (problem, fit) in fits.items() if _digits(fit.estimate, problem.certified) >= DIGITS}
    missed = {name: str(fit.stop_reason) for name, (_, fit) in fits.items() if name not in reached}
    assert len(reached) >= at_least, missed
    assert all(reason in tuple(StopReason) for reason in missed.values())
    assert all(fits[name][1].converged for name in reached)


@pytest.mark.parametrize("name", sorted(set(MODELS) - {"Lanczos1"}))
def test_certified_standard_deviations_are_reached(name: str) -> None:
    problem = read_strd(data_dir("nist-strd", f"{name}.dat"))
    assert _digits(np.sqrt(np.diag(_fit(problem, NEAR).covariance)), problem.deviations) >= DIGITS


def test_a_fit_without_noise_gives_standard_deviations_of_the_size_of_rounding() -> None:
    # Lanczos1: the certified residual is 1e-13 of y, so that its standard deviations are made of rounding
    problem = read_strd(data_dir("nist-strd", "Lanczos1.dat"))
    assert _digits(np.sqrt(np.diag(_fit(problem, NEAR).covariance)), problem.deviations) >= 1
