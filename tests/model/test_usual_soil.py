"""Names asked again where the stress peak lies ahead of the bottom: the algebra, and a campaign that loses its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import WIDTHS, column, world
from short_campaign import driven, looked

from model.diagnosis.core.clock import Clock
from model.diagnosis.findings.usual_soil import posterior_with_usual_soil, usual_effects, with_usual_soil
from model.diagnosis.time_series.evidence import estimate, log_evidence
from model.effects import EFFECTS


@pytest.mark.parametrize("keys", [(), ("vasilev",)])
def test_the_usual_soil_is_what_its_prior_says(keys: tuple[str, ...]) -> None:
    """Evidence with the parameters as columns of the soil, against a normal density in full."""
    free = {"lower": -np.inf, "upper": np.inf}
    causes = (
        column("slip_sinkage", "vasilev", **free),
        column("stress_peak_shift", parameter="c1", scale=0.3, **free),
        column("stress_peak_shift", parameter="c2", scale=0.3, **free),
    )
    grams = world(3, causes).grams(np.array([0.5, 1.0, 1.0]), np.random.default_rng(3))
    found = with_usual_soil(grams)
    assert usual_effects(grams) == ("stress_peak_shift",)
    assert [c.key for c in found.causes] == ["vasilev"]
    assert len(found.soil) == len(grams.soil) + 2
    total, width = grams.total, len(grams.soil)
    kept = [1 + i for i in range(width)] + [
        grams.cause_columns.start + i for i, c in enumerate(causes) if c.key in keys
    ]
    peak = [grams.cause_columns.start + i for i in (1, 2)]
    mean = np.array([0.30, 0.32]) / 0.3
    sigma = np.array([0.12, 0.15]) / 0.3
    at = [*kept, *peak]
    constant = float(grams.samples.sum()) * np.log(2 * np.pi) + float(grams.log_determinants.sum())
    side = total[at, 0] + np.r_[np.zeros(len(kept)), mean / sigma**2]
    each = []
    for size, share in WIDTHS:
        prior = np.r_[np.ones(width), np.full(len(kept) - width, size**-2.0), sigma**-2.0]
        precision = total[np.ix_(at, at)] + np.diag(prior)
        square = total[0, 0] + float(mean**2 @ sigma**-2.0) - side @ np.linalg.solve(precision, side)
        log_det = np.linalg.slogdet(precision)[1] - np.log(prior).sum()
        each.append(np.log(share) - 0.5 * (square + log_det + constant))
    assert log_evidence(found, keys) == pytest.approx(np.logaddexp(*each), rel=1e-9)


def test_the_usual_values_are_within_their_bounds() -> None:
    for effect in EFFECTS.values():
        for parameter in effect.parameters:
            if parameter.usual is not None:
                mean, sigma = parameter.usual
                assert parameter.lower < mean < parameter.upper
                assert 0 < sigma < parameter.upper - parameter.lower


def test_a_stress_peak_that_led_is_part_of_the_usual_soil() -> None:
    seen = looked(driven(), "vasilev", "stress_peak_shift")
    led = replace(seen, best=estimate(seen.grams, ("stress_peak_shift",)))
    found = posterior_with_usual_soil(led, np.random.default_rng(0), 1.0, Clock())
    assert "stress_peak_shift" not in found.best()
    assert found.probability.sum() == pytest.approx(1.0)
