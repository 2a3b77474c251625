"""Candidate causes: their probabilities and sizes, and those that are not identifiable."""

from __future__ import annotations

from math import isfinite

from model.diagnosis import Candidate, Cause, Diagnosis
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, section
from wheelsoil.report.figures import Trace, axes, bars, form_name
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.diagnosis_text import not_named, set_shares
from wheelsoil.wording.grounds_text import adequacy_words
from wheelsoil.wording.names import NOT_IDENTIFIABLE, chance, letter, meaning, parameter_name, plain_name, upper
from wheelsoil.wording.numbers import interval, number, unit
from wheelsoil.wording.verdict import NOT_JUDGED, refusal_words, several_terrains

_SHOWN = 10
_LOOKS = (("#0072B2", ""), ("#E69F00", "/"), ("#bdbdbd", "."))
_READING = (
    "the length of a bar is the probability that the cause is among those that act. Causes may act together, so the "
    "bars need not add up to 1. A name of runs needs more than 0.8 here, averaged over resampled runs, and 0.97 by the "
    "runs as they are; a name of a table 0.9; and either has to be worth something on held-out data."
)


@section("candidates", "Candidate causes")
def candidates(inputs: ReportInputs) -> Contents:
    """Build the section."""
    found = inputs.diagnosis
    blocks: list[Block] = []
    if refused := NOT_JUDGED if several_terrains(found) is not None else refusal_words(found):
        blocks.append(Text(refused, "warning"))
    elif found.candidates:
        blocks.append(Panels([_figure(found)], _READING))
    if len(found.sets) > 1 and found.verdict in ("named", "one_of"):
        rows = [[share.name, f"{share.percent:.1f} %"] for share in set_shares(found.sets)]
        blocks.append(Table("Causes that act together", ["set of causes, and no others", "probability"], rows))
    if found.causes:
        meant = [
            f"{upper(plain_name(cause.name))}: {sentence}" for cause in found.causes if (sentence := meaning(cause.key))
        ]
        blocks += [_table(found), *map(Text, dict.fromkeys(meant))]
    blocks += _adequacy(found)
    for heading, texts in not_named(found.not_identifiable, found.minimum_detectable).items():
        rows = [[plain_name(name), why] for name, why in texts.items()]
        blocks.append(Table(heading, ["cause", "for want of"], rows, left=2))
    numbers = {
        "verdict": found.verdict,
        "candidates": found.candidates,
        "causes": found.causes,
        "sets": found.sets,
        "adequacy": found.adequacy,
        "proposal": found.proposal,
        **dict.fromkeys(NOT_IDENTIFIABLE, found.not_identifiable),
    }
    return blocks, numbers


def _figure(found: Diagnosis) -> Figure:
    named = {cause.name for cause in found.causes}
    shown = [c for i, c in enumerate(found.candidates) if i < _SHOWN or c.name in named]
    labels = ("in the set", "not in it") if found.verdict == "one_of" else ("named", "not named")
    parts: tuple[list[Candidate], ...] = (
        [c for c in shown if c.name in named],
        [c for c in shown if c.name not in named and c.name != "none"],
        [c for c in shown if c.name == "none"],
    )
    data: list[Trace] = [
        bars([plain_name(c.name) for c in part], [c.probability for c in part], name, colour, pattern)
        for part, name, (colour, pattern) in zip(parts, (*labels, "no cause at all"), _LOOKS, strict=True)
        if part
    ]
    layout = axes("probability", "", height=120 + 26 * len(shown))
    layout["xaxis"] |= {"range": [0, 1]}
    layout["yaxis"] |= {"order": [plain_name(c.name) for c in shown]}
    return Figure("candidates", "How probable each cause is", data, layout)


def _table(found: Diagnosis) -> Table:
    head = ["cause", "parameter", "value", "95 % interval", "unit", "probability", "form", "kind"]
    rows = [row for cause in found.causes for row in _rows(cause)]
    several = "Possible causes, each with its size if it acts" if len(found.causes) > 1 else "Most probable, not named"
    title = several if found.verdict == "one_of" else "What was found"
    note = (
        "The family is named first; the form within it only conditionally, with its probability given the family in "
        "brackets. Intervals allow for the noise, for the errors of speed and load, and for the soil."
    )
    return Table(title, head, rows, note, left=2, words=("unit", "form", "kind"))


def _rows(cause: Cause) -> list[list[str]]:
    form = f"{form_name(cause.form)} ({chance(cause.form_probability)})" if cause.form else ""
    return [
        [
            plain_name(cause.name) if i == 0 else "",
            letter(parameter_name(cause.key, parameter.name)),
            number(parameter.value),
            interval(*parameter.interval95),
            unit(parameter.unit),
            *([chance(cause.probability), form, cause.kind] if i == 0 else [""] * 3),
        ]
        for i, parameter in enumerate(cause.parameters)
    ]


def _adequacy(found: Diagnosis) -> list[Block]:
    blocks: list[Block] = []
    if found.adequacy and isfinite(found.adequacy.statistic):
        adequacy = adequacy_words(found.adequacy)
        if found.adequacy.ok and several_terrains(found) is not None:
            apart = "What is left is judged with a soil that differs from run to run"
            blocks.append(Text(f"{apart}: {adequacy}.", "warning"))
        elif found.adequacy.ok:
            blocks.append(Text(f"The best explanation leaves no more than noise: {adequacy}.", "good"))
        else:
            text = (
                f"The best explanation leaves more than noise: {adequacy}. Do not rely on the probabilities of causes."
            )
            blocks.append(Text(text, "warning"))
    if found.proposal:
        text = (
            f"A formula for the remaining residual, not a named cause: {found.proposal.formula}, worth "
            f"{number(found.proposal.gain)} nats on held-out runs."
        )
        blocks.append(Text(text))
    return blocks
