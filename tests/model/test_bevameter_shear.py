from __future__ import annotations

import numpy as np
import pytest
from bench_soil import shear_tests
from hypothesis import given, settings
from hypothesis import strategies as st
from property_settings import examples

from daq import ConfigError, DataError
from daq.series import ShearTest
from model.bevameter import fit_shear, fit_shear_strength
from wheelsoil.wording.notes import texts_of

J = np.linspace(0, 0.08, 60)


def _curve(strength: float, modulus: float) -> np.ndarray:
    return strength * (1 - np.exp(-J / modulus))


@settings(deadline=None)
@given(st.floats(10, 1e6), st.floats(0.002, 0.06))
def test_an_exact_curve_gives_its_strength_and_k(strength: float, modulus: float) -> None:
    fit = fit_shear(ShearTest(J, _curve(strength, modulus), 1e4))
    assert fit.strength_pa == pytest.approx(strength, rel=1e-7)
    assert fit.shear_modulus_m == pytest.approx(modulus, rel=1e-7)
    assert ("hardly separated" in "".join(texts_of(fit.warnings))) == (modulus > 0.04)


def test_the_window_is_kept_and_a_hump_is_said() -> None:
    humped = _curve(1e4, 0.005) * (1 - 0.5 * J / J.max())
    fit = fit_shear(ShearTest(J, humped, 1e4))
    assert any("Janosi-Hanamoto has no hump" in text for text in texts_of(fit.warnings))
    before = fit_shear(ShearTest(J, humped, 1e4), to_m=0.02)
    assert before.warnings == ()
    assert before.to_m <= 0.02
    assert before.points == np.sum(J <= 0.02)


@pytest.mark.parametrize(
    ("tau", "words"),
    [
        (np.zeros(60), "too few samples with shear stress"),
        (-_curve(1e4, 0.01), "check the signs"),
        (np.full(60, np.nan), "lists of numbers"),
        (1e5 * J, "does not follow"),
    ],
)
def test_curves_that_cannot_be_fitted(tau: np.ndarray, words: str) -> None:
    with pytest.raises(DataError, match=words):
        fit_shear(ShearTest(J, tau, 1e4, "s"))


def test_a_k_finer_than_the_samples_is_said() -> None:
    fit = fit_shear(ShearTest(J, _curve(1e4, 0.0006), 1e4))
    assert any("not resolved" in text for text in texts_of(fit.warnings))


@given(st.floats(100, 1e5), st.floats(0.05, 1.5), st.floats(0.003, 0.03), st.sampled_from([1, 3]))
@examples(30, gate=10)
def test_exact_tests_give_their_terrain(c: float, tan_phi: float, modulus: float, repeats: int) -> None:
    tests = shear_tests(np.random.default_rng(0), cohesion_pa=c, tan_phi=tan_phi, modulus_m=modulus, repeats=repeats)
    found = fit_shear_strength(tests)
    assert found.joint["cohesion_pa"] == pytest.approx(c, rel=1e-6, abs=1e-3)
    assert found.joint["tan_phi"] == pytest.approx(tan_phi, rel=1e-6)
    assert found.joint["shear_modulus_m"] == pytest.approx(modulus, rel=1e-7)
    assert found.normal_stresses_pa == (10e3, 60e3)


@pytest.mark.parametrize("seeds", [range(15), pytest.param(range(200), marks=pytest.mark.slow)], ids=["fast", "slow"])
def test_intervals_cover_the_truth(seeds: range) -> None:
    from scipy.stats import binomtest

    truth = np.array([4140.0, 0.4, 0.012])
    hits = np.zeros(3, int)
    for seed in seeds:
        low, high = fit_shear_strength(
            shear_tests(np.random.default_rng(seed), scatter=(0.08, 0.15), noise=0.02)
        ).joint.interval95.T
        hits += (low <= truth) & (truth <= high)
    for hit in hits:
        bounds = binomtest(int(hit), len(seeds)).proportion_ci(0.99, method="exact")
        assert bounds.high >= 0.93, hits / len(seeds)
        assert bounds.low <= 0.97, hits / len(seeds)


def test_one_normal_stress_is_told_that_it_cannot_part_c_from_phi() -> None:
    found = fit_shear_strength(shear_tests(np.random.default_rng(0), normal_stresses_pa=(20e3,)))
    assert not found.separate
    assert found.joint["strength_pa"] == pytest.approx(4140 + 0.4 * 20e3, rel=1e-7)
    assert any("second normal stress" in text for text in texts_of(found.warnings))


@pytest.mark.parametrize(("unit", "said"), [(1.0, False), (1e-3, True)])
def test_stresses_in_kpa_taken_for_pa_are_noted(unit: float, said: bool) -> None:
    stresses = [unit * stress for stress in (2e3, 10e3, 60e3)]
    tests = shear_tests(np.random.default_rng(3), cohesion_pa=unit * 150.0, normal_stresses_pa=stresses, repeats=1)
    texts = texts_of(fit_shear_strength(tests).warnings)
    assert any("if the stresses are in kPa" in text for text in texts) == said


def test_a_negative_cohesion_is_set_to_zero_and_said() -> None:
    tests = shear_tests(np.random.default_rng(1), cohesion_pa=-900.0, scatter=(0.03, 0.05), noise=0.01)
    found = fit_shear_strength(tests)
    assert found.joint["cohesion_pa"] == 0
    assert found.joint.sigma[0] > 0
    assert found.joint["tan_phi"] == pytest.approx(0.4 - 900 / 25e3, rel=0.1)
    assert any("it is set to 0" in text for text in texts_of(found.warnings))


def test_a_strength_that_falls_with_the_normal_stress_is_refused() -> None:
    tests = shear_tests(np.random.default_rng(0), cohesion_pa=5e4, tan_phi=-0.5)
    with pytest.raises(DataError, match="does not rise with the normal stress"):
        fit_shear_strength(tests)


def test_no_test_and_bad_tests_together() -> None:
    with pytest.raises(ConfigError, match="no shear test"):
        fit_shear_strength([])
    with pytest.raises(DataError, match=r"first(.|\n)*second"):
        fit_shear_strength([ShearTest(J, np.zeros(60), 1e3, name) for name in ("first", "second")])


def test_the_interval_of_a_positive_parameter_stays_positive() -> None:
    """Three tests, one degree of freedom: Student's t is 13, and K plus or minus 13 one-sigma went below 0."""
    found = fit_shear_strength(shear_tests(np.random.default_rng(3), repeats=1, scatter=(0.05, 0.5)))
    low, high = found.joint.interval95[found.joint.names.index("shear_modulus_m")]
    assert 0 < low < found.joint["shear_modulus_m"] < high
