"""The health monitor on our sample recordings: nothing is wrong there."""

from __future__ import annotations

from pathlib import Path

import pytest
from health_support import watch

from daq.logger.health.report import Level
from daq.runs import open_runs

RECORDINGS = Path(__file__).parents[2] / "recordings"


NAMES = [f"{folder}/run-{number}.mcap" for folder in ("clay", "sandy") for number in range(1, 7)]
QUICK = ("clay/run-1.mcap", "sandy/run-4.mcap")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in NAMES]
)
def test_a_sample_stays_green(name: str) -> None:
    run = open_runs([RECORDINGS / name])[0]
    result = watch(run.vehicle, run.databases, run.frame_batches())
    assert {(one.code, one.where, one.what) for one in result.reasons} == set()
    assert result.last.level is Level.GREEN
    assert result.monitor.losses() == {}
    usual = {one.name: round(one.usual_rate_hz) for one in result.last.messages}
    assert usual["WFT_Forces"] == 1000
    assert usual["WheelSpeeds"] == 100
    assert usual["GNSS_1"] == 20
