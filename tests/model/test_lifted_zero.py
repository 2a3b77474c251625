"""A zero of the lifted wheel that was taken off is a reading of 0 without load, known as well as it was determined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from model.diagnosis import DiagnosisOptions, diagnose, samples_of
from model.diagnosis.core.campaign import Campaign
from model.diagnosis.time_series.standstills import corrected_zeros
from processing.processed_run import AppliedZero


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


@pytest.mark.parametrize(("names", "most"), [(("spin.mcap",), 0.75), (("before.mcap", "after.mcap"), 0.2)])
def test_it_tells_how_large_a_zero_may_still_be(names: tuple[str, ...], most: float) -> None:
    """Once: what it drifts until the runs stays open. Before and after: the zero is known."""
    options = DiagnosisOptions(effects=("torque_zero", "torque_gain"))
    campaign = simulated_campaign(runs=4, effect="torque_gain:relative=-0.05")
    blind, told = (diagnose([lifted(campaign, sigma, names)], options) for sigma in (0.0, 0.5))
    sizes = [found.minimum_detectable["torque_zero"].value for found in (blind, told)]
    assert sizes[1] < most * sizes[0]
    zeros = [{one.name: one.probability for one in found.candidates}["torque_zero"] for found in (blind, told)]
    assert zeros[1] < zeros[0] and [cause.name for cause in told.causes] == ["torque_gain"]
    assert blind.corrected == () != told.corrected


def test_what_was_taken_off_is_told_with_its_interval_and_source() -> None:
    campaign = lifted(simulated_campaign(runs=3))
    [zero] = corrected_zeros(campaign.runs)
    assert (zero.name, zero.value, zero.unit) == ("torque_zero", 12.0, "N m")
    assert zero.interval95 == pytest.approx((12.0 - 0.98, 12.0 + 0.98)) and zero.sources == (
        "before.mcap",
        "after.mcap",
    )
