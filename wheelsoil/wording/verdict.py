"""The sentence of a verdict: what it is, how large, how sure, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import Literal, NamedTuple

from daq import OUTPUTS, ROLES, Note, number, without_powers
from model import DiagnosisCode, LackCode
from model.diagnosis import (
    Adequacy,
    Cause,
    Detectable,
    Diagnosis,
    Finding,
    FormUsed,
    Gain,
    Grounds,
    NextRun,
    Reduction,
)
from model.effects import EFFECTS, parted
from wheelsoil.wording.error_text import ERRORS, error_text
from wheelsoil.wording.names import (
    SOIL_LETTERS,
    chance,
    family_of,
    letter,
    listed,
    parameter_name,
    place_text,
    plain_name,
    stretches,
    upper,
)
from wheelsoil.wording.notes import note_text, step_text
from wheelsoil.wording.numbers import estimate

REFUTED_AT = 3.0
"""One-sigmas of the laboratory by which a soil's parameter may be off."""
VERDICT_WORDS = {
    "one_of": "one of several",
    "nothing_detectable": "nothing detectable",
    "unexplained": "unexplained",
}
NOT_IN_THESE_DATA = "not detectable in these data"
"""Of an effect whose minimum detectable size is beyond what is plausible."""
MOST_WORDS = 25
"""Of a headline."""
_MOST_NAMES = 3
_MOST_LACKING = 5
_MOST_EXAMPLES = 3
_WORTH_SAYING = 0.2
NO_CHANGE = 0.5
"""Percent by which an error may fall or grow and still be said to stay."""
_TOGETHER_AT = 0.1
"""Probability from which on a set of several causes is said."""
_IN_ALL = 0.99
"""Probability above which a family is said to be in every explanation."""
_SURE = 0.95
"""Probability above which a cause that is not named acts, whichever others do."""
_OPEN_AT = 0.05
"""Posterior probability from which on a confounded family would fit almost as well."""
_UNLISTED_AT = 0.05
"""Probability of something unlisted from which on it is said to keep a name back."""
_USUAL = (LackCode.SAME_PASS, LackCode.PRESSURE_UNKNOWN)
"""What is wanting in nearly every campaign: it stands in the table, not in the sentence."""


class Statement(NamedTuple):
    """A sentence of a verdict, and which one it is where other places show that by itself."""

    text: str
    about: Literal["", "headline", "cause", "gain", "want", "next", "as_if"] = ""


def sentence_of(found: Diagnosis) -> str:
    """Return the verdict in a sentence or a few, with what speaks against it and what to do next."""
    return " ".join(sentences_of(found))


def sentences_of(found: Diagnosis) -> list[str]:
    """Return the sentences of the verdict, the most important one first."""
    return [statement.text for statement in statements_of(found)]


def statements_of(found: Diagnosis) -> list[Statement]:
    """Return the sentences of the verdict, the most important one first, each with what it is about."""
    grounds = found.grounds
    if grounds.undecided is not None:
        steps = dict.fromkeys(
            fault.next_step for fault in grounds.undecided.values.get("faults", ()) if fault.next_step
        )
        onward = [Statement(f"next: {'; '.join(steps)}", "next")] if steps else []
        return _sentences([f"nothing can be decided: {note_text(grounds.undecided)}", *onward])
    if (note := several_terrains(found)) is not None:
        return _as_if_of_one_soil(found, note)
    statements = [*_verdict_of_table(found), *_error_of_form(grounds)] if grounds.table_channels else _of_runs(found)
    before_next = next((i for i, statement in enumerate(statements) if statement.about == "next"), len(statements))
    first = statements[:1]
    rest = [*statements[1:before_next], *instead_words(found), *prior_words(found), *statements[before_next:]]
    cautions = _sentences([note_text(note) for note in grounds.cautions])
    soil = laboratory_words(found)
    return [*first, *cautions, *soil, *rest] if found.verdict == "unexplained" else [*first, *soil, *rest, *cautions]


