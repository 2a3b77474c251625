"""Rolling counters: any range, any losses, however the frames are cut into batches."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.can import RawKind, Signal
from daq.logger.health.arrivals import NO_VALUE, RollingCounter, counts, is_named_so, may_count, raw_of


def signal(name: str = "Counter", bits: int = 4, **more: object) -> Signal:
    return Signal(name, "", 0, bits, big_endian=False, kind=RawKind.UNSIGNED, **more)  # type: ignore[arg-type]


@st.composite
def streams(draw: st.DrawFn) -> tuple[int, int, int, list[int]]:
    """Bits, lowest value, modulus, and how many frames are lost before each frame of a long stream."""
    bits = draw(st.integers(2, 8))
    low = draw(st.integers(0, 1))
    modulus = draw(st.integers(min(4, (1 << bits) - low), (1 << bits) - low))
    sound = [0] * (3 * modulus)  # two turns that nothing is lost in make the range known
    losses = draw(st.lists(st.integers(0, modulus - 2) | st.just(0), max_size=60))
    return bits, low, modulus, [*sound, *losses]


def values(low: int, modulus: int, losses: list[int]) -> np.ndarray:
    return low + np.cumsum([1 + lost for lost in losses], dtype=np.int64) % modulus


def cut(raw: np.ndarray, places: list[int]) -> list[np.ndarray]:
    edges = sorted({0, len(raw), *(place % (len(raw) + 1) for place in places)})
    return [raw[a:b] for a, b in pairwise(edges)]


@given(streams(), st.lists(st.integers(0, 5000), max_size=20))
def test_every_loss_is_counted_once_in_any_batches(stream: tuple[int, int, int, list[int]], places: list[int]) -> None:
    bits, low, modulus, losses = stream
    raw = values(low, modulus, losses)
    whole, pieces = RollingCounter(bits), RollingCounter(bits)
    lost = whole.take(raw)
    for piece in cut(raw, places):
        pieces.take(piece)
    assert whole.modulus == modulus
    assert whole.lost == sum(losses)
    assert lost[3 * modulus :].tolist() == losses[3 * modulus :]
    assert (pieces.lost, pieces.repeated, pieces.modulus) == (whole.lost, whole.repeated, whole.modulus)


@given(
    st.integers(2, 8),
    st.lists(st.integers(-1, 255), min_size=1, max_size=300),
    st.lists(st.integers(0, 300), max_size=10),
)
def test_any_values_give_the_same_in_any_batches(bits: int, some: list[int], places: list[int]) -> None:
    raw = np.array([value % (1 << bits) if value >= 0 else NO_VALUE for value in some], np.int64)
    whole, pieces = RollingCounter(bits), RollingCounter(bits)
    whole.take(raw)
    for piece in cut(raw, places):
        pieces.take(piece)
    assert (pieces.lost, pieces.repeated, pieces.modulus) == (whole.lost, whole.repeated, whole.modulus)
    assert whole.lost >= 0


def test_a_loss_across_the_first_turn_is_counted_when_the_range_is_known() -> None:
    counter = RollingCounter(8)
    counter.take(np.array([250, 251, 252, 3], np.int64))
    assert counter.lost == 0
    counter.take(np.arange(4, 600) % 256)
    assert counter.lost == 6
    assert counter.modulus == 256


def test_a_range_that_is_no_power_of_two_is_no_loss() -> None:
    counter = RollingCounter(8)  # J1939 sequence numbers run to 250
    counter.take(np.arange(2000) % 251)
    assert (counter.lost, counter.modulus) == (0, 251)
    counter.take(np.array([5, 6], np.int64))
    assert counter.lost == (5 - 1999 % 251) % 251 - 1


def test_standing_still_is_not_losing() -> None:
    counter = RollingCounter(4)
    counter.take(np.array([*(np.arange(64) % 16), 15, 15, 15], np.int64))
    assert (counter.lost, counter.repeated) == (0, 3)


def test_what_was_not_looked_at_is_not_lost() -> None:
    counter = RollingCounter(4)
    counter.take(np.arange(64) % 16)
    counter.forget_last()
    counter.take(np.array([9, 10, 11], np.int64))
    assert (counter.lost, counter.repeated) == (0, 0)


@pytest.mark.parametrize(
    "name",
    [
        "Counter",
        "MsgCnt",
        "WFT_RC",
        "RC",
        "rolling_ctr",
        "AliveCounter",
        "SequenceNumber",
        "BZ_alive",
        "seq",
        "COUNTER_PEDAL",
    ],
)
def test_names_of_counters(name: str) -> None:
    assert is_named_so(signal(name))


@pytest.mark.parametrize("name", ["Force", "TorqueFL", "Arc", "Source", "ForceY", "Current", "ElectricPower"])
def test_names_that_are_none(name: str) -> None:
    assert not is_named_so(signal(name))


def test_behaviour_decides() -> None:
    rng = np.random.default_rng(1)
    turning = np.arange(200) % 16
    assert counts(turning, named=True)
    assert counts(turning, named=False)
    assert not counts(rng.integers(0, 16, 200), named=True)
    assert not counts(np.zeros(200, np.int64), named=True)
    assert not counts(np.arange(200), named=False)  # may be anything that grows
    assert [counts(np.arange(count) % 80, named=False) for count in (100, 200)] == [False, True]  # one turn, two
    lossy = np.delete(turning, rng.choice(200, 6, replace=False))
    assert counts(lossy, named=True)
    assert not counts(lossy, named=False)
    assert not counts(turning[:20], named=True)


def test_what_may_count() -> None:
    assert may_count(signal("Fx", 16))
    assert not may_count(signal("Fx", 24))
    assert may_count(signal("Counter", 24))
    assert not may_count(signal("Mode", 4, labels={0: "off"}))
    assert not may_count(signal("Counter", 4, multiplexer="Page"))


def test_raw_values_come_back() -> None:
    scaled = signal("Counter", 8, scale=0.5, offset=3)
    assert raw_of(scaled, np.array([3.0, 3.5, np.nan, 130.5])).tolist() == [0, 1, NO_VALUE, 255]
