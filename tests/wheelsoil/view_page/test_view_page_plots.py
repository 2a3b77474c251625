"""The plots of the analyst's page, driven as a user would: linked, cut, compared, and of runs that lack something."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect
from view_browser import comes, drag, drawn, looking, open_run, picked, points, seen_range, shapes, show_all, trace
from view_client import View
from view_field_day import SCRIPT

PLOTS = ("time-drawbar_pull_n", "slip-drawbar_pull_n", "time-driving_torque_nm", "slip-driving_torque_nm")


@pytest.fixture
def page(browser: Browser, view: View) -> Iterator[Page]:
    """Return the page, at which nothing is refused."""
    with looking(browser, view.address) as seen:
        drawn(seen, *PLOTS)
        yield seen


def samples(view: View, run: str = "r1") -> dict[str, Any]:
    found: dict[str, Any] = view.get(f"/api/run?campaign=c1&run={run}")
    return found


def test_a_stretch_of_time_is_highlighted_in_every_plot(page: Page, view: View) -> None:
    drag(page, "time-drawbar_pull_n", (10, -1000), (18, -2000))
    [box] = shapes(page, "time-driving_torque_nm", "box")
    assert (box["x0"], box["x1"]) == pytest.approx((10, 18), abs=0.2)
    data = samples(view)
    rows = [i for i, time_s in enumerate(data["time_s"]) if box["x0"] <= time_s <= box["x1"]]
    assert len(rows) > 20
    counted = view.post("/api/selected", campaign="c1", run="r1", kind="time", low=box["x0"], high=box["x1"])
    assert counted["samples"] > 5 * len(rows) and counted["of"] == data["thinned_from"]
    expect(page.locator("#brush-count")).to_contain_text(f"{counted['samples']} of {counted['of']} samples of run-1")
    for plot in PLOTS:
        assert picked(page, plot) == len(rows), plot
    assert set(points(page, "slip-drawbar_pull_n", "selected")) == {
        (data["slip"][i], data["drawbar_pull_n"][i]) for i in rows
    }


def test_a_box_over_slip_is_highlighted_over_time(page: Page, view: View) -> None:
    show_all(page, "slip-drawbar_pull_n")
    drag(page, "slip-drawbar_pull_n", (-0.25, -1500), (-0.05, -4000))
    [box] = shapes(page, "slip-drawbar_pull_n", "box")
    assert not shapes(page, "time-drawbar_pull_n", "box")
    data = samples(view)
    inside = {
        time_s
        for time_s, slip, pull in zip(data["time_s"], data["slip"], data["drawbar_pull_n"], strict=True)
        if slip is not None and box["x0"] <= slip <= box["x1"] and box["y0"] <= pull <= box["y1"]
    }
    assert len(inside) > 10
    assert {x for x, _ in points(page, "time-driving_torque_nm", "selected")} == inside
    page.get_by_role("button", name="Clear").click()
    assert not picked(page, "time-drawbar_pull_n")


def test_plots_over_slip_begin_with_what_was_driven(page: Page) -> None:
    plots = {"slip-drawbar_pull_n": -4000, "slip-driving_torque_nm": -1000}
    for plot, braking in plots.items():
        assert seen_range(page, plot, "x")[0] > -0.1 and seen_range(page, plot, "y")[0] > braking / 2
        used = trace(page, plot, "used")
        assert min(used["x"]) < -0.2 and min(used["y"]) < braking  # they are there, beyond the axes
    expect(page.locator("#part")).to_have_value("driving")
    show_all(page, PLOTS[3])
    expect(page.locator("#part")).to_have_value("all")
    for plot, braking in plots.items():
        page.wait_for_function("(id) => document.getElementById(id).layout.xaxis.range[0] < -0.2", arg=plot)
        assert seen_range(page, plot, "y")[0] < braking
    page.locator("#part").select_option("driving")
    for plot in plots:
        page.wait_for_function("(id) => document.getElementById(id).layout.xaxis.range[0] > -0.1", arg=plot)
    show_all(page, PLOTS[1])
    expect(page.locator("#part")).to_have_value("all")


def test_the_keyboard_selects_too(page: Page, view: View) -> None:
    page.get_by_label("Selection from, slip").fill("0.3")
    page.get_by_label("Selection from, slip").press("Enter")
    used = [slip for slip in samples(view)["slip"] if slip is not None and slip >= 0.3]
    assert picked(page, "time-drawbar_pull_n") == len(used) > 10
    page.keyboard.press("Escape")
    assert not picked(page, "time-drawbar_pull_n")
    page.locator("#time-drawbar_pull_n").focus()
    for key in ("ArrowRight", "ArrowRight", "Shift+ArrowRight"):
        page.keyboard.press(key)
    expect(page.get_by_label("Selection to, seconds")).to_have_value("6.5")
    [box] = shapes(page, "time-drawbar_pull_n", "box")
    assert (box["x0"], box["x1"]) == (1, 6.5)


def test_samples_that_are_left_out_are_shown_with_their_reason(page: Page, view: View) -> None:
    data = samples(view)
    standing = data["reason"].count("standstill")
    share = f"^Standstill {100 * data['shares']['standstill']:.1f} %"
    page.get_by_role("button", name=re.compile(share)).click()
    assert picked(page, "time-drawbar_pull_n") == standing > 0
    left_out = trace(page, "time-drawbar_pull_n", "excluded")
    assert "standstill" in left_out["customdata"]
    kinds = {
        shape["name"] for shape in page.evaluate("() => document.getElementById('time-drawbar_pull_n').layout.shapes")
    }
    assert {"drive", "brake", "standstill"} <= kinds
    page.locator("#show-left-out").uncheck()
    page.wait_for_function(
        "() => !document.getElementById('time-drawbar_pull_n').data.some((trace) => trace.name === 'excluded')"
    )


def test_a_stretch_is_left_out_by_hand_and_taken_back(page: Page, view: View) -> None:
    drag(page, "time-drawbar_pull_n", (20, -1000), (30, -2000))
    page.get_by_role("button", name="Leave this out").click()
    expect(page.get_by_role("button", name=re.compile("^By hand"))).to_be_visible()
    [run] = view.campaigns()[0]["choice"]["run"]
    [(_, first), (second, _)] = run["keep"]
    assert run["file"] == "run-1.mcap" and (first, second) == pytest.approx((20, 30), abs=0.3)
    data = samples(view)
    used = trace(page, "time-drawbar_pull_n", "used")["y"]
    assert [y is not None for y in used] == data["used"] and "by_hand" in data["reason"]
    assert len(shapes(page, "time-drawbar_pull_n", "kept")) == 2
    expect(page.locator("#kept")).to_contain_text("Kept of run-1")
    page.get_by_role("button", name="Use the whole run").click()
    expect(page.get_by_role("button", name=re.compile("^By hand"))).to_have_count(0)
    assert "keep" not in view.campaigns()[0]["choice"]["run"][0]


def test_a_run_is_taken_out_and_thresholds_are_set(page: Page, view: View) -> None:
    page.get_by_label("Use run-2").uncheck()
    expect(page.locator("button.run.unused")).to_have_count(1)
    for label, text in (("Slip threshold", "0.15"), ("Filter cut-off", "2"), ("Least speed", "0.6")):
        page.get_by_label(label).fill(text)
        page.get_by_label(label).press("Enter")
    page.get_by_label("torque", exact=True).last.check()
    expect(page.locator("#state")).to_have_text("READY")
    choice = view.settled()[0]["choice"]
    assert (choice["slip_threshold"], choice["cutoff_hz"], choice["min_speed_mps"]) == (0.15, 2, 0.6)
    assert choice["channels"] == ["dp", "t"]
    assert [(run["file"], run["use"]) for run in choice["run"]] == [("run-2.mcap", False)]
    assert shapes(page, "slip-drawbar_pull_n", "threshold")[0]["x0"] == 0.15


def test_two_runs_and_two_campaigns_are_compared(page: Page, view: View) -> None:
    page.get_by_label("Compare with").select_option(label="clay field: run-2")
    expect(page.locator("#legend")).to_contain_text("run-2, used")
    drawn(page, *PLOTS)
    used = "(plot) => plot.data.filter((trace) => trace.name === 'used').map((trace) => trace.line.dash).sort()"
    assert page.locator("#time-drawbar_pull_n").evaluate(used) == ["dash", "solid"]
    drag(page, "time-drawbar_pull_n", (10, -1000), (18, -2000))
    [box] = shapes(page, "time-drawbar_pull_n", "box")
    both = [t for data in (samples(view), samples(view, "r2")) for t in data["time_s"] if box["x0"] <= t <= box["x1"]]
    assert picked(page, "slip-driving_torque_nm") == len(both)
    page.get_by_label("Compare with").select_option(label="sandy: all runs")
    expect(page.locator("#legend")).to_contain_text("by hand, on the other soil")
    curves = ("curve by hand", "curve by hand, on the other soil")
    for name in curves:
        comes(page, "slip-drawbar_pull_n", name)
    clay, sandy = (points(page, "slip-drawbar_pull_n", name) for name in curves)
    assert clay != sandy


def test_names_from_data_are_text(page: Page) -> None:
    open_run(page, "<b>markup", SCRIPT)
    drawn(page, *PLOTS)
    page.locator("#time-drawbar_pull_n").hover()
    drag(page, "time-drawbar_pull_n", (10, -1000), (18, -2000))
    expect(page.locator("#plots .hoverlayer").first).to_contain_text("<script>")
    expect(page.locator("img, main script, main b")).to_have_count(0)
    assert page.title() != "taken"


def test_a_missing_torque_costs_its_own_plots_only(page: Page) -> None:
    open_run(page, "no driving_torque")
    drawn(page, *PLOTS[:2])
    expect(page.locator("#shown")).to_contain_text("torque: not measured")
    expect(page.locator("#plots figure")).to_have_count(2)


def test_a_missing_ground_speed_is_said_and_the_rest_is_drawn(browser: Browser, view: View) -> None:
    with looking(browser, view.address, refused=True) as page:
        drawn(page, *PLOTS)
        campaign = open_run(page, "no ground_speed")
        expect(page.locator("#plots")).to_have_attribute("aria-busy", "false")
        expect(page.locator("#plots figure")).to_have_count(2)
        expect(campaign.locator("button.run .tag")).to_have_text("✕ poor")
        expect(page.locator("#notes")).to_contain_text("ground_speed")


def test_a_measured_sinkage_has_its_plots(page: Page) -> None:
    open_run(page, "measured sinkage")
    drawn(page, *PLOTS, "time-sinkage_m", "slip-sinkage_m")
    expect(page.locator("#legend")).to_contain_text("by hand")
    comes(page, "slip-sinkage_m", "curve by hand")
    page.locator("#shown").get_by_label("sinkage").uncheck()
    expect(page.locator("#plots figure")).to_have_count(4)
