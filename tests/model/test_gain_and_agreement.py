"""Numbers of the gain on held-out runs and of Cochran's Q against textbooks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import column, world
from scipy.stats import chi2, norm

from model.diagnosis import Cause, ParameterEstimate
from model.diagnosis.core.gain import HeldOutPrediction, _reduction, gain_of
from model.diagnosis.findings.agreement import disagreements


def test_the_gain_is_of_the_error_and_not_of_its_square() -> None:
    assert _reduction(np.array([[400.0, 100.0], [0.0, 0.0]])).percent == pytest.approx(50.0)
    assert _reduction(np.array([[100.0, 400.0]])).percent == pytest.approx(-100.0)
    assert np.isnan(_reduction(np.array([[0.0, 1.0]])).percent)


def test_its_interval_is_that_of_many_runs() -> None:
    """With many runs the gain is normal: 1.96 of its standard deviations to either side."""
    rng = np.random.default_rng(1)
    squares = np.column_stack([np.full(400, 100.0), rng.uniform(10.0, 90.0, 400)])
    low, high = _reduction(squares).interval95
    share = squares[:, 1].mean() / 100.0
    sigma = 100.0 * np.std(squares[:, 1] / 100.0) / np.sqrt(400) / (2 * np.sqrt(share))
    assert high - low == pytest.approx(2 * norm.ppf(0.975) * sigma, rel=0.03)
    assert np.isnan(_reduction(squares[:2]).interval95).all()


@pytest.mark.parametrize("folds", [3, 4, 5, 12])
def test_its_interval_holds_with_few_runs(folds: int) -> None:
    """Runs that differ by a quarter; the truth is the ratio of expected squares."""
    rng = np.random.default_rng(folds)
    before, after = (x * rng.lognormal(0.0, 0.25, (1000, folds)) for x in (400.0, 100.0))
    held = 0
    for squares in np.stack([before, after], axis=-1):
        low, high = _reduction(squares).interval95
        held += low < 50.0 < high
    assert held > 930


@pytest.mark.parametrize(("of_runs", "expected"), [(True, 10.0), (False, 40.0)])
def test_m0_is_of_the_curve_against_slip_over_all_runs_and_of_each_row_of_a_table(
    of_runs: bool, expected: float
) -> None:
    slip = np.array([0.3, 0.3, 0.5, 0.1])
    pulls = {"dp": np.array([100.0, 100.0, 200.0, 100.0])}
    folds = [
        HeldOutPrediction(-1.0, pulls, {"dp": pulls["dp"] + error}, slip >= 0.2, 3, slip if of_runs else None)
        for error in (np.array([40.0, -20.0, 0.0, 500.0]), np.array([20.0, 0.0, 20.0, -500.0]))
    ]
    gain = gain_of(folds, folds, [(), ()], "dp")
    assert gain.base["dp"].M0_percent == pytest.approx(expected)


def test_both_models_are_judged_on_the_samples_that_both_answer() -> None:
    """The base errs by 3 N where the extension has no answer, and by 1 N elsewhere; that by 2 N, but for 9 N there."""
    pulls, slip = {"dp": np.full(4, 100.0)}, np.array([0.3, 0.4, 0.5, 0.1])
    error = {"base": [1.0, 3.0, 1.0, 8.0], "extended": [2.0, np.nan, 2.0, 8.0]}
    base, extended = (
        HeldOutPrediction(-1.0, pulls, {"dp": 100.0 + np.array(x)}, slip >= 0.2, 3, slip, {"dp": np.arange(4.0)})
        for x in error.values()
    )
    gain = gain_of([base, base], [extended, base], [("a",), ()], "dp")
    assert pytest.approx(np.sqrt((4 + 4 + 1 + 9 + 1) / 5)) == gain.extended["dp"].R0
    assert pytest.approx(np.sqrt((1 + 1 + 1 + 9 + 1) / 5)) == gain.base["dp"].R0
    assert gain.reduction_percent == pytest.approx(100 * (1 - np.sqrt(19 / 13)))
    assert gain.expected == pytest.approx({"dp": np.sqrt((0 + 2 + 0 + 1 + 2) / 5)})
    nowhere = replace(base, predicted={"dp": np.full(4, np.nan)})
    assert np.isnan(gain_of([nowhere], [base], [("a",)], "dp").expected["dp"])


@pytest.mark.parametrize("campaigns", [2, 3])
def test_cochrans_q_has_one_degree_of_freedom_less_than_campaigns(campaigns: int) -> None:
    drawn = world(4, (column("a"), column("b")), runs=3 * campaigns, strength=(30, 40))
    rng = np.random.default_rng(5)
    parts = [drawn.grams(np.array([0.2 + 0.8 * i, 0.0]), rng) for i in range(campaigns)]
    own = [part.matrices[3 * i : 3 * i + 3] for i, part in enumerate(parts)]
    size = ParameterEstimate("a", "m", 0.1, (0.0, 0.2), 0.0)
    cause = Cause("a", "", "physical", "a", 0.99, 1.0, (size,))
    runs = {f"campaign {i}": 3 for i in range(campaigns)}
    (found,) = disagreements(replace(parts[0], matrices=np.concatenate(own)), runs, [cause])
    values, weights = np.array([[one.value, one.sigma**-2] for one in found.own]).T
    q = np.sum(weights * (values - np.average(values, weights=weights)) ** 2)
    assert found.q == pytest.approx(q)
    assert found.chance == pytest.approx(chi2.sf(q, campaigns - 1))


@pytest.mark.parametrize("readings", [1, 2, 3, 5])
def test_a_channel_that_few_runs_measure_is_certain_of_nothing(readings: int) -> None:
    """One run with a sinkage sensor among five: its error grows twofold, and no interval can be known."""
    slip, nothing = np.full(4, 0.5), np.full(4, np.nan)

    def fold(error: float, measured: bool) -> HeldOutPrediction:
        values = {"dp": slip, "z": slip if measured else nothing}
        return HeldOutPrediction(-1.0, values, {c: v + error for c, v in values.items()}, slip > 0.2, 8, slip)

    base, worse = ([fold(e, i < readings) for i in range(5)] for e in (0.1, 0.2))
    change = gain_of(base, worse, [("a",)] * 5, "dp").reductions["z"]
    assert change.percent == pytest.approx(-100.0)
    assert change.grows == (readings >= 3) and not change.falls
    assert gain_of(worse, base, [("a",)] * 5, "dp").reductions["z"].falls == (readings >= 3)
