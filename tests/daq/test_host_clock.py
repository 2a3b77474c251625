"""Time in the file advances evenly, whatever happens to the host's clock."""

from __future__ import annotations

import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import Phase, example, given
from hypothesis import strategies as st
from property_settings import examples

from daq.can import CLASSIC_DTYPE, FrameBatch, FrameFlag
from daq.host_clock import EARLY_NS, HostClock, StampTracker, monotonic_ns

MS = 10**6
SECOND = 10**9
HOUR = 3600 * SECOND
TICK_NS = 60
BRACKET_NS = 1_000
LATENCY_NS = 5 * MS


@dataclass
class Host:
    """A host whose clock can be set; looking at a clock takes 60 ns, or as long as `pause` says."""

    offset_ns: int = 1_700_000_000 * SECOND
    now_ns: int = 1000 * SECOND
    pause: Callable[[], int] = lambda: TICK_NS
    set_at: list[tuple[int, int]] = field(default_factory=list)

    def monotonic(self) -> int:
        self.now_ns += self.pause()
        return self.now_ns

    def realtime(self) -> int:
        self.now_ns += self.pause()
        return self.now_ns + self.offset_ns

    def step(self, size_ns: int) -> None:
        self.set_at.append((self.now_ns, self.offset_ns))
        self.offset_ns += size_ns

    def stamp(self, at_ns: int) -> int:
        """What CLOCK_REALTIME was."""
        held = next((offset for until, offset in self.set_at if at_ns < until), self.offset_ns)
        return at_ns + held

    def clock(self) -> HostClock:
        return HostClock(self.realtime, self.monotonic)


def batch(stamps: list[int]) -> FrameBatch:
    frames = np.zeros(len(stamps), CLASSIC_DTYPE)
    frames["time_ns"] = stamps
    return FrameBatch(frames, ("can0",))


def is_unsure(of: FrameBatch) -> np.ndarray:
    return np.asarray((of.frames["flags"] & FrameFlag.UNCERTAIN_TIME) != 0)


@dataclass(frozen=True)
class Cycle:
    """One reading: how long it waits, how long the thread rests after it, and whether the clock is set in either."""

    wait_ns: int
    rest_ns: int
    step_ns: int
    at: float
    resting: bool


sizes = st.builds(
    lambda sign, power: sign * round(10**power), st.sampled_from([-1, 1]), st.floats(np.log10(2_000), np.log10(HOUR))
)
cycles = st.builds(
    Cycle,
    wait_ns=st.integers(0, 100 * MS),
    rest_ns=st.one_of(st.integers(0, 20 * MS), st.integers(0, SECOND)),
    step_ns=st.one_of(st.just(0), sizes),
    at=st.floats(0, 1),
    resting=st.booleans(),
)


@dataclass
class Reading:
    """What a reading brought, and from when on frames can have come."""

    batch: FrameBatch
    arrived_ns: list[int]
    since_ns: int
    until_ns: int


def drive(
    host: Host, clock: HostClock, plan: list[Cycle], interval_ns: int, most: int, rng: random.Random
) -> Iterator[Reading]:
    """Read a bus whose frames wait up to 5 ms before they can be read, at most `most` at once."""
    tracker = StampTracker(clock, "can0")
    arrives, since = host.now_ns + rng.randrange(interval_ns), host.now_ns - SECOND
    waiting: list[tuple[int, int]] = []
    for cycle in plan:
        began = host.now_ns
        tracker.before_read()
        for duration, resting in ((cycle.wait_ns, False), (cycle.rest_ns, True)):
            end = host.now_ns + duration
            if cycle.step_ns and cycle.resting is resting:
                host.now_ns += round(cycle.at * duration)
                host.step(cycle.step_ns)
            host.now_ns = end
            if resting:
                continue
            while arrives <= host.now_ns:
                observed = max(arrives + rng.randrange(LATENCY_NS), waiting[-1][1] if waiting else 0)
                waiting.append((arrives, observed))
                arrives += 1 + rng.randrange(2 * interval_ns)
            came = [arrived for arrived, observed in waiting[:most] if observed <= host.now_ns]
            del waiting[: len(came)]
            read = tracker.after_read(batch([host.stamp(arrived) for arrived in came]))
            yield Reading(read, came, since, host.now_ns)
            since = max(since, came[-1] if came else began)


