"""Faults put into recorded streams, each of which must be reported by its name, in time, and alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from health_support import HealthRun, watch
from numpy.typing import NDArray

from daq import VehicleConfig
from daq.can import FrameArray, FrameBatch, FrameFlag, concatenate
from daq.logger.health.report import HostStatus, Level
from daq.runs import Run, open_runs
from daq.sources.can_source import BusState, BusStatus

RECORDINGS = Path(__file__).parents[2] / "recordings"
FORCES, MOMENTS, WHEEL, SPEEDS, GNSS_2, GNSS_3 = 256, 257, 258, 464, 770, 771
MOVES_S = 15.0


@cache
def run() -> Run:
    return open_runs([RECORDINGS / "clay" / "run-1.mcap"])[0]


@cache
def whole() -> FrameBatch:
    return concatenate(list(run().frame_batches()))


@cache
def recorded(end_s: float = 30.0) -> FrameBatch:
    return whole()[whole().frames["time_ns"] < whole().frames["time_ns"][0] + int(end_s * 1e9)]


def without(batch: FrameBatch, from_s: float, to_s: float) -> FrameBatch:
    """Return frames without those of a time, counted from the first recorded; error frames stay."""
    time_s = (batch.frames["time_ns"] - recorded().frames["time_ns"][0]) * 1e-9
    gone = (time_s > from_s) & (time_s < to_s) & ((batch.frames["flags"] & FrameFlag.ERROR) == 0)
    return batch[~gone]


def set_rear_left(frames: FrameArray, at: NDArray[np.intp], raw: int) -> None:
    """Write the 15 bits of WheelSpeeds.RearLeft: Motorola, from bit 25 on."""
    data = frames["data"]
    data[at, 3] = data[at, 3] & 0xFC | raw >> 13
    data[at, 4] = raw >> 5 & 0xFF
    data[at, 5] = data[at, 5] & 0x07 | (raw & 0x1F) << 3


def at_s(frames: FrameArray) -> NDArray[np.float64]:
    return np.asarray((frames["time_ns"] - frames["time_ns"][0]) * 1e-9)


def rows(frames: FrameArray, can_id: int, from_s: float, to_s: float = 1e9) -> NDArray[np.intp]:
    time_s = at_s(frames)
    return np.flatnonzero((frames["can_id"] == can_id) & (time_s >= from_s) & (time_s < to_s))


def changed(change: Callable[[FrameArray], FrameArray], end_s: float = 30.0) -> FrameBatch:
    batch = recorded(end_s)
    return FrameBatch(change(batch.frames.copy()), batch.buses)


def monitored(
    batch: FrameBatch, host_at: Callable[[float], HostStatus] = lambda _: HostStatus({}), **sections: object
) -> HealthRun:
    vehicle = VehicleConfig.model_validate(run().vehicle.model_dump() | sections)
    return watch(vehicle, run().databases, [batch], host_at)


def codes(result: HealthRun) -> set[str]:
    return {one.code for one in result.reasons}


def level_of(result: HealthRun, code: str) -> Level:
    return max(one.level for one in result.reasons if one.code == code)


@pytest.mark.parametrize("count", [1, 16, 300, *(pytest.param(count, marks=pytest.mark.slow) for count in (7, 40))])
def test_frames_dropped_are_counted_exactly(count: int) -> None:
    """The counter has 4 bits: beyond 15 the gap in time says how often it went round."""

    def drop(frames: FrameArray) -> FrameArray:
        return np.delete(frames, rows(frames, FORCES, MOVES_S)[:count])

    result = monitored(changed(drop))
    assert result.monitor.losses() == {"counter.can0.WFT_Forces": count}
    assert codes(result) == {"counter_jump"}
    assert level_of(result, "counter_jump") is Level.RED
    assert MOVES_S <= result.first_s("counter_jump") < MOVES_S + 1.5
    assert result.last.level is Level.GREEN


def test_frames_dropped_of_a_message_without_counter() -> None:
    def drop(frames: FrameArray) -> FrameArray:
        return np.delete(frames, rows(frames, GNSS_2, MOVES_S)[:9])

    result = monitored(changed(drop))
    assert result.monitor.losses() == {"missing.can0.GNSS_2": 9}
    assert codes(result) == {"frames_missing"}


def test_skipped_frames_are_not_lost() -> None:
    from health_support import in_steps

    from daq.can import Decoder
    from daq.logger.health import HealthMonitor

    batch = recorded()
    monitor = HealthMonitor(run().vehicle, run().databases, started_ns=int(batch.frames["time_ns"][0]))
    decoder, reports = Decoder(run().databases), []
    for number, (now_ns, piece) in enumerate(in_steps(batch)):
        if 50 <= number < 70:
            monitor.skip(piece[len(piece) // 3 :])  # the oldest may have been given up altogether
        else:
            monitor.take(piece, decoder.decode(piece))
        reports.append(monitor.report(now_ns, HostStatus({}, skipped_frames=min(max(number - 49, 0), 20) * 600)))
    result = HealthRun(monitor, reports)
    assert monitor.losses() == {}
    assert codes(result) == {"inspection_skipped"}
    assert result.last.buses[0].unknown_frames == 0
    assert {one.name: one.frames for one in result.last.messages}["WFT_Forces"] > 0.9 * len(
        rows(batch.frames, FORCES, 0)
    )


@pytest.mark.parametrize(
    ("can_id", "first", "last", "where"),
    [
        (FORCES, 0, 2, "Fx"),
        pytest.param(FORCES, 4, 6, "Fz", marks=pytest.mark.slow),
        pytest.param(MOMENTS, 2, 4, "My", marks=pytest.mark.slow),
        (SPEEDS, 3, 6, "RearLeft"),
    ],
)
def test_a_frozen_signal_is_amber_within_3_s(can_id: int, first: int, last: int, where: str) -> None:
    def freeze(frames: FrameArray) -> FrameArray:
        at = rows(frames, can_id, MOVES_S)
        frames["data"][at, first:last] = frames["data"][at[0], first:last]
        return frames

    result = monitored(changed(freeze))
    assert codes(result) == {"signal_stuck"}
    assert MOVES_S + 1 < result.first_s("signal_stuck", where) < MOVES_S + 3
    assert level_of(result, "signal_stuck") is Level.AMBER
    signal = next(one for one in result.last.signals if one.name.endswith(where))
    assert signal.level is Level.AMBER
    assert signal.stuck_s > 10
    allowed = {"may_be_constant": (signal.name,)}
    assert codes(monitored(changed(freeze), health=allowed)) == set()


def test_a_frozen_sender_is_recognised_by_its_counter() -> None:
    def freeze(frames: FrameArray) -> FrameArray:
        at = rows(frames, FORCES, MOVES_S)
        frames["data"][at] = frames["data"][at[0]]
        return frames

    result = monitored(changed(freeze))
    assert codes(result) == {"counter_repeated", "signal_stuck", "frames_doubled"}
    assert level_of(result, "counter_repeated") is Level.RED
    assert result.monitor.losses() == {}


def test_a_signal_that_never_changes_while_the_vehicle_moves() -> None:
    def hold(frames: FrameArray) -> FrameArray:
        frames["data"][rows(frames, FORCES, 0), 0:2] = 17
        return frames

    result = monitored(changed(hold))
    assert codes(result) == {"signal_constant"}
    assert "WFT_Forces.Fx" in next(one.where for one in result.reasons)


def test_a_message_that_stops_is_red_and_its_bus_is_not_to_blame() -> None:
    def stop(frames: FrameArray) -> FrameArray:
        return np.delete(frames, rows(frames, MOMENTS, MOVES_S))

    result = monitored(changed(stop))
    assert codes(result) == {"message_missing"}
    assert level_of(result, "message_missing") is Level.RED
    assert MOVES_S + 1 <= result.first_s("message_missing") < MOVES_S + 2
    assert {one.name for one in result.last.messages if one.level is Level.RED} == {"WFT_Moments"}
    assert codes(monitored(changed(stop), health={"may_be_silent": ("WFT_Moments",)})) == set()


def test_a_message_with_a_role_that_never_comes() -> None:
    def without(frames: FrameArray) -> FrameArray:
        return np.delete(frames, rows(frames, MOMENTS, 0))

    result = monitored(changed(without, 8.0))
    assert codes(result) == {"message_missing"}
    assert 5 <= result.first_s("message_missing") < 6
    assert "driving_torque" in result.reasons[0].what


def test_a_silent_bus_is_reported_once() -> None:
    quiet = without(recorded(), 15, 20)
    result = monitored(quiet)
    end_ns = recorded().frames["time_ns"][0] + int(19.9e9)
    during = {one.code for report in result.reports for one in report.reasons if report.time_ns < end_ns}
    assert during == {"bus_silent"}
    assert 17 <= result.first_s("bus_silent") < 18
    assert level_of(result, "bus_silent") is Level.RED
    lost = result.monitor.losses()
    assert abs(lost["counter.can0.WFT_Forces"] - 5000) <= 16
    assert abs(lost["missing.can0.GNSS_2"] - 100) <= 1


def test_drops_are_red_and_then_amber_for_the_rest() -> None:
    def host_at(time_s: float) -> HostStatus:
        return HostStatus({"can0": BusStatus("up", 1, 0 if time_s < 10 else 12, 0 if time_s < 12 else 3)})

    result = monitored(recorded(), host_at)
    assert codes(result) == {"kernel_drops", "queue_drops"}
    levels = [(round((r.time_ns - result.reports[0].time_ns) * 1e-9), r.level) for r in result.reports]
    assert dict(levels)[8] is Level.GREEN
    assert dict(levels)[11] is Level.RED
    assert dict(levels)[18] is Level.RED
    assert dict(levels)[27] is Level.AMBER
    assert result.monitor.losses() == {"kernel.can0": 12, "queue.can0": 3}
    assert "12 frames so far" in next(one.what for one in result.last.reasons if one.code == "kernel_drops")


@pytest.mark.parametrize(("state", "code"), [("down", "bus_down"), ("bus_off", "bus_off")])
def test_a_bus_that_is_gone_and_comes_back(state: BusState, code: str) -> None:
    away = without(recorded(), 10, 20)

    def host_at(time_s: float) -> HostStatus:
        now = state if 10.3 < time_s < 19.9 else "up"
        return HostStatus({"can0": BusStatus(now, 1, 0, reconnects=int(time_s >= 20), detail="gone")})

    result = monitored(away, host_at)
    assert code in codes(result)
    assert "bus_silent" not in codes(result)
    assert "message_missing" not in codes(result)
    assert "bus_returned" in {one.code for one in result.last.reasons}


def with_errors(can_id: int, data: list[int], from_s: float, count: int, end_s: float = 14.0) -> FrameBatch:
    batch = recorded(end_s)
    errors = np.zeros(count, batch.frames.dtype)
    errors["time_ns"] = batch.frames["time_ns"][0] + int(from_s * 1e9) + np.arange(count) * 10_000_000
    errors["can_id"], errors["flags"], errors["length"] = can_id, FrameFlag.ERROR, 8
    errors["data"][:, : len(data)] = data
    return FrameBatch(np.concatenate([batch.frames, errors]), batch.buses)


@pytest.mark.parametrize(
    ("can_id", "data", "code", "words"),
    [
        (
            0x04,
            [0, 0x10, 0, 0, 0, 0, 0, 135],
            "bus_error_passive",
            "error passive (error counters: 0 sending, 135 receiving)",
        ),
        (0x04, [0, 0x08], "bus_error_warning", "warns"),
        (0x04, [0, 0x01], "controller_overflow", "5 times"),
        (0x20, [], "bus_no_ack", "acknowledgement"),
        (0x88, [0, 0, 0x04], "bus_errors", "5 protocol errors in the last 10 s, mostly stuff"),
        (0x10, [], "bus_errors", "5 error frames"),
    ],
)
def test_error_frames_are_understood(can_id: int, data: list[int], code: str, words: str) -> None:
    result = monitored(with_errors(can_id, data, 10.0, 5))
    assert codes(result) == {code}
    assert words in max((one.what for one in result.reasons), key=len)
    assert result.last.buses[0].error_frames == 5
    assert result.monitor.losses() == {}


def test_bus_off_holds_until_frames_come_again() -> None:
    result = monitored(without(with_errors(0x40, [], 10.0, 1, 30.0), 9.995, 14))
    assert level_of(result, "bus_off") is Level.RED
    assert 10 < result.first_s("bus_off") < 11
    assert "bus_off" not in {one.code for one in result.last.reasons}


def test_a_dbc_that_does_not_fit() -> None:
    def shifted(frames: FrameArray) -> FrameArray:
        frames["can_id"] += 1000
        return frames

    result = monitored(changed(shifted, 8.0))
    assert codes(result) == {"dbc_does_not_fit"}
    assert level_of(result, "dbc_does_not_fit") is Level.AMBER
    assert 5 <= result.first_s("dbc_does_not_fit") < 6
    assert "0x4E8" in result.reasons[-1].what
    assert "wheelsoil doctor" in result.reasons[-1].next_step


def test_many_unknown_frames() -> None:
    def some(frames: FrameArray) -> FrameArray:
        frames["can_id"][rows(frames, WHEEL, 0)[::3]] = 0x7A0
        return frames

    result = monitored(changed(some))
    assert "unknown_frames" in codes(result)
    assert "0x7A0" in next(one.what for one in result.reasons if one.code == "unknown_frames")
    assert result.last.buses[0].unknown_frames == -(-len(rows(recorded().frames, WHEEL, 0)) // 3)
    assert "unknown_frames" not in codes(monitored(changed(some), health={"may_carry_unknown": ("can0",)}))


def test_gnss_lost_for_some_seconds() -> None:
    def lose(frames: FrameArray) -> FrameArray:
        frames["data"][rows(frames, GNSS_3, 10.0, 18.0), 5] &= 0x7F
        return frames

    result = monitored(changed(lose))
    assert codes(result) == {"gnss_no_fix"}
    assert 11.5 < result.first_s("gnss_no_fix") < 12.5
    states = [report.gnss for report in result.reports if report.gnss is not None]
    assert len(states) == len(result.reports)
    assert max(one.age_s for one in states if one.age_s == one.age_s) == pytest.approx(8, abs=0.3)
    assert states[-1].fix
    assert states[-1].clock is not None
    assert result.last.level is Level.GREEN


def test_a_wheel_speed_of_0_while_the_ground_moves() -> None:
    def stop(frames: FrameArray) -> FrameArray:
        set_rear_left(frames, rows(frames, SPEEDS, MOVES_S), 0)
        return frames

    result = monitored(changed(stop))
    assert codes(result) == {"wheel_speed_zero"}
    assert MOVES_S + 1 < result.first_s("wheel_speed_zero") < MOVES_S + 2.5


def test_a_ground_speed_of_0_while_the_wheel_turns() -> None:
    def stop(frames: FrameArray) -> FrameArray:
        frames["data"][rows(frames, GNSS_2, MOVES_S), 4:6] = 0
        return frames

    result = monitored(changed(stop))
    assert codes(result) == {"ground_speed_zero"}


def test_saturation_is_red_and_not_available_is_not() -> None:
    def overload(frames: FrameArray) -> FrameArray:
        frames["data"][rows(frames, FORCES, MOVES_S, MOVES_S + 0.2), 0:2] = (0xFF, 0x7F)
        set_rear_left(frames, rows(frames, SPEEDS, 20.0, 21.0), 0x7FFF)
        return frames

    result = monitored(changed(overload), health={"may_leave_range": ("WFT_Forces.Fx",)})
    assert level_of(result, "signal_saturated") is Level.RED
    assert "signal_not_available" in codes(result)
    assert result.last.level is Level.GREEN


def test_a_value_out_of_range() -> None:
    def far(frames: FrameArray) -> FrameArray:
        at = rows(frames, WHEEL, MOVES_S, MOVES_S + 1)
        frames["data"][at, 0:2] = (0xFF, 0xF0)
        return frames

    result = monitored(changed(far))
    assert codes(result) == {"signal_out_of_range"}
    assert "the DBC's range is 0 to 359.99" in result.reasons[0].what


def test_the_transducer_says_what_is_wrong() -> None:
    def status(frames: FrameArray) -> FrameArray:
        at = rows(frames, FORCES, MOVES_S, MOVES_S + 2)
        frames["data"][at, 6] = frames["data"][at, 6] & 0x0F | 0x30
        return frames

    signals = run().vehicle.signals | {"transducer_status": "WFT_Forces.Status"}
    result = monitored(changed(status), signals=signals)
    assert codes(result) == {"transducer_status"}
    assert "Telemetry lost" in result.reasons[0].what


def test_a_role_that_names_no_signal_is_reported_and_no_error() -> None:
    result = monitored(recorded(6.0), signals=run().vehicle.signals | {"sinkage": "Ride.Height"})
    assert codes(result) == {"role_unusable"}
    assert result.reasons[0].where == "[signals] sinkage"


def test_names_in_health_that_nothing_goes_by_are_reported() -> None:
    wrong = {
        "may_be_silent": ("WFT_Moment", "GNSS_2"),
        "may_be_constant": ("WFT_Forces.Fzz",),
        "may_carry_unknown": ("can7",),
    }
    result = monitored(recorded(6.0), health=wrong)
    assert codes(result) == {"health_name_unknown"}
    texts = {one.where: one.what for one in result.last.reasons}
    assert set(texts) == {f"[health] {key}" for key in wrong}
    assert "'WFT_Moment'" in texts["[health] may_be_silent"] and "WFT_Moments" in texts["[health] may_be_silent"]
    assert "WFT_Forces.Fz" in texts["[health] may_be_constant"]
    assert "can0" in texts["[health] may_carry_unknown"]


def test_a_hole_of_the_whole_bus_is_one_reason() -> None:
    result = monitored(without(recorded(), MOVES_S, MOVES_S + 0.4))
    jumps = {one.where for one in result.reasons if one.code == "counter_jump"}
    assert jumps == {"can0: several messages"}
    assert any("WFT_Forces, WFT_Moments" in one.what for one in result.reasons)
    lost = len(rows(recorded().frames, FORCES, MOVES_S, MOVES_S + 0.4))
    assert result.monitor.losses()["counter.can0.WFT_Forces"] == lost


def test_the_machine() -> None:
    def host_at(time_s: float) -> HostStatus:
        return HostStatus(
            {"can0": BusStatus("up", 1, 0)},
            queue_share=0.0 if time_s < 5 else 0.3 if time_s < 10 else 0.8 if time_s < 15 else 0.0,
            disk_free_bytes=10**9,
            disk_reserve_bytes=10**8,
            disk_bytes_per_s=10_000.0 if time_s < 10 else 500_000.0 if time_s < 20 else 5_000_000.0,
            cpu_share=1.2 if 10 < time_s < 17 else 0.3,
            clock_steps=int(time_s > 20),
            last_step_s=3600.0,
        )

    result = monitored(recorded(), host_at)
    assert codes(result) == {"queue_filling", "disk_low", "cpu_busy", "clock_stepped"}
    assert level_of(result, "queue_filling") is Level.RED
    assert level_of(result, "disk_low") is Level.RED
    assert result.first_s("disk_low") == pytest.approx(10, abs=0.5)
    assert result.first_s("cpu_busy") == pytest.approx(15.2, abs=0.5)
    assert "+3600.000 s" in next(one.what for one in result.last.reasons if one.code == "clock_stepped")
