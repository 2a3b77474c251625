"""The net itself, and the part of it that runs with every test; the whole of it is ``make golden``."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from golden import store
from golden.__main__ import main
from golden.cases import CASES, IN_EVERY_TEST
from golden.comparison import SHOWN, Difference, differences, report
from golden.inputs import Inputs
from golden.kept import ASIDE, kept
from golden.store import NUMBERS, compared

MOST_BYTES = 2_200_000


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return Inputs(tmp_path_factory.mktemp("golden"))


@pytest.mark.parametrize("name", IN_EVERY_TEST)
def test_numbers_are_as_kept(name: str, inputs: Inputs) -> None:
    found, _ = compared(CASES[name], inputs)
    assert not found, f"{len(found)} differences\n{report(found)}"


def test_kept_numbers_are_of_a_case_and_few() -> None:
    files = list(NUMBERS.glob("*.json"))
    assert {path.stem for path in files} == set(CASES)
    assert sum(path.stat().st_size for path in files) <= MOST_BYTES


# --- the net reports what moves ---------------------------------------------------------------------------------------

COLUMN = ("samples.csv", "columns", "vertical_load_n [N]")


def _run() -> Any:
    return json.loads((NUMBERS / "run-process.json").read_text(encoding="utf-8"))


def _moved(*path: Any, by: Any) -> tuple[Any, Any]:
    """Return the kept numbers of a run, and the same with a change at one place."""
    expected = _run()
    got = deepcopy(expected)
    parent = got
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = by(parent[path[-1]])
    return expected, got


def test_the_same_numbers_do_not_differ() -> None:
    assert not list(differences(_run(), _run(), "run-process"))


@pytest.mark.parametrize(
    ("path", "place"),
    [
        (("stdout", 0, "duration_s"), "run-process.stdout[0].duration_s"),
        ((*COLUMN, "some_rows", 2), "run-process.samples.csv.columns.vertical_load_n [N]"),
        ((*COLUMN, "mean"), "run-process.samples.csv.columns.vertical_load_n [N].mean"),
        ((*COLUMN, "rms"), "run-process.samples.csv.columns.vertical_load_n [N].rms"),
    ],
)
def test_a_number_that_moves_by_1e_8_is_reported(path: tuple[Any, ...], place: str) -> None:
    (one,) = differences(*_moved(*path, by=lambda value: value * (1 + 1e-8)), "run-process")
    assert one.place.startswith(place)
    assert one.relative == pytest.approx(1e-8, rel=1e-3)
    assert not list(differences(*_moved(*path, by=lambda value: value * (1 + 2e-10)), "run-process"))


def test_keys_of_an_output_are_no_aggregates() -> None:
    output = {"spread": 0.01, "mean": 1.0, "rms": 2.0}
    assert len(list(differences(kept(output, "case"), kept(output | {"mean": 1.0 + 1e-8}, "case"), "case"))) == 1


def test_a_row_is_counted_in_the_whole_series() -> None:
    series = {"x": [float(i) for i in range(1, 1001)]}
    expected = kept(series, "case")
    moved = deepcopy(expected)
    moved["x"]["some_rows"][-1] *= 1 + 1e-8
    (one,) = differences(expected, moved, "case")
    assert one.place == "case.x[999]"
    series["x"][500] *= 1.001  # a row that is not kept itself
    assert {one.place for one in differences(expected, kept(series, "case"), "case")} == {"case.x.mean", "case.x.rms"}


@pytest.mark.parametrize("values", [[None, 7.0], [0, 1], ["used", "slow"]])
def test_a_stretch_that_moves_by_a_row_is_reported(values: list[Any]) -> None:
    before, after = ([values[start <= row < start + 600] for row in range(2000)] for start in (500, 501))
    assert list(differences(kept({"x": before}, "case"), kept({"x": after}, "case"), "case"))


@pytest.mark.parametrize("got", [float("inf"), float("nan"), -1.0])
def test_what_is_not_finite_is_no_number(got: float) -> None:
    assert list(differences(1.0, got, "case")) and list(differences(got, 1.0, "case"))
    assert not list(differences(got, got, "case"))


def test_a_warning_that_comes_and_another_next_run_are_reported() -> None:
    assert list(differences(kept({"notes": []}, "case"), kept({"notes": ["one"]}, "case"), "case"))
    runs = [kept({"change": f"one run with {mass} kg more"}, "case") for mass in (200, 300)]
    assert list(differences(*runs, "case"))


def test_a_whole_number_is_exact() -> None:
    start = ("stdout", 0, "start_ns")
    (one,) = differences(*_moved(*start, by=lambda value: value + 1), "run-process")
    assert one.place == "run-process.stdout[0].start_ns"


@pytest.mark.parametrize("by", [lambda value: value | {"new": 1.0}, lambda value: dict(list(value.items())[1:])])
def test_a_key_that_comes_or_goes_is_reported(by: Any) -> None:
    (one,) = differences(*_moved("stdout", 0, "quality", by=by), "run-process")
    assert one.place.startswith("run-process.stdout[0].quality.")


@pytest.mark.parametrize(
    ("path", "by"),
    [
        ((*COLUMN, "count"), lambda value: value + 1),
        (("stdout", 0, "quality", "standstills"), lambda value: value[1:]),
        (("stdout", 0, "duration_s"), lambda _: None),
        (("stdout", 0, "duration_s"), str),
        (("stdout", 0, "run", "direction"), lambda _: "back"),
    ],
)
def test_other_changes_are_reported(path: tuple[Any, ...], by: Any) -> None:
    assert list(differences(*_moved(*path, by=by), "run-process"))


def test_the_rounding_error_of_large_values_is_no_difference_at_a_zero_crossing() -> None:
    assert not list(differences([1e4, 1e-9], [1e4, -1e-9], "case"))
    assert list(differences([1e4, 1e-9], [1e4, 1e-6], "case"))


def test_words_and_times_are_put_aside() -> None:
    output = {"sentence": "39 % less", "notes": ["one"], "stages_s": {"fit": 1.2}, "cannot_tell": {"ding": "why"}}
    aside = {"sentence": ASIDE, "notes": [ASIDE], "stages_s": ASIDE, "cannot_tell": {"ding": ASIDE}}
    assert kept(output | {"verdict": "named"}, "case") == aside | {"verdict": "named"}


def test_the_largest_difference_comes_first_and_the_rest_is_counted() -> None:
    lines = report([Difference(f"case.{i}", 1.0, 1.0 + i, i / 100) for i in range(50)]).splitlines()
    assert lines[0] == "case.49: expected 1.0, got 50.0, relative difference 4.9e-01"
    assert len(lines) == SHOWN + 1
    assert lines[-1] == "... and 30 more differences"


# --- make golden, make golden-keep ------------------------------------------------------------------------------------


@pytest.fixture
def moved_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have a kept number of a case moved by 1e-8, in a copy."""
    numbers = json.loads((NUMBERS / "bevameter-soil.json").read_text(encoding="utf-8"))
    numbers["stdout"]["parameters"][0]["value"] *= 1 + 1e-8
    (tmp_path / "bevameter-soil.json").write_text(json.dumps(numbers))
    monkeypatch.setattr(store, "NUMBERS", tmp_path)
    monkeypatch.setattr(store, "CHANGES", tmp_path / "CHANGES.md")
    return tmp_path


def test_a_moved_number_fails_until_it_is_kept(moved_numbers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bevameter-soil"]) == 1
    out = capsys.readouterr().out
    assert "bevameter-soil.stdout.parameters[0].value: expected" in out
    assert "relative difference 1.0e-08" in out
    assert main(["bevameter-*", "--keep", "a better fit"]) == 0
    assert "a better fit (bevameter-soil)" in (moved_numbers / "CHANGES.md").read_text()
    assert (moved_numbers / "bevameter-soil.json").read_text() == (NUMBERS / "bevameter-soil.json").read_text()
    assert main(["bevameter-soil"]) == 0


def test_keeping_needs_a_reason() -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["bevameter-soil", "--keep", " "])


def test_public_data_that_are_missing_are_loud(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("WHEELSOIL_DATA", raising=False)
    assert main(["plates-soil"]) == 0
    assert "SKIPPED 1 of 1 cases, for WHEELSOIL_DATA is not set: plates-soil" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main(["plates-soil", "--keep", "why"])
    with pytest.raises(SystemExit, match="no such case: plate"):
        main(["plate"])
