"""Measure the strength of the tests: put one error at a time into a copy of the checkout, and see which test fails.

make mutants                                              every list, and docs/mutants.md
PYTHONPATH=tests python -m mutants.run --only 'model/*'   one list, or ids; docs/mutants.md keeps the others
PYTHONPATH=tests python -m mutants.run --check            only whether the lists still fit the source

The checkout is not touched. Public data (WHEELSOIL_DATA) is not used: a mutant has to be killed by what the repository
carries, without the slow tests.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from queue import SimpleQueue

from mutants.mutant import ROOT, Mutant, all_mutants, problems
from mutants.plugin import CPU_SECONDS
from mutants.table import write_table

ROOMS = ("daq", "processing", "model", "wheelsoil")
PYTEST = ("-m", "pytest", "-x", "-q", "--tb=no", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist")
EXAMPLES = ("-p", "mutants.plugin", "--hypothesis-seed=0")
_WAITING = 10
"""Longest time for a mutant that waits instead of working, in limits of its CPU time: the machine may be busy."""


@dataclass(frozen=True)
class Outcome:
    """What became of one mutant: "killed", "survived" or "timed out", the test that failed, and the time."""

    mutant: Mutant
    state: str
    test: str
    seconds: float


class Copy:
    """A copy of the checkout in which tests run; it is imported in place of the installed packages."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._process: subprocess.Popen[str] | None = None
        for name in _files_of_the_checkout():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
        # bytecode that is checked against the source itself: a mutant of equal length in the same second is seen
        compiled = ("-m", "compileall", "-q", "--invalidation-mode", "checked-hash", *ROOMS, "tests")
        subprocess.run([sys.executable, *compiled], cwd=folder, env=self._environment(), check=True)
        self._require_own_packages()

    def test(self, mutant: Mutant, limit_s: int) -> Outcome:
        """Put the error in, run its tests, take it out again."""
        path = self.folder / mutant.file
        text = path.read_text(encoding="utf-8")
        path.write_text(mutant.applied(text), encoding="utf-8")
        start = time.monotonic()
        try:
            state, test = _verdict(*self.run_tests(mutant.tests, limit_s))
        finally:
            path.write_text(text, encoding="utf-8")
        return Outcome(mutant, state, test, time.monotonic() - start)

    def run_tests(self, tests: Iterable[str], limit_s: int | None = None) -> tuple[int, str]:
        """Return pytest's exit code, minus a signal's number where one ended it, and what it printed."""
        limit = {} if limit_s is None else {CPU_SECONDS: str(limit_s)}
        process = self._process = subprocess.Popen(
            [sys.executable, *PYTEST, *EXAMPLES, *tests],
            cwd=self.folder,
            env=self._environment() | limit,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said, _ = process.communicate(timeout=None if limit_s is None else _WAITING * limit_s)
            return process.returncode, said
        except subprocess.TimeoutExpired:
            return -signal.SIGXCPU, ""
        finally:
            self.stop()

    def stop(self) -> None:
        """End pytest and whatever its tests started and a mutant kept from ending."""
        process, self._process = self._process, None
        if process is not None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def _require_own_packages(self) -> None:
        """Check from outside the copy that its packages are imported, not the installed ones."""
        show = f"import {', '.join(ROOMS)}; print({', '.join(f'{room}.__file__' for room in ROOMS)}, sep='\\n')"
        got = subprocess.check_output([sys.executable, "-c", show], cwd="/", env=self._environment(), text=True)
        if got.splitlines() != [str(self.folder / room / "__init__.py") for room in ROOMS]:
            raise SystemExit(f"expected to import the copy in {self.folder}, got\n{got}")

    def _environment(self) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if name != "WHEELSOIL_DATA"}
        path = os.pathsep.join([str(self.folder), str(self.folder / "tests")])
        return kept | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}


def main() -> None:
    """Run the mutants that the command line names."""
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended"))  # as Ctrl-C: nothing goes on running
    mutants = all_mutants()
    wrong = problems(mutants)
    if wrong or options.check:
        sys.exit("\n".join(wrong) or None)
    chosen = [mutant for mutant in mutants if _is_named(mutant, options.only)]
    if not chosen:
        sys.exit(f"no mutant is named {' or '.join(options.only)}")
    with _copies(options.jobs) as copies:
        _require_passing_tests(copies[0], chosen)
        outcomes = list(_shown(_tested(chosen, copies, options.limit), len(chosen)))
    write_table(ROOT / "docs" / "mutants.md", mutants, {o.mutant.id: o.test or f"**{o.state}**" for o in outcomes})
    survived = [outcome.mutant.id for outcome in outcomes if outcome.state == "survived"]
    print(f"{len(outcomes) - len(survived)} of {len(outcomes)} killed; survived: {', '.join(survived) or 'none'}")
    sys.exit(bool(survived))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only check that the lists fit the source")
    parser.add_argument("--only", nargs="+", default=["*"], metavar="ID", help="ids, or list/id; * stands for anything")
    parser.add_argument("--jobs", type=int, default=2, help="copies of the checkout at work at the same time")
    parser.add_argument("--limit", type=int, default=60, help="CPU seconds for the tests of one mutant")
    return parser.parse_args()


def _is_named(mutant: Mutant, names: list[str]) -> bool:
    return any(fnmatch(mutant.id, name) or fnmatch(f"{mutant.room}/{mutant.id}", name) for name in names)


@contextmanager
def _copies(count: int) -> Iterator[list[Copy]]:
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        yield [Copy(Path(folder).resolve() / str(number)) for number in range(count)]


def _files_of_the_checkout() -> list[str]:
    """Return tracked files and new ones that are not ignored."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--deduplicate"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def _require_passing_tests(copy: Copy, mutants: list[Mutant]) -> None:
    """Run every test that is used once, without any error in the source."""
    tests = dict.fromkeys(test for mutant in mutants for test in mutant.tests)
    start = time.monotonic()
    code, said = copy.run_tests(tests)
    if code != 0:
        sys.exit(f"the tests do not pass without a mutant:\n{said}")
    print(f"without a mutant: {said.strip().splitlines()[-1]} ({time.monotonic() - start:.0f} s)", flush=True)


def _tested(mutants: list[Mutant], copies: list[Copy], limit_s: int) -> Iterator[Outcome]:
    """Share the mutants out among the copies; outcomes come in the order of the mutants."""
    free: SimpleQueue[Copy] = SimpleQueue()
    for copy in copies:
        free.put(copy)

    def test(mutant: Mutant) -> Outcome:
        copy = free.get()
        try:
            return copy.test(mutant, limit_s)
        finally:
            free.put(copy)

    with ThreadPoolExecutor(len(copies)) as pool:
        waiting = [pool.submit(test, mutant) for mutant in mutants]
        try:
            for one in waiting:
                yield one.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for copy in copies:
                copy.stop()


def _shown(outcomes: Iterable[Outcome], count: int) -> Iterator[Outcome]:
    for number, outcome in enumerate(outcomes, 1):
        said = f"{outcome.state}, {outcome.seconds:.1f} s  {outcome.test}"
        print(f"{number}/{count} {outcome.mutant.room}/{outcome.mutant.id}: {said}", flush=True)
        yield outcome


def _verdict(code: int, said: str) -> tuple[str, str]:
    if code == 0:
        return "survived", ""
    if code == -signal.SIGXCPU:
        return "timed out", ""
    if code not in (1, 2):
        sys.exit(f"pytest ended with {code}:\n{said}")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.M)
    return "killed", failed[1] if failed else "while the tests were collected"


if __name__ == "__main__":
    main()
