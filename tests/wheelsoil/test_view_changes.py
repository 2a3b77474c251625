"""What the analyst's page says of two diagnosed campaigns: soil, causes and errors, as the report does."""

from __future__ import annotations

import json
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any

import pytest
from cli_support import invoke
from diagnosis_samples import diagnosis

from model.diagnosis import Diagnosis, SoilEstimate
from wheelsoil.to_json import plain
from wheelsoil.view.changes import changes_since_last, rows_of_difference
from wheelsoil.view.jobs import shown_of
from wheelsoil.wording.change_text import change_row
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.workflows.last_report import Change
from wheelsoil.workflows.traction import traction_of


def on_page(found: Diagnosis) -> dict[str, Any]:
    told: dict[str, Any] = plain(diagnosis_json(found) | shown_of(found))
    return told


def test_soils_and_causes_are_compared_with_their_intervals() -> None:
    named = diagnosis()
    soil = SoilEstimate("sandy", {"cohesion_pa": 4200.0, "tan_phi": 0.31}, {"cohesion_pa": 300.0, "tan_phi": 0.01})
    none = replace(diagnosis("nothing_detectable"), soils=(soil,))
    rows = {row[0]: row[1:] for row in rows_of_difference(on_page(named), on_page(none))}
    assert rows["tan φ of the soil"] == ["0.310 ± 0.020", "0.220 ± 0.020", "−0.090", "yes", ""]
    assert rows["c of the soil"][2:] == ["−0.10", "no", "kPa"]
    assert rows["slip sinkage, H"][0] == "–" and rows["slip sinkage, H"][3:] == ["yes", "m"]
    assert rows["error of drawbar pull on held-out runs, calibrated soil"][2:] == ["0", "no interval", "N"]
    assert list(rows)[:2] == ["slip sinkage, H", "tan φ of the soil"]  # beyond their intervals first


@pytest.mark.parametrize(
    ("difference", "written"), [(-0.0901, "−0.0901"), (999.4, "+999"), (-32974.3, "−32\u202f974"), (0.0, "0")]
)
def test_a_large_difference_is_written_in_full(difference: float, written: str) -> None:
    assert change_row(Change("soil", "soil.k", "", 0.0, nan, difference, nan))[3] == written


def test_a_cause_that_both_bar_is_compared() -> None:
    told = on_page(diagnosis())
    told["causes"][0]["barred"] = {"code": "x", "text": "x", "values": {}}
    assert [row[3] for row in rows_of_difference(told, told) if row[0] == "slip sinkage, H"] == ["0"]
    assert [row[3] for row in rows_of_difference(told, on_page(diagnosis())) if row[0] == "slip sinkage, H"] == ["0"]


def test_what_changed_since_the_last_report_is_said_as_in_the_report(tmp_path: Path) -> None:
    soil = {"campaign": "monday", "values": {"tan_phi": 0.31}, "sigmas": {"tan_phi": 0.01}}
    sections = {"fit": {"soils": [soil]}, "causes": {"causes": []}}
    last = {"schema": "wheelsoil/report/2", "made_at": "2026-05-04T10:00:00", "sections": sections}
    (tmp_path / "report.json").write_text(json.dumps(last))
    told = changes_since_last(str(tmp_path), on_page(diagnosis()), [], traction_of(()))
    assert told["says"].startswith(
        "Slip sinkage, H is 0.0510 m and was not among the causes last time and tan φ of the soil went"
    )
    assert told["says"].endswith("Last time: made 2026-05-04 (report report.json).")
    assert [row[0] for row in told["rows"][:2]] == ["slip sinkage, H", "tan φ of the soil"]
    assert told["rows"][1][1:] == ["0.310 ± 0.020", "0.220 ± 0.020", "−0.090", "yes", ""]


def test_a_last_report_that_cannot_be_read_costs_its_own_section_only(tmp_path: Path) -> None:
    told = changes_since_last(str(tmp_path), on_page(diagnosis()), [], traction_of(()))
    assert told == {"says": "this folder holds no report, or several: none", "rows": []}
    said = invoke("view", tmp_path, "--against", tmp_path, "--no-browser")
    assert said.code == 2 and "no report, or several" in said.err
