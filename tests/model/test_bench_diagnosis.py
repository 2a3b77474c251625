"""Diagnosis of benches with a hidden truth, and of benches that decide nothing."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from bench_samples import REPEATS, SAND, WHEEL, bench, prior
from blind.ground import Ground
from blind.wheel import Moments, Physics, Vehicle, soil_forces

from daq import ConfigError, DataError
from model.diagnosis import Diagnosis, DiagnosisOptions, Rows, compare_wheels, diagnose_bench
from model.diagnosis.single_wheel import CauseUse
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.wording.names import place_text
from wheelsoil.wording.notes import texts_of
from wheelsoil.wording.verdict import sentence_of

FEW = ("vasilev", "interface_friction", "stress_peak_shift", "drawbar_pull_zero", "load_gain", "skid_sinkage")
"""A short library: what is tested is the machine, not its length."""
TWO = ("vasilev", "interface_friction")
FOUR = (*TWO, "stress_peak_shift", "drawbar_pull_zero")


def _options(*channels: str, most: int = 1, effects: tuple[str, ...] = FEW) -> DiagnosisOptions:
    return DiagnosisOptions(channels=channels or ("dp", "z"), most_causes=most, effects=effects)


def _probability(diagnosis: Diagnosis, family: str) -> float:
    return next(c.probability for c in diagnosis.candidates if c.name == family)


def test_nothing_hidden_nothing_found() -> None:
    found = diagnose_bench([bench(np.random.default_rng(1))], _options())
    assert found.verdict == "nothing_detectable"
    assert not found.causes
    assert found.adequacy is not None
    assert found.adequacy.ok
    assert _probability(found, "none") > 0.5
    assert 0.0 < found.minimum_detectable["vasilev"].value < 0.02
    assert found.minimum_detectable["interface_friction"].value < 0.0


@pytest.mark.parametrize(
    ("key", "values", "family"),
    [
        ("vasilev", {"H_m": 0.015}, "slip_sinkage"),
        pytest.param("stress_peak_shift", {"c1": 0.3, "c2": 0.25}, "stress_peak_shift", marks=pytest.mark.slow),
    ],
)
def test_a_hidden_cause_is_named(key: str, values: dict[str, float], family: str) -> None:
    found = diagnose_bench([bench(np.random.default_rng(2), {key: values})], _options(effects=FOUR))
    assert found.verdict == "named"
    assert [cause.name for cause in found.causes] == [family]
    assert found.gain is not None
    assert found.gain.log_likelihood_gain > 0
    assert found.gain.extended["dp"].R0 < found.gain.base["dp"].R0
    for parameter in found.causes[0].parameters:
        low, high = parameter.interval95
        assert low - parameter.sigma <= values[parameter.name] <= high + parameter.sigma
    seen = found.plot_data[0]
    assert np.sqrt(np.mean((seen.measured["z"] - seen.extended["z"]) ** 2)) < 1.5e-3


@pytest.mark.slow
def test_a_cause_that_fades_beside_what_soils_usually_do_is_not_named() -> None:
    hidden = {"interface_friction": {"ln_mu": -0.7}}
    found = diagnose_bench([bench(np.random.default_rng(2), hidden)], _options(most=2))
    assert found.verdict == "one_of"
    assert {cause.name for cause in found.causes} > {"interface_friction"}
    assert _probability(found, "interface_friction") == max(c.probability for c in found.candidates)


def test_a_channel_that_is_not_used_is_predicted() -> None:
    found = diagnose_bench([bench(np.random.default_rng(3), {"vasilev": {"H_m": 0.02}})], _options("dp", effects=TWO))
    seen = found.plot_data[0]
    assert seen.unused_channels == ("z",)
    assert set(seen.implied) >= {"vasilev", "interface_friction"}
    assert np.isfinite(seen.implied["vasilev"]["z"]).all()
    assert any("which it has not seen" in note for note in texts_of(found.notes))


def test_what_no_cause_explains_is_unexplained() -> None:
    strange = bench(np.random.default_rng(4))
    rows = strange.rows
    pull = rows.drawbar_pull_n + 3.0 * np.sin(25.0 * rows.slip)
    found = diagnose_bench([replace(strange, rows=replace(rows, drawbar_pull_n=pull))], _options())
    assert found.verdict == "unexplained"
    assert not found.causes
    assert found.what_is_wrong
    assert found.what_is_wrong[0].channel == "drawbar_pull"
    assert place_text(found.what_is_wrong[0].place).startswith("slip")
    assert all(isinstance(one.place, Rows) for one in found.what_is_wrong)


@pytest.mark.slow
def test_two_benches_share_causes() -> None:
    rng = np.random.default_rng(5)
    softer = replace(SAND, name="softer", frictional_modulus=6.5e6)
    first = bench(rng, {"vasilev": {"H_m": 0.012}})
    second = bench(rng, {"vasilev": {"H_m": 0.012}}, soil=softer)
    second = replace(second, name="other", soil=softer, soil_prior=prior(soil=softer))
    found = diagnose_bench([first, second], _options())
    assert found.verdict == "named"
    assert found.causes[0].name == "slip_sinkage"
    assert [soil.campaign for soil in found.soils] == ["bench", "other"]
    assert found.soils[0].values["frictional_modulus"] > found.soils[1].values["frictional_modulus"]
    assert [seen.campaign for seen in found.plot_data] == ["bench", "other"]


def test_carrying_over_to_a_like_wheel_and_to_an_unlike_one() -> None:
    rng = np.random.default_rng(6)
    first = bench(rng, {"vasilev": {"H_m": 0.01}})
    like = compare_wheels(first, bench(rng, {"vasilev": {"H_m": 0.01}}), _options(effects=TWO))
    assert like.p_value > 0.001
    assert like.own_cause < 0.5
    assert like.measured["z"] == pytest.approx(like.predicted["z"], abs=4 * like.predicted_sigma["z"].max())
    unlike = compare_wheels(first, bench(rng, {"vasilev": {"H_m": 0.03}}), _options(effects=TWO))
    assert unlike.p_value < 1e-3
    assert unlike.own_cause > 0.95
    assert next(iter(unlike.families())) == "slip_sinkage"
    assert any(CauseUse("vasilev", 1) in w.hypothesis for w in unlike.both.sets)


@pytest.mark.slow
def test_the_same_seed_says_the_same() -> None:
    one, two = (
        diagnose_bench([bench(np.random.default_rng(7), {"vasilev": {"H_m": 0.01}})], _options()) for _ in range(2)
    )
    first, second = (json.dumps(diagnosis_json(d) | {"stages_s": None}) for d in (one, two))
    assert first == second


# --- what decides nothing --------------------------------------------------------------------------------------------


def test_no_rows() -> None:
    empty = bench(np.random.default_rng(0))
    with pytest.raises(DataError, match="no rows"):
        diagnose_bench([replace(empty, rows=empty.rows[:0])], _options())


@pytest.mark.parametrize("slips", [(0.3,), (0.1,)])
def test_too_few_conditions(slips: tuple[float, ...]) -> None:
    found = diagnose_bench([bench(np.random.default_rng(0), slips=slips)], _options())
    assert found.verdict == "nothing_detectable"
    assert "decide nothing" in sentence_of(found)
    assert "slip_sinkage" in found.not_identifiable


def test_a_channel_that_was_not_measured() -> None:
    found = diagnose_bench([bench(np.random.default_rng(0))], _options("t"))
    assert found.verdict == "nothing_detectable"
    assert "measured" in sentence_of(found)


def test_two_conditions_leave_no_gain() -> None:
    found = diagnose_bench([bench(np.random.default_rng(0), slips=(0.2, 0.8))], _options())
    assert found.gain is None
    assert found.verdict in ("nothing_detectable", "one_of")


def test_single_rows_without_repeats() -> None:
    found = diagnose_bench([bench(np.random.default_rng(0), repeats=1)], _options(effects=TWO))
    assert found.verdict in ("nothing_detectable", "one_of")
    assert found.adequacy is not None
    assert found.adequacy.ok


def test_an_exactly_known_soil() -> None:
    known = bench(np.random.default_rng(8), {"vasilev": {"H_m": 0.01}}, spread={})
    found = diagnose_bench([known], _options(effects=TWO))
    assert found.causes[0].name == "slip_sinkage"
    assert found.soils[0].sigmas["frictional_modulus"] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
def test_nan_rows_are_left_out() -> None:
    given = bench(np.random.default_rng(9), {"vasilev": {"H_m": 0.015}})
    holes = given.rows.drawbar_pull_n.copy()
    holes[::4] = np.nan
    sinkage = given.rows.sinkage_m.copy()
    sinkage[1::5] = np.nan
    rows = replace(given.rows, drawbar_pull_n=holes, sinkage_m=sinkage)
    found = diagnose_bench([replace(given, rows=rows)], _options(effects=TWO))
    assert found.causes[0].name == "slip_sinkage"


def test_a_soil_that_carries_nothing() -> None:
    weak = replace(SAND, cohesive_modulus=-1e6)
    given = replace(bench(np.random.default_rng(0)), soil=weak, soil_prior=prior(soil=weak))
    with pytest.raises(ConfigError, match="does not carry"):
        diagnose_bench([given], _options())
    soft = replace(SAND, frictional_modulus=2e4)
    given = replace(bench(np.random.default_rng(0)), soil=soft, soil_prior=prior({"tan_phi": 0.05}, soft))
    with pytest.raises(DataError, match="axle"):
        diagnose_bench([given], _options())


def test_a_rear_contact_that_grows_with_slip_is_no_gain_of_drawbar_pull() -> None:
    """Hidden by theta_2 = -0.4 (1 - exp(-s/0.3)) in the independent generator; without growth a gain led with 99 %."""
    own = bench(np.random.default_rng(3), loads_n=(25.0, 50.0))
    rows, still = own.rows, np.zeros(len(own.rows))
    vehicle = Vehicle(WHEEL.radius_m, WHEEL.width_m, outboard_kg=0.0, outboard_kgm2=0.0)
    turning = still + 0.1 / WHEEL.radius_m
    motion = (still, 0.1 * (1.0 - rows.slip), turning, still, still, rows.vertical_load_n, still, still, still)
    moments = Moments(*motion, direction=still + 1.0, passes=still + 1.0, inflation=still + 340.0, vehicle=vehicle)
    soil = (SAND.cohesion_pa, SAND.tan_phi, SAND.shear_modulus_m, SAND.sinkage_exponent, 0.0, SAND.frictional_modulus)
    physics = Physics(exit_angle=lambda slip: 0.4 * np.expm1(-slip / 0.3))
    pull, torque, sinkage = soil_forces(physics, Ground("sand", *soil), moments)
    rng = np.random.default_rng(4)
    pull, torque, sinkage = (
        true + REPEATS[channel] * rng.standard_normal(len(rows))
        for channel, true in (("dp", pull), ("t", torque), ("z", sinkage))
    )
    measured = replace(rows, drawbar_pull_n=pull, driving_torque_nm=torque, sinkage_m=sinkage)
    options = _options("dp", "t", "z", effects=("exit_angle", "exit_growth", "drawbar_pull_gain", "vasilev"))
    found = diagnose_bench([replace(own, rows=measured)], options)
    assert found.verdict == "named"
    [cause] = found.causes
    assert cause.name == "exit_angle" and cause.probability > 0.95
    assert cause.parameters[0].name == "growth" and cause.parameters[0].interval95[0] > 0.1
