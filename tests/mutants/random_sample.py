"""Measure the strength of the tests against mutants that nobody chose: drawn at random, beside the listed ones.

PYTHONPATH=tests python -m mutants.random_sample --seed 20261130 --count 170
PYTHONPATH=tests python -m mutants.random_sample --seed 20261201 --count 120 --files 'daq/logs/*' 'daq/series/*' \\
  daq/balance.py daq/can/transport.py daq/gunzip.py daq/recording/reader.py daq/recording/recovery.py \\
  daq/recording/chunks.py daq/recording/contents.py 'processing/referee/*'
PYTHONPATH=tests python -m mutants.random_sample ... --slow      the slow tests and random examples, on the survivors
PYTHONPATH=tests python -m mutants.random_sample ... --again     survivors once more, after a test was added
PYTHONPATH=tests python -m mutants.random_sample ... --count 0   only the map of which test runs which line
PYTHONPATH=tests python -m mutants.random_sample ... --kills 2   until two tests have failed: tests/mutants/gate.py

It needs the package `coverage`. A mutant (tests/mutants/draws.py) meets the fast tests that run its line
(tests/mutants/line_map.py), the cheapest first and for at most `--seconds`; where none is known to, the test files
whose names or imports fit its module. Outcomes are lines of JSON in out/random_mutants: a run that was ended goes on,
also with what is not decided: what no test noticed in its seconds ("cut off") and what was "timed out".
A kill by a test of something else is to be run again alone: some tests fail in another order, or on a busy machine.
What a survivor changes is read by hand: one that changes nothing that a user could see gets its reason in
random_equivalent.json, and does not count.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection, Sequence
from fnmatch import fnmatch
from functools import cache
from itertools import accumulate
from multiprocessing.connection import wait
from pathlib import Path, PurePosixPath
from typing import Any

from mutants.checkout import ROOMS, Checkout
from mutants.draws import Edit, drawn
from mutants.line_map import FAST, KILLS, MAP, ORDER, LineMap, function_of, record
from mutants.mutant import HERE, ROOT, Mutant

SLOW = ("-m", "(slow or hypothesis) and not study", "--hypothesis-profile", "random")
EQUIVALENT = HERE / "random_equivalent.json"
LEFT_OVER = ROOT / "tests" / "left_over.txt"
"""The tests that the gate does without, which tests/conftest.py marks `slow`."""
UNDECIDED = ("", "cut off", "timed out")
_IMPORTED = (
    "pandas",
    "pyarrow.parquet",
    "scipy.optimize",
    "scipy.linalg",
    "typer",
    "rich.console",
    "jinja2",
)
_MOST_FILES = 8
_NUMBERS = "tests/golden/test_golden.py"


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw mutants and run their tests."""
    options = _options(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended"))  # as Ctrl-C: nothing goes on running
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy
    tracked = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
    names = [f for f in tracked if f.endswith(".py") and any(fnmatch(f, glob) for glob in options.files)]
    sources = {f: (ROOT / f).read_text(encoding="utf-8") for f in names if f.split("/")[0] in ROOMS}
    edits = drawn(sources, options.seed, options.count)
    print(f"seed {options.seed}: {len(edits)} mutants of {len(sources)} files", flush=True)
    results = MAP.parent / f"{options.seed}.jsonl"
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Checkout(Path(folder).resolve() / "0")
        for compiled in (ROOT / "model").glob("_compiled.*"):
            shutil.copy2(compiled, copy.folder / "model")
        for name in _IMPORTED:
            __import__(name)
        try:
            left_over = copy.folder / LEFT_OVER.relative_to(ROOT)
            names = left_over.read_text(encoding="utf-8")
            left_over.write_text("", encoding="utf-8")  # the choice is made anew, from every test
            record(copy, [f for f in tracked if PurePosixPath(f).name.startswith("test_")])
            left_over.write_text(names if options.kills == 1 else "", encoding="utf-8")
            _run(options, copy, edits, sources, results)
        finally:
            copy.stop()
    if edits:
        print(summary(results_of(results), [described(edit, sources[edit.file])["id"] for edit in edits]))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=200, help="mutants to draw; more of the same seed go on")
    parser.add_argument("--files", nargs="+", default=["*"], metavar="GLOB", help="the sources to draw from")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the tests of one mutant, as the map knows them")
    parser.add_argument("--slow", action="store_true", help="run the survivors against the slow set")
    parser.add_argument("--again", action="store_true", help="run the survivors against the fast set as it is now")
    parser.add_argument("--kills", type=int, default=1, help="tests that have to fail; 2: of left_over.txt too")
    parser.add_argument("--only", default="", metavar="TEXT", help="of the survivors those with this in their line")
    parser.add_argument("--tests", nargs="+", default=[], metavar="FILE", help="in place of those that fit a survivor")
    return parser.parse_args(arguments)


