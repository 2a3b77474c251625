"""What a cause that is an error of measurement does, in a sentence with its size: for headlines and figures."""

from __future__ import annotations

from math import isfinite

from model.diagnosis import Cause
from model.effects import EFFECTS, Effect
from wheelsoil.wording.numbers import measured, number


def error_text(cause: Cause, channel: str) -> str:
    """Return what a cause does to a reading, with its size; `channel` in words. Empty where its effect has no text."""
    effect = EFFECTS.get(cause.key, Effect)
    if not effect.error_text or not cause.parameters:
        return ""
    first = cause.parameters[0]
    low, high = first.interval95
    size = f"{measured(abs(first.value), first.sigma)} {first.unit}".removesuffix(" 1")
    if isfinite(low) and isfinite(high):
        ends = sorted((abs(low), abs(high))) if low * high > 0 else (low, high)
        size = f"{size} ({' to '.join(measured(end, first.sigma) for end in ends)})"
    percent = f"{number(100 * abs(first.value), 2)} %"
    return effect.error_sentence(above=first.value > 0, channel=channel, size=size, percent=percent)
