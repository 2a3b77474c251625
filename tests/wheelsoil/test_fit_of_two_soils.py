"""Runs of two soils: refused at once where they say so, else in two groups."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from cli_support import invoke

from daq import RunInfo
from wheelsoil.workflows.diagnosis import _two_groups

RECORDINGS = Path(__file__).parents[2] / "recordings"


def test_two_soils_are_refused_before_the_work(tmp_path: Path) -> None:
    absent = tmp_path / "absent.toml"  # where work begins, this file is missed
    runs = [RECORDINGS / soil / "run-1.mcap" for soil in ("clay", "sandy")]
    said = invoke("fit", *runs, "--zero", absent)
    assert said.code == 2 and "of different soils" in said.err
    assert "absent.toml" not in said.err


@pytest.mark.parametrize(
    ("pulls", "groups"),
    [
        ({"a": 51.0, "b": -80.0, "c": 855.0, "d": 880.0}, (("a", "b"), ("c", "d"))),
        ({"a": 855.0, "b": -80.0, "c": 880.0}, (("a", "c"), ("b",))),
        ({"a": 100.0, "b": 300.0, "c": 500.0}, None),
        ({"a": 100.0, "b": None}, None),
    ],
)
def test_runs_are_parted_by_their_pull_where_they_are_clearly_two_groups(
    pulls: dict[str, float | None], groups: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pull_of(runs: tuple[SimpleNamespace, ...], _: str) -> SimpleNamespace | None:
        pull = pulls[runs[0].run.id]
        return None if pull is None else SimpleNamespace(pull_n=pull, load_n=9000.0)

    monkeypatch.setattr("wheelsoil.workflows.diagnosis.at_usual_slip", pull_of)
    found = _two_groups([SimpleNamespace(run=RunInfo(id=name, file=f"{name}.log")) for name in pulls])  # type: ignore[misc]
    assert found.get("groups") == groups
    if groups is not None:
        assert found["runs"] == tuple(pulls) and found["files"] == tuple(f"{name}.log" for name in groups[1])  # type: ignore[index]