def headline_of(found: Diagnosis) -> str:
    """Return the verdict in one short sentence, with the gain on held-out runs where there is one."""
    names, chances = [plain_name(cause.name) for cause in found.causes], [cause.probability for cause in found.causes]
    if len(names) > _MOST_NAMES:
        names = [*names[: _MOST_NAMES - 1], f"{len(names) - _MOST_NAMES + 1} more"]
        chances = [*chances[: _MOST_NAMES - 1], min(chances[_MOST_NAMES - 1 :])]
    if found.grounds.undecided is not None:
        return "Nothing can be decided from these data."
    if (note := several_terrains(found)) is not None:
        return _not_one_soil(found, note)
    if found.verdict == "named":
        return _named_headline(found, names)
    if found.verdict == "one_of" and (why := found.grounds.barred) is not None and chances[0] > _SURE:
        if peak_bars(found):
            return f"{upper(listed(_with_the_peak(found.causes), 'or'))}: these runs do not decide."
        whole = f"Most probably {names[0]}, but not named: {note_text(why)}."
        short = f"Most probably {names[0]}, but not named: the reason is below."
        return whole if len(whole.split()) <= MOST_WORDS else short
    if found.verdict == "one_of" and len(names) > 1:
        sure = all(cause.probability > _SURE for cause in found.causes)
        doubt = "not sure enough for names" if sure else "these data cannot separate them"
        sentence = f"{upper(alternatives(list(zip(names, chances, strict=True))))}: {doubt}"
    elif found.verdict == "one_of":
        sentence = f"Most probably {names[0]}, but not sure enough for a name"
    elif found.verdict == "unexplained":
        if groups := groups_of_runs(found):
            ask = f"{groups.first} ask{'s' if groups.single else ''}"
            return f"No known cause explains these data: {ask} for another soil than {groups.second}."
        return "No known cause explains these data: do not rely on the model."
    else:
        return "No cause is detected: soil and noise explain these data."
    channel = falling_channel(found)
    if channel is None:
        return f"{sentence}."
    whole = f"{sentence}. With the first, {_fall_of(found, channel)}."
    return whole if len(whole.split()) <= MOST_WORDS else f"{sentence}."


def _with_the_peak(causes: Sequence[Cause]) -> list[str]:
    """Return the names of the first causes with the stress peak last, in plain words."""
    others = [plain_name(cause.name) for cause in causes if not EFFECTS[cause.key].is_usual()]
    return [*others[: _MOST_NAMES - 1], "a stress peak ahead of the wheel's bottom"]


def _named_headline(found: Diagnosis, names: Sequence[str]) -> str:
    """Return the name with the error that falls for certain; where none does, with the size."""
    several = "" if len(names) == 1 else "s"
    verb = f"explain{'' if several else 's'} the misfit" if _explains(found) else f"act{'' if several else 's'}"
    sentence, channel = f"{upper(listed(names))} {verb}", falling_channel(found)
    sizes = "; ".join(_finding_or_size(cause, found.main_channel) for cause in found.causes)
    whole = f"{sentence}: {sizes if channel is None else _fall_of(found, channel)}."
    return whole if len(whole.split()) <= MOST_WORDS else f"{sentence}."


def falling_channel(found: Diagnosis) -> str | None:
    """Return the channel whose held-out error falls for certain with the causes: the main one, if it does; or None."""
    gain, main = found.gain, found.main_channel
    if gain is None:
        return None
    others = sorted(gain.base, key=lambda channel: reduction_in(gain, channel).interval95[0], reverse=True)
    return next((channel for channel in dict.fromkeys((main, *others)) if _falls(reduction_in(gain, channel))), None)


def _falls(change: Reduction) -> bool:
    return change.percent >= NO_CHANGE and change.interval95[0] > 0


def _fall_of(found: Diagnosis, channel: str) -> str:
    percent = reduction_in(found.gain, channel).percent if found.gain is not None else float("nan")
    return f"the {OUTPUTS[channel].name} error on held-out data falls by {percent:.0f} %"


def _finding_or_size(cause: Cause, channel: str) -> str:
    if parted(cause.name)[0] not in ERRORS or not cause.parameters:
        return size_text(cause)
    text = error_text(cause, OUTPUTS[channel].name)
    return f"{text[0].lower()}{text[1:]}"


def details_of(found: Diagnosis) -> list[str]:
    """Return the sentences of the verdict without what the headline, the gain and the next step say."""
    sizes = "; ".join(_form_and_size(cause) for cause in found.causes)
    elsewhere = ("headline", "gain", "next", "as_if")
    statements = [statement for statement in statements_of(found) if statement.about not in elsewhere]
    if _headline_has_size(found):
        statements = [statement for statement in statements if statement.about != "cause"]
    texts = [f"{sizes}." if statement.about == "cause" else statement.text for statement in statements]
    wants = [i for i, statement in enumerate(statements) if statement.about == "want"]
    if wants:
        lacking = [plain_name(family) for family, why in found.not_identifiable.items() if why.code not in _USUAL]
        names = listed(lacking) if len(lacking) <= _MOST_LACKING else f"{len(lacking)} causes"
        texts[wants[0] : wants[-1] + 1] = [f"Not identifiable from these runs: {names}."]
    if found.verdict == "one_of" and found.causes[0].parameters and several_terrains(found) is None:
        texts.insert(1, f"If {plain_name(found.causes[0].name)} acts: {size_text(found.causes[0])}.")
    if found.verdict == "named" and found.grounds.table_channels and several_terrains(found) is None:
        texts.insert(1, f"{sizes}.")
    return texts


