"""Gaps by the usual rate: jitter and bursts of arrival are no losses; losses are counted, however batches are cut."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from property_settings import examples

from daq.can import Message
from daq.logger.health.arrivals import MessageFlow
from daq.logger.health.gaps import Gaps, keeps, learn, learned_after

MS = 1_000_000


def arrivals(rng: np.random.Generator, period_ms: float, count: int, jitter: float) -> NDArray[np.int64]:
    """Return arrivals that jitter about an even beat by a share of the period."""
    beat = 10**18 + np.arange(count) * period_ms * MS
    return np.sort((beat + rng.uniform(-jitter, jitter, count) * period_ms * MS).astype(np.int64))


def flow_of(time_ns: NDArray[np.int64], places: list[int]) -> MessageFlow:
    flow = MessageFlow(Message("M", 1, extended=False, length=8, signals=()), [])
    edges = sorted({0, len(time_ns), *(place % (len(time_ns) + 1) for place in places)})
    for a, b in pairwise(edges):
        flow.take(time_ns[a:b], np.zeros((0, b - a)))
    return flow


@examples(60)
@given(
    period_ms=st.sampled_from([1.0, 2.5, 10.0, 50.0]),
    jitter=st.floats(0.0, 0.2),
    losses=st.lists(st.tuples(st.integers(5, 60), st.integers(1, 40)), min_size=1, max_size=8),
    places=st.lists(st.integers(0, 10_000), max_size=30),
    seed=st.integers(0, 2**32 - 1),
)
def test_losses_are_counted_to_one_a_gap(
    period_ms: float, jitter: float, losses: list[tuple[int, int]], places: list[int], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    learning = max(int(3200 / period_ms), 40)
    kept, at = [np.arange(learning)], learning
    for sound, lost in losses:
        kept.append(np.arange(at + lost, at + lost + sound))
        at += lost + sound
    judged = at + max(int(2500 / period_ms), 300)
    kept.append(np.arange(at, judged))
    whole = arrivals(rng, period_ms, judged, jitter)
    time_ns = whole[np.concatenate(kept)]
    flow = flow_of(time_ns, [])
    true = sum(lost for _, lost in losses)
    assert abs(flow.missing - true) <= len(losses)
    if jitter < 0.05:
        assert flow.missing == true
    cut = flow_of(time_ns, places)
    assert (cut.missing, cut.gaps, cut.period_s) == (flow.missing, flow.gaps, flow.period_s)


def test_where_most_frames_are_lost_for_long_the_rate_stands() -> None:
    sound = [np.arange(at, at + 12) for at in range(64, 64 + 8 * 52, 52)]
    kept = np.concatenate([np.arange(64), *sound, np.arange(64 + 8 * 52, 900)])
    flow = flow_of(arrivals(np.random.default_rng(0), 50.0, 900, 0.02)[kept], [])
    assert (flow.missing, flow.gaps, flow.rate_changes) == (8 * 40, 8, 0)


@pytest.mark.parametrize("period_ms", [1.0, 10.0])
@pytest.mark.parametrize("stall", [3, 40, 300])
def test_a_burst_makes_up_for_its_gap(period_ms: float, stall: int) -> None:
    time_ns = arrivals(np.random.default_rng(0), period_ms, 8000, 0.05)
    late = slice(5000, 5000 + stall)
    time_ns[late] = time_ns[5000 + stall] - np.arange(stall, 0, -1) * 10_000
    assert flow_of(time_ns, []).missing == 0
    lossy = np.delete(time_ns, np.arange(5000 + stall // 2, 5000 + stall // 2 + 2))
    assert abs(flow_of(lossy, []).missing - 2) <= 1


def test_arrivals_in_bursts_are_regular() -> None:
    """A driver that hands over frames of 5 ms at once."""
    time_ns = 10**18 + (np.arange(8000) // 5 + 1) * 5 * MS + np.arange(8000) % 5 * 2000
    flow = flow_of(time_ns, [])
    assert flow.period_s == pytest.approx(1e-3, rel=0.02)
    assert flow.missing == 0
    assert not flow.silent(int(time_ns[-1]) + 900 * MS)
    assert flow.silent(int(time_ns[-1]) + 2000 * MS)


def test_messages_that_come_when_something_happens_are_never_missing() -> None:
    time_ns = 10**18 + np.cumsum(np.random.default_rng(2).exponential(50 * MS, 2000)).astype(np.int64)
    flow = flow_of(time_ns, [])
    assert flow.learned
    assert np.isnan(flow.period_s)
    assert flow.missing == 0
    assert not flow.silent(int(time_ns[-1]) + 10**12)


def test_another_rate_is_learned() -> None:
    first = arrivals(np.random.default_rng(3), 10.0, 1000, 0.02)
    then = first[-1] + 20 * MS * np.arange(1, 1000)
    flow = flow_of(np.concatenate([first, then]), [17, 999, 1001, 1300])
    assert flow.period_s == pytest.approx(0.02, rel=0.01)
    assert flow.rate_changes == 1
    before = flow.missing
    flow.take(then[-1] + 20 * MS * np.arange(1, 500), np.zeros((0, 499)))
    assert flow.missing == before


def test_a_declared_rate_stands_until_one_is_learned() -> None:
    flow = MessageFlow(Message("M", 1, extended=False, length=8, signals=(), cycle_time_s=0.02), [])
    assert flow.period_s == 0.02
    flow.take(arrivals(np.random.default_rng(4), 10.0, 400, 0.02), np.zeros((0, 400)))
    assert flow.period_s == pytest.approx(0.01, rel=0.01)


def test_nothing_is_judged_across_a_break() -> None:
    time_ns = arrivals(np.random.default_rng(5), 10.0, 400, 0.02)
    flow = flow_of(time_ns, [])
    flow.forget_last()
    flow.take(time_ns[-1] + 10**9 + np.arange(1, 100) * 10 * MS, np.zeros((0, 99)))
    assert flow.missing == 0


def test_frames_that_were_skipped_are_not_missing() -> None:
    time_ns = arrivals(np.random.default_rng(6), 10.0, 2000, 0.02)
    flow = flow_of(time_ns[:600], [])
    flow.skip(time_ns[650:900], int(time_ns[899]))  # 50 of them were not even counted
    assert not flow.silent(int(time_ns[899]) + 900 * MS)
    flow.take(time_ns[900:], np.zeros((0, 1100)))
    assert (flow.missing, flow.gaps, flow.frames) == (0, 0, 1950)


def test_a_gap_that_cannot_be_judged_before_frames_are_skipped_is_no_loss() -> None:
    time_ns = arrivals(np.random.default_rng(7), 10.0, 2000, 0.02)
    flow = flow_of(np.delete(time_ns[:600], np.arange(590, 598)), [])
    flow.skip(time_ns[600:900], int(time_ns[899]))
    flow.take(time_ns[900:], np.zeros((0, 1100)))
    assert (flow.missing, flow.gaps, flow.at_least) == (0, 0, True)


def test_learning_asks_for_time_and_frames() -> None:
    slow = 10**18 + np.arange(20) * 10**9
    assert learned_after(slow[:10], 10) is None
    assert learned_after(slow, 10) == 11
    fast = 10**18 + np.arange(4000) * MS
    assert learned_after(fast[:2000], 10) is None
    assert learned_after(fast, 10) == 3001
    assert learned_after(10**18 + np.arange(10_000) * 10_000, 10) == 8192


@pytest.mark.parametrize(("share", "kept"), [(0.34, True), (0.36, False)])
def test_a_rate_is_that_of_intervals_within_a_third_of_it(share: float, kept: bool) -> None:
    uneven = 10**18 + np.cumsum(10 * MS * (1 + share * np.resize([0, 1, 0, -1], 400))).astype(np.int64)
    usual, even = learn(uneven), learn(10**18 + np.arange(400) * 10 * MS)
    assert even is not None and keeps(uneven, even) == kept
    assert (usual is not None and usual.wide_ns < 20 * MS) == kept, "what comes in bursts may be later"


def test_a_gap_is_judged_once_the_frames_behind_it_catch_up_no_more() -> None:
    usual = learn(10**18 + np.arange(400) * 10 * MS)
    assert usual is not None
    gaps = Gaps(usual)
    even = np.arange(300) * 10 * MS
    assert gaps.take(np.delete(even[:160], slice(100, 104)), np.zeros(156, np.int64)) == []
    assert gaps.open
    verdicts = gaps.take(even[160:], np.zeros(140, np.int64))
    assert (verdicts[0].gaps, verdicts[0].lacking) == (1, 4)
    assert not gaps.open
