"""Pytest plugin of the runner: the first example that fails ends a test, and so does a mutant that never ends.

For mutants drawn at random it also records which test runs which line and its CPU time, orders the tests of a mutant,
and ends them when so many have failed.
"""

from __future__ import annotations

import json
import os
import resource
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import Phase, settings
from mutants.line_map import KILLS, ORDER, RECORDED, function_of
from mutants.mutant import CPU_SECONDS

if CPU_SECONDS in os.environ:
    limit = int(os.environ[CPU_SECONDS])
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))


@pytest.hookimpl(trylast=True)
def pytest_configure() -> None:
    """Do not shrink an example: whatever the profile, which conftest or the command line has loaded by now."""
    settings.register_profile("mutants", settings(), phases=(Phase.explicit, Phase.generate), database=None)
    settings.load_profile("mutants")


def _cpu_s() -> list[float]:
    """Return the CPU time of this process, and of its children that have ended."""
    used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return [one.ru_utime + one.ru_stime for one in used]


class _Recorder:
    """Writes which test runs which line, how long each takes, and which fixtures it takes."""

    def __init__(self, path: Path) -> None:
        from coverage import Coverage

        self._path = path
        self._cpu: dict[str, float] = defaultdict(float)
        self._children: set[str] = set()
        self._since = _cpu_s()
        self._seconds: dict[str, float] = defaultdict(float)
        self._not_passed: set[str] = set()
        self._fixtures: dict[str, list[str]] = {}
        self._context = ""
        here = [str(Path.cwd() / room / "*") for room in ("daq", "processing", "model", "wheelsoil")]
        self._coverage = Coverage(str(path.with_suffix(".part")), include=here, config_file=False, messages=False)
        self._coverage.start()

    def _switch(self, context: str) -> str:
        before, self._context = self._context, context
        now = _cpu_s()
        own, children = (new - old for new, old in zip(now, self._since, strict=True))
        self._since = now
        self._cpu[before] += own + children
        self._children |= {before} if children > 0 else set()
        self._coverage.switch_context(context)
        return before

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, Any, Any]:
        known = item._fixtureinfo.name2fixturedefs
        self._fixtures[item.nodeid] = [_name_of(known[name][-1]) for name in item.fixturenames if name in known]
        self._switch(item.nodeid)
        self._children |= {item.nodeid} if "browser" in item.fixturenames else set()
        try:
            return (yield)
        finally:
            self._switch("")

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Any, Any]:
        before = self._switch(self._context if fixturedef.scope == "function" else _name_of(fixturedef))
        try:
            return (yield)
        finally:
            self._switch(before)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.nodeid] += report.duration
        if not report.passed:
            self._not_passed.add(report.nodeid)

    def pytest_unconfigure(self) -> None:
        self._switch("")
        self._coverage.stop()
        self._coverage.save()
        self._path.with_suffix(".part").rename(self._path.with_suffix(".sqlite"))
        seconds = {test: s for test, s in self._seconds.items() if test not in self._not_passed}
        said = {"seconds": seconds, "fixtures": self._fixtures, "not passed": sorted(self._not_passed)}
        said |= {"cpu": self._cpu, "children": sorted(self._children)}
        self._path.write_text(json.dumps(said), encoding="utf-8")


def _name_of(fixturedef: Any) -> str:
    return f"fixture {fixturedef.baseid}::{fixturedef.argname}"


_failed: set[str] = set()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Say at once which test fails: a later one may never end. End when so many have failed."""
    report = yield
    if report.failed and KILLS in os.environ:
        _failed.add(function_of(item.nodeid))
        item.config.pluginmanager.getplugin("terminalreporter").write_line(f"FAILED {item.nodeid}", flush=True)
        item.session.shouldfail = "killed" if len(_failed) == int(os.environ[KILLS]) else item.session.shouldfail
    return report


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Take the tests of a mutant, in their order; of a test with parameters only those that run its line."""
    if ORDER in os.environ:
        order = {test: rank for rank, test in enumerate(json.loads(Path(os.environ[ORDER]).read_text("utf-8")))}
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in order])
        items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Begin to record, where that is asked for, before a conftest imports what is recorded."""
    if RECORDED in os.environ:
        early_config.pluginmanager.register(_Recorder(Path(os.environ[RECORDED])))
