"""Whether the report says that braked samples confirm the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from diagnosis_samples import diagnosis, seen

from wheelsoil.report.recommendation import Recommendation, biases, of_diagnosis, unconfirmed


def with_braked_residual(swing_n: float, noise_n: float, samples: int = 4000) -> Recommendation:
    """Return a model that is right about driven samples; the braked ones have more noise, and a swing over slip."""
    data = seen(samples=samples)
    rng, braked = np.random.default_rng(5), data.slip < 0
    assert 0.05 < braked.mean() < 0.5
    left = np.where(braked, swing_n * np.sin(20 * np.pi * data.slip), 0.0)
    left += np.where(braked, noise_n, data.base_sigma["dp"]) * rng.standard_normal(len(data.slip))
    data = replace(data, measured=data.measured | {"dp": data.extended["dp"] + left})
    return of_diagnosis(replace(diagnosis(), plot_data=(data,)))


def test_noise_about_zero_is_no_swing() -> None:
    assert unconfirmed(with_braked_residual(0.0, 600.0, samples=50), "dp") == ""
    assert unconfirmed(with_braked_residual(0.0, 600.0), "dp") == ""


def test_a_swing_is_said() -> None:
    said = unconfirmed(with_braked_residual(400.0, 100.0), "dp")
    assert said.startswith("The model is not confirmed for braking: drawbar pull, median residual −")
    assert said.endswith("noise of a driven sample 35 N.")
    assert unconfirmed(with_braked_residual(20.0, 100.0), "dp") == "", "less than a driven sample's noise"


def test_a_bias_is_of_neighbouring_slips_on_one_side_of_zero() -> None:
    """Two stretches are off, with what fits between them: the one that is off more is said, and its noise."""
    data = seen(samples=2000)
    noise = data.base_sigma["dp"] * np.random.default_rng(5).standard_normal(len(data.slip))
    hump = np.where((data.slip > 0.2) & (data.slip < 0.4), -375.0, 0.0) + np.where(data.slip > 0.6, 90.0, 0.0)
    data = replace(data, measured=data.measured | {"dp": data.extended["dp"] + hump + noise})
    [bias] = [bias for bias in biases(of_diagnosis(replace(diagnosis(), plot_data=(data,)))) if bias.channel == "dp"]
    assert bias.slip == (0.2, 0.4) and -400 < bias.size[0] <= bias.size[1] < -350
    assert 30 < bias.noise < 40


def test_few_samples_far_off_are_a_bias_and_many_just_beyond_the_noise_are_none() -> None:
    data = seen(samples=400)
    sigma = data.base_sigma["dp"]
    noise = sigma * np.random.default_rng(6).standard_normal(len(data.slip))
    few = np.flatnonzero((data.slip > 0.5) & (data.slip < 0.55))[:6]

    def said(off_n: np.ndarray) -> list[tuple[float, float]]:
        of = replace(data, measured=data.measured | {"dp": data.extended["dp"] + off_n})
        found = biases(of_diagnosis(replace(diagnosis(), plot_data=(of,))))
        return [bias.slip for bias in found if bias.channel == "dp" and bias.driving]

    rows = np.ones(len(data.slip), np.bool_)
    rows[(data.slip > 0.5) & (data.slip < 0.55)] = False
    rows[few] = True
    shown = np.where(rows, noise + np.where(np.isin(np.arange(len(rows)), few), 6 * sigma, 0.0), np.nan)
    assert said(shown) == [(0.5, 0.55)]
    assert said(noise) == []
