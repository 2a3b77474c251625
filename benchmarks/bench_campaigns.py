"""Campaigns of 1 to 200 runs: what each command costs, how it grows, and one law's fit beside lmfit and scipy."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from math import log
from pathlib import Path
from statistics import median

from benchmarks.peer_environment import PeersMissingError, run_beside_peers
from benchmarks.table import Row, at_most, compared, judged, with_verdict
from benchmarks.timing import CommandCost, DiagnoseCost, diagnose_cost, wheelsoil_cost

RUNS, LENGTH_S = (1, 5, 20, 60, 200), 60
GROWTH = (20, 200)
"""Numbers of runs between which the growth is measured."""
CAMPAIGN = ("--soil", "sandy", "--effect", "lyasko:m1=0.6,m2=0.03", "--duration", str(LENGTH_S))
COMMANDS = ("process", "fit", "diagnose", "report")
OUT = {"process": ".parquet", "report": ".html"}
MEMORY_MB = {("diagnose", 200): 1000.0}
"""A quarter of the smallest field computer's 4 GB."""
CAUSE = "slip_sinkage"
LARGEST_EXPONENT = 1.05
"""Growth in proportion to the runs is 1."""


def rows() -> list[Row]:
    """Measure every command on every campaign, once, with an empty cache and a process for each core."""
    costs: dict[str, dict[int, CommandCost]] = {command: {} for command in COMMANDS}
    diagnosed: dict[int, DiagnoseCost] = {}
    pages: dict[int, float] = {}
    for runs in RUNS:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "sandy"
            wheelsoil_cost("simulate", *CAMPAIGN, "--runs", str(runs), "-o", str(folder))
            for command in COMMANDS:
                os.environ["WHEELSOIL_CACHE"] = str(Path(name) / f"cache of {command}")
                if command == "diagnose":
                    diagnosed[runs] = diagnose_cost(folder, CAUSE)
                    costs[command][runs] = diagnosed[runs].cost
                    continue
                out = Path(name) / f"{command}{OUT.get(command, '')}"
                arguments = ["-o", str(out)] if command in OUT else []
                costs[command][runs] = wheelsoil_cost(command, str(folder), *arguments)
            pages[runs] = out.stat().st_size / 1e6
    found = [row for command in COMMANDS for row in _of_command(command, costs[command], diagnosed)]
    found.append(Row(f"wheelsoil report, 20 runs of {LENGTH_S} s: size of the page", f"{pages[20]:.1f} MB"))
    return found + _law_beside_peers()


def _of_command(command: str, costs: Mapping[int, CommandCost], diagnosed: Mapping[int, DiagnoseCost]) -> list[Row]:
    found = []
    for runs, cost in costs.items():
        what = f"wheelsoil {command}, {runs} run{'s' * (runs > 1)} of {LENGTH_S} s"
        at = (command, runs)
        row = Row(what, f"{cost.cpu_s:.1f} s (wall {cost.wall_s:.1f} s)")
        if command == "diagnose":
            row = with_verdict(row, diagnosed[runs].verdict, right=diagnosed[runs].right)
        found.append(row)
        what, text = f"{what}: peak memory", f"{cost.peak_mb:.0f} MB"
        most = MEMORY_MB.get(at)
        found.append(judged(what, text, cost.peak_mb, at_most(most, "MB")) if most else Row(what, text))
    few, many = (costs[runs] for runs in GROWTH)
    for name, ratio in (("CPU", many.cpu_s / few.cpu_s), ("memory", many.peak_mb / few.peak_mb)):
        exponent = log(ratio) / log(GROWTH[1] / GROWTH[0])
        what = f"wheelsoil {command}, growth of {name} from {GROWTH[0]} to {GROWTH[1]} runs, exponent"
        found.append(judged(what, f"{exponent:.2f}", exponent, at_most(LARGEST_EXPONENT, ""), "in proportion: 1"))
    return found


def _law_beside_peers() -> list[Row]:
    try:
        found = run_beside_peers("law_fit")
    except PeersMissingError as error:
        return [Row("fit of one law: peers missing", str(error))]
    apart = max(found["apart"].values())
    remark = f", m1 and m2 within {apart:.0e} of theirs"
    what = "fit of Lyasko's law to one run of 60 s, drawbar pull"
    seconds = found["seconds"]
    beside = [
        compared(what, seconds["wheelsoil"], peer, seconds[peer], lambda s: f"{s:.3f} s", None, remark)
        for peer in ("scipy", "lmfit")
    ]
    whole = f"{median(seconds['wheelsoil, whole']):.3f} s"
    return [*beside, Row(f"{what}, with weights, intervals by profile and criteria", whole)]
