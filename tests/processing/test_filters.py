import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from synthetic_run import stamps

from processing.pipeline import kernel_sigma_s
from processing.pipeline.collection import thin
from processing.pipeline.filters import smooth, white_noise_bandwidth

BASE = np.arange(400, 1600) / 100.0
CUTOFF = 4.0
SIGMA = kernel_sigma_s(CUTOFF)


def _gain_and_phase(values: np.ndarray, frequency: float) -> complex:
    return complex(2 * np.mean(values * np.exp(-2j * np.pi * frequency * BASE)))


@pytest.mark.parametrize("rate", [20.0, 83.0, 100.0, 1000.0])
@pytest.mark.parametrize("frequency", [0.5, 2.0, 4.0])
def test_every_rate_has_the_same_transfer_function(rate: float, frequency: float) -> None:
    at = stamps(20.0, rate)
    out = smooth(BASE, at, np.cos(2 * np.pi * frequency * at), SIGMA, 0.2).values
    expected = 0.5 ** (0.5 * (frequency / CUTOFF) ** 2)
    np.testing.assert_allclose(_gain_and_phase(out, frequency), expected, atol=1.5e-3)


def test_a_sample_counts_for_the_time_that_it_stands_for() -> None:
    """Ten times as many samples in every other 50 ms pull the mean of a wave that rises and falls with them."""
    at = stamps(20.0, 1000.0)
    at = at[(at % 0.1 < 0.05) | (np.arange(len(at)) % 10 == 0)]
    out = smooth(BASE, at, np.sin(2 * np.pi * 10.0 * at), SIGMA, 0.2).values
    assert abs(np.mean(out)) < 2e-2


def test_cutoff_is_minus_three_decibels() -> None:
    at = stamps(20.0, 1000.0)
    out = smooth(BASE, at, np.cos(2 * np.pi * CUTOFF * at), SIGMA, 0.2).values
    np.testing.assert_allclose(abs(_gain_and_phase(out, CUTOFF)), np.sqrt(0.5), rtol=2e-4)


@pytest.mark.parametrize("frequency", [0.5, 4.0])
def test_thinning_does_not_change_the_transfer_function(frequency: float) -> None:
    at = stamps(20.0, 1000.0)
    wave = np.cos(2 * np.pi * frequency * at)
    time_ns, values, spread = thin(np.round(at * 1e9).astype(np.int64), wave, 10_000_000).entries(10_000_000)
    direct = smooth(BASE, at, wave, SIGMA, 0.2)
    thinned = smooth(BASE, time_ns * 1e-9, values, SIGMA, 0.2, float(spread.mean()))
    np.testing.assert_allclose(thinned.values, direct.values, atol=5e-4)
    np.testing.assert_allclose(thinned.slope, direct.slope, atol=5e-4 * 2 * np.pi * frequency)


def test_tones_near_the_node_rate_do_not_fold() -> None:
    at = stamps(20.0, 1000.0)
    time_ns, values, spread = thin(
        np.round(at * 1e9).astype(np.int64), np.cos(2 * np.pi * 97.0 * at), 10_000_000
    ).entries(10_000_000)
    out = smooth(BASE, time_ns * 1e-9, values, SIGMA, 0.2, float(spread.mean())).values
    assert np.abs(out).max() < 2e-3


@given(st.integers(0, 2**32), st.floats(0.0, 0.9), st.floats(20.0, 300.0))
@examples(40)
def test_a_ramp_passes_unchanged_whatever_the_jitter(seed: int, jitter: float, rate: float) -> None:
    at = stamps(20.0, rate, np.random.default_rng(seed), jitter)
    out = smooth(BASE, at, 3.0 - 0.7 * at, SIGMA, 0.25)
    np.testing.assert_allclose(out.values, 3.0 - 0.7 * BASE, atol=1e-9)
    np.testing.assert_allclose(out.slope, -0.7, atol=1e-8)


def test_slope_is_the_derivative_of_the_filtered_signal() -> None:
    at = stamps(20.0, 100.0)
    out = smooth(BASE, at, np.sin(2 * np.pi * 1.5 * at), SIGMA, 0.2)
    np.testing.assert_allclose(out.slope[2:-2], np.gradient(out.values, BASE)[2:-2], atol=0.02)


def test_white_noise_passes_as_the_bandwidth_says() -> None:
    at = stamps(20.0, 1000.0)
    noise = np.random.default_rng(3).standard_normal((20, len(at)))
    out = np.array([smooth(BASE, at, row, SIGMA, 0.2).values for row in noise])
    np.testing.assert_allclose(out.std(), np.sqrt(white_noise_bandwidth(SIGMA) / 1000.0), rtol=0.05)


@given(st.integers(0, 2**32), st.floats(5.0, 14.0), st.floats(0.1, 3.0))
@examples(40)
def test_nothing_crosses_a_gap(seed: int, gap_start: float, gap_length: float) -> None:
    rng = np.random.default_rng(seed)
    at = stamps(20.0, 100.0, rng, 0.4)
    at = at[(at < gap_start) | (at > gap_start + gap_length)]
    values = rng.standard_normal(len(at))
    moved = np.where(at > gap_start, values + 1e6, values)
    one, other = (smooth(BASE, at, v, SIGMA, 0.05) for v in (values, moved))
    before, after = gap_start - 0.011 > BASE, gap_start + gap_length + 0.011 < BASE
    np.testing.assert_array_equal(one.values[before], other.values[before])
    np.testing.assert_allclose(other.values[after] - one.values[after], 1e6, rtol=1e-6)
    inside = (gap_start + 0.001 < BASE) & (gap_start + gap_length - 0.001 > BASE)
    assert np.isnan(one.values[inside]).all()
    assert not one.covered[inside].any()
    assert one.edge[np.flatnonzero(before)[-1]]


def test_short_pieces_are_gaps() -> None:
    out = smooth(np.arange(0, 2, 0.01), np.array([0.5, 0.51, 1.5]), np.ones(3), SIGMA, 0.05)
    assert not out.covered.any()
