"""A name that turns the direction of writing (U+202E and its like) turns nothing but itself, on every HTML surface."""

from __future__ import annotations

import shutil
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import pytest
from cli_support import invoke, ok
from hypothesis import given
from hypothesis import strategies as st
from live_browser import Shower, looking_at
from playwright.sync_api import Browser, Page, expect
from view_browser import looking
from view_client import viewing

from wheelsoil.live import PagePanel
from wheelsoil.web.bidi import isolated

NAME = "north\u202eclay"
SIGNS = "\u202a\u202d\u202e\u2066\u2069\u200f\u05d0"
SAMPLE = Path(__file__).parents[2] / "recordings" / "clay"
LOOSE = """() => {
  const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const { data, parentElement } = walk.currentNode;
    if (data.includes("\\u202e") && !parentElement.closest("bdi, svg, option, script, style")) found.push(data);
  }
  return [document.querySelectorAll("bdi").length, found];
}"""


class Texts(HTMLParser):
    """The texts of a page, and which of them are isolated."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self._open: list[str] = []
        self.whole, self.loose, self.isolated = "", "", ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in ("meta", "br", "input", "link", "path", "circle"):
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        self.whole += data
        if "bdi" in self._open:
            self.isolated += data
        elif not {"script", "style", "title", "option", "svg"} & set(self._open):
            self.loose += data


@given(st.text(st.sampled_from(f"ab1 <>&\"'/\n{SIGNS}"), max_size=60))
def test_only_what_turns_is_isolated_and_no_text_is_changed(text: str) -> None:
    page = f'<p class="a">{escape(text)}</p><svg><text>{escape(text)}</text></svg><title>{escape(text)}</title>'
    found = Texts(isolated(page))
    assert found.whole == 3 * text
    assert not set(found.loose) & set(SIGNS)
    assert all(set(word) & set(SIGNS) for word in found.isolated.split())


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of one run, with such a name of folder, run, vehicle and terrain."""
    folder = tmp_path_factory.mktemp("turned") / NAME
    folder.mkdir()
    for path in (*SAMPLE.glob("*.dbc"), SAMPLE / "run-1.mcap"):
        shutil.copyfile(path, folder / path.name)
    for file in ("vehicle.toml", "terrain.toml"):
        lines = (SAMPLE / file).read_text().splitlines()
        turned = [f'name = "{NAME}"' if line.startswith("name = ") else line for line in lines]
        (folder / file).write_text("\n".join(turned), encoding="utf-8")
    (folder / "runs.toml").write_text(f'[[run]]\nfile = "run-1.mcap"\nid = "{NAME}"\n', encoding="utf-8")
    return folder


@pytest.mark.slow
def test_on_the_report(campaign: Path, tmp_path: Path) -> None:
    ok("report", campaign, "--no-diagnosis", "-o", tmp_path / "report.html")
    _check(tmp_path / "report.html")


@pytest.mark.slow
def test_on_the_page_of_a_fleet(campaign: Path, tmp_path: Path) -> None:
    root = tmp_path / "field"
    shutil.copytree(campaign, root / NAME)
    (root / NAME / "vehicle.toml").write_text("[vehicle\n")
    assert invoke("fleet", "run", root, "--store", tmp_path / "store", "--jobs", 1).code == 1, "it is broken"
    ok("fleet", "report", tmp_path / "store", "-o", tmp_path / "fleet.html")
    _check(tmp_path / "fleet.html")


def _check(page: Path) -> None:
    found = Texts(page.read_text(encoding="utf-8"))
    assert NAME in found.isolated and not set(found.loose) & set(SIGNS)


def _looked_at(page: Page) -> None:
    expect(page.locator("bdi").first).to_be_attached()
    count, loose = page.evaluate(LOOSE)
    assert count and not loose


def test_on_the_logger_s_page(browser: Browser, panel: PagePanel) -> None:
    changes = {"marks": [{"time_s": 1.0, "text": NAME}], "remarks": [f"{NAME}: something"]}
    with Shower(panel) as shower, looking_at(browser, panel.address) as seen:
        shower.changes = changes
        _looked_at(seen)


@pytest.mark.slow
def test_on_the_analyst_s_page(browser: Browser, campaign: Path) -> None:
    with viewing(campaign) as view, looking(browser, view.address) as seen:
        view.settled()
        _looked_at(seen)
