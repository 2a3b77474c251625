"""The verdict just below and just above each of its limits."""

from __future__ import annotations

import numpy as np
import pytest
from gram_support import column, world

from model.diagnosis import Adequacy, Gain
from model.diagnosis.core.hypotheses import Posterior
from model.diagnosis.core.naming import judgement
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import hypotheses

FINE = Adequacy(0.9, 1.8, ok=True)


@pytest.fixture(scope="module")
def grams() -> Grams:
    return world(0, (column("a"), column("b")), runs=3, n=20).grams(np.zeros(2), np.random.default_rng(0))


def found(grams: Grams, none: float, first: float) -> Posterior:
    listed = hypotheses(grams)
    probability = np.zeros(len(listed))
    for keys, p in (((), none), (("a",), first), (("b",), 1 - none - first)):
        probability[listed.index_of(keys)] = p
    return Posterior(listed, np.zeros(len(listed)), probability, calibrated=True)


def gain(nats: float) -> Gain:
    return Gain({}, {}, 10.0, (5.0, 15.0), nats, (("a",),), "dp")


@pytest.mark.parametrize(("probability", "verdict"), [(0.89, "one_of"), (0.91, "named")])
def test_a_name_asks_for_nine_tenths(grams: Grams, probability: float, verdict: str) -> None:
    assert judgement(found(grams, 0.04, probability), FINE, gain(3.0)).verdict == verdict


@pytest.mark.parametrize(
    ("nats", "none", "verdict"),
    [
        (3.0, 0.19, "one_of"),
        (3.0, 0.21, "nothing_detectable"),
        (-1.0, 0.04, "one_of"),
        (-1.0, 0.06, "nothing_detectable"),
    ],
)
def test_none_may_be_a_fifth_or_a_twentieth_without_a_gain(
    grams: Grams, nats: float, none: float, verdict: str
) -> None:
    assert judgement(found(grams, none, 0.6), FINE, gain(nats)).verdict == verdict
