"""What differs between two diagnoses, in sentences and table rows: the report's and the analyst's page's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from wheelsoil.wording.names import SOIL_LETTERS, letter, listed, plain_name, upper
from wheelsoil.wording.numbers import number, signed
from wheelsoil.workflows.last_report import Change, LastReport

CHANGE_HEAD = ("quantity", "last time", "now", "difference", "beyond the intervals", "unit")
_NAMES = {
    "pull_at_slip_0.2": "pull at slip 0.2",
    "usable_share": "usable share of the samples in motion",
    "used_share": "used share of all samples",
}


def change_summary(last: LastReport, changes: Sequence[Change], subject: Mapping[str, str]) -> str:
    """Return how many quantities differ beyond their intervals, and what became of the first three.

    First that they are of different things where vehicle, wheel or soil, the `subject`, is another than last time.
    """
    beyond = [change for change in changes if change.beyond]
    when = f"the {last.kind} of {last.made_at[:10]} ({last.name})"
    summary = f"Against {when}: {len(beyond)} of {len(changes)} quantities differ beyond their intervals."
    others = [name for name in last.subject if subject.get(name, "") not in ("", last.subject[name])]
    if others:
        each = listed([f"{name} {last.subject[name]}, not {subject[name]}" for name in sorted(others)])
        summary = f"Not the same thing: the last {last.kind} is of {each}. {summary}"
    return f"{summary} {upper(listed([_sentence(change) for change in beyond[:3]]))}." if beyond else summary


def _sentence(change: Change) -> str:
    if not isfinite(change.last):
        return f"{_name(change)} had no value last time"
    if not isfinite(change.now):
        return f"{_name(change)} has no value this time"
    return f"{_name(change)} went from {number(change.last)} to {number(change.now)} {change.unit}".rstrip()


def change_row(change: Change) -> list[str]:
    """Return a quantity with the columns of `CHANGE_HEAD`."""
    halves = [f" ± {number(half, 2)}" if isfinite(half) else "" for half in (change.last_half95, change.now_half95)]
    difference = _difference(change.difference) if isfinite(change.difference) else "–"
    verdict = "yes" if change.beyond else "no" if any(halves) else "no interval"
    values = [number(change.last) + halves[0], number(change.now) + halves[1]]
    return [_name(change), *values, difference, verdict, change.unit]


def _difference(value: float) -> str:
    return signed(value, "+.3g") if abs(value) < 999.5 else signed(value, "+,.0f").replace(",", "\u202f")


def _name(change: Change) -> str:
    if change.name in _NAMES:
        return _NAMES[change.name]
    first, _, last = change.name.partition(".")
    if change.kind == "soil":
        campaign, _, name = change.name.rpartition(".")
        return f"{SOIL_LETTERS.get(name, name)} of the soil" + (f" in {campaign}" if campaign != "soil" else "")
    if change.kind == "cause":
        return f"{plain_name(first)}, {letter(last)}"
    channel = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}[last.split(".")[0]]
    return f"error of {channel} on held-out runs, calibrated soil"
