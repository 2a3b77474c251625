"""The extended model as a file: written by a diagnosis, read by `fit`; a person can read it, too."""

from __future__ import annotations

import json
import shlex
import shutil
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok
from diagnosis_samples import diagnosis

from daq import ConfigError, SignalName
from daq.config import SensorSection
from daq.runs import Run
from daq.series import Series, SeriesReport
from model import ExtendedEffect, ExtendedModel
from model.diagnosis import Average, Campaign, Cause, Diagnosis, FittedSet, ParameterEstimate, SoilEstimate, considered
from model.diagnosis.time_series import coverage_of, linearise_campaigns
from model.effects import EFFECTS
from model.extended import ModelSet
from model.wheel_soil import REFERENCE_INFLATION_KPA, SOIL_PARAMETERS, SOILS, Wheel, conditions_of, prior_of
from processing import ProcessedRun, ProcessOptions
from processing.processed_run import AppliedZero
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.options import with_model
from wheelsoil.wording.names import plain_name
from wheelsoil.wording.verdict import sentence_of
from wheelsoil.workflows import (
    campaigns_of,
    diagnosis_options,
    fit_runs,
    load_model,
    model_toml,
    models_of,
    open_and_process,
)
from wheelsoil.workflows.fit import FitChoices
from wheelsoil.workflows.model_files import model_targets, refuse_mended

CLAY = SOILS["clay"]
CAMPAIGN = Campaign("clay", (), Wheel(0.47, 0.318), CLAY, prior_of(CLAY))


def effect(key: str, **values: float) -> ExtendedEffect:
    nan = float("nan")
    return ExtendedEffect(key, tuple(ParameterEstimate(n, "", v, (nan, nan), nan) for n, v in values.items()))


def written(folder: Path, *effects: ExtendedEffect, **changes: object) -> Path:
    model = replace(ExtendedModel(CAMPAIGN.wheel, CLAY, effects), **changes)
    path = folder / "model.toml"
    path.write_text(model_toml(model), encoding="utf-8")
    return path


def test_what_a_diagnosis_leaves_is_read_again_and_says_what_it_is(tmp_path):
    (model,) = models_of(diagnosis("named"), [CAMPAIGN], "balanced", "wheelsoil diagnose clay")
    path = tmp_path / "model.toml"
    path.write_text(model_toml(model), encoding="utf-8")
    again = load_model(path)
    assert again.values == {"H_m": 0.051}
    assert again.soil.cohesion_pa == 4100.0
    assert again.soil.shear_modulus_m == CLAY.shear_modulus_m, "what the data say nothing of stays the laboratory's"
    facts = tomllib.loads(path.read_text(encoding="utf-8"))["provenance"]
    assert facts["verdict"] == "named"
    assert facts["held_out_R0_reduction_percent"] == 45.0
    assert facts["command"] == "wheelsoil diagnose clay"
    head = path.read_text(encoding="utf-8").split("schema")[0]
    assert "slip sinkage (vasilev): H_m = 0.051 (0.04 to 0.06) m" in head
    assert sentence_of(diagnosis("named")) in head.replace("\n# ", " ")


def test_a_plain_number_keeps_its_digits():
    (share,) = effect("bulldozing", fraction=0.11).parameters
    model = ExtendedModel(CAMPAIGN.wheel, CLAY, (ExtendedEffect("bulldozing", (replace(share, unit="1"),)),))
    assert "bulldozing: fraction = 0.11\n" in model_toml(model)


@pytest.mark.parametrize("verdict", ["one_of", "unexplained", "nothing_detectable"])
def test_only_a_named_cause_is_put_into_it(verdict):
    (model,) = models_of(diagnosis(verdict), [CAMPAIGN], "balanced", "")
    assert model.effects == ()
    assert "No cause is named" in model_toml(model)
    assert not [fact for fact in model.provenance if fact.startswith("held_out")], (
        "the gain of causes that are not in it"
    )
    assert model.soil.cohesion_pa == (4100.0 if verdict == "nothing_detectable" else CLAY.cohesion_pa)
    assert model.soil.source == ("re-calibrated with clay" if verdict == "nothing_detectable" else CLAY.source)


