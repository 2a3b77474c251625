"""What a cause costs, and what differs from an earlier report."""

from __future__ import annotations

import json
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq import ConfigError, VehicleConfig
from model.diagnosis import Cause, ParameterEstimate, SoilEstimate
from model.effects import EFFECTS
from model.wheel_soil import SOILS, Wheel
from wheelsoil.wording.change_text import change_row, change_summary, of_another_thing
from wheelsoil.workflows.cause_cost import Driving, costs_of
from wheelsoil.workflows.last_report import changes_since, load_last, subject_of

CLAY = SOILS["clay"]
NO_SOIL = SoilEstimate("clay", {}, {})


def cause(key: str, value: float, interval: tuple[float, float]) -> Cause:
    [parameter] = EFFECTS[key].parameters
    size = ParameterEstimate(parameter.name, parameter.unit, value, interval, 1.0)
    return Cause(EFFECTS[key].name, "", EFFECTS[key].kind, key, 0.99, 1.0, (size,))


def test_a_torque_zero_costs_no_pull_and_shows_its_size_in_the_torque() -> None:
    found, best_slip = costs_of(
        [cause("torque_zero", 80.0, (70.0, 90.0))], Wheel(0.47, 0.318), CLAY, NO_SOIL, Driving(9e3, 2)
    )
    by = {(one.quantity, one.slip): one for one in found}
    assert by["drawbar_pull", 0.2].difference == 0.0
    assert by["driving_torque", 0.2].difference == pytest.approx(80.0)
    assert by["driving_torque", 0.2].difference95 == pytest.approx((70.0, 90.0))
    assert len(found) == 8 and found[-1].slip == best_slip > 0.2


def test_slip_sinkage_costs_pull_and_efficiency() -> None:
    size = ParameterEstimate("H_m", "m", 0.05, (0.04, 0.06), 5e-3)
    sinkage = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.99, 1.0, (size,))
    found, _ = costs_of([sinkage], Wheel(0.47, 0.318), CLAY, NO_SOIL, Driving(9e3, 2), highest_slip=0.807)
    pulls = [one for one in found if one.quantity == "drawbar_pull"]
    deeper = {one.slip: one.difference for one in found if one.quantity == "sinkage"}
    assert all(one.difference < 0 for one in found if one.quantity in ("drawbar_pull", "tractive_efficiency"))
    assert deeper[0.8] > deeper[0.2] > 0 and deeper[0.8] == pytest.approx(0.05 * 0.8, rel=0.1)
    assert all(one.difference95[0] < one.difference < one.difference95[1] < 0 for one in pulls)


def test_opposite_causes_do_not_cancel_each_others_uncertainty() -> None:
    size = ParameterEstimate("H_m", "m", 0.05, (0.04, 0.06), 5e-3)
    sinkage = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.99, 1.0, (size,))
    zero = cause("drawbar_pull_zero", 80.0, (70.0, 90.0))

    def sides(*causes: Cause) -> tuple[float, float]:
        found, _ = costs_of(causes, Wheel(0.47, 0.318), CLAY, NO_SOIL, Driving(9e3, 2))
        pull = next(one for one in found if one.quantity == "drawbar_pull")
        return pull.difference - pull.difference95[0], pull.difference95[1] - pull.difference

    together = np.hypot(sides(sinkage), sides(zero))
    assert sides(sinkage, zero) == pytest.approx(together, rel=0.02)
    assert min(together) > 12 and max(together) < 19


def test_of_terms_that_are_known_together_the_cost_has_an_interval() -> None:
    size = ParameterEstimate("p", "1", 0.6, (0.5, 0.7), 0.05)
    terms = [ParameterEstimate(name, "1", value, (nan, nan), nan) for name, value in (("m1", 0.5), ("m2", 0.1))]
    lyasko = Cause("slip_sinkage", "lyasko", "physical", "lyasko", 0.99, 1.0, (size, *terms))
    found, _ = costs_of([lyasko], Wheel(0.47, 0.318), CLAY, NO_SOIL, Driving(9e3, 2))
    assert all(one.difference95[0] < one.difference < one.difference95[1] for one in found)


