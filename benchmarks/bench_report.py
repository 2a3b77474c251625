"""The report of a long campaign: how long it takes to build, its memory, its size."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.row import Row

RUNS, LENGTH_S = 20, 60
EFFECT = "lyasko:m1=0.6,m2=0.03"
MOST_S, MOST_MB, MOST_PAGE_MB = 20.0, 1500.0, 12.0


def rows() -> list[Row]:
    """Measure the whole command, recordings to page, with the diagnosis and without."""
    with tempfile.TemporaryDirectory() as name:
        folder, page = Path(name) / "sandy", Path(name) / "report.html"
        campaign = ["--soil", "sandy", "--effect", EFFECT, "--runs", str(RUNS), "--duration", str(LENGTH_S)]
        _run("simulate", *campaign, "-o", str(folder))
        built_s, cpu_s, peak_mb = _run("report", str(folder), "-o", str(page), "--no-diagnosis")
        whole_s, whole_cpu_s, whole_mb = _run("report", str(folder), "-o", str(page), "--force")
        size_mb = page.stat().st_size / 1e6
    what = f"wheelsoil report, {RUNS} runs of {LENGTH_S} s"
    return [
        Row(f"{what}, no diagnosis", f"{built_s:.1f} s", f"{cpu_s:.1f} s CPU", "", "<= 20 s", built_s <= MOST_S),
        Row(f"{what}: peak memory", f"{peak_mb:.0f} MB", "", "", "<= 1500 MB", peak_mb <= MOST_MB),
        Row(f"{what}: page with diagnosis", f"{size_mb:.1f} MB", "", "", "<= 12 MB", size_mb <= MOST_PAGE_MB),
        Row(
            f"{what}, with diagnosis",
            f"{whole_s:.0f} s",
            f"{whole_cpu_s:.0f} s CPU, {whole_mb:.0f} MB",
            "",
            "stated",
            None,
        ),
    ]


def _run(*arguments: str) -> tuple[float, float, float]:
    """Run a command to its end; return its wall time and CPU time in s, and its peak memory in MB."""
    start = time.perf_counter()
    command = [str(Path(sys.executable).with_name("wheelsoil")), *arguments]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