@example(
    [
        Cycle(wait_ns=1_000_000, rest_ns=671_580_990, step_ns=-55_143_000, at=0.69, resting=True),
        Cycle(wait_ns=330, rest_ns=20_000_000, step_ns=0, at=0.0, resting=False),
        Cycle(wait_ns=335, rest_ns=3_519, step_ns=0, at=0.0, resting=False),
        Cycle(wait_ns=3_324_934, rest_ns=0, step_ns=0, at=0.0, resting=False),
    ],
    MS,
    4096,
    0,
)
@given(
    st.lists(cycles, min_size=1, max_size=25),
    st.sampled_from([MS // 8, MS, 30 * MS, 2 * SECOND]),
    st.sampled_from([7, 4096]),
    st.integers(0, 2**32),
)
@examples(300, phases=[Phase.explicit, Phase.reuse, Phase.generate])
def test_no_step_moves_a_frame_that_is_not_flagged(plan: list[Cycle], interval_ns: int, most: int, seed: int) -> None:
    host = Host()
    clock = host.clock()
    last = -1
    for read in drive(host, clock, plan, interval_ns, most, random.Random(seed)):
        times, unsure = read.batch.frames["time_ns"], is_unsure(read.batch)
        truth = np.array(read.arrived_ns, np.int64) + clock.base_ns
        assert np.all(np.diff(times, prepend=last) >= 0)
        np.testing.assert_allclose(times[~unsure], truth[~unsure], atol=BRACKET_NS, rtol=0)
        if unsure.any():
            noted = [(step.since_ns - clock.base_ns, step.time_ns - clock.base_ns) for step in clock.steps]
            known_ns = min(read.since_ns, last - clock.base_ns)  # the time of a flagged frame before may be early
            assert any(known_ns - EARLY_NS <= observed and since <= read.until_ns for since, observed in noted)
            assert np.all(times[unsure] <= truth[unsure] + BRACKET_NS)
        last = int(times[-1]) if len(times) else last


@given(st.lists(cycles, min_size=1, max_size=25), st.integers(0, 2**32))
@examples(100)
def test_every_step_is_noted_with_its_size_and_time(plan: list[Cycle], seed: int) -> None:
    host = Host()
    clock = host.clock()
    list(drive(host, clock, plan, MS, 4096, random.Random(seed)))
    clock.observe()
    made = [cycle.step_ns for cycle in plan if cycle.step_ns]
    assert [step.step_s for step in clock.steps] == pytest.approx([size * 1e-9 for size in made], abs=1e-6)
    for step, (at, _) in zip(clock.steps, host.set_at, strict=True):
        assert step.since_ns - clock.base_ns <= at <= step.time_ns - clock.base_ns


def test_a_step_of_an_hour_between_two_frames_is_resolved_within_the_batch() -> None:
    host = Host()
    clock = host.clock()
    tracker = StampTracker(clock, "can0")
    tracker.before_read()
    came = []
    for number in range(100):
        if number == 40:
            host.step(-HOUR)
        host.now_ns += MS
        came.append(host.now_ns)
    read = tracker.after_read(batch([host.stamp(at) for at in came]))
    assert not is_unsure(read).any()
    np.testing.assert_allclose(np.diff(read.frames["time_ns"]), MS, atol=BRACKET_NS)
    assert tracker.realtime_minus_monotonic_ns == pytest.approx(host.offset_ns, abs=BRACKET_NS)


def test_a_stamp_that_fits_no_offset_is_flagged_and_harms_no_other() -> None:
    """The clock is set and set back while a batch comes in: the times are not known, but contradictions are flagged."""
    host = Host()
    clock = host.clock()
    tracker = StampTracker(clock, "can0")
    tracker.before_read()
    stamps = []
    for number in range(30):
        if number in (10, 20):
            host.step(HOUR if number == 10 else -HOUR)
        host.now_ns += MS
        stamps.append(host.stamp(host.now_ns))
    read = tracker.after_read(batch(stamps))
    assert is_unsure(read).tolist() == [False] * 10 + [True] * 10 + [False] * 10
    assert np.all(np.diff(read.frames["time_ns"]) >= 0)
    assert read.frames["time_ns"][-1] == stamps[-1]
    assert tracker.uncertain == 10
    assert clock.steps == ()


def test_frames_that_waited_are_older_than_a_step_that_was_not_there_when_reading_began() -> None:
    host = Host()
    tracker = StampTracker(host.clock(), "can0")
    tracker.before_read()
    tracker.after_read(batch([host.stamp(host.now_ns)]))
    waited = [host.now_ns + number * MS for number in range(1, 1000)]
    host.now_ns += SECOND
    tracker.before_read()
    host.now_ns += 5 * MS
    host.step(200 * MS)
    host.now_ns += 5 * MS
    came = [*waited, host.now_ns]
    read = tracker.after_read(batch([host.stamp(at) for at in came]))
    assert not is_unsure(read).any()


def test_the_offset_is_read_well_although_the_processor_is_lost_now_and_then() -> None:
    slow = [20 * MS] * 9
    host = Host(pause=lambda: slow.pop() if slow else TICK_NS)
    assert host.clock().realtime_minus_monotonic_ns == pytest.approx(host.offset_ns, abs=BRACKET_NS)


@pytest.mark.parametrize("narrowest", range(7))
def test_the_narrowest_of_readings_that_are_all_wide_counts(narrowest: int) -> None:
    pauses = [(TICK_NS, 20 * MS, TICK_NS)] * 7
    pauses[narrowest] = (TICK_NS, 1500, 1500)
    left = iter([pause for reading in pauses for pause in reading])
    host = Host(pause=lambda: next(left))
    assert host.clock().realtime_minus_monotonic_ns == host.offset_ns


@given(st.integers(0, 2**32))
@examples(50)
def test_losing_the_processor_is_no_step(seed: int) -> None:
    rng = random.Random(seed)
    host = Host(pause=lambda: rng.choice([TICK_NS, TICK_NS, rng.randrange(20 * MS)]))
    clock = host.clock()
    for _ in range(200):
        clock.observe()
    assert clock.steps == ()


def test_stamps_are_untouched_while_the_clock_is_not_set() -> None:
    """Real stamps of the kernel, of datagrams: a HostClock with its defaults leaves them as they are."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        receiver.setsockopt(socket.SOL_SOCKET, 35, 1)  # SO_TIMESTAMPNS
        receiver.bind(("127.0.0.1", 0))
        clock = HostClock()
        tracker = StampTracker(clock, "udp")
        began_ns = clock.now_ns()
        tracker.before_read()
        stamps = []
        for _ in range(50):
            sender.sendto(b"frame", receiver.getsockname())
            ((_, _, stamp),) = receiver.recvmsg(16, 64)[1]
            seconds, nanoseconds = struct.unpack("qq", stamp)
            stamps.append(seconds * SECOND + nanoseconds)
        read = tracker.after_read(batch(stamps))
        if clock.steps:
            pytest.skip("this machine's clock was set just now")
        assert read.frames["time_ns"].tolist() == stamps
        assert not is_unsure(read).any()
        assert began_ns - BRACKET_NS <= stamps[0] <= stamps[-1] <= clock.now_ns() + BRACKET_NS


def test_threads_that_check_at_once_see_each_step_once() -> None:
    offset = [0]
    clock = HostClock(lambda: monotonic_ns() + offset[0], monotonic_ns)
    done = threading.Event()

    def check() -> None:
        while not done.is_set():
            clock.observe()

    threads = [threading.Thread(target=check) for _ in range(4)]
    for thread in threads:
        thread.start()
    sizes = [3 * SECOND, -HOUR, 50 * MS, HOUR, -SECOND]
    for size in sizes:
        time.sleep(0.01)
        offset[0] += size
        clock.observe()
    done.set()
    for thread in threads:
        thread.join()
    assert [step.step_s for step in clock.steps] == pytest.approx([size / SECOND for size in sizes], abs=1e-3)


def test_frames_of_two_processors_that_come_in_the_wrong_order_are_put_into_it() -> None:
    host = Host()
    tracker = StampTracker(host.clock(), "can0")
    tracker.before_read()
    first = host.now_ns + host.offset_ns
    host.now_ns += SECOND
    read = tracker.after_read(batch([first, first + 40_000, first + 10_000, first + 90_000]))
    assert (read.frames["time_ns"] - first).tolist() == [0, 40_000, 40_000, 90_000]
    assert not is_unsure(read).any()
