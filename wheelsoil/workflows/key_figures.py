"""Quantities that several surfaces show: key, value, unit, rule of its digits, and of which model it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan
from typing import Literal

from daq import OUTPUTS
from model.diagnosis import Cause, Diagnosis, Gain
from wheelsoil.workflows.cause_cost import Cost
from wheelsoil.workflows.traction import Traction

Digits = Literal["three", "by sigma", "percent", "probability", "three decimals", "change", "percent change"]
Z95 = 1.959964
"""One-sigmas from a value to either end of its 95 % interval."""
CALIBRATED_SOIL, WITH_CAUSES = "calibrated_soil", "with_causes"
MODELS = {"named": "recommended", "one_of": "most_probable"}


@dataclass(frozen=True)
class KeyFigure:
    """A quantity that is shown.

    Attributes
    ----------
    key : str
        The same on every surface.
    value : float
        Unrounded; a probability or a share as a fraction.
    unit : str
        "" for a plain number, a probability and a share.
    digits : str
        Rule by which it is written; see `wheelsoil.wording.figures`.
    model : "calibrated_soil", "laboratory_soil", "recommended", "most_probable" or ""
        Which model it is of; "" for what is measured.
    sigma : float
        Its standard error; NaN where it has none.
    interval95 : (float, float)
        NaN where there is none.
    """

    key: str
    value: float
    unit: str
    digits: Digits = "three"
    model: str = ""
    sigma: float = nan
    interval95: tuple[float, float] = (nan, nan)


def figures_of_diagnosis(found: Diagnosis) -> dict[str, KeyFigure]:
    """Return what a diagnosis shows: confidence, sizes of the causes, errors on held-out data, candidates."""
    figures = [*_confidence(found), *_candidates(found)]
    model = MODELS.get(found.verdict, MODELS["named"])
    figures += [figure for cause in found.causes for figure in sizes_of(cause, model)]
    figures += errors_of(found.gain, found.verdict).values() if found.gain is not None else []
    return {figure.key: figure for figure in figures}


def _confidence(found: Diagnosis) -> Iterator[KeyFigure]:
    """Return how sure the verdict is: of the least probable named cause, that a cause acts, or that none does."""
    none = next((candidate.probability for candidate in found.candidates if candidate.name == "none"), nan)
    sure = {
        "named": min((cause.probability for cause in found.causes), default=nan),
        "one_of": 1.0 - none,
        "nothing_detectable": none,
    }
    if found.verdict in sure:
        yield KeyFigure("confidence", sure[found.verdict], "", "probability")


def _candidates(found: Diagnosis) -> Iterator[KeyFigure]:
    if found.verdict != "unexplained":
        for candidate in found.candidates:
            yield KeyFigure(f"candidate.{candidate.name}", candidate.probability, "", "probability")


def sizes_of(cause: Cause, model: str = MODELS["named"]) -> list[KeyFigure]:
    """Return the parameters of a cause, of a model of `MODELS`."""
    return [
        KeyFigure(
            f"cause.{cause.name}.{parameter.name}",
            parameter.value,
            "" if parameter.unit == "1" else parameter.unit,
            "by sigma",
            model,
            parameter.sigma,
            parameter.interval95,
        )
        for parameter in cause.parameters
    ]


def errors_of(gain: Gain, verdict: str) -> dict[tuple[str, str], KeyFigure]:
    """Return R0 on held-out data by channel and `CALIBRATED_SOIL`, or `WITH_CAUSES` where the verdict has some."""
    with_causes = gain.extended if verdict in MODELS else {}
    return {
        (channel, which): KeyFigure(
            f"error.{channel}.{which}", scores[channel].R0, OUTPUTS[channel].unit_text, model=model
        )
        for channel in gain.base
        for which, scores, model in (
            (CALIBRATED_SOIL, gain.base, CALIBRATED_SOIL),
            (WITH_CAUSES, with_causes, MODELS.get(verdict, "")),
        )
        if channel in scores
    }


def figures_of_traction(found: Traction) -> dict[str, KeyFigure]:
    """Return the pull at slip 0.2 and drawbar coefficient there, and the best of both.

    A pull of the loads and speeds as driven has another key than one of steady driving at one load.
    """
    figures = []
    model = found.model if found.model == MODELS["named"] else ""
    if found.pull is not None:
        pull, at = found.pull, "{}_at_slip_0.2" if found.model else "measured_{}_near_slip_0.2"
        figures.append(KeyFigure(at.format("pull"), pull.pull_n, "N", model=found.model, interval95=pull.interval95))
        coefficient = pull.pull_n / pull.load_n
        figures.append(
            KeyFigure(at.format("drawbar_coefficient"), coefficient, "", "three decimals", model=found.model)
        )
    best, efficiency = found.drawbar_coefficient, found.efficiency
    figures += [
        KeyFigure("drawbar_coefficient", best, "", "three decimals", model=model),
        KeyFigure("tractive_efficiency", efficiency, "", "percent", model=model),
    ]
    return {figure.key: figure for figure in figures if figure.value == figure.value}


_UNITS_OF_COST: dict[str, tuple[float, str, Digits]] = {
    "1": (1.0, "points", "percent change"),
    "m": (1e3, "mm", "change"),
}


def figure_of_cost(cost: Cost) -> KeyFigure:
    """Return what causes change in a quantity at one slip; of the efficiency a fraction, written in points of 1 %."""
    factor, unit, digits = _UNITS_OF_COST.get(cost.unit, (1.0, cost.unit, "change"))
    low, high = cost.difference95
    return KeyFigure(
        f"cost.{cost.quantity}.at_slip_{cost.slip:.2f}",
        factor * cost.difference,
        unit,
        digits,
        MODELS["named"],
        interval95=(factor * low, factor * high),
    )
