"""Parts of the health monitor: values in any batches, the load of a bus, many identifiers, hysteresis, diagnostics."""

from __future__ import annotations

import math
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from frames_support import some_frames
from health_support import watch
from hypothesis import given
from hypothesis import strategies as st

from daq import VehicleConfig
from daq.can import (
    CLASSIC_DTYPE,
    Decoder,
    FrameBatch,
    FrameFlag,
    Message,
    RawKind,
    Signal,
    concatenate,
    load_database,
    shipped_dbc,
)
from daq.can.frames import FD_DTYPE
from daq.logger.health import HealthMonitor
from daq.logger.health.bus_health import bits_on_wire
from daq.logger.health.message_health import grouped_reasons
from daq.logger.health.monitor import statuses
from daq.logger.health.report import Board, HostStatus, Level, Recent, Since, reason
from daq.logger.health.watched_messages import SATURATED_RUN, SignalValues
from daq.recording.events import encode_diagnostics
from daq.runs import open_runs
from daq.sources.can_source import BusStatus

RECORDINGS = Path(__file__).parents[2] / "recordings"
SECOND_NS = 10**9


def signal(name: str, kind: RawKind = RawKind.SIGNED, bits: int = 8, **more: object) -> Signal:
    return Signal(name, "", 0, bits, big_endian=False, kind=kind, **more)  # type: ignore[arg-type]


def message(*signals: Signal, j1939: bool = False) -> Message:
    return Message("M", 1, extended=j1939, length=8, signals=signals, j1939=j1939)


FOUR = message(
    signal("A", minimum=-100.0, maximum=100.0),
    signal("B", RawKind.UNSIGNED),
    signal("C", RawKind.UNSIGNED, offset=-40, multiplexer="Page"),
    signal("Counter", RawKind.UNSIGNED, 4),
)


def state(values: SignalValues) -> list[list[float]]:
    columns = (values.last, values.changes, values.out_of_range, values.saturated, values.changed_ns, values.longest_ns)
    return [column.tolist() for column in columns] + [values.stuck_s().tolist()]


@given(
    st.lists(
        st.tuples(*[st.sampled_from([-128.0, -120.0, 0.0, 5.0, 127.0, 255.0, math.nan])] * 4), min_size=1, max_size=60
    ),
    st.lists(st.integers(0, 100), max_size=8),
)
def test_values_are_the_same_in_any_batches(samples: list[tuple[float, ...]], places: list[int]) -> None:
    columns = np.array(samples).T
    time_ns = SECOND_NS + np.arange(len(samples)) * 10**8
    whole, pieces = (SignalValues(FOUR, ["A", "B", "C", "Counter"]) for _ in range(2))
    whole.take(time_ns, columns)
    edges = sorted({0, len(samples), *(place % (len(samples) + 1) for place in places)})
    for a, b in pairwise(edges):
        pieces.take(time_ns[a:b], columns[:, a:b])
    np.testing.assert_equal(state(pieces), state(whole))
    known = ~np.isnan(columns[0])
    assert whole.out_of_range[0] == np.count_nonzero(np.abs(columns[0][known]) > 100.5)


def test_ends_that_are_saturation_and_ends_that_are_not() -> None:
    cases = {
        (127.0, RawKind.SIGNED, 0, False): True,
        (-128.0, RawKind.SIGNED, 0, False): True,
        (255.0, RawKind.UNSIGNED, 0, False): True,
        (0.0, RawKind.UNSIGNED, 0, False): False,  # a plain zero
        (-40.0, RawKind.UNSIGNED, -40, False): True,
        (255.0, RawKind.UNSIGNED, 0, True): False,  # J1939: not available
    }
    for (value, kind, offset, j1939), saturated in cases.items():
        values = SignalValues(message(signal("A", kind, offset=offset), j1939=j1939), ["A"])
        values.take(SECOND_NS + np.arange(10), np.full((1, 10), value))
        assert values.saturated.tolist() == [10 - SATURATED_RUN + 1 if saturated else 0]
    named = SignalValues(message(signal("A", RawKind.UNSIGNED, labels={255: "Not available"})), ["A"])
    named.take(SECOND_NS + np.arange(10), np.full((1, 10), 255.0))
    assert named.saturated.tolist() == [0]


@pytest.mark.parametrize(("resting", "limit_s"), [(False, 2.0), (True, 10.0)])
def test_a_signal_is_stuck_once_it_is_the_same_for_much_longer_than_ever(resting: bool, limit_s: float) -> None:
    values = SignalValues(message(signal("A")), ["A"])
    values.resting = resting
    changing = SECOND_NS + np.arange(100) * SECOND_NS // 2
    values.take(changing, np.arange(100.0)[None])
    for same_s, stuck_s in ((limit_s - 0.1, 0.0), (limit_s + 0.1, limit_s + 0.1)):
        values.take(changing[-1:] + round(same_s * SECOND_NS), np.array([[99.0]]))
        assert values.stuck_s().tolist() == [pytest.approx(stuck_s)]


