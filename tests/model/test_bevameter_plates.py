from __future__ import annotations

import numpy as np
import pytest
from bench_soil import plate_tests
from hypothesis import given, settings
from hypothesis import strategies as st
from property_settings import examples

from daq import ConfigError, DataError
from daq.series import PlateTest
from model.bevameter import PressureSinkage, WindowOptions, fit_plate, fit_pressure_sinkage
from wheelsoil.wording.notes import texts_of

Z = np.linspace(0.0005, 0.03, 60)


def _plate(pressure: np.ndarray, z: np.ndarray = Z, width: float = 0.05) -> PlateTest:
    return PlateTest(z, pressure, width, "p")


# --- one plate -------------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(st.floats(1e4, 1e8), st.floats(0.2, 2.5), st.floats(0.002, 0.3))
def test_an_exact_curve_gives_its_k_and_n(k: float, n: float, depth: float) -> None:
    z = np.linspace(depth / 50, depth, 50)
    fit = fit_plate(_plate(k * z**n, z))
    assert fit.exponent == pytest.approx(n, rel=1e-8)
    assert fit.stiffness == pytest.approx(k, rel=1e-7)
    assert fit.rms_pa < 1e-6 * k * depth**n
    value, _ = fit.at(depth / 3)
    assert value == pytest.approx([np.log(k * (depth / 3) ** n), n], rel=1e-8, abs=1e-7)  # ln p may be near 0


def test_the_samples_that_count_are_stated() -> None:
    z = np.concatenate([Z, Z[::-1], Z[::2], np.linspace(0.03, 0.04, 20)])
    virgin = np.concatenate([np.ones(60), np.zeros(60), np.zeros(30), np.ones(20)])
    pressure = np.where(virgin, 1e6 * z, np.maximum(3e4 - 2e7 * (0.03 - z), 0))  # the plate comes back and goes again
    fit = fit_plate(_plate(pressure, z))
    assert fit.stiffness == pytest.approx(1e6, rel=0.02)
    assert fit.window.unloading == pytest.approx(90, abs=4)
    assert fit.window.points + fit.window.unloading + fit.window.outside == z.size
    short = fit_plate(_plate(1e6 * Z, Z), WindowOptions(from_m=0.005, to_m=0.02))
    assert short.window.from_m >= 0.005
    assert short.window.to_m <= 0.02
    assert short.window.outside == np.sum((Z <= 0.005) | (Z > 0.02))


@examples(30, gate=10)
@given(st.integers(0, 10**6), st.floats(0.7, 1.6), st.floats(0.002, 0.02))
def test_the_contact_is_found_in_a_record_that_starts_in_the_air(seed: int, n: float, gap: float) -> None:
    rng = np.random.default_rng(seed)
    z = np.linspace(-gap, 0.03, 600)
    clean = 1e6 * np.maximum(z, 0) ** n
    offset, sigma = 0.002 * clean.max(), 2e-4 * clean.max()
    table = _plate(clean + offset + sigma * rng.normal(size=z.size), z + 0.123)
    fit = fit_plate(table, WindowOptions(zero="contact"))
    # the contact shows when the pressure is five sigma above the baseline: (5 sigma / k)^(1/n) too deep
    late = (5 * sigma / 1e6) ** (1 / n)
    assert -1e-3 <= fit.window.zero_m - 0.123 <= 1.2 * late + 2e-4
    assert fit.window.pressure_offset_pa == pytest.approx(offset, abs=2 * sigma)
    assert fit.exponent == pytest.approx(n, abs=0.15)
    fitted = fit_plate(table, WindowOptions(zero="fitted"))
    assert abs(fitted.exponent - n) < 0.05
    assert fitted.window.zero_m == pytest.approx(0.123, abs=6e-4)


def test_without_samples_in_the_air_the_zero_stays_as_given_and_it_is_said() -> None:
    fit = fit_plate(_plate(1e6 * Z**1.5), WindowOptions(zero="contact"))
    assert fit.window.zero_m == 0
    assert any("zero as given" in text for text in texts_of(fit.warnings))
    assert fit.exponent == pytest.approx(1.5, rel=1e-8)


