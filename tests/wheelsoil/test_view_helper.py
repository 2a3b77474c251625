"""The page's helper process: what it returns, how it fails, and that its end is nobody else's."""

from __future__ import annotations

import operator
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq import ConfigError, HardwareError
from daq.runs import open_runs
from model.progress import note_share
from wheelsoil.view.helper import Helper, HelperEndedError
from wheelsoil.workflows import known_soil

PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def helper() -> Iterator[Helper]:
    """Return one for all tests that leave its process alive."""
    one = Helper("test")
    yield one
    one.close()


@pytest.fixture
def mortal() -> Iterator[Helper]:
    """Return one whose process may be ended."""
    one = Helper("test")
    yield one
    one.close()


def test_it_is_another_process_and_stays_the_same(helper: Helper) -> None:
    first, second = (helper.ask(os.getpid).result(PATIENCE_S) for _ in range(2))
    assert first == second != os.getpid()


def test_a_job_says_how_far_it_is(helper: Helper) -> None:
    heard: list[float] = []
    helper.ask(note_share, 0.25, watch=heard.append).result(PATIENCE_S)
    helper.ask(note_share, 0.75).result(PATIENCE_S)
    assert heard == [0.25]


def test_our_errors_come_back_with_their_faults(helper: Helper) -> None:
    with pytest.raises(ConfigError, match="cheese") as caught:
        helper.ask(known_soil, "cheese", None).result(PATIENCE_S)
    assert "clay" in caught.value.faults[0].expected
    with pytest.raises(ConfigError) as several:
        helper.ask(open_runs, []).result(PATIENCE_S)
    assert several.value.faults[0].next_step


def test_the_systems_errors_name_their_file(helper: Helper, tmp_path: Path) -> None:
    with pytest.raises(HardwareError) as caught:
        helper.ask(os.listdir, tmp_path / "nowhere").result(PATIENCE_S)
    assert "nowhere" in caught.value.faults[0].where


def test_other_errors_come_back_and_cost_nothing_else(helper: Helper) -> None:
    pid = helper.ask(os.getpid).result(PATIENCE_S)
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        helper.ask(operator.truediv, 1, 0).result(PATIENCE_S)
    with pytest.raises(Exception, match="pickle"):
        helper.ask(lambda: 1).result(PATIENCE_S)
    assert helper.ask(os.getpid).result(PATIENCE_S) == pid


def test_what_cannot_come_back_is_an_error_and_not_the_end(helper: Helper) -> None:
    with pytest.raises(RuntimeError, match="pickle"):
        helper.ask(open, os.devnull).result(PATIENCE_S)
    assert helper.ask(abs, -1).result(PATIENCE_S) == 1


def test_after_its_death_there_is_another(mortal: Helper) -> None:
    first = mortal.ask(os.getpid).result(PATIENCE_S)
    with pytest.raises(HelperEndedError):
        mortal.ask(os.kill, first, signal.SIGKILL).result(PATIENCE_S)
    assert mortal.ask(os.getpid).result(PATIENCE_S) != first


def test_what_is_dropped_ends_and_what_waits_is_done(mortal: Helper) -> None:
    mortal.ask(os.getpid).result(PATIENCE_S)
    running, unwanted, waiting = mortal.ask(time.sleep, 600), mortal.ask(abs, -9), mortal.ask(abs, -2)
    while not running.running():
        time.sleep(0.01)
    mortal.drop(unwanted)
    mortal.drop(running)
    with pytest.raises(HelperEndedError):
        running.result(PATIENCE_S)
    assert unwanted.cancelled()
    assert waiting.result(PATIENCE_S) == 2
    mortal.drop(waiting)  # it is done
    assert mortal.ask(abs, -3).result(PATIENCE_S) == 3


def test_what_is_dropped_while_the_process_starts_is_not_done(mortal: Helper, tmp_path: Path) -> None:
    held = tmp_path / "held"
    os.mkfifo(held)
    asked = mortal.ask(_note, held, "text")  # it cannot be done before somebody reads
    while not asked.running():
        time.sleep(0.001)
    mortal.drop(asked)
    with pytest.raises(HelperEndedError):
        asked.result(PATIENCE_S)
    assert mortal.ask(abs, -3).result(PATIENCE_S) == 3


def test_what_is_urgent_goes_first(helper: Helper, tmp_path: Path) -> None:
    done, gate = tmp_path / "done", tmp_path / "gate"
    os.mkfifo(gate)
    helper.ask(_note, gate, "open")  # it is at this until somebody reads
    slow = [helper.ask(_note, done, text) for text in ("first", "second")]
    helper.ask(_note, done, "urgent", urgent=True)
    assert gate.read_text() == "open\n"
    slow[1].result(PATIENCE_S)
    assert done.read_text().split() == ["urgent", "first", "second"]


def test_its_end_leaves_nobody_waiting() -> None:
    helper = Helper("test")
    asked = [helper.ask(time.sleep, 600) for _ in range(3)]
    while not asked[0].running():
        time.sleep(0.01)
    helper.close()
    helper.close()  # once more does no harm
    for each in [*asked, helper.ask(abs, -1)]:
        with pytest.raises(HelperEndedError):
            each.result(PATIENCE_S)


def test_ctrl_c_is_not_for_it(helper: Helper) -> None:
    pid = helper.ask(os.getpid).result(PATIENCE_S)
    os.kill(pid, signal.SIGINT)
    assert helper.ask(os.getpid).result(PATIENCE_S) == pid


def _note(file: Path, text: str) -> None:
    with file.open("a") as out:
        out.write(f"{text}\n")
