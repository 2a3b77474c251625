"""The whole diagnosis on simulated campaigns, and on what poor campaigns there are; the noise model is given."""

from __future__ import annotations

import json
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from daq import Note
from model import DiagnosisCode
from model.diagnosis import Campaign, Diagnosis, DiagnosisOptions, diagnose, samples_of
from model.diagnosis.time_series.noise import Noise, hyper_priors
from processing import ProcessedRun, Reason
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.wording.notes import step_text, texts_of
from wheelsoil.wording.verdict import sentence_of, sentences_of

FEW = DiagnosisOptions(
    effects=(
        "vasilev",
        "lyasko",
        "ding",
        "stress_peak_shift",
        "bulldozing",
        "torque_zero",
        "drawbar_pull_zero",
        "slope",
    )
)
TWO = replace(FEW, effects=("vasilev", "slope"))
RUNS = 4


def diagnosed(*campaigns: Campaign, options: DiagnosisOptions = FEW) -> Diagnosis:
    """Diagnose with the noise model that the sensors' sigmas suggest."""
    noises = [
        Noise({name: b.centre for name, b in hyper_priors(samples_of(c)).items()}) if c.runs else Noise({})
        for c in campaigns
    ]
    found = diagnose(campaigns, options, noises)
    json.dumps(diagnosis_json(found))
    assert sum(c.probability for c in found.candidates) >= 0.999 or not found.candidates
    return found


def only(run: ProcessedRun, keep: np.ndarray) -> ProcessedRun:
    """Return a run of which only some samples are used."""
    reason = np.where(keep | (run.reason != Reason.USED), run.reason, np.uint8(Reason.INVALID_FIX))
    return replace(run, reason=reason.astype(np.uint8))


@pytest.fixture(scope="module")
def digging() -> Campaign:
    return simulated_campaign("clay", 3, RUNS, "vasilev:H_m=0.04")


@pytest.fixture(scope="module")
def plain() -> Campaign:
    return simulated_campaign("clay", 0, RUNS)


def test_slip_sinkage_is_named_with_its_size(digging: Campaign) -> None:
    found = diagnosed(digging)
    assert found.verdict == "named", sentence_of(found)
    [cause] = found.causes
    assert cause.name == "slip_sinkage"
    assert cause.probability > 0.9
    assert found.gain is not None
    assert found.gain.log_likelihood_gain > 0
    assert found.gain.reduction_percent > 20
    if cause.form == "vasilev":
        low, high = cause.parameters[0].interval95
        assert low < 0.04 < high
    assert found.what_is_wrong[0].statistic != 0
    if "would fit almost as well" in sentence_of(found):
        assert f"Next: {step_text(found.next_run[0])}." in sentence_of(found)
        assert "slip_sinkage" in found.next_run[0].separates
    assert found.sets[0].causes == ("slip_sinkage",)
    assert {"linearise", "whitening", "bagging", "held_out", "final"} <= set(found.stages_s)
    [seen] = found.plot_data
    began = np.array([run.start_ns - digging.runs[0].start_ns for run in digging.runs]) * 1e-9
    np.testing.assert_allclose(seen.since_first_run_s, began[seen.run] + seen.time_s, rtol=1e-9)
    assert np.corrcoef(seen.since_first_run_s, seen.campaign_time)[0, 1] > 0.999
    for channel in ("dp", "t"):  # medians: near zero slip the measured slip's own error is larger than any cause
        better = np.nanmedian(np.abs(seen.measured[channel] - seen.extended[channel]))
        assert better < 0.8 * np.nanmedian(np.abs(seen.measured[channel] - seen.base[channel]))
    for channel, change in seen.signatures[cause.key].items():  # the one cause of the extended model
        np.testing.assert_allclose(change, seen.extended[channel] - seen.base[channel], rtol=1e-9, atol=1e-9)
    assert all(np.isfinite(x).any() for x in seen.base_sigma.values())


