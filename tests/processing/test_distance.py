"""Distance along the track against closed forms."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.pipeline.assembly import distance_of

INTERVALS_S = st.lists(st.floats(1e-3, 0.5), min_size=1, max_size=40)
NAN = np.nan


@settings(deadline=None)
@given(INTERVALS_S, st.floats(0.0, 20.0), st.floats(-2.0, 2.0))
def test_a_uniform_acceleration_is_integrated_exactly(intervals_s: list[float], start: float, rate: float) -> None:
    time = np.concatenate([[0.0], np.cumsum(intervals_s)])
    distance, bridged = distance_of(time, start + rate * time)
    np.testing.assert_allclose(distance, start * time + 0.5 * rate * time**2, rtol=1e-9, atol=1e-9)
    assert bridged == 0.0


def test_a_gap_is_bridged_by_the_mean_of_its_ends_and_reported() -> None:
    time = np.arange(7.0)
    speed = np.array([NAN, 2.0, NAN, 4.0, 4.0, NAN, NAN])
    distance, bridged = distance_of(time, speed)
    np.testing.assert_array_equal(distance, [NAN, 0.0, NAN, 6.0, 10.0, NAN, NAN])
    assert bridged == 6.0
    nowhere, nothing = distance_of(time, np.full(7, NAN))
    assert np.isnan(nowhere).all()
    assert nothing == 0.0
