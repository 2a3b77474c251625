"""Growth of sinkage in words and millimetres, and a hidden size against its interval."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosis_samples import diagnosis

from model.diagnosis import ParameterEstimate
from model.sinkage_from_forces import Estimate, Growth
from wheelsoil.workflows.demo import Hidden, open_envelope
from wheelsoil.workflows.sinkage import growth_rows, growth_sentence

NONE = Estimate(float("nan"), (float("nan"), float("nan")))


def growth(low: float, high: float) -> Growth:
    found = Estimate((low + high) / 2, (low, high))
    return Growth(found, found, found, NONE)


def test_a_growth_is_told_in_millimetres() -> None:
    rows = growth_rows(growth(0.02, 0.06))
    assert rows[0] == ("over all shapes of the stress", "+40", "+20 .. +60")
    assert len(rows) == 3


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [(0.02, 0.06, "grows"), (-0.06, -0.02, "falls"), (-0.01, 0.06, "may grow with slip or")],
)
def test_it_grows_falls_or_is_open(low: float, high: float, said: str) -> None:
    assert said in growth_sentence(growth(low, high))


@pytest.mark.parametrize(("truth", "inside"), [(0.039, False), (0.041, True), (0.059, True), (0.061, False)])
def test_a_hidden_size_is_inside_both_ends(truth: float, inside: bool) -> None:
    """The interval of the sample diagnosis is 0.04 to 0.06 m."""
    opened = open_envelope(replace(Hidden("vasilev", {}), values={"H_m": truth}), diagnosis("named"))
    assert opened.parameters[0]["inside"] is inside


def test_of_lyaskos_coefficients_the_sum_is_compared() -> None:
    found = diagnosis("named")
    size = ParameterEstimate("p", "1", 0.15, (0.14, 0.17), 0.01)
    cause = replace(found.causes[0], key="lyasko", form="lyasko", parameters=(size,))
    opened = open_envelope(Hidden("lyasko", {"m1": 0.1, "m2": 0.05}), replace(found, causes=(cause,)))
    assert opened.parameters[0]["truth"] == pytest.approx(0.15)
    assert opened.parameters[0]["inside"] is True
