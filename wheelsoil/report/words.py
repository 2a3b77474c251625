"""Numbers and names as sentences and tables write them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daq import Quantity, unit_suffix, unit_text
from wheelsoil.report.figures import STYLES
from wheelsoil.wording.names import SOIL_LETTERS

PARAMETERS = {
    "H_m": "H",
    "m1": "m₁",
    "m2": "m₂",
    "p": "p = m₁ + m₂",
    "n1": "n₁",
    **SOIL_LETTERS,
}
"""The textbook's letters."""

_FORMS = {key: one.label for key, one in STYLES.items()} | {"second_order": "second order"}
_SIGNS = {"ln_mu": "ln μ", "H2_m": "H₂", "c1": "c₁", "c2": "c₂", "angle_rad": "angle"}
_POWERS = str.maketrans("0123456789n+-", "⁰¹²³⁴⁵⁶⁷⁸⁹ⁿ⁺⁻")

_UNITS = {unit_suffix(quantity.value): unit_text(quantity.value) for quantity in Quantity}


def letter(name: str) -> str:
    """Return the textbook's letter of a parameter, or else its name in words, without the unit."""
    known = PARAMETERS.get(name) or _SIGNS.get(name)
    return known or (name if "=" in name else named_with_unit(name)[0])


def form_name(text: str) -> str:
    """Return the form of an effect as people write it, also in brackets after its family: "slip sinkage (Vasil'ev)"."""
    return re.sub(r"\w+", lambda found: _FORMS.get(found[0], found[0]), text)


def measured(value: float, sigma: float) -> str:
    """Return a value with as many digits as its standard error has two, or with four where it has none."""
    if not (math.isfinite(value) and math.isfinite(sigma) and sigma > 0):
        return number(value, 4)
    decimals = max(1 - math.floor(math.log10(sigma)), 0)
    return f"{value:,.{decimals}f}".replace(",", "\u202f").replace("-", "−")


def number(value: float, digits: int = 3) -> str:
    """Return a number with `digits` significant digits and no exponent where that is readable; "–" for none."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if size < -4 or size >= 7:
        return f"{value:.{digits - 1}e}"
    rounded = f"{value:,.{max(digits - 1 - size, 0)}f}"
    return rounded.replace(",", "\u202f").replace("-", "−")


def count(value: int) -> str:
    """Return a whole number with thin spaces between thousands."""
    return f"{value:,}".replace(",", "\u202f")


def signed(value: float, form: str) -> str:
    """Return a number in a format of Python with a proper minus, and no sign before zero."""
    text = f"{value:{form}}"
    return text.replace("-", "−") if any(digit in "123456789" for digit in text) else text.lstrip("+-")


def interval(low: float, high: float, digits: int = 3) -> str:
    """Return "low … high", "–" where there is none."""
    return f"{number(low, digits)} … {number(high, digits)}" if math.isfinite(low) and math.isfinite(high) else "–"


def named_with_unit(name: str) -> tuple[str, str]:
    """Return "drawbar pull noise", "N" of ``drawbar_pull_noise_n``; no unit where the name ends in none."""
    plain, _, last = name.rpartition("_")
    known = plain and last in _UNITS
    return (plain if known else name).replace("_", " "), _UNITS[last] if known else ""


def unit(text: str) -> str:
    """Return a unit as people write it; a plain number has none."""
    return "" if text == "1" else re.sub(r"\^\(?([\dn+-]+)\)?", lambda power: power[1].translate(_POWERS), text)


def listed(names: Sequence[str], joint: str = "and") -> str:
    """Return "a, b and c"."""
    return " ".join([", ".join(names[:-1]), joint, names[-1]]) if len(names) > 1 else "".join(names)
