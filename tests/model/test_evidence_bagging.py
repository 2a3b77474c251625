"""Probabilities averaged over resampled runs: no surer than the data where the noise model is a little wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import World, column, library, world

from model.diagnosis.findings.adequacy import excess
from model.diagnosis.findings.held_out import bagged
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import Posterior, posterior

RUNS = 6


@pytest.fixture(scope="module")
def worlds() -> list[World]:
    return [world(seed, library(12), runs=RUNS, n=60, strength=(3, 60)) for seed in range(3)]


def weighed(grams: Grams, seed: int = 0) -> Posterior:
    """As the diagnosis does it: a little too much is left over is taken as noise, runs are drawn anew."""
    rng = np.random.default_rng(seed)
    return bagged(grams, rng, excess=excess(grams, posterior(grams).best()), replicates=32)


def one_hidden(drawn: World, rng: np.random.Generator) -> tuple[np.ndarray, str]:
    at = int(rng.integers(len(drawn.columns) - 4))
    coefficients = np.zeros(len(drawn.columns))
    coefficients[at] = abs(rng.normal()) + 0.3
    return coefficients, drawn.columns[at].family


def coloured(rng: np.random.Generator, n: int, size: float) -> np.ndarray:
    """Slow waves that no noise model knows of."""
    x = np.linspace(0, 1, n)
    waves = np.array([f(k * np.pi * x) for k in range(1, 8) for f in (np.sin, np.cos)])
    return np.asarray(size * rng.normal(size=(RUNS, len(waves))) @ waves)


def test_it_is_a_distribution_and_repeats_itself(worlds: list[World]) -> None:
    rng = np.random.default_rng(0)
    grams = worlds[0].grams(one_hidden(worlds[0], rng)[0], rng)
    once, again = weighed(grams, 3), weighed(grams, 3)
    assert once.probability.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(once.probability, again.probability)
    assert once.calibrated


def test_none_is_that_of_the_runs_as_they_are(worlds: list[World]) -> None:
    rng = np.random.default_rng(1)
    grams = worlds[0].grams(np.zeros(len(worlds[0].columns)), rng)
    scaled = replace(grams, matrices=grams.matrices / 1.3)
    found = bagged(grams, rng, excess=1.3, replicates=16)
    assert found.none == pytest.approx(posterior(scaled, beam=40).none, rel=0.02)


def test_one_cause_alone_can_be_weighed() -> None:
    alone = world(0, (column("a"),), runs=4, n=30)
    found = bagged(alone.grams(np.array([3.0]), np.random.default_rng(0)), np.random.default_rng(0))
    assert found.calibrated and found.families()["a"] > 0.5


@pytest.mark.parametrize("runs", [1, 2])
def test_one_or_two_runs_cannot_be_resampled(worlds: list[World], runs: int) -> None:
    rng = np.random.default_rng(2)
    grams = worlds[0].grams(np.zeros(len(worlds[0].columns)), rng, runs=runs)
    found = bagged(grams, rng)
    assert not found.calibrated
    np.testing.assert_allclose(found.probability, posterior(grams).probability)


@pytest.mark.parametrize(("noise", "waves"), [(1.2, 0.0), (1.0, 0.15)])
def test_nulls_get_no_name_where_the_noise_is_larger_than_modelled(
    worlds: list[World], noise: float, waves: float
) -> None:
    rng = np.random.default_rng(5)
    nothing, at_its_word, named = 0, 0, 0
    for i in range(24):
        drawn = worlds[i % 3]
        extra = coloured(rng, drawn.soil.shape[1], waves)
        grams = drawn.grams(np.zeros(len(drawn.columns)), rng, noise, extra)
        found = weighed(grams, i)
        nothing += found.none >= 0.5
        at_its_word += posterior(grams).none >= 0.5
        named += max(found.families().values()) > 0.9
    assert named == 0
    assert nothing >= 15
    assert nothing > at_its_word


def test_stated_names_are_right_where_the_noise_is_larger_than_modelled(worlds: list[World]) -> None:
    rng = np.random.default_rng(6)
    stated = right = found_at_all = 0
    for i in range(36):
        drawn = worlds[i % 3]
        coefficients, family = one_hidden(drawn, rng)
        extra = coloured(rng, drawn.soil.shape[1], 0.15)
        chances = weighed(drawn.grams(coefficients, rng, 1.1, extra), i).families()
        for name, p in chances.items():
            stated += p > 0.9
            right += p > 0.9 and name == family
        found_at_all += chances[family] > 0.5
    assert stated >= 5
    assert right >= 0.9 * stated
    assert found_at_all >= 10


def test_a_cause_that_is_not_in_the_library_is_given_a_wrong_name_less_often(worlds: list[World]) -> None:
    rng = np.random.default_rng(7)
    plain, drawn_anew = [], []
    for i in range(36):
        whole = worlds[i % 3]
        coefficients, family = one_hidden(whole, rng)
        grams = whole.grams(coefficients, rng)
        start = grams.cause_columns.start
        kept = [j for j, c in enumerate(grams.causes) if c.family != family]
        at = np.r_[0:start, [start + j for j in kept], grams.cause_columns.stop : grams.matrices.shape[1]]
        without = replace(
            grams,
            matrices=grams.matrices[:, at[:, None].astype(int), at.astype(int)],
            causes=tuple(grams.causes[j] for j in kept),
        )
        plain.append(max(posterior(without).families().values()) > 0.9)
        drawn_anew.append(max(weighed(without, i).families().values()) > 0.9)
    assert sum(plain) >= 3
    assert sum(drawn_anew) < sum(plain)
