"""The error of form: in the evidence, in the threshold and in the excess, and never smaller for more runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import World, library, world
from short_campaign import driven, looked

from model.diagnosis.findings.adequacy import adequacy, excess, unlisted
from model.diagnosis.findings.held_out import bagged
from model.diagnosis.time_series.basis import FORM_ERROR, amplitude_of, basis
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import estimate, log_evidence, posterior

FORM = 0.3


@pytest.fixture(scope="module")
def drawn() -> World:
    return world(4, library(8), n=80, strength=(3, 60))


def as_soil(grams: Grams) -> Grams:
    """Return the Grams with the shapes, as large as the error of form, among the soil's columns."""
    start, soils = grams.cause_columns.start, grams.soil_columns.stop
    order = [*range(soils), *range(grams.cause_columns.stop, len(grams.total)), *range(start, grams.cause_columns.stop)]
    scale = np.where(np.arange(len(grams.total)) < grams.cause_columns.stop, 1.0, grams.form)[order]
    matrices = grams.matrices[:, np.array(order)[:, None], order] * np.outer(scale, scale)
    labels = tuple(f"shape {i}" for i in range(len(grams.basis)))
    return replace(grams, matrices=matrices, soil=(*grams.soil, *labels), basis=(), form=0.0)


def test_the_shapes_are_integrated_out_of_every_evidence(drawn: World) -> None:
    grams = replace(drawn.grams(np.r_[1.0, np.zeros(len(drawn.columns) - 1)], np.random.default_rng(1)), form=FORM)
    plain = as_soil(grams)
    np.testing.assert_allclose(posterior(grams).log_evidence, posterior(plain).log_evidence, atol=1e-7)
    keys = (drawn.columns[1].key, "digging" if "digging" in {c.key for c in drawn.columns} else drawn.columns[2].key)
    for some in ((), (drawn.columns[1].key,), keys[:1]):
        assert log_evidence(grams, some) == pytest.approx(log_evidence(plain, some), abs=1e-7)
        found, expected = estimate(grams, some), estimate(plain, some)
        np.testing.assert_allclose(found.coefficients, expected.coefficients, atol=1e-9)
        np.testing.assert_allclose(found.sigmas, expected.sigmas, atol=1e-9)
    again = [bagged(one, np.random.default_rng(3)).probability for one in (grams, plain)]
    np.testing.assert_allclose(*again, atol=1e-8)


def test_more_runs_do_not_make_an_estimate_surer_than_the_error_of_form(drawn: World) -> None:
    """As many runs again and again: without it the sigma falls with the root of their number."""
    rng = np.random.default_rng(2)
    causes = drawn.causes.copy()
    causes[..., 1] = drawn.basis[..., :4].sum(axis=-1)
    grams = replace(drawn, causes=causes).grams(np.zeros(len(drawn.columns)), rng)
    key = drawn.columns[1].key

    def sigma(form: float, times: int) -> float:
        many = replace(grams, matrices=np.tile(grams.matrices, (times, 1, 1)), form=form)
        return float(estimate(many, (key,)).sigmas[0])

    assert sigma(0.0, 400) < 0.08 * sigma(0.0, 1)
    assert sigma(FORM, 400) > 0.8 * sigma(FORM, 25) > 0.0


def test_a_misfit_as_large_as_the_error_of_form_is_explained_by_it() -> None:
    """The same in every run; the noise is not thought larger for it. One ten times as large is no error of form."""
    many, rng = world(4, library(8), runs=20, n=80, strength=(3, 60)), np.random.default_rng(5)
    off = many.basis @ (FORM * rng.standard_normal(many.basis.shape[2]))
    grams = many.grams(np.zeros(len(many.columns)), rng, extra=off)
    known = replace(grams, form=FORM)
    assert not adequacy(grams, (), unlisted(grams, most=1)).ok and adequacy(known, (), unlisted(known, most=1)).ok
    assert excess(known, ()) < 1.3 < excess(grams, ())
    larger = many.grams(np.zeros(len(many.columns)), rng, extra=10.0 * off)
    larger = replace(larger, form=FORM)
    assert not adequacy(larger, (), unlisted(larger, most=1)).ok


def test_all_shapes_together_are_as_large_as_stated_whatever_the_number_of_runs() -> None:
    seen = looked(driven(), "vasilev", "torque_zero")
    [data] = seen.campaigns
    found = basis(data.samples, data.linear)
    sizes = [FORM_ERROR * amplitude_of(data.samples, c) / 0.02 for c in data.linear.channels]
    rms = np.sqrt(((found.catch_all.form * found.columns) ** 2).sum(axis=-1).mean(axis=1))
    assert np.sqrt(np.mean((rms / sizes) ** 2)) == pytest.approx(1.0, rel=1e-6)
    assert np.asarray(seen.grams.form) == pytest.approx(found.catch_all.form)
