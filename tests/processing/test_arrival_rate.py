"""Channels that arrive in bursts, or with losses, are judged by how many samples came in the time."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_run import forces, speeds, vehicle

from daq import Channel
from processing import ProcessOptions, RunCode
from processing.pipeline import process
from wheelsoil.wording.notes import texts_of

_RATE_HZ = 51.9


def _held_back(ground: Channel, largest: int, inner_s: float, seed: int = 3) -> Channel:
    """Return the channel as it arrives when up to `largest` samples wait for the last of them."""
    sizes = np.random.default_rng(seed).integers(1, largest + 1, len(ground))
    sizes = sizes[: int(np.searchsorted(np.cumsum(sizes), len(ground)))]
    last = np.repeat(np.cumsum(sizes), sizes) - 1
    within = np.concatenate([np.arange(size) for size in sizes])
    time_ns = ground.time_ns[last] + np.round(within * inner_s * 1e9).astype(np.int64)
    order = np.argsort(time_ns, kind="stable")
    return Channel(ground.name, ground.unit, time_ns[order], ground.values[: len(order)][order])


@pytest.mark.parametrize(("largest", "inner_s"), [(4, 0.0103), (8, 0.0005), (8, 0.0)])
def test_a_stream_in_bursts_is_used_at_its_rate(largest: int, inner_s: float) -> None:
    channels = speeds(40.0, 0.1, ground_rate_hz=_RATE_HZ) | forces(40.0)
    run = process(channels | {"ground_speed": _held_back(channels["ground_speed"], largest, inner_s)}, vehicle())
    facts = run.quality.sensors["ground_speed"]
    assert facts.rate_hz == pytest.approx(_RATE_HZ, rel=0.01)
    assert run.used.mean() > 0.6 and facts.gaps == 0
    if run.cutoff_hz < 5:
        assert any("in bursts" in text for text in texts_of(run.quality.notes))


def test_lost_samples_lower_the_rate() -> None:
    channels = speeds(40.0, 0.1, ground_rate_hz=100.0) | forces(40.0)
    ground = channels["ground_speed"]
    kept = np.random.default_rng(0).random(len(ground)) > 0.6
    lossy = Channel(ground.name, ground.unit, ground.time_ns[kept], ground.values[kept])
    run = process(channels | {"ground_speed": lossy}, vehicle())
    assert run.quality.sensors["ground_speed"].rate_hz == pytest.approx(100 * kept.mean(), rel=0.01)


def test_little_used_says_what_a_longer_gap_gives_and_it_does() -> None:
    channels = speeds(60.0, 0.1, ground_rate_hz=50.0) | forces(60.0)
    ground = channels["ground_speed"]
    kept = np.repeat(np.random.default_rng(2).random(len(ground) // 10) > 0.4, 10)
    patchy = Channel(ground.name, ground.unit, ground.time_ns[kept], ground.values[kept])
    run = process(channels | {"ground_speed": patchy}, vehicle())
    (note,) = (note for note in run.quality.notes if note.code is RunCode.LITTLE_USED)
    assert note.values["used"] == pytest.approx(run.used.mean()) and run.used.mean() < 0.5
    longer = process(
        channels | {"ground_speed": patchy}, vehicle(), options=ProcessOptions(max_gap_s=note.values["max_gap_s"])
    )
    assert longer.used.mean() == pytest.approx(note.values["used_then"]) and longer.used.mean() > run.used.mean() + 0.3
    assert f"{100 * longer.used.mean():.1f} % would be with `process --max-gap" in " ".join(texts_of(run.quality.notes))


def test_nothing_is_proposed_where_no_gap_helps() -> None:
    channels = speeds(60.0, 0.1, speed=lambda time_s: np.where(time_s < 50, 0.3, 2.0) + 0 * time_s) | forces(60.0)
    run = process(channels, vehicle(), options=ProcessOptions(min_speed_mps=1.0))
    (note,) = (note for note in run.quality.notes if note.code is RunCode.LITTLE_USED)
    assert note.values["max_gap_s"] is None and note.values["reason"] == "TOO_SLOW"
