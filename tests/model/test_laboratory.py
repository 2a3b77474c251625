"""The laboratory's soil is refuted beside every probable set of causes, or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import column
from short_campaign import driven, noise_of

from daq import FloatArray
from model.diagnosis import DiagnosisOptions, diagnose
from model.diagnosis.core.hypotheses import Posterior, probabilities
from model.diagnosis.findings.laboratory import refuted_soil, soil_instead
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import hypotheses, log_evidences, without_soil
from model.diagnosis.time_series.linearise import SENSORS, SoilSpace
from model.wheel_soil import SOIL_PARAMETERS, prior_of

RUNS, SAMPLES, SOILS = 6, 200, len(SOIL_PARAMETERS)
SPACE = SoilSpace(
    mean=np.ones(SOILS),
    logarithmic=np.zeros(SOILS, bool),
    root=np.c_[0.1 * np.eye(SOILS), np.zeros((SOILS, len(SENSORS)))],
    labels=(*SOIL_PARAMETERS, *SENSORS),
)
"""One-sigma of .1 for every parameter, none correlated."""
CAUSES = (column("first"), column("second"))
PLACES = np.arange(len(SPACE))


def grams(off: dict[str, float], coefficients: tuple[float, float], like: str = "", apart: float = 1.0) -> Grams:
    """Return cross products of runs on a soil that is so many sigmas off; `like`: what the second cause looks like."""
    rng = np.random.default_rng(4)
    soil = rng.normal(size=(RUNS, SAMPLES, len(SPACE)))
    causes = rng.normal(size=(RUNS, SAMPLES, 2))
    if like:
        causes[..., 1] = 4.0 * soil[..., SOIL_PARAMETERS.index(like)] + apart * rng.normal(size=(RUNS, SAMPLES))
    u: FloatArray = np.array([off.get(name, 0.0) for name in SPACE.labels])
    residual = soil @ u + causes @ np.array(coefficients) + rng.normal(size=(RUNS, SAMPLES))
    everything = np.concatenate([residual[..., None], soil, causes], axis=2)
    matrices = np.swapaxes(everything, 1, 2) @ everything
    names = tuple(f"run {i}" for i in range(RUNS))
    return Grams(matrices, np.zeros(RUNS), np.full(RUNS, SAMPLES), names, SPACE.labels, CAUSES, ())


def test_it_speaks_from_about_four_sigmas() -> None:
    for sigmas, said in ((3.5, False), (4.0, False), (4.7, True), (-6.0, True)):
        found = refuted_soil(grams({"tan_phi": sigmas}, (0.0, 0.0)), [("clay", SPACE, PLACES)], {(): 1.0}, 1.0)
        assert bool(found) == said, sigmas
        for one in found:
            assert (one.campaign, one.parameter) == ("clay", "tan_phi")
            assert one.sigmas == pytest.approx(sigmas, abs=0.25)


def test_a_second_cause_is_not_taken_for_the_soil() -> None:
    """Beside the first cause alone the soil takes up what the second does."""
    both = grams({"frictional_modulus": 1.0}, (2.0, 1.5), like="frictional_modulus")
    spaces = [("clay", SPACE, PLACES)]
    (wrong,) = refuted_soil(both, spaces, {("first",): 1.0}, 1.0)
    assert wrong.parameter == "frictional_modulus" and wrong.sigmas > 5.0
    assert refuted_soil(both, spaces, {("first",): 0.05, ("first", "second"): 0.95, (): 0.0}, 1.0) == ()


def test_a_parameter_that_is_known_exactly_is_not_asked_and_noise_makes_it_less_sure() -> None:
    off = grams({"tan_phi": 5.0}, (0.0, 0.0))
    (sure,) = refuted_soil(off, [("clay", SPACE, PLACES)], {(): 1.0}, 1.0)
    assert refuted_soil(off, [("clay", SPACE, PLACES)], {(): 1.0}, 4000.0) == (), "the data hardly determine it"
    known = SPACE.root.copy()
    known[SOIL_PARAMETERS.index("tan_phi")] = 0.0
    exact = SoilSpace(SPACE.mean, SPACE.logarithmic, known, SPACE.labels)
    assert sure.parameter not in [
        one.parameter for one in refuted_soil(off, [("clay", exact, np.arange(len(exact)))], {(): 1.0}, 1.0)
    ]


def test_what_looks_like_a_parameter_of_the_soil_is_said_to_be_it_instead() -> None:
    """The friction at the rim and the friction angle are one number to the forces."""
    spaces = [("clay", SPACE, PLACES)]
    for off, coefficient, apart, expected in ((5.5, 0.0, 0.01, True), (0.0, 1.4, 0.01, True), (0.0, 1.4, 1.0, False)):
        seen = grams({"tan_phi": off}, (0.0, coefficient), "tan_phi", apart)
        listed = hypotheses(seen)
        found = log_evidences(seen, without_soil(seen, seen.total), listed)
        posterior = Posterior(listed, found, probabilities(found, listed.log_prior))
        instead = soil_instead(seen, spaces, posterior, ("second",), 1.0)
        assert bool(instead) == expected
        for one in instead:
            assert (one.family, one.soil.parameter) == ("second", "tan_phi")
            assert one.soil.sigmas == pytest.approx(off + 4.0 * coefficient, abs=0.5)


def test_an_angle_that_is_too_high_is_said_beside_the_friction_that_is_not_named() -> None:
    campaign = driven(soil="sandy")
    high = replace(campaign.soil, friction_angle_rad=1.3 * campaign.soil.friction_angle_rad)
    found = diagnose(
        [replace(campaign, soil=high, soil_prior=prior_of(high))],
        DiagnosisOptions(effects=("interface_friction", "slope"), name_at=1.0 - 1e-12),  # no cause reaches that
        [noise_of(campaign)],
    )
    [instead] = found.grounds.soil_instead
    assert (found.verdict, instead.family, instead.soil.parameter) == ("one_of", "interface_friction", "tan_phi")
