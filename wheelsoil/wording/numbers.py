"""Numbers as pages and sentences write them: one rule for the digits of a value with a standard error."""

from __future__ import annotations

import math


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


def signed(value: float, form: str) -> str:
    """Return a number in a format of Python with a proper minus, and no sign before zero."""
    text = f"{value:{form}}"
    return text.replace("-", "−") if any(digit in "123456789" for digit in text) else text.lstrip("+-")


def estimate(value: float, sigma: float, interval95: tuple[float, float], unit: str = "") -> str:
    """Return a value with its 95 % interval in brackets and its unit, all with the digits of `measured`."""
    low, high = interval95
    known = math.isfinite(low) and math.isfinite(high)
    band = f" ({measured(low, sigma)} to {measured(high, sigma)})" if known else ""
    return f"{measured(value, sigma)}{band}{'' if unit in ('', '1') else f' {unit}'}"