def _headline_has_size(found: Diagnosis) -> bool:
    """Return whether the headline states the whole size of a named cause."""
    alone = found.verdict == "named" and len(found.causes) == 1 and falling_channel(found) is None
    return alone and not found.causes[0].form and ":" in headline_of(found)


def several_terrains(found: Diagnosis) -> Note | None:
    """Return the note that runs are probably not of one soil; None where they may be."""
    cautions = found.grounds.cautions
    return next((note for note in cautions if note.code == DiagnosisCode.SEVERAL_TERRAINS), None)


class Groups(NamedTuple):
    """Runs of the one soil and of the other as text, and whether the first is a single run, and the second."""

    first: str
    second: str
    single: bool
    single_second: bool


def groups_of_runs(found: Diagnosis) -> Groups | None:
    """Return the runs of the one soil and of the other; None where they are not known."""
    note, soils = several_terrains(found), found.grounds.terrains
    if note is not None:
        groups, order = note.values.get("groups", ()), note.values.get("runs", ())
    elif soils is not None:
        groups, order = soils, [name for data in found.plot_data for name in data.runs]
    else:
        return None
    if len(groups) != 2:
        return None
    first, second = (stretches(group, order) for group in groups)
    return Groups(first, second, len(groups[0]) == 1, len(groups[1]) == 1)


def _not_one_soil(found: Diagnosis, note: Note) -> str:
    of_campaign = f"The runs of {note.values['campaign']}" if len(found.soils) > 1 else "These runs"
    groups = groups_of_runs(found)
    apart = f": {groups.first} differ{'s' if groups.single else ''} from {groups.second}" if groups else ""
    return f"{of_campaign} are probably not of one soil{apart}."


def _as_if_of_one_soil(found: Diagnosis, note: Note) -> list[Statement]:
    """Return the sentences where runs are probably not of one soil: that first, and the causes as if they were."""
    others = tuple(caution for caution in found.grounds.cautions if caution.code != note.code)
    grounds = replace(found.grounds, cautions=others, prior_shifts=())
    first, *rest = [s for s in statements_of(replace(found, next_run=(), grounds=grounds)) if s.about != "next"]
    cautions = _sentences([note_text(caution) for caution in others])
    as_if = Statement(f"As if of one soil: {first.text[0].lower()}{first.text[1:]}", "as_if")
    return [
        Statement(_not_one_soil(found, note), "headline"),
        *_sentences([note_text(note)]),
        as_if,
        *(statement if statement in cautions else statement._replace(about="as_if") for statement in rest),
        *_sentences([Statement(f"Next: {terrains_step(found)}", "next")]),
    ]


def terrains_step(found: Diagnosis) -> str:
    """Return what to do with runs that are probably not of one soil."""
    groups = groups_of_runs(found)
    if not groups:
        return "move the runs of each soil into a folder of their own, with that soil in its terrain.toml; report each"
    their = "its" if groups.single_second else "their"
    moved = f"move {groups.second} into a folder of {their} own, with {their} soil in its terrain.toml"
    return f"{moved}; report both folders"


def peak_bars(found: Diagnosis) -> bool:
    """Return whether a name is kept back because the stress peak may lie ahead of the wheel's bottom."""
    return found.grounds.barred is not None and found.grounds.barred.code == LackCode.PEAK_MAY_SHIFT


def open_rivals(found: Diagnosis) -> list[str]:
    """Return the confounded families that these data do not separate from the causes."""
    chances = {candidate.name: candidate.probability for candidate in found.candidates}
    return [family for family in found.grounds.confounded if chances.get(family, 0.0) >= _OPEN_AT]


def deciding_runs(found: Diagnosis) -> tuple[NextRun, ...]:
    """Return the next runs, without those that only separate from a name what these data separate already."""
    decided = found.verdict == "named" and found.grounds.confounded and not open_rivals(found)
    return () if decided or several_terrains(found) is not None else found.next_run


