"""The report of a long campaign: how long it takes to build, its memory, its size."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.table import Row, at_most, judged
from benchmarks.timing import CommandCost, wheelsoil_cost

RUNS, LENGTH_S = 20, 60
EFFECT = "lyasko:m1=0.6,m2=0.03"


def rows() -> list[Row]:
    """Measure the whole command, recordings to page, with the diagnosis and without."""
    with tempfile.TemporaryDirectory() as name:
        folder, page = Path(name) / "sandy", Path(name) / "report.html"
        campaign = ["--soil", "sandy", "--effect", EFFECT, "--runs", str(RUNS), "--duration", str(LENGTH_S)]
        wheelsoil_cost("simulate", *campaign, "-o", str(folder))
        fitted = wheelsoil_cost("report", str(folder), "-o", str(page), "--no-diagnosis")
        diagnosed = wheelsoil_cost("report", str(folder), "-o", str(page), "--force")
        size_mb = page.stat().st_size / 1e6
    what = f"wheelsoil report, {RUNS} runs of {LENGTH_S} s"
    return [
        judged(f"{what}, no diagnosis", _seconds(fitted), fitted.cpu_s, at_most(20, "s")),
        judged(f"{what}, no diagnosis: peak memory", f"{fitted.peak_mb:.0f} MB", fitted.peak_mb, at_most(1500, "MB")),
        Row(f"{what}, with diagnosis", _seconds(diagnosed)),
        Row(f"{what}, with diagnosis: peak memory", f"{diagnosed.peak_mb:.0f} MB"),
        judged(f"{what}, with diagnosis: size of the page", f"{size_mb:.1f} MB", size_mb, at_most(12, "MB")),
    ]


def _seconds(cost: CommandCost) -> str:
    return f"{cost.cpu_s:.1f} s (wall {cost.wall_s:.1f} s)"
