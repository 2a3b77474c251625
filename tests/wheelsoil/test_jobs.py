"""Several processes give the numbers and the messages of one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from cli_support import invoke, small_campaign

DIAGNOSE = ("diagnose", "--effects", "lyasko,wheel_radius,slope", "--json")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four runs, of which one recording is cut off and one is none."""
    folder = small_campaign(tmp_path_factory.mktemp("jobs") / "clay", runs=4)
    cut = folder / "run-2.mcap"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 4 // 5])
    return folder


def output(*arguments: object, jobs: int) -> tuple[int, str, str]:
    """Run a command line: with one job in this process, else in one of its own."""
    if jobs == 1:
        here = invoke(*arguments, "-j", 1)
        return here.code, here.out, here.err
    main = "from wheelsoil.cli.app import main; main()"
    command = [sys.executable, "-c", main, *map(str, arguments), "-j", str(jobs)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


def test_runs_are_processed_alike(campaign: Path) -> None:
    one, two = (output("process", campaign, "--json", jobs=jobs) for jobs in (1, 2))
    assert one == two
    assert one[0] == 0 and "read without what is damaged" in one[2]


@pytest.mark.slow
def test_every_fault_is_reported_alike(campaign: Path) -> None:
    unsigned = campaign / "unsigned.toml"
    unsigned.write_text((campaign / "vehicle.toml").read_text(encoding="utf-8").split("[signals]")[0], encoding="utf-8")
    one, two = (output("process", campaign, "--vehicle", unsigned, jobs=jobs) for jobs in (1, 2))
    assert one == two and one[0] == 2
    assert "and in 3 more places" in one[2]


@pytest.mark.slow
def test_a_diagnosis_is_the_same_to_the_last_digit(campaign: Path) -> None:
    one, two = (output(DIAGNOSE[0], campaign, *DIAGNOSE[1:], jobs=jobs) for jobs in (1, 2))
    assert one[0] == two[0] == 0
    assert without_times(one[1]) == without_times(two[1])


def without_times(text: str) -> dict[str, object]:
    """Return the JSON without how long each stage took."""
    found: dict[str, object] = json.loads(text)
    found.pop("stages_s", None)
    return found