@pytest.mark.parametrize(("name", "labels", "bits"), [("Counter", {}, 8), ("Mode", {1: "on"}, 8), ("Flag", {}, 1)])
def test_what_does_not_measure_is_never_stuck(name: str, labels: dict[int, str], bits: int) -> None:
    values = SignalValues(message(signal(name, RawKind.UNSIGNED, bits, labels=labels), signal("A")), [name, "A"])
    time_ns = SECOND_NS + np.arange(3000) * 10**7
    column = np.where(np.arange(3000) < 2000, np.arange(3000) % 2, 1.0)
    values.take(time_ns, np.stack([column, column]))
    assert values.stuck_s().tolist() == [0.0, pytest.approx(10, abs=0.1)]


def test_bits_of_classical_frames_lie_between_none_and_the_worst_stuffing() -> None:
    frames = np.zeros(18, CLASSIC_DTYPE)
    frames["length"] = np.arange(18) % 9
    frames["flags"][9:] = FrameFlag.EXTENDED
    bits = bits_on_wire(frames)
    for row, head in ((0, 34), (9, 54)):
        for n in range(9):
            least = head + 8 * n + 13
            assert least <= bits[row + n] <= least + (head + 8 * n - 1) // 4
    assert bits[8] == pytest.approx(111, abs=4)  # 111 bits without stuffing: the well-known frame of 8 bytes
    frames["flags"] |= np.uint8(FrameFlag.REMOTE)
    assert len(set(bits_on_wire(frames)[:9])) == 1


def test_bits_of_fd_frames_are_unknown_only_with_a_rate_of_their_own() -> None:
    frames = np.zeros(3, FD_DTYPE)
    frames["length"] = (64, 8, 8)
    frames["flags"] = (FrameFlag.FD, FrameFlag.FD, FrameFlag.FD | FrameFlag.BITRATE_SWITCH)
    bits = bits_on_wire(frames)
    assert bits[0] > 64 * 8 + 60
    assert math.isnan(bits[2])


def test_the_load_of_a_bus() -> None:
    frames = np.zeros(4000, CLASSIC_DTYPE)
    frames["time_ns"] = 10**18 + np.arange(4000) * 500_000
    frames["length"] = 8
    monitor = HealthMonitor(vehicle(), {}, started_ns=10**18)
    for end in range(400, 4001, 400):
        monitor.take(FrameBatch(frames[end - 400 : end], ("can0",)), {})
        report = monitor.report(10**18 + end * 500_000, HostStatus({}))
    (bus,) = report.buses
    assert bus.rate_hz == pytest.approx(2000, rel=0.01)
    assert bus.load == pytest.approx(2000 * 114 / 500_000, rel=0.03)
    assert report.reasons == ()


def vehicle(**more: object) -> VehicleConfig:
    return VehicleConfig.model_validate({"bus": [{"channel": "can0", "bitrate": 500_000}], **more})


def test_100000_unknown_identifiers_take_no_memory() -> None:
    databases = {"can0": (load_database(shipped_dbc("wft.dbc")),)}
    monitor = HealthMonitor(vehicle(), databases, started_ns=10**18)
    frames = np.zeros(10_000, CLASSIC_DTYPE)
    frames["flags"] = FrameFlag.EXTENDED
    sizes = []
    tracemalloc.start()
    for number in range(10):
        frames["can_id"] = number * 10_000 + np.arange(10_000)
        frames["time_ns"] = 10**18 + number * SECOND_NS + np.arange(10_000) * 100_000
        batch = FrameBatch(frames, ("can0",))
        monitor.take(batch, Decoder(databases).decode(batch))
        report = monitor.report(10**18 + (number + 1) * SECOND_NS, HostStatus({}))
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert report.buses[0].unknown_frames == 100_000
    assert max(sizes[3:]) - sizes[2] < 50_000
    assert {one.code for one in report.reasons} == {"dbc_does_not_fit"}
    assert len(report.reasons[0].what) < 200


def test_frames_of_every_kind_are_taken_and_skipped() -> None:
    batch = some_frames(np.random.default_rng(0), 5000, buses=("can0", "can1", "can9"))
    two = vehicle(bus=[{"channel": "can0"}, {"channel": "can1"}])
    databases = {"can0": (load_database(shipped_dbc("wft.dbc")),)}
    reports = []
    for skipped in (False, True):
        monitor = HealthMonitor(two, databases, started_ns=int(batch.frames["time_ns"][0]))
        for start in range(0, 5000, 500):
            piece = batch[start : start + 500]
            if skipped:
                monitor.skip(piece)
            else:
                monitor.take(piece, Decoder(databases).decode(piece))
        reports.append(monitor.report(int(batch.frames["time_ns"][-1]), HostStatus({})))
    buses = [[(bus.name, bus.error_frames, bus.unknown_frames) for bus in report.buses] for report in reports]
    assert buses[0] == buses[1]
    flags, numbers = batch.frames["flags"], batch.frames["bus"]
    assert [bus[1] for bus in buses[0]] == [int(np.count_nonzero((flags & 4 != 0) & (numbers == n))) for n in (0, 1)]


