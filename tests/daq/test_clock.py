from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples

from benchmarks.recovery import clopper_pearson
from daq import DataError, fit_clock
from daq.clock import GnssClock

DAY = 86_400.0
START_S = 1_700_000_000


def _frames(
    offset_s: float,
    drift_ppm: float,
    rng: np.random.Generator,
    *,
    jitter_s: float,
    count: int = 1200,
) -> tuple[np.ndarray, np.ndarray]:
    """Return host stamps and true GNSS seconds since 1970; the offset holds in the middle."""
    gnss = START_S + np.arange(count) / 20
    middle = gnss[count // 2]
    host = gnss + offset_s + drift_ppm * 1e-6 * (gnss - middle) + jitter_s * rng.standard_normal(count)
    return np.round(host * 1e9).astype(np.int64), gnss


@given(st.floats(-40_000, 40_000), st.floats(-200, 200), st.sampled_from([None, DAY, 7 * DAY]), st.integers(0, 2**32))
@examples(60)
def test_offset_and_drift_come_back(offset: float, drift: float, period: float | None, seed: int) -> None:
    rng = np.random.default_rng(seed)
    host, gnss = _frames(offset, drift, rng, jitter_s=0.001)
    sent = gnss if period is None else gnss % period
    wrong = rng.random(len(sent)) < 0.05
    sent = np.where(wrong, rng.uniform(0, 1e6, len(sent)), sent)
    fit = fit_clock(host, sent)
    assert fit.offset_s == pytest.approx(offset, abs=5e-4)
    assert fit.drift_ppm == pytest.approx(drift, abs=8)
    assert fit.residual_s == pytest.approx(0.001, rel=0.3)
    assert fit.outliers >= 0.9 * wrong.sum()


@pytest.mark.parametrize("period", [DAY, 7 * DAY])
def test_rolling_over_at_midnight_changes_nothing(period: float) -> None:
    host, gnss = _frames(0.3, 12.0, np.random.default_rng(2), jitter_s=0.001)
    midnight = np.ceil(gnss[0] / period) * period - 30.0  # half a minute before
    shifted = gnss - gnss[0] + midnight
    fit = fit_clock(host + round((midnight - gnss[0]) * 1e9), shifted % period)
    assert shifted[0] % period > shifted[-1] % period
    assert fit.offset_s == pytest.approx(0.3, abs=5e-4)
    assert fit.drift_ppm == pytest.approx(12.0, abs=8)


def test_frames_that_queued_do_not_move_the_line_and_are_seen() -> None:
    rng = np.random.default_rng(4)
    host, gnss = _frames(0.05, 0.0, rng, jitter_s=0.0005)
    late = np.where(rng.random(len(host)) < 0.2, rng.uniform(0.01, 0.2, len(host)), 0.0)
    host = host + np.round(late * 1e9).astype(np.int64)
    fit = fit_clock(host, gnss)
    assert fit.offset_s == pytest.approx(0.05, abs=1e-3)
    np.testing.assert_allclose(fit.delays_s(host, gnss)[late > 0], late[late > 0], atol=0.004)


def test_repeated_epochs_count_once() -> None:
    host, gnss = _frames(0.0, 0.0, np.random.default_rng(5), jitter_s=0.001)
    held = gnss[np.arange(len(gnss)) // 5 * 5]
    assert fit_clock(host, held).epochs == len(np.unique(held))
    assert fit_clock(host, held).offset_s == pytest.approx(0.0, abs=1e-3)


def test_too_few_epochs_are_refused() -> None:
    host, gnss = _frames(0.0, 0.0, np.random.default_rng(6), jitter_s=0.001, count=4)
    with pytest.raises(DataError, match="4 epochs"):
        fit_clock(host, gnss)
    with pytest.raises(DataError, match="0 epochs"):
        fit_clock(host, np.full(4, np.nan))


def _queued(count: int, dt_s: float, rng: np.random.Generator) -> np.ndarray:
    """Return delays, s: now and then the bus is busy for a fifth of a second on average, and many frames queue."""
    changes = rng.random(count)
    more = rng.exponential(0.004, count)
    kept = np.exp(-dt_s / 0.05)
    delay, busy, waits = np.empty(count), False, 0.0
    for i in range(count):
        if changes[i] < dt_s / (0.2 if busy else 1.0):
            busy = not busy
        waits = kept * waits + (1 - kept) * (more[i] if busy else 0.0)
        delay[i] = waits
    return np.asarray(delay + rng.exponential(0.0003, count))


def _independent(count: int, dt_s: float, rng: np.random.Generator) -> np.ndarray:
    del dt_s
    return rng.exponential(0.001, count)


Jitter = Callable[[int, float, np.random.Generator], np.ndarray]


def _stamped(jitter: Jitter, seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    count = round(20 * seconds)
    gnss = START_S + np.arange(count) / 20
    delay = jitter(count, 1 / 20, np.random.default_rng(seed))
    return np.round((gnss + delay) * 1e9).astype(np.int64), gnss


@pytest.mark.parametrize("jitter", [_independent, _queued])
@pytest.mark.parametrize("seconds", [60.0, 300.0])
def test_sigma_is_honest(jitter: Jitter, seconds: float) -> None:
    """95 % intervals hold the truth in 95 % of 100 runs, as far as 100 runs can tell.

    The delay that belongs to a process is what the same estimator finds in runs that are much longer.
    """
    runs = 100
    centre = np.mean([fit_clock(*_stamped(jitter, 3000.0, 10_000 + seed)).offset_s for seed in range(4)])
    fits = [fit_clock(*_stamped(jitter, seconds, seed)) for seed in range(runs)]
    offset_hits = sum(abs(fit.offset_s - centre) < 1.96 * fit.offset_sigma_s for fit in fits)
    drift_hits = sum(abs(fit.drift_ppm) < 1.96 * fit.drift_sigma_ppm for fit in fits)
    for hits in (offset_hits, drift_hits):
        low, high = clopper_pearson(hits, runs, 0.99)
        assert low <= 0.95 <= high


def _fed(host: np.ndarray, gnss: np.ndarray, piece: int = 5) -> GnssClock:
    clock = GnssClock()
    for start in range(0, len(gnss), piece):
        clock.take(host[start : start + piece], gnss[start : start + piece])
    return clock


def test_a_short_run_is_fitted_online_as_afterwards() -> None:
    host, gnss = _frames(0.3, 12.0, np.random.default_rng(7), jitter_s=0.001)
    gnss[100:200:3] = np.nan
    gnss[500:600] = gnss[500]
    assert _fed(host, gnss).fit() == fit_clock(host, gnss)


def test_before_the_fifth_epoch_there_is_no_fit() -> None:
    host, gnss = _frames(0.3, 0.0, np.random.default_rng(8), jitter_s=0.001)
    assert _fed(host[:4], gnss[:4]).fit() is None
    assert _fed(host[:5], gnss[:5]).fit() is not None


def test_a_long_run_is_fitted_in_bounded_memory() -> None:
    """One hour at 100 Hz, every eighth frame late by 5 ms: what repeats itself must not be picked alone."""
    rng = np.random.default_rng(9)
    count = 360_000
    gnss = START_S + np.arange(count) / 100
    host = gnss + 0.2 + 20e-6 * (gnss - gnss[0]) + 0.0005 * rng.standard_normal(count)
    host_ns = np.round((host + (np.arange(count) % 8 == 0) * 0.005) * 1e9).astype(np.int64)
    fit, whole = _fed(host_ns, gnss % DAY, 37).fit(), fit_clock(host_ns, gnss % DAY)
    assert fit is not None
    assert 1000 <= fit.epochs <= 2100
    assert fit.drift_ppm == pytest.approx(20.0, abs=4 * fit.drift_sigma_ppm)
    apart_s = (fit.reference_ns - whole.reference_ns) * 1e-9
    at_reference = whole.offset_s + whole.drift_ppm * 1e-6 * apart_s
    assert fit.offset_s == pytest.approx(at_reference, abs=4 * fit.offset_sigma_s)
    assert fit.offset_sigma_s < 1e-4


def test_gnss_lost_for_twenty_seconds_and_back_with_a_wrong_time() -> None:
    """The receiver is restarted, and for a while counts from its own idea of the date."""
    host, gnss = _frames(0.3, 12.0, np.random.default_rng(10), jitter_s=0.001, count=4800)
    sent = gnss % DAY
    sent[2000:2400] = np.nan
    sent[2400:2700] = np.arange(300) / 20
    fit = _fed(host, sent).fit()
    assert fit is not None
    assert fit.offset_s == pytest.approx(0.3 + 12e-6 * (fit.reference_ns * 1e-9 - gnss[2400]), abs=5e-4)
    assert fit.drift_ppm == pytest.approx(12.0, abs=3)
    assert fit.outliers / fit.epochs == pytest.approx(300 / 4400, rel=0.3)


@pytest.mark.parametrize("period", [DAY, 7 * DAY])
def test_rolling_over_online_changes_nothing(period: float) -> None:
    host, gnss = _frames(0.3, 12.0, np.random.default_rng(2), jitter_s=0.001)
    moved = np.ceil(gnss[0] / period) * period - 30.0 - gnss[0]
    fit = _fed(host + round(moved * 1e9), (gnss + moved) % period).fit()
    assert fit is not None
    assert fit.offset_s == pytest.approx(0.3, abs=5e-4)
    assert fit.offset_sigma_s < 1e-4


def test_the_sigma_of_the_offset_is_its_spread_where_frames_are_only_late() -> None:
    host, gnss = _frames(0.0, 0.0, np.random.default_rng(0), jitter_s=0.0)
    late_s = np.random.default_rng(12).exponential(0.001, (60, len(host)))
    fits = [fit_clock(host + np.round(late * 1e9).astype(np.int64), gnss) for late in late_s]
    ratio = np.mean([fit.offset_sigma_s for fit in fits]) / np.std([fit.offset_s for fit in fits])
    assert 0.7 < ratio < 1.5


def test_a_fit_is_metadata_with_every_digit() -> None:
    fit = fit_clock(*_frames(0.3, 12.0, np.random.default_rng(11), jitter_s=0.001))
    record = fit.as_metadata()
    assert set(record) == {
        *("offset_s", "offset_sigma_s", "drift_ppm", "drift_sigma_ppm", "residual_s", "epochs", "outliers"),
        "reference_ns",
    }
    assert {name: float(text) for name, text in record.items()} == asdict(fit)
