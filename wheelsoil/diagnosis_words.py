"""Names and numbers of a diagnosis as the terminal and the report write them."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from model.diagnosis.result import CauseSet, Detectable, Gain
from model.diagnosis.verdict_words import SUMS
from model.effects import EFFECTS

CHANNEL_NAMES = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
CHANNEL_UNITS = {"dp": "N", "t": "N m", "z": "m"}
FINDING_UNITS = {"drawbar_pull": "N", "driving_torque": "N m", "sinkage": "m"}
FINDING_NOTE = (
    "Of recorded runs a size is no mean: it is the height of a shape of measured less simulated (a hat over that "
    "range, or what grows as it says), where the shape is largest, once the soil and the shapes that stand out more "
    "were taken out: the panels below show what is left before any of that. Of a bench table it is the mean of the "
    "rows. Sigmas: that over its standard deviation, which allows for correlated noise, errors of speed and load, and "
    "the soil."
)


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


def probability(value: float) -> str:
    """Return a probability; never 1 or 0, which no data give."""
    if not isfinite(value):
        return "-"
    text = f"{value:.3f}"
    return {"1.000": ">0.999", "0.000": "<0.001"}.get(text, text)


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
