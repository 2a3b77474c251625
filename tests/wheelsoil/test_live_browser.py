"""The status page in a real browser, shown snapshots of a sample drive."""

from __future__ import annotations

import os
import re
import signal
from typing import Any

from live_browser import Shower, looking_at
from live_client import page, until
from live_support import START_UTC_S, bus, reason
from playwright.sync_api import Browser, Page, expect

from daq.logger import Command
from wheelsoil.live import PagePanel

STUCK = reason(
    "amber", "signal_stuck", "can0: WFT_Forces.Fx", "has stood at 3104 N for 6.2 s.", "check the transducer's plug"
)
LOST = reason("red", "counter_jump", "can0: WFT_Forces", "214 frames were lost in 10 s.", "check the cable of can0")
DOWN = bus("can1", 20.0, state="down", level="red", rate_hz=None, load_percent=None, age_s=None, kernel_drops=None)
STATES: dict[str, dict[str, Any]] = {
    "green": {},
    "amber": {"level": "amber", "reasons": [STUCK]},
    "red": {
        "level": "red",
        "reasons": [LOST, STUCK],
        "buses": [bus("can0", 20.0, kernel_drops=17, level="red"), DOWN | {"detail": "Network is down"}],
        "losses": {"kernel.can0": 17, "counter.can0.WFT_Forces": 214, "wrapped.can0.WFT_Forces": 1},
        "remarks": ["can0: the kernel gave a receive buffer of 208 kB instead of 8192 kB"],
        "gnss": {"fix": False, "age_s": 21.0, "level": "amber"},
        "clock": {"steps": 2, "offset_s": None, "drift_ppm": None, "residual_s": None},
    },
    "between": {"state": "between", "gnss": None, "cpu_percent": None},
}
LEAVE = {
    "green": "✓ Good to leave: slip has reached",
    "amber": "▲ Leave only after a look at: 1 amber.",
    "red": "▲ Not good to leave yet: 1 red; 231 lost frames.",
}
_CONTRAST = """(element) => {
  const part = (c) => ((c /= 255), c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  const weights = [0.2126, 0.7152, 0.0722];
  const light = (css) => css.match(/\\d+/g).slice(0, 3).reduce((sum, c, i) => sum + part(Number(c)) * weights[i], 0);
  const style = getComputedStyle(element), [a, b] = [light(style.color), light(style.backgroundColor)];
  return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
}"""
_TIMED_OUT_SOON = """() => {
  const timeout = AbortSignal.timeout.bind(AbortSignal);
  AbortSignal.timeout = () => (window.timedOut = timeout(100));
}"""


def test_the_state_is_said_in_words_with_what_to_do(browser: Browser, panel: PagePanel) -> None:
    with Shower(panel) as shower, looking_at(browser, panel.address) as seen:
        for state, changes in STATES.items():
            shower.changes = changes
            level = "green" if state == "between" else state
            expect(seen.locator("#level")).to_contain_text(level.upper())
            expect(seen.locator("#state")).to_have_text("BETWEEN RUNS" if state == "between" else "RECORDING")
            expect(seen.locator("#spoken")).to_contain_text(level)
            assert seen.locator("#band").evaluate(_CONTRAST) > 7
            leave = seen.locator("#leave")
            expect(leave).to_contain_text(LEAVE[state]) if state in LEAVE else expect(leave).to_be_hidden()
            reasons = changes.get("reasons", [])
            expect(seen.locator("#reasons li")).to_have_count(max(len(reasons) - 1, 0))
            for each in reasons[:1]:  # the worst one stands in the band, and only there
                expect(seen.locator("#headline")).to_contain_text(f"{each['where']}: {each['what']}")
                expect(seen.locator("#do")).to_contain_text(each["next_step"])
            for item, each in zip(seen.locator("#reasons li").all(), reasons[1:], strict=True):
                for words in (each["level"].upper(), each["where"], each["what"], each["next_step"]):
                    expect(item).to_contain_text(words)
            for width in (360, 390, 1280):
                seen.set_viewport_size({"width": width, "height": 800})
                assert seen.evaluate("document.documentElement.scrollWidth") == width