def finding_of(found: Diagnosis) -> str:
    """Return the first sentence of the verdict, without the size where it is of a single cause."""
    first = statements_of(found)[0]
    if first.about != "cause" or len(found.causes) > 1:
        return first.text
    return upper(without_powers(_cause_named(found.causes[0], _explains(found))))


def size_text(cause: Cause) -> str:
    """Return the parameters of a cause with their intervals, those without one only where no other is known."""
    known = [p for p in cause.parameters if all(map(isfinite, p.interval95))]
    return ", ".join(
        f"{letter(parameter_name(cause.key, p.name))} = {estimate(p.value, p.sigma, p.interval95, p.unit)}"
        for p in known or cause.parameters
    )


def _form_and_size(cause: Cause) -> str:
    sizes = size_text(cause)
    if not cause.form:
        return sizes[0].upper() + sizes[1:] if len(sizes) > 1 and sizes[1].islower() else sizes
    return f"{cause.form.capitalize()}'s form is most probable ({chance(cause.form_probability)}): {sizes}"


def laboratory_words(found: Diagnosis) -> list[Statement]:
    """Return the sentence that the laboratory's soil is refuted; empty where it is not, or nothing explains the data.

    Of runs it is judged beside every probable set of causes; of tables beside the one that extends the simulation.
    """
    if found.verdict == "unexplained":
        return []
    several = len(found.soils) > 1
    of_runs = [
        (refuted.campaign, refuted.parameter, refuted.sigmas, refuted.probability)
        for refuted in found.grounds.refuted_soil
    ]
    of_tables = [
        (soil.campaign, name, sigmas, None)
        for soil in found.soils
        for name, sigmas in soil.off_laboratory.items()
        if found.grounds.table_channels and abs(sigmas) > REFUTED_AT
    ]
    off = [
        f"{SOIL_LETTERS[name]} is {abs(sigmas):.1f} sigma {'above' if sigmas > 0 else 'below'}"
        + (f" in {campaign}" if several else "")
        + (f" ({chance(p)})" if p is not None else "")
        for campaign, name, sigmas, p in (*of_runs, *of_tables)
    ]
    return _sentences([f"the laboratory's soil does not hold here: {listed(off)} its value"] if off else [])


def prior_words(found: Diagnosis) -> list[Statement]:
    """Return the sentence that the verdict depends on the prior; empty where it does not."""
    shifts = found.grounds.prior_shifts
    if not shifts or found.verdict not in ("named", "one_of"):
        return []
    first = shifts[0]
    times = "three times" if first.factor > 1 else "a third"
    families = [plain_name(family) for family in first.families]
    other = {"named": f"{listed(families)} named", "one_of": f"one of {', '.join(families)}" if families else ""}.get(
        first.verdict, ""
    )
    other = other or VERDICT_WORDS[first.verdict]
    turned = dict.fromkeys(shift.family for shift in shifts[1:] if shift.family != first.family)
    more = f"; so it is with {listed([plain_name(family) for family in turned])}" if turned else ""
    return _sentences(
        [
            f"Whoever expects {plain_name(first.family)} {times} as often as the prior does gets another verdict, "
            f"{other}{more}"
        ]
    )


def instead_words(found: Diagnosis) -> list[Statement]:
    """Return what the laboratory may have wrong in place of a named cause; empty where nothing is."""
    return _sentences(
        [
            f"A laboratory whose {SOIL_LETTERS[rival.soil.parameter]} is {abs(rival.soil.sigmas):.1f} sigma "
            f"{'too low' if rival.soil.sigmas > 0 else 'too high'} would explain these runs in place of "
            f"{plain_name(rival.family)} ({chance(rival.soil.probability)})"
            for rival in found.grounds.soil_instead
        ]
    )


def _of_runs(found: Diagnosis) -> list[Statement]:
    grounds = found.grounds
    chances = {cause.name: cause.probability for cause in found.causes}
    chances |= {candidate.name: candidate.probability for candidate in found.candidates}
    none = chances.pop("none", 0.0)
    if found.verdict == "named":
        statements = named_words(found, chances)
    elif found.verdict == "one_of":
        statements = one_of_words(found, chances, none)
    elif found.verdict == "unexplained" and found.adequacy is not None:
        worst, best = found.what_is_wrong[:1], grounds.most_probable
        statements = unexplained_words(found.adequacy, worst, best, grounds.terrains, grounds.barred)
    else:
        hidden = undetectable(found.minimum_detectable, found.notes)
        sizes = {key: size for key, size in found.minimum_detectable.items() if key not in hidden}
        statements = nothing_words(chances, none, _by_family(sizes), found.what_is_wrong)
    return [*statements, *want_words(found.not_identifiable)]


