"""A bad second is left out and said to be, a misfit is not; nor what the cut at little slip chose by its error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_campaign import driven, looked, noise_of

from model import DiagnosisCode
from model.diagnosis import Campaign, samples_of
from model.diagnosis.time_series.linearisation_point import LinearisationPoint
from model.diagnosis.time_series.linearise import Point
from model.diagnosis.time_series.noise import Noise
from model.diagnosis.time_series.selection import AROUND_S, LIMIT, without_near_cuts
from model.diagnosis.time_series.start import Start, begin


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
    assert not [note for note in whole.notes if note.code == DiagnosisCode.OUTLIERS]
    [note] = [note for note in seen.notes if note.code == DiagnosisCode.OUTLIERS]
    assert note.values["runs"] == (sound.runs[1].run.id,) and note.values["limit"] == LIMIT
    samples = seen.campaigns[0].samples
    before, after = (np.isnan(x.campaigns[0].samples.measured["t"]) for x in (whole, seen))
    out = after & ~before
    assert 2 <= note.values["samples"] <= 10 and out.sum() >= note.values["samples"] - 3
    assert (samples.run[out] == 1).all() and np.ptp(samples.time_s[out]) <= 0.6 + 2 * AROUND_S
    assert seen.converged and seen.best.keys == whole.best.keys
    assert np.abs(seen.best.soil - whole.best.soil).max() < 0.5


def test_a_misfit_of_many_seconds_is_none(sound: Campaign) -> None:
    seen = looked(with_torque(sound, 1, 5.0, 12.0, 400.0), "vasilev", "torque_zero")
    assert not [note for note in seen.notes if note.code == DiagnosisCode.OUTLIERS]
    assert seen.linearisation.used > 0.7 * seen.linearisation.samples


def start_of(campaign: Campaign) -> Start:
    return begin(campaign, samples_of(campaign), ("vasilev",), "balanced", noise_of(campaign))


def at_noise(start: Start, moved_mps: float, sigma_mps: float) -> LinearisationPoint:
    """Return a point at which the ground speed was off by so much, and by so much one-sigma."""
    noise = Noise({**start.noise.values, "speed_noise_mps": 0.6 * sigma_mps, "speed_white_mps": 0.8 * sigma_mps})
    count = len(start.samples)
    point = Point(np.zeros(len(start.simulation.space)), {}, np.full(count, moved_mps))
    return LinearisationPoint(point, noise, np.zeros(count))


def slowest_mps(start: Start, off_mps: float) -> np.ndarray:
    """Return the least of the larger speeds within each sample, the ground speed being off by so much."""
    within = start.samples.instants
    rim = start.samples.wheel_radius_m * within.wheel_speed_radps
    return np.where(rim > within.ground_speed_mps + off_mps, rim, within.ground_speed_mps + off_mps).min(axis=0)


@pytest.mark.parametrize("moved_mps", [0.0, 0.03, -0.03])
def test_samples_near_a_cut_by_their_smoothed_speed_are_not_used(sound: Campaign, moved_mps: float) -> None:
    start, sigma_mps = start_of(sound), 0.02
    [found] = without_near_cuts([start], [at_noise(start, moved_mps, sigma_mps)])
    at = start.samples.conditions
    rim = sound.wheel.radius_m * np.asarray(at.wheel_speed_radps)
    speed = np.asarray(at.ground_speed_mps) + moved_mps
    slip = np.where(rim > speed, 1.0 - speed / rim, rim / speed - 1.0)
    near = np.abs(slip) < 0.05 + 2.0 * sigma_mps / rim
    slow = slowest_mps(start, moved_mps - 2.0 * sigma_mps) < 0.5
    assert (slow & ~near).any()
    near |= slow
    assert 10 < near.sum() < 0.5 * len(near)
    for channel, x in start.samples.measured.items():
        np.testing.assert_array_equal(found.samples.measured[channel], np.where(near, np.nan, x))


def test_where_little_would_be_left_all_samples_are_used(sound: Campaign) -> None:
    start = start_of(sound)
    assert without_near_cuts([start], [at_noise(start, 0.0, 1.0)]) == [start]


def test_a_receiver_that_lags_behind_a_stop_is_no_locked_wheel(sound: Campaign) -> None:
    """One sample at slip -1 sent the linearisation of a campaign without a cause where three causes cancel."""
    own = sound.runs[1]
    time = own.time_s - own.time_s[0]
    stopped = replace(own, wheel_speed_radps=np.where((time >= 6.0) & (time < 6.6), 0.0, own.wheel_speed_radps))
    before, after = (samples_of(replace(sound, runs=(one,))) for one in (own, stopped))
    assert 1 <= len(before) - len(after) <= 5
    assert np.asarray(after.conditions.slip).min() > -0.99
