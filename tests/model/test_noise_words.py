"""What the noise says of the sensors: zeros that swallow a cause, wheels that are not round."""

from __future__ import annotations

import pytest
from diagnosis_support import linearised, simulated_campaign

from model.diagnosis import DiagnosisOptions, Kind, diagnose
from model.diagnosis.time_series.basis import basis
from model.diagnosis.time_series.noise import HyperPrior, Noise, noise_notes
from wheelsoil.wording.notes import texts_of
from wheelsoil.wording.verdict import sentence_of

VALUES = {
    "drawbar_pull_noise_n": 40.0,
    "drawbar_pull_of_run_n": 8.0,
    "drawbar_pull_wheel_order_n": 5.0,
}
PRIORS = {"drawbar_pull_of_run_n": HyperPrior(7.0, 0.8)}


@pytest.mark.parametrize(("size_n", "told"), [(8.0, False), (30.0, False), (48.0, True)])
def test_zeros_far_beyond_what_is_usual_are_told(size_n: float, told: bool) -> None:
    said = texts_of(noise_notes(Noise(VALUES | {"drawbar_pull_of_run_n": size_n}), PRIORS, ("dp",), 1.0))
    assert bool(said) == told
    assert all("zeros that differ by 48 N from run to run" in text and "where 7 are usual" in text for text in said)


@pytest.mark.parametrize(("size_n", "sure", "told"), [(30.0, 0.1, True), (30.0, 0.9, False), (5.0, 0.1, False)])
def test_a_swing_is_told_where_the_data_tell_it(size_n: float, sure: float, told: bool) -> None:
    values = VALUES | {"drawbar_pull_wheel_order_n": size_n}
    said = texts_of(noise_notes(Noise(values, {"drawbar_pull_wheel_order_n": sure}), PRIORS, ("dp",), 1.0))
    assert any("once a turn of the wheel" in text for text in said) == told


@pytest.mark.slow
def test_a_zero_that_nobody_asks_for_is_told_where_the_noise_takes_it() -> None:
    campaign = simulated_campaign(effect="torque_zero:offset_nm=60")
    listed = ("torque_zero", "torque_gain", "slope", "vasilev")
    assert [cause.name for cause in diagnose([campaign], DiagnosisOptions(effects=listed)).causes] == ["torque_zero"]
    found = diagnose([campaign], DiagnosisOptions(effects=listed[1:]))
    assert found.verdict == "nothing_detectable", sentence_of(found)
    assert any(note.startswith("driving torque: zeros that differ by") for note in texts_of(found.notes))


def test_one_direction_is_not_told_as_the_direction() -> None:
    _, samples, linear = linearised(1)
    kinds = {shape.kind for shape in basis(samples, linear).catch_all.by_rank}
    assert Kind.CONSTANT_DRIVING in kinds
    assert not kinds & {Kind.DIRECTION_DRIVING, Kind.DIRECTION_BRAKING}