def undetectable(sizes: Mapping[str, Detectable], notes: Sequence[Note] = ()) -> set[str]:
    """Return the effects whose minimum detectable size is beyond the bounds of what is plausible.

    Bounds in N and N m are of a wheel under 10 kN; of a lighter one they go with its load.
    """
    share = next((note.values["share"] for note in notes if note.code == DiagnosisCode.PRIOR_SCALED), 1.0)
    return {key for key, size in sizes.items() if not _is_plausible(key, size, share)}


def _is_plausible(key: str, size: Detectable, share: float) -> bool:
    known = {p.name: p for p in EFFECTS[key].parameters} if key in EFFECTS else {}
    bounds = known.get(size.parameter)
    if bounds is None or not isfinite(size.value):
        return isfinite(size.value)
    factor = share if size.unit in ("N", "N m") else 1.0
    return factor * bounds.lower <= size.value <= factor * bounds.upper


def _by_family(sizes: Mapping[str, Detectable]) -> dict[str, Detectable]:
    """Return the size of each family's first form."""
    first: dict[str, Detectable] = {}
    for key, size in sizes.items():
        first.setdefault(family_of(key), size)
    return first


def _error_of_form(grounds: Grounds) -> list[Statement]:
    """Return what was taken for the error of form where repeats do not say it, and which verdicts hang on it."""
    statements = [Statement(sentence) for sentence in form_error_words(grounds.form_errors)]
    if grounds.form_matters is None:
        return statements
    return [*statements, *_sentences([f"the verdict depends on it: {note_text(grounds.form_matters)}"])]


def form_error_words(used: Sequence[FormUsed]) -> list[str]:
    """Return what is given or assumed for the error of form; empty where the table itself says it."""
    taken = [form_error for form_error in used if form_error.share is not None]
    if not taken:
        return []
    sizes = listed(
        [
            f"{_in_unit(form_error.size, form_error.channel)} in {OUTPUTS[form_error.channel].name}"
            for form_error in taken
        ]
    )
    share = f"{100 * (taken[0].share or 0.0):.3g} % of load, load x radius and radius ({sizes})"
    if taken[0].basis == "given":
        sentence = f"The error of form of a right model is given as {share}"
    else:
        why = "there are neither repeats nor _sigma columns, and --error-of-form was not given"
        sentence = f"The error of form of a right model is assumed to be {share}: {why}"
    return [f"{sentence}."]


def _in_unit(size: float, channel: str) -> str:
    factor, unit = (1e3, "mm") if OUTPUTS[channel].unit == "m" else (1.0, OUTPUTS[channel].unit_text)
    return f"{factor * size:.2g} {unit}"


def _verdict_of_table(found: Diagnosis) -> list[Statement]:
    channels = listed([OUTPUTS[c].name for c in found.grounds.table_channels])
    chances = {candidate.name: candidate.probability for candidate in found.candidates}
    onward = [_next(found.next_run[0])] if found.next_run else []
    if found.verdict == "named":
        names = " and ".join(f"{plain_name(c.name)} ({chance(c.probability)})" for c in found.causes)
        others = [f"{plain_name(name)} ({chance(chances[name])})" for name in found.grounds.beside]
        more = [f"Beside it, one of: {', '.join(others)}"] if others else []
        worth = gain_words(found.gain, found.main_channel)
        held_out = [Statement(f"On held-out conditions {worth}", "gain")] if worth else []
        seen = f"{upper(names)} is detected in {channels}, among explanations that are adequate"
        if found.grounds.barred is not None and found.grounds.beside:
            first = upper(plain_name(found.grounds.beside[0]))
            more = [*more, f"{first} is not named: {note_text(found.grounds.barred)}"]
        return _sentences([seen, *held_out, *more, *onward])
    if found.verdict == "one_of":
        names = ", ".join(f"{plain_name(c.name)} ({chance(c.probability)})" for c in found.causes)
        barred = found.grounds.barred if found.grounds.form_matters is None else None
        why = "" if barred is None else f": {note_text(barred)}"
        if len(found.causes) == 1:
            return _sentences([f"Most probable: {names}, but not sure enough for a name{why}", *onward])
        named = f"{upper(plain_name(found.causes[0].name))} is not named{why}" if why else ""
        in_all = [c for c in found.causes if c.probability > _IN_ALL]
        open_causes = [c for c in found.causes if c not in in_all]
        sentence = f"One of {names}: {channels} of these rows cannot separate them"
        if in_all and open_causes:
            sure, open_ones = (
                ", ".join(f"{plain_name(c.name)} ({chance(c.probability)})" for c in part)
                for part in (in_all, open_causes)
            )
            sentence = (
                f"In every adequate explanation: {sure}. Beside or instead of it {open_ones}: {channels} of these rows "
                "cannot separate them"
            )
        elif in_all:
            sentence = f"In every adequate explanation: {names}; that is not sure enough for names"
        return _sentences([sentence, named, *onward])
    if found.verdict == "unexplained":
        left, best = found.grounds.lack_of_fit.worst, found.grounds.most_probable
        tried = listed([f"{plain_name(f)} ({chance(chances[f])})" for f in best if f in chances]) or "no cause"
        where = [f"The most probable set, {tried}, is off most in {findings_text(left)}"] if left else []
        if found.adequacy is not None:
            where.insert(0, adequacy_words(found.adequacy).capitalize())
        return _sentences(
            [
                f"No cause of the library, alone or with two others, explains {channels} to within what repeats "
                "scatter and a right model may miss",
                *where,
            ]
        )
    return _sentences([f"No cause is detectable in {channels}: the soil within the laboratory's spread explains them"])


