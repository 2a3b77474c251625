"""The gain on left-out runs, on short simulated campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_campaign import driven, looked

from daq import Note
from model import DiagnosisCode
from model.diagnosis.findings.held_out import held_out, predict_held_out
from model.diagnosis.findings.set_fit import fit_set
from model.diagnosis.time_series.evidence import log_likelihood_of_run
from model.diagnosis.time_series.linearise import SENSORS
from processing import ProcessedRun

DIGGING = "vasilev:H_m=0.04"


def test_a_cause_that_is_there_gains_and_every_fold_chooses_it() -> None:
    seen = looked(driven(DIGGING), "vasilev", "torque_zero")
    gain, note = held_out(seen)
    assert gain is not None and note == ()
    assert all("vasilev" in keys for keys in gain.chosen) and len(gain.chosen) == 4
    assert gain.log_likelihood_gain > 20
    assert gain.extended["dp"].R0 < 0.8 * gain.base["dp"].R0
    low, high = gain.interval95
    assert 0 < low <= gain.reduction_percent <= high < 100


def test_nothing_there_gains_nothing() -> None:
    gain, _ = held_out(looked(driven(), "vasilev", "torque_zero"))
    assert gain is not None and gain.log_likelihood_gain <= 1.0


def test_a_wrong_cause_that_is_forced_does_not_gain_what_the_right_one_does() -> None:
    seen = looked(driven(DIGGING), "vasilev", "torque_zero")
    right, wrong = (
        sum(predict_held_out(seen, fit, run).log_likelihood for run in range(4))
        for fit in (fit_set(seen, (key,)) for key in ("vasilev", "torque_zero"))
    )
    assert right > wrong + 20


def test_a_held_out_run_does_not_change_its_prediction() -> None:
    """Changed measured values of a run leave its prediction from the others unchanged."""
    seen = looked(driven(DIGGING), "vasilev")
    fit = fit_set(seen, ("vasilev",))
    grams = fit.grams()
    spoilt = grams.matrices.copy()
    spoilt[2, 0, :] *= 3.0
    spoilt[2, :, 0] *= 3.0
    one, other = predict_held_out(seen, fit, 2, grams), predict_held_out(seen, fit, 2, replace(grams, matrices=spoilt))
    np.testing.assert_allclose(one.predicted["dp"], other.predicted["dp"], rtol=1e-12)
    assert one.log_likelihood > other.log_likelihood
    assert one.log_likelihood == pytest.approx(log_likelihood_of_run(grams, 2, ("vasilev",)))


def test_a_sinkage_sensor_that_is_off_is_predicted_off() -> None:
    """Its zero is one number of the campaign, which the other runs know."""

    def off(run: ProcessedRun) -> ProcessedRun:
        return replace(run, sinkage_m=np.full(len(run), 0.1), sinkage_sigma_m=np.full(len(run), 0.003))

    campaign = driven()
    seen = looked(replace(campaign, runs=tuple(map(off, campaign.runs))))
    fit = fit_set(seen, ())
    part, point = fit.problem.parts[0], fit.problem.points(fit.estimate)[0]
    sensors = np.array([0.5, -0.3, 1.2])
    moved = replace(point, soil=np.r_[point.soil[:-3], point.soil[-3:] + sensors])
    change = part.at_measured_slip(moved) - part.at_measured_slip(point)
    np.testing.assert_allclose(change, part.frozen.soil[..., -3:] @ sensors, atol=1e-9)
    assert change[part.frozen.channels.index("z")] == pytest.approx(1.2 * SENSORS["sinkage_zero_m"], rel=0.02)
    few = np.arange(len(part.data.samples)) % 7 == 0
    np.testing.assert_allclose(part.at_measured_slip(point, few), part.at_measured_slip(point)[:, few])


def test_few_runs_are_said() -> None:
    campaign = driven(DIGGING)
    one = looked(replace(campaign, runs=campaign.runs[:1]), "vasilev")
    assert held_out(one) == (None, (Note(DiagnosisCode.ONE_RUN),))
    gain, notes = held_out(looked(replace(campaign, runs=campaign.runs[:2]), "vasilev"))
    assert gain is not None and notes == (Note(DiagnosisCode.TWO_RUNS),) and np.isnan(gain.interval95).all()