def sections(tan_phi: float, zero: tuple[float, float] | None, pull: float) -> dict[str, Any]:
    sizes = (
        [{"name": "offset_nm", "unit": "N m", "value": zero[0], "interval95": [zero[0] - zero[1], zero[0] + zero[1]]}]
        if zero
        else []
    )
    return {
        "fit": {
            "soils": [{"campaign": f"day {tan_phi}", "values": {"tan_phi": tan_phi}, "sigmas": {"tan_phi": 0.01}}],
            "traction": {"pull": {"pull_n": pull, "interval95": [pull - 30.0, pull + 30.0]}},
        },
        "causes": {"causes": [{"name": "torque_zero", "parameters": sizes}] if sizes else []},
        "runs": {"run-1": {"usable_share": 0.9, "start_utc": "08:00"}},
        "glance": {"key_figures": {"error.dp.calibrated_soil": {"value": 41.0, "unit": "N"}}},
    }


def write(path: Path, found: dict[str, Any]) -> Path:
    path.write_text(json.dumps({"schema": "wheelsoil/report/2", "made_at": "2026-05-04T10:00:00", "sections": found}))
    return path


def test_what_differs_beyond_its_interval_comes_first(tmp_path: Path) -> None:
    last = load_last(write(tmp_path / "last.json", sections(0.25, (78.0, 5.0), 700.0)))
    found = changes_since(last, sections(0.31, (20.0, 5.0), 720.0))
    assert [(one.name, one.beyond) for one in found] == [
        (("torque_zero", "offset_nm"), True),
        (("soil", "tan_phi"), True),
        (("pull_at_slip_0.2",), False),
        (("error", "dp", "calibrated_soil"), False),
        (("usable_share",), False),
    ]
    assert found[0].difference == pytest.approx(-58.0)
    gone = {one.name: one for one in changes_since(last, sections(0.26, None, 700.0))}
    assert gone[("torque_zero", "offset_nm")].beyond and not gone[("soil", "tan_phi")].beyond
    assert abs(gone[("soil", "tan_phi")].difference) < inf


def test_another_wheel_than_last_time_is_said_first(tmp_path: Path) -> None:
    facts = {"provenance": {"facts": [["vehicle", "truck"], ["wheel", "RL"], ["cohesion c", "1 kPa"]]}}
    last = load_last(write(tmp_path / "last.json", sections(0.25, None, 700.0) | facts))
    assert last.subject == {"vehicle": "truck", "wheel": "RL"}
    said = change_summary(last, (), {"vehicle": "truck", "wheel": "FL"})
    assert said.startswith("Not the same thing: the last report is of wheel RL, not FL. Nothing differs ")
    assert change_summary(last, (), {}).startswith("Nothing differs beyond the intervals")


def test_another_vehicle_of_the_same_name_is_said(tmp_path: Path) -> None:
    def truck(radius_m: float, mass_kg: float | None, serial: str) -> dict[str, str]:
        raw = {"vehicle": {"name": "truck", "mass_kg": mass_kg}, "transducer": {"serial": serial}}
        return subject_of(VehicleConfig.model_validate({**raw, "wheel": {"radius_m": radius_m, "width_m": 0.3}}))

    facts = {"provenance": {"facts": [[*fact] for fact in truck(0.47, 3600.0, "A7").items()]}}
    last = load_last(write(tmp_path / "last.json", sections(0.25, None, 700.0) | facts))
    assert last.subject == truck(0.47, 3600.0, "A7")
    assert of_another_thing(last, truck(0.6, 5200.0, "B2")) == (
        "the last report is of mass 3600 kg, not 5200 kg; transducer A7, not B2; wheel radius r 0.47 m, not 0.6 m"
    )
    assert not of_another_thing(last, truck(0.47, None, "")), "what one of the two does not state is not compared"


def test_a_cause_that_a_rule_bars_is_not_compared(tmp_path: Path) -> None:
    barred = sections(0.25, (78.0, 5.0), 700.0)
    barred["causes"]["barred"] = ["torque_zero"]
    last = load_last(write(tmp_path / "last.json", barred))
    assert ("torque_zero", "offset_nm") not in {one.name for one in changes_since(last, sections(0.25, None, 700.0))}
    named = {one.name: one for one in changes_since(last, sections(0.25, (78.0, 5.0), 700.0))}
    assert named[("torque_zero", "offset_nm")].last == 78.0, "its size was known, though no name was given"