def test_nothing_is_seen_where_nothing_is_hidden(plain: Campaign) -> None:
    found = diagnosed(plain)
    assert found.verdict == "nothing_detectable", sentence_of(found)
    assert not found.causes
    assert set(found.minimum_detectable) == set(FEW.effects)
    assert all(0 < abs(d.value) < inf for d in found.minimum_detectable.values())


@pytest.mark.slow
def test_two_campaigns_share_a_cause(digging: Campaign) -> None:
    found = diagnosed(replace(digging, runs=digging.runs[:2]), replace(digging, name="more", runs=digging.runs[2:]))
    assert found.verdict == "named", sentence_of(found)
    assert found.causes[0].name == "slip_sinkage"
    assert [soil.campaign for soil in found.soils] == [digging.name, "more"]
    assert "disagree" not in sentence_of(found)


@pytest.mark.slow
@pytest.mark.parametrize(("sinkage_m", "verdict"), [(0.05, "named"), (0.07, "unexplained")])
def test_two_campaigns_that_differ_in_the_size_of_a_shared_cause_are_told(
    digging: Campaign, sinkage_m: float, verdict: str
) -> None:
    deeper = simulated_campaign("clay", 4, RUNS, f"vasilev:H_m={sinkage_m:g}")
    found = diagnosed(digging, deeper, options=TWO)
    assert found.verdict == verdict, sentence_of(found)
    assert "The campaigns disagree about H_m: clay 3 0.0" in sentence_of(found)
    assert sentences_of(found)[1].startswith("The campaigns disagree") == (verdict == "unexplained")
    assert any("disagree about H_m" in note for note in texts_of(found.notes))


@pytest.mark.parametrize("runs", [1, 2])
def test_one_or_two_runs_name_nothing(digging: Campaign, runs: int) -> None:
    found = diagnosed(replace(digging, runs=digging.runs[:runs]), options=TWO)
    assert found.verdict in ("one_of", "unexplained")
    assert Note(DiagnosisCode.FEW_RUNS, values={"runs": runs}) in found.notes
    assert (found.gain is None) == (runs == 1)


@pytest.mark.slow
def test_two_terrains_in_one_campaign_are_told(plain: Campaign) -> None:
    sand = simulated_campaign("sandy", 2, RUNS)
    found = diagnosed(replace(plain, runs=plain.runs[:2] + sand.runs[2:]))
    assert found.verdict == "unexplained"
    assert "two terrains" in sentence_of(found)
    assert Note(DiagnosisCode.NOTHING_TO_TEST) in found.notes
    assert not found.causes


def test_a_soil_that_is_known_exactly_has_nothing_to_fit(plain: Campaign) -> None:
    prior = replace(plain.soil_prior, covariance=np.zeros((6, 6)))
    two = replace(plain, soil_prior=prior, runs=plain.runs[:2])
    found = diagnosed(two, options=replace(TWO, most_causes=1))
    assert found.soils[0].sigmas["tan_phi"] == 0.0


@pytest.mark.parametrize("few", ["samples", "slip", "runs"])
def test_too_little_is_a_verdict_that_says_so(digging: Campaign, few: str) -> None:
    if few == "runs":
        poor = replace(digging, runs=())
    elif few == "slip":
        poor = replace(digging, runs=tuple(only(r, np.abs(r.slip) < 0.08) for r in digging.runs))
    else:
        poor = replace(digging, runs=tuple(only(r, (r.time_s > 6) & (r.time_s < 8)) for r in digging.runs))
    found = diagnosed(poor)
    assert found.verdict == "nothing_detectable"
    assert sentence_of(found).startswith("Nothing can be decided: ")
    assert "Next: " in sentence_of(found)
    assert set(found.not_identifiable) == {"slip_sinkage", "stress_peak_shift", "bulldozing", "torque_zero"} | {
        "drawbar_pull_zero",
        "slope",
    }


def test_a_campaign_with_too_little_is_left_out_of_several(digging: Campaign) -> None:
    found = diagnosed(digging, replace(digging, name="empty", runs=()), options=TWO)
    assert found.verdict == "named"
    assert any("empty" in note and "excluded" in note for note in texts_of(found.notes))
