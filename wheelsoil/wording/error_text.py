"""What a cause that is an error of measurement does, in a sentence with its size: for headlines and figures."""

from __future__ import annotations

import re
from math import isfinite

from model.diagnosis import Cause
from model.effects import EFFECTS, Effect
from wheelsoil.wording.numbers import measured, number

_BY_SIGN = re.compile(r"\{([\w ]+)/([\w ]+)\}")


def error_text(cause: Cause, channel: str) -> str:
    """Return what a cause does to a reading, with its size; `channel` in words. Empty where its effect has no text."""
    text = EFFECTS.get(cause.key, Effect).error_text
    if not text or not cause.parameters:
        return ""
    first = cause.parameters[0]
    low, high = first.interval95
    size = f"{measured(abs(first.value), first.sigma)} {first.unit}".removesuffix(" 1")
    if isfinite(low) and isfinite(high):
        ends = sorted((abs(low), abs(high))) if low * high > 0 else (low, high)
        size = f"{size} ({' to '.join(measured(end, first.sigma) for end in ends)})"
    text = _BY_SIGN.sub(r"\1" if first.value > 0 else r"\2", text)
    return text.format(channel=channel, size=size, percent=f"{number(100 * abs(first.value), 2)} %")
