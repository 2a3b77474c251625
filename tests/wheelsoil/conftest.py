"""Fixtures that several files of this folder share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cli_support import ok
from diagnosis_samples import diagnosis, seen
from live_client import page
from report_support import diagnosed_by_hand, material_of, processed_of
from shared_results import made_once
from view_client import View
from view_field_day import FieldDay, field_day_in
from view_in_process import viewing_here

from wheelsoil.live import PagePanel
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.workflows.diagnosis import Processed

if TYPE_CHECKING:
    from live_browser import SharedChromium
    from playwright.sync_api import Browser


RECORDINGS = Path(__file__).parents[2] / "recordings"
_chromium: list[SharedChromium] = []


@pytest.fixture
def browser(request: pytest.FixtureRequest) -> Browser:
    """Return a Chromium, one for all tests in a row that use it."""
    from live_browser import SharedChromium

    if not _chromium:
        _chromium.append(SharedChromium())
        request.session.addfinalizer(_chromium[0].close)
    return _chromium[0].browser()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    """Close Chromium before a test that does not use it: Playwright keeps the thread's event loop to itself."""
    if _chromium and "browser" not in getattr(nextitem, "fixturenames", ()):
        _chromium[0].close()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder in which results are kept for a test."""
    monkeypatch.setenv("WHEELSOIL_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


@pytest.fixture(scope="module")
def shared_panel() -> Iterator[PagePanel]:
    """Return the status page of a logger, for a file's tests."""
    with page() as panel:
        yield panel


@pytest.fixture
def panel(shared_panel: PagePanel) -> PagePanel:
    """Return it for a test to which it does not matter what was shown before; no command waits in it."""
    shared_panel.commands()
    return shared_panel


@pytest.fixture(scope="module")
def view(folder: Path) -> Iterator[View]:
    """Return the analyst's page on the file's own `folder`, with all runs processed."""
    with viewing_here(folder) as running:
        running.settled()
        yield running


@pytest.fixture(scope="session")
def field_day(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FieldDay]:
    """Return the analyst's page on several campaigns, for all tests of the page that take back what they choose."""
    with field_day_in(tmp_path_factory.mktemp("page")) as found:
        yield found


@pytest.fixture(scope="session")
def report(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of `campaign`, with a diagnosis made by hand; its numbers lie beside it."""

    def make(folder: Path) -> None:
        with diagnosed_by_hand(replace(diagnosis("named"), plot_data=(seen(samples=900),))):
            ok("report", campaign, "-o", folder / "report.html")

    return made_once(tmp_path_factory, "report", make) / "report.html"


@pytest.fixture(scope="session")
def sample_report(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return what makes the report, with a diagnosis, of a campaign that is shipped; its numbers lie beside it."""

    def report(name: str) -> Path:
        made = made_once(
            tmp_path_factory, name, lambda folder: ok("report", RECORDINGS / name, "-o", folder / f"{name}.html")
        )
        return made / f"{name}.html"

    return report


@pytest.fixture(scope="session")
def processed(campaign: Path) -> Processed:
    """Return the runs of `campaign`, processed."""
    return processed_of(campaign)


@pytest.fixture(scope="session")
def material(processed: Processed) -> ReportInputs:
    """Return what the report of `campaign` is made from, without a diagnosis."""
    return material_of(processed)
