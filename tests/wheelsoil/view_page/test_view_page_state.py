"""State of the analyst's page: the choice in use, the campaign on display, and no data of the previous run."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, Page, expect
from view_browser import Held, curve_line, curve_on_page, drag, drawn, looking, open_run, unfold
from view_client import View

ROWS = ("slip", "pull")
_ON_FIRM_GROUND = """async () => {
  const { state, tell } = await import('/store.js');
  state.campaigns.flatMap((each) => each.runs).find((run) => run.state === "failed").on_soil = false;
  tell("list");
}"""


@pytest.mark.slow
def test_a_page_that_was_away_takes_what_another_one_chose(page: Page, view: View) -> None:
    unfold(page, "conditions-box")
    page.get_by_label("literal", exact=True).check()
    expect(page.locator("#state")).to_have_text("READY")
    page.context.set_offline(True)
    expect(page.locator("#state")).to_have_text("NO CONNECTION")
    before = view.campaigns()[0]["chosen"]
    choice = {"slip_threshold": 0.33, "run": [{"id": "run-1", "keep": [[0, 20]]}]}
    view.post("/api/choose", campaign="c1", choice=choice)
    page.context.set_offline(False)
    unfold(page, "choice-box")
    unfold(page, "samples-box")
    expect(page.get_by_label("Slip threshold")).to_have_value("0.33")
    expect(page.get_by_label("balanced", exact=True)).to_be_checked()
    expect(page.get_by_role("button", name=re.compile("^By hand"))).to_be_visible()
    drawn(page, *ROWS)
    [clay, *_] = view.campaigns()
    assert clay["choice"]["slip_threshold"] == 0.33 and clay["chosen"] == before + 1


def test_each_campaign_has_its_own_reading_of_the_sinkage(page: Page, view: View) -> None:
    unfold(page, "conditions-box")
    page.get_by_label("literal", exact=True).check()
    expect(page.locator("#state")).to_have_text("READY")
    open_run(page, "sandy")
    expect(page.get_by_label("balanced", exact=True)).to_be_checked()
    assert curve_on_page(page, view.post("/api/curve", campaign="c2", run="r3", sinkage="balanced"))
    open_run(page, "clay field")
    expect(page.get_by_label("literal", exact=True)).to_be_checked()
    assert curve_on_page(page, view.post("/api/curve", campaign="c1", run="r1", sinkage="literal"))


def test_a_soil_that_was_let_move_moves_the_curve_by_hand(browser: Browser, view: View) -> None:
    used = [{"id": "run-1", "keep": [[5, 20]]}, {"id": "run-2", "use": False}]
    view.post("/api/choose", campaign="c1", choice={"effects": ["vasilev"], "soil_prior": True, "run": used})
    with looking(browser, view.address) as page:
        drawn(page, *ROWS)
        with page.expect_response("**/api/fit") as told:
            page.get_by_role("button", name="Refit").click()
        fit = told.value.json()
        expect(page.locator("#fit-tables table").first).to_be_visible()
        expect(page.locator("#soil-hint")).to_contain_text("moved")
        fitted = view.post("/api/curve", campaign="c1", run="r1", **fit["curves"]["chosen"])
        assert curve_on_page(page, fitted)
        found = fit["models"]["chosen"]["estimates"]["tan_phi"]["value"]
        box = page.locator("[data-parameter=tan_phi] input[type=number]")
        assert float(box.input_value()) == pytest.approx(found, rel=1e-5)


def test_a_run_that_failed_or_cannot_be_read_is_not_shown_with_the_plots_of_another(page: Page) -> None:
    expect(page.locator("#remarks")).to_contain_text("run-0")
    expect(page.locator(".campaign").last.locator("button.run")).to_contain_text("run-1")
    page.locator(curve_line("model")).wait_for()
    open_run(page, "broken")
    expect(page.locator("#waiting")).to_contain_text("wheel")
    expect(page.locator("#rows")).to_be_hidden()
    expect(page.locator("#legend")).to_be_hidden()
    page.evaluate(_ON_FIRM_GROUND)
    expect(page.locator("button.run .tag[data-level=failed]").first).to_have_text("failed")
    open_run(page, "clay field")
    drawn(page, *ROWS)


@pytest.mark.slow
def test_a_selection_is_counted_though_the_one_before_it_failed(page: Page, view: View) -> None:
    drag(page, 5, 8)
    start, stop = page.get_by_label("Selection from"), page.get_by_label("Selection to")
    for lost, low in ((False, 10), (True, 12)):
        held = Held(page, "/api/selected", times=1)
        stop.fill(str(low + 5))
        stop.press("Enter")
        route = held.next()
        start.fill(str(low))
        start.press("Enter")
        if lost:
            route.abort()
        else:
            route.fulfill(status=422, json={"faults": [{"what": "not now"}]})
        counted = view.post("/api/selected", campaign="c1", run="r1", kind="time", low=low, high=low + 5)
        said = f"{counted['samples']} of {counted['of']} samples of run-1"
        expect(page.locator("#brush-count")).to_contain_text(said)
        expect(page.locator("#state")).to_have_text("READY")


def test_numbers_names_and_changes_hold(page: Page, view: View) -> None:
    shown = page.evaluate(
        "async () => { const { sensible } = await import('/channels.js'); "
        "return [1.235e-4, 0.012346, -487629, 12345.6, 9144, 1.2e-6, 4.876e6, 0].map((value) => sensible(value)); }"
    )
    narrow = "\u202f"
    assert shown[:5] == ["0.0001235", "0.01235", f"−487{narrow}600", f"12{narrow}350", f"9{narrow}144"]
    assert shown[5:] == ["1.200 × 10⁻⁶", f"4{narrow}876{narrow}000", "0"]
    ids = page.evaluate(
        "async () => { const { entryOf } = await import('/samples.js'), choice = {}; "
        "for (const id of ['run-1', 'run-1-2']) entryOf(choice, { file: 'run-1.mcap', id }).use = false; "
        "return choice.run.map((entry) => entry.id); }"
    )
    assert ids == ["run-1", "run-1-2"]
    page.evaluate(
        "async () => { const { change } = await import('/choice.js'); "
        "await change('c1', () => { throw new Error('mine'); }).catch(() => {}); }"
    )
    unfold(page, "choice-box")
    page.get_by_label("Slip threshold").fill("0.15")
    page.get_by_label("Slip threshold").press("Enter")
    expect(page.locator("#state")).to_have_text("READY")
    assert view.campaigns()[0]["choice"]["slip_threshold"] == 0.15
