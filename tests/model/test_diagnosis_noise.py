"""The noise model: one likelihood by two ways, its gradient, and hyper-parameters found again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from model.cores import spread
from model.diagnosis import Campaign, considered, samples_of
from model.diagnosis.time_series import coverage_of
from model.diagnosis.time_series import hyper as noise_blocks
from model.diagnosis.time_series.columns import Columns, columns_of
from model.diagnosis.time_series.hyper import (
    LONGEST,
    MOST,
    Block,
    Objective,
    Piece,
    _Covariance,
    _pieces,
    blocks_of,
    estimated,
    likelihood,
)
from model.diagnosis.time_series.linearise import Linear, Point, Simulation, linearise, soil_space
from model.diagnosis.time_series.noise import constants, hyper_priors, loading, processes, variance
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.whitening import run_grams
from model.effects import EFFECTS


@pytest.fixture(scope="module")
def seen() -> tuple[Samples, Linear, Columns]:
    campaign = simulated_campaign()
    return seen_of(campaign, samples_of(campaign))


def seen_of(campaign: Campaign, samples: Samples) -> tuple[Samples, Linear, Columns]:
    simulation = Simulation(
        campaign.wheel,
        campaign.soil,
        soil_space(campaign.soil_prior),
        considered(coverage_of(campaign, samples), tuple(EFFECTS), "balanced"),
        "balanced",
    )
    still = Point(np.zeros(len(simulation.space)), {}, np.zeros(len(samples)))
    mass = np.full(len(samples), 75.0)
    samples = replace(samples, conditions=replace(samples.conditions, compensated_mass_kg=mass))
    linear = linearise(simulation, samples, still)
    return samples, linear, columns_of(simulation, samples, linear, np.zeros(len(samples)))


def objective(blocks: Sequence[Block], values: Mapping[str, float]) -> Objective:
    with spread([Piece(block) for block in blocks]) as pieces:
        return likelihood(pieces, values, list(values))


def test_blocks_and_the_filter_agree(seen: tuple[Samples, Linear, Columns]) -> None:
    samples, linear, columns = seen
    values = {name: b.centre for name, b in hyper_priors(samples).items()}
    of_speed = np.full(len(samples), 9e-4)
    found = objective(blocks_of(samples, linear, columns, of_speed, values), values)
    grams = run_grams(samples, linear, columns, values, of_speed)
    total = grams.matrices.sum(axis=0)
    inner = np.eye(len(total) - 1) + total[1:, 1:]
    square = total[0, 0] - total[1:, 0] @ np.linalg.solve(inner, total[1:, 0])
    expected = 0.5 * (grams.log_determinants.sum() + np.linalg.slogdet(inner)[1] + square)
    assert found.value == pytest.approx(expected, abs=1e-6)


def test_the_variance_is_the_diagonal_of_the_covariance(seen: tuple[Samples, Linear, Columns]) -> None:
    samples, linear, columns = seen
    values, of_speed = {name: 1.3 * b.centre for name, b in hyper_priors(samples).items()}, np.full(len(samples), 9e-4)
    diagonal = []
    for block in blocks_of(samples, linear, columns, of_speed, values):
        driven = np.any([rows for name, rows in block.white if "_white_" in name], axis=0)
        diagonal.append(np.diag(_Covariance(block, values, list(values)).matrix())[driven])
    expected = variance(linear, samples, values, of_speed).T[columns.present.T]
    np.testing.assert_allclose(np.concatenate(diagonal), expected, rtol=1e-9)


def test_the_gradient_is_that_of_the_likelihood(seen: tuple[Samples, Linear, Columns]) -> None:
    samples, linear, columns = seen
    values = {name: b.centre for name, b in hyper_priors(samples).items()}
    blocks = blocks_of(samples, linear, columns, np.full(len(samples), 9e-4), values)[:1]
    gradient, _ = objective(blocks, values).slopes()
    for i, name in enumerate(values):
        up, down = ({**values, name: values[name] * np.exp(side * 1e-4)} for side in (1, -1))
        slope = (objective(blocks, up).value - objective(blocks, down).value) / 2e-4
        assert gradient[i] == pytest.approx(slope, rel=1e-4, abs=1e-4), name


def test_noise_without_a_sigma_is_a_share_of_the_load(seen: tuple[Samples, Linear, Columns]) -> None:
    samples = replace(seen[0], sigma=dict.fromkeys(seen[0].sigma, np.nan))
    priors = hyper_priors(samples)
    load = float(np.median(samples.conditions.vertical_load_n))
    assert priors["drawbar_pull_noise_n"].centre == pytest.approx(0.7 * 0.004 * load)
    assert priors["driving_torque_noise_nm"].centre == pytest.approx(0.7 * 0.004 * load * samples.wheel_radius_m)


def test_hyper_parameters_are_found_again(seen: tuple[Samples, Linear, Columns]) -> None:
    """Noise drawn three times from the model itself, with hyper-parameters that are not what the prior states."""
    samples, linear, columns = seen
    prior = hyper_priors(samples)
    names = list(prior)
    off = []
    for seed in range(5, 8):
        rng = np.random.default_rng(seed)
        truth = {name: b.centre * np.exp(0.7 * b.log_sigma * rng.standard_normal()) for name, b in prior.items()}
        blocks = blocks_of(samples, linear, columns, np.zeros(len(samples)), truth)
        drawn = []
        for block in blocks:
            root = np.linalg.cholesky(_Covariance(block, truth, names).matrix())
            residual = root @ rng.standard_normal(len(root))
            drawn.append(replace(block, columns=np.concatenate([residual[:, None], block.columns[:, 1:]], axis=1)))
        found = estimated(drawn, prior)
        likeliest = {n: x * np.exp(-(found.log_sigmas[n] ** 2) * prior[n].of_few) for n, x in found.values.items()}
        off += [np.log(likeliest[name] / truth[name]) / found.log_sigmas[name] for name in names]
        sharp = [name for name in names if found.log_sigmas[name] < 0.5 * prior[name].log_sigma]
        assert len(sharp) >= 5, sharp
    assert np.mean(np.square(off)) < 1.6
    assert np.mean(np.abs(off) > 3.0) < 0.03


def test_every_hyper_parameter_is_used(seen: tuple[Samples, Linear, Columns]) -> None:
    samples, linear, _ = seen
    listed = processes(linear.channels)
    used = (
        {p.deviation for p in listed} | {p.time for p in listed if p.time} | {n for n, _ in constants(linear.channels)}
    )
    left = set(hyper_priors(samples)) - used
    assert all("white" in name or "at_rest" in name for name in left)
    assert all(loading(linear, samples, p.loading).shape == linear.value.shape for p in listed)


@pytest.mark.parametrize("short", [0, 25])
def test_what_short_runs_cannot_tell_a_long_one_does(monkeypatch: pytest.MonkeyPatch, short: int) -> None:
    campaign = simulated_campaign()
    whole = samples_of(campaign)
    rank = np.arange(len(whole)) - np.searchsorted(whole.run, whole.run)
    samples, linear, columns = seen_of(campaign, whole[(whole.run == 0) | (rank < short)])
    assert samples.runs > 2 and len(samples) > 130
    monkeypatch.setattr(noise_blocks, "MOST", 120)
    monkeypatch.setattr(noise_blocks, "LONGEST", 30)
    monkeypatch.setattr(noise_blocks, "_SHORTEST", 15)
    values = {name: b.centre for name, b in hyper_priors(samples).items()}
    blocks = blocks_of(samples, linear, columns, np.zeros(len(samples)), values)
    assert 90 <= sum(len(block.columns) for block in blocks) / len(linear.channels) <= 180


@pytest.mark.parametrize(("runs", "length"), [(1, 150), (6, 156), (6, 400), (20, 240), (1, 5000), (60, 200), (3, 0)])
def test_of_a_long_campaign_every_run_tells_the_noise_a_little(runs: int, length: int) -> None:
    whole = runs * length <= MOST
    kept = [_pieces(np.arange(length), length if whole else MOST // runs, run) for run in range(runs)]
    sizes = [sum(len(piece) for piece in pieces) for pieces in kept]
    assert all(len(piece) <= LONGEST for pieces in kept for piece in pieces)
    if whole:
        assert sizes == [length] * runs
    else:
        assert min(sizes) > 0 and sum(sizes) <= max(1.5 * MOST, 1.5 * 60 * runs)
        assert len({int(pieces[0][0]) for pieces in kept}) > 1 or runs == 1
