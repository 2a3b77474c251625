"""The tables of a fit: what `wheelsoil fit` prints and a notebook shows."""

from __future__ import annotations

from typing import Any

from daq import OUTPUTS, number
from model.fit import CampaignFit, Criteria, ModelFit
from wheelsoil.wording.notes import note_text

Table = tuple[list[str], list[list[str]]]
"""Head and rows."""


def coefficients(fit: CampaignFit) -> Table:
    """Return every model's coefficients with their intervals; the first two columns are names."""
    head = ["model", "coefficient", "value", f"{100 * fit.options.confidence:g} % interval", "sigma", "unit"]
    return head, [row for model in fit.models for row in _estimates(model)]


def criteria_table(fit: CampaignFit, channel: str) -> Table:
    """Return M0, R0, R2 and the load's ratio of every model that was judged by a channel; no rows where none was."""
    of = OUTPUTS[channel]
    head = [of.name, "M0 %", f"R0 {of.unit_text}", "R2", "samples", "load Eq.7/measured", "least", "most"]
    scored = [model for model in fit.models if channel in model.criteria and model.criteria[channel].samples]
    return head, [_criteria(model, channel) for model in scored]


def remarks(fit: CampaignFit) -> list[str]:
    """Return remarks on the numbers: soil, interpretation, excluded samples, parameters that are not separable."""
    reading = "load-consistent" if fit.options.reading == "balanced" else "as published"
    first = f"soil {fit.soil.name}, slip sinkage {reading}, criteria at slips from {fit.slip_threshold:g} on"
    reasons = {reason_text(m.criteria["dp"]) for m in fit.models if "dp" in m.criteria} - {""}
    warnings = [f"{m.name}: {note_text(w)}" for m in fit.models for w in m.notes]
    return [first, *map(note_text, fit.notes), *sorted(reasons), *warnings]


def reason_text(criteria: Criteria) -> str:
    """Return why a criterion is not known; empty where all are."""
    return note_text(criteria.reason) if criteria.reason else ""


def criteria_json(model: ModelFit) -> dict[str, dict[str, Any]]:
    """Return the criteria of every channel as plain values."""
    return {
        channel: {**vars(criteria), "reason": reason_text(criteria)} for channel, criteria in model.criteria.items()
    }


def _estimates(model: ModelFit) -> list[list[str]]:
    held = [[model.name, name, f"{number(value)} (held)", "-", "-", ""] for name, value in model.fixed.items()]
    if not model.estimates:
        return held or [[model.name, "-", "-", "-", "-", ""]]
    return held + [
        [
            model.name,
            estimate.name,
            number(estimate.value) + (" (bound)" if estimate.at_bound else ""),
            f"{number(estimate.interval[0])} .. {number(estimate.interval[1])}",
            number(estimate.sigma, 2),
            estimate.unit,
        ]
        for estimate in model.estimates
    ]


def _criteria(model: ModelFit, channel: str) -> list[str]:
    score, ratio = model.criteria[channel], model.load_ratio
    return [
        model.name,
        number(score.M0_percent),
        number(score.R0_N),
        number(score.R2),
        f"{score.samples}",
        *(number(value) for value in (ratio.median, ratio.lowest, ratio.highest)),
    ]
