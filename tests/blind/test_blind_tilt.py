"""A tilt of the transducer's frame: hidden by another formula, rate and quadrature, with the sensor that shows it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from blind.engine import campaign_from_channels
from blind.field import OWN, FieldDay, field_day
from blind.sensors import START_NS
from blind.tilts import body_pitch as true_body_pitch
from blind.world import World

from daq import DataError
from model.diagnosis import Campaign, DiagnosisOptions, considered, diagnose, not_identifiable, samples_of
from model.diagnosis.time_series import coverage_of
from model.effects import EFFECTS
from model.wheel_soil.run_conditions import body_pitch
from wheelsoil.wording.verdict import sentence_of

SHORT = World(runs=3, duration_s=20.0)


def day_of(world: World) -> FieldDay:
    day = field_day("clay", (21, 1), "fjord", world=world)
    return replace(day, stance=replace(day.stance, held=False))


@cache
def campaign_of(size: float, world: World = OWN, *, pitch: bool = True) -> Campaign:
    return campaign_from_channels(day_of(world), [("body_pitch", size)] if size else [], pitch=pitch)


@pytest.mark.slow
def test_a_tilt_is_named_with_its_size() -> None:
    diagnosis = diagnose([campaign_of(1.0)], DiagnosisOptions())
    assert diagnosis.verdict == "named", sentence_of(diagnosis)
    [cause] = diagnosis.causes
    [share] = cause.parameters
    assert (cause.name, share.name) == ("body_pitch", "share")
    assert cause.probability > 0.9
    assert share.interval95[0] < 1.0 < share.interval95[1]


def test_the_pitch_of_the_body_is_without_slope_and_mounting() -> None:
    day, pitch, truth = day_of(SHORT), [], []
    for run, m in zip(campaign_of(0.0, SHORT).runs, day.moments, strict=True):
        at = (run.start_ns - START_NS) * 1e-9 + run.time_s[run.used]
        pitch += list(body_pitch(run)[run.used])
        truth += list(np.interp(at, m.time_s, true_body_pitch(m)))
    slope, offset = np.polyfit(truth, pitch, 1)
    assert slope == pytest.approx(1.0, abs=0.2)
    assert abs(offset) < np.radians(0.1)


def test_without_its_sensor_it_is_not_there() -> None:
    for pitch in (False, True):
        campaign = campaign_of(0.0, SHORT, pitch=pitch)
        covered = coverage_of(campaign, samples_of(campaign))
        names = {effect.name for effect in considered(covered, tuple(EFFECTS), "balanced")}
        assert ("body_pitch" in names) is pitch
        assert "body_pitch" not in not_identifiable(covered)
    with pytest.raises(DataError, match="body_pitch can only be considered where every run has pitch"):
        diagnose([campaign_of(0.0, SHORT, pitch=False)], DiagnosisOptions(effects=("body_pitch",)))
