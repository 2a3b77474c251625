"""The analyst's page in Debian's Chromium: a user's mouse and keys, and what the plots then hold."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from live_browser import PATIENCE_MS
from playwright.sync_api import Browser, Page, expect

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
    context = browser.new_context(viewport={"width": width, "height": height}, has_touch=width < 900)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    said: list[str] = []
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("console", lambda m: said.append(f"{m.text} {m.location}") if m.type in ("error", "warning") else None)
    page.on("request", lambda request: said.append(request.url) if _elsewhere(request.url, address) else None)
    page.goto(address)
    yield page
    context.close()
    told = [words for words in said if not (refused and "Failed to load resource" in words)]
    assert not told, told


def _elsewhere(url: str, address: str) -> bool:
    asked, here = urlsplit(url), urlsplit(address)
    return asked.scheme not in ("data", "blob") and asked.netloc != here.netloc


def drawn(page: Page, *plots: str) -> None:
    """Wait until the server is done and these plots are there."""
    for plot in plots:
        expect(page.locator(f"#{plot} .main-svg").first).to_be_visible()
    expect(page.locator("#state")).to_have_text(READY)


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
    for _ in range(100):
        if points(page, f"slip-{channel}", name) == pairs:
            return True
        page.wait_for_timeout(100)
    return False