def test_slip_pull_and_load_stand_below_the_band_also_when_it_is_red(browser: Browser, panel: PagePanel) -> None:
    with Shower(panel, **STATES["red"]), looking_at(browser, panel.address) as seen:
        expect(seen.locator("#level")).to_contain_text("RED")
        expect(seen.locator("#do")).to_contain_text(LOST["next_step"])
        for width, height in ((390, 844), (360, 640), (844, 390)):
            seen.set_viewport_size({"width": width, "height": height})
            bar = seen.locator("#bar").bounding_box()
            for role in ("slip", "drawbar_pull", "vertical_load"):
                box = seen.locator(f"#values [data-role={role}] .number").bounding_box()
                assert box["y"] > 0 and box["y"] + box["height"] <= height, (role, width)
                beside = width > height and box["x"] + box["width"] <= bar["x"]
                assert beside or box["y"] + box["height"] <= bar["y"], (role, width)
        assert not seen.locator("#run").is_visible(), "details are closed"
        mark, stop = (
            seen.locator(f"#{name}").evaluate("(b) => getComputedStyle(b).backgroundColor") for name in ("mark", "stop")
        )
        assert mark != stop, "Stop is secondary"


def test_the_unit_of_the_speed_is_kept(browser: Browser, panel: PagePanel) -> None:
    speed = "#values [data-role=ground_speed] .number"
    with Shower(panel) as shower, looking_at(browser, panel.address) as seen:
        expect(seen.locator(speed)).to_contain_text("m/s")
        seen.get_by_role("button", name="km/h").click()
        expect(seen.locator(speed)).to_contain_text("km/h")
        for unit, value, shown in (("kt", 10.0, "18.5 km/h"), ("MPH", 10.0, "16.1 km/h"), ("rad/s", 3.0, "3.00 rad/s")):
            sent = {"role": "ground_speed", "name": "v", "value": value, "unit": unit, "age_s": 0.1, "level": "green"}
            shower.changes = {"values": [sent]}
            expect(seen.locator(speed)).to_have_text(shown)
        shower.changes = {}
        seen.reload()
        expect(seen.locator(speed)).to_contain_text("km/h")
        seen.get_by_role("button", name="m/s").click()


def test_its_buttons_are_large(browser: Browser, panel: PagePanel) -> None:
    with Shower(panel), looking_at(browser, panel.address, width=360, scale=2.0) as seen:
        expect(seen.locator("#state")).to_have_text("RECORDING")
        for button in seen.locator("#bar button, #bar input").all():
            box = button.bounding_box()
            assert box is not None and min(box["width"], box["height"]) >= 48


def test_live_values_buses_and_curves_move(browser: Browser) -> None:
    with page() as panel, Shower(panel) as shower, looking_at(browser, panel.address, scale=2.0) as seen:
        expect(seen.locator("#values")).to_contain_text("drawbar pull")
        expect(seen.locator("#buses")).to_contain_text("can0")
        expect(seen.locator("#slip-plot")).to_have_attribute("aria-label", re.compile(r"[1-9]\d+ points, newest"))
        frames = seen.locator("#run div").nth(1)
        first = frames.text_content()
        seen.wait_for_function("(first) => document.querySelectorAll('#run div')[1].textContent !== first", arg=first)
        for curve in ("#slip-plot .dot", "#pull-plot .line"):
            expect(seen.locator(curve).last).to_have_attribute("d", re.compile("^M.*M|^M.*L"))
        shower.changes = {"session_s": 55.0, "traces": {}}
        expect(seen.locator("#values [data-role=slip] .age")).to_contain_text("not known for")
        expect(seen.locator("#values [data-role=slip] .reach")).to_have_text("")


def test_without_news_it_is_neither_green_nor_red(browser: Browser) -> None:
    with page() as panel, looking_at(browser, panel.address, clock=True) as seen:
        expect(seen.locator("#headline")).to_contain_text("no news from the logger yet")
        with Shower(panel):
            expect(seen.locator("#state")).to_have_text("RECORDING")
            expect(seen.locator("#mark")).to_be_enabled()
        seen.clock.fast_forward("00:04")
        expect(seen.locator("#headline")).to_contain_text("no news from the logger for")
        expect(seen.locator("#band")).to_have_attribute("data-level", "none")
        expect(seen.locator("#mark")).to_be_disabled()
        assert panel.pid is not None
        os.kill(panel.pid, signal.SIGSTOP)
        seen.clock.fast_forward("00:05")
        expect(seen.locator("#state")).to_have_text("NO CONNECTION")
        os.kill(panel.pid, signal.SIGCONT)
        with Shower(panel):
            expect(seen.locator("#state")).to_have_text("RECORDING")
        panel.close()
        expect(seen.locator("#state")).to_have_text("LOGGER ENDED")


