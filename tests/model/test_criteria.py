from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from daq import Note
from model.fit.criteria import criteria
from model.notes import FitCode
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


def test_a_measured_zero_makes_m0_infinite_unless_it_is_met() -> None:
    assert criteria([0.0, 2.0], [1.0, 2.0], [1, 1], 0).M0_percent == np.inf
    assert criteria([0.0, 2.0], [0.0, 2.0], [1, 1], 0).M0_percent == 0


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