def _run(options: argparse.Namespace, copy: Checkout, edits: list[Edit], sources: dict[str, str], path: Path) -> None:
    known, lines, equivalent = results_of(path), LineMap(), equivalents()
    for number, edit in enumerate(edits, 1):
        said = described(edit, sources[edit.file])
        last = known.get(said["id"], {})
        more = options.slow or options.again
        state = last.get("state", "")
        done = state not in (("survived",) if more else UNDECIDED) or (options.slow and "slow" in last)
        if done or said["id"] in equivalent or options.only not in said["id"]:
            continue
        running = lines.tests_of(edit.file, edit.lines)
        before, seconds, marks = 0, options.seconds, SLOW if options.slow else FAST
        killers = last.get("killers", []) if options.kills > 1 else []
        if running and not more:
            before = last["run"] if state == "cut off" else 0
            ordered = cheapest_first(lines, running, fitting(edit))[before:]
            until = accumulate(lines.seconds[name] for name in ordered)
            chosen = [name for name, total in zip(ordered, until, strict=True) if total <= seconds] or ordered[:1]
            seconds = sum(lines.seconds[name] for name in chosen)
            run = before + len(chosen)
            chosen = [name for name in chosen if function_of(name) not in killers] or chosen
        else:
            chosen = options.tests or [*fitting(edit)[:_MOST_FILES], _NUMBERS]
            marks = (*marks, *(f"--deselect={test}" for test in lines.not_passed))
            seconds, run = seconds * 2, len(chosen)
        if options.kills > 1:
            os.environ[KILLS], marks = str(options.kills - len(killers)), (*marks, "--maxfail=0")
        state, failed, took = _tested(copy, edit, sources[edit.file], chosen, int(seconds), marks)
        killers = [*killers, *failed]
        state = "killed" if killers and state == "survived" else state
        few = len(killers) < options.kills and all("::" in test for test in killers)  # a file: it cannot be imported
        if state != "timed out" and few and not more and run < len(running):
            state = "cut off"
        test = next(iter(killers), "")
        said |= {"state": state, "test": test, "running": len(running), "run": run, "seconds": round(took, 1)}
        if options.kills > 1:
            said["killers"] = killers
        if options.slow:
            said = last | {"slow": state, "slow test": test}
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(said, ensure_ascii=False) + "\n")
        at = f"{edit.file}:{said['line']} {edit.kind}"
        print(f"{number}/{len(edits)} {at}: {state}, {took:.1f} s  {' '.join(killers)}", flush=True)


def described(edit: Edit, source: str) -> dict[str, Any]:
    """Return what is written of a mutant: its id depends on the text only, not on the line."""
    line = source.encode()[: edit.start].count(b"\n")
    before, after = (text.split("\n")[line].strip() for text in (source, edit.applied(source)))
    id_ = f"{edit.file} {'.'.join(edit.inside)}: {before} -> {after}"
    return {"id": id_, "file": edit.file, "line": line + 1, "kind": edit.kind, "before": before, "after": after}


def equivalents() -> dict[str, str]:
    """Return the mutants that change nothing, each with the reason."""
    return dict(json.loads(EQUIVALENT.read_text(encoding="utf-8"))) if EQUIVALENT.exists() else {}


