"""How a model looks wherever it is drawn: one table for the report and for the analyst's page.

Colours are Okabe and Ito's, and one for a model of one's own; every model also has its own dash and marker, so that a
black-and-white print is legible.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Style:
    """How one model looks in every figure.

    Attributes
    ----------
    colour : str
        "#rrggbb"
    dash, symbol : str
        Plotly's.
    """

    label: str
    colour: str
    dash: str
    symbol: str


STYLES: dict[str, Style] = {
    "wong": Style("Wong", "#D55E00", "dash", "circle"),
    "vasilev": Style("Vasil'ev", "#0072B2", "dot", "square-open"),
    "lyasko": Style("Lyasko", "#009E73", "solid", "diamond"),
    "ding": Style("Ding", "#CC79A7", "dashdot", "triangle-up"),
    "chosen": Style("chosen", "#7A5FD0", "longdashdot", "star"),
}
BY_HAND = Style("by hand", STYLES["chosen"].colour, "solid", "star")
"""A model of one's own before it is fitted: its colour is that of the fitted one."""
_SPARE = Style("", "#777777", "longdash", "hexagon")


def style(model: str) -> Style:
    """Return a model's style; an unknown model gets a spare one under its own name."""
    return STYLES.get(model) or Style(model, _SPARE.colour, _SPARE.dash, _SPARE.symbol)


def styles_script() -> bytes:
    """Return the table as a module of JavaScript."""
    table = {name: asdict(one) for name, one in STYLES.items()}
    parts = {"MODELS": table, "BY_HAND": asdict(BY_HAND), "SPARE": asdict(_SPARE)}
    return "".join(f"export const {name} = {json.dumps(value)};\n" for name, value in parts.items()).encode()
