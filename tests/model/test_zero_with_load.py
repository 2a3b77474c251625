"""The catch-all sees a zero that grows with the load where it shows best: at standstill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import linearised, simulated_campaign
from short_campaign import noise_of

from model.diagnosis import DiagnosisOptions, Kind, Shape, diagnose
from model.diagnosis.time_series.basis import Basis, basis
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.samples import Samples

LISTED = (
    "crosstalk",
    "drawbar_pull_zero",
    "drawbar_pull_gain",
    "torque_gain",
    "load_zero",
    "zero_drift",
    "slope",
    "ding",
)


@pytest.fixture(scope="module")
def seen() -> tuple[Samples, Linear]:
    _, samples, linear = linearised(3)
    return samples, linear


@pytest.mark.parametrize(("row", "channel"), [(0, "dp"), (1, "t")])
def test_one_zero_is_the_same_function_of_the_load_rolling_and_at_rest(
    row: int, channel: str, seen: tuple[Samples, Linear]
) -> None:
    samples, linear = seen
    found = basis(samples, linear)
    at = found.catch_all.shapes.index(Shape(Kind.ZERO_WITH_LOAD, channel))
    load = np.asarray(samples.conditions.vertical_load_n)
    rolling = np.polyfit(load, found.columns[row, :, at], 1)
    resting = np.polyfit(np.asarray(samples.rests.conditions.vertical_load_n), found.rests[row, :, at], 1)
    np.testing.assert_allclose(resting, rolling, rtol=1e-6)
    assert np.polyval(rolling, load.mean()) == pytest.approx(0.0, abs=1e-6 * np.abs(found.columns[row, :, at]).max())
    assert not found.columns[1 - row, :, at].any()
    assert not found.rests[1 - row, :, at].any()


def test_without_a_standstill_there_is_no_such_shape(seen: tuple[Samples, Linear]) -> None:
    samples, linear = seen
    none = samples.rests.run < 0
    rests = replace(samples.rests, run=samples.rests.run[none])
    measured = {channel: values[none] for channel, values in samples.rests.measured.items()}
    never = replace(samples, rests=replace(rests, measured=measured, lifted_sigma={}, applied={}))
    assert Shape(Kind.ZERO_WITH_LOAD, "dp") in basis(samples, linear).catch_all.by_rank
    assert not zeros(basis(never, linear))
    unread = {**samples.rests.measured, "t": np.full(len(samples.rests), np.nan)}
    only_dp = replace(samples, rests=replace(samples.rests, measured=unread))
    assert zeros(basis(only_dp, linear)) == [Shape(Kind.ZERO_WITH_LOAD, "dp")]


def zeros(found: Basis) -> list[Shape]:
    return [shape for shape in found.catch_all.shapes if shape.kind == Kind.ZERO_WITH_LOAD]


def test_only_zeros_show_at_rest(seen: tuple[Samples, Linear]) -> None:
    found = basis(*seen)
    assert (
        len(found.catch_all.shapes)
        == len(found.catch_all.input_heights)
        == found.columns.shape[-1]
        == found.rests.shape[-1]
    )
    showing = {shape.kind for i, shape in enumerate(found.catch_all.shapes) if found.rests[..., i].any()}
    assert showing == {Kind.ZERO_WITH_LOAD}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "family"),
    [
        ("crosstalk:coefficient=0.03", "crosstalk"),
        ("drawbar_pull_zero:offset_n=-300", "drawbar_pull_zero"),
    ],
)
def test_cross_talk_and_a_zero_are_not_taken_for_each_other(hidden: str, family: str) -> None:
    campaign = simulated_campaign(effect=hidden)
    found = diagnose([campaign], DiagnosisOptions(effects=LISTED), [noise_of(campaign)])
    assert [cause.name for cause in found.causes] == [family]