def test_a_cause_that_a_rule_bars_in_both_is_compared(tmp_path: Path) -> None:
    last, now = sections(0.25, (78.0, 5.0), 700.0), sections(0.25, (120.0, 5.0), 700.0)
    for each in (last, now):
        each["causes"]["barred"] = ["torque_zero"]
    found = {one.name: one for one in changes_since(load_last(write(tmp_path / "last.json", last)), now)}
    assert found[("torque_zero", "offset_nm")].beyond and found[("torque_zero", "offset_nm")].now == 120.0
    last["causes"]["causes"][0]["probability"] = 0.01
    assert len(changes_since(load_last(write(tmp_path / "last.json", last)), now)) == len(found) - 1


def test_a_size_at_its_bound_is_compared_by_the_whole_of_its_interval(tmp_path: Path) -> None:
    last, now = sections(0.25, None, 700.0), sections(0.25, None, 700.0)
    for report, value, ends in ((last, 0.0, [0.0, 0.038]), (now, 0.03, [0.025, 0.035])):
        size = {"name": "height_m", "unit": "m", "value": value, "interval95": ends}
        report["causes"] = {"causes": [{"name": "grouser", "probability": 0.4, "parameters": [size]}]}
    [lugs, *_] = (
        one for one in changes_since(load_last(write(tmp_path / "last.json", last)), now) if one.kind == "cause"
    )
    assert not lugs.beyond and (lugs.last_half95, lugs.now_half95) == pytest.approx((0.038, 0.005))


def slip_sinkage(p: float, *, m1: float, probability: float = 0.99) -> dict[str, Any]:
    sizes = [{"name": "p", "unit": "1", "value": p, "interval95": [p - 0.04, p + 0.04]}]
    sizes += [{"name": "m1", "unit": "1", "value": m1, "interval95": [None, None]}]
    return {"name": "slip_sinkage", "probability": probability, "parameters": sizes}


def test_a_law_is_compared_by_its_sum_and_with_a_name_that_was_kept_back(tmp_path: Path) -> None:
    last, now = (sections(0.25, None, pull) for pull in (822.0, 753.0))
    peak = {"name": "c2", "unit": "1", "value": 0.2, "interval95": [0.0, 0.6]}
    improbable = {"name": "stress_peak_shift", "probability": 3e-4, "parameters": [peak]}
    last["causes"] = {"causes": [slip_sinkage(0.32, m1=0.23), improbable], "barred": ["slip_sinkage"]}
    now["causes"] = {"causes": [slip_sinkage(0.62, m1=0.59)]}
    path = write(tmp_path / "last.json", last)
    dated = json.loads(path.read_text()) | {
        "title": "Clay",
        "head": {"facts": [["", "16 June 2026, 08:00 to 08:53 UTC"], ["Runs", "6"]]},
    }
    path.write_text(json.dumps(dated))
    found = changes_since(load_last(path), now)
    assert [one.name for one in found if one.kind == "cause"] == [("slip_sinkage", "p")]
    said = change_summary(load_last(path), found, {})
    assert said.startswith(
        "Slip sinkage, p = m₁ + m₂ went from 0.320 to 0.620 and pull at slip 0.2 went from 822 to 753 N."
    )
    assert said.endswith("Last time: Clay, driven 16 June 2026, 08:00 to 08:53 UTC (report last.json).")
    for undated in (None, "–"):  # a dash in older reports
        last["runs"]["run-1"]["start_utc"] = undated
        path.write_text(json.dumps(dated | {"sections": last, "head": {"facts": [["", "date unknown"]]}}))
        assert "Last time: Clay, made 2026-05-04 (report" in change_summary(load_last(path), found, {})
    rows = {row[0]: row for row in map(change_row, found)}
    assert rows["usable share of the samples in motion"][1:4] == ["90.0", "90.0", "0"]
    assert rows["usable share of the samples in motion"][5] == "%"
    assert rows["slip sinkage, p = m₁ + m₂"][1:4] == ["0.320 ± 0.040", "0.620 ± 0.040", "+0.300"]


