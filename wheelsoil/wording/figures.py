"""The one renderer of quantities that several surfaces show; it can record which ones it wrote."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from html import escape
from math import isfinite
from typing import TYPE_CHECKING

from wheelsoil.wording.names import chance
from wheelsoil.wording.numbers import measured, number

if TYPE_CHECKING:
    from wheelsoil.workflows.key_figures import KeyFigure

_written: ContextVar[dict[str, float] | None] = ContextVar("written", default=None)


@contextmanager
def recording_figures() -> Iterator[dict[str, float]]:
    """Record the keys and unrounded values of all figures that are written within."""
    keys: dict[str, float] = {}
    token = _written.set(keys)
    try:
        yield keys
    finally:
        _written.reset(token)


def figure_value(one: KeyFigure) -> str:
    """Return the value of a figure as text, without its unit; a percentage has its sign."""
    if (keys := _written.get()) is not None:
        keys[one.key] = one.value
    if one.digits == "probability":
        return chance(one.value)
    if one.digits == "percent":
        return f"{100 * one.value:.0f} %".replace("-", "−") if isfinite(one.value) else "–"
    if one.digits == "three decimals":
        return f"{one.value:.3f}".replace("-", "−") if isfinite(one.value) else "–"
    return measured(one.value, one.sigma) if one.digits == "by sigma" else number(one.value)


def figure_text(one: KeyFigure) -> str:
    """Return the value of a figure with its unit."""
    return f"{figure_value(one)} {one.unit}".rstrip()


def figure_interval(one: KeyFigure, joint: str = " to ") -> str:
    """Return the 95 % interval of a figure with the digits of its value; "–" where there is none."""
    low, high = one.interval95
    if not (isfinite(low) and isfinite(high)):
        return "–"
    written = [measured(end, one.sigma) if one.digits == "by sigma" else number(end) for end in (low, high)]
    return joint.join(written)


def figure_html(one: KeyFigure) -> str:
    """Return the value of a figure as HTML with its key and its unrounded value."""
    return f'<span data-key="{escape(one.key)}" data-value="{one.value!r}">{escape(figure_value(one))}</span>'
