"""A diagnosis as lines of text for the terminal; names and numbers as the terminal and the report write them."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import NamedTuple

from daq import OUTPUTS, ROLES, Note, Use, VehicleConfig, number, table_lines
from model.diagnosis import Cause, CauseSet, Detectable, Diagnosis, Finding, Gain
from wheelsoil.wording.figures import figure_interval, figure_value
from wheelsoil.wording.grounds_text import NOT_IN_THESE_DATA, adequacy_words, undetectable
from wheelsoil.wording.mending import first_steps
from wheelsoil.wording.names import (
    SOIL_LETTERS,
    chance,
    effect_name,
    family_of,
    parameter_name,
    place_text,
    plain_name,
    plain_names,
    shares_percent,
)
from wheelsoil.wording.notes import key_text, note_text, step_text, texts_of, worth_text
from wheelsoil.wording.verdict import (
    deciding_runs,
    details_of,
    headline_of,
    reduction_in,
    refusal_words,
    several_terrains,
    stated_channel,
)
from wheelsoil.workflows.key_figures import CALIBRATED_SOIL, errors_of, figures_of_diagnosis, sizes_of

FINDING_NOTE = (
    "Median there: of measured - predicted. Size of the shape: the largest contribution of that shape "
    "alone (a hat function over the range, or the stated growth), with the soil re-calibrated beside it and the "
    "stronger shapes removed. The two can have opposite signs: a soil that compensates a misfit in one range shifts "
    "the curve in another. Sigmas: "
    "the size over its standard deviation, which allows for correlated noise, errors of speed and load, and the soil."
)
MISREAD_NOTE = (
    "As an error of the input: the error, measured - true, that would give this residual; there need not be one."
)

NO_GAIN = "No cause was chosen for any of the held-out runs, so that there is no gain."

NOT_IDENTIFIABLE = "Detectable, not identifiable"
NOT_DETECTABLE = "Not detectable"

_REST = "Probabilities, residuals, detectable sizes and further steps: --verbose."
_LEAST_SHOWN = 0.01
_MOST_FINDINGS = 8
_MOST_SETS = 5
_FINDINGS = (
    "median: of measured - predicted there; shape: contribution of that shape alone, with the soil free, so that its "
    "sign can be opposite."
)
_MEANS = "mean: of measured - predicted over these rows."
_LEAST_WIDTH, _MOST_WIDTH = 80, 100


def finding_note(note: str, found: Iterable[Finding]) -> str:
    """Return a note on findings, with what an error of an input means where one is among them."""
    return f"{note} {MISREAD_NOTE}" if any(ROLES[finding.channel].use is Use.INPUT for finding in found) else note


def nothing_chosen(gain: Gain) -> bool:
    """Return whether the choice fell on no cause each time."""
    return bool(gain.chosen) and not any(gain.chosen)


def not_named(not_identifiable: Mapping[str, Note], sizes: Mapping[str, Detectable]) -> dict[str, dict[str, str]]:
    """Return the families that cannot be named with the reason, by `NOT_IDENTIFIABLE` and `NOT_DETECTABLE`."""
    seen = {family_of(key) for key, least in sizes.items() if isfinite(least.value)}
    by_title: dict[str, dict[str, str]] = {NOT_IDENTIFIABLE: {}, NOT_DETECTABLE: {}}
    for family, why in not_identifiable.items():
        by_title[NOT_IDENTIFIABLE if family in seen else NOT_DETECTABLE][family] = note_text(why)
    return {title: texts for title, texts in by_title.items() if texts}


class SetShare(NamedTuple):
    """A set of causes, its probability, its percentage as it is shown (those of all add up to 100), and its size."""

    name: str
    probability: float
    percent: float
    causes: int


def set_shares(sets: Sequence[CauseSet]) -> list[SetShare]:
    """Return the most probable sets, and all others together."""
    if not sets:
        return []
    shown = sets[:_MOST_SETS]
    names = [" + ".join(map(plain_name, each.causes)) or "no cause" for each in shown]
    chances = [each.probability for each in shown]
    chances.append(max(1.0 - sum(chances), 0.0))
    sizes = [*(len(each.causes) for each in shown), 0]
    shares = map(SetShare, [*names, "all other sets"], chances, shares_percent(chances), sizes)
    return [share for share in shares if share.percent > 0]


def diagnosis_lines(
    diagnosis: Diagnosis,
    vehicle: VehicleConfig | None,
    width: int = 96,
    *,
    wheels: Mapping[str, VehicleConfig] | None = None,
    checks: Iterable[str] = (),
    verbose: bool = False,
    saved: bool = False,
) -> list[str]:
    """Return a diagnosis as lines of text: the verdict and the next step first, then the causes and the gain.

    `vehicle` is what the next step may have to change, None where the runs are of several; `wheels` has that of each
    wheel, for a cause at one of them. The width is held between 80
    and 100. `checks` say where the recommended model is off. With `verbose` also probabilities, residuals, detectable
    sizes and further steps. Where the model is `saved` already, no step asks to save it.
    """
    width = limited(width)
    head = [*wrapped(headline_of(diagnosis), width), *_first_steps(diagnosis, vehicle, wheels or {}, width, saved)]
    details = wrapped(" ".join(details_of(diagnosis)), width)
    causes, inconsistent = _causes(diagnosis, width), _inconsistent(diagnosis, width)
    to_check, notes = _notes("To check", checks, width), _notes("Notes", texts_of(diagnosis.notes), width)
    whole = (
        _candidates(diagnosis, width),
        _sets(diagnosis, width),
        inconsistent,
        to_check,
        _soils(diagnosis, width),
        _what_is_wrong(diagnosis, width),
        _gain(diagnosis, width),
        _adequacy(diagnosis, width),
        _linearisation(diagnosis, width),
        _proposal(diagnosis, width),
        _corrected(diagnosis, width),
        _static(diagnosis, width),
        *_not_named(diagnosis, width),
        _detectable(diagnosis, width),
        _next_run(diagnosis, width),
        notes,
    )
    worth = wrapped(text, width) if (text := gain_text(diagnosis)) else []
    brief = (worth, inconsistent, to_check, notes, wrapped(_REST, width))
    parts = (head, details, causes, *(whole if verbose else brief))
    return [line for i, part in enumerate(filter(None, parts)) for line in (("", *part) if i else part)]


def _first_steps(
    diagnosis: Diagnosis, vehicle: VehicleConfig | None, wheels: Mapping[str, VehicleConfig], width: int, saved: bool
) -> list[str]:
    return [
        line
        for text, step in first_steps(diagnosis, vehicle or VehicleConfig(), wheels, saved=saved)
        for pasted in [step.paste.splitlines() if vehicle is not None else ()]
        for line in (*wrapped(f"{text} {step.why}".rstrip(), width), *_indented(pasted))
    ]


def limited(width: int) -> int:
    """Return a width that a person reads well."""
    return min(max(width, _LEAST_WIDTH), _MOST_WIDTH)


def wrapped(text: str, width: int, first: str = "", then: str | None = None) -> list[str]:
    """Return a text as lines that begin with `first`, then with `then`."""
    after = first if then is None else then
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=after, break_on_hyphens=False) or [
        first.rstrip()
    ]


def _causes(diagnosis: Diagnosis, width: int) -> list[str]:
    rows = [row for cause in diagnosis.causes for row in _cause_rows(cause)]
    if not rows:
        return []
    title = "Causes"
    if diagnosis.verdict == "one_of":
        several = len(diagnosis.causes) > 1
        title = "Possible causes, each with its size if it acts" if several else "Most probable, not named"
    head = ["cause", "parameter", "prob.", "value", "95 % interval", "unit"]
    return [title, *_indented(table_lines(head, rows, left=2, width=width - 2))]


def _cause_rows(cause: Cause) -> Iterator[list[str]]:
    name, probability = plain_name(cause.name), chance(cause.probability)
    for figure, parameter in zip(sizes_of(cause), cause.parameters, strict=True):
        interval, words = figure_interval(figure, " .. "), parameter_name(cause.key, parameter.name)
        yield [name, words, probability, figure_value(figure), interval, figure.unit]
        name = probability = ""
    if not cause.parameters:
        yield [name, "-", probability, "-", "-", ""]
    if cause.form and cause.form_probability < 1:
        yield [f"  as {cause.form}, within the family", "", chance(cause.form_probability), "", "", ""]


def _candidates(diagnosis: Diagnosis, width: int) -> list[str]:
    if refused := refusal_words(diagnosis):
        return wrapped(refused, width)
    shown = [c for c in diagnosis.candidates if c.probability >= _LEAST_SHOWN]
    rest = len(diagnosis.candidates) - len(shown)
    figures = figures_of_diagnosis(diagnosis)
    words = [f"{plain_name(c.name)} {figure_value(figures[f'candidate.{c.name}'])}" for c in shown]
    words += [f"{rest} more below {100 * _LEAST_SHOWN:g} %"] if rest else []
    if not words:
        return []
    return ["Candidates (probability of being among the causes)", *wrapped(", ".join(words), width, "  ")]


def _sets(diagnosis: Diagnosis, width: int) -> list[str]:
    if len(diagnosis.sets) < 2 or diagnosis.verdict not in ("named", "one_of"):
        return []
    words = ", ".join(f"{share.name} {share.percent:.1f} %" for share in set_shares(diagnosis.sets))
    return ["Sets of causes (probability that these act, and no others)", *wrapped(words, width, "  ")]


def _what_is_wrong(diagnosis: Diagnosis, width: int) -> list[str]:
    if not diagnosis.what_is_wrong:
        return []
    findings = diagnosis.what_is_wrong[:_MOST_FINDINGS]
    of_rows = all(found.of_rows for found in findings)
    rows = [
        [
            ROLES[found.channel].name,
            *([] if of_rows else [_in_unit(diagnosis.median_there(found), found.channel)]),
            _in_unit(found.size, found.channel),
            number(found.statistic, 3),
            "",
        ]
        for found in findings
    ]
    head = ["channel", *(["mean"] if of_rows else ["median", "shape"]), "sigmas", ""]
    lines = table_lines(head, rows)
    widest = max(map(len, lines)) + 2
    texts = ["where", *(place_text(found.place) for found in findings)]
    folded = [
        line
        for start, text in zip(lines, texts, strict=True)
        for line in wrapped(text, width - 2, start.ljust(widest), " " * widest)
    ]
    more = len(diagnosis.what_is_wrong) - len(findings)
    tail = [f"and {more} more (--json)"] if more else []
    note = wrapped(finding_note(_MEANS if of_rows else _FINDINGS, findings), width - 2)
    return ["Residuals of the simulation, largest first", *_indented([*folded, *tail, *note])]


def _in_unit(value: float, channel: str) -> str:
    return f"{number(value, 3)} {ROLES[channel].unit_text}".rstrip() if isfinite(value) else "-"


def _gain(diagnosis: Diagnosis, width: int) -> list[str]:
    gain = diagnosis.gain
    if gain is None:
        return []
    head = ["held out", "R0", "unit", "M0 %", "R2", "ln L of a run"]
    rows = score_rows(gain, number, diagnosis.verdict)
    return [
        "Gain on held-out data: cause and fit know the others only, the noise model all",
        *_indented(table_lines(head, rows, width=width - 2)),
        *wrapped(gain_text(diagnosis), width, "  "),
    ]


def score_rows(gain: Gain, number: Callable[[float, int], str], verdict: str) -> list[list[str]]:
    """Return model, R0, unit, M0, R2 and log-likelihood of every channel, without and with the causes of a verdict."""
    return [
        [
            f"{OUTPUTS[channel].name}, {which.replace('_', ' ')}",
            figure_value(figure),
            figure.unit,
            number(scores[channel].M0_percent, 3),
            number(scores[channel].R2, 4),
            number(scores[channel].log_likelihood, 5) if channel == next(iter(gain.base)) else "",  # of the whole run
        ]
        for (channel, which), figure in errors_of(gain, verdict).items()
        for scores in [gain.base if which == CALIBRATED_SOIL else gain.extended]
    ]


_COVERED = "held in 90 % of campaigns of a study"
"""Of the interval of a gain in pull: measured by studies/gain_interval on 200 campaigns of three to five runs."""
_FEW_RUNS = 8


def covered(found: Diagnosis) -> str:
    """Return in how many campaigns the interval of the gain is right; "" where the study says nothing of such data."""
    runs = len(found.gain.chosen) if found.gain is not None else 0
    other = found.grounds.table_channels or several_terrains(found) is not None or stated_channel(found) != "dp"
    return _COVERED if runs <= _FEW_RUNS and not other else ""


def gain_text(found: Diagnosis) -> str:
    """Return the gain in a sentence, in the channel of the headline; "" where there is none."""
    gain, channel, of_interval = found.gain, stated_channel(found), covered(found)
    if gain is None or nothing_chosen(gain):
        return NO_GAIN if gain is not None else ""
    change = reduction_in(gain, channel)
    how, sign = ("falls", 1) if change.percent >= 0 else ("grows", -1)
    low, high = sorted(sign * end for end in change.interval95)
    within = f" (95 %: {number(low, 3)} to {number(high, 3)} %)" if isfinite(low) and isfinite(high) else ""
    chosen = sum(bool(keys) for keys in gain.chosen)
    folds = f"; {chosen} of {len(gain.chosen)} folds chose a cause" if gain.chosen else ""
    return (
        f"R0 of the {OUTPUTS[channel].name} {how} by {number(abs(change.percent), 3)} %{within}; "
        f"the log likelihood gains {number(gain.log_likelihood_gain, 4)} nats{folds}."
        + (f" The interval {of_interval}." if within and of_interval else "")
    )


def _soils(diagnosis: Diagnosis, width: int) -> list[str]:
    several = len(diagnosis.soils) > 1
    texts = [
        (f"{soil.campaign}: " if several else "")
        + ", ".join(f"{SOIL_LETTERS[name]} {x:+.1f}" for name, x in soil.off_laboratory.items())
        for soil in diagnosis.soils
        if soil.off_laboratory
    ]
    return _notes("Soil here less the laboratory's, in the laboratory's sigma", texts, width)


def _adequacy(diagnosis: Diagnosis, width: int) -> list[str]:
    if diagnosis.adequacy is None:
        return []
    found = diagnosis.adequacy
    return wrapped(f"The best explanation is {'' if found.ok else 'not '}adequate: {adequacy_words(found)}.", width)


def _linearisation(diagnosis: Diagnosis, width: int) -> list[str]:
    if diagnosis.linearisation is None:
        return []
    found = diagnosis.linearisation
    how = "converged after" if found.converged else "did not converge in"
    used = f"Samples used: {found.used} of {found.samples}"
    return wrapped(f"{used}. The linearisation {how} {found.iterations} iterations.", width)


def _inconsistent(diagnosis: Diagnosis, width: int) -> list[str]:
    texts = (f"{plain_name(item.channel)}: {item.rows} rows: {note_text(item.why)}" for item in diagnosis.inconsistent)
    return _notes("Inconsistent: possible with no soil", texts, width)


def _proposal(diagnosis: Diagnosis, width: int) -> list[str]:
    if diagnosis.proposal is None:
        return []
    found = diagnosis.proposal
    text = (
        f"A formula for the remaining residual, not a named cause: {found.formula} (gain {number(found.gain, 3)} nats)"
    )
    return wrapped(text, width, "", "  ")


def notes_by_text(title: str, texts: dict[str, str], width: int) -> list[str]:
    """Return the lines of a title and texts, each text once with all its names."""
    about: dict[str, list[str]] = {}
    for name, text in texts.items():
        about.setdefault(text, []).append(name)
    return _notes(title, (f"{', '.join(plain_names(names))}: {text}" for text, names in about.items()), width)


def _not_named(diagnosis: Diagnosis, width: int) -> list[list[str]]:
    parts = not_named(diagnosis.not_identifiable, diagnosis.minimum_detectable)
    return [notes_by_text(f"{title} ({len(texts)})", texts, width) for title, texts in parts.items()]


def _detectable(diagnosis: Diagnosis, width: int) -> list[str]:
    found = diagnosis.minimum_detectable
    hidden = undetectable(found, diagnosis.notes)
    never_named = [key for key in found if family_of(key) in diagnosis.not_identifiable]
    cells = [
        f"{effect_name(key)}{' *' if key in never_named else ''}  {least.parameter} {number(least.value, 2)} "
        f"{'' if least.unit == '1' else least.unit}"
        for key, least in found.items()
        if key not in hidden
    ]
    never = ", ".join(effect_name(key) for key in found if key in hidden)
    lines = _in_columns([cell.rstrip() for cell in cells], width - 2) if cells else []
    lines += wrapped(f"{NOT_IN_THESE_DATA}: {never}", width - 2, "", "  ") if never else []
    starred = any(key not in hidden for key in never_named)
    lines += ["* detectable, not identifiable: see above"] if starred else []
    return ["Minimum detectable effect", *_indented(lines)] if lines else []


def _in_columns(cells: list[str], width: int) -> list[str]:
    """Return the cells in as many columns as fit, read downwards."""
    wide = max(map(len, cells)) + 3
    columns = max(1, (width + 3) // wide)
    height = -(-len(cells) // columns)
    return ["".join(cell.ljust(wide) for cell in cells[row::height]).rstrip() for row in range(height)]


def _corrected(diagnosis: Diagnosis, width: int) -> list[str]:
    texts = (
        f"{plain_name(each.name)} {number(each.value, 3)} {each.unit} "
        f"({' to '.join(number(x, 3) for x in each.interval95)}), {', '.join(each.source)}"
        for each in diagnosis.corrected
    )
    return _notes("Taken off before, by the lifted wheel (95 %)", texts, width)


def _static(diagnosis: Diagnosis, width: int) -> list[str]:
    texts = []
    for check in diagnosis.static:
        read = []
        for channel, (reading, sigma) in check.readings.items():
            known = f" of {number(force, 4)}" if (force := check.applied[channel]) else ""
            unit = OUTPUTS[channel].unit_text
            read.append(f"{OUTPUTS[channel].name} {number(reading, 4)}{known} {unit}, one-sigma {number(sigma, 2)}")
        if check.wheel_speed_radps:
            read.append(
                f"{check.ground_speed_mps:.4g} m/s at {check.wheel_speed_radps:.4g} rad/s of the wheel, one-sigma "
                f"{check.ground_speed_sigma_mps:.2g} m/s"
            )
        texts.append(f"{plain_name(check.test)}{f' of {check.run}' if check.run else ''}: {'; '.join(read)}")
    return _notes("Static tests, taken as data", texts, width)


def _next_run(diagnosis: Diagnosis, width: int) -> list[str]:
    lines = []
    for i, run in enumerate(deciding_runs(diagnosis), 1):
        parted = f", separates {', '.join(map(plain_name, run.separates))}" if run.separates else ""
        written = f"; write {key}" if (key := key_text(run)) else ""
        lines += wrapped(f"{i}. {step_text(run)}: {worth_text(run)}{parted}{written}", width, "  ", "     ")
    return ["Next run, best first", *lines] if lines else []


def _notes(title: str, notes: Iterable[str], width: int) -> list[str]:
    lines = [line for note in notes for line in wrapped(note, width, "  ", "    ")]
    return [title, *lines] if lines else []


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"  {line}" for line in lines]
