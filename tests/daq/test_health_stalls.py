"""Stalls and the bursts behind them are no losses, and losses inside them are counted."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from property_settings import examples

from daq.can import Message, RawKind, Signal
from daq.logger.health.arrivals import MessageFlow

MS = 1_000_000
COUNTER = Signal("Counter", "", 0, 4, big_endian=False, kind=RawKind.UNSIGNED)


def stalled(
    rng: np.random.Generator, period_ms: float, jitter_ms: float, stalls: list[tuple[float, float]], count: int
) -> NDArray[np.int64]:
    """Return arrivals that wait in stalls of (start, length) in ms, and come out at up to twice the usual pace."""
    arrival_ms = np.arange(count) * period_ms + rng.uniform(0, jitter_ms, count)
    for start_ms, length_ms in stalls:
        waiting = np.flatnonzero(arrival_ms >= start_ms)
        pace_ms = rng.choice([0.0, 0.01, 0.1, 0.5]) * period_ms
        arrival_ms[waiting] = np.maximum(arrival_ms[waiting], start_ms + length_ms + np.arange(len(waiting)) * pace_ms)
    return (10**18 + np.maximum.accumulate(arrival_ms) * MS).astype(np.int64)


def flow_of(time_ns: NDArray[np.int64], numbers: NDArray[np.intp], places: list[int], *, counter: bool) -> MessageFlow:
    signals = (COUNTER,) if counter else ()
    flow = MessageFlow(Message("M", 1, extended=False, length=8, signals=signals), [one.name for one in signals])
    values = (numbers % 16).astype(np.float64)[None] if counter else np.zeros((0, len(numbers)))
    for a, b in pairwise(sorted({0, len(time_ns), *(place % (len(time_ns) + 1) for place in places)})):
        flow.take(time_ns[a:b], values[:, a:b])
    return flow


STREAMS = {
    "period_ms": st.sampled_from([1.0, 2.0, 5.0, 10.0]),
    "jitter_ms": st.sampled_from([0.0, 0.1, 1.0, 5.0, 20.0]),
    "stalls": st.lists(st.tuples(st.floats(0, 9000), st.floats(5, 200)), max_size=15),
    "places": st.lists(st.integers(0, 20_000), max_size=30),
    "seed": st.integers(0, 2**32 - 1),
}


@pytest.mark.parametrize("counter", [True, False])
@examples(150)
@given(**STREAMS)
def test_stalls_and_bursts_are_never_losses(
    counter: bool,
    period_ms: float,
    jitter_ms: float,
    stalls: list[tuple[float, float]],
    places: list[int],
    seed: int,
) -> None:
    count = int(12_000 / period_ms)
    time_ns = stalled(np.random.default_rng(seed), period_ms, jitter_ms, stalls, count)
    flow = flow_of(time_ns, np.arange(count), places, counter=counter)
    assert (flow.counter_lost, flow.missing, flow.repeated) == (0, 0, 0)


@examples(100)
@given(
    period_ms=STREAMS["period_ms"],
    jitter=st.sampled_from([0.0, 0.05, 0.2]),
    lost=st.integers(1, 300).filter(lambda lost: lost % 16 != 15),
    length_ms=st.floats(5, 200),
    places=STREAMS["places"],
    seed=STREAMS["seed"],
)
@example(period_ms=1.0, jitter=0.05, lost=16, length_ms=15.0, places=[], seed=1)  # a frame inside the gap, one early
def test_losses_inside_a_stall_are_counted_with_their_turns(
    period_ms: float, jitter: float, lost: int, length_ms: float, places: list[int], seed: int
) -> None:
    count, first = int(14_000 / period_ms), int(5000 / period_ms)
    whole = stalled(np.random.default_rng(seed), period_ms, jitter * period_ms, [(5000.0, length_ms)], count)
    numbers = np.delete(np.arange(count), slice(first + 1, first + 1 + lost))
    flow = flow_of(whole[numbers], numbers, places, counter=True)
    assert (flow.counter_lost, flow.at_least) == (lost, False)
    rate = flow_of(whole[numbers], numbers, places, counter=False)
    assert abs(rate.missing - lost) <= 1


def test_one_frame_less_than_a_turn_is_a_loss_and_no_standing_still() -> None:
    numbers = np.delete(np.arange(8000), slice(5000, 5015))
    flow = flow_of(10**18 + numbers * MS, numbers, [5000], counter=True)
    assert (flow.counter_lost, flow.repeated) == (15, 0)


def test_an_adapter_that_begins_to_delay_everything_loses_nothing_for_certain() -> None:
    """50 frames late for ever, and every step of the counter 1: it cannot have gone round."""
    numbers = np.arange(12_000)
    flow = flow_of(10**18 + (numbers + 56 * (numbers > 6000)) * MS, numbers, [], counter=True)
    assert flow.counter_lost == 0
    assert flow.at_least


@pytest.mark.parametrize("jitter_ms", [0.0, 0.3, 1.0, 5.0, 20.0])
def test_the_usual_rate_is_frames_over_time(jitter_ms: float) -> None:
    time_ns = stalled(np.random.default_rng(1), 1.0, jitter_ms, [], 12_000)
    assert flow_of(time_ns, np.arange(12_000), [], counter=False).period_s == pytest.approx(1e-3, rel=5e-4)


def _held_to(time_ns: NDArray[np.int64], every_ms: int) -> NDArray[np.int64]:
    """Return arrivals of frames that wait for the next multiple of `every_ms`."""
    return -(-time_ns // (every_ms * MS)) * every_ms * MS


@pytest.mark.parametrize(("every_ms", "lost"), [(20, 383), (50, 383), (50, 40), (100, 300)])
def test_turns_lost_in_a_stream_of_bursts_are_resolved_by_time_over_period(every_ms: int, lost: int) -> None:
    numbers = np.delete(np.arange(16_000), slice(8000, 8000 + lost))
    flow = flow_of(10**18 + _held_to(numbers * MS, every_ms), numbers, [], counter=True)
    assert (flow.counter_lost, flow.wrapped) == (lost, 0)


def test_turns_lost_in_one_gap_after_another_are_resolved() -> None:
    numbers = np.arange(8000)
    numbers = numbers[(numbers < 1000) | (numbers > 6000) | (numbers % 60 >= 40)]
    flow = flow_of(10**18 + numbers * 10 * MS, numbers, [], counter=True)
    assert 0.9 * (8000 - len(numbers)) < flow.counter_lost <= 8000 - len(numbers)
    assert flow.counter_lost == 8000 - len(numbers) or flow.wrapped


def test_a_count_that_may_have_wrapped_stays_the_least_when_the_rate_is_known_again() -> None:
    rng = np.random.default_rng(4)
    numbers = np.arange(12_000)
    numbers = numbers[(numbers < 2000) | (numbers > 4000) | (rng.random(12_000) > 0.95)]
    flow = flow_of(10**18 + numbers * 10 * MS, numbers, [], counter=True)
    assert flow.counter_lost < 12_000 - len(numbers)
    assert flow.wrapped and flow.at_least
