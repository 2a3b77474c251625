"""Predictions of many samples, block by block, and a fit that keeps none, are those of all at once."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from short_campaign import driven
from virtual_support import LYASKO, lyasko_model

from model.fit import fit_models
from model.wheel_soil import Conditions, wheel_soil_model


@settings(max_examples=25, deadline=None)
@given(block=st.integers(1, 80), count=st.integers(0, 70), seed=st.integers(0, 1000), given_sinkage=st.booleans())
def test_blocks_of_any_length_are_the_whole(block: int, count: int, seed: int, given_sinkage: bool) -> None:
    rng = np.random.default_rng(seed)
    slip, load = rng.uniform(-0.9, 0.9, count), rng.uniform(3000.0, 9000.0, count)
    slip[rng.random(count) < 0.2] = np.nan
    conditions = Conditions(slip, load, ground_speed_mps=np.full(count, 1.0), direction=1.0)
    sinkage = rng.uniform(0.02, 0.1, count) if given_sinkage else None
    with pytest.MonkeyPatch.context() as patch:
        whole = lyasko_model().predict(conditions, LYASKO["clay"], ("m1", "slip"), sinkage)
        patch.setattr(wheel_soil_model, "_BLOCK", block)
        parts = lyasko_model().predict(conditions, LYASKO["clay"], ("m1", "slip"), sinkage)
    pairs = [(parts, whole), *((parts.sensitivities[key], whole.sensitivities[key]) for key in ("m1", "slip"))]
    for one, other in pairs:
        for name in (f.name for f in fields(one) if f.name != "sensitivities"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-9)


def test_a_fit_that_keeps_no_predictions_judges_alike() -> None:
    campaign = driven("lyasko:m1=0.1,m2=0.05")
    kept, light = (
        fit_models(campaign.runs, campaign.wheel, campaign.soil, keep_predictions=keep) for keep in (True, False)
    )
    for one, other in zip(kept.models, light.models, strict=True):
        assert len(one.predictions) == len(campaign.runs)
        assert not other.predictions
        for channel, found in one.criteria.items():
            same = other.criteria[channel]
            assert same.samples == found.samples
            assert [same.M0_percent, same.R0_N, same.R2] == pytest.approx([found.M0_percent, found.R0_N, found.R2])
