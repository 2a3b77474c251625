"""A zero of the lifted wheel that was taken off is a reading of 0 without load, known as well as it was determined."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosis_support import simulated_campaign
from short_campaign import driven, looked, noise_of

from daq import ConfigError, RunsConfig, StaticTest, parse_mapping
from model.diagnosis import DiagnosisOptions, diagnose, samples_of
from model.diagnosis.core.campaign import Campaign
from model.diagnosis.core.result import Diagnosis
from model.diagnosis.findings.agreement import static_disputes
from model.diagnosis.planning.static_tests import hard_ground
from model.diagnosis.time_series.evidence import estimate
from model.diagnosis.time_series.standstills import corrected_zeros
from model.notes import DiagnosisCode
from processing.processed_run import AppliedZero
from wheelsoil.wording.notes import note_text


def lifted(campaign: Campaign, sigma: float = 0.5, names: tuple[str, ...] = ("before.mcap", "after.mcap")) -> Campaign:
    """Return the campaign held brakes throughout, its torque's zero taken off after a spin of the lifted wheel."""
    runs = []
    for i, run in enumerate(campaign.runs):
        zero = AppliedZero(12.0, float("nan"), sigma, ("spin",), names, (600.0 * (i + 1),))
        held = tuple(replace(one, brakes="held") for one in run.quality.standstills)
        zeros = {"driving_torque": zero} if sigma else {}
        runs.append(replace(run, quality=replace(run.quality, zeros=zeros, standstills=held)))
    return replace(campaign, runs=tuple(runs))


def test_runs_that_share_a_determination_know_it_once_and_beside_the_nearest_run() -> None:
    rests = samples_of(lifted(simulated_campaign(runs=3))).rests
    assert rests.lifted.tolist() == [True] and rests.run.tolist() == [0]
    assert rests.measured["t"].tolist() == [0.0] and np.isnan(rests.measured["dp"]).all()
    assert rests.lifted_sigma["t"].tolist() == [0.5] and (np.asarray(rests.conditions.vertical_load_n) < 1e-6).all()


@cache
def with_zeros(sigma: float, names: tuple[str, ...] = ()) -> Diagnosis:
    """Diagnose a gain of the torque of which zeros are known so well, or not at all."""
    campaign = driven("torque_gain:relative=-0.05")
    options = DiagnosisOptions(effects=("torque_zero", "torque_gain"))
    return diagnose([lifted(campaign, sigma, names)], options, [noise_of(campaign)])


@pytest.mark.parametrize(("names", "most"), [(("spin.mcap",), 0.75), (("before.mcap", "after.mcap"), 0.2)])
def test_it_tells_how_large_a_zero_may_still_be(names: tuple[str, ...], most: float) -> None:
    """Once: what it drifts until the runs stays open. Before and after: the zero is known."""
    blind, told = with_zeros(0.0), with_zeros(0.5, names)
    sizes = [found.minimum_detectable["torque_zero"].value for found in (blind, told)]
    assert sizes[1] < most * sizes[0]
    zeros = [{one.name: one.probability for one in found.candidates}["torque_zero"] for found in (blind, told)]
    assert zeros[1] < zeros[0] and [cause.name for cause in told.causes] == ["torque_gain"]
    assert blind.corrected == () != told.corrected


def test_what_was_taken_off_is_told_with_its_interval_and_source() -> None:
    campaign = lifted(simulated_campaign(runs=3))
    [zero] = corrected_zeros(campaign.runs)
    assert (zero.name, zero.value, zero.unit) == ("torque_zero", 12.0, "N m")
    assert zero.interval95 == pytest.approx((12.0 - 0.98, 12.0 + 0.98)) and zero.source == (
        "before.mcap",
        "after.mcap",
    )


def test_white_noise_of_the_speed_averages_out_while_a_wheel_coasts() -> None:
    [data] = looked(driven(), "speed_bias", "wheel_radius").campaigns
    values = data.noise.values | {"speed_noise_time_s": 4.0 * data.samples.block_s}
    noises = [{"speed_noise_mps": 0.02, "speed_white_mps": 1e-9}, {"speed_noise_mps": 1e-9, "speed_white_mps": 0.04}]
    told = [
        hard_ground(replace(data, noise=replace(data.noise, values=values | noise)), data.simulation, data.samples)
        for noise in noises
    ]
    np.testing.assert_allclose(told[1], told[0], rtol=1e-6, atol=1e-9)
    assert told[0].any()


