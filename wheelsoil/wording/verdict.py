"""The verdict in sentences: what it is, how large, how sure, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, nan
from typing import NamedTuple

from daq import OUTPUTS, Note, without_powers
from model import DiagnosisCode, LackCode
from model.diagnosis import Cause, Diagnosis, Gain, NextRun, Reduction
from model.effects import EFFECTS
from wheelsoil.wording.error_text import error_text
from wheelsoil.wording.grounds_text import (
    OPEN_AT,
    Statement,
    adequacy_words,
    chances_of,
    findings_text,
    form_statements,
    instead_words,
    laboratory_words,
    nothing_words,
    prior_words,
    rival_words,
    sentences,
    unexplained_words,
    unlisted_words,
    unsure_words,
    want_words,
    wanting,
)
from wheelsoil.wording.names import chance, letter, listed, parameter_name, plain_name, stretches, upper, with_chance
from wheelsoil.wording.notes import note_text, step_text
from wheelsoil.wording.numbers import estimate

MOST_WORDS = 25
"""Of a headline."""
_MOST_NAMES = 3
_MOST_LACKING = 5
NO_CHANGE = 0.5
"""Percent by which an error may fall or grow and still be said to stay."""
_FALLS = ("grows", "falls")
_TOGETHER_AT = 0.1
"""Probability from which on a set of several causes is said."""
_IN_ALL = 0.99
"""Probability above which a family is said to be in every explanation."""
_SURE = 0.95
"""Probability above which a cause that is not named acts, whichever others do."""
NOT_JUDGED = "No cause is judged: these runs are probably not of one soil."


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
        return sentences([f"nothing can be decided: {note_text(grounds.undecided)}", *onward])
    if (note := several_terrains(found)) is not None:
        return _as_if_of_one_soil(found, note)
    statements = [*_verdict_of_table(found), *form_statements(grounds)] if grounds.table_channels else _of_runs(found)
    before_next = next((i for i, statement in enumerate(statements) if statement.about == "next"), len(statements))
    first = statements[:1]
    rest = [*statements[1:before_next], *instead_words(found), *prior_words(found), *statements[before_next:]]
    coasted = dict.fromkeys(test.run or "a static test" for test in found.static if test.test == "coasting")
    tests = [f"how the wheel coasts on firm ground is used as data: {', '.join(coasted)}"] if coasted else []
    cautions = sentences([*tests, *(note_text(note) for note in grounds.cautions)])
    soil = laboratory_words(found)
    return [*first, *cautions, *soil, *rest] if found.verdict == "unexplained" else [*first, *soil, *rest, *cautions]


def headline_of(found: Diagnosis) -> str:
    """Return the verdict in one short sentence, with the gain on held-out runs where there is one."""
    causes = [c for c in found.causes if c.probability >= OPEN_AT or found.causes[0].probability <= _SURE]
    names, chances = [_name_of(cause, found) for cause in causes], [cause.probability for cause in causes]
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
            rows = "rows" if found.grounds.table_channels else "runs"
            return f"{upper(listed(_with_the_peak(found.causes), 'or'))}: these {rows} do not decide."
        best = f"Most probably {names[0]}, but not named"
        return in_few_words(f"{best}: {note_text(why)}.", f"{best}: the reason is below.")
    if found.verdict == "one_of" and len(names) > 1:
        sure = all(cause.probability > _SURE for cause in causes)
        doubt = "not sure enough for names" if sure else "these data cannot separate them"
        sentence = f"{upper(alternatives(list(zip(names, chances, strict=True))))}: {doubt}"
    elif found.verdict == "one_of":
        sentence = f"Most probably {names[0]}, but not sure enough for a name"
    elif found.verdict == "unexplained":
        if groups := groups_of_runs(found):
            ask = f"{groups.first} ask{'s' if groups.single else ''}"
            return f"No known cause explains these data: {ask} for another soil than {groups.second}."
        return "No known cause explains these data: do not rely on the model."
    elif apart := list(runs_apart(found)):
        lie = "lies" if len(apart) == 1 else "lie"
        none_is = f"No cause is {'sure' if unsure_words(found) else 'detected'}"
        whole = f"{none_is}, but {listed(apart)} {lie} apart from the other runs."
        return in_few_words(whole, f"{none_is}, but {len(apart)} runs lie apart from the others.")
    else:
        return f"{unsure_words(found) or 'No cause is detected: soil and noise explain these data'}."
    fall = _fall_of(found)
    return in_few_words(f"{sentence}. With the first, {fall}." if fall else f"{sentence}.", f"{sentence}.")


def model_title(found: Diagnosis) -> str:
    """Return what the model with the first cause is called: most probable if it is twice as probable as the next."""
    if found.verdict == "named":
        return "Recommended"
    chances = [cause.probability for cause in found.causes[:2]]
    return "Most probable" if len(chances) < 2 or chances[0] >= 2 * chances[1] else "Possible"


def in_few_words(whole: str, short: str) -> str:
    """Return a whole headline where it is of at most 25 words, or else a short one."""
    return whole if len(whole.split()) <= MOST_WORDS else short


def _with_the_peak(causes: Sequence[Cause]) -> list[str]:
    """Return the names of the first causes with the stress peak last, in plain words."""
    others = [plain_name(cause.name) for cause in causes if not EFFECTS[cause.key].is_usual()]
    return [*others[: _MOST_NAMES - 1], "a stress peak ahead of the wheel's bottom"]


def _named_headline(found: Diagnosis, names: Sequence[str]) -> str:
    """Return the name with the error that falls for certain; where none does, with the size."""
    s = "s" if len(names) == 1 else ""
    verb = f"explain{s} the misfit" if _explains(found) else f"act{s}"
    sentence = f"{upper(listed(names))} {verb}"
    sizes = "; ".join(_finding_or_size(cause, found.main_channel) for cause in found.causes)
    return in_few_words(f"{sentence}: {_fall_of(found) or sizes}.", f"{sentence}.")


def falling_channel(found: Diagnosis) -> str | None:
    """Return the channel whose held-out error falls for certain with the causes: the main one, if it does; or None."""
    gain, main = found.gain, found.main_channel
    if gain is None:
        return None
    others = sorted(gain.base, key=lambda channel: reduction_in(gain, channel).interval95[0], reverse=True)
    changes = {channel: reduction_in(gain, channel) for channel in (main, *others)}
    return next((c for c, by in changes.items() if by.percent >= NO_CHANGE and by.falls), None)


def stated_channel(found: Diagnosis) -> str:
    """Return the channel whose held-out error stands first wherever a verdict's gain is stated."""
    return (falling_channel(found) if found.verdict in ("named", "one_of") else None) or found.main_channel


