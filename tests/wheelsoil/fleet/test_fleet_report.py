"""The fleet's page in Debian's Chromium: what is on it, and how its table is sorted and searched."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from cli_support import invoke, ok
from live_browser import shown, tab
from playwright.sync_api import Browser, Page, expect

from model.diagnosis.pooling import Passport
from wheelsoil.fleet import Overview, Pooled, open_store, overview_of


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


@pytest.mark.usefixtures("one_process")
def test_names_are_data_and_reports_are_linked(fleet: Path, tmp_path: Path) -> None:
    place = tmp_path / "field" / "<b>day</b> & 1"
    shutil.copytree(fleet / "spring" / "day-1", place)
    (place / "report.html").write_text("a report")
    ok("fleet", "run", tmp_path / "field", "--store", tmp_path / "s", "--effects", "vasilev")
    html = overview_of(open_store(str(tmp_path / "s"))).html(tmp_path)
    assert "<b>day</b>" not in html and "&lt;b&gt;day&lt;/b&gt; &amp; 1</a>" in html
    assert 'href="field/' in html
    assert invoke("fleet", "report", tmp_path / "s", "-o", tmp_path / "none" / "f.html").code == 2


@pytest.mark.usefixtures("warm", "one_process")
def test_a_store_without_transducers_and_causes_says_so(fleet: Path, tmp_path: Path) -> None:
    shutil.copytree(fleet / "bench", tmp_path / "field" / "bench")
    ok("fleet", "run", tmp_path / "field", "--store", tmp_path / "s")
    overview = overview_of(open_store(str(tmp_path / "s")))
    assert overview.headline == "No cause is named in any of 1 campaigns." and not overview.pulls
    assert "No campaign says which transducer" in overview.html(tmp_path)
    for none, said in ((0.124, "no cause is sure"), (0.9, "nothing detectable")):
        campaigns = overview.campaigns.assign(verdict="nothing_detectable", none_probability=none)
        assert said in replace(overview, campaigns=campaigns).html(tmp_path)


def test_the_transducers_begin_on_the_first_screen(page: Path, browser: Browser) -> None:
    seen = browser.new_page(viewport={"width": 1366, "height": 768})
    seen.goto(page.as_uri())
    box = seen.locator("#transducers").bounding_box()
    seen.close()
    assert box is not None and box["y"] < 384


def test_a_phone_shows_each_verdict_with_its_cause(page: Path, browser: Browser) -> None:
    seen = browser.new_page(viewport={"width": 390, "height": 844})
    with closing(seen), shown(seen, page.as_uri(), {}):
        scroll = seen.locator("#campaigns .scroll")
        assert scroll.evaluate("each => each.scrollWidth <= each.clientWidth")
        row = seen.locator("#table tbody tr", has_text="autumn/day-2")
        expect(row.locator(".cause")).to_be_visible()
        expect(seen.locator("#pull svg text")).to_be_visible()
        size = seen.locator("#pull svg text").evaluate("each => each.getBoundingClientRect().height")
        assert size > 10.0
        expect(seen.locator(".further")).to_be_visible()
        seen.emulate_media(media="print")
        expect(seen.locator(".further")).to_be_hidden()
        expect(seen.get_by_role("columnheader", name="pull at 0.2, N")).to_be_visible()


@pytest.mark.slow
def test_the_legend_of_the_map_has_its_colours_in_both_modes(page: Path, browser: Browser) -> None:
    for mode in ("light", "dark"):
        seen = browser.new_page(color_scheme=mode)
        with closing(seen), shown(seen, page.as_uri(), {}):
            for fifth in (1, 5):
                swatch, place = (seen.locator(f"{each}.dens-{fifth}").first for each in (".swatch", "#pull circle"))
                colour = swatch.evaluate("each => getComputedStyle(each).backgroundColor")
                assert colour == place.evaluate("each => getComputedStyle(each).fill")


@pytest.mark.parametrize(
    ("decisions", "headline"),
    [
        (["nothing"], "No cause is named in any of 0 campaigns."),
        (["named"], "Transducer 0 is wrong: load gain and load zero."),
        (["flagged"], "Transducer 0 is wrong: load gain or load zero (not separable)."),
        (
            ["named", "flagged"],
            "2 transducers are wrong. 0: load gain and load zero; 1: load gain or load zero (not separable).",
        ),
        (["named", "named"], "Transducers 0 and 1 are wrong: load gain and load zero."),
    ],
)
def test_a_tie_between_channels_is_called_one(decisions: Sequence[Any], headline: str) -> None:
    effects = ("load_gain", "load_zero")
    passports = tuple(
        Passport(str(i), (), each, effects, 0.99, (), {}, 0.0, {}, ()) for i, each in enumerate(decisions)
    )
    none = pd.DataFrame({"campaign": [], "state": []})
    assert Overview("", none, {}, Pooled(passports, (), (), ()), datetime.now(UTC)).headline == headline
