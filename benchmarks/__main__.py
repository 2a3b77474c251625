"""Measure side by side: ``python -m benchmarks [name ...]``, each benchmark in a process of its own.

Without a name all of them run, and the table goes to out/bench/results.md, its rows with a mark to marks.md beside it.
A missed mark is no failure.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks.table import Row, page

HERE = Path(__file__).parent
RESULTS = HERE.parent / "out" / "bench" / "results.md"
NAMES = tuple(sorted(path.stem.removeprefix("bench_") for path in HERE.glob("bench_*.py")))
LIMIT_S = 5400.0
"""A benchmark that takes longer has failed."""
_ROWS_ONLY = "--rows"


class BenchmarkError(Exception):
    """A benchmark failed or did not finish."""


def main(arguments: Sequence[str]) -> int:
    """Run the benchmarks named, or all; return the exit status."""
    os.environ["WHEELSOIL_CACHE"] = "off"  # nothing measured was computed before
    if arguments[:1] == [_ROWS_ONLY]:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell ignores it
        module = importlib.import_module(f"benchmarks.bench_{arguments[1]}")
        print(json.dumps([asdict(row) for row in module.rows()]))
        return 0
    if "--help" in arguments or "-h" in arguments:
        print(f"{__doc__}\nThere are: {', '.join(NAMES)}.")
        return 0
    names = [name.removeprefix("bench_") for name in arguments]
    if unknown := sorted(set(names) - set(NAMES)):
        print(f"no benchmark {', '.join(unknown)}; there are {', '.join(NAMES)}", file=sys.stderr)
        return 2
    return run(names or NAMES, None if names else RESULTS)


def run(names: Sequence[str], results: Path | None, measure: Callable[[str], list[Row]] | None = None) -> int:
    """Run benchmarks one after the other, print their rows and write the table; 1 where one failed, else 0."""
    load = os.getloadavg()[0]
    rows: list[Row] = []
    failed = False
    for name in names:
        print(f"== {name}", flush=True)
        try:
            found = (measure or in_own_process)(name)
        except BenchmarkError as error:
            failed = True
            found = [Row(f"{name}: failed", str(error))]
        for row in found:
            print(row.line(), flush=True)
        rows += found
    if results:
        results.parent.mkdir(parents=True, exist_ok=True)
        results.write_text(page(rows, load), encoding="utf-8")
        marked = [row for row in rows if row.reached is not None]
        results.with_name("marks.md").write_text(page(marked, load), encoding="utf-8")
        print(results)
    return int(failed)


def in_own_process(name: str) -> list[Row]:
    """Run a benchmark in a process of its own: it finds no memory, no modules and no threads of the one before.

    Raises
    ------
    BenchmarkError
        If it fails or takes longer than `LIMIT_S`; its children are ended with it.
    """
    command = [sys.executable, "-m", "benchmarks", _ROWS_ONLY, name]
    with subprocess.Popen(
        command, cwd=HERE.parent, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            said, _ = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            raise BenchmarkError(f"not finished after {LIMIT_S:g} s") from None
        finally:
            _end(process)
    if process.returncode:
        raise BenchmarkError(f"exit status {process.returncode}, see above")
    return [Row(**row) for row in json.loads(said.splitlines()[-1])]


def _end(process: subprocess.Popen[str]) -> None:
    """End the process and what it left behind."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
