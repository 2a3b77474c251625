"""What the axes of the analyst's page hold, and where the values at the cursor stand."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page, expect
from view_browser import curve_line, drawn
from view_client import View

ROWS = ("slip", "speed", "pull")


def driven(view: View, run: str, *, used: bool) -> list[tuple[float, float]]:
    """Slip and pull of a run's driven samples, of the used or of the excluded ones."""
    data = view.get(f"/api/run?campaign=c1&run={run}")
    rows = zip(data["slip"], data["drawbar_pull_n"], data["used"], strict=True)
    return [(slip, pull) for slip, pull, kept in rows if kept == used and None not in (slip, pull) and slip > 0]


def inside(limits: dict[str, Any], slip: float, pull: float) -> bool:
    (left, right), (low, high) = limits["x"], limits["y"]
    return bool(left <= slip <= right and low <= pull <= high)


def test_the_cross_plot_holds_every_sample_of_all_runs_or_counts_it(page: Page, view: View) -> None:
    script = "async () => (await import('/cross.js')).figureOfCross().limits"
    samples = {used: [s for run in ("r1", "r2") for s in driven(view, run, used=used)] for used in (True, False)}
    most = max(slip for slip, _ in samples[True])
    page.locator(curve_line("model")).wait_for(state="attached")
    page.wait_for_function(f"async (slip) => (await ({script})()).x[1] >= slip", arg=most)  # all runs are drawn
    with_out = page.evaluate(script)
    assert len(samples[True]) > 100 and all(inside(with_out, *sample) for sample in samples[True])
    beyond = [sample for sample in samples[False] if not inside(with_out, *sample)]
    assert with_out["beyond"] == len(beyond)
    page.locator("#samples-box > summary").click()
    page.locator("#show-left-out").uncheck()
    expect(page.locator("#cross .samples.out")).to_have_count(0)
    used_only = page.evaluate(script)
    assert all(inside(used_only, *sample) for sample in samples[True]) and used_only["beyond"] == 0
    (_, right), (low, high) = used_only["x"], used_only["y"]
    assert right < 1.04 * most
    assert high - low <= with_out["y"][1] - with_out["y"][0]


def test_the_values_at_the_cursor_stand_inside_their_rows(page: Page) -> None:
    drawn(page, *ROWS)
    page.keyboard.press("ArrowRight")
    box, grid = (page.locator(place).first.bounding_box() for place in ("#rows", "#rows .row .grid"))
    assert box is not None and grid is not None and grid["width"] > box["width"] - 80
    for value in page.locator("[data-row='speed'] .number").all():
        place = value.bounding_box()
        assert place is not None and place["width"] > 0
        assert grid["x"] < place["x"] and place["x"] + place["width"] <= grid["x"] + grid["width"] + 1
    expect(page.locator("[data-row='speed'] .label")).to_have_text(["rim", "ground"])
