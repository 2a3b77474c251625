"""docs/paper.md: its numbers are those that the tables, the equations and the sample recordings give."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.paper import published
from studies.paper.published import STATIC_LOAD_N, Published
from studies.paper.study import PAGE, differences, page

PAPERS = published.read()
curves = st.lists(st.floats(-1e3, 1e3), min_size=12, max_size=12).map(np.array)


@pytest.mark.slow
def test_the_page_holds() -> None:
    assert differences(PAGE.read_text(encoding="utf-8"), page()) == []


def test_only_words_and_numbers_that_moved_are_differences() -> None:
    assert differences("R0 1,437 N m\n0.98 of 0", "R0 1,438 N m\n0.99 of 0") == []
    assert len(differences("R0 1,437 N m\n0.98", "R0 1,441 N m\n0.96")) == 2
    assert len(differences("R0 17 N", "R1 17 N")) == 1
    assert len(differences("one line", "one line\nand another")) == 1


@given(curves, st.floats(-3, 3), st.floats(-500, 500), st.lists(curves, min_size=1, max_size=3))
def test_what_tables_bound_is_true_of_any_curve(
    measured: np.ndarray, gain: float, offset: float, noise: list[np.ndarray]
) -> None:
    """Distances and correlations of predictions, and what an offset and a gain explain, for any measured curve."""
    predictions = [gain * measured + offset + 0.3 * values for values in noise] + [measured + 0.1 * noise[0]]
    if min(np.std(values) for values in (measured, *predictions)) < 1 or np.ptp(predictions[-1] - measured) < 1:
        return
    names = ("wong", "vasilev", "ding")[: len(noise)]
    table = {}
    for name, values in zip((*names, "lyasko"), predictions, strict=True):
        r2 = float(np.corrcoef(measured, values)[0, 1] ** 2)
        table[name] = (0.0, published.rms(values - measured), min(r2, 1 - 1e-12))
    paper = Published("clay", 0.2, 0.0, {}, table, {})
    assert published.largest_spread_n(paper) >= np.std(measured) * (1 - 1e-6)
    plain = published.rms(predictions[0] - measured)
    if plain > 1:
        left = published.rms(np.polyval(np.polyfit(predictions[0], measured, 1), predictions[0]) - measured)
        assert 100 * (1 - (left / plain) ** 2) >= published.affine_share(paper) - 1e-3
    angle = {name: np.arccos(np.sqrt(r2)) for name, (_, _, r2) in table.items()}
    for prediction, (name, (near, far, low, high)) in zip(predictions, published.bounds(paper).items(), strict=True):
        assert near - 1e-6 <= published.rms(prediction - predictions[-1]) <= far + 1e-6
        if angle[name] + angle["lyasko"] < np.pi / 2:
            assert low - 1e-5 <= np.corrcoef(prediction, predictions[-1])[0, 1] ** 2 <= high + 1e-5


def test_an_offset_and_a_gain_explain_most_of_what_the_paper_credits_to_slip_sinkage() -> None:
    assert published.affine_share(PAPERS["clay"]) == pytest.approx(81.6, abs=0.05)
    assert published.affine_share(PAPERS["sandy"]) == pytest.approx(64.2, abs=0.05)


def test_rows_of_tab_3_agree_on_clay_at_a_quarter_of_the_added_load_and_not_on_sand() -> None:
    clay, sandy = PAPERS["clay"], PAPERS["sandy"]
    assert published.equivalents(clay, STATIC_LOAD_N + 750.0)["H_m"] == pytest.approx(
        clay.coefficients["H_m"], rel=0.01
    )
    for load in (8000.0, 9250.0, 13_000.0):
        assert published.equivalents(sandy, load)["H_m"] > 1.3 * sandy.coefficients["H_m"]


def test_eq_2_as_printed_carries_nothing() -> None:
    found = published.equations(PAPERS["clay"])
    assert found["printed_kpa"] < 0.02 and found["right_kpa"] > 100
