"""The analyst's model panel, driven as a user would, and held to the command line and the model itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cli_support import ok
from playwright.sync_api import Browser, Locator, Page, Route, expect
from view_browser import add_effect, curve_on_page, drawn, looking, unfold
from view_client import View
from view_field_day import FieldDay

ROWS = ("slip", "pull", "torque")
_FITS = "(width) => document.documentElement.scrollWidth === width"
RUN = {"campaign": "c1", "run": "r1"}


def row(page: Page, parameter: str) -> Locator:
    return page.locator(f"[data-parameter='{parameter}']")


def switch_on(page: Page, effect: str, parameter: str) -> None:
    add_effect(page, effect)
    expect(row(page, parameter)).to_be_visible()


def value_of(page: Page, parameter: str) -> float:
    return float(row(page, parameter).locator("input[type=number]").input_value())


def test_the_curve_follows_a_slider_and_is_the_model_s(page: Page, view: View) -> None:
    switch_on(page, "vasilev", "H_m")
    slider = row(page, "H_m").locator("input[type=range]")
    box = slider.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.1 * box["width"], middle)
    page.mouse.down()
    for step in range(40):
        page.mouse.move(box["x"] + (0.1 + 0.015 * step) * box["width"], middle)
    page.mouse.up()
    moved = value_of(page, "H_m")
    assert moved > 0
    said = view.post("/api/curve", **RUN, sinkage="balanced", effects=["vasilev"], values={"H_m": moved})
    assert curve_on_page(page, said)
    base = view.post("/api/curve", **RUN, sinkage="balanced", effects=[], values={})
    assert said["driving_torque_nm"] != base["driving_torque_nm"]
    measures = page.evaluate("() => performance.getEntriesByName('curve').map((each) => each.duration)")
    assert measures and all(duration > 0 for duration in measures)


def test_boxes_arrows_resets_reading_load_and_soil_bend_it_too(page: Page, view: View) -> None:
    switch_on(page, "vasilev", "H_m")
    resets = [row(page, name).locator(".reset") for name in ("cohesion_pa", "tan_phi", "H_m")]
    titles = [reset.get_attribute("title") or "" for reset in resets]
    assert titles[0].endswith("\u202f580 Pa") and re.fullmatch(r"back to 0\.\d{1,4}", titles[1])
    assert titles[2] == "back to 0 m"
    row(page, "H_m").locator("input[type=number]").fill("0.05")
    row(page, "H_m").locator("input[type=number]").press("Enter")
    row(page, "H_m").locator("input[type=range]").press("ArrowRight")
    moved = value_of(page, "H_m")
    assert 0.05 < moved < 0.06
    unfold(page, "conditions-box")
    page.get_by_label("literal", exact=True).check()
    page.locator("#load").fill("8000")
    page.locator("#load").press("Enter")
    row(page, "cohesion_pa").locator("input[type=number]").fill("9000")
    row(page, "cohesion_pa").locator("input[type=number]").press("Enter")
    asked: dict[str, Any] = {**RUN, "sinkage": "literal", "effects": ["vasilev"], "load_n": 8000}
    said = view.post("/api/curve", **asked, values={"H_m": moved}, soil={"cohesion_pa": 9000})
    assert curve_on_page(page, said)
    row(page, "cohesion_pa").get_by_role("button").click()
    row(page, "H_m").get_by_role("button").click()
    assert value_of(page, "H_m") == 0
    said = view.post("/api/curve", **asked, values={"H_m": 0.0})
    assert curve_on_page(page, said)


def test_effects_are_found_by_words(page: Page, view: View) -> None:
    search, found = page.get_by_label("Search effects"), page.locator("#effect-picker .option:visible")
    search.fill("zero")
    keys = found.evaluate_all("(rows) => rows.map((row) => row.dataset.key)")
    assert "drawbar_pull_zero" in keys and "vasilev" not in keys
    search.fill("multi pass")
    expect(found.first).to_contain_text("not identifiable here")
    search.press("Enter")  # one that cannot be identified is not taken
    search.fill("vasilev")
    search.press("Enter")
    expect(row(page, "H_m")).to_be_visible()
    expect(page.locator("#sliders section")).to_have_count(1)
    page.get_by_role("button", name="Take Slip sinkage").click()
    expect(row(page, "H_m")).to_have_count(0)
    expect(page.locator("#state")).to_have_text("READY")
    assert not view.campaigns()[0]["choice"].get("effects")


def test_a_refit_is_the_command_line_s_and_the_choice_is_kept(page: Page, view: View, folder: Path) -> None:
    switch_on(page, "vasilev", "H_m")
    unfold(page, "choice-box")
    page.get_by_label("Slip threshold").fill("0.15")
    page.get_by_label("Slip threshold").press("Enter")
    page.get_by_label("Use run-2").uncheck()
    expect(page.locator("button.run.unused")).to_have_count(1)
    with page.expect_response("**/api/fit") as told:
        page.get_by_role("button", name="Refit").click()
    expect(page.locator("#fit-tables table").first).to_be_visible()
    page.get_by_role("button", name="Save choice").click()
    kept = folder / "choice.toml"
    expect(page.locator("#saved")).to_contain_text(str(kept))
    expect(page.locator("#commands li").first).to_contain_text(f"wheelsoil fit '{folder}' --choice '{kept}'")
    fit = ok("fit", folder, "--choice", kept, "--json").json
    own = fit["models"]["chosen"]
    assert own["effects"] == ["vasilev"] and fit["slip_threshold"] == 0.15
    assert value_of(page, "H_m") == pytest.approx(own["estimates"]["H_m"]["value"], rel=1e-5)
    expect(row(page, "H_m").locator(".fitted")).to_contain_text("95 %")
    cells = (
        page.locator("#fit-tables table")
        .first.locator("tbody tr")
        .evaluate_all("(rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent.trim()))")
    )
    expected = [model["criteria"]["dp"] for model in fit["models"].values()]
    shown = [[float(text.replace("−", "-").replace("\u202f", "")) for text in cells[1:]] for cells in cells]
    assert shown == [pytest.approx([each["M0_percent"], each["R0_N"], each["R2"]], rel=1e-3) for each in expected]
    asked = told.value.json()["curves"]["chosen"]
    assert curve_on_page(page, view.post("/api/curve", **RUN, **asked), "chosen")
    page.locator("button.run", has_text="run-2").click()
    other = view.post("/api/curve", **RUN | {"run": "r2"}, **asked)
    assert other["load_n"] != view.post("/api/curve", **RUN)["load_n"]
    for curve in ("model", "chosen"):
        assert curve_on_page(page, other, curve)
    expect(page.locator("#load")).to_have_attribute("placeholder", f"{other['load_n']:.0f}")
    page.get_by_label("Use run-2").check()
    expect(page.locator("#fit-says")).to_contain_text("The choice has changed")


def test_a_file_is_only_replaced_when_that_is_asked_for(page: Page, folder: Path) -> None:
    save = page.get_by_role("button", name="Save choice")
    mine = '# mine\nschema = "wheelsoil/choice/1"\nslip_threshold = 0.3\n'
    (folder / "choice.toml").write_text(mine, encoding="utf-8")
    save.click()
    expect(page.locator("#state")).to_have_text("NOT DONE")
    expect(page.locator("#faults")).to_contain_text("do")
    assert (folder / "choice.toml").read_text(encoding="utf-8") == mine
    page.get_by_label("replace the file").check()
    save.click()
    expect(page.locator("#saved")).to_contain_text("choice.toml")
    expect(page.locator("#faults li")).to_have_count(0)
    assert "[[run]]" in (folder / "choice.toml").read_text(encoding="utf-8")
    page.get_by_label("Name of the file").fill("../elsewhere.toml")
    save.click()
    expect(page.locator("#faults li")).to_have_count(1)
    assert not (folder.parent / "elsewhere.toml").exists()
    page.get_by_role("button", name="Close").click()
    expect(page.locator("#state")).to_have_text("READY")


def as_named(route: Route) -> None:
    """Answer as the server does, its first cause named: of two runs nothing is, and only a name recommends a model."""
    answer = route.fetch()
    told = answer.json()
    if told.get("causes"):
        row = ["drawbar pull", "0.20", "734", "612", "error.dp.with_causes", "−140 … −90", "N"]
        told |= {"verdict": "named", "causes": told["causes"][:1]}
        told["cost"] = {"title": "With and without slip sinkage", "says": "what the wheel loses", "rows": [row]}
        change = ["tan φ of the soil", "0.31 ± 0.02", "0.25 ± 0.02", "−0.06", "yes", ""]
        told["since"] = {"says": "Against the report of Monday", "rows": [change]}
    route.fulfill(response=answer, json=told)


@pytest.fixture
def over(field_day: FieldDay) -> Iterator[Path]:
    """Return the file that ends a diagnosis; it is not there yet."""
    yield field_day.over
    field_day.over.unlink(missing_ok=True)


def test_a_diagnosis_says_its_sentence_and_its_candidates(page: Page, view: View, over: Path) -> None:
    page.route("**/api/diagnosis*", as_named)
    page.get_by_role("button", name="Diagnose").click()
    expect(page.get_by_role("button", name="Cancel: Diagnose")).to_be_visible()
    expect(page.locator("#verdict")).to_contain_text(
        re.compile(r"running, (just begun|\d+ % done(, about \d+ s left)?);")
    )
    over.touch()
    expect(page.locator("#error-table td").first).to_be_visible()
    told = view.get("/api/diagnosis?campaign=c1")
    expect(page.locator("#verdict")).to_have_attribute("title", told["sentence"])
    assert told["sentence"].startswith(page.locator("#verdict b").inner_text())
    expect(page.locator("#campaigns .hint").first).to_contain_text(f"· verdict: {told['words']}")
    unfold(page, "causes-box")
    names = page.locator("#candidates .name").all_inner_texts()
    assert names == [each["name"].replace("_", " ") for each in told["candidates"] if each["probability"] >= 0.01][:8]
    errors = [told["gain"]["held_out"][which]["channels"]["dp"]["R0"] for which in ("base", "extended")]
    keys = ["error.dp.calibrated_soil", "error.dp.with_causes"]
    figures = [page.locator(f"#error-table [data-key='{key}']") for key in keys]
    assert [float(one.get_attribute("data-value") or "nan") for one in figures] == errors
    assert [one.inner_text() for one in figures] == [told["figures"][key]["text"] for key in keys]
    for shown in page.locator("[data-key][data-value]").all():
        key = shown.get_attribute("data-key")
        assert key is not None and float(shown.get_attribute("data-value") or "nan") == told["figures"][key]["value"]
    figure = told["figures"]["error.dp.with_causes"]["text"]
    cells = page.locator("#cost-table tr").last.locator("th, td").all_inner_texts()
    assert [cell.split() for cell in cells[:4]] == [["drawbar", "pull", "(N)"], ["0.20"], ["734"], ["612"]]
    assert cells[4].split() == [figure, "−140", "…", "−90"]
    expect(page.locator("#cost-says")).to_contain_text("what the wheel loses")
    since = page.locator("#since-table tr").last.locator("th, td")
    expect(since).to_have_text(["tan φ of the soil", "0.31 ± 0.02", "0.25 ± 0.02", "−0.06beyond"])
    expect(page.locator("#since-says")).to_have_text("Against the report of Monday")
    expect(page.locator("#legend")).not_to_contain_text("recommended")
    page.get_by_role("button", name="Use this model").click()
    best = told["causes"][0]["parameters"][0]
    assert value_of(page, best["name"]) == pytest.approx(best["value"], rel=1e-4)
    assert value_of(page, "tan_phi") == pytest.approx(told["soils"][0]["values"]["tan_phi"], rel=1e-4)
    expect(page.locator("#legend")).to_contain_text("recommended")
    expect(page.locator("#state")).to_have_text("READY")
    assert view.campaigns()[0]["choice"]["effects"]


@pytest.mark.slow
def test_a_diagnosis_is_cancelled(page: Page, view: View) -> None:
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_role("button", name="Cancel: Diagnose").click()
    expect(page.get_by_role("button", name="Diagnose", exact=True)).to_be_visible()
    expect(page.locator("#verdict")).to_have_text("Not diagnosed: it was cancelled. Diagnose starts it again.")
    expect(page.locator("#state")).to_have_text("READY")
    assert view.campaigns()[0]["diagnosis"]["state"] == "none"


@pytest.mark.parametrize("widths", [(360, 390, 768), (1366,)])
def test_nothing_scrolls_sideways(browser: Browser, view: View, widths: tuple[int, ...]) -> None:
    with looking(browser, view.address, width=widths[0], height=844) as seen:
        drawn(seen, *ROWS)
        for width in widths:
            seen.set_viewport_size({"width": width, "height": 844})
            seen.wait_for_function(_FITS, arg=width)