def test_a_reason_stays_for_3_s_as_bad_as_it_was() -> None:
    board = Board()
    red, amber = (reason("bus_silent", level, "can0", "is so") for level in (Level.RED, Level.AMBER))
    assert board.update(0, [red]) == (red,)
    assert board.update(SECOND_NS, [amber])[0].level is Level.RED
    assert board.update(3 * SECOND_NS, [amber]) == (amber,)
    assert board.update(5 * SECOND_NS, []) == (amber,)
    assert board.update(6 * SECOND_NS, []) == ()


def test_reasons_come_worst_first() -> None:
    some = [
        reason("disk_low", Level.AMBER, "host", "is so"),
        reason("bus_silent", Level.RED, "can1", "is so"),
        reason("bus_silent", Level.RED, "can0", "is so"),
    ]
    assert [one.where for one in Board().update(0, some)] == ["can0", "can1", "host"]


def test_two_buses_whose_names_begin_alike_stay_two() -> None:
    buses = ("ff15::1", "ff15::2")
    lost = [reason("counter_jump", Level.RED, bus, "lost 3", name=f"M{i}") for bus in buses for i in range(5)]
    grouped = grouped_reasons(lost, frozenset())
    assert [(one.bus, one.where) for one in grouped] == [(bus, f"{bus}: several messages") for bus in buses]


def test_growth_and_duration() -> None:
    recent, since = Recent(), Since()
    assert [recent.take(t * SECOND_NS, count) for t, count in ((0, 0), (1, 5), (9, 7), (11, 7), (19, 7))] == [
        0,
        5,
        7,
        2,
        0,
    ]
    held = [since.held_s("x", t * SECOND_NS, holds) for t, holds in ((0, True), (2, True), (3, False), (4, True))]
    assert held == [0.0, 2.0, 0.0, 0.0]


def test_times_that_are_not_sure_are_not_judged() -> None:
    run = open_runs([RECORDINGS / "clay" / "run-1.mcap"])[0]
    batch = next(iter(run.frame_batches()))[:40_000]
    frames = batch.frames.copy()
    start_ns = int(frames["time_ns"][0])
    late = frames["time_ns"] > start_ns + 5 * SECOND_NS
    frames["time_ns"][late] += 2 * SECOND_NS
    stepped = frames["time_ns"] > start_ns + 7 * SECOND_NS
    stepped &= frames["time_ns"] <= start_ns + 7 * SECOND_NS + 200_000_000
    frames["flags"][stepped] |= np.uint8(FrameFlag.UNCERTAIN_TIME)
    result = watch(run.vehicle, run.databases, [FrameBatch(frames, batch.buses)])
    assert result.monitor.losses() == {}


def test_a_report_becomes_diagnostics() -> None:
    run = open_runs([RECORDINGS / "clay" / "run-1.mcap"])[0]
    batch = concatenate(list(run.frame_batches()))
    start_ns = batch.frames["time_ns"][0]
    gone = (batch.frames["can_id"] == 257) & (batch.frames["time_ns"] > start_ns + 8 * SECOND_NS)
    short = batch[~gone & (batch.frames["time_ns"] < start_ns + 10 * SECOND_NS)]
    host = HostStatus({"can0": BusStatus("up", len(short), 3)}, disk_free_bytes=10**9)
    result = watch(run.vehicle, run.databases, [short], lambda _: host)
    found = {one.name: one for one in statuses(result.last)}
    assert {"can0", "can0/WFT_Forces", "can0/WFT_Forces.Fz", "gnss", "host"} <= set(found)
    assert "can0/WFT_Forces.Fy" not in found
    assert found["can0"].level == 2
    assert found["can0"].message.startswith("kernel_drops: lost 3 frames")
    assert found["can0/WFT_Moments"].level == 2
    assert "message_missing" in found["can0/WFT_Moments"].message
    assert (found["can0/WFT_Forces"].level, found["can0/WFT_Forces"].message) == (0, "ok")
    assert found["can0/WFT_Forces.Fz"].values["role"] == "vertical_load"
    assert found["can0/WFT_Forces"].values["frames"] == str(np.count_nonzero(short.frames["can_id"] == 256))
    assert found["gnss"].values["fix"] == "yes"
    assert found["host"].values["disk_free_mb"] == "1000"
    assert not any("nan" in value for one in found.values() for value in one.values.values())
    assert len(encode_diagnostics(result.last.time_ns, list(found.values()))) < 8000
