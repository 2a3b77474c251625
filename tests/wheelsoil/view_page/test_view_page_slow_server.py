"""The analyst's page while the server takes its time: no click is lost, and nothing that is typed or has the focus."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import APIResponse, Page, Route, expect
from view_browser import Held, add_effect, drawn, unfold
from view_client import PATIENCE_S, View

from wheelsoil.workflows import load_choice

ROWS = ("slip", "pull")


def set_threshold(page: Page, value: str) -> None:
    unfold(page, "choice-box")
    page.get_by_label("Slip threshold").fill(value)
    page.get_by_label("Slip threshold").press("Enter")


def test_clicks_while_a_change_is_underway_are_shown_and_taken(page: Page, view: View) -> None:
    held = Held(page, "/api/choose")
    set_threshold(page, "0.15")
    page.get_by_label("Use run-2").uncheck()
    unfold(page, "conditions-box")
    page.get_by_label("literal", exact=True).check()
    add_effect(page, "vasilev")
    page.get_by_label("torque", exact=True).last.check()
    page.get_by_label("drawbar pull", exact=True).last.uncheck()
    page.get_by_label("let the soil move").check()
    asked = {}
    for _ in range(7):
        expect(page.get_by_label("Slip threshold")).to_have_value("0.15")
        expect(page.get_by_label("Use run-2")).not_to_be_checked()
        expect(page.locator("button.run.unused")).to_have_count(1)
        expect(page.get_by_label("literal", exact=True)).to_be_checked()
        expect(page.locator("[data-parameter=H_m]")).to_be_visible()
        expect(page.get_by_label("torque", exact=True).last).to_be_checked()
        expect(page.get_by_label("drawbar pull", exact=True).last).not_to_be_checked()
        expect(page.get_by_label("let the soil move")).to_be_checked()
        route = held.next()
        asked = route.request.post_data_json["choice"]
        route.continue_()
    drawn(page, *ROWS)
    choice = view.settled()[0]["choice"]
    assert choice["slip_threshold"] == 0.15 and choice["sinkage"] == "literal" and choice["soil_prior"]
    assert choice["channels"] == ["t"] and choice["effects"] == ["vasilev"]
    assert [(run["id"], run["use"]) for run in choice["run"]] == [("run-2", False)]
    assert {name: choice[name] for name in asked} == asked


def test_a_click_that_the_server_refuses_is_taken_back(page: Page) -> None:
    held = Held(page, "/api/choose")
    for run in ("run-1", "run-2"):
        page.get_by_label(f"Use {run}").first.uncheck()
    held.next().continue_()
    refused = held.next()
    expect(page.locator("button.run.unused")).to_have_count(2)
    refused.fulfill(status=400, json={"faults": [{"what": "no run is used"}]})
    expect(page.locator("button.run.unused")).to_have_count(1)
    expect(page.get_by_label("Use run-2")).to_be_checked()


def test_save_and_refit_take_the_changes_before_them(page: Page, folder: Path) -> None:
    held = Held(page, "/api/choose")
    set_threshold(page, "0.15")
    page.get_by_label("Use run-2").uncheck()
    page.get_by_role("button", name="Save choice").click()
    page.get_by_role("button", name="Refit").click()
    for _ in range(2):
        held.next().continue_()
    expect(page.locator("#saved")).to_contain_text(str(folder / "choice.toml"))
    saved = load_choice(folder / "choice.toml")
    assert saved.slip_threshold == 0.15 and [run.use for run in saved.runs] == [True, False]
    expect(page.locator("#fit-tables caption").first).to_contain_text("slips from 0.15 on")
    expect(page.locator("#fit-says")).not_to_contain_text("has changed")


def test_nothing_is_saved_where_a_change_before_it_is_refused(page: Page, folder: Path) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    held = Held(page, "/api/choose")
    set_threshold(page, "0.15")
    page.get_by_role("button", name="Save choice").click()
    held.next().fulfill(status=400, json={"faults": [{"what": "no such threshold"}]})
    page.get_by_label("Use run-2").uncheck()
    held.next().continue_()
    drawn(page, *ROWS)
    assert not [url for url in asked if url.endswith("/api/save")]
    assert not (folder / "choice.toml").exists()


@pytest.mark.slow
def test_a_list_that_was_overtaken_by_a_choice_changes_nothing(page: Page, view: View) -> None:
    late: list[tuple[Route, APIResponse]] = []

    def hold(route: Route) -> None:
        view.post("/api/choose", campaign="c1", choice={"slip_threshold": 0.3})  # so that the list has news
        late.append((route, route.fetch()))

    page.route("**/api/list", hold, times=1)
    end = time.monotonic() + PATIENCE_S
    while not late:
        assert time.monotonic() < end, "the list is not asked for"
        page.wait_for_timeout(10)
    page.get_by_label("Use run-2").uncheck()
    expect(page.locator("#state")).to_have_text("READY")
    [(route, answer)] = late
    assert answer.json()["campaigns"][0]["chosen"] < view.campaigns()[0]["chosen"]
    with page.expect_request_finished(lambda request: request.url.endswith("/api/list")):
        route.fulfill(response=answer)
    unfold(page, "choice-box")
    page.get_by_label("let the soil move").check()
    expect(page.get_by_label("Use run-2")).not_to_be_checked()
    expect(page.locator("#state")).to_have_text("READY")
    choice = view.campaigns()[0]["choice"]
    assert choice["soil_prior"] and [run["use"] for run in choice["run"]] == [False]


def test_an_answer_leaves_focus_and_half_typed_numbers_alone(page: Page) -> None:
    add_effect(page, "vasilev")
    drawn(page, *ROWS)
    held = Held(page, "/api/choose")
    box = page.locator("[data-parameter=H_m] input[type=number]")
    add_effect(page, "torque_zero")
    box.fill("0.0")
    held.next().continue_()
    drawn(page, *ROWS)
    expect(page.locator("#sliders [data-effect=torque_zero]")).to_be_visible()
    expect(box).to_have_value("0.0")
    box.press_sequentially("5")
    box.press("Enter")
    expect(box).to_have_value("0.05")
    for element in (page.get_by_label("Search effects"), page.get_by_label("Comment")):
        page.get_by_label("Use run-2").click()  # what can be told depends on the runs: the effects are asked for anew
        element.focus()
        held.next().continue_()
        drawn(page, *ROWS)
        expect(element).to_be_focused()
