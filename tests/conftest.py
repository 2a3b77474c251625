"""Fixtures that several folders of tests share."""

from __future__ import annotations

import os
import signal
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads of two workers wait for each other
os.environ["COLUMNS"] = "96"  # what a command prints is folded to the terminal: not to that of whoever runs the tests

import pytest
from cli_support import ok, small_campaign


def pytest_configure() -> None:
    """Have commands see the signals that a terminal sends, although `nohup` or `&` had them ignored here."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign folder: two runs of 20 s on clay. Not to be written to."""
    return small_campaign(tmp_path_factory.mktemp("campaign") / "clay")


@pytest.fixture(scope="session")
def report(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of `campaign`; its numbers lie beside it."""
    page = tmp_path_factory.mktemp("report") / "report.html"
    ok("report", campaign, "-o", page)
    return page