def named_words(found: Diagnosis, chances: Mapping[str, float]) -> list[Statement]:
    """Return the sentences of "named"."""
    alike = found.grounds.confounded
    causes = " and ".join(f"{_cause_named(cause, _explains(found))}: {size_text(cause)}" for cause in found.causes)
    statements: list[str | Statement] = [Statement(causes, "cause")]
    if free := found.grounds.free_form:
        statements.append(f"{upper(plain_name(free[0]))} acts by another formula than the listed ones, over {free[1]}")
    if worth := gain_words(found.gain, found.main_channel):
        statements.append(Statement(f"On held-out runs {worth}", "gain"))
    if found.grounds.beside:
        statements.append(f"A further cause acts: {_alternatives(found.grounds.beside, chances)}")
    statements += rival_words(alike, chances)
    if alike and (runs := deciding_runs(found)):
        statements.append(_next(runs[0]))
    return _sentences(statements)


def one_of_words(found: Diagnosis, chances: Mapping[str, float], none: float) -> list[Statement]:
    """Return the sentences of "one_of"."""
    families, barred = [cause.name for cause in found.causes], found.grounds.barred
    likely = f"with probability {chance(1.0 - none)}"
    statements: list[str | Statement]
    if len(families) == 1:
        best = f"{plain_name(families[0])} ({chance(chances[families[0]])})"
        statements = [f"A cause acts ({likely}), most probably {best}"]
        if barred is None:
            statements.append(f"That is not sure enough for a name{_unlisted_words(found.adequacy)}")
    elif peak_bars(found):
        statements = [f"A cause acts ({likely}): {listed([plain_name(family) for family in families], 'or')}"]
    else:
        sure = [family for family in families if chances[family] > _SURE]
        acts = "Several causes act" if len(sure) > 1 else "A cause acts"
        statements = [f"{acts} ({likely}): {_alternatives(families, chances)}"]
        if barred is None and ((why := _unlisted_words(found.adequacy)) or sure):
            statements.append(f"None is sure enough for a name{why}")
    together = [
        f"{listed([plain_name(f) for f in cause_set.causes])} ({chance(cause_set.probability)})"
        for cause_set in found.sets
        if len(cause_set.causes) > 1 and cause_set.probability >= _TOGETHER_AT
    ]
    if together:
        statements.append(f"Several may act together: {'; '.join(together)}")
    if barred is not None:
        rare = f", and {chance(chances[families[0]])} if it seldom does" if peak_bars(found) else ""
        statements.append(f"{upper(plain_name(families[0]))} is not named: {note_text(barred)}{rare}")
    statements += rival_words([family for family in found.grounds.confounded if family not in families], chances)
    if found.next_run:
        alone = all(run.naming_chance is None for run in found.next_run) or any(run.decides for run in found.next_run)
        statements += [*([] if alone else ["No single run decides"]), _next(found.next_run[0])]
    return _sentences(statements)


def _next(run: NextRun) -> Statement:
    return Statement(f"Next: {step_text(run)}", "next")


