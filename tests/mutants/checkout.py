"""Copies of the checkout in which a mutant is put and its tests are run."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from mutants.mutant import CPU_SECONDS, ROOT, Mutant

ROOMS = ("daq", "processing", "model", "wheelsoil")
PYTEST = ("-x", "-q", "--tb=no", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist")
EXAMPLES = ("-p", "mutants.plugin", "--hypothesis-seed=0")
_ALREADY_LOADED = (
    "numpy",
    "scipy.special",
    "scipy.stats",
    "scipy.signal",
    "pydantic",
    "cantools",
    "can",
    "mcap.reader",
)
"""Each mutant's tests run in a fork of this process: what takes long to import and is no mutant is there already."""
_WAITING = 10
"""Longest time for a mutant that waits instead of working, in limits of its CPU time: the machine may be busy."""


@dataclass(frozen=True)
class Outcome:
    """What became of one mutant: "killed", "survived" or "timed out", the tests that failed, and the time."""

    mutant: Mutant
    state: str
    tests: tuple[str, ...]
    seconds: float

    @property
    def test(self) -> str:
        """The first that failed."""
        return next(iter(self.tests), "")


class Checkout:
    """A copy of the checkout; it is imported in place of the installed packages. One test run at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._process: multiprocessing.context.ForkProcess | None = None
        self._mutated: tuple[Mutant, str, float] | None = None
        self._started = 0.0
        for name in _files_of_the_checkout():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
        # bytecode that is checked against the source itself: a mutant of equal length in the same second is seen
        compiled = ("-m", "compileall", "-q", "--invalidation-mode", "checked-hash", *ROOMS, "tests")
        subprocess.run([sys.executable, *compiled], cwd=folder, env=os.environ | self._environment(), check=True)
        self._require_own_packages()

    @property
    def sentinel(self) -> int:
        """File descriptor that is ready when the tests have ended."""
        assert self._process is not None
        return self._process.sentinel

    @property
    def is_late(self) -> bool:
        """Whether the tests wait for something that will not come."""
        return self._mutated is not None and time.monotonic() > self._mutated[2]

    def start(self, mutant: Mutant, limit_s: int, longest_s: float | None = None) -> None:
        """Put the error in and start its tests, with a limit of their CPU time and of the time that they take."""
        path = self.folder / mutant.file
        text = path.read_text(encoding="utf-8")
        self._mutated = (mutant, text, time.monotonic() + (longest_s or _WAITING * limit_s))
        path.write_text(mutant.applied(text), encoding="utf-8")
        self._started = time.monotonic()
        self.start_tests(mutant.tests, limit_s)

    def outcome(self) -> Outcome:
        """End the tests, take the error out again, and say what became of it."""
        assert self._mutated is not None
        mutant, text, _ = self._mutated
        late = self.is_late
        code, said = self.end_tests()
        (self.folder / mutant.file).write_text(text, encoding="utf-8")
        self._mutated = None
        state, tests = ("timed out", ()) if late else _verdict(code, said)
        return Outcome(mutant, state, tests, time.monotonic() - self._started)

    def start_tests(self, tests: Iterable[str], limit_s: int | None = None) -> None:
        """Run tests in a fork of this process."""
        limit = {} if limit_s is None else {CPU_SECONDS: str(limit_s)}
        _load()
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=self._run, args=(tuple(tests), self._environment() | limit))
        self._process.start()

    def end_tests(self) -> tuple[int, str]:
        """Wait for the tests; return pytest's exit code, minus a signal's number where one ended it, and its output."""
        assert self._process is not None
        if not self.is_late:
            self._process.join()
        self.stop()
        return int(self._process.exitcode or 0), self._output.read_text(encoding="utf-8", errors="replace")

    def stop(self) -> None:
        """End pytest and whatever its tests started and a mutant kept from ending."""
        if self._process is not None and self._process.pid is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.join()

    @property
    def _output(self) -> Path:
        return self.folder.with_suffix(".txt")

    def _run(self, tests: tuple[str, ...], environment: dict[str, str]) -> None:
        """Be pytest, in the copy; in the forked process."""
        os.setsid()
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.chdir(self.folder)
        os.environ.pop("WHEELSOIL_DATA", None)
        os.environ.update(environment)
        sys.dont_write_bytecode = True
        sys.path[:0] = [str(self.folder), str(self.folder / "tests")]
        with self._output.open("wb") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        code = int(pytest.main([*PYTEST, *EXAMPLES, *tests]))
        sys.stdout.flush()
        os._exit(code)

    def _require_own_packages(self) -> None:
        """Check from outside the copy that its packages are imported, not the installed ones."""
        show = f"import {', '.join(ROOMS)}; print({', '.join(f'{room}.__file__' for room in ROOMS)}, sep='\\n')"
        environment = os.environ | self._environment()
        got = subprocess.check_output([sys.executable, "-c", show], cwd="/", env=environment, text=True)
        if got.splitlines() != [str(self.folder / room / "__init__.py") for room in ROOMS]:
            raise SystemExit(f"expected to import the copy in {self.folder}, got\n{got}")

    def _environment(self) -> dict[str, str]:
        path = os.pathsep.join([str(self.folder), str(self.folder / "tests")])
        return {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}


def _load() -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy
    for name in _ALREADY_LOADED:
        importlib.import_module(name)
    assert not set(ROOMS) & set(sys.modules)


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


def _verdict(code: int, said: str) -> tuple[str, tuple[str, ...]]:
    """Return what became of a mutant, and the tests that failed, without parameters."""
    if code == 0:
        return "survived", ()
    failed = tuple(dict.fromkeys(re.findall(r"^(?:FAILED|ERROR) ([^\s\[]+)", said, re.M)))
    if code in (-signal.SIGXCPU, -signal.SIGKILL) and not failed:
        return "timed out", ()
    broken = failed or "while loading conftest" in said or "INTERNALERROR" in said
    if code not in (1, 2, -signal.SIGSEGV) and not broken:
        raise SystemExit(f"pytest ended with {code}:\n{said}")
    return "killed", failed or ("while the tests were collected",)
