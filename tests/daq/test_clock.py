import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.clock import fit_clock
from daq.errors import DataError

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
@settings(max_examples=60, deadline=None)
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
