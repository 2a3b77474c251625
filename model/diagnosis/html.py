"""A diagnosis as small HTML tables, for a notebook; `wheelsoil diagnose` and the report say more."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from daq.shown import html_paragraph, html_table, number

if TYPE_CHECKING:
    from model.diagnosis.result import Cause, Diagnosis

_LEAST_SHOWN = 0.01
_MOST_FINDINGS = 6
_UNITS = {"drawbar_pull": "N", "driving_torque": "N m", "sinkage": "m"}


def diagnosis_html(found: Diagnosis) -> str:
    """Return the verdict, the causes and where the simulation is off."""
    shown = [html_paragraph(found.sentence)]
    causes = [row for cause in found.causes for row in _cause(cause)]
    if causes:
        head = ["cause", "parameter", "probability", "value", "95 % interval", "unit"]
        shown.append(html_table(head, causes, left=2, caption=f"verdict: {_plain(found.verdict)}"))
    likely = [[_plain(c.name), f"{c.probability:.3f}"] for c in found.candidates if c.probability >= _LEAST_SHOWN]
    if likely:
        shown.append(html_table(["candidate", "probability"], likely))
    wrong = [
        [_plain(w.channel), w.where, f"{number(w.size, 3)} {_UNITS.get(w.channel, '')}", number(w.statistic, 3)]
        for w in found.what_is_wrong[:_MOST_FINDINGS]
    ]
    if wrong:
        shown.append(html_table(["channel", "where the simulation is off", "by", "sigmas"], wrong, left=2))
    return "".join(shown)


def _cause(cause: Cause) -> list[list[str]]:
    name, probability = _plain(cause.name), f"{cause.probability:.3f}"
    if not cause.parameters:
        return [[name, "", probability, "", "", ""]]
    rows = []
    for p in cause.parameters:
        low, high = p.interval95
        interval = f"{number(low, 3)} .. {number(high, 3)}" if isfinite(low) and isfinite(high) else "-"
        rows.append([name, p.name, probability, number(p.value, 3), interval, "" if p.unit == "1" else p.unit])
    return rows


def _plain(name: str) -> str:
    return name.replace("_", " ")