def test_a_recording_that_the_disk_has_ended_stays_red(browser: Browser) -> None:
    what, step = "recording has ended: the recording cannot be written on (Read-only file system)", "change the disk"
    failed = reason("red", "disk_failed", "disk", what, step)
    with page() as panel, looking_at(browser, panel.address) as seen:
        with Shower(panel, state="stopping", level="red", reasons=[failed, STUCK]):
            expect(seen.locator("#headline")).to_contain_text(what)
        panel.close()
        expect(seen.locator("#state")).to_have_text("LOGGER ENDED")
        expect(seen.locator("#level")).to_contain_text("RED")
        expect(seen.locator("#headline")).to_contain_text(what)
        expect(seen.locator("#do")).to_contain_text(step)
        expect(seen.locator("#reasons li")).to_have_count(1)


def test_lost_frames_are_no_good_run_and_a_vehicle_without_slip_has_no_goal(browser: Browser) -> None:
    with (
        page() as panel,
        Shower(panel, losses={"counter.can0.WFT": 3}) as shower,
        looking_at(browser, panel.address) as seen,
    ):
        expect(seen.locator("#leave")).to_have_text("▲ Leave only after a look at: 3 lost frames.")
        shower.changes = {"setup": {"wheel_radius_m": None, "latency_s": {}, "min_speed_mps": 0.5}}
        expect(seen.locator("#leave")).to_be_hidden()
        seen.get_by_role("button", name="Stop run").first.click()
        expect(seen.locator("#stop-hint")).to_have_text("Nothing is wrong; the slip is not known.")
        seen.get_by_role("button", name="Go on").click()


def test_a_goal_that_is_nearly_reached_does_not_read_as_reached(browser: Browser) -> None:
    time_s = [round(0.05 * k, 2) for k in range(40)]
    values = {"drawbar_pull": 900.0, "wheel_speed": 4.0, "ground_speed": 4.0 * 0.5 * (1 - 0.496)}
    traces = {role: {"time_s": time_s, "value": [value] * 40} for role, value in values.items()}
    setup = {"wheel_radius_m": 0.5, "latency_s": {}, "min_speed_mps": 0.5}
    with page() as panel, Shower(panel, traces=traces, setup=setup), looking_at(browser, panel.address) as seen:
        reached = "slip has reached 49 %, the goal is at least 50 %"
        expect(seen.locator("#leave")).to_have_text(f"▲ Not good to leave yet: {reached}.")


def test_a_mark_is_reported_when_sent_and_when_it_stands_in_the_file(browser: Browser, panel: PagePanel) -> None:
    with Shower(panel) as shower, looking_at(browser, panel.address) as seen:
        _press_mark(seen, "left rut")
        expect(seen.locator("#feedback")).to_contain_text("was sent")
        assert until(panel.commands, "the mark") == [Command("mark", "left rut")]
        shower.changes = {"marks": [{"time_utc_s": START_UTC_S + 21, "text": "left rut"}]}
        expect(seen.locator("#feedback")).to_contain_text("stands in the file")
        expect(seen.locator("#marks li")).to_contain_text("left rut")
        expect(seen.locator("#note")).to_have_value("")


def test_a_mark_that_nobody_takes_is_reported_too(browser: Browser, panel: PagePanel) -> None:
    with Shower(panel), looking_at(browser, panel.address, clock=True) as seen:
        _press_mark(seen, "")
        expect(seen.locator("#feedback")).to_contain_text("was sent")
        seen.clock.fast_forward("00:06")
        expect(seen.locator("#feedback")).to_contain_text("has not confirmed it")


