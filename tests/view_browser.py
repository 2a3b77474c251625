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
_AT = """([id, x, y]) => {
  const plot = document.getElementById(id), box = plot.getBoundingClientRect(), { xaxis, yaxis } = plot._fullLayout;
  return [box.x + xaxis._offset + xaxis.d2p(x), box.y + yaxis._offset + yaxis.d2p(y)];
}"""
_SELECTED = """([id, from, to]) => {
  const { layout } = document.getElementById(id), near = 0.02 * (layout.xaxis.range[1] - layout.xaxis.range[0]);
  const box = layout.shapes.find((shape) => shape.name === "box");
  return box && Math.abs(box.x0 - Math.min(from, to)) < near && Math.abs(box.x1 - Math.max(from, to)) < near;
}"""
_SHAPES = "([id, name]) => document.getElementById(id).layout.shapes.filter((shape) => shape.name === name)"


@contextmanager
def looking(
    browser: Browser, address: str, width: int = 1366, height: int = 900, refused: bool = False
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


def drawn(page: Page, *plots: str) -> None:
    """Wait until the server is done and these plots are drawn of what it said."""
    expect(page.locator("#state")).to_have_text(READY)
    expect(page.locator("#plots")).to_have_attribute("aria-busy", "false")
    for plot in plots:
        expect(page.locator(f"#{plot} .main-svg").first).to_be_visible()


def open_run(page: Page, campaign: str, run: str = "run-1") -> Locator:
    """Look at a run of a campaign; return the campaign's part of the list."""
    section = page.locator("section.campaign").filter(has=page.get_by_role("heading", name=campaign, exact=True))
    section.locator("button.run", has_text=run).click()
    expect(page.locator("#view-title")).to_contain_text(f"{campaign}: {run}")
    return section


def drag(page: Page, plot: str, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag the mouse in a plot from one point to another, in the axes' units, and wait for what it selects."""
    page.locator(f"#{plot}").evaluate("(plot) => plot.scrollIntoView({ block: 'center' })")
    (x0, y0), (x1, y1) = (page.evaluate(_AT, [plot, *point]) for point in (start, end))
    page.mouse.move(x0, y0)
    page.mouse.down()
    page.mouse.move((x0 + x1) / 2, (y0 + y1) / 2)
    page.mouse.move(x1, y1, steps=3)
    page.mouse.up()
    page.wait_for_function(_SELECTED, arg=[plot, start[0], end[0]])


def seen_range(page: Page, plot: str, axis: str) -> list[float]:
    """What a plot's axis holds, of "x" or "y"."""
    return list(page.evaluate("([id, axis]) => document.getElementById(id).layout[`${axis}axis`].range", [plot, axis]))


def show_all(page: Page, plot: str) -> None:
    """Double-click in a plot over slip until it shows all; on a busy machine two clicks may be no double-click."""
    end = time.monotonic() + PATIENCE_MS / 1000
    while page.evaluate("(id) => document.getElementById(id).layout.xaxis.title.text", plot) != "slip":
        assert time.monotonic() < end
        page.locator(f"#{plot}").dblclick()
        page.wait_for_timeout(500)


def shapes(page: Page, plot: str, name: str) -> list[dict[str, Any]]:
    """The shapes of a name that lie over a plot's samples."""
    return list(page.evaluate(_SHAPES, [plot, name]))


def points(page: Page, plot: str, name: str) -> list[tuple[float, float]]:
    """The points of the one path of a name over a plot's samples; none where there is no such path."""
    found = shapes(page, plot, name)
    if not found:
        return []
    [shape] = found
    pairs = shape["path"].replace("M", "L").strip("L").split("L")
    return [(float(x), float(y)) for x, y in (pair.split(",") for pair in pairs)]


def comes(page: Page, plot: str, name: str) -> None:
    """Wait until a shape of a name lies over a plot's samples; the model's curve is asked for after they are drawn."""
    page.wait_for_function(f"(asked) => ({_SHAPES})(asked).length > 0", arg=[plot, name])


def picked(page: Page, plot: str) -> int:
    """How many samples a plot shows as selected; each is a stroke of no length, so two points."""
    return len(points(page, plot, "selected")) // 2


def trace(page: Page, plot: str, name: str) -> dict[str, Any]:
    """One trace of a plot, by its name; the last where there are several."""
    script = "([id, name]) => document.getElementById(id).data.filter((trace) => trace.name === name).at(-1)"
    found: dict[str, Any] = page.evaluate(script, [plot, name])
    return found


def curve_on_page(page: Page, channel: str, expected: dict[str, Any], name: str = "curve by hand") -> bool:
    """Whether a curve comes to be what ``/api/curve`` said."""
    pairs = list(zip(expected["slip"], expected[channel], strict=True))
    end = time.monotonic() + PATIENCE_MS / 1000
    while points(page, f"slip-{channel}", name) != pairs:
        if time.monotonic() > end:
            return False
        page.wait_for_timeout(20)
    return True
