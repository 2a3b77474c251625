"""What a user waits for: the first command, the same diagnosis again, sinkage; median of five."""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

from benchmarks.table import Row, at_least, at_most, compared, judged, times
from benchmarks.timing import command_cost, wheelsoil_cost

ROUNDS = 5
ROOT = Path(__file__).parents[1]
CLAY = ROOT / "recordings" / "clay"
BARE = "import numpy, mcap, zstandard, pydantic"
"""What reading a recording needs in any program."""
START, AGAIN = 3.0, 3.0


def rows() -> list[Row]:
    """Measure whole commands."""
    with tempfile.TemporaryDirectory() as cache:
        return [_start(), _again(cache), _sinkage()]


def _start() -> Row:
    run = str(next(CLAY.glob("*.mcap")))
    ours, bare = [], []
    for _ in range(ROUNDS):
        ours.append(wheelsoil_cost("info", run).cpu_s)
        bare.append(command_cost([sys.executable, "-c", BARE]).cpu_s)
    ratio = statistics.median(ours) / statistics.median(bare)
    text, beside = (f"{statistics.median(took):.2f} s" for took in (ours, bare))
    return judged("wheelsoil info of a recording", text, ratio, at_most(START, "x"), f"{BARE}: {beside}", times(ratio))


def _again(cache: str) -> Row:
    first, second = [], []
    for round_ in range(ROUNDS):
        with patch.dict(os.environ, WHEELSOIL_CACHE=f"{cache}/{round_}"):
            first.append(wheelsoil_cost("diagnose", str(CLAY)).cpu_s)
            second.append(wheelsoil_cost("diagnose", str(CLAY)).cpu_s)
    what = "wheelsoil diagnose of recordings/clay again, from the cache"
    return compared(what, second, "the first time", first, lambda s: f"{s:.2f} s", at_least(AGAIN, "x"))


def _sinkage() -> Row:
    took = [wheelsoil_cost("sinkage", str(CLAY)).cpu_s for _ in range(ROUNDS)]
    return Row("wheelsoil sinkage of recordings/clay", f"{statistics.median(took):.2f} s")
