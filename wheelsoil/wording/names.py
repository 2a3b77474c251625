"""Names and probabilities as sentences and tables write them."""

from __future__ import annotations

from model.effects import EFFECTS


def plain_name(name: str) -> str:
    """Return the name of a family or a channel as people write it."""
    return name.replace("_", " ")


def effect_name(key: str) -> str:
    """Return family and form of an effect of the library, or the key of one that is not in it."""
    effect = EFFECTS.get(key)
    if effect is None:
        return plain_name(key)
    return f"{plain_name(effect.name)} ({effect.form})" if effect.form else plain_name(effect.name)


def family_of(key: str) -> str:
    """Return the family of an effect of the library, or the key of one that is not in it."""
    effect = EFFECTS.get(key)
    return effect.name if effect else key


def parameter_name(key: str, name: str) -> str:
    """Return the name of a cause's parameter; of a combination, what it is made of."""
    return EFFECTS[key].spelled(name) if key in EFFECTS else name


def chance(p: float) -> str:
    """Return a probability; never 1 or 0, which no data give."""
    return "> .999" if p > 0.9995 else "< .001" if p < 0.0005 else f"{p:.3f}".lstrip("0")
