"""Debian's Chromium for the status page's tests, and somebody who goes on showing snapshots meanwhile."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from typing import Any

import pytest
from live_support import snapshot
from playwright.sync_api import Browser, Page, expect, sync_playwright

from wheelsoil.live import PagePanel

PATIENCE_MS = 30_000
PHONE = {"width": 390, "height": 844}
expect.set_options(timeout=PATIENCE_MS)


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser; the test is skipped without one, or fails where one is required."""
    path = shutil.which("chromium")
    if path is None:
        why = "no Chromium here: apt-get install chromium"
        (pytest.fail if os.environ.get("WHEELSOIL_REQUIRE_BROWSER") == "1" else pytest.skip)(why)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


class SharedChromium:
    """One browser for all tests in a row that use one; it is started when it is first needed."""

    def __init__(self) -> None:
        self._open = ExitStack()
        self._browser: Browser | None = None

    def browser(self) -> Browser:
        """Return the browser."""
        if self._browser is None:
            self._browser = self._open.enter_context(chromium())
        return self._browser

    def close(self) -> None:
        """End it, and with it the event loop that Playwright runs in this thread."""
        self._browser = None
        self._open.close()


@lru_cache(maxsize=4)
def tab(browser: Browser, touch: bool = False, mobile: bool = False, scale: float = 1.0) -> Page:
    """Return an open tab. A page that is opened in it again takes a third of the time: its scripts are compiled."""
    page = browser.new_context(has_touch=touch, is_mobile=mobile, device_scale_factor=scale).new_page()
    page.set_default_timeout(PATIENCE_MS)
    return page


@contextmanager
def shown(page: Page, address: str, listeners: dict[str, Callable[[Any], None]]) -> Iterator[None]:
    """Have a tab show an address, and tell `listeners` of its events meanwhile."""
    for event, listener in listeners.items():
        page.on(event, listener)  # type: ignore[call-overload]
    try:
        page.goto(address)
        yield
    except BaseException:
        tab.cache_clear()  # a tab in which a test failed is not used again
        raise
    for event, listener in listeners.items():
        page.remove_listener(event, listener)
    page.unroute_all(behavior="ignoreErrors")
    page.context.set_offline(False)
    page.emulate_media(media="null")
    page.goto("about:blank")


@contextmanager
def looking_at(
    browser: Browser, address: str, width: int = 390, height: int = 844, scale: float = 1.0, clock: bool = False
) -> Iterator[Page]:
    """A phone's page on an address; a script error or a breach of the page's policy fails the test.

    With `clock` the page's time is `page.clock`, which can be put forward instead of waiting.
    """
    own = tab.__wrapped__ if clock else tab  # a clock stays where it is installed
    page = own(browser, True, width < 900, scale)
    page.set_viewport_size({"width": width, "height": height})
    faults: list[str] = []
    listeners = {
        "pageerror": lambda error: faults.append(str(error)),
        "console": lambda message: faults.append(message.text) if "Content Security" in message.text else None,
    }
    if clock:
        page.clock.install()
    with shown(page, address, listeners):
        yield page
    if clock:
        page.context.close()
    assert not faults


class Shower:
    """Shows a snapshot every 0.2 s, about as often as the logger; `changes` are laid over it."""

    def __init__(self, panel: PagePanel, **changes: Any) -> None:
        self.changes = changes
        self._panel = panel
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._show)

    def __enter__(self) -> Shower:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _show(self) -> None:
        before_s = 0.0
        now_s = 20.0
        while not self._over.wait(0.2):
            self._panel.show(snapshot(before_s, now_s, **self.changes))
            before_s, now_s = now_s, now_s + 0.2