def results_of(path: Path) -> dict[str, dict[str, Any]]:
    """Return the last outcome of each mutant by its id."""
    texts = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {said["id"]: said for said in map(json.loads, texts)}


@cache
def _test_texts() -> dict[str, str]:
    paths = sorted((ROOT / "tests").rglob("test_*.py"))
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def fitting(edit: Edit) -> list[str]:
    """Return the test files whose names fit a module, then those that name it or what the line stands in."""
    path = PurePosixPath(edit.file)
    stem, dotted = path.stem.removesuffix("s"), ".".join(path.with_suffix("").parts)
    named = [name for name in _test_texts() if stem in PurePosixPath(name).stem]
    of_folder = [name for name in _test_texts() if any(f"_{part}" in name for part in path.parts[1:-1])]
    words = "|".join(re.escape(word) for word in (dotted, *edit.inside[:1]))
    using = [name for name, text in _test_texts().items() if re.search(rf"\b({words})\b", text)]
    first = [name for name in named if name.split("/")[1] == path.parts[0]]
    return list(dict.fromkeys([*first, *of_folder, *using, *named]))


def cheapest_first(lines: LineMap, tests: Collection[str], first: Collection[str]) -> list[str]:
    """Return tests file by file, the cheapest file first among those that fit and then among the others."""
    files: dict[str, list[str]] = {}
    for test in sorted(tests, key=lambda test: (lines.seconds[test], test)):
        files.setdefault(test.split("::")[0], []).append(test)
    cost = {file: sum(lines.seconds[test] for test in found) for file, found in files.items()}
    return [test for file in sorted(files, key=lambda file: (file not in first, cost[file])) for test in files[file]]


def _tested(
    copy: Checkout, edit: Edit, source: str, chosen: list[str], seconds: int, marks: Collection[str]
) -> tuple[str, tuple[str, ...], float]:
    """Return what became of a mutant, the tests that failed, and the time."""
    os.environ.pop(ORDER, None)
    if any("::" in name for name in chosen):
        order = copy.folder / "order.json"
        order.write_text(json.dumps(chosen), encoding="utf-8")
        os.environ[ORDER] = str(order)
    tests = (*marks, *dict.fromkeys(test.split("[")[0] for test in chosen))
    mutant = Mutant("random", "random", edit.file, source, edit.applied(source), edit.kind, False, tests)
    copy.start(mutant, 60 + 3 * seconds, 300 + 10 * seconds)
    while not copy.is_late and not wait([copy.sentinel], timeout=1.0):
        pass
    try:
        outcome = copy.outcome()
    except SystemExit as error:
        if "ended with 5" not in str(error):  # no test is selected
            raise
        return "survived", (), 0.0
    return outcome.state, outcome.tests, outcome.seconds


def summary(known: dict[str, dict[str, Any]], drawn_ids: list[str]) -> str:
    """Return how many of the drawn mutants are killed, with the Clopper-Pearson bounds, and the survivors."""
    from scipy.stats import binomtest  # not before a copy has set the threads of numpy

    equivalent = equivalents()
    every = [known[id_] for id_ in drawn_ids if id_ in known]
    run = [said for said in every if said["state"] not in UNDECIDED]
    counted = [said for said in run if said["id"] not in equivalent]
    text = f"{len(run)} of {len(drawn_ids)} decided, {len(run) - len(counted)} equivalent\n"
    for key in ("fast set", "fast or the slow set"):
        states = [said["state"] if key == "fast set" else said.get("slow", said["state"]) for said in counted]
        killed = states.count("killed")
        low = binomtest(killed, max(len(counted), 1)).proportion_ci(0.95, method="exact").low
        text += f"killed by the {key}: {killed} of {len(counted)}"
        text += f", at least {low:.3f} (95 % Clopper-Pearson)\n"
    left = [said for said in every if said["state"] != "killed" and said["id"] not in equivalent]
    return text + "\n".join(
        f"{said['id']}  ({said['line']}; {said['state']}; slow: {said.get('slow', 'not run')})" for said in left
    )


if __name__ == "__main__":
    main()
