"""Tilts of the transducer's frame: hidden by another formula, rate and quadrature, with the sensors that show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from blind.engine import campaign_from_channels
from blind.field import FieldDay, field_day
from blind.sensors import START_NS
from blind.tilts import body_pitch as true_body_pitch

from daq.notes import Note
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions, considered, not_identifiable
from model.diagnosis.time_series.diagnosis import diagnose
from model.diagnosis.time_series.samples import coverage_of, samples_of
from model.effects.catalogue import EFFECTS
from model.effects.hub_tilt import hub_tilt_per_torque
from model.wheel_soil.run_conditions import body_pitch
from processing.notes import RunCode
from wheelsoil.wording.verdict import sentence_of

TILTS = {"axle_windup", "body_pitch"}


def day_of(soil: str) -> FieldDay:
    day = field_day(soil, (21, 1), "fjord")
    return replace(day, stance=replace(day.stance, held=False))


def campaign_of(soil: str, hidden: list[tuple[str, float]], *, in_motion: bool = True) -> Campaign:
    return campaign_from_channels(day_of(soil), hidden, in_motion=in_motion)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("soil", "key", "parameter", "size"),
    [
        ("sandy", "axle_windup", "angle_rad_per_knm", 0.004),
        ("clay", "body_pitch", "share", 1.0),
    ],
)
def test_a_tilt_is_named_with_its_size(soil: str, key: str, parameter: str, size: float) -> None:
    said = diagnose([campaign_of(soil, [(key, size)])], DiagnosisOptions())
    assert said.verdict == "named", sentence_of(said)
    [cause] = said.causes
    [found] = cause.parameters
    assert (cause.name, found.name) == (key, parameter)
    assert cause.probability > 0.9
    assert found.interval95[0] < size < found.interval95[1]


def test_the_hub_shows_its_tilt_and_the_body_its_pitch() -> None:
    """The slope of the ground, the zero of either sensor and the noise of the ground speed are in neither."""
    wound = campaign_of("clay", [("axle_windup", 0.004)])
    found = hub_tilt_per_torque(wound.runs)
    assert found is not None
    assert found[0] == pytest.approx(0.004, abs=2.5 * found[1])
    assert found[1] < 0.0012
    assert samples_of(wound).direct == {"axle_windup": found}
    doubt = Note(RunCode.ACCELEROMETER_DOUBTED, values={"role": "wheel_acceleration_x"})
    quality = replace(wound.runs[0].quality, notes=(doubt,))
    assert hub_tilt_per_torque([replace(wound.runs[0], quality=quality), *wound.runs[1:]]) is None
    day, pitch, truth = day_of("clay"), [], []
    for run, m in zip(wound.runs, day.moments, strict=True):
        at = (run.start_ns - START_NS) * 1e-9 + run.time_s[run.used]
        pitch += list(body_pitch(run)[run.used])
        truth += list(np.interp(at, m.time_s, true_body_pitch(m)))
    slope, offset = np.polyfit(truth, pitch, 1)
    assert slope == pytest.approx(1.0, abs=0.2)
    assert abs(offset) < np.radians(0.1)


def test_without_their_sensors_they_are_not_there() -> None:
    plain, moving = (campaign_of("clay", [], in_motion=way) for way in (False, True))
    for campaign, expected in ((plain, set()), (moving, TILTS)):
        samples = samples_of(campaign)
        covered = coverage_of(campaign, samples)
        assert {e.name for e in considered(covered, tuple(EFFECTS), "balanced")} & TILTS == expected
        assert not TILTS & not_identifiable(covered).keys()
        assert samples.direct.keys() == expected - {"body_pitch"}
