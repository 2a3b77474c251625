"""What a terminal shows while a diagnosis runs; a pipe gets nothing of it."""

from __future__ import annotations

import io
import sys
import time

import pytest

from model.diagnosis import SHARE_BEFORE
from model.diagnosis.core.clock import Clock
from wheelsoil.console import diagnosing


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def work() -> None:
    clock = Clock()
    for stage in ("samples", "linearise", "noise", "linearise", "held_out"):
        with clock.stage(stage):
            time.sleep(0.12)  # longer than the bar waits between two drawings


def test_a_terminal_shows_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    with diagnosing():
        work()
    work()  # a bar that has ended hears of nothing
    assert "diagnosing" in shown.getvalue() and "00:0" in shown.getvalue()


def test_a_pipe_gets_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with diagnosing():
        work()
    assert capsys.readouterr() == ("", "")


def test_shares_grow_with_the_stages() -> None:
    shares = list(SHARE_BEFORE.values())
    assert shares == sorted(shares) and shares[0] > 0 and shares[-1] < 1
