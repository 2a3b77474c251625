"""The next run: which manoeuvre would part the candidates best."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp
from typing import Any

from model.diagnosis import NextRun
from wheelsoil.report.content import Section, Table, Text
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.words import listed, number
from wheelsoil.wording.names import plain_name

KEY = "next_run"
TITLE = "Next run"

_NOTE = (
    "Expected ln Bayes factor: by how many nats one such run is expected to favour the true candidate over the one "
    "that looks most like it. 1 is hardly anything, 3 is 20 to 1, 5 is 150 to 1. It counts noise only: beyond 1000 "
    "to 1 the limit is not the noise, but the errors of the models themselves."
)
_MOST = 1e3


def build(material: ReportInputs) -> Section:
    """Build the section."""
    runs = material.diagnosis.next_run
    if not runs:
        text = (
            "No run can be ranked: no candidate explains these runs. See where the simulation is off."
            if material.diagnosis.verdict == "unexplained"
            else "The verdict asks for no further run; --next-run ranks them all the same."
        )
        return Section(KEY, TITLE, [Text(text)], {})
    rows = [
        [
            run.change,
            listed([plain_name(name) for name in run.separates]),
            number(run.expected_log_bayes_factor),
            _told(_odds(run.expected_log_bayes_factor)),
        ]
        for run in runs
    ]
    head = ["what to do", "parts", "expected ln Bayes factor", "odds"]
    return Section(KEY, TITLE, [Table("Best first", head, rows, _NOTE, left=2)], _numbers(runs))


def _numbers(runs: Sequence[NextRun]) -> dict[str, Any]:
    return {"next_run": runs, "odds_to_1": [_odds(run.expected_log_bayes_factor) for run in runs]}


def _odds(nats: float) -> float:
    return exp(min(max(nats, 0.0), 50.0))


def _told(odds: float) -> str:
    return f"{number(odds, 2)} to 1" if odds < _MOST else "over 1000 to 1"
