"""No sample is lost on the way of the linearisation, and a verdict needs samples: a wheel in granular ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from granular_wheel import granular_campaign
from short_campaign import driven, looked

from model.diagnosis import DiagnosisOptions, diagnose
from model.diagnosis.core.clock import Clock
from model.diagnosis.core.naming import MOST_ERROR
from model.diagnosis.findings import set_fit
from model.diagnosis.findings.held_out import held_out
from model.diagnosis.findings.set_problem import set_problem
from model.diagnosis.time_series import diagnosis
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import SetEstimate, estimate, log_evidence
from model.diagnosis.time_series.joining import joined, part_of
from model.diagnosis.time_series.linearisation_point import LinearisationPoint, linearisation_points
from model.diagnosis.time_series.linearised_campaign import (
    STEPS,
    LinearisedCampaign,
    Relinearised,
    _swings,
    campaigns_at,
    most_probable,
    relinearise,
)
from wheelsoil.wording.verdict import sentence_of

EFFECTS = ("exit_angle",)


@pytest.fixture(scope="module")
def granular() -> LinearisedCampaign:
    return looked(granular_campaign(), *EFFECTS)


def test_granular_ground_and_a_wide_laboratory_are_unexplained(
    granular: LinearisedCampaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once the linearisation walked to a point without samples, and nothing was detectable in nothing."""
    monkeypatch.setattr(diagnosis, "linearise_campaigns", lambda *_: granular)
    found = diagnose([granular_campaign()], DiagnosisOptions(effects=EFFECTS))
    assert found.verdict == "unexplained", sentence_of(found)
    assert found.linearisation == granular.linearisation
    assert found.linearisation is not None
    samples = granular.campaigns[0].samples
    measured = np.isfinite(samples.measured["dp"]) | np.isfinite(samples.measured["t"])
    assert 50 < found.linearisation.used == measured.sum() < found.linearisation.samples == len(samples)


@pytest.mark.slow
def test_soil_alone_leaves_more_than_noise_in_granular_ground_and_not_in_its_own() -> None:
    for campaign, bites in ((granular_campaign(spread=0.1), True), (driven(soil="sandy"), False)):
        gain, _ = held_out(looked(campaign, "torque_zero"))
        assert gain is not None and set(gain.expected) == {"dp", "t"}
        ratios = [gain.base[c].R0 / expected for c, expected in gain.expected.items()]
        assert (max(ratios) > 1.1 * MOST_ERROR) if bites else (min(ratios) > 0.3 and max(ratios) < 1.2)


def far(seen: LinearisedCampaign, k_phi: float) -> LinearisationPoint:
    """Return a step in the stiffness of the soil from the last point, in the laboratory's one-sigma."""
    [at] = linearisation_points(seen.campaigns, seen.grams, seen.best)
    last = seen.campaigns[0].linear
    return replace(at, point=replace(last.point, soil=last.point.soil + k_phi * np.eye(len(last.point.soil))[5]))


def test_a_step_is_shortened_until_no_sample_is_lost(granular: LinearisedCampaign) -> None:
    """k_phi = mean (1 + u): below u = -1 the soil carries nothing."""
    last = granular.campaigns[0].linear
    u = last.point.soil[5]
    steps = []
    for reach in (0.01, 1.6 * (-1.0 - u), -1e3):
        [data], step = campaigns_at(granular.starts, [far(granular, reach)], Clock(), keep_noise=True, catch_all=False)
        assert data.linear.usable.sum() == last.usable.sum() == len(data.samples)
        stiffer = np.eye(len(last.point.soil))[5]
        np.testing.assert_allclose(data.linear.point.soil, last.point.soil + step * reach * stiffer)
        steps.append(step)
    assert steps[0] == 1.0 > steps[1] > steps[2] == 0.0


