"""What a verdict rests on as sentences: soil, prior, lack of fit, error of form, rivals, what is not detectable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Literal, NamedTuple

from daq import OUTPUTS, ROLES, Note, number, without_powers
from model import DiagnosisCode, LackCode
from model.diagnosis import Adequacy, Detectable, Diagnosis, Finding, FormUsed, Grounds
from model.effects import EFFECTS, Effect
from wheelsoil.wording.names import (
    SOIL_LETTERS,
    chance,
    family_of,
    letter,
    listed,
    page_unit,
    place_text,
    plain_name,
    upper,
    with_chance,
)
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import after_value

REFUTED_AT = 3.0
"""One-sigmas of the laboratory by which a soil's parameter may be off."""
VERDICT_WORDS = {"one_of": "one of several", "nothing_detectable": "nothing detectable", "unexplained": "unexplained"}
NOT_IN_THESE_DATA = "not detectable in these data"
"""Of an effect whose minimum detectable size is beyond what is plausible."""
_MOST_EXAMPLES = 3
_WORTH_SAYING = 0.2
HALF = 0.5  # probability of no cause below which it is not said that none is detected
OPEN_AT = 0.05
"""Posterior probability from which on a confounded family would fit almost as well."""
_UNLISTED_AT = 0.05
"""Probability of something unlisted from which on it is said to keep a name back."""
USUAL = (LackCode.SAME_PASS, LackCode.PRESSURE_UNKNOWN)
"""What is wanting in nearly every campaign: it stands in the table, not in the sentence."""


class Statement(NamedTuple):
    """A sentence of a verdict, and which one it is where other places show that by itself."""

    text: str
    about: Literal["", "headline", "cause", "gain", "want", "next", "as_if"] = ""


def sentences(statements: Sequence[str | Statement]) -> list[Statement]:
    """Return statements, those that are not empty, each with a capital letter and a full stop."""
    all_of = [part if isinstance(part, Statement) else Statement(part) for part in statements if part]
    return [part._replace(text=f"{upper(without_powers(part.text))}.") for part in all_of]


def chances_of(found: Diagnosis) -> dict[str, float]:
    """Return the posterior probability of each candidate, "none" among them."""
    return {candidate.name: candidate.probability for candidate in found.candidates}


def laboratory_words(found: Diagnosis) -> list[Statement]:
    """Return the sentence that the laboratory's soil is refuted; empty where it is not, or nothing explains the data.

    Of runs it is judged beside every probable set of causes; of tables beside the one that extends the simulation.
    """
    if found.verdict == "unexplained":
        return []
    several = len(found.soils) > 1
    of_runs = [
        (refuted.campaign, refuted.parameter, refuted.sigmas, f" ({chance(refuted.probability)})")
        for refuted in found.grounds.refuted_soil
    ]
    of_tables = [
        (soil.campaign, name, sigmas, "")
        for soil in found.soils
        for name, sigmas in soil.off_laboratory.items()
        if found.grounds.table_channels and abs(sigmas) > REFUTED_AT
    ]
    off = [
        f"{SOIL_LETTERS[name]} is {abs(sigmas):.1f} sigma {'above' if sigmas > 0 else 'below'}"
        f"{f' in {campaign}' if several else ''}{likely}"
        for campaign, name, sigmas, likely in (*of_runs, *of_tables)
    ]
    return sentences([f"the laboratory's soil does not hold here: {listed(off)} its value"] if off else [])


def prior_words(found: Diagnosis) -> list[Statement]:
    """Return the sentence that the verdict depends on the prior; empty where it does not."""
    shifts = found.grounds.prior_shifts
    if not shifts or found.verdict not in ("named", "one_of"):
        return []
    first, families = shifts[0], [plain_name(family) for family in shifts[0].families]
    others = {"named": f"{listed(families)} named", "one_of": f"one of {', '.join(families) or 'several'}"}
    turned = dict.fromkeys(shift.family for shift in shifts[1:] if shift.family != first.family)
    more = f"; the prior of {listed([plain_name(family) for family in turned])} changes it, too" if turned else ""
    return sentences(
        [
            f"The verdict depends on the prior: at {'three times' if first.factor > 1 else 'a third of'} the prior "
            f"odds of {plain_name(first.family)} it would be: {(VERDICT_WORDS | others)[first.verdict]}{more}"
        ]
    )


def instead_words(found: Diagnosis) -> list[Statement]:
    """Return what the laboratory may have wrong in place of a cause; empty where nothing is."""
    return sentences(
        [
            f"A laboratory whose {SOIL_LETTERS[soil.parameter]} is {abs(soil.sigmas):.1f} sigma "
            f"{'too low' if soil.sigmas > 0 else 'too high'} would explain these runs in place of "
            f"{listed([plain_name(x.family) for x in found.grounds.soil_instead if x.soil == soil], 'or')}, with a "
            f"probability of {chance(soil.probability)}"
            for soil in dict.fromkeys(x.soil for x in found.grounds.soil_instead)
        ]
    )


