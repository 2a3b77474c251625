"""The harness: cases, figures and their bounds, resuming."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from blind.causes import FAMILIES
from blind.figures import Figure, candidates, clopper_pearson, intervals, right_verdict, said
from blind.mix import FULL, Mix, cases
from blind.study import read_lines
from blind.tables import figures, write_report

from model.effects.catalogue import EFFECTS


def test_every_family_of_the_library_is_hidden_but_the_literal_readings_own() -> None:
    assert set(FAMILIES) == {effect.name for effect in EFFECTS.values()} - {"closed_form_sinkage"}


def test_the_full_mix_has_what_the_figures_need() -> None:
    full = cases(FULL)
    assert len({case.name for case in full}) == len(full)
    count = {kind: sum(case.kind == kind for case in full) for kind in {case.kind for case in full}}
    assert count["null"] == 200
    assert count["single"] >= 500
    assert count["pair"] >= 50
    assert 0.03 < sum(case.frames for case in full) / len(full) < 0.08
    assert {case.soil for case in full} == {"clay", "sandy"}


def test_a_small_mix_is_part_of_a_larger_one() -> None:
    small = {case.name: case for case in cases(Mix(nulls=3, singles=1, pairs=2))}
    large = {case.name: case for case in cases(FULL)}
    assert small.items() <= large.items()


def test_bounds_are_those_of_clopper_and_pearson() -> None:
    """Newcombe (1998), Stat. Med. 17:857: 81 of 263, 15 of 148, 0 of 20, 1 of 29."""
    for hits, n, low, high in (
        (81, 263, 0.2527, 0.3676),
        (15, 148, 0.0578, 0.1617),
        (0, 20, 0, 0.1684),
        (1, 29, 0.0009, 0.1776),
    ):
        assert clopper_pearson(hits, n) == pytest.approx((low, high), abs=6e-5)


def line(
    verdict: str, name: str, p: float, *, d: float = 30.0, d_sep: float = 20.0, hidden: str = "torque_zero"
) -> dict[str, Any]:
    parameter = {"name": "offset_nm", "unit": "N m", "value": 21.0, "interval95": [19.0, 23.0]}
    cause = {"name": name, "form": "", "kind": "measurement", "probability": p, "parameters": [parameter]}
    member = {"key": hidden, "family": hidden, "parameter": "offset_nm", "variant": False, "size": 20.0, "L": 2.0}
    return {
        "kind": "single",
        "hidden": [[hidden, 2.0, 1.0]],
        "members": [member | {"d": d, "d_sep": d_sep, "d_forms": 0.0}],
        "verdict": verdict,
        "causes": [cause],
        "candidates": [{"name": name, "probability": p}, {"name": "none", "probability": 1 - p}],
        "frames": False,
        "oracle": {"right": 1.0, "right_forced": 1.0},
        "engine_s": 1.0,
        "stages_s": {},
        "gain": None,
    }


@pytest.mark.parametrize(
    ("verdict", "name", "d", "d_sep", "right"),
    [
        ("named", "torque_zero", 30, 20, True),
        ("named", "slope", 30, 20, False),
        ("one_of", "torque_zero", 30, 20, False),
        ("one_of", "torque_zero", 30, 3, True),
        ("one_of", "slope", 30, 3, False),
        ("nothing_detectable", "torque_zero", 3, 3, True),
        ("named", "torque_zero", 3, 3, False),
        ("nothing_detectable", "torque_zero", 30, 20, False),
        ("unexplained", "torque_zero", 1, 1, False),
    ],
)
def test_a_verdict_is_held_against_what_the_data_can_tell(
    verdict: str, name: str, d: float, d_sep: float, right: bool
) -> None:
    assert right_verdict(line(verdict, name, 0.95, d=d, d_sep=d_sep)) is right


def test_names_candidates_and_intervals_are_read_from_an_answer() -> None:
    one = line("named", "torque_zero", 0.95)
    assert said(one, 0.9) == ["torque_zero"]
    assert said(one, 0.99) == []
    assert candidates(one, none=True) == ["torque_zero", "none"]
    [interval] = intervals([one])
    assert interval.inside
    assert interval.z == pytest.approx(1.0, abs=0.05)


def test_a_report_is_written_of_what_is_there(tmp_path: Path) -> None:
    for name, entry in (("truth", line("named", "slope", 0.95)), ("answers", line("named", "slope", 0.95))):
        (tmp_path / f"{name}.jsonl").write_text(json.dumps(entry | {"name": "single/x"}) + '\n{"name": "cut o')
    write_report(tmp_path, None, tmp_path / "results.md")
    text = (tmp_path / "results.md").read_text()
    assert "| torque_zero | single | slope | 1 |" in text
    kept = json.loads((tmp_path / "results.json").read_text())["figures"]
    [precision] = [row for row in kept if row["what"].startswith("stated names right, p > 0.9 ")]
    assert (precision["hits"], precision["n"], precision["reached"]) == (0, 1, 0.0)
    assert list(read_lines(tmp_path / "truth.jsonl")) == ["single/x"]


def test_figures_of_nothing_are_no_figures() -> None:
    assert all(row.reached is None for row in figures([]))


@pytest.mark.parametrize(
    ("to_reach", "hits", "n", "beside", "may"),
    [
        (">= .97", 90, 100, "", False),
        (">= .97", 96, 100, "", True),
        ("<= .05", 20, 100, "", False),
        (".92 to .98, n >= 500", 500, 500, "", False),
        (".92 to .98, n >= 500", 39, 39, "", True),
        (">= .9 of the oracle's", 10, 20, "oracle 0.90", False),
        (">= .9 of the oracle's", 14, 20, "oracle 0.90", True),
        ("0 of 200 is the aim, above 2 a defect", 3, 20, "", False),
        ("", 3, 20, "", True),
    ],
)
def test_a_figure_is_held_to_what_it_is_to_reach(to_reach: str, hits: int, n: int, beside: str, may: bool) -> None:
    assert Figure("x", to_reach, hits, n, beside=beside).may_reach == may
