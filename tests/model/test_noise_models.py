"""Models of the noise about the most probable one: which hyper-parameters move, by how much, and what it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_campaign import driven, looked

from model.diagnosis.findings.noise_models import STEP, grams_around, plausible_grams
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.noise import hyper_priors

MOVED = ("_slow_noise_n", "_slow_noise_nm", "_in_run")


@pytest.fixture(scope="module")
def seen() -> LinearisedCampaign:
    return looked(driven(), "vasilev")


def test_more_noise_leaves_less_of_a_misfit(seen: LinearisedCampaign) -> None:
    (at, _), (slow_up, _), (slow_down, _), (soil_up, _), (soil_down, _) = grams_around(seen)
    np.testing.assert_allclose(at.total, seen.grams.total, rtol=1e-9, atol=1e-9)
    for up, down in ((slow_up, slow_down), (soil_up, soil_down)):
        assert up.total[0, 0] < at.total[0, 0] < down.total[0, 0]
        assert up.log_determinants.sum() > at.log_determinants.sum() > down.log_determinants.sum()


def test_each_model_has_its_prior_density(seen: LinearisedCampaign) -> None:
    """The noise is at the centre of its prior here, known to .3 of the prior's sigma."""
    [data] = seen.campaigns
    priors = np.array([log_prior for _, log_prior in grams_around(seen)])
    slow = sum(name.endswith(MOVED[:2]) for name in hyper_priors(data.samples))
    soil = sum(name.endswith(MOVED[2]) for name in hyper_priors(data.samples))
    off = -0.5 * (0.3 * STEP) ** 2
    np.testing.assert_allclose(priors - priors[0], [0.0, slow * off, slow * off, soil * off, soil * off], rtol=1e-9)


def test_no_model_has_a_speed_error_that_no_receiver_has(seen: LinearisedCampaign) -> None:
    [data] = seen.campaigns
    noise = replace(data.noise, values=data.noise.values | {"speed_noise_mps": 5.0})
    wild = replace(seen, campaigns=(replace(data, noise=noise),))
    plausible = plausible_grams(wild)
    np.testing.assert_allclose(next(grams_around(wild))[0].total, plausible.total)
    assert plausible_grams(seen) is seen.grams