def _fall_of(found: Diagnosis) -> str:
    """Return by how much the error falls that falls for certain; "" where none does."""
    channel = falling_channel(found)
    if found.gain is None or channel is None:
        return ""
    by = reduction_in(found.gain, channel)
    return f"the {OUTPUTS[channel].name} error on held-out data falls by {by.percent:.0f} %"


def _finding_or_size(cause: Cause, channel: str) -> str:
    text = error_text(cause, OUTPUTS[channel].name)
    return f"{text[0].lower()}{text[1:]}" if text else size_text(cause)


def not_corrected(found: Diagnosis | None, *roles: str) -> str:
    """Return which errors under a verdict are in a figure of some measured roles; "" for none."""
    causes = found.causes if found is not None and found.verdict in ("named", "one_of") else ()
    names = [
        plain_name(each.name)
        for each in causes
        if each.kind == "measurement" and not set(EFFECTS[each.key].shows).isdisjoint(roles)
    ]
    joined = listed(names, "or" if found is not None and found.verdict == "one_of" else "and")
    return joined and f"not corrected for {joined}"


def details_of(found: Diagnosis) -> list[str]:
    """Return the sentences of the verdict without what the headline, the gain and the next step say."""
    several = len(found.causes) > 1
    sizes = "; ".join(f"{plain_name(cause.name)}: " * several + _form_and_size(cause) for cause in found.causes)
    sizes = upper(sizes) if sizes[1:2].islower() else sizes
    elsewhere = ("headline", "gain", "next", "as_if", *["cause"] * _headline_has_size(found))
    statements = [statement for statement in statements_of(found) if statement.about not in elsewhere]
    texts = [f"{sizes}." if statement.about == "cause" else statement.text for statement in statements]
    wants = [i for i, statement in enumerate(statements) if statement.about == "want"]
    if wants:
        lacking = [plain_name(family) for family in wanting(found)]
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
    return _caution(found, DiagnosisCode.SEVERAL_TERRAINS)