def adequacy_words(judged: Adequacy, *, soils: bool = False) -> str:
    """Return by how much an explanation is adequate or not, as it reads within a sentence; of perhaps two `soils`."""
    if not isfinite(judged.statistic):
        return "whether anything explains them is not known"
    if judged.measure == "probability":
        who = "there are two soils, or an unknown cause acts," if soils else "an unknown cause acts"
        return f"{who} with a probability of {chance(judged.statistic)}"
    return f"the lack of fit is {number(judged.statistic)}, the threshold {number(judged.threshold)}"


def unlisted_words(judged: Adequacy | None) -> str:
    """Return that something unlisted may act, where that is what keeps a name back."""
    if judged is None or 1.0 - judged.listed < _UNLISTED_AT:
        return ""
    return f": an unknown cause may act ({chance(1.0 - judged.listed)})"


def unexplained_words(found: Diagnosis, judged: Adequacy) -> list[Statement]:
    """Return the sentences of "unexplained"."""
    best, soils, why = found.grounds.most_probable, found.grounds.terrains, found.grounds.barred
    tried = f", not even {listed([plain_name(f) for f in best])}," if best else ""
    none_does = f"Neither the soil nor any set of causes in the library{tried} explains these runs"
    statements: list[str | Statement] = [
        f"These runs are not explained: {note_text(why)}"
        if why
        else f"{none_does}: {adequacy_words(judged, soils=bool(soils))}"
    ]
    for worst in found.what_is_wrong[:1]:
        where = f"{ROLES[worst.channel].name}, {place_text(worst.place)} ({abs(worst.statistic):.1f} sigma)"
        statements.append(f"With calibrated soil the simulation is off most in {where}")
    if soils:
        statements.append(
            f"Runs {listed(soils[0])} ask for another soil than {listed(soils[1])}: if these are two terrains, "
            "diagnose them as two campaigns"
        )
    if why:
        statements.append(Statement("Next: check zeros, signs and configuration, and the soil in terrain.toml", "next"))
    return sentences(statements)


def findings_text(found: Sequence[Finding]) -> str:
    """Return findings as channel, place, size and sigmas."""
    return "; ".join(
        f"{ROLES[finding.channel].name}, {place_text(finding.place)}: "
        f"{finding.size:+.3g} {ROLES[finding.channel].unit_text} ({abs(finding.statistic):.1f} sigma)"
        for finding in found[:_MOST_EXAMPLES]
    )


def rival_words(families: Sequence[str], chances: Mapping[str, float]) -> list[str]:
    """Return how well families with a similar signature are separated: by their posterior probability.

    Those below 5 % are separated by these data; the others are not.
    """
    open_, closed = (
        [with_chance(f, p) for f in families for p in [chances.get(f, 0.0)] if (p >= OPEN_AT) == is_open]
        for is_open in (True, False)
    )
    verb = "has a similar signature, but is" if len(closed) == 1 else "have similar signatures, but are"
    names_by_text = {"would fit almost as well": open_, f"{verb} separable in these data": closed}
    return [f"{upper(listed(names))} {what}" for what, names in names_by_text.items() if names]


def form_statements(grounds: Grounds) -> list[Statement]:
    """Return what was taken for the error of form where repeats do not say it, and which verdicts hang on it."""
    matters = grounds.form_matters
    hangs = [f"the verdict depends on it: {note_text(matters)}"] if matters is not None else []
    return [*map(Statement, form_error_words(grounds.form_errors)), *sentences(hangs)]


def form_error_words(used: Sequence[FormUsed]) -> list[str]:
    """Return what is given or assumed for the error of form; empty where the table itself says it."""
    taken = [form_error for form_error in used if form_error.share is not None]
    if not taken:
        return []
    sizes = listed(
        [
            f"{factor * form_error.size:.2g} {unit} in {OUTPUTS[form_error.channel].name}"
            for form_error in taken
            for factor, unit in [page_unit(form_error.channel)]
        ]
    )
    share = f"{100 * (taken[0].share or 0.0):.3g} % of load, load x radius and radius ({sizes})"
    if taken[0].basis == "given":
        return [f"The error of form of a right model is given as {share}."]
    why = "there are neither repeats nor _sigma columns, and --error-of-form was not given"
    return [f"The error of form of a right model is assumed to be {share}: {why}."]


