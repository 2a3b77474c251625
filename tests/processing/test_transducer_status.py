"""Samples that the transducer itself distrusts."""

from itertools import pairwise

import numpy as np
import pytest
from synthetic_run import START_NS, channel, forces, speeds, stamps, vehicle

from daq import Channel
from processing import ProcessedRun, ProcessOptions, Reason
from processing.pipeline import process, process_stream
from wheelsoil.wording.notes import texts_of

LABELS = {0: "Ok", 2: "Overrange", 15: "Fault"}


def _run(
    status: np.ndarray,  # type: ignore[type-arg]
    chunks: int = 1,
    purpose: str = "process",
    *,
    of_s: float = 20.0,
    came: np.ndarray | None = None,  # type: ignore[type-arg]
) -> ProcessedRun:
    """Process 20 s, of which the status covers `of_s`; only those status samples are there that `came`."""
    at = stamps(20.0, 1000.0)
    made = speeds(20.0) | forces(20.0)
    spoilt = made["drawbar_pull"].values.copy()
    spoilt[: len(status)][status != 0] = 32_000.0
    made["drawbar_pull"] = channel("drawbar_pull", at, spoilt)
    there = slice(None) if came is None else came
    raw = channel("transducer_status", stamps(of_s, 1000.0)[there], status[there])
    made["transducer_status"] = Channel(raw.name, "", raw.time_ns, raw.values, LABELS)
    if chunks == 1:
        return process(made, vehicle(), options=ProcessOptions(purpose=purpose))
    edges = START_NS + np.linspace(0, 20e9, chunks + 1).astype(np.int64)
    pieces = []
    for start, stop in pairwise(edges.tolist()):
        rows = {role: (c.time_ns >= start) & (c.time_ns < stop) for role, c in made.items()}
        pieces.append({r: Channel(r, c.unit, c.time_ns[rows[r]], c.values[rows[r]], c.labels) for r, c in made.items()})
    return process_stream(pieces, vehicle())


@pytest.mark.parametrize("chunks", [1, 7])
def test_distrusted_samples_are_left_out_for_a_reason_of_their_own(chunks: int) -> None:
    at = stamps(20.0, 1000.0)
    status = np.zeros(len(at))
    status[(at >= 8.0) & (at < 9.5)] = 2
    status[(at >= 9.5) & (at < 10.0)] = 15
    status[12_345] = 2  # one alone is bridged like any missing sample
    run = _run(status, chunks)
    left_out = run.reason == Reason.TRANSDUCER
    assert left_out[(run.time_s > 8.2) & (run.time_s < 9.8)].all()
    assert not left_out[(run.time_s < 7.9) | (run.time_s > 10.1)].any()
    assert run.quality.transducer_status == {"Overrange": 1501, "Fault": 500}
    assert run.quality.sensors["drawbar_pull"].distrusted == 2001
    assert any("Overrange 1,501, Fault 500" in note for note in texts_of(run.quality.notes))
    assert np.abs(run.drawbar_pull_n[run.used]).max() < 950
    assert run.quality.shares["TRANSDUCER"] == pytest.approx(2.0 / 20.0, rel=0.1)


def test_a_transducer_that_trusts_itself_leaves_no_trace() -> None:
    run = _run(np.zeros(20_000))
    assert not run.quality.transducer_status
    assert "TRANSDUCER" not in run.quality.shares


def test_a_transducer_that_never_trusts_itself_leaves_nothing() -> None:
    run = _run(np.full(20_000, 15.0), purpose="fit")
    assert not run.used.any()
    assert run.quality.shares["TRANSDUCER"] > 0.9
    assert np.isnan(run.drawbar_pull_n).all()


@pytest.mark.parametrize("chunks", [1, 7])
@pytest.mark.parametrize("last", [0.0, 15.0])
def test_a_status_that_stops_is_not_held_and_is_told(chunks: int, last: float) -> None:
    status = np.zeros(8_000)
    status[7_500:] = last
    run = _run(status, chunks, of_s=8.0)
    left_out = run.reason == Reason.TRANSDUCER
    assert not left_out[run.time_s > 8.3].any()
    assert left_out[(run.time_s > 7.7) & (run.time_s < 7.9)].all() == bool(last)
    assert run.used[run.time_s > 8.5].mean() > 0.95
    (note,) = [note for note in texts_of(run.quality.notes) if "status is not known" in note]
    assert note.startswith("of 11,900 of 20,000 samples")


def test_a_status_that_never_comes_is_told() -> None:
    made = speeds(20.0) | forces(20.0)
    run = process(made, vehicle(signals={"transducer_status": "W.Status"}))
    assert any("status never came" in note for note in texts_of(run.quality.notes))
    assert not any("status" in note for note in texts_of(process(made, vehicle()).quality.notes))


def test_a_status_that_arrives_late_holds_meanwhile() -> None:
    status = np.zeros(20_000)
    came = np.ones(20_000, bool)
    for first in np.random.default_rng(2).integers(0, 19_900, 60):
        came[first : first + 80] = False
    run = _run(status, came=came)
    assert not any("status" in note for note in texts_of(run.quality.notes))
