"""What a cause costs, and what differs from an earlier report."""

from __future__ import annotations

import json
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import ConfigError
from model.diagnosis.core.result import Cause, ParameterEstimate, SoilEstimate
from model.effects import EFFECTS
from model.wheel_soil import SOILS, Wheel
from wheelsoil.wording.change_text import change_summary
from wheelsoil.workflows.cause_cost import costs_of
from wheelsoil.workflows.last_report import changes_since, load_last

CLAY = SOILS["clay"]
NO_SOIL = SoilEstimate("clay", {}, {})


def cause(key: str, value: float, interval: tuple[float, float]) -> Cause:
    [parameter] = EFFECTS[key].parameters
    size = ParameterEstimate(parameter.name, parameter.unit, value, interval, 1.0)
    return Cause(EFFECTS[key].name, "", EFFECTS[key].kind, key, 0.99, 1.0, (size,))


def test_a_torque_zero_costs_no_pull_and_shows_its_size_in_the_torque() -> None:
    found = costs_of(
        [cause("torque_zero", 80.0, (70.0, 90.0))], Wheel(0.47, 0.318), CLAY, NO_SOIL, load_n=9e3, speed_mps=2
    )
    by = {(one.quantity, one.slip): one for one in found}
    assert by["drawbar_pull", 0.2].difference == 0.0
    assert by["driving_torque", 0.2].difference == pytest.approx(80.0)
    assert by["driving_torque", 0.2].difference95 == pytest.approx((70.0, 90.0))
    assert len(found) == 6 and found[-1].slip > 0.2


def test_slip_sinkage_costs_pull_and_efficiency() -> None:
    size = ParameterEstimate("H_m", "m", 0.05, (0.04, 0.06), 5e-3)
    sinkage = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.99, 1.0, (size,))
    found = costs_of([sinkage], Wheel(0.47, 0.318), CLAY, NO_SOIL, load_n=9e3, speed_mps=2)
    pulls = [one for one in found if one.quantity == "drawbar_pull"]
    assert all(one.difference < 0 for one in found if one.quantity != "driving_torque")
    assert all(one.difference95[0] < one.difference < one.difference95[1] < 0 for one in pulls)


def test_opposite_causes_do_not_cancel_each_others_uncertainty() -> None:
    size = ParameterEstimate("H_m", "m", 0.05, (0.04, 0.06), 5e-3)
    sinkage = Cause("slip_sinkage", "vasilev", "physical", "vasilev", 0.99, 1.0, (size,))
    zero = cause("drawbar_pull_zero", 80.0, (70.0, 90.0))

    def sides(*causes: Cause) -> tuple[float, float]:
        found = costs_of(causes, Wheel(0.47, 0.318), CLAY, NO_SOIL, load_n=9e3, speed_mps=2)
        pull = next(one for one in found if one.quantity == "drawbar_pull")
        return pull.difference - pull.difference95[0], pull.difference95[1] - pull.difference

    together = np.hypot(sides(sinkage), sides(zero))
    assert sides(sinkage, zero) == pytest.approx(together, rel=0.02)
    assert min(together) > 12 and max(together) < 19


def test_of_terms_that_are_known_together_the_cost_has_an_interval() -> None:
    size = ParameterEstimate("p", "1", 0.6, (0.5, 0.7), 0.05)
    terms = [ParameterEstimate(name, "1", value, (nan, nan), nan) for name, value in (("m1", 0.5), ("m2", 0.1))]
    lyasko = Cause("slip_sinkage", "lyasko", "physical", "lyasko", 0.99, 1.0, (size, *terms))
    found = costs_of([lyasko], Wheel(0.47, 0.318), CLAY, NO_SOIL, load_n=9e3, speed_mps=2)
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
        "runs": {"run-1": {"usable_share": 0.9}},
        "glance": {"key_figures": {"error.dp.calibrated_soil": {"value": 41.0, "unit": "N"}}},
    }


def write(path: Path, found: dict[str, Any]) -> Path:
    path.write_text(json.dumps({"schema": "wheelsoil/report/2", "made_at": "2026-05-04T10:00:00", "sections": found}))
    return path


def test_what_differs_beyond_its_interval_comes_first(tmp_path: Path) -> None:
    last = load_last(write(tmp_path / "last.json", sections(0.25, (78.0, 5.0), 700.0)))
    found = changes_since(last, sections(0.31, (20.0, 5.0), 720.0))
    assert [(one.name, one.beyond) for one in found] == [
        ("soil.tan_phi", True),
        ("torque_zero.offset_nm", True),
        ("pull_at_slip_0.2", False),
        ("error.dp.calibrated_soil", False),
        ("usable_share", False),
    ]
    assert found[1].difference == pytest.approx(-58.0)
    gone = {one.name: one for one in changes_since(last, sections(0.26, None, 700.0))}
    assert gone["torque_zero.offset_nm"].beyond and not gone["soil.tan_phi"].beyond
    assert abs(gone["soil.tan_phi"].difference) < inf


def test_another_wheel_than_last_time_is_said_first(tmp_path: Path) -> None:
    facts = {"provenance": {"facts": [["vehicle", "truck"], ["wheel", "RL"], ["mass", "1 kg"]]}}
    last = load_last(write(tmp_path / "last.json", sections(0.25, None, 700.0) | facts))
    assert last.subject == {"vehicle": "truck", "wheel": "RL"}
    said = change_summary(last, (), {"vehicle": "truck", "wheel": "FL"})
    assert said.startswith("Not the same thing: the last report is of wheel RL, not FL. Against the report of ")
    assert change_summary(last, (), {"vehicle": "truck"}).startswith("Against the report of ")


def test_a_cause_that_a_rule_bars_is_not_compared(tmp_path: Path) -> None:
    barred = sections(0.25, (78.0, 5.0), 700.0)
    barred["causes"]["barred"] = ["torque_zero"]
    last = load_last(write(tmp_path / "last.json", barred))
    assert "torque_zero.offset_nm" not in {one.name for one in changes_since(last, sections(0.25, None, 700.0))}
    named = {one.name: one for one in changes_since(last, sections(0.25, (78.0, 5.0), 700.0))}
    assert named["torque_zero.offset_nm"].beyond, "it was not named, and is"


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