def runs_apart(found: Diagnosis | None) -> dict[str, Note]:
    """Return the runs whose pull or torque is off by a constant that no other run has, with the note on each."""
    cautions = found.grounds.cautions if found else ()
    return {note.values["run"]: note for note in cautions if note.code == DiagnosisCode.RUN_APART}


def doubt_of_the_peak(found: Diagnosis) -> Note | None:
    """Return how much less probable a name is where the stress peak usually lies ahead; None where it stays."""
    return _caution(found, DiagnosisCode.LESS_BESIDE_USUAL)


def like_radius(found: Diagnosis) -> tuple[Note, ...]:
    """Return the notes on causes of the verdict and of probable sets that a larger wheel radius looks the same as."""
    return _cautions(found, DiagnosisCode.LIKE_RADIUS)


def against_tests(found: Diagnosis) -> tuple[Note, ...]:
    """Return the notes on static tests that the runs contradict."""
    return _cautions(found, DiagnosisCode.STATIC_CONTRADICTS)


def _name_of(cause: Cause, found: Diagnosis) -> str:
    """Return the name of a cause, with the wheel radius that looks the same."""
    larger = next((note.values["larger_m"] for note in like_radius(found) if note.values["family"] == cause.name), None)
    than = "larger" if larger and larger > 0 else "smaller"
    same = f" (or a wheel radius {than} by {1e3 * abs(larger):.2g} mm)" if larger else ""
    return f"{plain_name(cause.name)}{same}"


def _caution(found: Diagnosis, code: DiagnosisCode) -> Note | None:
    return next(iter(_cautions(found, code)), None)


def _cautions(found: Diagnosis, code: DiagnosisCode) -> tuple[Note, ...]:
    return tuple(note for note in found.grounds.cautions if note.code == code)


class Groups(NamedTuple):
    """Runs of the one soil and of the other as text, whether the first is a single run, whether the second; all ids."""

    first: str
    second: str
    single: bool
    single_second: bool
    runs: tuple[Sequence[str], Sequence[str]]


