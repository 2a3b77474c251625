"""Fewer points of a run: peaks of pull and slip stay, a gap stays a gap, one index for all quantities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processing import ProcessedRun, ProcessOptions, Reason
from wheelsoil.view.trace import MOST_POINTS, rows_to_draw, trace_as_json, trace_of
from wheelsoil.workflows import open_and_process

SAMPLE = Path(__file__).parents[2] / "recordings" / "clay" / "run-1.mcap"
ARRAYS = [name for name, kind in ProcessedRun.__annotations__.items() if "Array" in kind and "dict" not in kind]


@pytest.fixture(scope="module")
def run() -> ProcessedRun:
    [(_, processed)] = open_and_process([SAMPLE], ProcessOptions())
    return processed


def longer(run: ProcessedRun, times: int) -> ProcessedRun:
    """The run, driven several times without a break."""
    arrays = {name: np.tile(getattr(run, name), times) for name in ARRAYS}
    return replace(run, **arrays | {"time_s": np.arange(times * len(run)) / run.rate_hz})


def test_a_long_run_has_no_more_points_than_can_be_drawn(run: ProcessedRun) -> None:
    long = longer(run, 40)
    trace = trace_of(long)
    assert MOST_POINTS / 2 < len(trace.time_s) <= MOST_POINTS
    assert trace.thinned_from == len(long) and len(long) > 20 * MOST_POINTS
    assert {len(values) for values in trace.quantities.values()} == {len(trace.reason)}


def test_one_sample_that_stands_out_stays(run: ProcessedRun) -> None:
    row = int(np.flatnonzero(run.used)[777])
    pull, slip = run.drawbar_pull_n.copy(), run.slip.copy()
    pull[row], slip[row + 3] = 99e3, -0.99
    rows = rows_to_draw(replace(run, drawbar_pull_n=pull, slip=slip))
    assert row in rows and row + 3 in rows
    assert np.all(np.diff(rows) > 0)


def test_a_run_that_is_short_stays_whole(run: ProcessedRun) -> None:
    short = replace(run, **{name: getattr(run, name)[:4] for name in ARRAYS})
    assert rows_to_draw(short).tolist() == [0, 1, 2, 3]
    one = replace(run, **{name: getattr(run, name)[:1] for name in ARRAYS})
    assert trace_of(one).segments[0][1:] == (0.0, 0.0)


def test_a_gap_stays_a_gap(run: ProcessedRun) -> None:
    lost = (run.time_s > 10) & (run.time_s < 15)
    reason = np.where(lost, np.uint8(Reason.GAP), run.reason)
    changed = {name: np.where(lost, np.nan, getattr(run, name)) for name in ("slip", "drawbar_pull_n")}
    said = trace_as_json(trace := trace_of(replace(run, reason=reason, **changed)), trace.reason)
    inside = [i for i, t in enumerate(said["time_s"]) if 10.5 < t < 14.5]
    assert inside and all(said["slip"][i] is None and said["reason"][i] == "gap" for i in inside)
    assert not any(said["used"][i] for i in inside)


def test_used_samples_are_preferred_to_those_left_out(run: ProcessedRun) -> None:
    reason = np.full(len(run), np.uint8(Reason.TRANSDUCER))
    reason[::7] = Reason.USED
    trace = trace_of(replace(run, reason=reason))
    assert (trace.reason == Reason.USED).mean() > 0.7


@pytest.mark.parametrize("row", [600, 613, 639])
@pytest.mark.parametrize("samples", [1, 7, 20])
def test_what_is_left_out_for_an_instant_is_drawn_as_such(run: ProcessedRun, row: int, samples: int) -> None:
    assert run.used[590:670].all()
    reason = run.reason.copy()
    reason[row : row + samples] = Reason.GAP
    reason[row + samples] = Reason.TRANSDUCER
    said = trace_as_json(trace := trace_of(replace(run, reason=reason)), trace.reason)
    at = said["time_s"].index(row / run.rate_hz)
    assert said["reason"][at] == "gap" and said["used"][at - 1] and "transducer" in said["reason"][at : at + 3]


def test_many_short_gaps_do_not_make_more_points_than_can_be_drawn(run: ProcessedRun) -> None:
    long = longer(run, 40)
    reason = long.reason.copy()
    reason[::20], reason[10::20] = Reason.GAP, Reason.TRANSDUCER
    assert MOST_POINTS / 2 < len(rows_to_draw(replace(long, reason=reason))) <= MOST_POINTS


def test_a_run_without_any_number_is_drawn_as_nothing(run: ProcessedRun) -> None:
    nothing = np.full(len(run), np.nan)
    empty = replace(run, **dict.fromkeys(("slip", "drawbar_pull_n", "driving_torque_nm", "vertical_load_n"), nothing))
    said = trace_as_json(trace := trace_of(empty), trace.reason)
    assert said["driving_torque_nm"] is None and set(said["slip"]) == {None}
    assert len(said["time_s"]) >= 50
