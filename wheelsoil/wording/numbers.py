"""Numbers as pages and sentences write them: one rule for the digits of a value with a standard error."""

from __future__ import annotations

import math
import re

_POWERS = str.maketrans("0123456789n+-", "⁰¹²³⁴⁵⁶⁷⁸⁹ⁿ⁺⁻")
_THIN = "\u202f"
_E_NOTATION = re.compile(r"(?<![\w.])[-−]?\d(?:\.\d+)?e[+−-]\d\d(?!\w)")
_THOUSANDS = re.compile(r"(?<![\w.,])\d{1,3}(?:,\d{3})+(?![\w,])")
_UNGROUPED = re.compile(r"(?<![\w.,/-])\d{4,9}(?= (?:: 1|k?N|kg|k?Pa|m|mm|s|ms|Hz|samples|frames)\b)")
_MINUS = re.compile(r"(?:^|(?<=[\s(\[]))(?<!= )-(?=\.?\d)")
_PLUS_MINUS = re.compile(r"\+-(?=\s*[\d.])")
_TIMES = re.compile(r"(?<=\w) x (?=radius\b)")
_SUM = re.compile(r"\bm1 (\+|and) m2\b")
_BEFORE_UNIT = re.compile(r"(?:(?<=\d)|^) (?=(?:%|°|σ|N m|k?N|kg|k?Pa|mm?|m/s|m?s|Hz|rad|deg)(?![\w’']))")
_PERCENT = re.compile(r"(?<=\d)%(?!\w)")


def measured(value: float, sigma: float) -> str:
    """Return a value with as many digits as its standard error has two, or with four where it has none."""
    if not (math.isfinite(value) and math.isfinite(sigma) and sigma > 0):
        return number(value, 4)
    decimals = max(1 - math.floor(math.log10(sigma)), 0)
    return signed(value, f",.{decimals}f").replace(",", _THIN)


def number(value: float, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, "–" for none.

    Below 0.0001 and from 10⁹ on it has a power of ten.
    """
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if size < -4 or size >= 9:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa} × 10{str(int(power)).translate(_POWERS)}".replace("-", "−")
    return f"{value:,.{max(digits - 1 - size, 0)}f}".replace(",", _THIN).replace("-", "−")


def typeset(text: str) -> str:
    """Return a sentence of the terminal with its numbers as pages write them.

    Thin spaces between thousands, a true minus, ×, ± and a space before %, no exponents. What follows "= " is left, as
    it is there to be copied into a file.
    """
    text = _E_NOTATION.sub(_without_exponent, text)
    text = _THOUSANDS.sub(lambda found: found[0].replace(",", _THIN), text)
    text = _SUM.sub(r"m₁ \1 m₂", _TIMES.sub(" × ", text))
    text = _UNGROUPED.sub(lambda found: f"{int(found[0]):,}".replace(",", _THIN), text)
    return percent_apart(_PLUS_MINUS.sub("±", _MINUS.sub("−", text)))


def unbroken(text: str) -> str:
    """Return a text in which no line ends between a number and its unit."""
    return _BEFORE_UNIT.sub("\u00a0", text).replace("N m", "N\u00a0m")


def percent_apart(text: str) -> str:
    """Return a text with a space before each percent sign behind a number."""
    return _PERCENT.sub(" %", text)


def _without_exponent(found: re.Match[str]) -> str:
    digits = sum(map(str.isdigit, found[0].partition("e")[0]))
    return number(float(found[0].replace("−", "-")), digits)


def signed(value: float, form: str) -> str:
    """Return a number in a format of Python with a proper minus, and no sign before zero."""
    text = f"{value:{form}}"
    return text.replace("-", "−") if any(digit in "123456789" for digit in text) else text.lstrip("+-")


def load_text(*ends_n: float) -> str:
    """Return a load, or from where to where loads go, in kN; in N where all are below 1 kN, as on a test rig."""
    factor, name, form = (1e-3, "kN", ".1f") if max(ends_n) >= 1e3 else (1.0, "N", ".0f")
    return f"{' to '.join(dict.fromkeys(f'{factor * end:{form}}' for end in ends_n))} {name}"


def estimate(value: float, sigma: float, interval95: tuple[float, float], unit: str = "") -> str:
    """Return a value with its 95 % interval in brackets and its unit, all with the digits of `measured`."""
    low, high = interval95
    known = math.isfinite(low) and math.isfinite(high)
    band = f" ({measured(low, sigma)} to {measured(high, sigma)})" if known else ""
    return f"{measured(value, sigma)}{band}{after_value(unit)}"


def count(value: int) -> str:
    """Return a whole number with thin spaces between thousands."""
    return f"{value:,}".replace(",", "\u202f")


def interval(low: float, high: float, digits: int = 3) -> str:
    """Return "low … high", "–" where there is none."""
    return f"{number(low, digits)} … {number(high, digits)}" if math.isfinite(low) and math.isfinite(high) else "–"


def after_value(unit: str) -> str:
    """Return a unit as it follows its value; "" for a plain number."""
    return "" if unit in ("", "1") else f" {unit}"


def unit(text: str) -> str:
    """Return a unit as people write it; a plain number has none."""
    return "" if text == "1" else re.sub(r"\^\(?([\dn+-]+)\)?", lambda power: power[1].translate(_POWERS), text)
