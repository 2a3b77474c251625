"""The real logger on a network bus, watched and led from a browser: what the page says is so, and in the file."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from live_browser import chromium, looking_at
from live_client import until
from playwright.sync_api import Page, expect

from daq.recording import Recording

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "recordings" / "clay"
CYCLE = re.compile(r'(BA_ "GenMsgCycleTime" BO_ \d+) 1;')

USUAL_IS_KNOWN = re.compile(r"00:[1-5]\d|0[1-9]:\d\d")
"""The run's duration from 10 s on: a signal that never changed cannot be seen to freeze."""


@pytest.mark.slow
def test_a_live_run_is_shown_led_and_recorded(tmp_path: Path) -> None:
    channel = f"239.{os.getpid() % 200 + 20}.163.7"
    out = tmp_path / "out"
    with _vehicle(channel) as tell, _logger(_configuration(tmp_path, channel), out) as (logger, address):
        with chromium() as browser, looking_at(browser, address) as page:
            expect(page.locator("#state")).to_have_text("RECORDING")
            _is_live(page)
            expect(page.locator("#level")).to_contain_text("GREEN")
            _mark(page, "gate 7")

            expect(page.locator("#headline")).to_contain_text(USUAL_IS_KNOWN)
            tell("freeze")
            _says(page, "AMBER", "WFT_Forces.F")
            tell("well")
            for place in ("#headline", "#reasons"):
                expect(page.locator(place)).not_to_contain_text("WFT_Forces.F")

            tell("drop")
            _says(page, "RED", "WFT_Forces")
            expect(page.locator("#losses")).to_contain_text("rolling counter")
            tell("well")

            [killed] = _page_processes(logger.pid)
            os.kill(killed, signal.SIGKILL)
            until(lambda: set(_page_processes(logger.pid)) - {killed}, "the page's next process")
            _is_live(page)

            page.get_by_role("button", name="Stop run").first.click()
            page.locator("#stop-dialog").get_by_role("button", name="Stop run").click()
            expect(page.locator("#state")).to_have_text("BETWEEN RUNS")
            expect(page.locator("#feedback")).to_contain_text("The run has ended")
            page.get_by_role("button", name="Start run").first.click()
            page.locator("#run-name").fill("second")
            page.locator("#start-dialog").get_by_role("button", name="Start run").click()
            expect(page.locator("#feedback")).to_contain_text("Run second is being recorded")
            _mark(page, "")

            logger.send_signal(signal.SIGINT)
            expect(page.locator("#state")).to_have_text("LOGGER ENDED")
        assert logger.wait() == 130
    first, second = Recording.open(out / "first.mcap"), Recording.open(out / "second.mcap")
    assert [event.text for event in first.events() if event.name == "mark"] == ["gate 7"]
    assert len([event for event in second.events() if event.name == "mark"]) == 1
    losses = first.metadata["losses"]
    assert [int(lost) for name, lost in losses.items() if name.startswith("counter") and "WFT_Forces" in name] > [0]
    assert sum(first.frame_counts.values()) > 1000
    assert list((out / "between").glob("*.mcap"))


def _is_live(page: Page) -> None:
    """Frames grow, values change, and both curves are drawn."""
    for place in ("#run div:nth-child(2) dd", "#values li:nth-child(2) .number", "#values li:nth-child(5) .number"):
        before = page.locator(place).text_content()
        page.wait_for_function(
            "([place, text]) => document.querySelector(place).textContent !== text", arg=[place, before]
        )
    expect(page.locator("#slip-plot")).to_have_attribute("aria-label", re.compile(r"[1-9]\d+ points"))
    expect(page.locator("#values li").first).to_contain_text(re.compile(r"slip\s*[−\d]"))


def _mark(page: Page, note: str) -> None:
    page.get_by_label("Note").fill(note)
    page.get_by_role("button", name="Mark").click()
    expect(page.locator("#feedback")).to_contain_text("stands in the file")


def _says(page: Page, level: str, where: str) -> None:
    """The worst reason stands in the band, the others in the list: which is the worst is the machine's timing."""
    said = page.locator("#band, #reasons li", has_text=level).filter(has_text=where)
    expect(said.first).to_contain_text("Do: ")


def _configuration(folder: Path, channel: str) -> Path:
    """The sample vehicle on that bus, with DBCs that say how fast it sends there."""
    for name in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc"):
        text = (SAMPLE / name).read_text(encoding="utf-8")
        text = CYCLE.sub(r"\1 20;", text).replace("BO_ 464 10;", "BO_ 464 20;")
        (folder / name).write_text(text, encoding="utf-8")
    text = (SAMPLE / "vehicle.toml").read_text(encoding="utf-8")
    text = text.replace('channel = "can0"', f'channel = "{channel}"\ninterface = "udp_multicast"')
    (folder / "vehicle.toml").write_text(text, encoding="utf-8")
    return folder / "vehicle.toml"


def _page_processes(logger: int) -> list[int]:
    children = [path.read_text().split() for path in Path(f"/proc/{logger}/task").glob("*/children")]
    return [int(pid) for each in children for pid in each]


@contextmanager
def _vehicle(channel: str) -> Iterator[object]:
    """A process that sends on the bus; yields what tells it how."""
    script = [sys.executable, ROOT / "tests" / "live_sender.py", channel]
    with subprocess.Popen(script, stdin=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None

        def tell(what: str) -> None:
            process.stdin.write(f"{what}\n")
            process.stdin.flush()

        yield tell
        process.stdin.close()
        assert process.wait() == 0


@contextmanager
def _logger(vehicle: Path, out: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``wheelsoil log`` and its page's address."""
    program = shutil.which("wheelsoil", path=str(Path(sys.executable).parent))
    assert program is not None
    command = [program, "log", vehicle, "--out", out, "--run-id", "first", "--page-port", "0"]
    told = out.parent / "stderr.txt"
    with (
        told.open("w") as stderr,
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stderr, text=True) as process,
    ):
        try:
            found = until(lambda: re.search(r"status page: (\S+)", told.read_text()), "the page's address")
            assert found is not None
            yield process, found[1]
        finally:
            process.kill()
            print(told.read_text())
