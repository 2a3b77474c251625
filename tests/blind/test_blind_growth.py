"""The growth study: its campaigns, what counts as a lost name, and one short campaign from frames to a line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from blind.growth import CAMPAIGNS, COUNTS, contains_true_value, every_stage, main, page, rank, stays_right
from blind.jsonl import read_lines

from wheelsoil.simulation import parse_effect


def line(runs: int, verdict: str, *names: str, seed: int = 0, **other: Any) -> dict[str, Any]:
    """Return a line of a campaign with slip sinkage, or of another seed's."""
    growing = CAMPAIGNS[seed]
    parameter = {"name": "H_m", "value": 0.031, "interval95": [0.028, 0.034]}
    causes = [{"name": name, "form": "vasilev", "parameters": [parameter]} for name in names]
    stages = ("samples", "noise", "evidence", "adequacy", "bagging", "final")
    return {
        "seed": seed,
        "soil": growing.soil,
        "effect": growing.effect,
        "family": growing.family,
        "runs": runs,
        "verdict": verdict,
        "causes": causes,
        "stages_s": dict.fromkeys((*stages, "held_out"), 0.1),
        "adequacy": {"statistic": 0.02, "threshold": 0.5},
        "samples": 100,
        "two_soils": False,
        "cpu_s": 1.0,
        "engine": {"model": "a" * 40, "processing": "b" * 40, "dirty": False},
        **other,
    }


def test_the_campaigns_are_those_that_were_asked_for() -> None:
    families = [growing.family for growing in CAMPAIGNS]
    assert len(CAMPAIGNS) == 24
    assert families.count("slip_sinkage") == 8
    assert families.count("") == 4
    assert [growing.soil for growing in CAMPAIGNS[:3]] == ["clay", "sandy", "clay"]
    for growing in CAMPAIGNS[:20]:
        key, values = parse_effect(growing.effect)
        assert key == growing.key
        assert growing.value == pytest.approx(values.get(growing.parameter, sum(values.values())))


@pytest.mark.parametrize(
    ("said", "stays"),
    [
        ((("nothing_detectable",), ("one_of", "slip_sinkage", "slope"), ("named", "slip_sinkage")), True),
        ((("named", "slip_sinkage"), ("named", "slip_sinkage")), True),
        ((("named", "slip_sinkage"), ("unexplained",)), False),
        ((("named", "slip_sinkage"), ("one_of", "slip_sinkage", "slope")), False),
        ((("one_of", "slip_sinkage", "slope"), ("nothing_detectable",)), False),
        ((("nothing_detectable",), ("named", "slope")), False),
        ((("nothing_detectable",), ("named", "slip_sinkage", "slope")), False),
        ((("one_of", "slope", "crosstalk"),), False),
        ((("unexplained",), ("named", "slip_sinkage")), False),
    ],
)
def test_a_name_may_come_and_may_not_be_lost(said: tuple[tuple[str, ...], ...], stays: bool) -> None:
    lines = [line(n, *one) for n, one in zip(COUNTS, said, strict=False)]
    assert stays_right(lines) is stays
    assert stays_right(lines[::-1]) is stays


def test_nothing_is_the_right_verdict_where_nothing_is_hidden_only() -> None:
    assert rank(line(6, "nothing_detectable", seed=20)) == 2
    assert rank(line(6, "named", "slope", seed=20)) == -1
    assert rank(line(6, "one_of", "slope", seed=20)) == -1
    assert rank(line(6, "nothing_detectable")) == 0


def test_an_interval_counts_only_where_the_cause_is_named_by_its_form() -> None:
    right = line(200, "named", "slip_sinkage")
    assert contains_true_value(right)
    assert contains_true_value(right | {"verdict": "one_of"})
    right["causes"][0]["parameters"][0]["interval95"] = [0.0301, 0.034]
    assert not contains_true_value(right)
    other = line(200, "named", "slip_sinkage")
    other["causes"][0]["form"] = "ding"
    assert not contains_true_value(other)


def test_a_stage_that_is_missing_is_seen() -> None:
    whole = line(6, "named", "slip_sinkage")
    without = {name: 0.1 for name in whole["stages_s"] if name != "held_out"}
    assert every_stage(whole)
    assert not every_stage(whole | {"stages_s": without})
    assert every_stage(whole | {"stages_s": without, "verdict": "unexplained"})
    assert not every_stage(whole | {"stages_s": {"samples": 0.1}})


def test_the_page_counts_lost_names_and_two_soils() -> None:
    kept = [line(6, "named", "slip_sinkage"), line(200, "named", "slip_sinkage")]
    lost = [line(6, "nothing_detectable", seed=20), line(200, "unexplained", seed=20, two_soils=True)]
    text = page([*kept, *lost])
    assert "| all of 24 | 1 of 2 |" in text
    assert "| 0 | 1 of 4 |" in text
    assert "| 18 of 20 | 1 of 1 |" in text
    assert "model aaaaaaaaaaaa, processing bbbbbbbbbbbb." in text
    assert "| 20 | clay | nothing | nothing_detectable, 0.020, 100, 1 s | unexplained, two soils," in text


@pytest.mark.slow
def test_a_campaign_is_simulated_and_diagnosed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["growth", "--out", str(tmp_path), "--seeds", "0", "--counts", "3", "4", "--report", str(tmp_path / "a.md")]
    monkeypatch.setattr("sys.argv", words)
    assert main() == 0
    assert main() == 0  # nothing is left to do
    lines = read_lines(tmp_path / "growth.jsonl")
    assert [(one["seed"], one["runs"]) for one in lines] == [(0, 3), (0, 4)]
    assert all(one["samples"] > 50 and one["cpu_s"] > 0 for one in lines)
    assert "vasilev:H_m=0.03" in (tmp_path / "a.md").read_text()
