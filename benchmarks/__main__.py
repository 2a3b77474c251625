"""Run every benchmark side by side and write results.md: ``python -m benchmarks [name ...]``."""

from __future__ import annotations

import importlib
import os
import platform
import sys
from pathlib import Path

from benchmarks.row import Row

HERE = Path(__file__).parent
NAMES = tuple(sorted(p.stem for p in HERE.glob("bench_*.py")))


def main(names: list[str]) -> int:
    chosen = [f"bench_{n.removeprefix('bench_')}" for n in names] or list(NAMES)
    rows: list[Row] = []
    for name in chosen:
        print(f"== {name}", flush=True)
        for row in importlib.import_module(f"benchmarks.{name}").rows():
            print(row.line(), flush=True)
            rows.append(row)
    if not names:
        (HERE / "results.md").write_text(_markdown(rows), encoding="utf-8")
    return 0


def _markdown(rows: list[Row]) -> str:
    head = (
        "# Benchmarks\n\n`make bench` measured these side by side in one run; medians of several. "
        f"{os.cpu_count()} cores, Python {platform.python_version()}, {platform.machine()}. Noisy: trust ratios.\n\n"
        "| what | ours | peer or mark | ratio | to reach | reached |\n|---|---|---|---|---|---|\n"
    )
    return head + "\n".join(row.line() for row in rows) + "\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
