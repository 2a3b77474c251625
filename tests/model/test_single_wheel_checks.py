"""What takes a name back from the rows of a single-wheel test."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from bench_samples import bench

from model import LackCode
from model.diagnosis.single_wheel import (
    BenchProblem,
    CauseUse,
    Hypothesis,
    Weighed,
    Weighing,
    library,
    predictions,
    weigh,
)
from model.diagnosis.single_wheel.checks import cancelling, chances_beside_usual_soil, usual_families
from model.diagnosis.single_wheel.search import Optimum

USES = tuple(CauseUse(key) for key in ("vasilev", "stress_peak_shift", "interface_friction"))
PULL_ZERO, CROSSTALK = CauseUse("drawbar_pull_zero"), CauseUse("crosstalk")


def test_the_usual_soil_is_expected_where_soils_are() -> None:
    problem = BenchProblem.of([bench(np.random.default_rng(0))], ("dp",))
    assert "stress_peak_shift" in usual_families(library(problem).uses)
    for usual, centres in ((True, (0.30, 0.32)), (False, (0.0, 0.0))):
        found = problem.coordinates(CauseUse("stress_peak_shift", usual=usual))
        assert tuple(c.centre for c in found) == centres


@pytest.mark.parametrize(
    ("hidden", "channels", "least", "most"),
    [
        ({"vasilev": {"H_m": 0.015}}, ("dp", "z"), 0.9, 1.0),
        ({"stress_peak_shift": {"c1": 0.3, "c2": 0.32}}, ("dp",), 0.0, 0.5),
    ],
)
def test_slip_sinkage_is_kept_where_it_was_measured_and_not_where_a_usual_peak_does_it(
    hidden: dict[str, dict[str, float]], channels: tuple[str, ...], least: float, most: float
) -> None:
    problem = BenchProblem.of([bench(np.random.default_rng(2), hidden)], channels)
    rng = np.random.default_rng(0)
    weighing = weigh(problem, USES, 1, rng)
    chances = chances_beside_usual_soil(weighing, USES, 1, rng)
    assert set(chances) == {"slip_sinkage", "interface_friction"}
    assert least <= chances["slip_sinkage"] <= most


@pytest.mark.parametrize(
    ("crosstalk", "less", "cancels"),
    [(-1.0, 1.0, True), (-1.0, 9.0, False), (1.0, 1.0, False), (-0.2, 1.0, False)],
)
def test_two_causes_that_leave_little_together_cancel_unless_the_rows_ask_for_both(
    crosstalk: float, less: float, cancels: bool
) -> None:
    """Under one load a zero of the pull and a cross-talk of the other sign leave nothing together.

    ``less``: nats that the evidence loses with one of them less.
    """
    problem = BenchProblem.of([bench(np.random.default_rng(0))], ("dp",))
    offset = 0.5 * problem.coordinates(PULL_ZERO)[0].scale
    values = {PULL_ZERO: offset, CROSSTALK: crosstalk * offset / float(problem.load_n[0])}

    def weighed(*hypothesis: CauseUse) -> Weighed:
        own: Hypothesis = hypothesis
        standard = np.zeros(problem.size(own))
        for use, place in problem.positions(own).items():
            standard[place] = problem.coordinates(use)[0].standard(values[use])
        said, _ = problem.evaluate([own], standard[None])
        optimum = Optimum(own, standard, np.eye(len(standard)), 0.0, {c: x[0] for c, x in said.items()}, {})
        return Weighed(own, 0.0, -less * (2 - len(own)), (optimum,), 0.0)

    sets = (weighed(PULL_ZERO, CROSSTALK), weighed(PULL_ZERO), weighed(CROSSTALK), weighed())
    note = cancelling(Weighing(problem, sets, 1.0))
    if not cancels:
        assert note is None
        return
    assert note is not None and note.code == LackCode.PARTS_CANCEL
    assert note.values["families"] == ("drawbar_pull_zero", "crosstalk")


def test_rows_that_fit_nowhere_have_no_likelihood_and_no_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """The samples that have a weight lose it where another, which has none, is far more likely."""
    monkeypatch.setattr(predictions, "log_likelihood", lambda *_: np.array([0.0, -2000.0]))
    posterior = SimpleNamespace(log_likelihood=np.zeros(2), weights=np.array([0.0, 1.0]), predicted={})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert predictions._log_predictive(None, posterior) == -np.inf  # type: ignore[arg-type]