def undetectable(sizes: Mapping[str, Detectable], notes: Sequence[Note] = ()) -> set[str]:
    """Return the effects whose minimum detectable size is beyond the bounds of what is plausible.

    Bounds in N and N m are of a wheel under 10 kN; of a lighter one they go with its load.
    """
    share = next((note.values["share"] for note in notes if note.code == DiagnosisCode.PRIOR_SCALED), 1.0)
    return {key for key, size in sizes.items() if not _is_plausible(key, size, share)}


def _is_plausible(key: str, size: Detectable, share: float) -> bool:
    bounds = next((p for p in EFFECTS.get(key, Effect).parameters if p.name == size.parameter), None)
    if bounds is None or not isfinite(size.value):
        return isfinite(size.value)
    factor = share if size.unit in ("N", "N m") else 1.0
    return factor * bounds.lower <= size.value <= factor * bounds.upper


def detectable_by_family(found: Diagnosis) -> dict[str, Detectable]:
    """Return the minimum detectable size of each family: of its first form with a plausible one."""
    first: dict[str, Detectable] = {}
    hidden = undetectable(found.minimum_detectable, found.notes)
    for key, size in found.minimum_detectable.items():
        if key not in hidden:
            first.setdefault(family_of(key), size)
    return first


def detectable_words(sizes: Mapping[str, Detectable]) -> str:
    """Return from which size on the first families would be detected, without a full stop; `sizes` by family."""
    shown = [
        f"{'an' if name[0] in 'aeio' else 'a'} {plain_name(name)} of {letter(d.parameter)} = "
        f"{d.value:.3g}{after_value(d.unit)}"
        for name, d in list(sizes.items())[:_MOST_EXAMPLES]
    ]
    return f"{listed(shown, 'or')} or more would be detected in half of such campaigns"


def verdict_words(verdict: str, chances: Mapping[str, float]) -> str:
    """Return a verdict in a few words; where "no cause" of the candidates is improbable, that none is sure."""
    if verdict != "nothing_detectable" or not chances.get("none", 1.0) < HALF:
        return VERDICT_WORDS.get(verdict, verdict)
    best = _most_probable(chances)
    return f"no cause is sure: {best} is most probable" if best else "no cause is sure"


def _most_probable(chances: Mapping[str, float]) -> str:
    """Return the most probable cause, with its probability; "" where there is none."""
    best = max((name for name in chances if name != "none"), key=chances.__getitem__, default="")
    return best and with_chance(best, chances[best])


def unsure_words(found: Diagnosis) -> str:
    """Return which cause is most probable and why it has no name, where "no cause" is improbable; "" elsewhere."""
    chances = chances_of(found)
    best = _most_probable(chances)
    if found.verdict != "nothing_detectable" or not best or chances.get("none", 1.0) >= HALF:
        return ""
    idle = found.gain is not None and not found.gain.log_likelihood_gain > 0
    return (
        f"No cause is sure (no cause: {chance(chances['none'])}): {best} is most probable, "
        f"but {'held-out data do not confirm it' if idle else 'chance may explain these data too'}"
    )


def nothing_words(found: Diagnosis, chances: Mapping[str, float], none: float) -> list[Statement]:
    """Return the sentences of "nothing_detectable"."""
    unsure = unsure_words(found)
    statements: list[str | Statement] = [
        Statement(
            unsure or f"No cause is detected (no cause: {chance(none)}): soil and noise explain these runs", "headline"
        ),
        *[Statement("Next: drive another run", "next")] * bool(unsure),
    ]
    best = max(chances, key=lambda family: chances[family], default="")
    if not unsure and best and chances[best] > _WORTH_SAYING:
        statements = [
            f"No cause is distinguishable from chance (no cause: {chance(none)})",
            f"The most probable one is {with_chance(best, chances[best])}",
            Statement("Next: drive another run", "next"),
        ]
    if sizes := detectable_by_family(found):
        statements.append(f"A cause may still act: {detectable_words(sizes)}")
    if found.what_is_wrong:
        statements.append(f"The largest residual is in {findings_text(found.what_is_wrong[:1])}")
    return sentences(statements)


def wanting(found: Diagnosis) -> dict[str, Note]:
    """Return why each cause is not identifiable, without the usual reasons and without what these data separate."""
    separable = {f for f in found.grounds.confounded if chances_of(found).get(f, 0.0) < OPEN_AT}
    return {f: why for f, why in found.not_identifiable.items() if why.code not in USUAL and f not in separable}


def want_words(found: Diagnosis) -> list[Statement]:
    """Return the causes that are not identifiable, with the reason."""
    by_reason: dict[str, list[str]] = {}
    for family, why in wanting(found).items():
        by_reason.setdefault(note_text(why), []).append(plain_name(family))
    return sentences(
        [
            Statement(
                f"{listed(families)} {'is' if len(families) == 1 else 'are'} not identifiable from these runs: {why}",
                "want",
            )
            for why, families in by_reason.items()
        ]
    )