def test_another_law_than_last_time_is_said_in_one_sentence(tmp_path: Path) -> None:
    last, now = sections(0.25, None, 700.0), sections(0.25, None, 700.0)
    depth = {"name": "H_m", "unit": "m", "value": 0.05, "interval95": [0.04, 0.06]}
    last["causes"] = {"causes": [{"name": "slip_sinkage", "probability": 0.99, "parameters": [depth]}]}
    now["causes"] = {"causes": [slip_sinkage(0.62, m1=0.59)]}
    before = load_last(write(tmp_path / "last.json", last))
    said = change_summary(before, changes_since(before, now), {})
    assert "p = m₁ + m₂ is 0.620, and last time slip sinkage, H was 0.0500 m." in said and "no value" not in said


def test_without_a_diagnosis_no_cause_is_said_to_be_gone_or_new(tmp_path: Path) -> None:
    both = sections(0.25, (78.0, 5.0), 700.0)
    none = {key: each for key, each in both.items() if key != "causes"}
    for last, now, when in ((both, none, "this time"), (none, both, "last time")):
        before = load_last(write(tmp_path / "last.json", last))
        found = changes_since(before, now)
        said = change_summary(before, found, {})
        assert f"Not diagnosed {when}: causes are not compared." in said and "among the causes" not in said
        assert f"not diagnosed {when}" in [change_row(change)[4] for change in found if change.kind == "cause"]


def test_a_report_of_one_wheel_of_several_is_not_of_one_without_an_id(tmp_path: Path) -> None:
    before = load_last(write(tmp_path / "last.json", sections(0.25, None, 700.0)))
    before, here = replace(before, subject={"vehicle": "tractor"}), {"vehicle": "tractor", "wheel": "FL"}
    assert of_another_thing(before, here) == "the last report is of a wheel without an id, not wheel FL"
    assert of_another_thing(replace(before, subject=here), {"vehicle": "tractor"}).endswith(
        "of wheel FL, not a wheel without an id"
    )
    assert not of_another_thing(replace(before, subject=here), here)


def test_of_a_folder_the_report_of_the_vehicle_is_taken(tmp_path: Path) -> None:
    for name in ("four", "four-FL", "four-FR"):
        write(tmp_path / f"{name}.json", sections(0.25, None, 700.0))
        (tmp_path / f"{name}.html").write_text("")
    assert load_last(tmp_path, "FR").name == "four-FR.json"
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "other.html").write_text("")
    with pytest.raises(ConfigError, match="or several"):
        load_last(tmp_path, "FR")


def test_the_last_report_is_its_json_its_page_or_their_folder(tmp_path: Path) -> None:
    write(tmp_path / "monday.json", sections(0.25, None, 700.0))
    with pytest.raises(ConfigError, match="no report, or several"):
        load_last(tmp_path)
    page = tmp_path / "monday.html"
    page.write_text("")
    assert load_last(tmp_path) == load_last(page) == load_last(tmp_path / "monday.json")


DAMAGED = '{"schema": "wheelsoil/report/2", "sections": {"fit": {"soils": [{"campaign": "clay"}]}}}'


@pytest.mark.parametrize("text", ["", "[]", '{"schema": "wheelsoil/fit/1"}', DAMAGED])
def test_what_is_no_report_is_refused_with_a_next_step(tmp_path: Path, text: str) -> None:
    (tmp_path / "other.json").write_text(text)
    with pytest.raises(ConfigError, match=r"cannot be read|no report of wheelsoil|is damaged"):
        load_last(tmp_path / "other.json")


def test_the_report_of_a_vehicle_is_refused_as_such(tmp_path: Path) -> None:
    path = tmp_path / "four.json"
    path.write_text(json.dumps({"schema": "wheelsoil/vehicle/1", "wheels": [{"wheel": "FL"}], "sections": {}}))
    with pytest.raises(ConfigError, match="of all wheels of a vehicle"):
        load_last(path)
