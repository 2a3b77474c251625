"""The report in a real browser: complete, silent, legible at every size, and deaf to markup in names."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from cli_support import ok
from live_browser import shown, tab
from playwright.sync_api import Browser, Page

RECORDINGS = Path(__file__).parents[2] / "recordings"
LAPTOP = {"width": 1366, "height": 768}
SMALL_PHONE = {"width": 360, "height": 844}
EVIL = '<script>window.struck = 1</script><b>bold</b><a href="https://x.example">link</a><img src=x onerror="struck=1">'

DRAW = """async (plots) => {
  for (const part of document.querySelectorAll("details.part")) part.removeAttribute("name");  // all open together
  for (const plot of document.querySelectorAll(plots)) {
    plot.closest("details.part").open = true;
    plot.scrollIntoView();
    for (let i = 0; i < 400 && !plot.querySelector("svg"); i++) await new Promise((go) => setTimeout(go, 25));
  }
  window.scrollTo(0, 0);
}"""
EMPTY = """() => [...document.querySelectorAll(".plot")].filter((plot) =>
  ![...plot.querySelectorAll(".trace [d], .trace rect")].some((part) => part.getAttribute("d") !== "")
).map((plot) => plot.id)"""
CRAMPED = """() => [...document.querySelectorAll(".plot")].flatMap((plot) => {
  const box = (element) => element.getBoundingClientRect(), frame = box(plot), found = [];
  const area = plot.querySelector("svg > svg"), top = frame.top + plot.figure.box.top;
  const names = [...plot.querySelectorAll(".entry")];
  if (names.some((name) => box(name).bottom > top)) found.push("the legend is over the curves");
  for (const label of plot.querySelectorAll(".plotted text")) {
    if (area.contains(label)) continue;
    const { left, right, top, bottom } = box(label);
    if (left < frame.left - 1 || right > frame.right + 1 || top < frame.top - 1 || bottom > frame.bottom + 1)
      found.push(`${label.textContent} is cut`);
  }
  for (const axis of ["x", "y"]) {
    const boxes = [...plot.querySelectorAll(`.tick.${axis}`)].map(box);
    if (boxes.some((a, i) => boxes.slice(i + 1).some((b) =>
      a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 2 && b.top < a.bottom - 2)))
      found.push(`labels of ${axis} overlap`);
  }
  return found.map((what) => `${plot.id}: ${what}`);
})"""


@dataclass
class Written:
    """A report on disk."""

    page: Path

    @property
    def numbers(self) -> dict[str, Any]:
        return json.loads(self.page.with_suffix(".json").read_text(encoding="utf-8"))


@pytest.fixture
def written(report: Path) -> Written:
    """Return the report of two runs, with a diagnosis made by hand."""
    return Written(report)


@pytest.fixture(params=["two runs", pytest.param("sandy", marks=pytest.mark.slow)])
def each(request: pytest.FixtureRequest) -> Written:
    """Return that report, and the one of a sample campaign."""
    if request.param == "two runs":
        return Written(request.getfixturevalue("report"))
    return Written(request.getfixturevalue("sample_report")(request.param))


@contextmanager
def opened(browser: Browser, path: Path, size: dict[str, int] = LAPTOP) -> Iterator[Page]:
    """Open a report; a message on the console or a request beyond the file itself fails the test."""
    page = tab(browser, mobile=size["width"] < 900)
    page.set_viewport_size({"width": size["width"], "height": size["height"]})
    said: list[str] = []
    asked: list[str] = []
    listeners = {
        "console": lambda message: said.append(message.text),
        "pageerror": lambda error: said.append(str(error)),
        "request": lambda request: asked.append(request.url) if not request.url.startswith("data:") else None,
    }
    with shown(page, path.as_uri(), listeners):
        yield page
    assert said == []
    assert [address for address in asked if not address.startswith("blob:")] == [path.as_uri()]


def test_it_opens_silent_and_complete(browser: Browser, each: Written) -> None:
    numbers = each.numbers
    assert numbers["left_out"] == {}
    with opened(browser, each.page) as page:
        summary = numbers["sections"]["glance"]
        assert page.locator("h1").inner_text().replace("\u00a0", " ") == summary["headline"]
        tiles = page.locator("#glance .tile .v").all_inner_texts()
        for tile, text in zip(summary["tiles"].values(), tiles, strict=True):
            shown = text.replace("\u00a0", " ")
            assert tile["before"] in shown and tile["value"] in shown and tile["unit"] in shown
        for seen in ("#glance .tile", "#drawing-hero .line.model", "#glance .next li"):
            box = page.locator(f"{seen} >> visible=true").first.bounding_box()
            assert 0 <= box["y"] < LAPTOP["height"] - 40, f"{seen} is on the first screen"
        assert page.locator("#drawing-hero .wide-svg .dens-5").get_attribute("d"), "measured samples"
        assert page.locator("#drawing-hero .wide-svg .line.base").count() == 1
        assert page.locator("details.part[open]").count() == 0, "the appendix is closed"
        words = len(re.findall(r"[^\W\d_]{2,}", page.locator("main").inner_text()))
        assert words < 1200, "what is open is read in some minutes"
        assert page.locator(".drawing").count() <= 8
        page.evaluate(DRAW, ".plot")
        assert page.evaluate(EMPTY) == []
        assert page.evaluate("document.querySelectorAll('.plot').length") == len(numbers["figures"])
        assert page.evaluate("document.querySelectorAll('.drawing').length") == len(numbers["drawings"])
        assert page.evaluate(CRAMPED) == []


def test_the_first_screen_holds_the_figure_and_one_place_is_marked(browser: Browser, each: Written) -> None:
    with opened(browser, each.page) as page:
        for seen in ("#drawing-hero .wide-svg text.title >> nth=1", ".again", ".badge"):
            box = page.locator(seen).bounding_box()
            assert box["y"] + box["height"] <= LAPTOP["height"], f"{seen} is on the first screen"
        figure, next_steps = page.locator("#drawing-hero").bounding_box(), page.locator(".next").bounding_box()
        axis = page.locator("#drawing-hero .wide-svg text.title >> nth=1").bounding_box()
        assert figure["y"] + figure["height"] - axis["y"] - axis["height"] < 40, "no empty card under the figure"
        assert next_steps["y"] + next_steps["height"] <= LAPTOP["height"], "what to do is on the first screen"
        header = page.locator("header").bounding_box()
        assert header["height"] < 45, "one line"
        page.evaluate("document.documentElement.style.scrollBehavior = 'auto'")
        for link in page.locator("nav a").all():
            link.click()
            marked = "(name) => [...document.querySelectorAll('nav a.on')].map((a) => a.innerText).join() === name"
            page.wait_for_function(marked, arg=link.inner_text(), timeout=3000)


def test_no_script_but_its_own_runs(browser: Browser, written: Written, tmp_path: Path) -> None:
    text = written.page.read_text(encoding="utf-8")
    assert "unsafe-inline" not in re.search("script-src ([^;]*);", unescape(text))[1]
    struck = tmp_path / "struck.html"
    struck.write_text(text.replace("</body>", "<script>window.struck = 1</script></body>"), encoding="utf-8")
    page = tab(browser, mobile=False)
    with shown(page, struck.as_uri(), {}):
        assert page.evaluate("window.struck") is None


POINTS = """() => [...document.querySelectorAll(".plot")].flatMap(({ figure }) => {
  const { X, Y, axes } = figure, away = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  return [...figure.svg.querySelectorAll(".trace")].flatMap((group) => {
    const { trace } = group, numbers = (path) => path.getAttribute("d").match(/[ML]-?[\\d.]+ -?[\\d.]+/g) ?? [];
    if (!["line", "points"].includes(trace.kind)) return [];
    const pairs = [...group.querySelectorAll("path")].flatMap(numbers);
    const drawn = pairs.map((pair) => pair.slice(1).split(" ").map(Number));
    return trace.x.flatMap((value, i) => {
      if (value === null || trace.y[i] === null) return [];
      const wanted = [X(axes.x.units(value)), Y(axes.y.units(trace.y[i]))];
      const isThere = drawn.some((place) => away(place, wanted) < 0.2);
      return isThere ? [] : [`${figure.key}, ${trace.name}: ${value}, ${trace.y[i]}`];
    });
  });
})"""
AREA = """({ figure: { svg, box: { left, right, top, bottom } } }) =>
  ({ x: svg.getBoundingClientRect().x + left, y: svg.getBoundingClientRect().y + top, width: right - left })"""
TRACES = """() => Object.fromEntries([...document.querySelectorAll(".plot")].map(({ figure }) =>
  [figure.key, [...figure.svg.querySelectorAll(".trace")].map(({ trace }) => trace)]))"""


def test_what_the_json_has_is_drawn(browser: Browser, each: Written) -> None:
    with opened(browser, each.page) as page:
        page.evaluate(DRAW, ".plot")
        assert page.evaluate(POINTS) == [], "every point of every line stands at its place"
        drawn = page.evaluate(TRACES)
    for key, figure in each.numbers["figures"].items():
        first = next((trace["shown_for"] for trace in figure["traces"] if trace["shown_for"]), "")
        kept = [trace for trace in figure["traces"] if trace["shown_for"] in ("", first)]
        assert [[trace.get(axis) for axis in "xyz"] for trace in drawn[key]] == [
            [trace.get(axis) for axis in "xyz"] for trace in kept
        ], key


def test_time_histories_share_a_cursor_with_the_track_and_zoom_together(browser: Browser, written: Written) -> None:
    drawn = "[...document.querySelectorAll('#time .plot')].map(({ figure }) => figure)"
    cursors = f"{drawn}.map(({{ X, cursor }}) => X.back(cursor.transform.baseVal[0]?.matrix.e))"

    with opened(browser, written.page) as page:
        page.evaluate(DRAW, "#time .plot")
        speed = page.locator("#plot-drive-speed")
        speed.scroll_into_view_if_needed()
        box = speed.evaluate(AREA)
        page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + 40)
        here = page.locator("#time .place .here")
        here.and_(page.locator("[visibility=visible]")).wait_for()
        told = page.locator("#plot-drive-speed .tip").inner_text()
        assert re.fullmatch(r"time \d+\.\d+\ss\nrim: −?\d\.\d+\sm/s\nground: −?\d\.\d+\sm/s", told)
        before, place = page.evaluate(cursors), here.bounding_box()
        assert max(before) - min(before) < 1e-3
        path = page.locator("#time .place .start").bounding_box()
        page.mouse.move(path["x"] + path["width"] / 2, path["y"] + path["height"] / 2)
        assert here.bounding_box() != place and page.evaluate(cursors)[0] < min(3.0, before[0])
        speed.scroll_into_view_if_needed()
        box = speed.evaluate(AREA)
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 22)
        page.mouse.up()
        limits = page.evaluate(f"{drawn}.map(({{ X }}) => X.limits)")
        assert limits == [limits[0]] * len(limits) and 0.0 < limits[0][0] < limits[0][1]
        page.mouse.dblclick(box["x"] + 50, box["y"] + 20)
        whole = page.evaluate(f"{drawn}.map(({{ X }}) => X.limits)")
        assert whole == [whole[0]] * len(whole) and whole[0][0] <= 0.0 < limits[0][1] < whole[0][1]


TOLD = """() => [...document.querySelectorAll(".plot")].flatMap(({ figure }) => {
  const told = figure.shown.filter(({ kind, quiet }) => !quiet && ["bar", "line", "points"].includes(kind));
  return ["x", "y"].filter((along) => !figure.axes[along].order).flatMap((along) => {
    const { title = "" } = figure.axes[along], [low, high] = figure[along.toUpperCase()].limits;
    const values = told.flatMap((trace) => trace[along]).filter((value) => value !== null);
    return values.map((value) => [title, value, figure.told(along, value), high - low]);
  });
})"""
UNITS = {"(N)": "N", "(N m)": "N m", "(m/s)": "m/s", "(s)": "s", "(m)": "m", "(mm)": "mm", "(σ)": "σ", "(%)": "%"}


def test_a_value_at_the_pointer_has_its_unit_and_five_digits(browser: Browser, each: Written) -> None:
    with opened(browser, each.page) as page:
        page.evaluate(DRAW, ".plot")
        values = page.evaluate(TOLD)
    assert values
    for title, value, told, span in values:
        written, _, unit = told.partition("\u00a0")
        ends = "%" if "(% of" in title else next((unit for end, unit in UNITS.items() if title.endswith(end)), "")
        assert unit == ends, title
        digits = re.sub(r"\D", "", written).lstrip("0")
        assert len(digits) <= 5 and "e" not in written, (title, value, told)
        number = float(written.replace("−", "-").replace("\u202f", ""))
        assert number == pytest.approx(value, rel=5e-3, abs=1e-3 * span), title


def test_a_name_in_the_legend_hides_its_line(browser: Browser, written: Written) -> None:
    with opened(browser, written.page) as page:
        page.evaluate(DRAW, "#plot-slip-driving")
        wong = page.locator("#plot-slip-driving .entry", has_text="Wong")
        lines = "#plot-slip-driving .trace[data-name=Wong]"
        assert page.locator(lines).count() and wong.get_attribute("aria-pressed") == "true"
        wong.click()
        assert page.locator(lines).count() == 0 and wong.get_attribute("aria-pressed") == "false"
        page.keyboard.press("Enter")
        assert page.locator(lines).count()


@pytest.mark.slow
def test_a_figure_is_saved_and_a_run_is_chosen(browser: Browser, written: Written, tmp_path: Path) -> None:
    with opened(browser, written.page) as page:
        page.evaluate(DRAW, "#plot-slip-driving, #plot-time-dp, #plot-track-use")
        for place, key in (("#drawing-hero", "hero"), ("#slip .card:has(#plot-slip-driving)", "slip-driving")):
            for kind in ("svg", "csv"):
                with page.expect_download() as download:
                    page.locator(f"{place} [data-save={kind}]").first.click()
                download.value.save_as(tmp_path / f"{key}.{kind}")
            drawing = ElementTree.parse(tmp_path / f"{key}.svg").getroot()
            assert drawing.get("width") == "174mm" and drawing.get("viewBox")
        rows = (tmp_path / "hero.csv").read_text().splitlines()
        curve = next(one for one in written.numbers["drawings"]["hero"]["curves"] if one["look"] == "model")
        of_model = [row.split(",") for row in rows if row.startswith(curve["name"])]
        assert [float(row[2]) for row in of_model] == pytest.approx(curve["y"])
        for section, figure in (("slip", "slip-driving"), ("time", "time-dp"), ("track", "track-use")):
            before = page.evaluate("(id) => JSON.stringify(document.getElementById(id).figure.shown)", f"plot-{figure}")
            page.locator(f"#{section} select").first.select_option("run-2")
            kept = [t for t in written.numbers["figures"][figure]["traces"] if t["shown_for"] == "run-2"]
            shown = page.evaluate("(id) => document.getElementById(id).figure.shown", f"plot-{figure}")
            assert kept and [trace.get("y") for trace in shown] == [trace.get("y") for trace in kept]
            assert json.dumps(shown) != before


TALLEST = """() => {
  for (const part of document.querySelectorAll("details.part")) part.open = true;
  const one = (part) => (part.open = true, part.getBoundingClientRect().height);
  const groups = Object.values(Object.groupBy(document.querySelectorAll("details.part"), (part) => part.name));
  for (const group of groups) group.sort((a, b) => one(b) - one(a))[0].open = true;
  return document.documentElement.scrollHeight;
}"""


def test_an_opened_report_is_not_endless(browser: Browser, written: Written) -> None:
    with opened(browser, written.page) as page:
        assert page.evaluate(TALLEST) <= 15_000
        assert page.locator("details.part[open]").count() == page.locator("h3.group").count() > 3


def test_figures_are_drawn_when_they_are_looked_at(browser: Browser, written: Written) -> None:
    with opened(browser, written.page) as page:
        page.locator("details.part").evaluate_all("(all) => all.forEach((one) => { one.name = ''; one.open = true; })")
        last = page.locator(".plot").last
        assert last.locator("svg").count() == 0
        last.scroll_into_view_if_needed()
        last.locator("svg").first.wait_for()


def test_a_phone_need_not_scroll_sideways(browser: Browser, each: Written) -> None:
    with opened(browser, each.page, SMALL_PHONE) as page:
        page.evaluate(DRAW, ".plot")
        assert page.evaluate("document.documentElement.scrollWidth") == SMALL_PHONE["width"]
        assert page.evaluate(EMPTY) == []
        assert page.evaluate(CRAMPED) == []


def test_no_border_of_a_card_is_at_the_edge_of_the_paper(browser: Browser, written: Written) -> None:
    """The printer rounds widths up, so that what ends there is cut off."""
    with opened(browser, written.page, {"width": 702, "height": 1000}) as page:
        page.emulate_media(media="print")
        ends = page.locator(".card:visible").evaluate_all("all => all.map((x) => x.getBoundingClientRect().right)")
        assert len(ends) > 3 and max(ends) <= page.evaluate("document.documentElement.clientWidth") - 1


def test_a_pdf_is_a4(browser: Browser, tmp_path: Path) -> None:
    assert browser.is_connected(), "what prints it is there"
    one = tmp_path / "one.pdf"
    found = ok("report", RECORDINGS / "clay/run-1.mcap", "-o", one, "--no-diagnosis", "--json").json
    assert found["report"] == str(one) and Path(found["numbers"]) == one.with_suffix(".json")
    content = one.read_bytes()
    assert content.startswith(b"%PDF")
    boxes = {tuple(map(float, box.split())) for box in re.findall(rb"/MediaBox \[([^\]]+)\]", content)}
    assert [(round(box[2]), round(box[3])) for box in boxes] == [(595, 842)]
    assert 2 <= len(re.findall(rb"/Type /Page\b", content)) <= 10


def test_names_are_text(browser: Browser, campaign: Path, tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    folder.mkdir()
    comment = 'CM_ "<script>window.struck = 1</script>";\n'
    (folder / "<b>wft<b>.dbc").write_text((campaign / "wft.dbc").read_text("cp1252") + comment, "cp1252")
    for name in ("wheel_speed.dbc", "gnss.dbc"):
        (folder / name).write_bytes((campaign / name).read_bytes())
    quoted = json.dumps(EVIL)
    vehicle = (campaign / "vehicle.toml").read_text().replace('"wft.dbc"', '"<b>wft<b>.dbc"')
    terrain = (campaign / "terrain.toml").read_text()
    named = re.compile(r'(?m)^name = ".*"')
    (folder / "vehicle.toml").write_text(named.sub(lambda _: f"name = {quoted}", vehicle, count=1))
    (folder / "terrain.toml").write_text(named.sub(lambda _: f"name = {quoted}", terrain, count=1))
    runs = "".join(f'[[run]]\nfile = "run-{i}.mcap"\nid = {json.dumps(f"{EVIL} {i}")}\n' for i in (1, 2))
    (folder / "runs.toml").write_text(runs)
    for i in (1, 2):
        (folder / f"run-{i}.mcap").write_bytes((campaign / f"run-{i}.mcap").read_bytes())
    target = tmp_path / "report.html"
    ok("report", folder, "-o", target)
    with opened(browser, target) as page:
        page.evaluate(DRAW, "#plot-shares, #time .plot")
        assert page.evaluate("window.struck") is None
        assert (
            page.locator("section a:not([href^='#']), main img, svg a, svg script, .plot b, h1 b, header b b").count()
            == 0
        )
        assert EVIL.capitalize()[1:] in page.locator("header b").inner_text().capitalize()
        ticks = page.locator("#plot-shares .tick.y").all_text_contents()
        assert [tick for tick in ticks if EVIL in tick], "letter for letter in a figure, too"
        page.locator("#time select").select_option(f"{EVIL} 2")
        assert page.evaluate("document.querySelector('#plot-time-dp').figure.shown.length") > 4
        assert page.evaluate("window.struck") is None
