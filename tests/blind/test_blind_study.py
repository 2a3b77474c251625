"""The harness: cases, figures and their bounds, resuming."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blind.causes import FAMILIES, KNOWN
from blind.figures import (
    ALL_NAMES_RIGHT,
    FALSE_UNEXPLAINED,
    NAMES_RIGHT,
    NULLS_NAMED,
    Aim,
    Figure,
    candidates,
    clopper_pearson,
    intervals,
    named_causes,
    oracle_verdict,
    reliability,
    right_foreign_verdict,
    right_verdict,
    said,
)
from blind.jsonl import append_line, read_lines
from blind.mix import WHOLE, Mix, cases, unlisted_share
from blind.prior import SCALES, drawn_causes
from blind.provenance import engine_of, engine_words, generator_of
from blind.study import check_engine
from blind.tables import BLOCKS, figures, write_report

from model.effects import EFFECTS


def test_every_family_of_the_library_is_hidden_but_the_literal_readings_own() -> None:
    """Those that need further sensors are hidden by tests of their own."""
    without = {effect.name for effect in EFFECTS.values() if not effect.needs.roles}
    assert set(FAMILIES) == without - {"closed_form_sinkage"}


def test_a_block_has_what_the_figures_need() -> None:
    block = cases(replace(WHOLE, block=3))
    assert len({case.name for case in block}) == len(block)
    count = Counter(case.kind for case in block)
    assert count["null"] == 300
    assert count["null"] + count["single"] >= 600
    assert count["pair"] == 60
    assert count["calibration"] == 200
    assert count["outside"] / count["left_out"] == pytest.approx(96 / 75)
    assert unlisted_share(block) == pytest.approx(0.30, abs=0.005)
    assert 0.03 < sum(case.frames for case in block) / len(block) < 0.08
    assert {case.seed // 1000 for case in block} == {23}


def test_a_small_mix_is_part_of_a_larger_one() -> None:
    small = {case.name: case for case in cases(Mix(nulls=3, singles=1, pairs=2, calibration=5))}
    large = {case.name: case for case in cases(WHOLE)}
    assert small.items() <= large.items()
    tenth = [case.name for case in cases(WHOLE, 0.1)]
    assert set(tenth) < large.keys()
    assert 0.05 < len(tenth) / len(large) < 0.15


def test_no_seed_of_a_block_is_another_blocks() -> None:
    seeds = [{case.seed for case in cases(replace(WHOLE, block=block))} for block in (-1, 0, 1)]
    assert not seeds[0] & seeds[1]
    assert not seeds[1] & seeds[2]


def test_the_prior_is_the_engines() -> None:
    parameters = {
        "stress_peak_shift": ("stress_peak_shift", ("c1", "c2")),
        "lyasko": ("lyasko", ("m1", "m2")),
    }
    for key, scale in SCALES.items():
        effect, names = parameters.get(key, (key, ()))
        own = [p for p in EFFECTS[effect].parameters if not names or p.name in names]
        assert {p.prior_scale for p in own} == {scale}, key
    assert {EFFECTS[key].name for key in SCALES} == set(FAMILIES)


def test_no_cause_is_hidden_beyond_the_sizes_that_the_engine_considers() -> None:
    for key, hidden in KNOWN.items():
        if hidden.variant or not hidden.parameter:
            continue
        effect = next(e for name, e in EFFECTS.items() if name == key or (e.name == hidden.family and e.form == ""))
        known = {one.name: one for one in effect.parameters}
        if hidden.parameter not in known:
            continue  # Lyasko's sum
        bounds = known[hidden.parameter]
        low, high = (0.6 / 0.47 * edge if hidden.length else edge for edge in hidden.limits)
        assert bounds.lower < low or low == bounds.neutral, key
        assert high < bounds.upper or high == bounds.neutral, key


def test_causes_are_drawn_from_the_prior() -> None:
    drawn = [drawn_causes(np.random.default_rng(seed), 0.3) for seed in range(2000)]
    count = Counter(len(causes) for causes in drawn)
    for size, probability in enumerate((0.5, 0.35, 0.12, 0.03)):
        low, high = clopper_pearson(count[size], 2000)
        assert low <= probability <= high
    sizes = [size for causes in drawn for key, size in causes if key == "torque_zero"]
    assert np.std(sizes) == pytest.approx(60, rel=0.3)
    skids = [size for causes in drawn for key, size in causes if key == "skid_sinkage"]
    assert min(skids) > 0
    assert np.mean(skids) == pytest.approx(0.6 * 0.3 * np.sqrt(2 / np.pi), rel=0.3)
    assert all(size < 0 for causes in drawn for key, size in causes if key == "interface_friction")


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
        "seed": 0,
        "block": -1,
        "engine": {"model": "a" * 40, "processing": "b" * 40, "dirty": False},
        "oracle": {"right": 1.0, "right_forced": 1.0},
        "engine_cpu_s": 1.0,
        "stages_s": {},
        "gain": None,
    }


VERDICTS = ("nothing", "named right", "named wrong", "one_of right", "one_of wrong")


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
    said = line(verdict, name, 0.95, d=d, d_sep=d_sep)
    assert right_verdict(said) is right
    of_oracle = verdict.removesuffix("_detectable")
    of_oracle += f" {'right' if name == 'torque_zero' else 'wrong'}" if of_oracle in ("named", "one_of") else ""
    assert oracle_verdict(said | {"oracle": {"verdicts": dict.fromkeys(VERDICTS, 0.0) | {of_oracle: 1.0}}}) == right


def test_names_candidates_and_intervals_are_read_from_an_answer() -> None:
    one = line("named", "torque_zero", 0.95)
    assert said(one) == ["torque_zero"]
    assert said(line("one_of", "torque_zero", 0.95)) == []
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
    assert "model aaaaaaaaaaaa, processing bbbbbbbbbbbb. Without a result, in no figure: none." in text
    first, *_ = json.loads((tmp_path / "results.json").read_text())["figures"]
    assert first["what"].startswith("names right over all campaigns")
    assert (first["hits"], first["n"], first["reached"], first["passes"]) == (0, 1, 0.0, False)
    assert [entry["name"] for entry in read_lines(tmp_path / "truth.jsonl")] == ["single/x"]


def test_a_block_that_failed_stays_in_the_list(tmp_path: Path) -> None:
    for block, name in ((0, "slope"), (1, "torque_zero")):
        out = tmp_path / f"block-{block}"
        out.mkdir()
        entry = line("named", name, 0.95) | {"name": "single/x", "block": block, "seed": 20_000 + 1000 * block}
        append_line(out / "truth.jsonl", entry)
        append_line(out / "answers.jsonl", entry)
        write_report(out, None, tmp_path / "results.md")
    blocks = json.loads((tmp_path / BLOCKS).read_text())
    assert [(one["block"], one["passed"]) for one in blocks] == [(0, False), (1, False)]  # one name proves nothing
    assert [next(iter(one["gates"].values())) for one in blocks] == ["0 of 1", "1 of 1"]
    assert "| 0 | model aaaaaaaaaaaa, processing bbbbbbbbbbbb | 1 | 0 of 1 |" in (tmp_path / "results.md").read_text()


def test_a_case_without_a_result_is_counted_and_no_block_passes_with_it(tmp_path: Path) -> None:
    entry = line("nothing_detectable", "slope", 0.1) | {"name": "null/x", "kind": "null", "members": [], "block": 0}
    names = [f"null/{i}" for i in range(300)]
    for name in names:
        append_line(tmp_path / "truth.jsonl", entry | {"name": name})
        append_line(tmp_path / "answers.jsonl", entry | {"name": name})
    write_report(tmp_path, {*names, "null/lost"}, tmp_path / "results.md")
    assert "in no figure: null/lost." in (tmp_path / "results.md").read_text()
    [block] = json.loads((tmp_path / BLOCKS).read_text())
    assert block["passed"] is False


def test_a_lost_case_that_no_gate_counts_does_not_fail_a_block(tmp_path: Path) -> None:
    null = line("nothing_detectable", "slope", 0.1) | {"kind": "null", "members": []}
    right = line("named", "torque_zero", 0.99)
    entries = [null | {"name": f"null/{i}", "block": 0} for i in range(300)]
    entries += [right | {"name": f"single/{i}", "block": 0} for i in range(400)]
    for entry in entries:
        append_line(tmp_path / "truth.jsonl", entry)
        append_line(tmp_path / "answers.jsonl", entry)
    names = {entry["name"] for entry in entries}
    for lost, passed in (("calibration/x", True), ("outside/x", False)):
        write_report(tmp_path, {*names, lost}, tmp_path / "results.md")
        assert json.loads((tmp_path / BLOCKS).read_text())[0]["passed"] is passed


def test_figures_of_nothing_are_no_figures_and_pass_no_gate() -> None:
    rows = figures([])
    assert all(row.reached is None for row in rows)
    assert [row.passes for row in rows if row.aim and row.aim.gate] == [False] * 4


@pytest.mark.parametrize(
    ("aim", "hits", "n", "passes", "refuted"),
    [
        (NULLS_NAMED, 0, 10, False, False),  # too few to say so
        (NULLS_NAMED, 1, 300, True, False),
        (NULLS_NAMED, 2, 300, False, False),
        (NULLS_NAMED, 20, 300, False, True),
        (FALSE_UNEXPLAINED, 5, 600, True, False),
        (FALSE_UNEXPLAINED, 6, 600, False, False),
        (FALSE_UNEXPLAINED, 0, 100, False, False),
        (NAMES_RIGHT, 148, 150, True, False),
        (NAMES_RIGHT, 147, 150, False, False),
        (NAMES_RIGHT, 30, 30, False, False),
        (ALL_NAMES_RIGHT, 144, 150, True, False),
        (ALL_NAMES_RIGHT, 138, 149, False, False),
        (Aim(least=0.97), 90, 100, False, True),
        (Aim(least=0.97), 96, 100, False, False),
        (Aim(least=0.97), 97, 100, True, False),
        (Aim(0.92, 0.98), 500, 500, False, True),
        (Aim(0.92, 0.98), 39, 39, False, False),
        (Aim(0.92, 0.98), 95, 100, True, False),
        (Aim(most=0.02), 2, 100, True, False),
        (Aim(most=0.02), 3, 100, False, False),
        (None, 3, 20, None, False),
    ],
)
def test_a_figure_is_held_to_what_it_is_to_reach(
    aim: Aim | None, hits: int, n: int, passes: bool | None, refuted: bool
) -> None:
    figure = Figure("x", aim, hits, n)
    assert (figure.passes, figure.refuted) == (passes, refuted)


@pytest.mark.parametrize(("hits", "passes"), [(10, False), (17, True)])
def test_a_share_of_the_oracles_is_held_to_its_share(hits: int, passes: bool) -> None:
    assert Figure("x", Aim(least=0.9, of_oracle=True), hits, 20, oracle=0.9).passes is passes


def test_no_name_is_right_where_its_family_is_not_hidden_or_not_in_the_library() -> None:
    right, wrong = line("named", "torque_zero", 0.95), line("named", "slope", 0.95)
    assert named_causes([right, wrong, line("one_of", "slope", 0.5)]) == (1, 2)
    assert named_causes([right | {"kind": "left_out"}]) == (0, 1)
    assert named_causes([wrong | {"kind": "null", "members": []}]) == (0, 1)


@pytest.mark.parametrize(
    ("key", "verdict", "name", "right"),
    [
        ("reece", "unexplained", "", True),
        ("reece", "named", "stress_peak_shift", True),
        ("reece", "named", "slip_sinkage", False),
        ("reece", "one_of", "stress_peak_shift", True),
        ("reece", "nothing_detectable", "", False),
        ("resistive_force", "named", "slip_sinkage", False),
        ("resistive_force", "unexplained", "", True),
        ("elastic_tyre", "named", "tyre_flattening", False),
        ("elastic_tyre", "one_of", "tyre_flattening", True),
        ("granular", "named", "slip_sinkage", True),
        ("granular", "nothing_detectable", "", False),
    ],
)
def test_a_foreign_wheel_is_unexplained_or_akin(key: str, verdict: str, name: str, right: bool) -> None:
    one = line(verdict, name, 0.95) | {"kind": "foreign", "members": [{"key": key}]}
    one["causes"] = one["causes"] if name else []
    assert right_foreign_verdict(one) is right


def test_stated_probabilities_are_held_against_what_was_hidden() -> None:
    low, high = (line("named", "torque_zero", p) for p in (0.92, 0.95))
    wrong = line("named", "slope", 0.95)
    null = line("nothing_detectable", "slope", 0.05) | {"members": []}
    taken_back = line("unexplained", "slope", 0.95)
    bins = {(one.low, one.high): one for one in reliability([low, high, wrong, null, taken_back])}
    assert (bins[0.9, 0.99].n, bins[0.9, 0.99].hits) == (4, 3)  # the null's "none" is right, too
    assert bins[0.9, 0.99].stated == pytest.approx((0.92 + 0.95 + 0.95 + 0.95) / 4)
    assert (bins[0.01, 0.1].n, bins[0.01, 0.1].hits) == (4, 0)


def test_a_block_is_of_one_engine_that_git_has() -> None:
    engine = {"model": "a", "processing": "b", "dirty": False}
    check_engine(engine, [{"engine": engine}])
    with pytest.raises(ValueError, match="commit them"):
        check_engine(engine | {"dirty": True}, [])
    with pytest.raises(ValueError, match="another engine"):
        check_engine(engine, [{"engine": engine | {"model": "c"}}])


def test_an_engine_outside_git_counts_as_not_committed(tmp_path: Path) -> None:
    assert generator_of(tmp_path) == "unknown"
    assert engine_words(engine_of(tmp_path)) == "not known: no git checkout"
    assert engine_words({"model": "a" * 40, "processing": "b" * 40, "dirty": True}).endswith("are not committed")
    assert engine_of(tmp_path) == {"model": "unknown", "processing": "unknown", "dirty": True}


def test_a_line_that_a_kill_cut_off_costs_no_other(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    append_line(path, {"name": "a"})
    with path.open("a") as file:
        file.write('{"name": "cut')
    append_line(path, {"name": "b"})
    assert [entry["name"] for entry in read_lines(path)] == ["a", "b"]
