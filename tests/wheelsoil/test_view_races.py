"""What happens on the analyst's page while something else is underway: nothing is lost, nothing is done for nobody."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from view_client import PATIENCE_S, Answer, View, taken_from
from view_in_process import ViewInProcess, viewing_here

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return taken_from(ROOT / "recordings" / "clay", tmp_path / "clay", 2)


@contextmanager
def fitting(view: View) -> Iterator[list[Answer]]:
    """A fit that is underway; its answer is there at the end."""
    found: list[Answer] = []
    thread = threading.Thread(target=lambda: found.append(view.tell("/api/fit", campaign="c1")))
    thread.start()
    time.sleep(0.2)  # nothing hangs on it: a fit that has not begun is to be treated alike
    yield found
    thread.join()


@pytest.mark.slow
def test_the_same_choice_sent_again_costs_no_fit_and_another_one_ends_it(folder: Path) -> None:
    choice = {"slip_threshold": 0.15, "effects": ["vasilev"]}
    with viewing_here(folder) as view:
        view.settled()
        view.post("/api/choose", campaign="c1", choice=choice)
        with fitting(view) as found:
            for _ in range(3):
                view.post("/api/choose", campaign="c1", choice=choice)
        assert found[0].status == 200 and "chosen" in found[0].json["models"]
        for before, after in ((0.15, 0.1), (0.1, 0.2)):
            with fitting(view) as found:
                view.post("/api/choose", campaign="c1", choice={"slip_threshold": after})
            [answer] = found
            if answer.status == 200:  # it came before the choice was changed, or began after it
                assert answer.json["slip_threshold"] in (before, after)
            else:
                assert answer.status == 409 and "changed in the meantime" in answer.faults[0]["what"]
        assert view.post("/api/fit", campaign="c1")["slip_threshold"] == 0.2


def test_a_helper_that_ends_once_costs_no_run(folder: Path) -> None:
    with viewing_here(folder) as view:
        end = time.monotonic() + PATIENCE_S
        while not _kill_helpers(view):
            assert time.monotonic() < end, "no helper is started"
            time.sleep(0.01)
        assert [run["state"] for run in view.settled()[0]["runs"]] == ["ready", "ready"]


def test_a_run_that_ends_every_helper_has_failed_and_may_be_tried_again(folder: Path) -> None:
    file, aside, choice = folder / "run-1.mcap", folder / "run-1.aside", {"cutoff_hz": 2.0}
    with viewing_here(folder) as view:
        view.settled()
        file.rename(aside)
        os.mkfifo(file)  # nobody writes into it: a helper that opens it waits until it is ended
        view.post("/api/choose", campaign="c1", choice=choice)
        end = time.monotonic() + PATIENCE_S
        while (run := view.campaigns()[0]["runs"][0])["state"] != "failed":
            assert time.monotonic() < end and run["state"] != "ready"
            _kill_helpers(view)
            time.sleep(0.02)
        answer = view.ask("GET", f"/api/run?campaign=c1&run={run['key']}")
        assert answer.status == 422 and "off and on again" in answer.faults[0]["next_step"]
        aside.replace(file)
        view.post("/api/choose", campaign="c1", choice=choice)
        assert [run["state"] for run in view.settled()[0]["runs"]] == ["ready", "ready"]


def _kill_helpers(view: ViewInProcess) -> int:
    """End the processes that the page has started, as a system does that is short of memory."""
    found = view.helpers()
    for child in found:
        with suppress(ProcessLookupError):  # helpers come and go
            os.kill(child, signal.SIGKILL)
    return len(found)