def rival_words(families: Sequence[str], chances: Mapping[str, float]) -> list[str]:
    """Return how well families with a similar signature are separated: by their posterior probability.

    Those below 5 % are separated by these data; the others are not.
    """
    open_ = [f for f in families if chances.get(f, 0.0) >= _OPEN_AT]
    closed = [f for f in families if f not in open_]
    sentences = []
    if open_:
        each = [f"{plain_name(f)} ({chance(chances[f])})" for f in open_]
        sentences.append(f"{upper(listed(each))} would fit almost as well")
    if closed:
        each = [f"{plain_name(f)} ({chance(chances.get(f, 0.0))})" for f in closed]
        verb = "has a similar signature, but is" if len(each) == 1 else "have similar signatures, but are"
        sentences.append(f"{upper(listed(each))} {verb} separable in these data")
    return sentences


def _unlisted_words(judged: Adequacy | None) -> str:
    """Return that something unlisted may act, where that is what keeps a name back."""
    if judged is None or 1.0 - judged.listed < _UNLISTED_AT:
        return ""
    return f": an unknown cause may act ({chance(1.0 - judged.listed)})"


def refusal_words(found: Diagnosis) -> str:
    """Return which set is the best of the library, and why it is refused; empty where the verdict is another."""
    if found.verdict != "unexplained" or found.grounds.undecided is not None:
        return ""
    best = found.grounds.most_probable or next((cause_set.causes for cause_set in found.sets), ())
    why = "it does not explain these data"
    if found.grounds.barred is not None:
        why = note_text(found.grounds.barred)
    elif found.adequacy is not None:
        why = adequacy_words(found.adequacy)
    name = listed([plain_name(family) for family in best]) or "no cause"
    return f"Best of the library, refused: {name}. Reason: {why}."


def unexplained_words(
    judged: Adequacy,
    worst: Sequence[Finding],
    best: Sequence[str],
    soils: tuple[Sequence[str], Sequence[str]] | None,
    why: Note | None = None,
) -> list[Statement]:
    """Return the sentences of "unexplained".

    Parameters
    ----------
    worst : sequence of Finding
        Largest residual of the simulation with calibrated soil, as it leads the list of them; may be empty.
    best : sequence of str
        Families of that set.
    soils : two sequences of str, optional
        Runs that ask for one soil, and those that ask for another.
    why : Note, optional
        What leaves them unexplained where lack of fit does not.
    """
    tried = f", not even {listed([plain_name(f) for f in best])}," if best else ""
    statements: list[str | Statement] = [
        f"Neither the soil nor any set of causes in the library{tried} explains these runs: {adequacy_words(judged)}"
    ]
    if why:
        statements = [f"These runs are not explained: {note_text(why)}"]
    if worst:
        where = "; ".join(
            f"{ROLES[finding.channel].name}, {place_text(finding.place)} ({abs(finding.statistic):.1f} sigma)"
            for finding in worst
        )
        statements.append(f"With calibrated soil the simulation is off most in {where}")
    if soils:
        first_runs, other_runs = (listed(runs) for runs in soils)
        statements.append(
            f"Runs {first_runs} ask for another soil than {other_runs}: if these are two terrains, "
            "diagnose them as two campaigns"
        )
    if why:
        statements.append(Statement("Next: check zeros, signs and configuration, and the soil in terrain.toml", "next"))
    return _sentences(statements)


def nothing_words(
    chances: Mapping[str, float], none: float, sizes: Mapping[str, Detectable], wrong: Sequence[Finding]
) -> list[Statement]:
    """Return the sentences of "nothing_detectable"; `sizes` by family."""
    statements: list[str | Statement] = [
        Statement(f"No cause is detected (no cause: {chance(none)}): soil and noise explain these runs", "headline")
    ]
    best = max(chances, key=lambda family: chances[family], default="")
    if best and chances[best] > _WORTH_SAYING:
        statements = [
            f"No cause is distinguishable from chance (no cause: {chance(none)})",
            f"The most probable one is {plain_name(best)} ({chance(chances[best])})",
            Statement("Next: drive another run", "next"),
        ]
    shown = [
        f"{_with_article(plain_name(name))} of {letter(d.parameter)} = {d.value:.3g}{_unit(d.unit)}"
        for name, d in sizes.items()
    ]
    if shown:
        examples = listed(shown[:_MOST_EXAMPLES], "or")
        statements.append(f"A cause may still act: {examples} or more would be detected in half of such campaigns")
    if wrong:
        statements.append(f"The largest residual is in {findings_text(wrong[:1])}")
    return _sentences(statements)


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'aeio' else 'a'} {name}"


