"""The analyst's page when its server is gone, is locked, or refuses."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect
from view_browser import add_effect, curve_on_page, drag, drawn, looking, selection, unfold
from view_client import View, taken_from
from view_in_process import viewing_here

RECORDINGS = Path(__file__).parents[3] / "recordings"
ROWS = ("slip", "pull")
TOKEN = "a-token-of-the-test"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return taken_from(RECORDINGS / "clay", tmp_path / "clay", 1)


@pytest.mark.slow
def test_the_page_outlives_its_server_and_tells_the_next_one_what_was_chosen(browser: Browser, folder: Path) -> None:
    sandy = taken_from(RECORDINGS / "sandy", folder.parent / "sandy", 1)
    with ExitStack() as running:
        first = running.enter_context(viewing_here(folder))
        with looking(browser, first.address, refused=True) as seen:
            drawn(seen, *ROWS)
            add_effect(seen, "vasilev")
            drag(seen, 20, 30)
            seen.get_by_role("button", name="Exclude").click()
            expect(seen.locator("#kept")).to_contain_text("Kept of run-1")
            drawn(seen, *ROWS)
            asked = {"sinkage": "balanced", "effects": ["vasilev"], "values": {"H_m": 0.02}}
            before = first.post("/api/curve", campaign="c1", run="r1", **asked)
            assert curve_on_page(seen, before)
            running.close()
            expect(seen.locator("#state")).to_have_text("NO CONNECTION")
            seen.locator("[data-parameter=H_m] input[type=range]").press("ArrowRight")
            assert selection(seen) and curve_on_page(seen, before)
            with viewing_here(folder, port=first.port) as second:
                drawn(seen, *ROWS)
                expect(seen.locator("#kept")).to_contain_text("Kept of run-1")
                choice = second.settled()[0]["choice"]
                assert choice["effects"] == ["vasilev"] and len(choice["run"][0]["keep"]) == 2
            with viewing_here(sandy, port=first.port) as other:  # on other folders, of which nothing is chosen yet
                expect(seen.locator("#view-title")).to_contain_text("sandy")
                drawn(seen, *ROWS)
                expect(seen.locator("#sliders [data-effect=vasilev]")).to_have_count(0)
                assert other.campaigns()[0]["chosen"] == 0


def test_without_the_token_nothing_is_shown(browser: Browser, folder: Path) -> None:
    with viewing_here(folder, token=TOKEN) as view:
        address = f"http://127.0.0.1:{view.port}/"
        with looking(browser, address, refused=True) as seen:
            expect(seen.locator("#state")).to_have_text("TOKEN NEEDED")
            expect(seen.locator("#main")).to_be_hidden()
            seen.get_by_label("token").fill(TOKEN)
            seen.get_by_role("button", name="Open").click()
            drawn(seen, *ROWS)
        with looking(browser, f"{address}#{TOKEN}", refused=True) as seen:
            drawn(seen, *ROWS)


def test_what_the_server_refuses_is_reported_with_what_to_do(page: Page, view: View) -> None:
    unfold(page, "choice-box")
    page.get_by_label("Filter cut-off").fill("50")
    page.get_by_label("Filter cut-off").press("Enter")
    expect(page.locator("#faults li")).to_contain_text("cutoff_hz")
    expect(page.locator("#faults dt").last).to_have_text("do")
    expect(page.locator("#state")).to_have_text("NOT DONE")
    assert "cutoff_hz" not in view.campaigns()[0]["choice"]
    page.get_by_label("Filter cut-off").fill("2")
    page.get_by_label("Filter cut-off").press("Enter")
    drawn(page, *ROWS)
    assert view.settled()[0]["choice"]["cutoff_hz"] == 2
