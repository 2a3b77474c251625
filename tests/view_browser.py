"""The analyst's page in Debian's Chromium: a user's mouse and keys, and what the plots then hold."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from live_browser import PATIENCE_MS, shown, tab
from playwright.sync_api import Browser, Locator, Page, Route, expect

READY = "READY"


@contextmanager
def looking(
    browser: Browser, address: str, width: int = 1440, height: int = 900, refused: bool = False
) -> Iterator[Page]:
    """The page with all its plots; anything on the console, or a request to elsewhere, fails the test.

    With `refused` the browser may say that the server refused something, which it does on its own.
    """
    page = tab(browser, touch=width < 900)
    page.set_viewport_size({"width": width, "height": height})
    page.mouse.move(0, 0)
    said: list[str] = []
    listeners = {
        "pageerror": lambda error: said.append(str(error)),
        "console": lambda m: said.append(f"{m.text} {m.location}") if m.type in ("error", "warning") else None,
        "request": lambda request: said.append(request.url) if _elsewhere(request.url, address) else None,
    }
    with shown(page, address, listeners):
        yield page
    told = [words for words in said if not (refused and "Failed to load resource" in words)]
    assert not told, told


def _elsewhere(url: str, address: str) -> bool:
    asked, here = urlsplit(url), urlsplit(address)
    return asked.scheme not in ("data", "blob") and asked.netloc != here.netloc


class Held:
    """Questions of a page to a path, which reach the server only when they are let go; the first `times` of them."""

    def __init__(self, page: Page, path: str, times: int | None = None) -> None:
        self._page = page
        self._routes: list[Route] = []
        page.route(f"**{path}", lambda route: self._routes.append(route), times=times)

    def next(self) -> Route:
        """The next question, as soon as it is asked."""
        end = time.monotonic() + PATIENCE_MS / 1000
        while not self._routes:
            assert time.monotonic() < end, "nothing is asked"
            self._page.wait_for_timeout(10)
        return self._routes.pop(0)


def drawn(page: Page, *rows: str) -> None:
    """Wait until the server is done and these rows are drawn of what it said."""
    expect(page.locator("#state")).to_have_text(READY)
    expect(page.locator("#rows")).to_have_attribute("aria-busy", "false")
    for row in rows:
        page.locator(row_line(row, "measured")).wait_for(state="attached")  # a flat line has no height to be visible by


def open_run(page: Page, campaign: str, run: str = "run-1") -> Locator:
    """Look at a run of a campaign; return the campaign's part of the list."""
    section = page.locator(".campaign").filter(has=page.get_by_text(campaign, exact=True))
    if not section.evaluate("(box) => box.open"):
        section.locator("summary").click()
    section.locator("button.run", has_text=run).click()
    expect(page.locator("#view-title")).to_contain_text(f"{campaign}: {run}")
    return section


def unfold(page: Page, box: str) -> None:
    """Open a part of the panel that begins closed."""
    if not page.locator(f"#{box}").evaluate("(box) => box.open"):
        page.locator(f"#{box} > summary").click()


def add_effect(page: Page, key: str) -> None:
    """Find an effect by its words and put it into the model."""
    page.get_by_label("Search effects").fill(key.replace("_", " "))
    page.locator(f"#effect-picker [data-key='{key}']").click()
    expect(page.locator(f"#sliders [data-effect='{key}']")).to_be_visible()


def drag(page: Page, start_s: float, end_s: float) -> None:
    """Drag the mouse in the time histories from one moment to another, and wait for what it selects."""
    page.locator("#rows svg.figure").wait_for()
    x0, x1 = (_at(page, t) for t in (start_s, end_s))
    box = page.locator("#rows").bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(x0, y)
    page.mouse.down()
    page.mouse.move((x0 + x1) / 2, y)
    page.mouse.move(x1, y, steps=3)
    page.mouse.up()
    expect(page.locator("#bar")).to_be_visible()
    low, high = sorted((start_s, end_s))
    found = selection(page)
    assert abs(found["from"] - low) < 0.3 and abs(found["to"] - high) < 0.3


_AT = """async (t) => {
  const { timeLimits } = await import('/rows.js'), [from, to] = timeLimits();
  const grid = document.querySelector('#rows .row .grid').getBoundingClientRect();
  return grid.x + (t - from) / (to - from) * grid.width;
}"""


def _at(page: Page, time_s: float) -> float:
    return float(page.evaluate(_AT, time_s))


def state(page: Page, name: str) -> Any:
    """One value of the page's state."""
    return page.evaluate("async (name) => (await import('/store.js')).state[name]", name)


def selection(page: Page) -> Any:
    """What is selected."""
    return state(page, "selection")


def points(page: Page, path: str) -> list[tuple[float, float]]:
    """The points of a drawn line, by its selector; none where there is no such line."""
    script = "(path) => { const { x, y } = document.querySelector(path)?.points ?? { x: [], y: [] }; return [x, y]; }"
    x, y = page.evaluate(script, path)
    return list(zip(x, y, strict=True))


def row_line(row: str, look: str) -> str:
    """The selector of a line in the time histories."""
    return f"[data-row='{row}'] svg > path.{look}"


def curve_line(name: str) -> str:
    """The selector of a model's curve in the cross plot."""
    return f"#cross [data-curve='{name}']"


def picked(page: Page) -> int:
    """How many samples the cross plot shows as selected."""
    return int(page.evaluate("() => document.querySelector('#cross .picked')?.points.count ?? 0"))


def curve_on_page(page: Page, expected: dict[str, Any], name: str = "model") -> bool:
    """Whether a curve of the pull comes to be what ``/api/curve`` said."""
    pairs = list(zip(expected["slip"], expected["drawbar_pull_n"], strict=True))
    end = time.monotonic() + PATIENCE_MS / 1000
    while points(page, curve_line(name)) != pairs:
        if time.monotonic() > end:
            return False
        page.wait_for_timeout(20)
    return True
