"""Lack of fit, where it shows, what could have been seen, and whether there is one soil."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import World, column, library, world
from scipy.stats import multivariate_normal

from model.diagnosis import Adequacy, Kind, Shape
from model.diagnosis.findings.adequacy import (
    LIMIT,
    MOST_EXCESS,
    UNLISTED,
    adequacy,
    excess,
    found_in,
    kinds_of,
    left_over,
    over_noises,
    unlisted,
)
from model.diagnosis.findings.agreement import two_soils
from model.diagnosis.findings.isolability import detectable_in_runs
from model.diagnosis.time_series.basis import RunShapes
from model.diagnosis.time_series.columns import Grams, OwnGram
from model.diagnosis.time_series.evidence import hypotheses, log_evidence_of_none, posterior, without_soil
from model.diagnosis.time_series.linearise import SENSORS

UNITS_AND_CHANNELS = ((0.0, "dp", "m/s"), (1.0, "t", ""), (2.0, "dp", "any text"))


@pytest.fixture(scope="module")
def drawn() -> World:
    return world(4, library(10), n=80, strength=(3, 60))


def judged(grams: Grams, most: int = 3) -> Adequacy:
    return adequacy(grams, (), unlisted(grams, most=most))


def test_noise_is_nothing_unlisted(drawn: World) -> None:
    rng = np.random.default_rng(0)
    found = [judged(drawn.grams(np.zeros(len(drawn.columns)), rng), most=1) for _ in range(5)]
    assert np.mean([one.statistic for one in found]) < UNLISTED
    assert all(one.ok for one in found)


@pytest.mark.parametrize("with_own", [False, True])
def test_the_probability_is_that_of_a_covariance_written_out(with_own: bool) -> None:
    """Gaussian densities with all columns in the covariance; the square root of the Gram matrix is the data."""
    drawn, rng = world(4, library(1), runs=3, n=40), np.random.default_rng(3)
    kinds = [Shape(Kind.SLIP if i < 11 else Kind.LINE_POSITION, "dp") for i in range(drawn.basis.shape[2])]
    extra = 1.4 * drawn.basis[..., 3]
    dense = replace(drawn.grams(np.zeros(len(drawn.columns)), rng, extra=extra), basis=tuple(kinds), form=0.02)
    columns = np.linalg.cholesky(dense.total + 1e-9 * np.eye(len(dense.total))).T
    soil, shapes = columns[:, dense.soil_columns], columns[:, dense.basis_columns]
    grams, own = dense, [np.zeros((len(columns), 0))]
    if with_own:  # the last two shapes are a run's own
        kept, last = slice(0, -2), slice(len(columns) - 2, None)
        one = OwnGram(
            RunShapes((Shape(Kind.TIME_IN_RUN, "dp", run="r"),) * 2), dense.total[last, kept], dense.total[last, last]
        )
        grams = replace(dense, matrices=dense.matrices[:, kept, kept], basis=dense.basis[kept], own=(one,))
        own, shapes = [shapes[:, -2:]], shapes[:, :-2]

    def log_density(sigmas: np.ndarray, scale_of_own: float) -> float:
        covariance = np.eye(len(columns)) + soil @ soil.T + (shapes * sigmas**2) @ shapes.T
        covariance += scale_of_own**2 * own[0] @ own[0].T
        return float(multivariate_normal(np.zeros(len(columns)), covariance).logpdf(columns[:, 0]))

    small = np.full(shapes.shape[1], 0.02)
    slip = np.array([shape.kind == Kind.SLIP for shape in grams.basis])
    larger = [log_density(np.where(mine, scale, small), 0.0) for mine in (slip, ~slip) for scale in (0.1, 0.3, 1.0)] + [
        log_density(small, scale) for scale in (0.1, 0.3, 1.0) if with_own
    ]
    odds = 0.02 / 0.98 * np.mean(np.exp(np.array(larger) - log_density(small, 0.0)))
    assert 0.02 < odds / (1.0 + odds) < 0.98
    assert unlisted(grams, most=0).probability == pytest.approx(odds / (1.0 + odds), rel=1e-4)


@pytest.mark.parametrize("one", [Shape(Kind.SLIP), Shape(Kind.LOAD_DRIVING)])
def test_one_shape_of_few_counts_as_much_as_many_of_one_kind(drawn: World, one: Shape) -> None:
    shapes = drawn.basis.shape[2]
    grams = drawn.grams(np.zeros(len(drawn.columns)), np.random.default_rng(4), extra=1.4 * drawn.basis[..., 3])
    places = [Shape(Kind.LINE_POSITION, "dp", (float(i), i + 1.0)) for i in range(shapes)]
    alone = unlisted(replace(grams, basis=(*places[:3], one, *places[4:])), most=1)
    one_kind = unlisted(replace(grams, basis=tuple(places)), most=1)
    assert alone.probability > one_kind.probability > LIMIT
    assert alone.shapes.tolist() == [3] and alone.run is None


@pytest.mark.parametrize("prior", [-1.5, pytest.param(2.0, marks=pytest.mark.slow)])
def test_models_of_the_noise_count_by_prior_and_evidence(drawn: World, prior: float) -> None:
    """Under a noise of twice the variance the same data have half the cross products and a larger determinant."""
    rng = np.random.default_rng(4)
    one = drawn.grams(np.zeros(len(drawn.columns)), rng, extra=1.4 * drawn.basis[..., 3])
    larger = one.samples * np.log(2.0)
    other = replace(one, matrices=one.matrices / 2.0, log_determinants=one.log_determinants + larger)
    both = over_noises([(one, 0.0), (other, prior)], most=0)
    weights = [prior_of + none_unlisted(grams) for grams, prior_of in ((one, 0.0), (other, prior))]
    odds = [np.exp(unlisted(grams, most=0).log_odds) for grams in (one, other)]
    shares = np.exp(weights - np.logaddexp(*weights))
    assert np.exp(both.log_odds) == pytest.approx(shares @ odds, rel=1e-9)
    assert over_noises([(one, 0.0), (other, -1e6)], most=0).log_odds == unlisted(one, most=0).log_odds


def none_unlisted(grams: Grams) -> float:
    """Return the log evidence of soil alone with the error of form, but for what the number of samples adds."""
    return log_evidence_of_none(grams, without_soil(grams, grams.total))


def test_only_the_kind_and_the_campaign_part_the_shapes() -> None:
    speeds = [Shape(Kind.GROUND_SPEED, channel, (i, i + 1.0), unit) for i, channel, unit in UNITS_AND_CHANNELS]
    several = [Shape(Kind.GROUND_SPEED, "dp", campaign="clay"), Shape(Kind.SLIP, "dp", campaign="clay")]
    kinds = [kind.tolist() for kind in kinds_of((*speeds, *several))]
    assert kinds == [[0, 1, 2], [3], [4]]


def test_without_a_shape_nothing_is_explained(drawn: World) -> None:
    grams = drawn.grams(np.zeros(len(drawn.columns)), np.random.default_rng(0))
    blind = replace(grams, matrices=grams.matrices.copy())
    blind.matrices[:, grams.basis_columns] = blind.matrices[:, :, grams.basis_columns] = 0.0
    start = grams.cause_columns.stop
    bare = replace(grams, basis=(), matrices=grams.matrices[:, :start, :start])
    for found in (judged(blind, most=1), judged(bare, most=1)):
        assert not found.ok and np.isnan([found.statistic, found.threshold]).all()


def test_what_is_in_no_cause_is_unlisted(drawn: World) -> None:
    bump = 8.0 * drawn.basis[..., 5] * np.array([1.0, -1, 1, 1, -1, 1])[:, None]
    found = judged(drawn.grams(np.zeros(len(drawn.columns)), np.random.default_rng(1), extra=bump))
    assert not found.ok
    assert found.statistic > 0.99 and found.threshold == LIMIT


def test_a_cause_is_unlisted_without_itself_and_not_with_it(drawn: World) -> None:
    def grams_of(at: int) -> Grams:
        coefficients = np.zeros(len(drawn.columns))
        coefficients[at] = 40.0
        return drawn.grams(coefficients, np.random.default_rng(2))

    strongest = max(range(9), key=lambda at: left_over(grams_of(at)).misfit)
    grams, key = grams_of(strongest), drawn.columns[strongest].key
    without = unlisted(grams, frozenset({key}), most=1).probability
    assert without > 0.99 > 0.2 > unlisted(grams, most=1).probability
    assert left_over(grams, (key,)).misfit < left_over(grams).misfit


@pytest.mark.parametrize(("noise", "factor"), [(0.6, 1.0), (1.2, 1.44), (4.0, MOST_EXCESS)])
def test_what_is_left_over_widens_the_noise_up_to_a_limit(drawn: World, noise: float, factor: float) -> None:
    rng = np.random.default_rng(5)
    own = [excess(drawn.grams(np.zeros(len(drawn.columns)), rng, noise=noise), ()) for _ in range(30)]
    assert np.mean(own) == pytest.approx(factor, abs=0.2)


def test_the_smallest_detectable_size_is_detected_half_of_the_time() -> None:
    columns = (column("a"), column("b", one_sided=True), column("c"))
    small = world(3, columns, n=60, strength=(20, 40))
    rng = np.random.default_rng(3)
    sizes = detectable_in_runs(small.grams(np.zeros(3), rng), name_at=0.9)
    listed = hypotheses(small.grams(np.zeros(3), rng), most=1)
    for i, key in enumerate(("a", "b")):
        coefficients = np.zeros(3)
        coefficients[i] = sizes[key].value / columns[i].scale
        odds = []
        for _ in range(200):
            found = posterior(small.grams(coefficients, rng), most=1)
            at = found.hypotheses.index_of((key,))
            odds.append(found.log_evidence[at] + listed.log_prior[at] - listed.log_prior[0])
        assert np.mean(odds) == pytest.approx(np.log(9.0), abs=0.6)


def test_what_leaves_no_trace_is_never_detectable() -> None:
    columns = (column("a"), column("b"))
    small = world(3, columns, n=40)
    small.causes[..., 1] = 0.0
    grams = small.grams(np.zeros(2), np.random.default_rng(0))
    assert detectable_in_runs(grams)["b"].value == np.inf
    assert set(detectable_in_runs(grams, frozenset({"b"}))) == {"a"}


def test_a_misfit_is_found_where_it_is(drawn: World) -> None:
    rng = np.random.default_rng(6)
    height = np.full(drawn.basis.shape[2], 3.0)
    for at in (2, 7, 15):
        extra = 2.5 * drawn.basis[..., at]
        grams = drawn.grams(np.zeros(len(drawn.columns)), rng, extra=extra)
        worst = found_in(left_over(grams), grams.basis, height)[0]
        assert worst.place == grams.basis[at]
        assert worst.channel == "drawbar_pull"
        assert worst.size == pytest.approx(2.5 * 3.0, rel=0.4)
        assert worst.statistic > 5


def test_noise_is_hardly_ever_a_finding(drawn: World) -> None:
    rng = np.random.default_rng(7)
    height = np.ones(drawn.basis.shape[2])
    said = [
        len(found_in(left_over(g := drawn.grams(np.zeros(len(drawn.columns)), rng)), g.basis, height))
        for _ in range(100)
    ]
    assert sum(n > 0 for n in said) <= 6


def test_two_terrains_are_seen_and_one_is_not(drawn: World) -> None:
    rng = np.random.default_rng(8)
    one = drawn.grams(np.zeros(len(drawn.columns)), rng)
    assert two_soils(one) is None
    other = np.zeros(drawn.soil.shape[:2])
    other[3:5] = drawn.soil[3:5] @ np.array([3.0, -3.0, 3.0, 3.0, -3.0, 3.0])
    mixed = two_soils(drawn.grams(np.zeros(len(drawn.columns)), rng, extra=other))
    assert mixed is not None
    assert set(mixed[0]) == {"run 3", "run 4"}
    assert set(mixed[1]) == {"run 0", "run 1", "run 2", "run 5"}


@pytest.mark.parametrize("wheel", ["", "wheel FL: "])
def test_sensors_are_the_same_on_all_terrains(drawn: World, wheel: str) -> None:
    """What differs from run to run as an error of a sensor would is no second soil."""
    rng = np.random.default_rng(8)
    parts = drawn.soil.copy()
    parts[..., 3:] = rng.normal(size=parts[..., 3:].shape)
    of_run = replace(drawn, soil=parts)
    other = np.zeros(parts.shape[:2])
    other[3:5] = parts[3:5] @ np.array([0.0, 0.0, 0.0, 3.0, -3.0, 3.0])
    mixed = of_run.grams(np.zeros(len(drawn.columns)), rng, extra=other)
    assert two_soils(mixed) is not None
    of_sensors = replace(mixed, soil=(*mixed.soil[:3], *(f"{wheel}{sensor}" for sensor in SENSORS)))
    assert two_soils(of_sensors) is None


def test_two_terrains_are_seen_among_many_runs() -> None:
    many = world(5, (column("a"),), runs=12, n=20)
    other = np.zeros(many.soil.shape[:2])
    other[[2, 9, 11]] = many.soil[[2, 9, 11]] @ np.array([5.0, -5.0, 5.0, 5.0, -5.0, 5.0])
    mixed = two_soils(many.grams(np.zeros(1), np.random.default_rng(0), extra=other))
    assert mixed is not None
    assert set(mixed[0]) == {"run 2", "run 9", "run 11"}


def test_shapes_of_single_runs_count_as_shapes_of_all_that_are_zero_elsewhere() -> None:
    rng = np.random.default_rng(11)
    drawn = world(11, library(4), runs=4)
    runs, n, shapes = drawn.basis.shape
    own = np.zeros((runs, n, 2 * runs))
    for run in range(runs):
        own[run, :, 2 * run : 2 * run + 2] = 3.0 * rng.normal(size=(n, 2))
    everywhere = replace(drawn, basis=np.concatenate([drawn.basis, own], axis=2))
    dense = everywhere.grams(np.zeros(len(drawn.columns)), rng, noise=1.2)
    start = dense.basis_columns.start
    shared = slice(start + shapes)
    blocks = []
    for run, matrix in enumerate(dense.matrices):
        rank = shapes + 2 * run + np.arange(2)
        at = start + rank
        names = RunShapes(tuple(dense.basis[i] for i in rank), rank)
        blocks.append(OwnGram(names, matrix[at, shared], matrix[np.ix_(at, at)]))
    kept = replace(dense, matrices=dense.matrices[:, shared, shared], basis=dense.basis[:shapes], own=tuple(blocks))
    keys = (drawn.columns[0].key,)
    np.testing.assert_allclose(left_over(kept, keys).information, left_over(dense, keys).information, rtol=1e-9)
    assert 1.0 < excess(dense, keys) < MOST_EXCESS
    assert excess(kept, keys) == pytest.approx(excess(dense, keys), rel=1e-9)
    for run in range(runs):
        assert excess(kept.without(run), keys) == pytest.approx(excess(dense.without(run), keys), rel=1e-9)
