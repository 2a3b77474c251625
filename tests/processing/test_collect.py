import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from property_settings import examples

from processing.pipeline.collection import Collector, resolution, rethin, thin

NODE_NS = 10_000_000
ORIGIN = 1_700_000_000_123_456_789


def _kilohertz(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    time = ORIGIN + np.arange(count) * 1_000_000 + rng.integers(0, 300_000, count)
    return time, rng.standard_normal(count)


@given(st.integers(1, 3000), st.integers(0, 2**32))
@examples(50)
def test_thinning_keeps_every_samples_weight(count: int, seed: int) -> None:
    time, values = _kilohertz(count, seed)
    nodes = thin(time, values, NODE_NS)
    at, mean, spread = nodes.entries(NODE_NS)
    assert nodes.sums[0].sum() == pytest.approx(count)
    assert nodes.sums[3].sum() == pytest.approx(values.sum())
    assert np.all(np.diff(at) >= 0)
    assert values.min() - 1e-12 <= mean.min()
    assert mean.max() <= values.max() + 1e-12
    assert 0 <= spread.min() <= spread.max() <= (NODE_NS * 1e-9) ** 2 / 4 * (1 + 1e-9)


def test_thinning_keeps_a_ramp() -> None:
    time, _ = _kilohertz(5000)
    at, mean, spread = thin(time, (time - ORIGIN) * 1e-9, NODE_NS).entries(NODE_NS)
    np.testing.assert_allclose(mean, (at - ORIGIN) * 1e-9, atol=2e-9)
    assert len(at) == pytest.approx(501, abs=2)
    assert spread.mean() == pytest.approx((NODE_NS * 1e-9) ** 2 / 6, rel=0.05)


def _collected(pieces: list[tuple[np.ndarray, np.ndarray]]):
    collector = Collector(NODE_NS)
    for time, values in pieces:
        collector.add(time, values)
    return collector.finish()


def test_slow_channels_stay_as_they_are() -> None:
    time, values = ORIGIN + np.arange(500) * 50_000_000, np.random.default_rng(0).standard_normal(500)
    samples = _collected([(time[:200], values[:200]), (time[200:], values[200:])])
    np.testing.assert_array_equal(samples.time_ns, time)
    np.testing.assert_array_equal(samples.values, values)
    assert samples.sampling.interval_s == pytest.approx(0.05)
    assert (samples.node_s, samples.spread_s2, samples.count, samples.late) == (0.0, 0.0, 500, 0)


def test_kilohertz_channels_come_down_to_the_base() -> None:
    time, values = _kilohertz(100_000)
    samples = _collected([(time[k : k + 7000], values[k : k + 7000]) for k in range(0, 100_000, 7000)])
    assert len(samples.time_ns) < 10_100
    assert samples.sampling.interval_s == pytest.approx(0.001, rel=0.01)
    assert samples.count == 100_000
    assert samples.node_s == pytest.approx(0.01)


def test_frames_without_a_value_leave_their_stamp() -> None:
    time = ORIGIN + np.arange(100) * 50_000_000
    values = np.where(np.arange(100) % 3 == 0, np.nan, 1.0)
    samples = _collected([(time, values)])
    assert samples.count == 66
    assert len(samples.absent_ns) == 34
    assert np.abs(samples.absent_ns - time[::3]).max() <= NODE_NS
    assert len(samples.received_ns()) == 100


def test_samples_that_run_backward_are_counted_across_chunks() -> None:
    time, values = ORIGIN + np.arange(40_000) * 1_000_000, np.zeros(40_000)
    again = time[10_000:20_000]
    samples = _collected([(time[:20_000], values[:20_000]), (again, values[:10_000]), (time[20_000:], values[20_000:])])
    assert samples.late == pytest.approx(10_000, abs=200)
    assert np.all(np.diff(samples.time_ns) > 0)


@given(st.sampled_from([0.01, 0.25, 1 / 3.6, 2.0]), st.integers(0, 2**32))
@settings(deadline=None)
def test_resolution_is_found(step: float, seed: int) -> None:
    steps = np.random.default_rng(seed).integers(-8, 9, 400).cumsum() // 10
    found = resolution(step * steps)
    assert found == 0.0 if np.ptp(steps) == 0 else found == pytest.approx(step)


def test_continuous_values_have_no_resolution() -> None:
    assert resolution(np.random.default_rng(0).standard_normal(4000)) == 0.0
    assert resolution(np.ones(10)) == 0.0


def test_thinning_twice_keeps_slow_channels() -> None:
    slow = _collected([(ORIGIN + np.arange(50) * 1_000_000_000, np.arange(50.0))])
    assert rethin(slow, 0.1) is slow
    fast = _collected([_kilohertz(50_000)])
    twice = rethin(fast, 0.1)
    assert len(twice.time_ns) == pytest.approx(501, abs=3)
    assert twice.spread_s2 > fast.spread_s2
