"""What a terminal shows while something long runs; a pipe gets nothing of it."""

from __future__ import annotations

import io
import os
import sys
import time
from pathlib import Path

import pytest

from model import in_parallel, processes, watched
from model.diagnosis.core.clock import OF_RUNS, OF_TABLES, Clock
from model.progress import counted, note_share
from wheelsoil.console import computing, counting


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    return shown


def work() -> None:
    clock = Clock()
    for stage in ("samples", "linearise", "noise", "linearise", "held_out"):
        with clock.stage(stage):
            time.sleep(0.12)  # longer than the bar waits between two drawings


def test_a_terminal_shows_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with computing("diagnosing"):
        work()
    work()  # a bar that has ended hears of nothing
    assert "diagnosing" in terminal.getvalue() and "00:0" in terminal.getvalue()


def test_a_terminal_shows_what_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with counting("reading run {1} [bold].mcap", "frames") as watch:  # a file may be called so
        assert watch
        for i in range(1, 5):
            watch(1000 * i, 0.2 * i)
            time.sleep(0.12)
    shown = terminal.getvalue()
    assert "run {1} [bold].mcap" in shown and "3,000 frames" in shown and "00:0" in shown


def test_a_pipe_gets_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with computing("diagnosing"):
        work()
    with counting("importing", "frames") as watch:
        assert watch is None
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("stages", [OF_RUNS, OF_TABLES])
def test_shares_grow_with_the_stages(stages: dict[str, float]) -> None:
    shares = list(stages.values())
    assert shares == sorted(shares) and shares[0] > 0 and shares[-1] < 1


def test_copies_of_the_process_are_not_watched(tmp_path: Path) -> None:
    """What a copy calls would be lost with its memory: a file has it."""
    heard, mine = tmp_path / "heard", os.getpid()

    def watch(share: float) -> None:
        with heard.open("a") as file:
            file.write(f"{share:.1f} ")

    def work(share: float) -> None:
        time.sleep(0.02)
        if os.getpid() != mine:
            note_share(share)

    with watched(watch), processes(2):
        list(counted(in_parallel(work, [0.1, 0.2, 0.3]), 3, 0.5, 0.8))
    assert heard.read_text().split() == ["0.6", "0.7", "0.8"]
