"""Adapters whose stamps are not the host's: brought to it by the shortest delay, in their own order and spacing."""

from __future__ import annotations

import sys
import time
import uuid
from collections.abc import Callable
from types import ModuleType
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus
from hypothesis import Phase, given
from hypothesis import strategies as st
from property_settings import examples

from daq import BusSection
from daq.can import CLASSIC_DTYPE, FrameBatch, FrameFlag
from daq.host_clock import HostClock, StampTracker
from daq.sources.python_can import AdapterClock, PythonCanSource

MS = 10**6
SECOND = 10**9
MONOTONIC_NS = 5000 * SECOND
OFFSET_NS = 1_700_000_000 * SECOND


class Host:
    """A host whose clocks advance only when a test moves them."""

    def __init__(self) -> None:
        self.now_ns = MONOTONIC_NS
        self.offset_ns = OFFSET_NS

    def clock(self) -> HostClock:
        return HostClock(lambda: self.now_ns + self.offset_ns, lambda: self.now_ns)


def delivered(
    rng: np.random.Generator, count: int, *, rate_hz: float = 100.0, stall: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return monotonic times at which frames were on the bus and at which they were fetched, one after the other."""
    sent = MONOTONIC_NS + np.sort(rng.integers(0, round(count / rate_hz * SECOND), count))
    delay = 300_000 + rng.exponential(MS, count).astype(np.int64) + (rng.random(count) < stall) * 80 * MS
    return sent, np.maximum.accumulate(sent + delay)


@given(
    st.floats(-100, 100),
    st.sampled_from([0, 3 * SECOND, 400 * SECOND, OFFSET_NS + MONOTONIC_NS - SECOND]),
    st.sampled_from([0.0, 0.01]),
    st.integers(1, 50),
    st.integers(0, 2**32),
)
@examples(25, gate=6, phases=[Phase.explicit, Phase.reuse, Phase.generate])
def test_times_are_late_by_a_short_delay_only(ppm: float, counted: int, stall: float, size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sent, fetched = delivered(rng, 6000, stall=stall)
    stamps = counted + ((sent - MONOTONIC_NS) * (1 + ppm * 1e-6)).astype(np.int64) // 1000 * 1000 + 1000
    clock = AdapterClock("gs_usb", Host().clock())
    pieces = [
        clock.realtime_ns(stamps[start : start + size], fetched[start : start + size])
        for start in range(0, len(stamps), size)
    ]
    times = np.concatenate(pieces) - OFFSET_NS
    late = times - sent
    assert np.all(np.diff(times) >= 0)
    assert np.all(times <= fetched)
    settled = sent > sent[0] + 2 * SECOND
    assert late[settled].min() > 300_000 - 2_000
    assert late[settled].max() < 1.5 * MS
    spacing = np.diff(times[settled]) - np.diff(stamps[settled])
    assert np.percentile(np.abs(spacing), 95) < 50_000
    assert len(clock.remarks) == 1


def test_a_counter_that_wraps_or_is_restarted_is_followed() -> None:
    sent, fetched = delivered(np.random.default_rng(1), 20_000)
    stamps = (sent - MONOTONIC_NS + 40 * SECOND) % (65_536 * MS) + 1
    clock = AdapterClock("serial", Host().clock())
    times = np.concatenate([clock.realtime_ns(stamps[i : i + 7], fetched[i : i + 7]) for i in range(0, 20_000, 7)])
    late = times - OFFSET_NS - sent
    assert np.count_nonzero(np.diff(stamps) < 0) == 3
    assert late.min() > 290_000
    assert late.max() < 100 * MS
    assert np.mean(late > 2 * MS) < 0.02


def test_a_clock_that_is_far_too_slow_is_caught_up_with() -> None:
    """A ceramic resonator may be half a percent off: beyond what is followed, but never by much."""
    sent, fetched = delivered(np.random.default_rng(2), 30_000)
    stamps = ((sent - MONOTONIC_NS) * 0.995).astype(np.int64) + SECOND
    clock = AdapterClock("serial", Host().clock())
    times = np.concatenate([clock.realtime_ns(stamps[i : i + 9], fetched[i : i + 9]) for i in range(0, 30_000, 9)])
    late = times - OFFSET_NS - sent
    assert late.max() < 20 * MS
    assert late.min() > -200 * MS


@pytest.mark.parametrize("stamp", [0, 77 * SECOND])
def test_without_a_clock_that_counts_the_arrival_is_the_time(stamp: int) -> None:
    sent, fetched = delivered(np.random.default_rng(3), 3000)
    clock = AdapterClock("gs_usb", Host().clock())
    times = np.concatenate([clock.realtime_ns(np.full(3, stamp), fetched[i : i + 3]) for i in range(0, len(sent), 3)])
    after = fetched > fetched[0] + 6 * SECOND if stamp else np.ones(len(fetched), np.bool_)
    assert np.array_equal(times[after] - OFFSET_NS, fetched[after])
    assert any("fetched" in remark for remark in clock.remarks)


def test_setting_the_host_does_not_move_an_adapter_of_its_own_clock() -> None:
    host = Host()
    session, adapter = host.clock(), AdapterClock("pcan", host.clock())
    tracker = StampTracker(session, "PCAN_USBBUS1")
    sent, fetched = delivered(np.random.default_rng(4), 3000)
    late, unsure = [], 0
    for start in range(0, len(sent), 10):
        tracker.before_read()
        arrived = []
        for at in fetched[start : start + 10]:
            if at > MONOTONIC_NS + 15 * SECOND and host.offset_ns == OFFSET_NS:
                host.offset_ns -= 3600 * SECOND
            host.now_ns = int(at)
            adapter.observe()
            arrived.append(host.now_ns)
        stamps = sent[start : start + 10] - MONOTONIC_NS + SECOND
        frames = np.zeros(10, CLASSIC_DTYPE)
        frames["time_ns"] = adapter.realtime_ns(stamps, np.array(arrived))
        read = tracker.after_read(FrameBatch(frames, ("PCAN_USBBUS1",)))
        unsure += np.count_nonzero(read.frames["flags"] & FrameFlag.UNCERTAIN_TIME)
        late.append(read.frames["time_ns"] - OFFSET_NS - sent[start : start + 10])
    assert len(session.steps) == 1
    assert unsure == 0
    assert np.concatenate(late)[200:].max() < 1.5 * MS
    assert np.concatenate(late).min() > 290_000


def receive(source: PythonCanSource, sender: can.BusABC, stamp_s: Callable[[], float]) -> tuple[float, float, float]:
    """Send a frame; return when it was sent at the earliest, its time, and when it was there, s since 1970."""
    sent = time.time()
    sender.send(can.Message(arbitration_id=1, timestamp=stamp_s(), data=b"x"))
    (when,) = source.read(2.0).frames["time_ns"].tolist()
    return sent, when * 1e-9, time.time()


@pytest.mark.parametrize("first", [12.5, 0.0])
def test_a_bus_that_counts_from_power_up_is_recorded_in_utc(first: float) -> None:
    """The sender of a virtual bus may stamp: with the time since its start, or not at all."""
    channel = f"bus-{uuid.uuid4().hex}"
    source = PythonCanSource(BusSection(channel=channel, interface="virtual"))
    began = time.monotonic()
    rows = []
    with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as sender:
        for _ in range(20):
            rows.append(receive(source, sender, lambda: first + time.monotonic() - began if first else 0.0))
            time.sleep(0.002)
    sent, when, fetched = np.array(rows).T
    source.close()
    assert np.all(when >= sent - 1e-4)
    assert np.all(when <= fetched + 1e-4)
    assert np.all(np.diff(when) >= 0)
    assert len(source.remarks) == 2


class SetOnceBus(VirtualBus):
    """What Kvaser's and Vector's drivers do: UTC when it was opened, then a counter of its own."""

    def __init__(self, channel: Any = None, **options: Any) -> None:
        super().__init__(channel=channel, preserve_timestamps=True, **options)


def test_an_adapter_that_was_set_to_utc_once_is_followed_too(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("set_once")
    module.SetOnceBus = SetOnceBus  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "set_once", module)
    monkeypatch.setitem(can.interfaces.BACKENDS, "set_once", ("set_once", "SetOnceBus"))
    monkeypatch.setattr(can, "VALID_INTERFACES", can.VALID_INTERFACES | {"set_once"})
    channel = f"bus-{uuid.uuid4().hex}"
    source = PythonCanSource(BusSection(channel=channel, interface="set_once"))
    with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as sender:
        behind_s = 4.0  # ten hours after it was set
        rows = [receive(source, sender, lambda: time.time() - behind_s) for _ in range(20)]
    source.close()
    sent, when, fetched = np.array(rows).T
    assert np.all(when >= sent - 0.05)
    assert np.all(when <= fetched + 1e-4)
    assert any("clock of its own" in remark for remark in source.remarks)


def test_stamps_of_the_host_are_left_as_they_are() -> None:
    channel = f"bus-{uuid.uuid4().hex}"
    source = PythonCanSource(BusSection(channel=channel, interface="virtual"))
    with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as sender:
        stamp = round(time.time(), 6)
        _, when, _ = receive(source, sender, lambda: stamp)
    source.close()
    assert when == pytest.approx(stamp, abs=1e-6)
    assert len(source.remarks) == 1
