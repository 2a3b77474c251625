"""The page on the field day's campaigns, as each test of it finds it: nothing chosen, the first run drawn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page
from view_browser import drawn, looking
from view_client import View
from view_field_day import FieldDay

ROWS = ("slip", "speed", "load", "pull", "torque")


@pytest.fixture
def view(field_day: FieldDay) -> View:
    """Return the server, with nothing chosen."""
    field_day.view.reset()
    return field_day.view


@pytest.fixture
def folder(field_day: FieldDay) -> Path:
    """Return the folder of campaign c1, without a choice."""
    (field_day.clay / "choice.toml").unlink(missing_ok=True)
    return field_day.clay


@pytest.fixture
def page(browser: Browser, view: View) -> Iterator[Page]:
    """Return the page, with the plots of campaign c1's first run."""
    with looking(browser, view.address, refused=True) as seen:
        drawn(seen, *ROWS)
        yield seen
