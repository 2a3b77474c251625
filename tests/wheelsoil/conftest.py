"""Fixtures that several files of this folder share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from report_support import material_of, processed_of
from view_client import View, viewing

from wheelsoil.diagnosing import Processed
from wheelsoil.report.material import Material

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Return a Chromium; each file has its own, for Playwright keeps its thread's event loop to itself."""
    from live_browser import chromium

    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def view(folder: Path) -> Iterator[View]:
    """Return the analyst's page on the file's own `folder`, with all runs processed."""
    with viewing(folder) as running:
        running.settled()
        yield running


@pytest.fixture(scope="session")
def processed(campaign: Path) -> Processed:
    """Return the runs of `campaign`, processed."""
    return processed_of(campaign)


@pytest.fixture(scope="session")
def material(processed: Processed) -> Material:
    """Return what the report of `campaign` is made from, without a diagnosis."""
    return material_of(processed)
