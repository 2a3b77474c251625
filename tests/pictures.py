"""Takes the manual's pictures of the pages anew, into docs/images (`make pictures`; a few minutes).

Needs Chromium, for `report_print` pdftoppm (poppler-utils); with Pillow each file has 256 colours, a third of the size.
`python -m pictures report view` takes those whose names begin so.
"""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from live_browser import chromium
from playwright.sync_api import Browser, Page, expect
from view_browser import drag, drawn, open_run
from view_client import START, viewing

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
LAPTOP, WIDE, PHONE = (1440, 900), (1920, 1080), (390, 844)
DIAGNOSED_MS = 300_000
MONTHS, SERIALS = 8, {"WFT-0411": 0.0, "WFT-0412": 0.005, "WFT-0413": 0.0}
"""Campaigns of each transducer, and by how much its gain of drawbar pull grows a month."""


def wheelsoil(*arguments: object) -> None:
    """Run a command."""
    subprocess.run([sys.executable, "-c", START, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def keep(name: str, data: bytes) -> None:
    """Write a picture."""
    try:
        from PIL import Image
    except ImportError:
        pass
    else:
        buffer = BytesIO()
        Image.open(BytesIO(data)).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
            buffer, "png", optimize=True
        )
        data = buffer.getvalue()
    (IMAGES / f"{name}.png").write_bytes(data)
    print(f"{name}: {len(data) / 1e3:.0f} kB", flush=True)


@contextmanager
def opened(browser: Browser, address: str, size: tuple[int, int], **options: Any) -> Iterator[Page]:
    """A tab of its own."""
    viewport = {"width": size[0], "height": size[1]}
    context = browser.new_context(viewport=viewport, **options)
    page = context.new_page()
    page.goto(address)
    yield page
    context.close()


def of_reports(browser: Browser, folder: Path) -> None:
    """Take those of the report of the sandy sample."""
    path = folder / "report.html"
    wheelsoil("report", ROOT / "recordings" / "sandy", "-o", path)
    looks: dict[str, tuple[tuple[int, int], dict[str, Any]]] = {
        "laptop": (LAPTOP, {}),
        "wide": (WIDE, {}),
        "phone": (PHONE, {"is_mobile": True}),
        "dark": (LAPTOP, {"color_scheme": "dark"}),
    }
    for name, (size, options) in looks.items():
        with opened(browser, path.as_uri(), size, **options) as page:
            keep(f"report_{name}", page.screenshot())
    with opened(browser, path.as_uri(), LAPTOP) as page:
        page.locator("nav").get_by_text("Appendix").click()
        title = page.locator("summary", has_text="Time histories")
        title.click()
        plots = page.locator("details", has=title).locator("figure, .figure")
        plots.first.evaluate(
            "(plot) => window.scrollTo({ top: plot.getBoundingClientRect().top + scrollY - 60, behavior: 'instant' })"
        )
        page.wait_for_timeout(1500)
        box = plots.first.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
        page.wait_for_timeout(500)
        keep("report_time", page.screenshot())
        paper = folder / "report.pdf"
        paper.write_bytes(page.pdf(format="A4", prefer_css_page_size=True, print_background=True))
    subprocess.run(["pdftoppm", "-png", "-r", "72", "-l", "2", paper, folder / "sheet"], check=True)
    keep("report_print", beside(browser, [sheet.read_bytes() for sheet in sorted(folder.glob("sheet*.png"))], "#888"))


def beside(browser: Browser, pictures: list[bytes], gap: str) -> bytes:
    """Return pictures side by side, with a gap of a colour."""
    shown = (f'<img src="data:image/png;base64,{base64.b64encode(data).decode()}">' for data in pictures)
    page = browser.new_page()
    page.set_content(
        f'<div id="all" style="display:inline-flex;gap:12px;background:{gap}">{"".join(shown)}</div>', wait_until="load"
    )
    data = page.locator("#all").screenshot()
    page.close()
    return data


def of_view(browser: Browser, _: Path) -> None:
    """Take those of the analyst's page on both samples."""
    with viewing(ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy") as view:
        view.settled()
        with opened(browser, view.address, LAPTOP) as page:
            open_run(page, "sandy", "run-3")
            drawn(page)
            page.get_by_role("button", name="Diagnose").click()
            expect(page.locator("#recommended")).to_be_visible(timeout=DIAGNOSED_MS)
            page.locator("#recommended").click()
            drawn(page)
            at_cursor(page)
            page.emulate_media(color_scheme="dark")
            page.wait_for_timeout(500)
            keep("view_dark", page.screenshot())
            page.emulate_media(color_scheme="light")
            page.set_viewport_size({"width": WIDE[0], "height": WIDE[1]})
            page.get_by_label("Compare with").select_option(label="clay: all runs")
            expect(page.locator("#compare-note")).to_contain_text("sandy − clay")
            drawn(page)
            at_cursor(page)
            keep("view_compare", page.screenshot())
            page.get_by_label("Compare with").select_option(index=0)
            page.set_viewport_size({"width": LAPTOP[0], "height": LAPTOP[1]})
            drawn(page)
            drag(page, 17.9, 27.9)
            drawn(page)
            at_cursor(page)
            keep("view_laptop", page.screenshot())
            address = page.url
        with opened(browser, address, PHONE, is_mobile=True, has_touch=True, device_scale_factor=2) as page:
            drawn(page)
            keep("view_phone", page.screenshot())


def at_cursor(page: Page) -> None:
    """Put the cursor into the plots."""
    box = page.locator("#rows").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.3 * box["height"])
    page.wait_for_timeout(500)


def of_fleets(browser: Browser, folder: Path) -> None:
    """Take that of a fleet with three transducers, one of which drifts."""
    for number, (serial, drift) in enumerate(SERIALS.items()):
        for month in range(MONTHS):
            (folder / "fields").mkdir(exist_ok=True)
            place = folder / "fields" / f"{serial}-{month + 1:02d}"
            gain = ("--effect", f"drawbar_pull_gain:relative={drift * month}") if drift * month else ()
            start = f"2026-{month + 1:02d}-{5 + 7 * number:02d}T08:00:00"
            soil = ("clay", "sandy")[(number + month) % 2]
            seed = 10 * number + month
            told = (
                "--soil",
                soil,
                "--runs",
                2,
                "--duration",
                40,
                "--seed",
                seed,
                "--draw-soil",
                "--start",
                start,
                *gain,
            )
            wheelsoil("simulate", *told, "-o", place)
            vehicle = place / "vehicle.toml"
            text, count = re.subn(r"(?m)^(\[transducer\])$", rf'\1\nserial = "{serial}"', vehicle.read_text("utf-8"))
            assert count == 1, "vehicle.toml has no [transducer]"
            vehicle.write_text(text, "utf-8")
    wheelsoil("fleet", "run", folder / "fields", "--store", folder / "store")
    subprocess.run(
        [sys.executable, "-c", START, "fleet", "report", "store", "-o", "fleet.html"], check=True, cwd=folder
    )
    with opened(browser, (folder / "fleet.html").as_uri(), LAPTOP) as page:
        keep("fleet_laptop", page.screenshot())


def of_status(browser: Browser, folder: Path) -> None:
    """Take those of the logger's page while a vehicle sends on a network bus."""
    live = live_logging()
    channel, phones = "239.77.163.7", []
    with (
        live._vehicle(channel) as tell,
        live._logger(live._configuration(folder, channel), folder / "out") as (_, where),
        opened(browser, where, PHONE, is_mobile=True, has_touch=True) as page,
    ):
        page.wait_for_timeout(30_000)
        phones.append(page.screenshot())
        page.set_viewport_size({"width": PHONE[1], "height": PHONE[0]})
        page.wait_for_timeout(500)
        keep("status_page_landscape", page.screenshot())
        with opened(browser, where, (1366, 768)) as laptop:
            laptop.wait_for_timeout(5_000)
            keep("status_page_laptop", laptop.screenshot())
        page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
        for told, level in (("freeze", "AMBER"), ("drop", "RED")):
            tell(told)
            expect(page.locator("#level")).to_contain_text(level)
            page.wait_for_timeout(3_000)
            phones.append(page.screenshot())
            tell("well")
            expect(page.locator("#level")).not_to_contain_text(level)
    keep("status_page", beside(browser, phones, "#c5ccd3"))


def live_logging() -> ModuleType:
    """Return the tests of the logger, which have a vehicle that sends."""
    spec = spec_from_file_location("test_live_logging", ROOT / "tests" / "wheelsoil" / "test_live_logging.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGES: dict[str, Callable[[Browser, Path], None]] = {
    "report": of_reports,
    "view": of_view,
    "fleet": of_fleets,
    "status": of_status,
}


def main(names: list[str]) -> None:
    """Take the pictures of some pages, or of all."""
    for name in names or PAGES:
        with TemporaryDirectory(prefix="pictures-") as place, chromium() as browser:
            PAGES[name](browser, Path(place))


if __name__ == "__main__":
    main(sys.argv[1:])