def groups_of_runs(found: Diagnosis | None) -> Groups | None:
    """Return the runs of the one soil and of the other; None where they are not known."""
    if found is None:
        return None
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
    return Groups(first, second, len(groups[0]) == 1, len(groups[1]) == 1, (groups[0], groups[1]))


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
    cautions = sentences([note_text(caution) for caution in others])
    as_if = Statement(f"As if of one soil: {first.text[0].lower()}{first.text[1:]}", "as_if")
    return [
        Statement(_not_one_soil(found, note), "headline"),
        *sentences([note_text(note)]),
        as_if,
        *(statement if statement in cautions else statement._replace(about="as_if") for statement in rest),
        *sentences([Statement(f"Next: {terrains_step(found)}", "next")]),
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


def deciding_runs(found: Diagnosis) -> tuple[NextRun, ...]:
    """Return the next runs, without those that only separate from a name what these data separate already."""
    rivals, chances = found.grounds.confounded, chances_of(found)
    decided = found.verdict == "named" and rivals and not any(chances.get(rival, 0.0) >= OPEN_AT for rival in rivals)
    return () if decided or several_terrains(found) is not None else found.next_run


def finding_of(found: Diagnosis) -> str:
    """Return the first sentence of the verdict, without the size where it is of a single cause."""
    first = statements_of(found)[0]
    if first.about != "cause" or len(found.causes) > 1:
        return first.text
    return upper(without_powers(_cause_named(found.causes[0], found)))


def size_text(cause: Cause) -> str:
    """Return the parameters of a cause with their intervals, those without one only where no other is known."""
    known = [p for p in cause.parameters if all(map(isfinite, p.interval95))]
    return ", ".join(
        f"{letter(parameter_name(cause.key, p.name))} = {estimate(p.value, p.sigma, p.interval95, p.unit)}"
        for p in known or cause.parameters
    )


def _form_and_size(cause: Cause) -> str:
    form = f"{cause.form.capitalize()}'s form is most probable ({chance(cause.form_probability)}): "
    return form * bool(cause.form) + size_text(cause)


def _of_runs(found: Diagnosis) -> list[Statement]:
    chances = {cause.name: cause.probability for cause in found.causes} | chances_of(found)
    none = chances.pop("none", 0.0)
    if found.verdict == "named":
        statements = named_words(found, chances)
    elif found.verdict == "one_of":
        statements = one_of_words(found, chances, none)
    elif found.verdict == "unexplained" and found.adequacy is not None:
        statements = unexplained_words(found, found.adequacy)
    else:
        statements = nothing_words(found, chances, none)
    return [*statements, *want_words(found)]


def _verdict_of_table(found: Diagnosis) -> list[Statement]:
    channels, chances = listed([OUTPUTS[c].name for c in found.grounds.table_channels]), chances_of(found)
    onward = [_next(run) for run in found.next_run[:1]]
    if found.verdict == "named":
        return sentences([*_named_of_table(found, channels, chances), *onward])
    if found.verdict == "one_of":
        return sentences([*_one_of_table(found, channels), *onward])
    if found.verdict == "unexplained":
        left, best = found.grounds.lack_of_fit.worst, found.sets[0]
        tried = f"{listed(list(map(plain_name, best.causes))) or 'no cause'} ({chance(best.probability)})"
        none_does = (
            f"No cause of the library, alone or with two others, explains {channels} to within what repeats scatter "
            "and a right model may miss"
        )
        misfit = adequacy_words(found.adequacy).capitalize() if found.adequacy is not None else ""
        where = f"The most probable set, {tried}, is off most in {findings_text(left)}" if left else ""
        return sentences([none_does, misfit, where])
    nothing = f"No cause is detectable in {channels}: the soil within the laboratory's spread explains them"
    return sentences([unsure_words(found) or nothing])


def _named_of_table(found: Diagnosis, channels: str, chances: Mapping[str, float]) -> list[str | Statement]:
    statements: list[str | Statement] = [
        f"{upper(' and '.join(_with_chances(found.causes)))} is detected in {channels}, "
        "among explanations that are adequate"
    ]
    if worth := gain_words(found.gain, stated_channel(found)):
        statements.append(Statement(f"On held-out conditions {worth}", "gain"))
    return [*statements, *_beside_words(found, chances)]


def _one_of_table(found: Diagnosis, channels: str) -> list[str]:
    names = ", ".join(_with_chances(found.causes))
    barred = found.grounds.barred if found.grounds.form_matters is None else None
    why = "" if barred is None else f": {note_text(barred)}"
    if len(found.causes) == 1:
        return [f"Most probable: {names}, but not sure enough for a name{why}"]
    sure, open_ones = (
        ", ".join(_with_chances([c for c in found.causes if (c.probability > _IN_ALL) == in_all]))
        for in_all in (True, False)
    )
    not_separable = f"{channels} of these rows cannot separate them"
    sentence = f"One of {names}: {not_separable}"
    if sure and open_ones:
        sentence = f"In every adequate explanation: {sure}. Beside or instead of it {open_ones}: {not_separable}"
    elif sure:
        sentence = f"In every adequate explanation: {names}; that is not sure enough for names"
    return [sentence, f"{upper(plain_name(found.causes[0].name))} is not named{why}" if why else ""]


def _with_chances(causes: Sequence[Cause]) -> list[str]:
    return [with_chance(cause.name, cause.probability) for cause in causes]


def named_words(found: Diagnosis, chances: Mapping[str, float]) -> list[Statement]:
    """Return the sentences of "named"."""
    ahead = doubt_of_the_peak(found) is not None
    alike = [name for name in found.grounds.confounded if not (ahead and name in EFFECTS and EFFECTS[name].is_usual())]
    causes = " and ".join(f"{_cause_named(cause, found)}: {size_text(cause)}" for cause in found.causes)
    statements: list[str | Statement] = [Statement(causes, "cause")]
    if free := found.grounds.free_form:
        statements.append(f"{upper(plain_name(free[0]))} acts by another formula than the listed ones, over {free[1]}")
    if worth := gain_words(found.gain, stated_channel(found)):
        statements.append(Statement(f"On held-out runs {worth}", "gain"))
    statements += [*_beside_words(found, chances), *rival_words(alike, chances)]
    if alike and (runs := deciding_runs(found)):
        statements.append(_next(runs[0]))
    return sentences(statements)


def _beside_words(found: Diagnosis, chances: Mapping[str, float]) -> list[str]:
    """Return what else acts beside named causes, and why each cause that a rule keeps back is not named.

    What the stress peak keeps back stays with that peak: one of them acts.
    """
    beside, barred = found.grounds.beside, found.grounds.reasons
    ahead = [name for name, why in barred.items() if why.code == LackCode.PEAK_MAY_SHIFT]
    others = [name for name in beside if name not in barred or name in ahead]
    likely = listed(list(map(plain_name, others)), "or") if ahead else _alternatives(others, chances)
    sure = len(others) == len(beside) or any(chances[name] > _SURE for name in others)
    further = [f"A further cause {'acts' if sure else 'may act'}: {likely}"] * bool(others)
    names = {name: plain_name(name) if name in ahead else with_chance(name, chances[name]) for name in barred}
    return further + [f"{upper(names[x])} is not named: {_why_not(why, chances[x])}" for x, why in barred.items()]


def _why_not(why: Note, probability: float) -> str:
    """Return the rule that keeps a probable cause back; of the stress peak also the probability without that rule."""
    rare = f", and {chance(probability)} if it seldom does" if why.code == LackCode.PEAK_MAY_SHIFT else ""
    return f"{note_text(why)}{rare}"


def one_of_words(found: Diagnosis, chances: Mapping[str, float], none: float) -> list[Statement]:
    """Return the sentences of "one_of"."""
    families, barred = [cause.name for cause in found.causes], found.grounds.barred
    likely = f"with probability {chance(1.0 - none)}"
    statements: list[str | Statement]
    if len(families) == 1:
        statements = [f"A cause acts ({likely}), most probably {with_chance(families[0], chances[families[0]])}"]
        if barred is None:
            statements.append(f"That is not sure enough for a name{unlisted_words(found.adequacy)}")
    elif peak_bars(found):
        statements = [f"A cause acts ({likely}): {listed([plain_name(family) for family in families], 'or')}"]
    else:
        sure = [family for family in families if chances[family] > _SURE]
        acts = "Several causes act" if len(sure) > 1 else "A cause acts"
        statements = [f"{acts} ({likely}): {_alternatives(families, chances)}"]
        if barred is None and ((why := unlisted_words(found.adequacy)) or sure):
            statements.append(f"None is sure enough for a name{why}")
    together = [
        f"{listed([plain_name(f) for f in cause_set.causes])} ({chance(cause_set.probability)})"
        for cause_set in found.sets
        if len(cause_set.causes) > 1 and cause_set.probability >= _TOGETHER_AT
    ]
    if together:
        statements.append(f"Several may act together: {'; '.join(together)}")
    if barred is not None:
        statements.append(f"{upper(plain_name(families[0]))} is not named: {_why_not(barred, chances[families[0]])}")
        statements += [
            "Whether a step changes that cannot be foreseen: no probability of the right name is stated"
        ] * any(run.naming_barred for run in found.next_run)
    statements += rival_words([family for family in found.grounds.confounded if family not in families], chances)
    if found.next_run:
        alone = all(run.naming_chance is None for run in found.next_run) or any(run.decides for run in found.next_run)
        statements += [*([] if alone else ["No single run decides"]), _next(found.next_run[0])]
    return sentences(statements)


def refusal_words(found: Diagnosis) -> str:
    """Return which set is the best of the library, and why it is refused; empty where the verdict is another."""
    if found.verdict != "unexplained" or found.grounds.undecided is not None:
        return ""
    best = found.grounds.most_probable or next((cause_set.causes for cause_set in found.sets), ())
    judged = adequacy_words(found.adequacy) if found.adequacy is not None else "it does not explain these data"
    why = note_text(found.grounds.barred) if found.grounds.barred is not None else judged
    return f"Best of the library, refused: {listed([plain_name(f) for f in best]) or 'no cause'}. Reason: {why}."


def _next(run: NextRun) -> Statement:
    return Statement(f"Next: {step_text(run)}", "next")


def _explains(found: Diagnosis) -> bool:
    """Return whether no held-out error speaks against saying that a named cause explains the misfit."""
    return found.gain is None or falling_channel(found) is not None


def _cause_named(cause: Cause, found: Diagnosis) -> str:
    form = f"; {cause.form} most probable, {chance(cause.form_probability)}" if cause.form else ""
    verb = "explains the misfit" if _explains(found) else "acts"
    return f"{_name_of(cause, found)} {verb} ({chance(cause.probability)}{form})"


def reduction_in(gain: Gain, channel: str) -> Reduction:
    """Return by how much the held-out error of a channel falls, with its interval where it is known."""
    if channel == gain.channel:
        return Reduction(gain.reduction_percent, gain.interval95)
    return gain.reductions.get(channel) or Reduction(_fall_percent(gain, channel), (nan, nan))


def _fall_percent(gain: Gain, channel: str) -> float:
    known = channel in gain.base and channel in gain.extended and gain.base[channel].R0 > 0
    return 100 * (1 - gain.extended[channel].R0 / gain.base[channel].R0) if known else nan


def gain_words(gain: Gain | None, first: str = "") -> str:
    """Return the change of the held-out errors, without a full stop; empty where it is not known.

    `first` is the channel that leads, if not the gain's.
    """
    first = first or (gain.channel if gain is not None else "")
    change = reduction_in(gain, first) if gain is not None else None
    if gain is None or change is None or not isfinite(change.percent):
        return ""
    falls, stays = change.percent >= 0, abs(change.percent) < NO_CHANGE
    low, high = sorted(end if falls else -end for end in change.interval95)
    between = f"{low:.0f} to {high:.0f}" if isfinite(low) and isfinite(high) else ""
    by = f"by {abs(change.percent):.0f}{f' ({between})' if between else ''} %"
    words = f"stays as it is{f' ({between} %)' if between else ''}" if stays else f"{_FALLS[falls]} {by}"
    changes = [f"the error of {OUTPUTS[first].name} {words}"]
    for channel in gain.base:
        if channel != first and gain.base[channel].R0 > 0:
            fell = _fall_percent(gain, channel)
            verb = "" if not stays and (fell >= 0) == falls else f"{_FALLS[fell >= 0]} "
            changes.append(f"{'that ' if verb else ''}of {OUTPUTS[channel].name} {verb}by {abs(fell):.0f} %")
    return listed(changes)


def alternatives(causes: Sequence[tuple[str, float]]) -> str:
    """Return causes, each with its probability, that are not parted: "and" between those that act for sure."""
    sure = [name for name, p in causes if p > _SURE]
    others = [name for name, p in causes if (OPEN_AT if sure else 0.0) <= p <= _SURE]
    if not sure:
        return listed(others, "or")
    return listed(sure) + (f", perhaps with {listed(others, 'or')}" if others else "")


def _alternatives(families: Sequence[str], chances: Mapping[str, float]) -> str:
    return alternatives([(with_chance(family, chances[family]), chances[family]) for family in families])
