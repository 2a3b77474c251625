"""What causes cost, in a sentence and a table: the report's and the analyst's page's."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from wheelsoil.wording.figures import figure_interval, figure_value
from wheelsoil.wording.names import listed, plain_name
from wheelsoil.wording.numbers import load_text, number
from wheelsoil.workflows.cause_cost import USUAL_SLIP
from wheelsoil.workflows.key_figures import KeyFigure, figure_of_cost

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wheelsoil.workflows.cause_cost import CausesCost, Cost, Driving

COST_HEAD = ("quantity", "slip", "without", "with", "difference", "95 % interval", "unit")
_QUANTITIES = {
    "drawbar_pull": ("drawbar pull", 1.0),
    "driving_torque": ("driving torque", 1.0),
    "sinkage": ("sinkage", 1e3),
    "tractive_efficiency": ("tractive efficiency", 100.0),
}
_PHYSICAL = (
    "The same soil, load and slip, with and without: what the wheel loses or gains through the cause. (In the first "
    "figure the line without a cause has a soil of its own, calibrated to the runs.)"
)
_MEASURED = (
    "The wheel loses nothing: the cause is in the measurement. The difference is the error of the reading at the same "
    "soil, load and slip."
)


def cost_title(found: CausesCost) -> str:
    """Return the title of the table."""
    return f"With and without {listed([plain_name(cause.name) for cause in found.causes])}"


def costs_nothing(found: CausesCost) -> bool:
    """Return whether no cost, and no end of its interval, is more than nothing."""
    return not any(abs(x) > 0 for cost in found.costs for x in (cost.difference, *cost.difference95))


def cost_meaning(found: CausesCost) -> str:
    """Return what the difference is."""
    if costs_nothing(found):
        error = {cause.kind for cause in found.causes} == {"measurement"}
        return f"Costs nothing in steady driving{': an error of measurement' if error else ''}."
    return _MEASURED if {cause.kind for cause in found.causes} == {"measurement"} else _PHYSICAL


def driving_text(driving: Driving) -> str:
    """Return for which driving a cost holds."""
    speed = f" and {driving.speed_mps:.1f} m/s" if isfinite(driving.speed_mps) else ""
    passage = f", passage {driving.passage:.0f} over the soil" if driving.passage > 1 else ""
    return f"Steady driving at {load_text(driving.load_n)}{speed}{passage}"


def cost_note(found: CausesCost) -> str:
    """Return for which driving it holds, and what the interval is of."""
    cause = "the cause" if len(found.causes) == 1 else "the causes"
    return (
        f"{driving_text(found.driving)}, "
        f"by the recommended model. Without {cause}, efficiency is highest at slip {found.best_slip:.2f}. "
        "Interval: of the causes' sizes, soil held."
    )


def cost_sentence(costs: Sequence[Cost], slip: float = USUAL_SLIP) -> str:
    """Return what causes change at one slip, without a full stop: "drawbar pull −110 N (−117 to −96), ..."."""
    texts = []
    for cost in costs:
        if cost.slip == slip and abs(cost.difference) > 0:
            figure = figure_of_cost(cost)
            ends = "" if (ends := figure_interval(figure)) == "–" else f" ({ends})"
            texts.append(f"{_QUANTITIES[cost.quantity][0]} {figure_value(figure)} {figure.unit}{ends}")
    return f"at slip {slip:g} {listed(texts)}" if texts else ""


def cost_rows(found: CausesCost) -> list[list[str | KeyFigure]]:
    """Return a row for each quantity and slip, with the columns of `COST_HEAD`; none where it costs nothing."""
    rows: list[list[str | KeyFigure]] = []
    for cost in () if costs_nothing(found) else found.costs:
        name, factor = _QUANTITIES[cost.quantity]
        figure = figure_of_cost(cost)
        values = [number(factor * cost.without), number(factor * cost.with_causes)]
        rows.append([name, f"{cost.slip:.2f}", *values, figure, figure_interval(figure, " … "), figure.unit])
    return rows
