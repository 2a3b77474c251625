"""The plots of the analyst's page, driven as a user would: linked, cut, compared, and of runs that lack something."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Route, expect
from view_browser import (
    curve_line,
    drag,
    drawn,
    looking,
    open_run,
    picked,
    points,
    row_line,
    selection,
    state,
    unfold,
)
from view_client import View
from view_field_day import SCRIPT

ROWS = ("slip", "speed", "load", "pull", "torque")


@pytest.fixture
def page(browser: Browser, view: View) -> Iterator[Page]:
    """Return the page, at which nothing is refused."""
    with looking(browser, view.address) as seen:
        drawn(seen, *ROWS)
        yield seen


def samples(view: View, run: str = "r1") -> dict[str, Any]:
    found: dict[str, Any] = view.get(f"/api/run?campaign=c1&run={run}")
    return found


def test_rows_hold_the_samples_and_the_models_at_them(page: Page, view: View) -> None:
    data = samples(view)
    pull = points(page, row_line("pull", "measured"))
    used = [y if u else None for y, u in zip(data["drawbar_pull_n"], data["used"], strict=True)]
    assert pull == list(zip(data["time_s"], used, strict=True))
    said = view.post("/api/prediction", campaign="c1", run="r1", sinkage="balanced")
    page.locator(row_line("pull", "model")).wait_for(state="attached")
    for look in ("model", "baseline"):
        predicted = [y if u else None for y, u in zip(said["drawbar_pull_n"], data["used"], strict=True)]
        assert [y for _, y in points(page, row_line("pull", look))] == predicted
    load = points(page, row_line("load", "measured"))
    assert max(y for _, y in load if y is not None) < 20  # kN


def test_a_stretch_of_time_is_highlighted_in_every_plot_and_zoomed(page: Page, view: View) -> None:
    drag(page, 9.9, 18)  # before the tick at 10 s, by more than a pixel
    chosen, data = selection(page), samples(view)
    rows = [i for i, time_s in enumerate(data["time_s"]) if chosen["from"] <= time_s <= chosen["to"]]
    counted = view.post("/api/selected", campaign="c1", run="r1", kind="time", low=chosen["from"], high=chosen["to"])
    expect(page.locator("#brush-count")).to_contain_text(f"{counted['samples']} of {counted['of']} samples of run-1")
    known = [i for i in rows if data["slip"][i] is not None]
    assert picked(page) == len(known) > 20
    page.get_by_role("button", name="Zoom").click()
    expect(page.locator("#rows .time-axis text").first).to_have_text("10")
    shown = page.evaluate("() => document.querySelector('#cross .samples.own').points.rows")
    assert set(shown) == {i for i in rows if data["used"][i]}
    assert page.evaluate("() => document.querySelectorAll('#track path.track').length") == 5
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    assert state(page, "zoom") is None and selection(page) is None


def test_the_cross_plot_has_the_values_at_the_pointer(page: Page) -> None:
    box = page.locator("#cross").bounding_box()
    page.locator(curve_line("model")).wait_for(state="attached")
    assert box
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(*middle)
    told = page.locator("#cross .figure > text.number")
    expect(told).to_have_text(re.compile(r"^slip 0\.\d\d · [−\d\u202f]+ · model [−\d\u202f]+ N$"))
    page.mouse.move(middle[0], box["y"] + box["height"] - 2)
    expect(told).to_have_text("")


def test_the_cursor_is_one_in_all_plots(page: Page, view: View) -> None:
    drag(page, 10, 12)
    page.keyboard.press("Escape")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    at, data = state(page, "cursor"), samples(view)
    nearest = min(range(len(data["time_s"])), key=lambda i: abs(data["time_s"][i] - at))
    values = page.locator("[data-row='speed'] .number").all_text_contents()
    assert values == [f"{data[key][nearest]:.2f}" for key in ("rim_speed_mps", "ground_speed_mps")]
    expect(page.locator(".cursor-tag text")).to_have_text(f"{at:.2f} s")
    for plot in ("#cross", "#track"):
        assert "translate" in (page.locator(f"{plot} .now").get_attribute("transform") or "")
    page.keyboard.press(" ")
    page.wait_for_timeout(300)
    page.keyboard.press(" ")
    stopped = state(page, "cursor")
    assert 0.1 < stopped - at < 3
    page.wait_for_timeout(100)
    assert state(page, "cursor") == stopped


def test_a_box_over_slip_is_highlighted_over_time(page: Page, view: View) -> None:
    page.locator("#part label", has_text="All").click()
    expect(page.locator("#rows")).to_have_attribute("aria-busy", "false")
    page.wait_for_timeout(50)
    grid = page.locator("#cross .grid").bounding_box()
    assert grid is not None
    page.mouse.move(grid["x"] + 0.2 * grid["width"], grid["y"] + 0.3 * grid["height"])
    page.mouse.down()
    page.mouse.move(grid["x"] + 0.7 * grid["width"], grid["y"] + 0.02 * grid["height"], steps=4)
    page.mouse.up()
    chosen, data = selection(page), samples(view)
    inside = {
        t
        for t, slip, pull in zip(data["time_s"], data["slip"], data["drawbar_pull_n"], strict=True)
        if slip is not None and chosen["from"] <= slip <= chosen["to"] and chosen["low"] <= pull <= chosen["high"]
    }
    assert chosen["kind"] == "slip" and len(inside) > 10
    page.wait_for_function("() => document.querySelector(\"[data-row='torque'] .picked\").points.x.length > 0")
    script = "() => document.querySelector(\"[data-row='torque'] .picked\").points.x"
    assert set(page.evaluate(script)) == inside
    page.get_by_role("button", name="Clear the selection").click()
    expect(page.locator("#bar")).to_be_hidden()


def test_the_keyboard_selects_zooms_and_goes_to_the_next_run(page: Page) -> None:
    before = state(page, "cursor")
    for _ in range(4):
        page.keyboard.press("Shift+ArrowRight")
    chosen = selection(page)
    assert (chosen["from"], chosen["to"]) == pytest.approx((before, before + 2))
    page.keyboard.press("z")
    assert state(page, "zoom") == pytest.approx([before, before + 2])
    page.keyboard.press("j")
    expect(page.locator("#view-title")).to_have_text("clay field: run-2")
    assert state(page, "zoom") is None
    page.keyboard.press("k")
    expect(page.locator("#view-title")).to_have_text("clay field: run-1")
    page.keyboard.press("?")
    expect(page.locator("#shortcuts")).to_contain_text("previous run")
    page.keyboard.press("Escape")
    expect(page.locator("#shortcuts")).to_be_hidden()


def test_samples_that_are_left_out_are_shown_with_their_reason(page: Page, view: View) -> None:
    data = samples(view)
    unfold(page, "samples-box")
    share = f"^Standstill\\s*{100 * data['shares']['standstill']:.1f} %"
    page.get_by_role("button", name=re.compile(share)).click()
    assert selection(page) == {"kind": "reason", "code": "standstill"}
    expect(page.locator("#rows .phase.standstill").first).to_be_visible()
    assert points(page, row_line("pull", "excluded"))
    page.locator("#show-left-out").uncheck()
    expect(page.locator(row_line("pull", "excluded"))).to_have_count(0)


def test_a_stretch_is_left_out_by_hand_and_that_is_undone(page: Page, view: View) -> None:
    drag(page, 20, 30)
    page.get_by_role("button", name="Exclude").click()
    unfold(page, "samples-box")
    expect(page.get_by_role("button", name=re.compile("^By hand"))).to_be_visible()
    drawn(page, *ROWS)  # a change stands on the page before the server has it
    [run] = view.campaigns()[0]["choice"]["run"]
    [(_, first), (second, _)] = run["keep"]
    assert run["file"] == "run-1.mcap" and (first, second) == pytest.approx((20, 30), abs=0.3)
    expect(page.locator("#rows .kept")).to_have_count(2)
    expect(page.locator("#kept")).to_contain_text("Kept of run-1")
    page.wait_for_timeout(400)  # a step is one once it has settled
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("button", name=re.compile("^By hand"))).to_have_count(0)
    drawn(page, *ROWS)
    assert not view.campaigns()[0]["choice"].get("run")
    page.keyboard.press("Control+Shift+z")
    expect(page.locator("#rows .kept")).to_have_count(2)
    page.get_by_role("button", name="Use the whole run").click()
    expect(page.get_by_role("button", name=re.compile("^By hand"))).to_have_count(0)
    drawn(page, *ROWS)
    assert "keep" not in view.campaigns()[0]["choice"]["run"][0]


def test_a_run_is_taken_out_and_thresholds_are_set(page: Page, view: View) -> None:
    page.get_by_label("Use run-2").uncheck()
    expect(page.locator("button.run.unused")).to_have_count(1)
    unfold(page, "choice-box")
    for label, text in (("Slip threshold", "0.15"), ("Filter cut-off", "2"), ("Least speed", "0.6")):
        page.get_by_label(label).fill(text)
        page.get_by_label(label).press("Enter")
    page.get_by_label("torque", exact=True).last.check()
    expect(page.locator("#state")).to_have_text("READY")
    choice = view.settled()[0]["choice"]
    assert (choice["slip_threshold"], choice["cutoff_hz"], choice["min_speed_mps"]) == (0.15, 2, 0.6)
    assert choice["channels"] == ["dp", "t"]
    assert [(run["file"], run["use"]) for run in choice["run"]] == [("run-2.mcap", False)]
    expect(page.locator("#cross .threshold")).to_have_attribute("data-at", "0.15")


def as_diagnosed(route: Route) -> None:
    """Answer as the server does of two campaigns that are diagnosed."""
    answer = route.fetch()
    row = ["tan φ of the soil", "0.25 ± 0.02", "0.31 ± 0.02", "+0.06", "yes", ""]
    route.fulfill(response=answer, json=answer.json() | {"changes": [row], "undiagnosed": []})


def test_two_runs_and_two_campaigns_are_compared(page: Page, view: View) -> None:
    page.get_by_label("Compare with").select_option(label="clay field: run-2")
    other = samples(view, "r2")
    page.locator(row_line("pull", "other")).wait_for(state="attached")
    drawn(page, *ROWS)
    assert len(points(page, row_line("pull", "other"))) == len(other["time_s"])
    told = view.get("/api/compare?campaign=c1&run=r1&campaign_b=c1&run_b=r2")
    cells = page.locator("#compare-table tr").nth(1).locator("td").all_inner_texts()
    loads = [group["load_n"] / 1000 for group in told["groups"]]
    assert cells[:2] == [f"{load:.2f}" for load in loads]
    difference = points(page, "#difference path.measured")
    pairs = zip(told["slip"], *(group["curves"]["drawbar_pull_n"] for group in told["groups"]), strict=True)
    assert difference == [(s, p - q) for s, p, q in pairs if p is not None and q is not None and s > 0]
    page.get_by_label("Compare with").select_option(label="sandy: all runs")
    for name in ("model", "model there"):
        page.locator(curve_line(name)).wait_for(state="attached")
    assert points(page, curve_line("model")) != points(page, curve_line("model there"))
    expect(page.locator("#compare-note")).to_contain_text("clay field − sandy")
    expect(page.locator("#changes-says")).to_contain_text("once clay field and sandy are diagnosed")
    page.route("**/api/compare*", as_diagnosed)
    page.get_by_label("Compare with").select_option(label="sandy: run-1")
    cells = page.locator("#changes-table tr").last.locator("th, td")
    expect(cells).to_have_text(["tan φ of the soil", "0.31 ± 0.02", "0.25 ± 0.02", "+0.06beyond"])


def test_signals_layouts_marks_and_files(page: Page, view: View) -> None:
    page.keyboard.press("s")
    search = page.get_by_label("Search signals")
    search.fill("altitude")
    expect(page.locator("#signal-picker .option")).to_have_count(1)
    search.press("Enter")
    page.locator("[data-row^='signal:'] path.measured").first.wait_for(state="attached")
    [name] = [each for each in state(page, "rows") if each.startswith("signal:")]
    said = view.get(f"/api/signal?campaign=c1&run=r1&name={name.removeprefix('signal:').replace(' ', '%20')}")
    assert points(page, row_line(name, "measured")) == list(zip(said["time_s"], said["values"], strict=True))
    page.get_by_role("button", name="Layout", exact=True).click()
    page.locator("#cross-y").select_option("vertical_load_n")
    page.locator("#cross-x").select_option("ground_speed_mps")
    expect(page.locator("#cross-title")).to_have_text("Vertical load against ground speed")
    page.locator("#colour").select_option("load")
    expect(page.locator("#colours li")).to_have_count(1)
    page.get_by_label("Name of the layout").fill("mine")
    page.get_by_role("button", name="Save layout").click()
    page.get_by_label("Slip ratio").uncheck()
    expect(page.locator("[data-row='slip']")).to_have_count(0)
    page.get_by_role("button", name="mine", exact=True).click()
    expect(page.locator("[data-row='slip']")).to_have_count(1)
    page.get_by_role("button", name="Forget the layout mine").click()
    page.keyboard.press("Escape")
    page.keyboard.press("m")
    expect(page.get_by_label("Text of the mark")).to_be_focused()
    page.keyboard.type("rut <b>")
    page.keyboard.press("Enter")
    expect(page.locator("#rows .flag-text")).to_have_text("rut <b>")
    page.get_by_label("Comment").fill("wet")
    page.get_by_label("Comment").blur()
    drawn(page, "speed")
    choice = view.campaigns()[0]["choice"]
    assert choice["comment"] == "wet" and choice["run"][0]["marks"][0]["text"] == "rut <b>"
    for kind, begins in (("rows", "<svg"), ("csv", "time_s,")):
        page.get_by_role("button", name="Export").click()
        with page.expect_download() as saved:
            page.locator(f"[data-save='{kind}']").click()
        text = saved.value.path().read_text(encoding="utf-8")
        assert text.startswith(begins) and "var(--" not in text
    assert len(text.splitlines()) == len(samples(view)["time_s"]) + 1


def test_the_address_keeps_run_zoom_parameters_and_comparison(page: Page) -> None:
    page.keyboard.press("j")
    page.get_by_label("Compare with").select_option(label="sandy: run-1")
    page.locator("[data-parameter=tan_phi] input[type=number]").fill("0.3")
    page.locator("[data-parameter=tan_phi] input[type=number]").press("Enter")
    page.locator("#view-title").click()
    drag(page, 10, 18)
    page.keyboard.press("z")
    zoom = state(page, "zoom")
    page.wait_for_url(re.compile(r"run=clay.*run-2.*with=sandy.*t=.*soil=tan_phi"))
    page.reload()
    drawn(page, *ROWS)
    expect(page.locator("#view-title")).to_have_text("clay field: run-2")
    assert state(page, "zoom") == pytest.approx(zoom, abs=0.01)
    expect(page.locator("[data-parameter=tan_phi] input[type=number]")).to_have_value("0.3")
    assert page.get_by_label("Compare with").evaluate("(menu) => menu.selectedOptions[0].label") == "sandy: run-1"
    page.keyboard.press("k")
    page.wait_for_url(re.compile("[?]run=[^&]*run-1&"))
    page.go_back()
    expect(page.locator("#view-title")).to_have_text("clay field: run-2")
    expect(page.locator("[data-parameter=tan_phi] input[type=number]")).to_have_value("0.3")


def test_names_from_data_are_text(page: Page) -> None:
    open_run(page, "<b>markup", SCRIPT)
    drawn(page, *ROWS)
    expect(page.locator("#view-title")).to_contain_text("<script>")
    expect(page.locator("img, main script, main nav b b")).to_have_count(0)
    assert page.title() != "taken"


def test_a_missing_torque_costs_its_own_row_only(page: Page) -> None:
    open_run(page, "no driving_torque")
    drawn(page, *ROWS[:4])
    expect(page.locator("#rows .row")).to_have_count(4)


def test_a_missing_ground_speed_is_said_and_the_rest_is_drawn(browser: Browser, view: View) -> None:
    with looking(browser, view.address, refused=True) as page:
        drawn(page, *ROWS)
        campaign = open_run(page, "no ground_speed")
        expect(page.locator("#rows .row")).to_have_count(4)
        expect(page.locator("[data-row='slip']")).to_have_count(0)
        expect(campaign.locator("button.run .tag")).to_have_text("✕ poor")
        expect(page.locator("#cross-note")).to_have_text("not measured")
        unfold(page, "samples-box")
        expect(page.locator("#notes")).to_contain_text("ground_speed")


def test_a_measured_sinkage_has_its_row(page: Page) -> None:
    open_run(page, "measured sinkage")
    drawn(page, *ROWS, "sinkage")
    page.locator(row_line("sinkage", "model")).wait_for(state="attached")
    page.get_by_role("button", name="Layout", exact=True).click()
    page.locator("#row-list").get_by_label("Sinkage").uncheck()
    expect(page.locator("#rows .row")).to_have_count(5)
