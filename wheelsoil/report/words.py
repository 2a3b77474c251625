"""Names, counts and intervals as pages alone write them."""

from __future__ import annotations

import math
import re

from daq import ROLES
from wheelsoil.report.figures import STYLES
from wheelsoil.wording.numbers import number

NOT_JUDGED = "No cause is judged: these runs are probably not of one soil."

_FORMS = {key: model_style.label for key, model_style in STYLES.items()} | {"second_order": "second order"}


def form_name(text: str) -> str:
    """Return the form of an effect as people write it, also in brackets after its family: "slip sinkage (Vasil'ev)"."""
    return re.sub(r"\w+", lambda found: _FORMS.get(found[0], found[0]), text)


def with_names(text: str) -> str:
    """Return a note with the channel at its beginning as people call it."""
    first, _, rest = text.partition(" ")
    return f"{ROLES[first].name} {rest}" if first in ROLES else text


def count(value: int) -> str:
    """Return a whole number with thin spaces between thousands."""
    return f"{value:,}".replace(",", "\u202f")


def interval(low: float, high: float, digits: int = 3) -> str:
    """Return "low … high", "–" where there is none."""
    return f"{number(low, digits)} … {number(high, digits)}" if math.isfinite(low) and math.isfinite(high) else "–"
