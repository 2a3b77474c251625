"""What the two speeds say of each other where a force is not measured: no false alarm on soft soil."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.runs import open_runs
from processing import ProcessOptions, QualityReport
from processing.pipeline import process_stream
from processing.pipeline.latency import rolls_freely
from wheelsoil.wording.notes import texts_of

SANDY = Path(__file__).parents[2] / "recordings" / "sandy"


def quality_without(*roles: str) -> list[QualityReport]:
    found = []
    for run in open_runs([SANDY])[:2]:
        signals = {role: name for role, name in run.vehicle.signals.items() if role not in roles}
        vehicle = run.vehicle.model_copy(update={"signals": signals})
        found.append(process_stream(run.channel_batches(), vehicle, run.info, ProcessOptions()).quality)
    return found


def test_the_delay_is_told_by_drawbar_pull_and_the_radius_by_nobody() -> None:
    for quality in quality_without("driving_torque"):
        assert abs(quality.residual_latency_s) < 0.05 and quality.residual_latency_sigma_s < 0.05
        assert np.isnan(quality.speed_scale)
        assert not any("late" in note or "rim speed" in note for note in texts_of(quality.notes))


@pytest.mark.parametrize("roles", [("drawbar_pull",), ("driving_torque", "drawbar_pull", "vertical_load")])
def test_no_radius_is_told_of_a_wheel_that_may_slip(roles: tuple[str, ...]) -> None:
    for quality in quality_without(*roles):
        assert np.isnan(quality.speed_scale)
        assert not any("rim speed" in note for note in texts_of(quality.notes))


def test_a_road_vehicle_rolls_freely_and_one_that_pulls_cannot_say() -> None:
    rim, nothing = np.full(50, 3.0), np.full(50, np.nan)
    assert rolls_freely(rim, nothing, nothing, nothing, 0.4).all()
    assert not rolls_freely(rim, nothing, np.full(50, 9e3), np.full(50, 200.0), 0.4).any()
