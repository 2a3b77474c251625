"""The live plot's slip is the pipeline's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_support import drive, snapshot

from processing.pipeline import process
from wheelsoil.live.hub import SPAN_S, Curve, LiveSlip


def test_live_slip_agrees_with_the_processed_run() -> None:
    live, run = LiveSlip(), drive().run
    for k in range(120):
        live.take(snapshot(0.25 * k, 0.25 * (k + 1)))
    rows = np.array(live.slip.since(-np.inf))
    channels = run.channels()
    assert run.vehicle is not None
    processed = process(channels, run.vehicle)
    offset_s = (processed.start_ns - min(int(c.time_ns[0]) for c in channels.values())) * 1e-9
    finite = np.isfinite(processed.slip)
    expected = np.interp(rows[:, 0], processed.time_s[finite] + offset_s, processed.slip[finite])
    assert len(rows) > 200
    assert np.median(np.abs(rows[:, 1] - expected)) < 0.02


def test_latencies_are_taken_out() -> None:
    late = LiveSlip()
    late.take(_ramp(latency_s={"wheel_speed": 0.5, "ground_speed": 0.5, "drawbar_pull": 0.5}))
    prompt = LiveSlip()
    prompt.take(_ramp(latency_s={}))
    assert [row[1:] for row in late.slip.since(-np.inf)] == [row[1:] for row in prompt.slip.since(-np.inf)]
    assert late.slip.end_s == pytest.approx(prompt.slip.end_s - 0.5)


def test_a_late_speed_is_waited_for() -> None:
    live, whole = LiveSlip(), _ramp(latency_s={})
    ground = whole["traces"].pop("ground_speed")
    live.take(whole)
    assert live.slip.since(-np.inf) == [] and len(live.pull.since(-np.inf)) == 40
    live.take({"setup": whole["setup"], "traces": {"ground_speed": ground}})
    assert [row[1] for row in live.slip.since(-np.inf)] == [0.2] * 40


@pytest.mark.parametrize("without", ["drawbar_pull", "wheel_speed", "ground_speed", "radius"])
def test_no_slip_without_all_it_needs(without: str) -> None:
    live, snapshot = LiveSlip(), _ramp(latency_s={})
    snapshot["traces"].pop(without, None)
    if without == "radius":
        snapshot["setup"]["wheel_radius_m"] = None
    live.take(snapshot)
    assert live.slip.since(-np.inf) == []


def test_standstill_holes_and_missing_values_give_no_slip() -> None:
    live, snapshot = LiveSlip(), _ramp(latency_s={})
    ground = snapshot["traces"]["ground_speed"]
    ground["value"][10:32] = [None] * 22  # a hole of more than a second
    live.take(snapshot)
    assert [row[0] for row in live.slip.since(-np.inf)] == [*_times()[:10], *_times()[32:]]
    slow = LiveSlip()
    slow.take(_ramp(latency_s={}, speed_mps=0.2))
    assert slow.slip.since(-np.inf) == []


def test_a_sample_that_is_a_minute_old_is_forgotten() -> None:
    curve = Curve()
    curve.add([(t, 1.0) for t in (1.0, 31.0, 61.0)])
    assert [row[0] for row in curve.since(-np.inf)] == [31.0, 61.0]


@given(st.lists(st.floats(0.01, 30.0), min_size=1, max_size=60), st.floats(0, 400))
def test_a_curve_holds_the_last_minute_and_gives_what_is_new(steps_s: list[float], after_s: float) -> None:
    curve, times = Curve(), np.cumsum(steps_s).tolist()
    for t in times:
        curve.add([(t, 1.0)])
    kept = [t for t in times if t > times[-1] - SPAN_S]
    assert [row[0] for row in curve.since(-np.inf)] == kept
    assert [row[0] for row in curve.since(after_s)] == [t for t in kept if t > after_s]
    curve.add([(times[-1], 2.0)])
    assert curve.since(-np.inf)[-1] == (times[-1], 1.0)


def test_the_highest_slip_is_that_of_the_run() -> None:
    live, low = LiveSlip(), _ramp(latency_s={})
    live.take(low | {"session_s": 2.0, "run": {"id": "run-1", "since_s": 2.0}})
    assert live.highest_slip == pytest.approx(0.2)
    live.take({"session_s": 300.0, "run": {"id": "run-1", "since_s": 300.0}})
    assert live.highest_slip == pytest.approx(0.2), "minutes later, too"
    live.take({"session_s": 301.0, "run": {"id": "run-2", "since_s": 0.5}})
    assert live.highest_slip is None, "of a new run nothing is known"


def test_a_clock_that_steps_begins_no_run_and_a_run_of_a_moment_is_one() -> None:
    live, low = LiveSlip(), _ramp(latency_s={})
    live.take(low | {"session_s": 2.0, "run": {"id": "run-1", "since_s": 2.0}})
    live.take({"session_s": 3.0, "run": {"id": "run-1", "since_s": 9.0}})  # the file's time was set 6 s on
    assert live.highest_slip == pytest.approx(0.2)
    live.take({"session_s": 3.1, "run": {"id": "", "since_s": 0.1}})  # between runs
    assert live.highest_slip is None


@pytest.mark.parametrize(("samples", "reached"), [(4, 0.2), (14, 1.0)])
@pytest.mark.parametrize("first", [0, 20])
def test_only_a_slip_that_was_held_is_reached(first: int, samples: int, reached: float) -> None:
    """A ground speed that comes 0.2 s late looks like a slip of 100 %."""
    live, whole = LiveSlip(), _ramp(latency_s={})
    whole["traces"]["ground_speed"]["value"][first : first + samples] = [0.0] * samples
    for begin in range(0, 40, 5):  # as the snapshots come
        part = {
            role: {name: row[begin : begin + 5] for name, row in trace.items()}
            for role, trace in whole["traces"].items()
        }
        live.take({"setup": whole["setup"], "traces": part, "session_s": 2.0, "run": {"id": "run-1", "since_s": 2.0}})
    assert live.highest_slip == pytest.approx(reached)


def test_what_a_run_lost_is_not_what_the_one_before_it_lost() -> None:
    live, losses = LiveSlip(), {"kernel.can0": 17, "counter.can0.WFT": 3, "wrapped.can0.WFT": 1}
    live.take({"session_s": 2.0, "run": {"id": "run-1", "since_s": 2.0}, "losses": losses})
    assert live.lost_frames == 20
    live.take({"session_s": 301.0, "run": {"id": "run-2", "since_s": 0.5}, "losses": losses})
    assert live.lost_frames == 0
    live.take({"session_s": 302.0, "run": {"id": "run-2", "since_s": 1.5}, "losses": losses | {"kernel.can0": 19}})
    assert live.lost_frames == 2


def _times() -> list[float]:
    return [round(0.05 * k, 3) for k in range(1, 41)]


def _ramp(*, latency_s: dict[str, float], speed_mps: float = 2.0) -> dict[str, dict[str, object]]:
    """Two seconds of 20 % slip at a growing pull."""
    traces = {
        "drawbar_pull": {"time_s": _times(), "value": [100.0 * k for k in range(40)]},
        "wheel_speed": {"time_s": _times(), "value": [speed_mps / 0.5] * 40},
        "ground_speed": {"time_s": _times(), "value": [0.8 * speed_mps] * 40},
    }
    return {"setup": {"wheel_radius_m": 0.5, "latency_s": latency_s, "min_speed_mps": 0.5}, "traces": traces}
