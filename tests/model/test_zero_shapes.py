"""The catch-all sees a zero that grows with the load where it shows best: at standstill."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from model.diagnosis.basis import Basis, basis
from model.diagnosis.campaign import DiagnosisOptions
from model.diagnosis.diagnose import diagnose
from model.diagnosis.linearise import Point, Simulation, linearise
from model.diagnosis.samples import Samples, samples_of
from model.diagnosis.soil_space import soil_space
from model.diagnosis.zero_shapes import ZERO_WITH_LOAD
from model.effects import EFFECTS


@pytest.fixture(scope="module")
def seen() -> tuple[Samples, Basis]:
    campaign = simulated_campaign(runs=3)
    samples = samples_of(campaign, DiagnosisOptions().channels)
    samples = samples[np.arange(len(samples)) % 4 == 0]
    simulation = Simulation(campaign.wheel, campaign.soil, soil_space(campaign.soil_prior), (), "balanced")
    linear = linearise(simulation, samples, Point(np.zeros(len(simulation.space)), {}, np.zeros(len(samples))))
    return samples, basis(samples, linear)


@pytest.mark.parametrize(("row", "channel"), [(0, "dp"), (1, "t")])
def test_one_zero_is_the_same_function_of_the_load_rolling_and_at_rest(
    row: int, channel: str, seen: tuple[Samples, Basis]
) -> None:
    samples, found = seen
    at = found.labels.index(f"{channel}|{ZERO_WITH_LOAD}")
    load = np.asarray(samples.conditions.vertical_load_n)
    rolling = np.polyfit(load, found.columns[row, :, at], 1)
    resting = np.polyfit(np.asarray(samples.rests.conditions.vertical_load_n), found.rests[row, :, at], 1)
    np.testing.assert_allclose(resting, rolling, rtol=1e-6)
    assert np.polyval(rolling, load.mean()) == pytest.approx(0.0, abs=1e-6 * found.heights[at])
    assert not found.columns[1 - row, :, at].any()
    assert not found.rests[1 - row, :, at].any()


def test_only_zeros_show_at_rest(seen: tuple[Samples, Basis]) -> None:
    found = seen[1]
    assert len(found.labels) == len(found.heights) == found.columns.shape[-1] == found.rests.shape[-1]
    showing = {label.partition("|")[2] for i, label in enumerate(found.labels) if found.rests[..., i].any()}
    assert showing == {ZERO_WITH_LOAD}


@pytest.mark.parametrize(
    ("hidden", "family"),
    [("crosstalk:coefficient=0.03", "crosstalk"), ("drawbar_pull_zero:offset_n=-300", "drawbar_pull_zero")],
)
def test_cross_talk_and_a_zero_are_not_taken_for_each_other(hidden: str, family: str) -> None:
    campaign = simulated_campaign(effect=hidden)
    assert [cause.name for cause in diagnose([campaign], DiagnosisOptions()).causes] == [family]
    rest = tuple(key for key, effect in EFFECTS.items() if effect.name != family and effect.reading == "any")
    found = diagnose([campaign], DiagnosisOptions(effects=rest))
    assert found.verdict == "unexplained", found.sentence
    assert any("at standstill too" in one.where for one in found.what_is_wrong)
