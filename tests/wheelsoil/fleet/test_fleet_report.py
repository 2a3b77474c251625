"""The fleet's page in Debian's Chromium: what is on it, and how its table is sorted and searched."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from cli_support import invoke, ok
from live_browser import shown, tab
from playwright.sync_api import Browser, Page, expect

from wheelsoil.fleet import open_store, overview_of


@pytest.fixture(scope="module")
def page(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page; its numbers lie beside it."""
    folder = tmp_path_factory.mktemp("page")
    said = ok("fleet", "report", store, "-o", folder / "fleet.html")
    assert said.out == "Transducer WFT-2 is wrong: drawbar pull gain.\n"
    return folder / "fleet.html"


@pytest.fixture
def numbers(page: Path) -> Any:
    """Return the page's numbers."""
    return json.loads(page.with_suffix(".json").read_text())


def _names(seen: Page) -> list[str]:
    return seen.locator("#table tbody tr:not([hidden]) td:first-child").all_inner_texts()


def test_the_page_shows_its_numbers_and_its_table_is_sorted_and_searched(
    page: Path, numbers: Any, browser: Browser
) -> None:
    said: list[str] = []
    seen = tab(browser)
    listeners = {
        "console": lambda message: said.append(message.text),
        "pageerror": lambda error: said.append(str(error)),
        "request": lambda request: said.append(request.url) if not request.url.startswith("file:") else None,
    }
    with shown(seen, page.as_uri(), listeners):
        expect(seen.locator("h1")).to_have_text(numbers["headline"])
        expect(seen.locator(".badge")).to_have_text("▲ 1 failed")
        assert _names(seen) == [row["campaign"] for row in numbers["campaigns"]]
        for one in numbers["transducers"]:
            figure = seen.locator("figure", has_text=f"{one['serial']}: {len(one['campaigns'])} campaigns")
            expect(figure.locator(".wide-svg .point")).to_have_count(len(one["campaigns"]))
        expect(seen.locator("#pull svg circle")).to_have_count(6)
        pull = seen.get_by_role("button", name="pull at 0.2, N")
        pull.click()
        by_pull = sorted(numbers["campaigns"], key=lambda row: row["pull_at_slip_0_2_n"] or 1e9)
        assert _names(seen)[:6] == [row["campaign"] for row in by_pull][:6]  # those without one are last
        pull.click()
        assert _names(seen)[:6] == [row["campaign"] for row in by_pull][:6][::-1]
        seen.get_by_label("Search").fill("WFT-1 clay")
        assert sorted(_names(seen)) == ["spring/day-1", "spring/day-3", "spring/day-5"]
        expect(seen.locator("#count")).to_have_text("3 of 8")
    assert not said


def test_names_are_data_and_reports_are_linked(fleet: Path, tmp_path: Path) -> None:
    place = tmp_path / "field" / "<b>day</b> & 1"
    shutil.copytree(fleet / "spring" / "day-1", place)
    (place / "report.html").write_text("a report")
    ok("fleet", "run", tmp_path / "field", "--store", tmp_path / "s")
    html = overview_of(open_store(str(tmp_path / "s"))).html(tmp_path)
    assert "<b>day</b>" not in html and "&lt;b&gt;day&lt;/b&gt; &amp; 1</a>" in html
    assert 'href="field/' in html
    assert invoke("fleet", "report", tmp_path / "s", "-o", tmp_path / "none" / "f.html").code == 2


def test_a_store_without_transducers_and_causes_says_so(fleet: Path, tmp_path: Path) -> None:
    shutil.copytree(fleet / "bench", tmp_path / "field" / "bench")
    ok("fleet", "run", tmp_path / "field", "--store", tmp_path / "s")
    overview = overview_of(open_store(str(tmp_path / "s")))
    assert overview.headline == "No cause is named in any of 1 campaigns." and not overview.pulls
    assert "No campaign says which transducer" in overview.html(tmp_path)
