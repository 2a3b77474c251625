import numpy as np
import pytest
from scipy.signal import lfilter

from processing import Segment
from processing.pipeline import kernel_sigma_s
from processing.pipeline.collection import Collector, Samples
from processing.pipeline.filters import filtered_sigma, smooth, standstill_sigma

CUTOFF = 4.0
KERNEL = kernel_sigma_s(CUTOFF)
BASE = np.arange(100, 5900) / 100.0


def _samples(values: np.ndarray, rate: float) -> Samples:
    collector = Collector(10_000_000)
    collector.add(np.round(np.arange(len(values)) / rate * 1e9).astype(np.int64), values)
    return collector.finish()


def _filtered(values: np.ndarray, rate: float, declared: float | None) -> tuple[np.ndarray, float, str]:
    samples = _samples(values, rate)
    at = samples.time_ns * 1e-9
    out = smooth(BASE, at, samples.values, KERNEL, 0.2, samples.spread_s2)
    sigma, source = filtered_sigma(
        samples, samples.values - np.interp(at, BASE, out.values, np.nan, np.nan), KERNEL, declared
    )
    return out.values, sigma, source


@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("declared", [None, 0.3])
def test_sigma_of_white_noise_on_a_moving_signal(rate: float, declared: float | None) -> None:
    rng = np.random.default_rng(7)
    errors, sigmas = [], []
    for _ in range(8):
        at = np.arange(int(60 * rate)) / rate
        signal = 5 * np.sin(0.7 * at)
        values, sigma, source = _filtered(signal + 0.3 * rng.standard_normal(len(at)), rate, declared)
        clean, _, _ = _filtered(signal, rate, declared)
        errors.append(values - clean)
        sigmas.append(sigma)
    assert source == ("declared" if declared else "estimated")
    assert np.mean(sigmas) == pytest.approx(np.std(errors), rel=0.12)


def test_what_is_declared_beyond_the_white_noise_is_slow_and_stays() -> None:
    rng = np.random.default_rng(8)
    at = np.arange(0, 60, 0.05)
    _, sigma, _ = _filtered(np.sin(0.7 * at) + 0.02 * rng.standard_normal(len(at)), 20.0, 0.05)
    white = 0.02 * np.sqrt(0.05 / (2 * np.sqrt(np.pi) * KERNEL))
    assert sigma == pytest.approx(np.hypot(white, np.sqrt(0.05**2 - 0.02**2)), rel=0.06)


@pytest.mark.parametrize("declared", [None, 60.0])
def test_slow_noise_of_a_kilohertz_channel_is_not_averaged_away(declared: float | None) -> None:
    rng = np.random.default_rng(10)
    decay = np.exp(-0.001 / 0.1)
    slow = lfilter([np.sqrt(1 - decay**2)], [1, -decay], rng.standard_normal(60_000))
    values, sigma, _ = _filtered(60.0 * slow + 8.0 * rng.standard_normal(60_000), 1000.0, declared)
    if declared:
        assert np.std(values) < sigma < 1.5 * np.std(values)
    else:  # in-band noise looks like signal; the rest still shows
        assert 0.05 * np.std(values) < sigma < np.std(values)


@pytest.mark.parametrize("rate", [100.0, 200.0, 1000.0])
def test_signal_beyond_the_cutoff_is_not_taken_for_white_noise(rate: float) -> None:
    """What bounces at 6 Hz is filtered out as noise is; a declared slow noise must not shrink by it."""
    rng = np.random.default_rng(11)
    at = np.arange(int(60 * rate)) / rate
    decay = np.exp(-1 / rate / 0.1)
    slow = 60 * lfilter([np.sqrt(1 - decay**2)], [1, -decay], rng.standard_normal(len(at)))
    bounce = 300 * np.sin(2 * np.pi * 6 * at)
    values, sigma, _ = _filtered(bounce + slow, rate, 60.0)
    clean, _, _ = _filtered(bounce, rate, 60.0)
    assert 0.8 * np.std(values - clean) < sigma < 1.6 * np.std(values - clean)


def test_a_quiet_quantised_signal_is_not_exact() -> None:
    at = np.arange(0, 60, 0.05)
    speed = 10 + 2 * np.sin(0.1 * at)
    step = 1 / 3.6
    values, sigma, _ = _filtered(np.round(speed / step) * step, 20.0, None)
    error = values - 10 - 2 * np.sin(0.1 * BASE)
    assert sigma == pytest.approx(step / np.sqrt(12), rel=0.35)
    assert np.std(error) < 1.2 * sigma


def test_nothing_is_known_of_a_handful_of_samples() -> None:
    samples = _samples(np.random.default_rng(0).standard_normal(5), 20.0)
    assert np.isnan(filtered_sigma(samples, np.full(5, np.nan), KERNEL, None)[0])
    assert filtered_sigma(samples, np.full(5, np.nan), KERNEL, 0.1)[0] == pytest.approx(0.1, rel=0.5)


def test_standstill_shows_slow_noise_but_not_the_launch() -> None:
    rng = np.random.default_rng(9)
    values = 50 * np.interp(np.arange(2000), np.arange(0, 2000, 10), rng.standard_normal(200))
    kind = np.full(2000, Segment.DRIVE, np.uint8)
    kind[:800] = Segment.STANDSTILL
    values[700:800] += np.linspace(0, 900, 100)
    spread = standstill_sigma(values, kind, 100.0, CUTOFF)
    assert spread == pytest.approx(np.std(values[:700]), rel=0.3)
    assert np.isnan(standstill_sigma(values, np.full(2000, Segment.DRIVE, np.uint8), 100.0, CUTOFF))
