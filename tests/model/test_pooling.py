"""Passports of transducers, from information that is made of sampled rows: no formula of the pooling's own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from model.diagnosis import Information
from model.diagnosis.pooling import Observation, passport_of, soil_departure

EFFECTS = ("lyasko", "drawbar_pull_gain", "torque_gain", "load_gain", "drawbar_pull_zero")
SCALES = (0.1, 0.08, 0.06, 0.06, 150.0)
NOISE = 0.25
SOIL = ("cohesion_pa", "tan_phi", "shear_modulus_m")


def campaign(
    seed: int,
    years: float,
    sizes: Mapping[str, float] | None = None,
    soil: tuple[float, ...] | None = None,
    about: tuple[str, ...] = (),
) -> Observation:
    """A campaign of 400 rows; sizes in the parameters' units, the soil drawn."""
    rng = np.random.default_rng(seed)
    slip, load = rng.uniform(0, 0.8, 400), rng.choice([0.7, 1.3], 400)
    pull = 60 * (1 - np.exp(-8 * slip)) * load
    own = np.stack([2 * load, pull / pull.max() + load, 8 * slip * np.exp(-5 * slip)], axis=1)
    causes = np.stack([40 * slip**2, pull, 40 * slip + 20 * load, 6 * load**2, np.full(400, 0.05)], axis=1)
    truth = np.array([(sizes or {}).get(key, 0.0) for key in EFFECTS])
    drawn = rng.standard_normal(3) if soil is None else np.array(soil)
    rows = own @ drawn + causes @ truth + NOISE * rng.standard_normal(400)
    columns = np.concatenate([rows[:, None], own, causes * SCALES], axis=1) / NOISE
    information = Information(
        soil=SOIL,
        effects=EFFECTS,
        parameters=("m1", "relative", "relative", "relative", "offset_n"),
        units=("1", "1", "1", "1", "N"),
        scales=SCALES,
        neutrals=(0.0,) * 5,
        one_sided=(True, False, False, False, False),
        matrix=columns.T @ columns,
        samples=400,
        about=about,
    )
    return Observation(f"day {seed}", years, information)


def year(seed: int, per_year: float = 0.0, start: float = 0.0, key: str = "drawbar_pull_gain") -> list[Observation]:
    """Twelve campaigns of a year."""
    times = np.random.default_rng(seed).uniform(0, 1, 12)
    return [campaign(100 * seed + i, t, {key: start + per_year * t}) for i, t in enumerate(times.tolist())]


def test_a_drift_is_named_with_its_size() -> None:
    found = passport_of("7", year(1, per_year=0.3))
    assert found.decision == "named" and found.effects == ("drawbar_pull_gain",) and found.wrong > 0.999
    [first, *_] = found.candidates
    assert first.effect == "drawbar_pull_gain" and first.drifts > 0.95
    trend = found.trends["drawbar_pull_gain"]
    assert trend.per_year[0] == pytest.approx(0.3, abs=3 * trend.per_year[1]) and trend.per_year[1] < 0.02
    middle, low, high = trend.value(trend.middle)
    assert low < 0.3 * trend.middle < high and middle == trend.at[0]
    assert (trend.parameter, trend.unit) == ("relative", "1") and len(trend.points) == 12


def test_a_constant_error_is_no_drift() -> None:
    found = passport_of("7", year(2, start=0.05, key="torque_gain"))
    [first, *_] = found.candidates
    assert found.effects == ("torque_gain",) and first.drifts < 0.3 * first.probability


def test_sound_transducers_are_not_flagged_and_intervals_cover() -> None:
    misses = 0
    for seed in range(3, 43):
        found = passport_of("7", year(seed))
        assert found.decision == "nothing" and found.effects == ()
        misses += (
            abs(found.trends["drawbar_pull_gain"].per_year[0]) > 1.96 * found.trends["drawbar_pull_gain"].per_year[1]
        )
    assert misses <= 6  # of 40 at 95 %; 7 or more in 0.3 %


def test_the_order_of_campaigns_does_not_matter() -> None:
    campaigns = year(1, per_year=0.02)
    one, other = passport_of("7", campaigns), passport_of("7", campaigns[::-1])
    assert one.campaigns == other.campaigns and one.wrong == pytest.approx(other.wrong, rel=1e-9)


def test_campaigns_that_do_not_show_a_channel_say_nothing_of_it() -> None:
    def blind(one: Observation) -> Observation:
        keep = [i for i in range(9) if i != 4 + EFFECTS.index("torque_gain")]
        names = {name: getattr(one.information, name) for name in vars(one.information)}
        for name in ("effects", "parameters", "units", "scales", "neutrals", "one_sided"):
            names[name] = tuple(v for v, key in zip(names[name], EFFECTS, strict=True) if key != "torque_gain")
        return Observation(
            one.campaign, one.years, Information(**names | {"matrix": names["matrix"][np.ix_(keep, keep)]})
        )

    found = passport_of("7", [blind(one) for one in year(1, per_year=0.3)])
    assert "torque_gain" not in found.trends and found.effects == ("drawbar_pull_gain",)
    assert passport_of("7", []).decision == "nothing"


def test_a_campaign_that_is_not_as_the_others_is_told_apart() -> None:
    campaigns = [*year(5), campaign(999, 0.5, {"drawbar_pull_gain": 0.2})]
    assert list(passport_of("7", campaigns).disagree) == ["day 999"]
    assert not passport_of("7", campaigns[:-1]).disagree


def test_a_campaign_s_own_cause_is_no_fault_of_the_transducer() -> None:
    sunk = [campaign(700 + i, i / 12, {"lyasko": 0.2}, about=("lyasko",)) for i in range(12)]
    assert passport_of("7", sunk).decision == "nothing"


def test_what_all_campaigns_share_may_be_the_wheel_s_or_the_soil_s() -> None:
    found = passport_of("7", [campaign(500 + i, i / 12, {"lyasko": 0.04}) for i in range(12)])
    assert found.decision == "nothing" and found.shared[0].effect == "lyasko" and found.shared[0].probability > 0.9
    sound = passport_of("7", year(9))
    assert sound.shared[0].probability < 0.5


def test_scatter_between_campaigns_is_no_drift() -> None:
    rng = np.random.default_rng(8)
    sizes = 0.01 * rng.standard_normal(12)
    found = passport_of("7", [campaign(800 + i, i / 12, {"drawbar_pull_gain": x}) for i, x in enumerate(sizes)])
    assert found.decision == "nothing" and found.scatter > passport_of("7", year(8)).scatter


def test_a_soil_that_is_not_the_laboratory_s_is_seen() -> None:
    near = [soil_departure(campaign(900 + i, 0.0)).p_value for i in range(40)]
    assert 0.2 < np.median(near) < 0.8 and min(near) > 1e-4
    far = soil_departure(campaign(1, 0.0, soil=(0.0, 4.0, 0.0)))
    assert far.p_value < 0.01 and max(far.sigmas, key=lambda name: abs(far.sigmas[name])) == "tan_phi"
    known = {"drawbar_pull_gain": 0.3}
    wrong = campaign(2, 0.0, {"drawbar_pull_gain": 0.3}, soil=(0.0, 0.0, 0.0))
    assert soil_departure(wrong, known).p_value > 10 * soil_departure(wrong).p_value
