"""Which tests run a line: a map from one run of the fast tests under `coverage`, kept in out/random_mutants/map.

The plugin (tests/mutants/plugin.py) writes it, and runs the tests of a mutant in their order. Lines that a fixture of a
wider scope runs belong to every test that takes it. What only child processes run is not in it.
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path

from mutants.checkout import Checkout
from mutants.mutant import ROOT

MAP = ROOT / "out" / "random_mutants" / "map"
FAST = ("-m", "not slow and not study", "--hypothesis-profile", "gate")
RECORDED, ORDER, KILLS = "MUTANTS_RECORDED", "MUTANTS_ORDER", "MUTANTS_KILLS"
"""Environment variables: where the plugin writes the map of a run; the file with the order of a mutant's tests; how
many of them have to fail to end it."""
_FOLDERS = ("daq", "processing", "certified", "model", "contract", "fuzz", "golden", "wheelsoil")
_NOT_RECORDED = ("browser", "view_page", "packaging", "/conftest", "on_windows", "dask", "examples")
"""They run in browsers, in other processes or in environments of their own."""
_FILES_AT_ONCE = 25


class LineMap:
    """The map, read from the files in a folder."""

    def __init__(self, folder: Path = MAP) -> None:
        from coverage import CoverageData

        self.seconds: dict[str, float] = {}
        self.not_passed: list[str] = []
        self.cpu: Counter[str] = Counter()
        self.children: list[str] = []
        self.takers: dict[str, set[str]] = defaultdict(set)
        for path in sorted(folder.glob("*.json")):
            said = json.loads(path.read_text(encoding="utf-8"))
            self.seconds |= said["seconds"]
            self.not_passed += said["not passed"]
            self.cpu.update(said["cpu"])
            self.children += said["children"]
            for test, fixtures in said["fixtures"].items():
                for fixture in fixtures:
                    self.takers[fixture].add(test)
        self._data = [CoverageData(str(path)) for path in sorted(folder.glob("*.sqlite"))]
        for data in self._data:
            data.read()

    def tests_of(self, file: str, lines: Iterable[int]) -> set[str]:
        """Return the tests that run one of these lines, or any of the file where none is known to."""
        tests: set[str] = set()
        for by_line in self._of_file(file):
            for line in lines:
                tests |= self.taking(by_line.get(line, ()))
        if not tests:
            for by_line in self._of_file(file):
                tests |= self.taking(name for names in by_line.values() for name in names)
        return tests

    def lines(self) -> Iterator[tuple[str, int, str]]:
        """Yield file, line and test for every line that a test runs."""
        for data in self._data:
            for path in data.measured_files():
                for line, names in data.contexts_by_lineno(path).items():
                    yield from ((path.rpartition("/0/")[2], line, test) for test in self.taking(names))

    def _of_file(self, file: str) -> Iterator[Mapping[int, list[str]]]:
        for data in self._data:
            yield from (data.contexts_by_lineno(name) for name in data.measured_files() if name.endswith("/" + file))

    def taking(self, names: Iterable[str]) -> set[str]:
        """Return the tests of these names, and those that take a fixture of these names."""
        known = set(names)
        return {test for name in known for test in self.takers.get(name, {name}) if test in self.seconds}


def record(copy: Checkout, test_files: Iterable[str], folder: Path = MAP) -> None:
    """Run the fast tests of these files that are not in the map yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for room in _FOLDERS:
        files = iter(f for f in test_files if f.startswith(f"tests/{room}/") and not any(n in f for n in _NOT_RECORDED))
        for number, chosen in enumerate(iter(lambda files=files: list(islice(files, _FILES_AT_ONCE)), [])):
            path = folder / f"{room}-{number}.json"
            if not path.exists():
                start = time.monotonic()
                os.environ[RECORDED] = str(path)
                copy.start_tests(["--maxfail=0", *FAST, *chosen])
                said = copy.end_tests()[1]
                del os.environ[RECORDED]
                if not path.exists():
                    raise SystemExit(f"{path.stem} cannot be recorded:\n{said}")
                print(f"{path.stem}: {said.splitlines()[-1]} ({time.monotonic() - start:.0f} s)", flush=True)


def function_of(test: str) -> str:
    """Return a test without its parameters."""
    return test.split("[")[0]
