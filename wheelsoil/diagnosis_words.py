"""Names and numbers of a diagnosis as the terminal and the report write them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite

from daq.shown import probability as probability
from model.diagnosis.channel_words import INPUT_FIELDS
from model.diagnosis.result import CauseSet, Detectable, Finding, Gain
from model.diagnosis.verdict_words import SUMS
from model.effects import EFFECTS

FINDING_NOTE = (
    "Median there: of measured less simulated, as the panels show it. Size of the shape: what that shape (a hat over "
    "the range, or what grows as it says) adds by itself at its largest, after the soil was re-calibrated beside it "
    "and the shapes that stand out more were taken out. The two can have opposite signs: a soil that makes up for a "
    "misfit in one range pushes the curve off in another. Sigmas: "
    "the size over its standard deviation, which allows for correlated noise, errors of speed and load, and the soil."
)
MISREAD_NOTE = "As if misread: the error of that input, measured less true, that would look so; there need not be one."


def finding_note(note: str, found: Iterable[Finding]) -> str:
    """Return a note on findings, with what an error of an input means where one is among them."""
    return f"{note} {MISREAD_NOTE}" if any(one.channel in INPUT_FIELDS for one in found) else note


def plain_name(name: str) -> str:
    """Return the name of a family or a channel as people write it."""
    return name.replace("_", " ")


def effect_name(key: str) -> str:
    """Return family and form of an effect of the library, or the key of one that is not in it."""
    effect = EFFECTS.get(key)
    if effect is None:
        return plain_name(key)
    return f"{plain_name(effect.name)} ({effect.form})" if effect.form else plain_name(effect.name)


NO_GAIN = "No cause was chosen for any of the runs left out, so that there is nothing to gain."


def nothing_chosen(gain: Gain) -> bool:
    """Return whether the choice fell on no cause each time."""
    return bool(gain.chosen) and not any(gain.chosen)


def reduction(gain: Gain) -> tuple[str, float, float]:
    """Return whether R0 falls or grows, and between what, in percent of the base's; the size is that of the gain."""
    low, high = gain.interval95
    return ("falls", low, high) if gain.reduction_percent >= 0 else ("grows", -high, -low)


CAN_BE_SEEN = "Can be seen, cannot be named"
CANNOT_BE_SEEN = "Cannot be seen"


def not_named(cannot_tell: Mapping[str, str], sizes: Mapping[str, Detectable]) -> dict[str, dict[str, str]]:
    """Return what is never named, for want of what: by `CAN_BE_SEEN` and `CANNOT_BE_SEEN`.

    Parameters
    ----------
    cannot_tell : mapping family -> why
    sizes : mapping effect key -> Detectable
        Smallest sizes that would be found.
    """
    seen = {family_of(key) for key, least in sizes.items() if isfinite(least.value)}
    by_title: dict[str, dict[str, str]] = {CAN_BE_SEEN: {}, CANNOT_BE_SEEN: {}}
    for family, why in cannot_tell.items():
        by_title[CAN_BE_SEEN if family in seen else CANNOT_BE_SEEN][family] = why
    return {title: texts for title, texts in by_title.items() if texts}


def family_of(key: str) -> str:
    """Return the family of an effect of the library, or the key of one that is not in it."""
    effect = EFFECTS.get(key)
    return effect.name if effect else key


def set_name(one: CauseSet) -> str:
    """Return a set of causes as people write it."""
    return " + ".join(map(plain_name, one.causes)) or "no cause"


def parameter_name(key: str, name: str) -> str:
    """Return the name of a cause's parameter; of a combination, what it is made of."""
    return SUMS.get(key, {}).get(name, name)
