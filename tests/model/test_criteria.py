from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from daq import Note
from model import FitCode
from model.fit.criteria import BIN_WIDTH, criteria
from wheelsoil.wording.notes import note_text

numbers = st.floats(-1e4, 1e4, width=32)


@st.composite
def pairs(draw: st.DrawFn) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    n = draw(st.integers(2, 30))
    slips = arrays(float, n, elements=st.floats(-1, 1))
    return draw(arrays(float, n, elements=numbers)), draw(arrays(float, n, elements=numbers)), draw(slips)


def test_the_definitions_by_hand() -> None:
    found = criteria([100, 200, -50, 7], [110, 180, -40, 0], [0.2, 0.5, 0.9, 0.1], 0.2, vertical_load_n=[1e3] * 4)
    assert found.M0_percent == pytest.approx(20.0)
    r0 = found.R0_N
    assert r0 == pytest.approx(np.sqrt((100 + 400 + 100) / 3))
    r2 = found.R2
    assert r2 == pytest.approx(np.corrcoef([100, 200, -50], [110, 180, -40])[0, 1] ** 2)
    assert (found.samples, found.threshold, found.reason) == (3, 0.2, None)
    assert found.R0_per_load == pytest.approx(found.R0_N / 1e3)


@given(pairs(), st.floats(0.1, 10), st.floats(-1e4, 1e4), st.sampled_from([-1, 1]))
def test_r2_is_blind_to_offset_gain_and_sign_and_r0_is_not(
    data: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], gain: float, offset: float, sign: int
) -> None:
    actual, _, _ = data
    if np.ptp(actual) < 1:
        return
    predicted = sign * gain * actual + offset
    found = criteria(actual, predicted, np.ones_like(actual), 0.2)
    r2 = found.R2
    assert r2 == pytest.approx(1.0, abs=1e-9)
    r0 = found.R0_N
    assert r0 == pytest.approx(float(np.sqrt(np.mean((predicted - actual) ** 2))))


@given(pairs(), st.floats(-1, 1))
def test_samples_below_the_threshold_and_nan_do_not_count(
    data: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], threshold: float
) -> None:
    actual, predicted, slip = data
    holes = [np.append(values, hole) for values, hole in zip(data, [np.nan, 1.0, 1.0], strict=True)]
    counted = slip >= threshold
    found = criteria(*holes, threshold)
    assert found.samples == counted.sum()
    if found.samples:
        error = (predicted - actual)[counted]
        r0 = found.R0_N
        assert r0 == pytest.approx(float(np.sqrt(np.mean(error**2))))
        assert np.isnan(found.R2) or 0 <= found.R2 <= 1
        assert np.isnan(found.R2) == bool(found.reason)
    else:
        assert np.isnan([found.M0_percent, found.R0_N, found.R2]).all()
        assert found.reason


def test_nothing_above_the_threshold_is_a_result_with_its_reason() -> None:
    found = criteria([1.0], [1.0], [0.15], 0.2)
    assert found.samples == 0
    assert found.reason and note_text(found.reason) == "no slip at or above the threshold 0.2: the largest is 0.15"
    assert criteria([np.nan], [1.0], [0.5], 0.2).reason == Note(FitCode.NO_SAMPLE)
    assert criteria([], [], [], 0.2).samples == 0


def test_m0_of_samples_is_infinite_at_a_measured_zero_unless_it_is_predicted() -> None:
    assert criteria([0.0, 2.0], [1.0, 2.0], [1, 1], 0).M0_sample_percent == np.inf
    assert criteria([0.0, 2.0], [0.0, 2.0], [1, 1], 0).M0_sample_percent == 0
    assert criteria([0.0, 0.0], [0.0, 0.0], [1, 1], 0).M0_percent == 0
    assert criteria([0.0, 0.0], [1.0, 0.0], [1, 1], 0).M0_percent == np.inf


curves = st.lists(st.tuples(st.floats(50, 400), st.floats(-400, 400), st.floats(1, 300)), min_size=1, max_size=16)
"""Of bins: measured mean, error of the prediction, half the width of the noise."""