def test_a_shortened_step_moves_everything_alike(granular: LinearisedCampaign) -> None:
    before, after = ({"a": 2.0, "b": 4.0}, {"b": 8.0, "c": 3.0})
    last = replace(granular.campaigns[0].linear.point, causes=before, acceleration_mps2=0.4)
    point = replace(last, causes=after, soil=last.soil + 1.0, speed_mps=last.speed_mps + 0.4, acceleration_mps2=0.8)
    at = replace(far(granular, 0.0), before=last, point=point)
    neutral = {"a": 1.0, "b": 0.0, "c": 1.0}
    short = at.shortened(0.25, neutral).point
    assert short.causes == pytest.approx({"a": 1.75, "b": 5.0, "c": 1.5})
    np.testing.assert_allclose(short.soil - last.soil, 0.25)
    np.testing.assert_allclose(short.speed_mps - last.speed_mps, 0.1)
    assert short.acceleration_mps2 == pytest.approx(0.5)
    assert at.shortened(0.0, neutral).point.causes == before
    assert at.shortened(STEPS[0], neutral) is at


def test_where_no_step_keeps_the_samples_the_iteration_ends_unconverged(granular: LinearisedCampaign) -> None:
    def choose(grams: Grams, _: SetEstimate | None) -> SetEstimate:
        best = estimate(grams, ())
        return replace(best, soil=best.soil - 1e4)

    [at] = linearisation_points(granular.campaigns, granular.grams, granular.best)
    last = granular.campaigns[0].linear
    at = replace(at, point=last.point)
    found = relinearise(granular.starts, [at], choose, Clock(), keep_noise=True)
    assert not found.converged and len(found.chosen_sets) == 2
    assert found.campaigns[0].linear.usable.all()
    np.testing.assert_allclose(found.campaigns[0].linear.point.soil, last.point.soil)


def test_a_start_does_not_win_by_having_fewer_samples() -> None:
    seen = looked(driven("vasilev:H_m=0.04"), "vasilev")
    [data] = seen.campaigns
    right = Relinearised(seen.starts, seen.grams, seen.campaigns, seen.best, True, (seen.best.keys,))
    few = replace(data.columns, present=data.columns.present & (np.arange(len(data.samples)) < 60))
    assert few.present.any()
    emptier = replace(data, columns=few)
    lost = joined([part_of(data)], [replace(data.grams, log_determinants=np.full(data.samples.runs, -1e4))])
    wrong = Relinearised(seen.starts, lost, (emptier,), estimate(seen.grams, ()), True, ((),))
    assert log_evidence(wrong.grams) > log_evidence(right.grams, right.best.keys)
    assert most_probable([wrong, right]) is right
    assert most_probable([right, wrong]) is right


def test_a_set_is_fitted_from_where_no_sample_is_lost(granular: LinearisedCampaign) -> None:
    """A start where k_phi is below 0 is moved towards the laboratory's soil."""
    problem = set_problem(granular.campaigns, granular.grams, ())
    moved, start = set_fit._answered(problem, -3.0 * np.eye(len(granular.grams.soil))[5])
    assert moved.parts[0].frozen.usable.all()
    assert -1.0 < start[5] < 0.0 and start[5] == moved.parts[0].frozen.point.soil[5]


def explanation(keys: tuple[str, ...], soil: float) -> SetEstimate:
    return SetEstimate(keys, (), np.zeros(2), np.array([soil, 0.0]), np.eye(2))


@pytest.mark.parametrize(
    ("steps", "back"),
    [
        ((("a", 0.0), ("a", 1.0), ("a", 0.4)), True),
        ((("a", 0.0), ("a", 1.0), ("a", 1.4)), False),
        ((("a", 0.0), ("b", 1.0), ("a", 1.4)), True),
        ((("a", 0.0), ("b", 1.0), ("c", 0.4)), False),
        ((("a", 0.0), ("b", 1.0), ("b", 0.4)), False),
    ],
)
def test_an_explanation_goes_back_by_its_step_or_its_set(steps: tuple[tuple[str, float], ...], back: bool) -> None:
    first, one, other = (explanation((key,), soil) for key, soil in steps)
    assert _swings(first, one, other) is back
    assert not _swings(None, one, other)
