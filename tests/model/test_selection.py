"""A bad second is left out and said to be; a misfit is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_campaign import driven, looked

from model.diagnosis.core.campaign import Campaign
from model.diagnosis.time_series.selection import AROUND_S, LIMIT
from model.diagnosis.time_series.samples import samples_of
from model.notes import DiagnosisCode


def with_torque(campaign: Campaign, run: int, first_s: float, last_s: float, off_nm: float) -> Campaign:
    """Return a campaign whose torque is off for some seconds of a run."""
    own = campaign.runs[run]
    time = own.time_s - own.time_s[0]
    off = np.where((time >= first_s) & (time < last_s), off_nm, 0.0)
    spoilt = replace(own, driving_torque_nm=own.driving_torque_nm + off)
    return replace(campaign, runs=tuple(spoilt if i == run else one for i, one in enumerate(campaign.runs)))


@pytest.fixture(scope="module")
def sound() -> Campaign:
    return driven()


def test_a_bad_second_is_left_out_and_said_to_be(sound: Campaign) -> None:
    whole = looked(sound, "vasilev", "torque_zero")
    seen = looked(with_torque(sound, 1, 6.0, 6.4, 400.0), "vasilev", "torque_zero")
    assert whole.linearisation.used == whole.linearisation.samples
    assert not [note for note in whole.notes if note.code == DiagnosisCode.OUTLIERS]
    [note] = [note for note in seen.notes if note.code == DiagnosisCode.OUTLIERS]
    assert note.values["runs"] == (sound.runs[1].run.id,) and note.values["limit"] == LIMIT
    assert 2 <= note.values["samples"] == seen.linearisation.samples - seen.linearisation.used <= 10
    samples = seen.campaigns[0].samples
    out = np.isnan(samples.measured["t"])
    assert (samples.run[out] == 1).all() and np.ptp(samples.time_s[out]) <= 0.6 + 2 * AROUND_S
    assert seen.converged and seen.best.keys == whole.best.keys
    assert np.abs(seen.best.soil - whole.best.soil).max() < 0.5


def test_a_misfit_of_many_seconds_is_none(sound: Campaign) -> None:
    seen = looked(with_torque(sound, 1, 5.0, 12.0, 400.0), "vasilev", "torque_zero")
    assert not [note for note in seen.notes if note.code == DiagnosisCode.OUTLIERS]
    assert seen.linearisation.used == seen.linearisation.samples


def test_a_receiver_that_lags_behind_a_stop_is_no_locked_wheel(sound: Campaign) -> None:
    """One sample at slip -1 sent the linearisation of a campaign without a cause where three causes cancel."""
    own = sound.runs[1]
    time = own.time_s - own.time_s[0]
    stopped = replace(own, wheel_speed_radps=np.where((time >= 6.0) & (time < 6.6), 0.0, own.wheel_speed_radps))
    before, after = (samples_of(replace(sound, runs=(one,))) for one in (own, stopped))
    assert 1 <= len(before) - len(after) <= 5
    assert np.asarray(after.conditions.slip).min() > -0.99