def test_what_is_known_of_lyaskos_sum_is_kept(tmp_path):
    nan = float("nan")
    p = ParameterEstimate("p", "1", 0.615, (0.58, 0.64), 0.02)
    singly = tuple(ParameterEstimate(n, "1", v, (nan, nan), nan) for n, v in (("m1", 0.58), ("m2", 0.035)))
    found = diagnosis("named")
    lyasko = replace(found.causes[0], key="lyasko", form="lyasko", parameters=(p, *singly))
    (model,) = models_of(replace(found, causes=(lyasko,)), [CAMPAIGN], "balanced", "")
    path = tmp_path / "model.toml"
    path.write_text(model_toml(model), encoding="utf-8")
    assert "p = m1 + m2 = 0.615 (0.58 to 0.64)" in path.read_text(encoding="utf-8")
    again = load_model(path)
    assert again.values == {"m1": 0.58, "m2": 0.035}
    assert again.effects[0].combinations == (p,)


def test_several_campaigns_get_a_file_each(tmp_path):
    output = tmp_path / "model.toml"
    names = [path.name for path in model_targets(output, ["clay", "../sand (2)"], force=False)]
    assert names == ["model-clay.toml", "model-sand-2.toml"]
    alike = [path.name for path in model_targets(output, ["a b", "a-b"], force=False)]
    assert len(set(alike)) == 2
    (tmp_path / "model-clay.toml").touch()
    with pytest.raises(ConfigError, match="exists already"):
        model_targets(output, ["clay", "sand"], force=False)


def test_fit_takes_it_as_a_fifth_model_and_refits_its_cause(campaign, tmp_path):
    path = written(tmp_path, effect("lyasko", m1=0.3, m2=0.0), effect("torque_zero", offset_nm=25.0))
    fit = ok("fit", campaign, "--model", path, "--json").json
    assert list(fit["models"]) == ["wong", "vasilev", "lyasko", "ding", "extended"]
    extended, lyasko = fit["models"]["extended"], fit["models"]["lyasko"]
    p = lyasko["estimates"]["p"]
    assert extended["estimates"]["p"]["value"] == pytest.approx(p["value"], abs=0.02 * p["sigma"])
    assert extended["held"] == {"torque_zero.offset_nm": 25.0}, "the drawbar pull shows nothing of it"
    assert fit["models"]["wong"] == ok("fit", campaign, "--json").json["models"]["wong"]
    text = ok("fit", campaign, "--model", path).out
    assert "25 (held)" in text


def test_fit_needs_what_its_causes_need(campaign, tmp_path):
    pitching = written(tmp_path, effect("body_pitch", share=0.5))
    result = invoke("fit", campaign, "--model", pitching)
    assert result.code == 1
    assert "needs body_pitch_rad, which these data do not have" in result.err
    drifting = written(tmp_path, effect("zero_drift", campaign_span_n=100.0))
    extended = ok("fit", campaign, "--model", drifting, "--json").json["models"]["extended"]
    assert abs(extended["estimates"]["zero_drift.campaign_span_n"]["value"]) < 400