def want_words(not_identifiable: Mapping[str, Note]) -> list[Statement]:
    """Return the causes that are not identifiable, with the reason; empty where only the usual reasons apply."""
    by_reason: dict[str, list[str]] = {}
    for family, why in not_identifiable.items():
        if why.code not in _USUAL:
            by_reason.setdefault(note_text(why), []).append(plain_name(family))
    return _sentences(
        [
            Statement(
                f"{listed(families)} {'is' if len(families) == 1 else 'are'} not identifiable from these runs: {why}",
                "want",
            )
            for why, families in by_reason.items()
        ]
    )


def _explains(found: Diagnosis) -> bool:
    """Return whether no held-out error speaks against saying that a named cause explains the misfit."""
    return found.gain is None or falling_channel(found) is not None


def _cause_named(cause: Cause, explains: bool) -> str:
    form = f"; {cause.form} most probable, {chance(cause.form_probability)}" if cause.form else ""
    verb = "explains the misfit" if explains else "acts"
    return f"{plain_name(cause.name)} {verb} ({chance(cause.probability)}{form})"


def reduction_in(gain: Gain, channel: str) -> Reduction:
    """Return by how much the held-out error of a channel falls, with its interval where it is known."""
    if channel == gain.channel:
        return Reduction(gain.reduction_percent, gain.interval95)
    if channel in gain.reductions:
        return gain.reductions[channel]
    known = channel in gain.base and channel in gain.extended and gain.base[channel].R0 > 0
    percent = 100 * (1 - gain.extended[channel].R0 / gain.base[channel].R0) if known else float("nan")
    return Reduction(percent, (float("nan"), float("nan")))


def gain_words(gain: Gain | None, first: str = "") -> str:
    """Return the change of the held-out errors, without a full stop; empty where it is not known.

    `first` is the channel that leads, if not the gain's.
    """
    first = first or (gain.channel if gain is not None else "")
    change = reduction_in(gain, first) if gain is not None else None
    if gain is None or change is None or not isfinite(change.percent):
        return ""
    low, high = change.interval95
    others = [channel for channel in gain.base if channel != first]
    falls, size = ("falls", 1.0) if change.percent >= 0 else ("grows", -1.0)
    low, high = sorted((size * low, size * high))
    between = f"{low:.0f} to {high:.0f}" if isfinite(low) and isfinite(high) else ""
    stays = abs(change.percent) < NO_CHANGE
    if stays:
        words = f"stays as it is ({between} %)" if between else "stays as it is"
    else:
        words = f"{falls} by {size * change.percent:.0f}{f' ({between})' if between else ''} %"
    changes = [f"the error of {OUTPUTS[first].name} {words}"]
    for channel in others:
        before, after = gain.base[channel].R0, gain.extended[channel].R0
        if before > 0:
            fell = 100 * (1 - after / before)
            verb = "falls " if fell >= 0 else "grows "
            verb = "" if not stays and (fell >= 0) == (size > 0) else verb
            changes.append(f"{'that ' if verb else ''}of {OUTPUTS[channel].name} {verb}by {abs(fell):.0f} %")
    return listed(changes)


def alternatives(causes: Sequence[tuple[str, float]]) -> str:
    """Return causes, each with its probability, that are not parted: "and" between those that act for sure."""
    sure, others = ([name for name, p in causes if (p > _SURE) == acts] for acts in (True, False))
    if not sure:
        return listed(others, "or")
    return listed(sure) + (f", perhaps with {listed(others, 'or')}" if others else "")


def _alternatives(families: Sequence[str], chances: Mapping[str, float]) -> str:
    return alternatives([(f"{plain_name(family)} ({chance(chances[family])})", chances[family]) for family in families])


def findings_text(found: Sequence[Finding]) -> str:
    """Return findings as channel, place, size and sigmas."""
    return "; ".join(
        f"{ROLES[finding.channel].name}, {place_text(finding.place)}: "
        f"{finding.size:+.3g} {ROLES[finding.channel].unit_text} ({abs(finding.statistic):.1f} sigma)"
        for finding in found[:_MOST_EXAMPLES]
    )


def adequacy_words(judged: Adequacy) -> str:
    """Return by how much an explanation is adequate or not, as it reads within a sentence."""
    if not isfinite(judged.statistic):
        return "whether anything explains them is not known"
    if judged.measure == "probability":
        return f"an unknown cause acts with a probability of {chance(judged.statistic)}"
    return f"the lack of fit is {number(judged.statistic)}, the threshold {number(judged.threshold)}"


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _sentences(statements: Sequence[str | Statement]) -> list[Statement]:
    all_of = [
        statement if isinstance(statement, Statement) else Statement(statement) for statement in statements if statement
    ]
    return [statement._replace(text=f"{upper(without_powers(statement.text))}.") for statement in all_of]
