"""The evidence of sets of causes: exact, calibrated, fast enough to be taken for granted."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np
import pytest
from gram_support import WIDTHS, World, column, library, widths_of, world
from scipy.stats import multivariate_normal, norm

from model.diagnosis.core.hypotheses import SIZE_PRIOR
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import (
    Posterior,
    best_set,
    box,
    estimate,
    hypotheses,
    posterior,
    weighed,
    without_soil,
)


@pytest.fixture(scope="module")
def small() -> World:
    columns = (
        column("a"),
        column("b", one_sided=True),
        column("c", "c1"),
        column("c", "c2", "p", one_sided=True),
        column("c", "c2", "q", upper=0.15),
        column("d"),
    )
    return world(1, columns, runs=3, n=30, strength=(3, 10))


def grams_of(drawn: World, seed: int = 0, size: float = 0.0, which: int = 0) -> Grams:
    coefficients = np.zeros(len(drawn.columns))
    coefficients[which] = size
    return drawn.grams(coefficients, np.random.default_rng(seed))


def test_the_prior_is_as_published(small: World) -> None:
    listed = hypotheses(grams_of(small))
    assert listed.effects == ("a", "b", "c1", "c2", "d")
    assert listed.families == ("a", "b", "c", "d")
    sizes = (listed.members >= 0).sum(axis=1)
    mass = np.bincount(sizes, np.exp(listed.log_prior))
    np.testing.assert_allclose(mass, SIZE_PRIOR, rtol=1e-12)
    one = {listed.keys_of(i): np.exp(listed.log_prior[i]) for i in np.flatnonzero(sizes == 1)}
    assert one[("a",)] == pytest.approx(0.35 / 4)
    assert one[("c1",)] == one[("c2",)] == pytest.approx(0.35 / 8)
    assert ("c1", "c2") not in {listed.keys_of(i) for i in range(len(listed))}
    assert listed.index_of(("d", "c2")) == listed.index_of(("c2", "d"))
    with pytest.raises(KeyError):
        listed.index_of(("c1", "c2"))


def test_a_family_that_cannot_be_told_is_out(small: World) -> None:
    listed = hypotheses(grams_of(small), excluded=frozenset({"c", "d"}))
    assert listed.effects == ("a", "b")
    assert np.exp(listed.log_prior).sum() == pytest.approx(1.0)
    nothing = hypotheses(grams_of(small), excluded=frozenset("abcd"))
    assert len(nothing) == 1
    assert np.exp(nothing.log_prior[0]) == pytest.approx(1.0)
    assert posterior(grams_of(small), excluded=frozenset("abcd")).none == 1.0


def test_the_evidence_is_the_density_of_the_residual(small: World) -> None:
    """Against the marginal normal density of all samples, for a set without bounds that matter."""
    rng = np.random.default_rng(4)
    coefficients = np.zeros(6)
    coefficients[[0, 5]] = 1.3, -0.8
    grams = small.grams(coefficients, rng)
    everything = [np.concatenate([small.soil[i], small.causes[i]], axis=1) for i in range(3)]
    stacked = np.concatenate(everything)
    # the residual itself is not in the Grams: any one with the same products will do
    root = np.linalg.cholesky(grams.total[:13, :13] + 1e-9 * np.eye(13))
    made = root.T
    residual, soil, causes = made[:, 0], made[:, 1:7], made[:, 7:]
    assert stacked.shape == (90, 12)

    def density(chosen: list[int]) -> float:
        each = []
        for width, share in widths_of(chosen):
            own = np.concatenate([soil, width * causes[:, chosen]], axis=1)
            each.append(np.log(share) + multivariate_normal(np.zeros(13), np.eye(13) + own @ own.T).logpdf(residual))
        return float(np.logaddexp.reduce(each))

    found = posterior(grams)
    for keys, chosen in ((("a",), [0]), (("d",), [5]), (("a", "d"), [0, 5]), (("a", "c1", "d"), [0, 2, 5])):
        index = found.hypotheses.index_of(keys)
        assert found.log_evidence[index] == pytest.approx(density(chosen) - density([]), abs=1e-5)


def test_a_one_sided_cause_has_twice_the_mass_above_zero(small: World) -> None:
    grams = grams_of(small, 2, 0.4, 1)
    found = posterior(grams)
    two_sided = hypotheses(grams)
    reduced = without_soil(grams, grams.total)
    b, each = reduced[0, 2], []
    for width, share in WIDTHS:
        a = width**-2 + reduced[2, 2]
        fit = 0.5 * b * b / a - 0.5 * np.log(a) - np.log(width) + np.log(2) + norm.logcdf(b / np.sqrt(a))
        each.append(fit + np.log(share))
    expected = np.logaddexp(*each)
    assert found.log_evidence[two_sided.index_of(("b",))] == pytest.approx(expected)


def test_sets_with_bounds_are_near_their_integral(small: World) -> None:
    """Importance sampling of the truncated prior, two bounded parameters at once."""
    grams = grams_of(small, 5, 0.7, 3)
    reduced = without_soil(grams, grams.total)
    found = posterior(grams)
    at = [4, 5]
    precision, side = reduced[np.ix_(at, at)], reduced[at, 0]
    lower, upper = (x[[3, 4]] for x in box(grams.causes))
    rng = np.random.default_rng(0)
    mean = 0.0
    for width, share in WIDTHS:
        draws = width * rng.normal(size=(2_000_000, 2))
        draws = draws[((draws > lower) & (draws < upper)).all(axis=1)]
        values = draws @ side - 0.5 * np.einsum("ni,ij,nj->n", draws, precision, draws)
        mean += share * np.mean(np.exp(values))
    exact = np.log(mean)
    assert found.log_evidence[found.hypotheses.index_of(("c2",))] == pytest.approx(exact, abs=0.05)


def test_a_cause_far_larger_than_usual_is_not_lost_to_two_that_fit_worse() -> None:
    """A radius 15 % wrong looked like lugs and a gain of the torque, each of a usual size, and 20 nats worse."""
    drawn = world(1, tuple(column(name) for name in "abc"), runs=3, n=30, strength=(3, 10))
    for own in drawn.causes:
        own[:, 0] = 0.25 * (own[:, 1] + own[:, 2])
        own[0, 0] += 0.5
    found = posterior(grams_of(drawn, size=7.5))
    assert found.best() == ("a",)
    assert found.families()["a"] > 0.99


def test_a_size_far_larger_than_usual_is_not_drawn_towards_it() -> None:
    drawn = world(1, (column("a"),), runs=3, n=30, strength=(4, 4))
    found = [estimate(grams_of(drawn, seed, 7.5), ("a",)) for seed in range(20)]
    sigma = found[0].sigmas[0]
    assert 0.2 < sigma < 1.0
    off = np.mean([one.coefficients[0] for one in found]) - 7.5
    assert abs(off) < 3 * sigma / np.sqrt(20), (off, sigma)


def test_the_beam_loses_next_to_nothing() -> None:
    drawn = world(2, library(20), n=80)
    coefficients = np.zeros(len(drawn.columns))
    coefficients[[1, 7, 13]] = 1.5, -1.5, 1.5
    grams = drawn.grams(coefficients, np.random.default_rng(0))
    whole, beam = posterior(grams), posterior(grams, beam=40)
    assert len(beam.hypotheses) < 0.7 * len(whole.hypotheses)
    assert beam.best() == whole.best()
    narrow = beam.families()
    assert max(abs(p - narrow[name]) for name, p in whole.families().items()) < 0.02


def test_every_set_is_listed_once() -> None:
    drawn = world(2, library(6), n=40)
    grams = grams_of(drawn)
    listed = posterior(grams).hypotheses
    sets = {listed.keys_of(i) for i in range(len(listed))}
    assert len(sets) == len(listed)
    family = dict(zip(listed.effects, listed.family, strict=True))
    expected = sum(
        len({family[key] for key in keys}) == size for size in range(4) for keys in combinations(listed.effects, size)
    )
    assert len(listed) == expected
    through, _ = weighed(grams, without_soil(grams, grams.total), beam=comb(8, 2))
    assert {through.keys_of(i) for i in range(len(through))} == sets


def test_estimates_stay_within_bounds_and_find_the_truth(small: World) -> None:
    found = estimate(grams_of(small, 7, -1.0, 1), ("b", "c2"))
    lower, upper = box(small.columns)
    assert np.all((found.coefficients >= lower) & (found.coefficients <= upper))
    assert found.coefficients[1] == 0.0
    assert found.columns == (1, 3, 4)
    assert np.all(found.coefficients[[0, 2, 5]] == 0.0)
    for seed in range(5):
        best = best_set(grams_of(small, seed, 4.0, 1))
        assert "b" in best.keys
        assert abs(best.coefficients[1] - 4.0) < 4 * best.sigmas[best.columns.index(1)]


def test_a_coefficient_of_a_one_sided_cause_is_never_negative() -> None:
    columns = (column("below", one_sided=True, scale=-0.4, lower=-2.0, upper=2.0), column("both", lower=-0.2))
    lower, upper = box(columns)
    np.testing.assert_allclose(lower, [0.0, -2.0])
    np.testing.assert_allclose(upper, [5.0, 100.0])


def calibration(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities of families, and whether they acted, in a world drawn from the prior."""
    rng = np.random.default_rng(seed)
    worlds = [world(s, library(14), n=60) for s in range(4)]
    said, true = [], []
    for i in range(count):
        drawn = worlds[i % 4]
        families = list(dict.fromkeys(c.family for c in drawn.columns))
        hidden = set(rng.choice(families, size=rng.choice(4, p=SIZE_PRIOR), replace=False))
        forms = {f: rng.choice(sorted({c.key for c in drawn.columns if c.family == f})) for f in sorted(hidden)}
        size = rng.normal(size=len(drawn.columns))
        at_work = np.array([c.key == forms.get(c.family) for c in drawn.columns])
        one_sided = np.array([c.one_sided for c in drawn.columns])
        coefficients = np.where(at_work, np.where(one_sided, np.abs(size), size), 0.0)
        found: Posterior = posterior(drawn.grams(coefficients, rng))
        for family, probability in {**found.families(), "none": found.none}.items():
            said.append(probability)
            true.append(family in hidden or (family == "none" and not hidden))
    return np.array(said), np.array(true)


def test_probabilities_are_frequencies_in_the_exact_world() -> None:
    said, true = calibration(11, 400)
    bins = np.digitize(said, [0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
    for i in np.unique(bins):
        own = bins == i
        expected = said[own].sum()
        spread = np.sqrt((said[own] * (1 - said[own])).sum())
        assert abs(true[own].sum() - expected) < 3.3 * spread + 1.0, (i, own.sum(), true[own].mean(), said[own].mean())
    assert true[said > 0.99].size > 20
