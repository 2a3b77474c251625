from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import DataError, sampling_of
from processing import in_order, interpolate, merge_equal_stamps
from processing.pipeline.resampling import interpolated_on_base
from processing.timebase import as_of, make_time_base, stretches

MS = 1_000_000


def _ns(*milliseconds: float) -> np.ndarray:
    return np.array([round(m * MS) for m in milliseconds], np.int64)


def test_frames_that_queued_are_put_in_their_place() -> None:
    np.testing.assert_array_equal(in_order(_ns(0, 20, 10, 30)), [0, 2, 1, 3])


def test_one_rogue_stamp_is_left_out_whether_ahead_or_behind() -> None:
    ahead, behind = np.arange(0, 50_000, 10.0), np.arange(0, 50_000, 10.0)
    ahead[17], behind[4000] = 9e12, -9e12
    np.testing.assert_array_equal(in_order(_ns(*ahead)), np.delete(np.arange(5000), 17))
    np.testing.assert_array_equal(in_order(_ns(*behind)), np.delete(np.arange(5000), 4000))


def test_a_clock_that_steps_back_costs_the_time_it_repeats() -> None:
    time = np.concatenate([np.arange(0, 10_000, 10.0), np.arange(8_000, 20_000, 10.0)])
    kept = in_order(_ns(*time))
    assert np.all(np.diff(time[kept]) >= 0)
    assert len(time) - len(kept) == pytest.approx(200, abs=15)


@given(st.lists(st.integers(-(10**12), 10**12), max_size=60))
def test_any_stamps_come_out_ascending(stamps: list[int]) -> None:
    time = np.array(stamps, np.int64)
    kept = in_order(time)
    assert np.all(np.diff(time[kept]) >= 0)
    assert len(np.unique(kept)) == len(kept) >= min(1, len(time))


def test_hopeless_disorder_ends() -> None:
    time = np.random.default_rng(1).integers(0, 10**15, 20_000)
    assert np.all(np.diff(time[in_order(time)]) >= 0)


def test_equal_stamps_become_their_mean() -> None:
    time, values = merge_equal_stamps(_ns(0, 10, 10, 10, 20), np.array([1.0, 2.0, 3.0, 7.0, 5.0]))
    np.testing.assert_array_equal(time, _ns(0, 10, 20))
    np.testing.assert_array_equal(values, [1.0, 4.0, 5.0])


def test_stretches_end_at_gaps() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.5, 0.6, 2.0])
    np.testing.assert_array_equal(stretches(time, 0.15), [[0, 3], [3, 5], [5, 6]])
    np.testing.assert_array_equal(stretches(time, 0.15, least=2), [[0, 3], [3, 5]])
    assert stretches(np.zeros(0), 0.1).shape == (0, 2)


def test_as_of_takes_the_latest_that_is_not_stale() -> None:
    source = _ns(0, 100, 200)
    np.testing.assert_array_equal(as_of(_ns(-1, 0, 99, 100, 260, 400), source, 80 * MS), [-1, 0, -1, 1, 2, -1])
    np.testing.assert_array_equal(as_of(_ns(5), _ns(), 80 * MS), [-1])


@given(st.lists(st.floats(0, 100), min_size=2, max_size=30, unique=True), st.floats(0.5, 20))
def test_interpolation_is_bounded_by_its_neighbours_and_stops_at_gaps(time: list[float], limit: float) -> None:
    at = np.sort(time)
    values = np.random.default_rng(0).standard_normal(len(at))
    grid = np.linspace(-1, 101, 307)
    out = interpolate(grid, at, values, limit)
    after = np.searchsorted(at, grid, side="right")
    for instant, value, k in zip(grid, out, after, strict=True):
        between = 0 < k < len(at)
        if between and at[k] - at[k - 1] <= limit:
            low, high = sorted(values[k - 1 : k + 1])
            assert low - 1e-12 <= value <= high + 1e-12
        elif instant not in at:
            assert np.isnan(value)


def test_the_base_covers_everything_on_whole_steps() -> None:
    start, time = make_time_base({"a": (1_234_567, 5_000_000_000), "b": (999_000_000, 7_001_000_000)}, 100.0)
    assert start == 10_000_000
    assert start + round(time[-1] * 1e9) == 7_000_000_000
    np.testing.assert_allclose(np.diff(time), 0.01)


@pytest.mark.parametrize(
    ("spans", "words"),
    [
        ({"a": (0, 10**9), "b": (2 * 10**9, 3 * 10**9)}, "never there at the same time"),
        ({"a": (5 * MS, 6 * MS)}, "too short"),
        ({"a": (0, 10**18), "b": (0, 10**9)}, "hours"),
    ],
)
def test_no_base_without_common_sensible_time(spans: dict[str, tuple[int, int]], words: str) -> None:
    with pytest.raises(DataError, match=words):
        make_time_base(spans, 100.0)


def test_one_sample_that_is_late_is_bridged_and_one_that_is_missing_is_not() -> None:
    for interval_ns, bridged in ((170_000_000, True), (200_000_000, False)):
        time_ns = np.cumsum([0, *[100_000_000] * 20, interval_ns, *[100_000_000] * 20])
        samples = SimpleNamespace(time_ns=time_ns, values=np.arange(42.0), sampling=sampling_of(time_ns))
        between = interpolated_on_base(samples, 0, np.array([2.0, 2.05, 2.1]))[1]  # type: ignore[arg-type]
        assert np.isfinite(between) == bridged