def test_a_bench_table_has_no_clock(tmp_path):
    (tmp_path / "wheel.toml").write_text("[wheel]\nradius_m = 0.47\nwidth_m = 0.318\n")
    rows = [f"{s / 10},8000,{100 + 300 * s / 10}" for s in range(1, 10)]
    (tmp_path / "rows.csv").write_text("\n".join(["slip,vertical_load_n,drawbar_pull_n", *rows]))
    table = ["fit", "--table", tmp_path / "rows.csv", "--vehicle", tmp_path / "wheel.toml", "--soil", "clay"]
    result = invoke(*table, "--model", written(tmp_path, effect("zero_drift", campaign_span_n=100.0)))
    assert result.code == 1
    assert "needs campaign_time" in result.err
    known = ok(*table, "--model", written(tmp_path, effect("vasilev", H_m=0.01)), "--json").json
    assert known["models"]["extended"]["estimates"]["H_m"]["value"] == pytest.approx(
        known["models"]["vasilev"]["estimates"]["H_m"]["value"], rel=1e-3, abs=1e-6
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 'wheelsoil/model/1'\n", ("key 'wheel' is missing", "key 'soil' is missing")),
        ("not toml", ("not valid TOML",)),
        ("schema = 'wheelsoil/model/9'\n", ("schema",)),
    ],
)
def test_a_wrong_file_says_everything_that_is_wrong(text, said, campaign, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(text)
    result = invoke("fit", campaign, "--model", path)
    assert result.code == 2
    assert "Traceback" not in result.err
    for words in said:
        assert words in result.err


def test_readings_do_not_mix(campaign, tmp_path):
    path = written(tmp_path, effect("vasilev", H_m=0.01), reading="literal")
    result = invoke("fit", campaign, "--model", path)
    assert result.code == 2
    assert "add --sinkage literal" in result.err


def test_simulate_drives_over_it(tmp_path):
    soil = replace(CLAY, name="re-calibrated clay", cohesion_pa=3900.0)
    model = written(
        tmp_path,
        effect("vasilev", H_m=0.02),
        effect("drawbar_pull_zero", offset_n=80.0),
        wheel=Wheel(0.4, 0.25),
        soil=soil,
        soil_sigmas={"cohesion_pa": 390.0},
    )
    ok(
        "simulate",
        "--model",
        model,
        "-o",
        tmp_path / "a",
        "--runs",
        1,
        "--duration",
        15,
        "--effect",
        "vasilev:H_m=0.03",
    )
    manifest = tomllib.loads((tmp_path / "a" / "manifest.toml").read_text())
    truth = manifest["truth"]
    assert truth["wheel"] == {"radius_m": 0.4, "width_m": 0.25}
    assert truth["soil"]["cohesion_pa"] == pytest.approx(3900.0)
    assert {e["name"]: e["parameters"] for e in truth["effect"]} == {
        "vasilev": {"H_m": 0.03},
        "drawbar_pull_zero": {"offset_n": 80.0},
    }
    terrain = tomllib.loads((tmp_path / "a" / "terrain.toml").read_text())
    assert terrain["soil"]["name"] == "re-calibrated clay"
    assert terrain["uncertainty"]["cohesion_kpa"] == pytest.approx(0.1)
    ok(*shlex.split(manifest["command"])[1:], "-o", tmp_path / "b")
    again = tomllib.loads((tmp_path / "b" / "manifest.toml").read_text())
    assert [run["frames_sha256"] for run in again["run"]] == [run["frames_sha256"] for run in manifest["run"]]


def test_simulate_takes_soil_and_wheel_from_one_place(tmp_path):
    model = written(tmp_path)
    result = invoke("simulate", "--model", model, "-o", tmp_path / "x", "--soil", "sandy", "--radius", 0.4)
    assert result.code == 2
    assert "--soil, --radius" in result.err


VALUES = {name: float(getattr(CLAY, name)) for name in SOIL_PARAMETERS}


def in_doubt() -> Diagnosis:
    """Return a diagnosis that leaves slip sinkage at its upper bound, and no cause; its gain is the average's."""
    found = diagnosis("one_of")
    worth = replace(found.gain, reduction_percent=21.0, log_likelihood_gain=34.0)
    top = replace(found.causes[0], parameters=(ParameterEstimate("H_m", "m", 0.5 + 1e-12, (0.3, 0.5), 0.1),))
    soft = SoilEstimate("clay", VALUES | {"cohesion_pa": 6000.0}, {"cohesion_pa": 300.0})
    known = ("cohesion_pa", "H_m")
    sets = (
        FittedSet(0.6, (top,), (soft,), known, (np.diag([300.0**2, 0.1**2]),)),
        FittedSet(0.1, (), (SoilEstimate("clay", VALUES, {}),), ("cohesion_pa",), (np.diag([200.0**2]),)),
    )
    return replace(found, average=Average(sets, 0.3, worth))


def test_what_is_not_decided_is_kept_as_sets_and_claims_what_their_average_gains(tmp_path):
    (model,) = models_of(in_doubt(), [CAMPAIGN], "balanced", "wheelsoil diagnose clay")
    path = tmp_path / "model.toml"
    path.write_text(model_toml(model), encoding="utf-8")
    again = load_model(path)
    assert again == model
    assert (again.soil, again.rest_probability) == (CLAY, 0.3)
    assert [(one.probability, one.soil["cohesion_pa"]) for one in again.sets] == [(0.6, 6000.0), (0.1, 7580.0)]
    assert again.sets[0].effects[0].values == {"H_m": 0.5}, "a rounding error beyond the bound could not be read"
    assert again.sets[0].sigmas == {"cohesion_pa": 300.0, "H_m": 0.1}
    facts = tomllib.loads(path.read_text(encoding="utf-8"))["provenance"]
    assert facts["held_out_R0_reduction_percent"] == 21.0, "of the average, not of the first set"
    head = path.read_text(encoding="utf-8").split("schema")[0].replace("\n# ", " ")
    assert "60.0 %: slip sinkage (vasilev): H_m = 0.5 (0.3 to 0.5) m" in head
    assert "10.0 %: no cause" in head
    assert "the error of drawbar pull falls by 21" in head
    assert "30.0 % of the probability is of sets that are not here" in head


def test_a_name_beside_which_another_cause_acts_claims_what_the_sets_with_it_gain():
    doubt, found = in_doubt(), diagnosis("named")
    beside = replace(found, average=doubt.average, grounds=replace(found.grounds, beside=("bulldozing", "slope")))
    (model,) = models_of(beside, [CAMPAIGN], "balanced", "")
    again = ExtendedModel.from_mapping(tomllib.loads(text := model_toml(model)))
    assert again == model and again.sets == models_of(doubt, [CAMPAIGN], "balanced", "")[0].sets
    assert model.provenance["held_out_R0_reduction_percent"] == 21.0, "not that of causes chosen anew in each fold"
    assert "falls by 21" in str(model.provenance["sentence"])
    assert "What acts beside the named causes is not decided: 2 sets" in text.replace("\n# ", " ")
    assert "No cause is named" not in text


def test_a_campaign_that_was_left_out_keeps_the_laboratorys_soil():
    other = replace(CAMPAIGN, name="sand")
    (clay, sand) = models_of(in_doubt(), [CAMPAIGN, other], "balanced", "")
    assert clay.sets and not sand.sets
    assert (sand.soil, sand.effects) == (CLAY, ())


def sets_of(*given: tuple[float, float, tuple[ExtendedEffect, ...]]) -> tuple[ModelSet, ...]:
    return tuple(
        ModelSet(p, VALUES | {"cohesion_pa": c}, effects, ("cohesion_pa",), ((300.0**2,),)) for p, c, effects in given
    )


def test_fit_takes_the_average_as_it_is(campaign, tmp_path):
    law, offset = effect("vasilev", H_m=0.02), effect("torque_zero", offset_nm=25.0)
    sets = sets_of((0.6, 6000.0, (law,)), (0.4, 9000.0, (law, offset)))
    path = written(tmp_path, sets=sets)
    fit = ok("fit", campaign, "--model", path, "--soil-prior", "--json").json
    extended = fit["models"]["extended"]
    assert (extended["estimates"], extended["held"], extended["stop_reason"]) == ({}, {}, "nothing_to_fit")
    assert extended["effects"] == ["vasilev", "torque_zero"]
    assert extended["predicted_sigma"]["dp"] > 1.0
    assert "predicted_sigma" not in fit["models"]["wong"]
    assert "the average of 2 sets of causes" in str(extended["warnings"])


@pytest.mark.slow
def test_a_report_has_the_average_with_its_band(campaign, tmp_path):
    sets = sets_of((0.6, 6000.0, (effect("vasilev", H_m=0.02),)), (0.4, 9000.0, ()))
    options = ["--model", written(tmp_path, sets=sets), "--no-diagnosis", "-o", tmp_path / "report.html"]
    numbers = ok("report", campaign, *options, "--json").json
    assert "the average of 2 sets of causes" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "extended" in str(numbers)


def test_sets_need_what_their_causes_need(campaign, tmp_path):
    sets = sets_of((0.9, 7000.0, ()), (0.1, 7000.0, (effect("body_pitch", share=0.5),)))
    result = invoke("fit", campaign, "--model", written(tmp_path, sets=sets))
    assert result.code == 1
    assert "body_pitch needs body_pitch_rad, which these data do not have" in result.err


def test_fit_takes_every_cause_that_a_diagnosis_of_the_same_runs_weighs(processed):
    """A tyre's pressure that no run states is the usual one in both."""
    (campaign,) = campaigns_of([], processed)
    read = linearise_campaigns((campaign,), diagnosis_options()).campaigns[0].samples
    causes = considered(coverage_of(campaign, read), tuple(EFFECTS), "balanced")
    assert "tyre_flattening" in [cause.key() for cause in causes]
    at_start = [effect(cause.key(), **{p.name: p.start for p in cause.parameters}) for cause in causes]
    one_each = sets_of(*((1 / len(at_start), 7000.0, (each,)) for each in at_start))
    fit = fit_runs(processed, FitChoices(extended=ExtendedModel(CAMPAIGN.wheel, CLAY, sets=one_each)), None)
    assert fit.models[-1].criteria["dp"].samples == fit.models[0].criteria["dp"].samples > 100
    [used] = {float(c) for c in conditions_of(campaign.runs, 16_500.0)[0].inflation_kpa}
    assert used == REFERENCE_INFLATION_KPA


def test_simulate_drives_one_set_which_its_seed_draws(tmp_path):
    law, offset = effect("vasilev", H_m=0.02), effect("drawbar_pull_zero", offset_n=80.0)
    model = written(tmp_path, sets=sets_of((0.5, 6000.0, (law, offset)), (0.5, 9000.0, ())))
    drawn = [with_model(SimulationOptions(seed=seed), model, ()) for seed in range(60)]
    soft = [one.laboratory_soil.cohesion_pa == pytest.approx(6000.0) for one in drawn]
    assert 15 < sum(soft) < 45
    for one, has_law in zip(drawn, soft, strict=True):
        assert one.effects == ({"vasilev": {"H_m": 0.02}} if has_law else {}), "no error of a sensor is driven"
    words = shlex.split(drawn[0].command)
    assert words[words.index("--seed") + 1] == "0" and str(model) in words, "the command draws the same set again"


@pytest.mark.parametrize("command", ["fit", "report"])
def test_a_file_of_another_wheel_is_refused_with_both_sizes(campaign, tmp_path, command):
    path = written(tmp_path, wheel=Wheel(0.058, 0.05))
    to = ("-o", tmp_path / "r.html", "--no-diagnosis") if command == "report" else ()
    result = invoke(command, campaign, "--model", path, *to)
    assert result.code == 2 and "another wheel" in result.err
    assert "radius 0.058 m, width 0.05 m" in result.err and "radius 0.47 m" in result.err


@pytest.fixture(scope="module")
def processed(campaign: Path) -> list[tuple[Run, ProcessedRun]]:
    return open_and_process([campaign], ProcessOptions(purpose="diagnose"))


def made(runs: Sequence[tuple[Run, ProcessedRun]], *causes: str) -> ExtendedModel:
    """Return the model of a diagnosis of these runs that names some causes, read back from its file."""
    named = []
    for key in causes:
        one = EFFECTS[key]
        sizes = effect(key, **{p.name: p.start for p in one.parameters}).parameters
        named.append(Cause(one.name, one.form, one.kind, key, 1.0, 1.0, sizes))
    found = replace(diagnosis("named"), causes=tuple(named), average=None)
    (model,) = models_of(found, campaigns_of([], runs), "balanced", "", runs)
    return ExtendedModel.from_mapping(tomllib.loads(model_toml(model)))


MENDED_BY = {
    "speed_latency": "[sensors.ground_speed] latency_s",
    "speed_bias": "scale of ground_speed",
    "wheel_radius": "[wheel] rolling_radius_m",
    "drawbar_pull_gain": "scale of drawbar_pull",
    "torque_gain": "scale of driving_torque",
    "load_gain": "scale of vertical_load",
    "crosstalk": "[transducer] angle_offset_deg",
    "drawbar_pull_zero": "zero of drawbar_pull",
    "torque_zero": "zero of driving_torque",
    "load_zero": "zero of vertical_load",
    "zero_drift": "zero of drawbar_pull",
    "body_pitch": "scale of drawbar_pull",
    "wheel_inertia": "[wheel] outboard_mass_kg",
}


def otherwise(run: Run, done: ProcessedRun, name: str) -> tuple[Run, ProcessedRun]:
    """Return a run with another value of what is declared."""
    vehicle, wheel = run.vehicle, run.vehicle.wheel
    assert wheel is not None
    section, _, key = name.rpartition(" ")
    if section == "zero of":
        zero = AppliedZero(12.0, float("nan"), 1.0, ("spin",), ("spin.mcap",), (60.0,))
        return run, replace(done, quality=replace(done.quality, zeros={key: zero}))
    if section == "scale of":
        name = SignalName(signal=vehicle.signals[key].signal, sign=-vehicle.signals[key].sign)
        return replace(run, vehicle=vehicle.model_copy(update={"signals": vehicle.signals | {key: name}})), done
    parts = {
        "[wheel]": {"wheel": wheel.model_copy(update={key: 0.99 * (getattr(wheel, key, None) or wheel.radius_m)})},
        "[transducer]": {"transducer": vehicle.transducer.model_copy(update={key: "spin" if key == "zero" else 1.5})},
    }
    role = section.removeprefix("[sensors.").removesuffix("]")
    late = {"sensors": vehicle.sensors | {role: SensorSection(latency_s=vehicle.latency_s(role) + 0.25)}}
    return replace(run, vehicle=vehicle.model_copy(update=parts.get(section, late))), done


def test_every_error_of_measurement_counts_from_what_the_report_mends(processed):
    """Whoever mends it in vehicle.toml, a DBC or by a zero file has it corrected twice by the file."""
    errors = [effect for effect in EFFECTS.values() if effect.kind == "measurement" or effect.remedy]
    assert {effect.key() for effect in errors} == MENDED_BY.keys(), "a new one: what mends it?"
    for each in errors:
        model = made(processed, each.key())
        names = [name for _, name, _ in model.provenance["counted_from"]]
        assert MENDED_BY[each.key()] in names and len(set(names)) == len(names)
        refuse_mended(model, processed)
        for name in names:
            with pytest.raises(ConfigError) as refused:
                refuse_mended(model, [otherwise(*processed[0], name)])
            faults = [fault for fault in refused.value.faults if f"and {name} has changed" in fault.what]
            assert len(faults) == 1 and faults[0].found != faults[0].expected and "diagnose anew" in faults[0].next_step
            assert plain_name(each.key()) in faults[0].what and str(faults[0].where).endswith("vehicle.toml")
    others = [effect.key() for effect in EFFECTS.values() if effect not in errors]
    assert all("counted_from" not in made(processed, key).provenance for key in others)


def test_what_an_error_does_not_count_from_may_change(processed):
    """A gain outlives the zero of another day, and a latency the gain's scale."""
    gain, late = made(processed, "torque_gain"), made(processed, "speed_latency")
    refuse_mended(gain, [otherwise(*processed[0], "zero of driving_torque")])
    refuse_mended(gain, [otherwise(*processed[0], "[sensors.ground_speed] latency_s")])
    refuse_mended(late, [otherwise(*processed[0], "scale of driving_torque")])
    for provenance in ({}, {"counted_from": ("[sensors.ground_speed] latency_s = 0.07",)}):  # older files
        old = ExtendedModel.from_mapping(replace(late, provenance=provenance).to_mapping())
        refuse_mended(old, [otherwise(*processed[0], "[sensors.ground_speed] latency_s")])


@pytest.mark.parametrize("first", [0, 1])
def test_runs_with_and_without_a_dbc_make_one_model(processed, first):
    members = list(processed[:2])
    members[first] = (replace(members[first][0], databases={}), members[first][1])
    rows = made(members, "torque_gain").provenance["counted_from"]
    assert [name for _, name, _ in rows if name.startswith("scale")] == ["scale of driving_torque"]


@pytest.mark.parametrize(("unit", "sign"), [("kN m", 1), ("N m", -1)])
def test_a_gain_of_a_table_is_not_corrected_twice(processed, unit, sign):
    """No DBC says its scale: what vehicle.toml makes of the unit of the file does."""
    units = {"driving_torque": "N m", "drawbar_pull": "N", "vertical_load": "N"}
    series = Series({"table": units}, lambda: iter(()), SeriesReport("run.csv", "csv"))

    def of_table(run: Run, **torque: object) -> Run:
        names = {role: SignalName(signal=role) for role in units}
        names["driving_torque"] = SignalName(signal="driving_torque", **torque)
        return replace(run, series=series, databases={}, vehicle=run.vehicle.model_copy(update={"signals": names}))

    members = [(of_table(run), done) for run, done in processed]
    model = made(members, "torque_gain")
    assert ("", "unit and sign of driving_torque", "times 1") in model.provenance["counted_from"]
    same = of_table(members[0][0], unit="N m")
    refuse_mended(model, [members[0], (same, members[0][1]), processed[0]])
    with pytest.raises(ConfigError, match="unit and sign of driving_torque has changed"):
        refuse_mended(model, [(of_table(members[0][0], unit=unit, sign=sign), members[0][1])])


@pytest.mark.parametrize("command", ["fit", "report"])
def test_a_latency_that_was_mended_is_not_corrected_twice(campaign, processed, tmp_path, command):
    model = tmp_path / "model.toml"
    model.write_text(model_toml(made(processed, "speed_latency")), encoding="utf-8")
    to = ("-o", tmp_path / "r.html", "--no-diagnosis") if command == "report" else ()
    text = (campaign / "vehicle.toml").read_text(encoding="utf-8")
    mended = tmp_path / "mended"
    shutil.copytree(campaign, mended, dirs_exist_ok=True)
    declared = "[sensors.ground_speed]\nlatency_s = 0.07\n"
    assert declared in text
    (mended / "vehicle.toml").write_text(text.replace(declared, declared.replace("0.07", "0.17")), encoding="utf-8")
    result = invoke(command, mended, "--model", model, *to)
    assert result.code == 2 and "speed latency, and [sensors.ground_speed] latency_s has changed" in result.err
    assert "found: 0.17" in result.err and "expected: 0.07" in result.err and "put the value back" in result.err
    ok(command, campaign, "--model", model, *to)


def test_the_file_of_a_single_wheel_without_an_error_of_measurement_says_no_more_than_before(processed):
    model = made(processed, "vasilev")
    assert not {"wheel", "counted_from"} & model.provenance.keys()


def test_a_model_of_another_soil_is_said(campaign, tmp_path):
    path = written(tmp_path, effect("vasilev", H_m=0.02), soil=replace(CLAY, name="north field"))
    said = "the model file is of soil north field, and this is soil clay"
    assert said in ok("fit", campaign, "--model", path).err
    assert "north field" not in ok("fit", campaign, "--model", written(tmp_path, effect("vasilev", H_m=0.02))).err
    page = tmp_path / "report.html"
    ok(
        "report",
        campaign,
        "--model",
        written(tmp_path, soil=replace(CLAY, name="north field")),
        "--no-diagnosis",
        "-o",
        page,
    )
    assert said in page.read_text(encoding="utf-8")


def test_a_report_keeps_its_fits_without_a_model_that_a_table_cannot_use(tmp_path):
    (tmp_path / "wheel.toml").write_text("[wheel]\nradius_m = 0.47\nwidth_m = 0.318\n")
    rows = [f"{s / 10},8000,{100 + 300 * s / 10}" for s in range(1, 10)]
    (tmp_path / "rows.csv").write_text("\n".join(["slip,vertical_load_n,drawbar_pull_n", *rows]))
    late = written(tmp_path, effect("speed_latency", extra_delay_s=0.2))
    table = ("--table", tmp_path / "rows.csv", "--vehicle", tmp_path / "wheel.toml", "--soil", "clay", "--no-diagnosis")
    found = ok("report", *table, "--model", late, "-o", tmp_path / "r.html", "--json")
    numbers = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert found.json["left_out"].keys() == {"sinkage"}, "of rows without torque"
    assert "the model file is not used: effect speed_latency needs ground_speed_mps" in found.err.replace("\n  ", " ")
    assert "the model file is not used" in (tmp_path / "r.html").read_text(encoding="utf-8")
    ok("report", *table, "-o", tmp_path / "plain.html")
    plain = json.loads((tmp_path / "plain.json").read_text(encoding="utf-8"))
    assert numbers["sections"]["criteria"] == plain["sections"]["criteria"]


OF_FR = {"provenance": {"wheel": "FR"}}


def test_the_error_of_one_wheel_is_driven_at_that_wheel(tmp_path):
    causes = (effect("torque_gain", relative=0.06), effect("speed_bias", offset_mps=0.1), effect("vasilev", H_m=0.02))
    path = written(tmp_path, *causes, **OF_FR)
    four = with_model(SimulationOptions(wheels=4), path, ["wheels"])
    assert list(four.effects) == ["torque_gain@FR", "speed_bias", "vasilev"], "receiver and soil are of all wheels"
    assert list(with_model(SimulationOptions(), path, ()).effects) == ["torque_gain", "speed_bias", "vasilev"]
    given = SimulationOptions(wheels=4, effects={"torque_gain": {"relative": 0.2}})
    assert "torque_gain@FR" not in with_model(given, path, ["wheels"]).effects, "given effects override the file's"
    with pytest.raises(ConfigError, match="not simulated"):
        with_model(SimulationOptions(wheels=2), path, ["wheels"])


def test_the_errors_of_a_file_may_be_those_of_a_faulty_wheel(tmp_path):
    path = written(tmp_path, effect("torque_gain", relative=0.06))
    folder = ("--runs", 1, "--duration", 15, "--wheels", 4, "-o", tmp_path / "c")
    ok("simulate", "--model", path, "--faulty-wheel", "FR", *folder)
    truth = tomllib.loads((tmp_path / "c" / "manifest.toml").read_text())["truth"]
    assert truth["faulty_wheel"] == "FR" and [each["name"] for each in truth["effect"]] == ["torque_gain"]
    alone = written(tmp_path, effect("torque_gain", relative=0.06), **OF_FR)
    wrong = invoke("simulate", "--model", alone, "--faulty-wheel", "FL", *folder, "--force")
    assert wrong.code == 2 and "no error of measurement is given for wheel FL" in wrong.err


def test_the_manifest_says_which_set_was_drawn(tmp_path):
    law, offset = effect("vasilev", H_m=0.02), effect("drawbar_pull_zero", offset_n=80.0)
    model = written(tmp_path, sets=sets_of((0.7, 6000.0, (law, offset)), (0.3, 9000.0, ())))
    said = {with_model(SimulationOptions(seed=seed), model, ()).model_set for seed in range(20)}
    assert said == {"1 of 2 (70 %): vasilev + drawbar_pull_zero", "2 of 2 (30 %): no cause"}
    made = ok("simulate", "--model", model, "--runs", 1, "--duration", 15, "-o", tmp_path / "c")
    drawn = tomllib.loads((tmp_path / "c" / "manifest.toml").read_text())["truth"]["model_set"]
    assert drawn in said and f"drives set {drawn}" in made.err
