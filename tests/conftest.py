"""Fixtures that several folders of tests share."""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter
from pathlib import Path
from typing import Any

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else every command that a test starts compiles all of us anew
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads of two workers wait for each other
os.environ.setdefault("WHEELSOIL_JOBS", "1")  # tests use all cores already
os.environ["WHEELSOIL_CACHE"] = "off"  # else what a test made would be what the next one sees; no test touches a home
os.environ["COLUMNS"] = "96"  # what a command prints is folded to the terminal: not to that of whoever runs the tests

import pytest
from cli_support import small_campaign
from hypothesis import settings
from scheduling import GroupScheduling, rank
from shared_results import made_once

settings.register_profile("gate", deadline=None, derandomize=True, max_examples=20)
settings.register_profile("random", deadline=None, print_blob=True)
settings.load_profile("random")  # also where CI is set, for which Hypothesis has a profile of its own


def pytest_configure() -> None:
    """Have bytecode kept, and commands see the signals that a terminal sends, although `nohup` had them ignored."""
    sys.dont_write_bytecode = False
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Have files run as groups, and those that share a server or a guest."""
    return GroupScheduling(config, log)


LEFT_OVER = frozenset((Path(__file__).parent / "left_over.txt").read_text(encoding="utf-8").split())
"""The tests that the gate does without (docs/testing.md): `make gate-choice` writes the file."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the folders whose tests wait, and leave to the slow set what the gate does without."""
    for item in items:
        if item.nodeid.split("[")[0] in LEFT_OVER:
            item.add_marker("slow")
    items.sort(key=lambda item: rank(item.nodeid.split("/")[1]))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how long the tests of each folder took, with their fixtures: one worker's seconds."""
    seconds: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in (one for one in reports if isinstance(one, pytest.TestReport)):
            seconds["/".join(report.nodeid.split("/")[:2])] += report.duration
    terminalreporter.section("seconds of each folder")
    for folder, total in seconds.most_common():
        terminalreporter.write_line(f"{total:7.1f} s  {folder}")


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign folder: two runs of 20 s on clay. Not to be written to."""
    return made_once(tmp_path_factory, "campaign", lambda folder: small_campaign(folder / "clay")) / "clay"