def test_a_wrong_shape_is_said() -> None:
    fit = fit_plate(_plate(1e6 * Z + 7e3 * np.sin(400 * Z)))
    assert any("the curve is not p = k z^n" in text for text in texts_of(fit.warnings))


@pytest.mark.parametrize(
    ("pressure", "z", "options", "words"),
    [
        (np.zeros(60), Z, None, "too few loading samples with pressure"),
        (-1e6 * Z, Z, None, "pressure positive"),
        (1e6 * Z, -Z, None, "positive downwards"),
        (1e6 * Z[:5], Z[:5], None, "5 samples"),
        (1e6 * Z, Z, WindowOptions(from_m=0.05), "0 samples"),
        (np.full(60, np.nan), Z, None, "lists of numbers"),
        (1e6 * Z[:-1], Z, None, "same length"),
        (np.zeros(0), np.zeros(0), None, "0 samples"),
        (np.where(Z > 0.0299, 1e5, 1.0), Z, None, "does not follow p = k z"),
    ],
)
def test_plates_that_cannot_be_fitted(
    pressure: np.ndarray, z: np.ndarray, options: WindowOptions | None, words: str
) -> None:
    with pytest.raises(DataError, match=words):
        fit_plate(_plate(pressure, z), options)


# --- several plates --------------------------------------------------------------------------------------------------


@given(st.floats(0, 5e4), st.floats(1e5, 5e6), st.floats(0.3, 1.5), st.sampled_from([1, 2, 3]))
@examples(30, gate=10)
def test_exact_plates_give_their_terrain(k_c: float, k_phi: float, n: float, repeats: int) -> None:
    tests = plate_tests(np.random.default_rng(0), k_c=k_c, k_phi=k_phi, n=n, repeats=repeats)
    found = fit_pressure_sinkage(tests)
    assert found.separate
    scale = k_phi + k_c / 0.03
    assert found.joint["cohesive_modulus"] == pytest.approx(k_c, rel=1e-6, abs=1e-7 * scale)
    assert found.joint["frictional_modulus"] == pytest.approx(k_phi, rel=1e-6, abs=1e-6 * scale)
    assert found.joint["sinkage_exponent"] == pytest.approx(n, rel=1e-7)
    assert found.widths_m == (0.03, 0.05, 0.08)
    assert len(found.plates) == 3 * repeats


def test_the_order_and_the_unit_of_the_reference_do_not_matter() -> None:
    tests = plate_tests(np.random.default_rng(5), scatter=(0.1, 0.05), noise=0.01)
    first, second = fit_pressure_sinkage(tests), fit_pressure_sinkage(tests[::-1])
    assert second.joint.values == pytest.approx(first.joint.values, rel=1e-6)
    assert second.joint.covariance == pytest.approx(first.joint.covariance, rel=1e-4)


def _covered(found: PressureSinkage, truth: np.ndarray) -> np.ndarray:
    low, high = found.joint.interval95.T
    return (low <= truth) & (truth <= high)


@pytest.mark.parametrize(
    "seeds",
    [range(15), pytest.param(range(200), marks=pytest.mark.slow)],
    ids=["fast", "slow"],
)
@pytest.mark.parametrize(
    ("widths", "repeats", "scatter"), [((0.03, 0.05, 0.08), 3, (0.1, 0.05)), ((0.05,), 5, (0.3, 0.1))]
)
def test_intervals_cover_the_truth(
    seeds: range, widths: tuple[float, ...], repeats: int, scatter: tuple[float, float]
) -> None:
    from scipy.stats import binomtest

    truth = np.array([13.19e3, 692.15e3, 0.8]) if len(widths) > 1 else np.array([13.19e3 / 0.05 + 692.15e3, 0.8])
    hits = np.zeros(truth.size, int)
    for seed in seeds:
        tests = plate_tests(np.random.default_rng(seed), widths_m=widths, repeats=repeats, scatter=scatter, noise=0.02)
        hits += _covered(fit_pressure_sinkage(tests), truth)
    for hit in hits:
        bounds = binomtest(int(hit), len(seeds)).proportion_ci(0.99, method="exact")
        assert bounds.high >= 0.93, hits / len(seeds)
        assert bounds.low <= 0.97, hits / len(seeds)


