"""The gain on left-out runs, on short simulated campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_campaign import driven, looked

from daq.notes import Note
from model.diagnosis.findings.held_out import held_out, predict_held_out
from model.diagnosis.findings.set_fit import fit_set
from model.diagnosis.time_series.evidence import log_likelihood_of_run
from model.notes import DiagnosisCode

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


def test_few_runs_are_said() -> None:
    campaign = driven(DIGGING)
    one = looked(replace(campaign, runs=campaign.runs[:1]), "vasilev")
    assert held_out(one) == (None, (Note(DiagnosisCode.ONE_RUN),))
    gain, notes = held_out(looked(replace(campaign, runs=campaign.runs[:2]), "vasilev"))
    assert gain is not None and notes == (Note(DiagnosisCode.TWO_RUNS),) and np.isnan(gain.interval95).all()