def samples_of(curve: list[tuple[float, float, float]], count: int = 40) -> NDArray[np.float64]:
    """Return measured, predicted and slip of `count` samples in each bin; noise and its sign cancel in the mean."""
    rng = np.random.default_rng(len(curve))
    sign = np.tile([1.0, -1.0], count // 2)
    bins = [
        (mean + noise * sign, np.full(count, mean + error), BIN_WIDTH * (4 + i + rng.uniform(0.01, 0.99, count)))
        for i, (mean, error, noise) in enumerate(curve)
    ]
    return np.concatenate(bins, axis=1)


@given(curves, st.randoms(use_true_random=False), st.floats(0.01, 100), st.sampled_from([-1, 1]))
def test_m0_is_that_of_the_curve_in_bins_whatever_noise_order_scale_or_sign(
    curve: list[tuple[float, float, float]], random: Random, scale: float, sign: int
) -> None:
    actual, predicted, slip = samples_of(curve)
    expected = 100 * max(abs(error) / mean for mean, error, _ in curve)  # means of 50 to 400: all of them count
    order = random.sample(range(len(slip)), len(slip))
    found = criteria(sign * scale * actual[order], sign * scale * predicted[order], slip[order], 0.2)
    assert found.M0_percent == pytest.approx(expected, rel=1e-6, abs=1e-6)
    twice = criteria(*np.tile([actual, predicted, slip], 2), 0.2)
    assert twice.M0_percent == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(pairs())
def test_m0_of_bins_is_at_most_that_of_samples_of_one_sign(
    data: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
) -> None:
    actual, predicted, slip = data
    found = criteria(np.abs(actual) + 1, predicted, slip, -1.0)
    assert found.M0_percent <= found.M0_sample_percent * (1 + 1e-9)


@pytest.mark.parametrize(("mean", "counts"), [(9.0, False), (-9.0, False), (11.0, True), (-11.0, True)])
def test_a_bin_where_the_measured_mean_is_near_zero_does_not_count(mean: float, counts: bool) -> None:
    curve = [(100.0, 10.0, 30.0), (mean, 20.0, 30.0), (-60.0, 3.0, 30.0)]
    found = criteria(*samples_of(curve), 0.2)
    assert found.M0_percent == pytest.approx(100 * 20 / abs(mean) if counts else 10.0)
    assert found.samples == 120 and found.M0_sample_percent > 50


@pytest.mark.parametrize(("few", "counts"), [(3, False), (5, True)])
def test_a_bin_with_less_than_a_hundredth_of_the_samples_does_not_count(few: int, counts: bool) -> None:
    many = samples_of([(100.0, 10.0, 5.0)], 400)
    rest = np.array([[1000.0, 2000.0, 0.9]] * few).T
    found = criteria(*np.concatenate([many, rest], axis=1), 0.2)
    assert found.M0_percent == pytest.approx(100.0 if counts else 10.0)  # nor does it set what is near zero


def test_bins_begin_at_multiples_of_their_width_and_empty_ones_do_not_matter() -> None:
    slip = [0.15, 0.199, 0.2, 0.249, 0.9]
    actual, predicted = np.array([100, 300, 200, 100, 50.0]), np.array([140, 300, 200, 130, 55.0])
    found = criteria(actual, predicted, slip, 0.1)
    assert found.M0_percent == pytest.approx(10.0)  # means 200, 150 and 50; errors 20, 15 and 5
    assert criteria(actual, predicted, slip, 0.15).M0_percent == pytest.approx(10.0)
    assert criteria(actual, predicted, slip, 0.16).M0_percent == pytest.approx(10.0)
    assert criteria(actual, predicted, slip, 0.2).M0_percent == pytest.approx(10.0)
    assert criteria(actual, predicted, slip, 0.21).M0_percent == pytest.approx(30.0)


def test_each_row_of_a_single_wheel_test_is_a_bin() -> None:
    table = ([100.0, 200.0, 5.0], [130.0, 180.0, 50.0], [0.51, 0.52, 0.53], 0.2)
    assert criteria(*table, rows=True).M0_percent == pytest.approx(30.0)
    assert criteria(*table).M0_percent == pytest.approx(100 * 55 / 305)
    many = (np.full(300, 10.0), np.r_[np.full(299, 10.0), 12.0], np.full(300, 0.5), 0.2)
    assert criteria(*many, rows=True).M0_percent == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("actual", "predicted", "code"),
    [
        ([3.0, 3.0], [1.0, 2.0], FitCode.MEASURED_CONSTANT),
        ([1.0, 2.0], [3.1, 3.1], FitCode.PREDICTED_CONSTANT),
        ([1.0], [1.0], FitCode.ONE_SAMPLE),
    ],
)
def test_r2_that_cannot_be_has_a_reason(actual: list[float], predicted: list[float], code: str) -> None:
    found = criteria(actual, predicted, [1.0] * len(actual), 0.2)
    assert np.isnan(found.R2)
    assert found.reason == Note(code)
    assert np.isfinite(found.R0_N)


def test_lengths_must_agree() -> None:
    with pytest.raises(ValueError, match="same length"):
        criteria([1.0], [1.0, 2.0], [1.0], 0.2)
