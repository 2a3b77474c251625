"""The compiled core beside numpy, and what a second core costs: whole commands, in turns, with an empty cache."""

from __future__ import annotations

import os
import statistics
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from unittest.mock import patch

from benchmarks.table import Row, at_least, at_most, compared, judged, times, with_verdict
from benchmarks.timing import CommandCost, DiagnoseCost, diagnose_cost, wheelsoil_cost

PAIRS = 5
CAUSE = "slip_sinkage"
DRIVEN = ("--soil", "sandy", "--effect", "lyasko:m1=0.6,m2=0.03")
LENGTH_S = {6: 40, 20: 40, 60: 20}
"""Runs -> length of each."""
DIAGNOSED = {6: 1.6, 20: 1.9, 60: 2.2}
"""Runs -> how many times faster the compiled core has to be."""
REPORTED = {6: 1.5, 20: 1.8}
JOBS_COST = 1.05
"""Most processor time with two processes over that with one."""


def rows() -> list[Row]:
    """Measure both cores on campaigns of 6, 20 and 60 runs, one process each; then two processes."""
    with tempfile.TemporaryDirectory() as name:
        folders = {runs: _driven(Path(name) / f"runs-{runs}", runs) for runs in DIAGNOSED}
        page = str(Path(name) / "page.html")
        diagnosed = [_diagnosed(folders[runs], runs, least) for runs, least in DIAGNOSED.items()]
        reported = [
            _beside_numpy(f"wheelsoil report, {_driven_as(runs)}", least, _report(folders[runs], page))
            for runs, least in REPORTED.items()
        ]
        return [*diagnosed, *reported, _two_processes(folders[6])]


def _driven_as(runs: int) -> str:
    return f"{runs} runs of {LENGTH_S[runs]} s"


def _driven(folder: Path, runs: int) -> Path:
    length = ("--duration", str(LENGTH_S[runs]))
    wheelsoil_cost("simulate", *DRIVEN, *length, "--runs", str(runs), "-o", str(folder))
    return folder


def _diagnosed(folder: Path, runs: int, least: float) -> Row:
    answers: list[DiagnoseCost] = []

    def diagnose() -> CommandCost:
        answers.append(diagnose_cost(folder, CAUSE))
        return answers[-1].cost

    row = _beside_numpy(f"wheelsoil diagnose, {_driven_as(runs)}", least, diagnose)
    return with_verdict(row, answers[0].verdict, right=all(answer.right for answer in answers))


def _report(folder: Path, page: str) -> Callable[[], CommandCost]:
    return lambda: wheelsoil_cost("report", str(folder), "-o", page, "--force")


def _beside_numpy(what: str, least: float, command: Callable[[], CommandCost]) -> Row:
    one = {"WHEELSOIL_JOBS": "1"}
    took = _in_turns(command, {"compiled": one, "numpy": one | {"WHEELSOIL_CORE": "numpy"}})
    return compared(what, took["compiled"], "numpy core", took["numpy"], lambda s: f"{s:.1f} s", at_least(least, "x"))


def _two_processes(folder: Path) -> Row:
    took = _in_turns(lambda: diagnose_cost(folder, CAUSE).cost, {jobs: {"WHEELSOIL_JOBS": jobs} for jobs in ("1", "2")})
    one_s, two_s = (statistics.median(took[jobs]) for jobs in ("1", "2"))
    what = f"wheelsoil diagnose, {_driven_as(6)}: processor time of two processes over one"
    return judged(
        what, f"{times(two_s / one_s)}: {two_s:.1f} s over {one_s:.1f} s", two_s / one_s, at_most(JOBS_COST, "x")
    )


def _in_turns(
    command: Callable[[], CommandCost], environments: Mapping[str, Mapping[str, str]]
) -> dict[str, list[float]]:
    took: dict[str, list[float]] = {name: [] for name in environments}
    for _ in range(PAIRS):
        for name, environment in environments.items():
            with patch.dict(os.environ, environment):
                took[name].append(command().cpu_s)
    return took
