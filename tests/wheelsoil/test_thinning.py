from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wheelsoil.report.figures import (
    EDGES,
    Binning,
    _cell,
    binned,
    decimated_rows,
    parted_at_zero,
    repeated,
    thinned_rows,
)

series = arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e6, 1e6) | st.just(np.nan))


@given(series, st.integers(4, 100))
def test_decimation_keeps_order_limit_ends_and_peaks(values, limit):
    rows = decimated_rows(values, limit)
    assert len(rows) <= max(limit, 2) and rows[0] == 0 and rows[-1] == len(values) - 1
    assert (np.diff(rows) > 0).all()
    if np.isfinite(values).any():
        assert np.nanmax(values[rows]) == np.nanmax(values)
        assert np.nanmin(values[rows]) == np.nanmin(values)


def test_decimation_keeps_a_gap():
    values = np.sin(np.arange(1000.0))
    values[400:600] = np.nan
    assert np.isnan(values[decimated_rows(values, 50)]).any()


@given(series, st.integers(1, 5))
def test_thinning_keeps_every_cell_and_no_more_than_asked(values, per_cell):
    x = np.arange(len(values), dtype=float)
    rows = thinned_rows(x, values, cells=8, per_cell=per_cell)
    finite = np.flatnonzero(np.isfinite(values))
    assert np.isin(rows, finite).all()
    assert len(np.unique(rows)) == len(rows) <= 64 * per_cell
    assert bool(len(rows)) == bool(len(finite))
    if len(finite):  # no column of the cloud is emptied
        assert set(_cell(x[finite], 8)[np.isin(finite, rows)]) == set(_cell(x[finite], 8))


def test_bins_hold_medians_and_leave_out_the_empty():
    x = np.repeat([0.05, 0.15, 0.35], [9, 2, 9])
    y = np.concatenate([np.arange(9.0), [50.0, 60.0], np.full(9, np.nan)])
    result = binned(x, y, np.array([0.0, 0.1, 0.2, 0.3, 0.4]))
    np.testing.assert_allclose(result.centre, [0.05])
    np.testing.assert_allclose([result.lower[0], result.median[0], result.upper[0]], [2, 4, 6])
    assert result.count.tolist() == [9]


def test_repeats_are_rows_at_nearly_one_slip():
    slip = np.array([0.502, 0.0, 0.499, 0.003, 0.168, 0.501, np.nan])
    result = repeated(slip, np.array([5.0, 1.0, 3.0, 2.0, 7.0, 4.0, 9.0]))
    np.testing.assert_allclose(result.centre, [0.0015, 0.168, 0.5006666666666667])
    np.testing.assert_allclose(result.median, [1.5, 7.0, 4.0])
    assert result.count.tolist() == [2, 1, 3]
    assert len(repeated(slip[:0], slip[:0]).centre) == 0


@given(
    arrays(
        np.float64, st.integers(0, 80), elements=st.floats(-1.2, 1.2) | st.sampled_from([np.nan, np.inf, -1.0, 1.0])
    ),
    st.integers(0, 2**32 - 1),
)
def test_bins_are_those_of_percentile(x, seed):
    rng = np.random.default_rng(seed)
    y = np.where(rng.random(len(x)) < 0.1, rng.choice([np.nan, np.inf, -np.inf]), rng.normal(0.0, 1e3, len(x)))
    found = Binning(x, EDGES).of(y, least=2)
    which, known = np.digitize(x, EDGES) - 1, np.isfinite(x) & np.isfinite(y)
    inside = {i: y[known & (which == i)] for i in range(len(EDGES) - 1)}
    inside = {i: values for i, values in inside.items() if len(values) >= 2}
    assert found.count.tolist() == [len(values) for values in inside.values()]
    assert found.centre.tolist() == [(EDGES[i] + EDGES[i + 1]) / 2 for i in inside]
    for values, share in ((found.lower, 25), (found.median, 50), (found.upper, 75)):
        assert values.tolist() == [np.percentile(one, share) for one in inside.values()], "to the last bit"


def test_braking_is_parted_from_driving():
    curve = binned(np.linspace(-1, 1, 400), np.ones(400), np.linspace(-1, 1, 11))
    parted = parted_at_zero(curve)
    assert parted.centre.tolist() == [*curve.centre[:5], 0.0, *curve.centre[5:]]
    assert np.isnan(parted.median[5]) and np.isfinite(np.delete(parted.median, 5)).all()
    driven = binned(np.linspace(0, 1, 400), np.ones(400), np.linspace(-1, 1, 11))
    assert parted_at_zero(driven) is driven
