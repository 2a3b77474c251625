"""A fit of runs that do not belong together is refused at once."""

from __future__ import annotations

from pathlib import Path

from cli_support import invoke

RECORDINGS = Path(__file__).parents[2] / "recordings"


def test_two_soils_are_refused_before_the_work(tmp_path: Path) -> None:
    absent = tmp_path / "absent.toml"  # where work begins, this file is missed
    runs = [RECORDINGS / soil / "run-1.mcap" for soil in ("clay", "sandy")]
    said = invoke("fit", *runs, "--zero", absent)
    assert said.code == 2 and "of different soils" in said.err
    assert "absent.toml" not in said.err