def test_a_mark_whose_answer_is_lost_is_confirmed_by_the_file(browser: Browser, panel: PagePanel) -> None:
    """The page was too slow to answer: that does not mean that nothing was sent."""
    with Shower(panel) as shower, looking_at(browser, panel.address, clock=True) as seen:
        seen.route("**/command", lambda _: None)
        seen.evaluate(_TIMED_OUT_SOON)
        _press_mark(seen, "left rut")
        expect(seen.locator("#feedback")).to_contain_text("is being sent")
        until(lambda: seen.evaluate("() => window.timedOut.aborted"), "the end of the page's patience")
        seen.clock.fast_forward("00:06")
        expect(seen.locator("#feedback")).to_contain_text("has not confirmed it")
        shower.changes = {"marks": [{"time_utc_s": START_UTC_S + 21, "text": "left rut"}]}
        expect(seen.locator("#feedback")).to_contain_text("stands in the file")


def test_a_run_is_started_by_name_and_stopped_after_a_question(browser: Browser, panel: PagePanel) -> None:
    with Shower(panel) as shower, looking_at(browser, panel.address) as seen:
        stop, start = seen.get_by_role("button", name="Stop run"), seen.get_by_role("button", name="Start run")
        expect(stop.first).to_be_enabled()
        stop.first.click()
        seen.get_by_role("button", name="Go on").click()
        start.first.click()
        expect(seen.locator("#run-name")).to_have_value("clay-out-4")
        seen.get_by_role("button", name="Cancel").click()
        stop.first.click()
        seen.locator("#stop-dialog").get_by_role("button", name="Stop run").click()
        assert until(panel.commands, "the stop") == [Command("stop")]
        shower.changes = {"state": "between"}
        expect(seen.locator("#feedback")).to_contain_text("The run has ended")
        expect(stop.first).to_be_disabled()
        start.first.click()
        seen.locator("#run-name").fill("second field")
        seen.locator("#start-dialog").get_by_role("button", name="Start run").click()
        assert until(panel.commands, "the start") == [Command("start", "second field")]


def test_nothing_is_shown_without_the_token_and_all_with_it(browser: Browser) -> None:
    with page(token="token-of-a-test") as panel, Shower(panel):
        with looking_at(browser, panel.address.partition("#")[0]) as seen:
            expect(seen.locator("#state")).to_have_text("TOKEN NEEDED")
            expect(seen.locator("#main")).to_be_hidden()
            seen.get_by_label("token").fill("wrong")
            seen.get_by_role("button", name="Open").click()
            expect(seen.locator("#state")).to_have_text("WRONG TOKEN")
            seen.get_by_label("token").fill("token-of-a-test")
            seen.get_by_role("button", name="Open").click()
            expect(seen.locator("#state")).to_have_text("RECORDING")
        with looking_at(browser, panel.address) as seen:
            expect(seen.locator("#state")).to_have_text("RECORDING")
            _press_mark(seen, "")
            assert until(panel.commands, "the mark") == [Command("mark")]


def test_names_from_data_are_text(browser: Browser, panel: PagePanel) -> None:
    name = "<img src=x onerror=document.body.remove()>"
    changes = {"vehicle": name, "remarks": [name], "reasons": [STUCK, STUCK | {"what": name}]}
    with Shower(panel, **changes), looking_at(browser, panel.address) as seen:
        for place in ("#run-title", "#remarks", "#reasons"):
            expect(seen.locator(place)).to_contain_text(name)
        expect(seen.locator("img")).to_have_count(0)


def test_a_plot_that_has_nothing_to_show_says_why(browser: Browser) -> None:
    changes = {"setup": {"wheel_radius_m": None, "latency_s": {}, "min_speed_mps": 0.5}}
    with page() as panel, Shower(panel, **changes), looking_at(browser, panel.address) as seen:
        expect(seen.locator("#slip-plot")).to_have_attribute("aria-label", re.compile("0 points"))
        expect(seen.locator("#slip-plot p")).to_have_text("no slip: vehicle.toml has no [wheel] radius_m")
        expect(seen.locator("#pull-plot")).to_have_attribute("aria-label", re.compile("newest"))


def _press_mark(seen: Page, note: str) -> None:
    seen.get_by_label("Note").fill(note)
    seen.get_by_role("button", name="Mark").click()
