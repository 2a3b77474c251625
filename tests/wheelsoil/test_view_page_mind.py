"""What the analyst's page keeps in mind: whose choice it is, which campaign it shows, and nothing of a run before."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Route, expect
from view_browser import comes, curve_on_page, drawn, looking
from view_client import PATIENCE_S, taken_from, viewing

ROOT = Path(__file__).parents[2]
CLAY, SANDY = ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy"
PLOTS = ("time-drawbar_pull_n", "slip-drawbar_pull_n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return taken_from(CLAY, tmp_path / "clay", 1)


def test_a_page_that_was_away_takes_what_another_one_chose(browser: Browser, folder: Path) -> None:
    with viewing(folder) as view, looking(browser, view.address, refused=True) as seen:
        drawn(seen, *PLOTS)
        seen.get_by_label("literal", exact=True).check()
        expect(seen.locator("#state")).to_have_text("READY")
        seen.context.set_offline(True)
        expect(seen.locator("#state")).to_have_text("NO CONNECTION")
        view.post(
            "/api/choose", campaign="c1", choice={"slip_threshold": 0.33, "run": [{"id": "run-1", "keep": [[0, 20]]}]}
        )
        seen.context.set_offline(False)
        expect(seen.get_by_label("Slip threshold")).to_have_value("0.33")
        expect(seen.get_by_label("balanced", exact=True)).to_be_checked()
        expect(seen.get_by_role("button", name=re.compile("^By hand"))).to_be_visible()
        drawn(seen, *PLOTS)
        assert view.campaigns()[0]["choice"]["slip_threshold"] == 0.33 and view.campaigns()[0]["chosen"] == 2


def test_a_server_on_other_folders_is_told_nothing_of_the_ones_before(browser: Browser, folder: Path) -> None:
    sandy = taken_from(SANDY, folder.parent / "sandy", 1)
    with viewing(folder) as first:
        port = first.port
        with looking(browser, first.address, refused=True) as seen:
            drawn(seen, *PLOTS)
            seen.locator("[data-effect=vasilev] input").check()
            expect(seen.locator("[data-parameter=H_m]")).to_be_visible()
            first.process.send_signal(2)
            first.process.wait()
            with viewing(sandy, port=port) as second:
                expect(seen.locator("#view-title")).to_contain_text("sandy")
                drawn(seen, *PLOTS)
                expect(seen.locator("[data-effect=vasilev] input")).not_to_be_checked()
                assert second.campaigns()[0]["chosen"] == 0


def test_each_campaign_has_its_own_reading_of_the_sinkage(browser: Browser, folder: Path) -> None:
    sandy = taken_from(SANDY, folder.parent / "sandy", 1)
    with viewing(folder, sandy) as view, looking(browser, view.address) as seen:
        drawn(seen, *PLOTS)
        seen.get_by_label("literal", exact=True).check()
        expect(seen.locator("#state")).to_have_text("READY")
        seen.locator("button.run").last.click()
        expect(seen.locator("#view-title")).to_contain_text("sandy")
        expect(seen.get_by_label("balanced", exact=True)).to_be_checked()
        assert curve_on_page(
            seen, "drawbar_pull_n", view.post("/api/curve", campaign="c2", run="r1", sinkage="balanced")
        )
        seen.locator("button.run").first.click()
        expect(seen.get_by_label("literal", exact=True)).to_be_checked()
        assert curve_on_page(
            seen, "drawbar_pull_n", view.post("/api/curve", campaign="c1", run="r1", sinkage="literal")
        )


def test_a_soil_that_was_let_move_moves_the_curve_by_hand(browser: Browser, folder: Path) -> None:
    choice = {"effects": ["vasilev"], "soil_prior": True}
    with viewing(folder) as view:
        view.settled()
        view.post("/api/choose", campaign="c1", choice=choice)
        fit = view.post("/api/fit", campaign="c1")
        with looking(browser, view.address) as seen:
            drawn(seen, *PLOTS)
            seen.get_by_role("button", name="Refit").click()
            expect(seen.locator("#fit-tables table").first).to_be_visible()
            expect(seen.locator("#soil-hint")).to_contain_text("moved")
            assert curve_on_page(
                seen, "drawbar_pull_n", view.post("/api/curve", campaign="c1", run="r1", **fit["curves"]["chosen"])
            )
            seen.locator("#soil-box summary").click()
            found = fit["models"]["chosen"]["estimates"]["tan_phi"]["value"]
            box = seen.locator("[data-parameter=tan_phi] input[type=number]")
            assert float(box.input_value()) == pytest.approx(found, rel=1e-5)


def test_a_run_that_failed_is_not_shown_with_the_plots_of_another(browser: Browser, folder: Path) -> None:
    broken = taken_from(CLAY, folder.parent / "broken", 1)
    text = (broken / "vehicle.toml").read_text(encoding="utf-8")
    (broken / "vehicle.toml").write_text(re.sub(r"\[wheel\].*?\n\n", "", text, flags=re.DOTALL), encoding="utf-8")
    with viewing(folder, broken) as view, looking(browser, view.address, refused=True) as seen:
        view.settled()
        drawn(seen, *PLOTS)
        comes(seen, PLOTS[1], "curve by hand")
        seen.locator("button.run").last.click()
        expect(seen.locator("#waiting")).to_contain_text("wheel")
        expect(seen.locator("#plots")).to_be_hidden()
        expect(seen.locator("#legend")).to_be_hidden()
        seen.locator("button.run").first.click()
        drawn(seen, *PLOTS)


@pytest.mark.parametrize("lost", [False, True])
def test_a_selection_is_counted_though_the_one_before_it_failed(browser: Browser, folder: Path, lost: bool) -> None:
    with viewing(folder) as view, looking(browser, view.address, refused=True) as seen:
        drawn(seen, *PLOTS)
        held: list[Route] = []
        seen.route("**/api/selected", lambda route: route.continue_() if held else held.append(route))
        start, stop = seen.get_by_label("Selection from, seconds"), seen.get_by_label("Selection to, seconds")
        start.fill("10")
        start.press("Enter")
        end = time.monotonic() + PATIENCE_S
        while not held:
            assert time.monotonic() < end, "nothing is counted"
            seen.wait_for_timeout(10)
        stop.fill("15")
        stop.press("Enter")
        if lost:
            held[0].abort()
        else:
            said = json.dumps({"faults": [{"what": "not now"}]})
            held[0].fulfill(status=422, content_type="application/json", body=said)
        counted = view.post("/api/selected", campaign="c1", run="r1", kind="time", low=10, high=15)
        expect(seen.locator("#brush-count")).to_contain_text(
            f"{counted['samples']} of {counted['of']} samples of run-1"
        )
        expect(seen.locator("#state")).to_have_text("READY")


def test_numbers_names_and_changes_hold(browser: Browser, folder: Path) -> None:
    with viewing(folder) as view, looking(browser, view.address) as seen:
        drawn(seen, *PLOTS)
        shown = seen.evaluate(
            "async () => { const { sensible } = await import('/channels.js'); "
            "return [1.235e-4, 0.012346, -487629, 12345.6, 9144, 1.2e-6, 4.876e6, 0].map((value) => sensible(value)); }"
        )
        narrow = "\u202f"
        assert shown[:5] == ["0.0001235", "0.01235", f"−487{narrow}600", f"12{narrow}350", "9144"]
        assert shown[5:] == ["1.200e−6", "4.876e+6", "0"]
        ids = seen.evaluate(
            "async () => { const { entryOf } = await import('/samples.js'), choice = {}; "
            "for (const id of ['run-1', 'run-1-2']) entryOf(choice, { file: 'run-1.mcap', id }).use = false; "
            "return choice.run.map((entry) => entry.id); }"
        )
        assert ids == ["run-1", "run-1-2"]
        seen.evaluate(
            "async () => { const { change } = await import('/choice.js'); "
            "await change('c1', () => { throw new Error('mine'); }).catch(() => {}); }"
        )
        seen.get_by_label("Slip threshold").fill("0.15")
        seen.get_by_label("Slip threshold").press("Enter")
        expect(seen.locator("#state")).to_have_text("READY")
        assert view.campaigns()[0]["choice"]["slip_threshold"] == 0.15