def test_the_scatter_between_plates_is_found_and_makes_the_interval() -> None:
    tests = plate_tests(np.random.default_rng(2), repeats=12, scatter=(0.2, 0.06), noise=0.002)
    found = fit_pressure_sinkage(tests)
    at_reference = np.sqrt(np.diag(found.joint.scatter))
    assert found.joint.scatter_source == "repeats"
    assert at_reference == pytest.approx([0.2, 0.06], rel=0.35)
    points = np.sqrt(found.plates[0].covariance[0, 0])
    assert at_reference[0] > 20 * points
    assert found.joint.freedom == pytest.approx(34)


def test_without_repeats_a_scatter_is_assumed_and_said() -> None:
    found = fit_pressure_sinkage(plate_tests(np.random.default_rng(1), widths_m=(0.03, 0.08), repeats=1, noise=0.01))
    assert found.separate
    assert found.joint.scatter_source == "assumed"
    assert np.isinf(found.joint.freedom).all()
    assert found.joint.sigma[1] > 0.1 * abs(found.joint.values[1])
    assert any("repeat each test at least three times" in text for text in texts_of(found.warnings))


def test_one_width_is_told_that_it_cannot_part_k_c_from_k_phi() -> None:
    found = fit_pressure_sinkage(plate_tests(np.random.default_rng(0), widths_m=(0.05,)))
    assert not found.separate
    assert found.joint["stiffness"] == pytest.approx(13.19e3 / 0.05 + 692.15e3, rel=1e-7)
    assert "cohesive_modulus" not in found.joint
    assert any("one plate width (b = 0.05 m)" in text and "second plate" in text for text in texts_of(found.warnings))


def test_widths_that_are_too_alike_are_said() -> None:
    found = fit_pressure_sinkage(plate_tests(np.random.default_rng(0), widths_m=(0.05, 0.052), noise=0.01))
    assert any("too alike" in text for text in texts_of(found.warnings))


def test_a_negative_k_c_is_reported_not_clipped() -> None:
    tests = plate_tests(np.random.default_rng(3), k_c=-15e3, k_phi=1e6, scatter=(0.03, 0.02), noise=0.01, repeats=4)
    found = fit_pressure_sinkage(tests)
    assert found.joint["cohesive_modulus"] == pytest.approx(-15e3, rel=0.15)
    (text,) = [text for text in texts_of(found.warnings) if "is negative" in text]
    assert "contradicts k = k_c/b + k_phi" in text
    assert "contains 0" not in text
    weak = fit_pressure_sinkage(plate_tests(np.random.default_rng(4), k_c=-1e2, scatter=(0.1, 0.05), noise=0.01))
    if weak.joint["cohesive_modulus"] < 0:
        assert any("the interval contains 0" in text for text in texts_of(weak.warnings))


def test_a_negative_k_phi_is_reported_too() -> None:
    found = fit_pressure_sinkage(plate_tests(np.random.default_rng(3), k_c=60e3, k_phi=-3e5, noise=0.001))
    assert found.joint["frictional_modulus"] == pytest.approx(-3e5, rel=0.1)
    assert any("k is positive only for b < 0.2" in text for text in texts_of(found.warnings))


def test_all_plates_that_cannot_be_fitted_are_named_together() -> None:
    bad = [PlateTest(Z, np.zeros(60), 0.05, name) for name in ("first", "second")]
    with pytest.raises(DataError, match=r"first(.|\n)*second"):
        fit_pressure_sinkage(bad)


def test_no_plate_and_a_plate_without_a_size() -> None:
    with pytest.raises(ConfigError, match="no plate test"):
        fit_pressure_sinkage([])
    with pytest.raises(ConfigError, match="width must be positive"):
        fit_pressure_sinkage([_plate(1e6 * Z, width=0.0)])
