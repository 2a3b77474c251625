"""Zeros that differ from run to run, or that nobody lists, are noise: they are given no cause's name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign, with_sinkage
from short_campaign import driven, noise_of

from model.diagnosis import Campaign, DiagnosisOptions, diagnose, samples_of
from model.diagnosis.time_series import linearise_campaigns
from model.diagnosis.time_series.linearised_campaign import with_likely_load
from model.diagnosis.time_series.noise import hyper_priors


def taken_anew(campaign: Campaign, pull_n: float, torque_nm: float) -> Campaign:
    """Zero the transducer anew before each run, not very well."""
    off = np.random.default_rng(0).normal(size=(len(campaign.runs), 2)) * (pull_n, torque_nm)
    runs = [
        replace(run, drawbar_pull_n=run.drawbar_pull_n + a, driving_torque_nm=run.driving_torque_nm + b)
        for run, (a, b) in zip(campaign.runs, off, strict=True)
    ]
    return replace(campaign, runs=tuple(runs))


@pytest.mark.parametrize(
    "effects", [("drawbar_pull_zero", "torque_zero", "crosstalk", "slope"), pytest.param((), marks=pytest.mark.slow)]
)
def test_zeros_taken_anew_are_seen_as_such_and_not_named(effects: tuple[str, ...]) -> None:
    """With a short library, and with all of it."""
    campaign = taken_anew(simulated_campaign("clay", 0), 40.0, 20.0)
    options = DiagnosisOptions(effects=effects) if effects else DiagnosisOptions()
    seen = linearise_campaigns([campaign], options)
    assert 15.0 < seen.campaigns[0].noise.values["drawbar_pull_of_run_n"] < 100.0
    assert 7.0 < seen.campaigns[0].noise.values["driving_torque_of_run_nm"] < 50.0
    found = diagnose([campaign], options, seen.noises)
    assert found.verdict != "named"


@pytest.mark.slow
@pytest.mark.parametrize("offset_m", [-0.015, 0.015])
def test_a_zero_of_the_sinkage_sensor_is_not_given_another_causes_name(offset_m: float) -> None:
    campaign = with_sinkage(simulated_campaign("clay", 0))
    runs = tuple(replace(run, sinkage_m=run.sinkage_m + offset_m) for run in campaign.runs)
    assert diagnose([replace(campaign, runs=runs)]).verdict != "named"


def test_a_load_that_never_moves_is_taken_as_it_is() -> None:
    samples = samples_of(simulated_campaign("clay", 0, runs=2))
    still = np.where(samples.run == 0, 8e3, 11e3)
    samples = replace(samples, conditions=replace(samples.conditions, vertical_load_n=still))
    values = {name: b.centre for name, b in hyper_priors(samples).items()}
    assert with_likely_load(samples, values) is samples


def test_a_library_of_one_cause_is_weighed_whole() -> None:
    found = diagnose([driven()], DiagnosisOptions(effects=("torque_zero",)), [noise_of(driven())])
    assert [c.name for c in found.candidates if c.name != "none"] == ["torque_zero"]
