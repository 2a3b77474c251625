"""The extended model as a file: written by a diagnosis, read by `fit`; a person can read it, too."""

from __future__ import annotations

import shlex
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import invoke, ok
from diagnosis_samples import diagnosis

from daq.errors import ConfigError
from model.diagnosis.core.campaign import Campaign
from model.diagnosis.core.result import ParameterEstimate
from model.extended import ExtendedEffect, ExtendedModel
from model.wheel_soil.conditions import Wheel
from model.wheel_soil.soils import SOILS, prior_of
from wheelsoil.wording.verdict import sentence_of
from wheelsoil.workflows.model_files import load_model, model_targets, model_toml, models_of

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
    flat = written(tmp_path, effect("tyre_flattening", radius_gain=0.1))
    result = invoke("fit", campaign, "--model", flat)
    assert result.code == 1
    assert "needs inflation_kpa, which these data do not have" in result.err
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
