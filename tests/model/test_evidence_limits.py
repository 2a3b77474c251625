"""What is believed without data, and the smallest size that data would show, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from gram_support import column, world

from model.diagnosis.findings.isolability import detectable_in_runs
from model.diagnosis.time_series.evidence import hypotheses, probabilities, without_soil

COLUMNS = (column("a"), column("b", one_sided=True), column("c"))


def test_without_data_the_prior_stands() -> None:
    grams = world(3, COLUMNS, n=30).grams(np.zeros(3), np.random.default_rng(0))
    listed = hypotheses(grams)
    np.testing.assert_allclose(probabilities(np.zeros(len(listed)), listed.log_prior), np.exp(listed.log_prior))


@pytest.mark.parametrize("name_at", [0.8, 0.9])
def test_at_the_smallest_detectable_size_the_expected_odds_are_those_of_a_name(name_at: float) -> None:
    """ln of the odds: half of (a^2 l^2 + l)/(1 + l) - ln(1 + l), ln 2 where one-sided, and the prior's."""
    grams = world(3, COLUMNS, n=60, strength=(20, 40)).grams(np.zeros(3), np.random.default_rng(3))
    sizes = detectable_in_runs(grams, name_at=name_at)
    information = np.diag(without_soil(grams, grams.total))[1:]
    listed = hypotheses(grams, most=1)
    for i, cause in enumerate(COLUMNS):
        a, own = sizes[cause.key].value / cause.scale, information[i]
        factor = 0.5 * (a**2 * own**2 + own) / (1 + own) - 0.5 * np.log1p(own) + np.log(2) * cause.one_sided
        odds = factor + listed.log_prior[listed.index_of((cause.key,))] - listed.log_prior[0]
        assert odds == pytest.approx(np.log(name_at / (1 - name_at)), abs=1e-9), cause.key
