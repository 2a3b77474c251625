"""A diagnosis as small HTML tables, for a notebook; `wheelsoil diagnose` and the report say more."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from daq.shown import html_paragraph, html_table, number, probability
from model.diagnosis.channel_words import FIELD_NAMES, FIELD_UNITS, NAMES, UNITS

if TYPE_CHECKING:
    from model.diagnosis.result import Cause, Diagnosis, Gain

_LEAST_SHOWN = 0.01
_MOST_FINDINGS = 6


def diagnosis_html(found: Diagnosis) -> str:
    """Return the verdict, the causes and where the simulation is off."""
    shown = [html_paragraph(found.sentence)]
    causes = [row for cause in found.causes for row in _cause(cause)]
    if causes:
        head = ["cause", "parameter", "probability", "value", "95 % interval", "unit"]
        shown.append(html_table(head, causes, left=2, caption=f"verdict: {_plain(found.verdict)}"))
    likely = [[_plain(c.name), probability(c.probability)] for c in found.candidates if c.probability >= _LEAST_SHOWN]
    if likely:
        shown.append(html_table(["candidate", "probability"], likely))
    wrong = [
        [
            FIELD_NAMES.get(w.channel, w.channel),
            w.where,
            f"{number(w.size, 3)} {FIELD_UNITS.get(w.channel, '')}",
            number(w.statistic, 3),
        ]
        for w in found.what_is_wrong[:_MOST_FINDINGS]
    ]
    if wrong:
        shown.append(html_table(["channel", "where the simulation is off", "by", "sigmas"], wrong, left=2))
    if found.gain is not None:
        rows = _gain(found.gain)
        head = ["on runs left out", "R0 base", "R0 extended", "unit"]
        shown.append(html_table(head, rows, caption=f"gain: {number(found.gain.log_likelihood_gain, 4)} nats"))
    if found.next_run:
        runs = [[run.change, number(run.expected_log_bayes_factor, 3)] for run in found.next_run]
        shown.append(html_table(["next run, best first", "expected ln Bayes factor"], runs))
    return "".join(shown)


def _gain(gain: Gain) -> list[list[str]]:
    return [
        [name, number(gain.base[key].R0), number(gain.extended[key].R0), UNITS[key]]
        for key, name in NAMES.items()
        if key in gain.base and key in gain.extended
    ]


def _cause(cause: Cause) -> list[list[str]]:
    name, sure = _plain(cause.name), probability(cause.probability)
    if not cause.parameters:
        return [[name, "", sure, "", "", ""]]
    rows = []
    for p in cause.parameters:
        low, high = p.interval95
        interval = f"{number(low, 3)} .. {number(high, 3)}" if isfinite(low) and isfinite(high) else "-"
        rows.append([name, p.name, sure, number(p.value, 3), interval, "" if p.unit == "1" else p.unit])
    return rows


def _plain(name: str) -> str:
    return name.replace("_", " ")
