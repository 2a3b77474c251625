"""The rate of samples that come as bursts, after pauses, with equal stamps and with losses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import IntArray, SamplingEstimator, sampling_of
from daq.sampling import _unit_of

_START_NS = 1_777_881_600_000_000_000
_PERIODS_S = st.floats(0.001, 1.0)
_SEEDS = st.integers(0, 2**32 - 1)


def _stamps(time_s: object) -> IntArray:
    return _START_NS + np.rint(np.asarray(time_s) * 1e9).astype(np.int64)


def _in_bursts(rng: np.random.Generator, period_s: float, largest: int, inner: float, count: int) -> np.ndarray:
    """Return when samples arrive that wait for up to `largest` of them, `inner` periods apart (0: all at once)."""
    sizes = rng.integers(1, largest + 1, count)
    sizes = sizes[: int(np.searchsorted(np.cumsum(sizes), count)) + 1]
    ends = np.cumsum(sizes)
    within = np.concatenate([np.arange(size) for size in sizes])
    return np.repeat(ends, sizes) * period_s + within * inner * period_s


@given(_PERIODS_S, st.integers(2, 20), st.sampled_from([0.0, 0.01, 0.5]), _SEEDS)
def test_rate_of_bursts_is_the_sender_s(period_s: float, largest: int, inner: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    arrived = np.sort(_in_bursts(rng, period_s, largest, inner / largest, 4000))
    sampling = sampling_of(_stamps(arrived))
    assert sampling.rate_hz * period_s == pytest.approx(1.0, rel=0.01)
    assert sampling.period_s == pytest.approx(period_s, rel=0.01) and sampling.missing_share < 0.01


@given(st.floats(0.001, 0.15), st.integers(2, 10), st.lists(st.floats(3.0, 600.0), max_size=4), _SEEDS)
def test_pauses_are_no_part_of_the_duration(period_s: float, largest: int, pauses_s: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    arrived = np.sort(_in_bursts(rng, period_s, largest, 0.0, 8000))
    for pause_s in pauses_s:
        arrived[int(rng.integers(1, 8) * 1000) :] += pause_s
    assert sampling_of(_stamps(arrived)).rate_hz * period_s == pytest.approx(1.0, rel=0.01)


@given(_PERIODS_S, st.floats(0.0, 0.8), st.floats(0.0, 0.05), _SEEDS)
def test_lost_samples_lower_the_rate_and_are_missing(period_s: float, lost: float, jitter: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sent = np.arange(6000) + rng.normal(0, jitter, 6000)
    came = sent[rng.random(6000) >= lost] * period_s
    sampling = sampling_of(_stamps(came))
    assert sampling.rate_hz == pytest.approx((len(came) - 1) / (came[-1] - came[0]), rel=0.01)
    assert sampling.missing_share == pytest.approx(1 - len(came) / 6000, abs=0.02)


@given(_PERIODS_S, st.integers(2, 4), _SEEDS)
def test_equal_stamps_count(period_s: float, copies: int, seed: int) -> None:
    jitter = np.random.default_rng(seed).normal(0, 0.02, 1000)
    stamps = np.repeat(_stamps((np.arange(1000) + jitter) * period_s), copies)
    sampling = sampling_of(stamps)
    assert sampling.rate_hz * period_s == pytest.approx(copies, rel=0.01)
    assert sampling.spacing_s == pytest.approx(period_s, rel=0.1), "holes are judged by the stamps that differ"


@given(_PERIODS_S, st.lists(st.integers(1, 20_000), min_size=1, max_size=6), _SEEDS)
def test_pieces_change_nothing_but_the_last_digits(period_s: float, sizes: list[int], seed: int) -> None:
    stamps = _stamps(np.arange(sum(sizes)) * period_s + np.random.default_rng(seed).normal(0, 0.01 * period_s))
    estimator = SamplingEstimator()
    for piece in np.split(stamps, np.cumsum(sizes)[:-1]):
        estimator.take(piece)
    whole, pieces = sampling_of(stamps), estimator.estimate()
    assert pieces.rate_hz == pytest.approx(whole.rate_hz, rel=1e-6, nan_ok=True)
    assert pieces.interval_s == pytest.approx(whole.interval_s, rel=1e-6, nan_ok=True)


def test_a_rogue_stamp_and_a_step_of_the_clock_are_no_duration() -> None:
    regular = np.arange(3000) * 0.01
    rogue = np.concatenate([regular[:1000], [regular[1000] + 86_400], regular[1001:]])
    stepped = np.concatenate([regular[:1500], regular[1500:] - 3600])
    for stamps in (rogue, stepped):
        assert sampling_of(_stamps(stamps)).rate_hz == pytest.approx(100.0, rel=1e-3)


def test_slow_samples_are_not_pauses_and_events_have_no_period() -> None:
    assert sampling_of(_stamps(np.arange(100) * 5.0)).rate_hz == pytest.approx(0.2)
    events = np.cumsum(np.random.default_rng(0).exponential(0.02, 3000))
    sampling = sampling_of(_stamps(events))
    assert np.isnan(sampling.period_s) and np.isnan(sampling.missing_share)
    assert sampling.rate_hz == pytest.approx(50, rel=0.05)


@pytest.mark.parametrize("count", [0, 1])
def test_no_rate_below_two_samples(count: int) -> None:
    assert np.isnan(sampling_of(_stamps(np.zeros(count))).rate_hz)


def test_a_short_stream_is_not_faster_for_its_first_burst() -> None:
    ends = np.repeat(np.arange(20, 320, 20), 20) * 0.01
    assert sampling_of(_stamps(ends + np.tile(np.arange(20) * 1e-5, 15))).rate_hz == pytest.approx(100.0, rel=0.001)


def test_a_nanosecond_is_an_interval() -> None:
    steps = np.random.default_rng(0).geometric(0.4, 3000)  # of one sample a nanosecond three of five are lost
    assert sampling_of(_START_NS + np.cumsum(steps)).period_s == pytest.approx(1e-9)


@pytest.mark.parametrize(("intervals", "regular"), [(127, False), (128, True)])
def test_bursts_are_regular_once_sixteen_blocks_of_eight_take_equal_times(intervals: int, regular: bool) -> None:
    steps = np.resize([1, 19], intervals) * 10**6
    assert sampling_of(10**18 + np.cumsum([0, *steps])).regular == regular


@pytest.mark.parametrize("hours", [1, 0.02])
def test_a_clock_that_is_set_back_leaves_no_share_above_all(hours: float) -> None:
    """The end of summer time, within a run of 40 s."""
    time_s = np.arange(4000) / 100
    missing = sampling_of(_stamps(np.where(time_s < 20, time_s, time_s - 3600 * hours))).missing_share
    assert np.isnan(missing) or 0 <= missing <= 1


@pytest.mark.parametrize(("longer", "found"), [(19, []), (20, [10.0])])
def test_twenty_longer_intervals_tell_the_sender_s_period(longer: int, found: list[float]) -> None:
    assert _unit_of(np.repeat([10, 20], [100, longer])) == found
