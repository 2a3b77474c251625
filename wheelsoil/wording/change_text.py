"""What differs between two diagnoses, in sentences and table rows: the report's and the analyst's page's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import isfinite, nan

from daq import OUTPUTS
from wheelsoil.wording.names import SOIL_LETTERS, letter, listed, plain_name, soil_unit, upper
from wheelsoil.wording.numbers import measured, number, signed
from wheelsoil.wording.numbers import unit as unit_text
from wheelsoil.workflows.key_figures import Z95
from wheelsoil.workflows.last_report import Change, LastReport

_MOST_SAID = 3
CHANGE_HEAD = ("quantity", "last time", "now", "difference", "beyond the intervals", "unit")
_NAMES = {
    ("pull_at_slip_0.2",): "pull at slip 0.2",
    ("usable_share",): "usable share of the samples in motion",
    ("used_share",): "used share of all samples",
}


def change_summary(last: LastReport, changes: Sequence[Change], subject: Mapping[str, str]) -> str:
    """Return in a sentence what differs beyond the intervals, with both values, and then what it is compared with.

    First that they are of different things where vehicle, wheel or soil, the `subject`, is another than last time.
    """
    beyond = [change for change in changes if change.beyond]
    judged = sum(
        change.beyond or (not change.undiagnosed and any(map(isfinite, (change.last_half95, change.now_half95))))
        for change in changes
    )
    rest = judged - len(beyond)
    if differences := differing(changes):
        summary = f"{upper(differences)}."
        summary += f" The other {rest} quantities with an interval do not differ beyond it." if rest > 1 else ""
    else:
        summary = f"Nothing differs beyond the intervals ({rest} quantities with an interval)."
    for when in {change.undiagnosed for change in changes} - {""}:
        summary += f" Not diagnosed {when}: causes are not compared."
    summary += f" Last time: {', '.join(filter(None, (last.title, _when(last))))} ({last.kind} {last.name})."
    return of_the_same(summary, of_another_thing(last, subject))


def of_the_same(text: str, other: str) -> str:
    """Return a text of what differs behind what `of_another_thing` says; the text alone where it says nothing."""
    return f"Not the same thing: {other}. {text}" if other else text


def of_another_thing(last: LastReport, subject: Mapping[str, str]) -> str:
    """Return of which other vehicle, wheel, transducer or soil the last report is, within a sentence; "" of none."""
    others = sorted(name for name in last.subject if subject.get(name, "") not in ("", last.subject[name]))
    each = [f"{name} {last.subject[name]}, not {subject[name]}" for name in others]
    wheels = [of.get("wheel", "") for of in (last.subject, subject)]
    if last.subject.get("vehicle") and subject and wheels.count("") == 1:
        each.append(", not ".join(f"wheel {wheel}" if wheel else "a wheel without an id" for wheel in wheels))
    return f"the last {last.kind} is of {'; '.join(each)}" if each else ""


def differing(changes: Sequence[Change]) -> str:
    """Return what differs beyond the intervals, as it reads within a sentence; empty where nothing does."""
    sentences = list(_sentences([_as_pages_write(change) for change in changes if change.beyond]))
    more = [f"{len(sentences) - _MOST_SAID} more (see the table)"] if len(sentences) > _MOST_SAID else []
    return listed(sentences[:_MOST_SAID] + more)


def _when(last: LastReport) -> str:
    if last.driven:
        return f"driven {last.driven}"
    return f"{'driven' if last.kind == 'campaign' else 'made'} {last.made_at[:10]}"


def _sentences(beyond: Sequence[Change]) -> Iterator[str]:
    """Yield what became of each quantity; of a cause with another law than last time both sizes in one."""
    gone = {
        family: [c for c in beyond if c.name[0] == family and not isfinite(c.now)]
        for family in {c.name[0] for c in beyond}
    }
    told = set()
    for change in beyond:
        before = gone[change.name[0]] if change.kind == "cause" else []
        if before and not isfinite(change.last):
            earlier = listed([_was(each) for each in before])
            yield f"{_name(change)} is {_value(change, change.now)}, and last time {earlier}"
            told |= {each.name for each in before}
        elif isfinite(change.now) or change.name not in told:
            yield size_sentence(change)


def _was(change: Change) -> str:
    return f"{_name(change)} was {_value(change, change.last)}"


def size_sentence(change: Change) -> str:
    """Return what became of one quantity."""
    if not isfinite(change.last):
        before = "was not among the causes" if change.kind == "cause" else "had no value"
        return f"{_name(change)} is {_value(change, change.now)} and {before} last time"
    if not isfinite(change.now):
        now = "is not among the causes" if change.kind == "cause" else "has no value"
        return f"{_was(change)} last time and {now} now"
    unit = _unit(change)
    return f"{_name(change)} went from {_number(change, change.last)} to {_number(change, change.now)} {unit}".rstrip()


def change_row(change: Change) -> list[str]:
    """Return a quantity with the columns of `CHANGE_HEAD`; shares are in percent."""
    change = _as_pages_write(change)
    halves = [f" ± {number(half, 2)}" if isfinite(half) else "" for half in (change.last_half95, change.now_half95)]
    difference = "–"
    if isfinite(change.difference):
        halves_known = [half for half in (change.last_half95, change.now_half95) if isfinite(half)]
        sigma = max(halves_known, default=nan) / Z95
        step = measured(change.difference, sigma) if halves_known else _number(change, change.difference)
        step = step if step.strip("0.") else "0"
        difference = f"+{step}" if change.difference > 0 and step != "0" else step
    verdict = (
        f"not diagnosed {change.undiagnosed}"
        if change.undiagnosed
        else "yes"
        if change.beyond
        else "no"
        if any(halves)
        else "no interval"
    )
    values = [_number(change, change.last) + halves[0], _number(change, change.now) + halves[1]]
    return [_name(change), *values, difference, verdict, _unit(change)]


def _as_pages_write(change: Change) -> Change:
    """Return a change in the unit that pages write for it: of the soil's parameters as terrain.toml does."""
    if change.kind != "soil":
        return change
    factor, text = soil_unit(change.name[-1])
    numbers = {name: factor * getattr(change, name) for name in ("last", "last_half95", "now", "now_half95")}
    return replace(change, unit=text, **numbers)


def _number(change: Change, value: float) -> str:
    """Return a value; of a share in percent with one decimal, as the difference of two is then readable."""
    if change.kind != "data":
        return number(value)
    return signed(100 * value, ".1f") if isfinite(value) else number(value)


def _value(change: Change, value: float) -> str:
    return f"{_number(change, value)} {_unit(change)}".rstrip()


def _unit(change: Change) -> str:
    return "%" if change.kind == "data" else unit_text(change.unit)


def _name(change: Change) -> str:
    if change.name in _NAMES:
        return _NAMES[change.name]
    first, last, *_ = change.name
    if change.kind == "soil":
        return f"{SOIL_LETTERS.get(last, last)} of the soil" + (f" in {first}" if first != "soil" else "")
    if change.kind == "cause":
        return f"{plain_name(first)}, {letter(last)}"
    return f"error of {OUTPUTS[last].name} on held-out runs, calibrated soil"