PULL = {"test": "known_pull", "applied_n": 30000.0, "applied_share": 0.001, "drawbar_pull_sigma_n": 2.0}
TORQUE = {"test": "known_torque", "applied_n": 5000.0, "lever_m": 2.0, "applied_share": 0.001}
TORQUE |= {"driving_torque_sigma_nm": 1.0}


@pytest.mark.parametrize(
    ("reading", "key"),
    [
        (PULL | {"drawbar_pull_n": 30000.0 * 1.02}, "drawbar_pull_gain"),
        (TORQUE | {"driving_torque_nm": 10000.0 * 1.02}, "torque_gain"),
    ],
)
def test_a_known_force_tells_a_gain(reading: dict, key: str) -> None:
    """Runs without any error, and a static test that shows 2 %: it says how large the gain is, within its sigma."""
    campaign = lifted(driven(), 0.0)
    found = []
    for one in (campaign, replace(campaign, static=(StaticTest.model_validate(reading),))):
        grams = looked(one, "drawbar_pull_gain", "torque_gain").grams
        told = estimate(grams, (key,))
        found.append((told.coefficients[told.columns[0]] * grams.causes[told.columns[0]].scale, told.sigmas[0]))
    assert found[1][0] == pytest.approx(0.02, abs=0.004) and found[1][1] < 0.6 * found[0][1]


@pytest.mark.parametrize(("gain", "contradicts"), [(1.1, True), (1.01, False)])
def test_a_static_test_that_contradicts_the_runs_is_named_with_both_values(gain: float, contradicts: bool) -> None:
    reading = StaticTest.model_validate(TORQUE | {"driving_torque_nm": 10000.0 * gain})
    campaign = replace(lifted(driven(), 0.0), static=(reading,))
    notes = list(static_disputes(looked(campaign, "drawbar_pull_gain", "torque_gain", "torque_zero")))
    assert [note.code for note in notes] == [DiagnosisCode.STATIC_CONTRADICTS] * contradicts
    for note in notes:
        assert note.values["runs"] == pytest.approx(10000.0, abs=4.0 * note.values["runs_sigma"])
        text = note_text(note)
        assert (
            "under 10,000 N m reads 11,000 ± 10 N m" in text
            and "by the runs it would read" in text
            and "repeat" in text
        )


def test_a_static_zero_says_nothing_beside_the_zero_file_of_the_same_event() -> None:
    campaign = simulated_campaign(runs=3)
    reading = StaticTest(test="lifted", driving_torque_nm=12.3, driving_torque_sigma_nm=0.5)
    both = replace(lifted(campaign), static=(reading,))
    assert len(samples_of(both).rests) == 1
    alone = samples_of(replace(lifted(campaign, 0.0), static=(reading,))).rests
    assert alone.measured["t"].tolist() == [12.3]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"test": "lifted"}, "give a reading"),
        ({"test": "lifted", "driving_torque_nm": 3.0}, "driving_torque_sigma_nm is missing"),
        ({"test": "lifted", "driving_torque_nm": 3.0, "driving_torque_sigma_nm": 1.0, "applied_n": 5.0}, "only lifted"),
        (TORQUE | {"driving_torque_nm": 10000.0, "lever_m": None}, "lever_m is missing"),
        (TORQUE | {"driving_torque_nm": 10000.0, "applied_nm": 900.0}, "is given twice"),
        (TORQUE | {"driving_torque_nm": -10000.0}, "-1 times what was applied; check unit and sign"),
        (TORQUE | {"driving_torque_nm": 10.0}, "0.001 times"),
        (TORQUE | {"driving_torque_nm": 10000.0, "applied_share": 0.5}, "applied_share"),
        (PULL, "go together"),
    ],
)
def test_a_static_test_that_lacks_something_is_refused_with_what(wrong: dict, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse_mapping({"static": [wrong]}, RunsConfig, "runs.toml")


def test_two_static_tests_that_contradict_each_other_are_named_with_their_sizes() -> None:
    readings = [{**TORQUE, "driving_torque_nm": size} for size in (10000.0, 11000.0)]
    with pytest.raises(ConfigError, match=r"0 and 1 contradict each other: 10000 and 11000"):
        parse_mapping({"static": readings}, RunsConfig, "runs.toml")


def test_a_hundred_static_tests_are_enough() -> None:
    reading = {**TORQUE, "driving_torque_nm": 10000.0}
    assert len(parse_mapping({"static": [reading] * 100}, RunsConfig, "runs.toml").static) == 100
    with pytest.raises(ConfigError, match="100"):
        parse_mapping({"static": [reading] * 101}, RunsConfig, "runs.toml")
