"""The one renderer of quantities that several surfaces show."""

from __future__ import annotations

from html import escape
from math import isfinite
from typing import TYPE_CHECKING

from wheelsoil.wording.names import chance
from wheelsoil.wording.numbers import measured, number, signed

if TYPE_CHECKING:
    from wheelsoil.workflows.key_figures import KeyFigure


def figure_value(figure: KeyFigure) -> str:
    """Return the value of a figure as text, without its unit; a percentage has its sign, a change in percent none."""
    return _written_as(figure, figure.value)


def _written_as(figure: KeyFigure, value: float) -> str:
    """Return a value by the rule of a figure."""
    if figure.digits == "probability":
        return chance(value)
    if figure.digits in ("change", "percent change"):
        text = number(100 * value if figure.digits == "percent change" else value, 2)
        return f"+{text}" if value > 0 and text != "0" else text
    if figure.digits == "percent":
        return f"{signed(100 * value, '.1f')} %" if isfinite(value) else "–"
    if figure.digits == "three decimals":
        return signed(value, ".3f") if isfinite(value) else "–"
    return measured(value, figure.sigma) if figure.digits == "by sigma" else number(value)


def figure_interval(figure: KeyFigure, joint: str = " to ") -> str:
    """Return the 95 % interval of a figure with the digits of its value; "–" where there is none."""
    low, high = figure.interval95
    if not (isfinite(low) and isfinite(high)):
        return "–"
    return joint.join(_written_as(figure, end) for end in (low, high))


def figure_html(figure: KeyFigure) -> str:
    """Return the value of a figure as HTML with its key and its unrounded value."""
    return f'<span data-key="{escape(figure.key)}" data-value="{figure.value!r}">{escape(figure_value(figure))}</span>'
