"""The fitted coefficients, laid out as lmfit does, and how well each model predicts: the paper's Tab. 2 to 4."""

from __future__ import annotations

from itertools import combinations
from math import isfinite
from typing import Any

import numpy as np
import scipy

from daq import OUTPUTS
from model.fit import EXTENDED, CampaignFit, Estimate, ModelFit, free_parameters
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, section
from wheelsoil.report.figures import axes, line, marked_line, style
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.fit_text import criteria_json, reason_text
from wheelsoil.wording.names import letter, listed, meaning
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import count, interval, measured, number, unit
from wheelsoil.workflows.fit import model_as_json

SINGLE_LAW = (
    "Each of these fits adds one law to the laboratory's soil. The recommended model calibrates the soil together with "
    "the cause and weighs the errors of slip and load: so the same coefficient has another value there."
)
_STRONG = 0.9
_NOT_SHOWN = 0.1
"""Correlations below it are left out, as lmfit does."""
_HELD_NOTE = (
    "Held by its bound: the data ask for a value beyond it, there is no standard error, and the interval ends there. "
    "Derived: a sum of two that are fitted."
)

_READING_PAIRS = (
    "what the data leave of two coefficients together, the most correlated ones: the regions that hold both with 50 "
    "and with 95 %. In a long thin one only a combination of the two is known."
)
_STATISTICS = [
    "model",
    "method",
    "data points",
    "independent blocks",
    "variables",
    "iterations",
    "ended by",
    "scatter left",
]

_JUDGED = ("dp", "t")
_OF_CRITERIA = ("effects", "criteria", "load_ratio")


@section("coefficients", "Single-law fits: parameters")
def coefficients(inputs: ReportInputs) -> Contents:
    """Build the section: fit statistics, variables, correlations."""
    fit = inputs.fit
    limits = {model.name: _limits(fit, model) for model in fit.models}
    rows = [row for model in fit.models for row in _variables(model, limits[model.name])]
    percent = f"{100 * fit.options.confidence:g} % interval"
    head = ["model", "variable", "value", "standard error", "relative error", percent, "initial", "min", "max", "unit"]
    # What the data leave of the most correlated pair of each model: regions of 50 and 95 %.
    figures = [figure for model in fit.models if (figure := _pair(model))]
    pairs = [Panels(figures, _READING_PAIRS)] if figures else []
    blocks: list[Block] = [
        Text(SINGLE_LAW),
        Table(
            "Fit statistics",
            _STATISTICS,
            [_statistics(fit, model) for model in fit.models],
            _said_of_data(fit),
            words=("method", "ended by", "scatter left"),
        ),
        Table("Variables (the paper's Tab. 3)", [*head, "held"], rows, _HELD_NOTE, left=2, words=("unit", "held")),
        *_correlations(fit),
        *pairs,
        *(Text(f"{style(m.name).label}: {' '.join(map(meaning, m.effects))}") for m in fit.models if m.effects),
    ]
    blocks += [Text(f"{style(m.name).label}: {note_text(w)}.", "warning") for m in fit.models for w in m.notes]
    return blocks, {m.name: _numbers(fit, m, limits[m.name]) for m in fit.models}


def _statistics(fit: CampaignFit, model: ModelFit) -> list[str]:
    fitted = bool(model.estimates)
    floor = {OUTPUTS[c]: value for c, value in model.residual_floor.items() if c in fit.options.channels}
    left = [f"{number(value)} {channel.unit_text}" for channel, value in floor.items()]
    return [
        style(model.name).label,
        "Gauss–Newton" if fitted else "nothing to fit",
        count(model.samples),
        count(model.blocks.count),
        count(len([e for e in model.estimates if not e.derived])),
        count(model.iterations) if fitted else "–",
        model.stop_reason.replace("_", " "),
        ", ".join(left) or "–",
    ]


def _said_of_data(fit: CampaignFit) -> str:
    channels = listed([OUTPUTS[channel].name for channel in fit.options.channels])
    soil = "free within the laboratory's uncertainty" if fit.options.soil_prior else "the laboratory's"
    return (
        f"Fitted to the {channels} of the driven samples (slip > 0); the soil is {soil}. Neighbouring samples are "
        "correlated and the slip is measured: the intervals allow for both, not for an error that is the same in every "
        "run (zero, gain, angle, soil values)."
    )


def _limits(fit: CampaignFit, model: ModelFit) -> dict[str, tuple[float, float, float]]:
    """Return start, lower and upper bound of each variable."""
    options = fit.options
    extended = options.extended if model.name == EXTENDED else None
    law = options.forward(fit.wheel, fit.soil, model.name)
    free = free_parameters(law, options.soil_prior, extended.values if extended else None)
    return {parameter.name: (parameter.start, parameter.lower, parameter.upper) for parameter in free}


def _variables(model: ModelFit, limits: dict[str, tuple[float, float, float]]) -> list[list[str]]:
    label = style(model.name).label
    held = [
        [label if i == 0 else "", letter(name), number(value, 4), *["–"] * 6, "", "held: not shown"]
        for i, (name, value) in enumerate(model.fixed.items())
    ]
    if not model.estimates and not held:
        return [[label, "none", *["–"] * 7, "", ""]]
    return [
        *held,
        *(
            _variable("" if held or i else label, estimate, limits.get(estimate.name))
            for i, estimate in enumerate(model.estimates)
        ),
    ]


def _variable(label: str, estimate: Estimate, limit: tuple[float, float, float] | None) -> list[str]:
    share, known = relative_error(estimate), all(map(isfinite, estimate.interval))
    return [
        label,
        letter(estimate.name),
        measured(estimate.value, estimate.sigma),
        number(estimate.sigma, 2),
        f"{number(100 * share, 2)} %" if share == share else "–",
        " … ".join(measured(end, estimate.sigma) for end in estimate.interval) if known else "–",
        *(map(number, limit) if limit else ["–"] * 3),
        unit(estimate.unit),
        "by its bound" if estimate.at_bound else "derived" if estimate.derived else "",
    ]


def relative_error(estimate: Estimate) -> float:
    """Return the standard error over the value; NaN where there is none."""
    return estimate.sigma / abs(estimate.value) if estimate.value else float("nan")


def _correlations(fit: CampaignFit) -> list[Block]:
    rows = [
        [style(model.name).label, f"C({letter(a)}, {letter(b)})", f"{value:+.4f}".replace("-", "−")]
        for model in fit.models
        for (a, b), value in sorted(model.correlation.items(), key=lambda item: -abs(item[1]))
        if abs(value) >= _NOT_SHOWN
    ]
    if not rows:
        return [Text("Correlations: no two variables of one model are correlated by 0.1 or more.")]
    note = (
        f"Those below {_NOT_SHOWN} are not shown. Beyond ±{_STRONG} the two are not separable: read their "
        "sum, or fix one."
    )
    return [Table("Correlations", ["model", "between", "correlation"], rows, note, left=2)]


def _pair(model: ModelFit) -> Figure | None:
    normal, names = model.normal, list(model.normal.units)
    free = [i for i in range(len(names)) if normal.covariance[i, i] > 0]
    if len(free) < 2:
        return None
    sigma = np.sqrt(np.diag(normal.covariance))
    i, j = max(combinations(free, 2), key=lambda at: abs(normal.covariance[at]) / (sigma[at[0]] * sigma[at[1]]))
    root = np.linalg.cholesky(normal.covariance[np.ix_([i, j], [i, j])])
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    around = root @ np.array([np.cos(turn), np.sin(turn)])
    look, data = style(model.name), []
    for share, dash in ((0.5, "solid"), (0.95, "dash")):
        x, y = normal.mean[[i, j], None] + np.sqrt(scipy.special.chdtri(2, 1.0 - share)) * around
        data.append(line(x, y, f"{100 * share:.0f} %", look.colour, dash))
    data.append(marked_line(normal.mean[[i]], normal.mean[[j]], "estimate", look))
    letters = [letter(names[at]) for at in (i, j)]
    units = [unit(normal.units[names[at]]) for at in (i, j)]
    x_title, y_title = (f"{each} ({u})" if u else each for each, u in zip(letters, units, strict=True))
    title = f"{look.label}: {' and '.join(letters)}"
    return Figure(f"pair-{model.name}", title, data, axes(x_title, y_title, height=300))


def _numbers(fit: CampaignFit, model: ModelFit, limits: dict[str, tuple[float, float, float]]) -> dict[str, Any]:
    of_fit = {key: value for key, value in model_as_json(model).items() if key not in _OF_CRITERIA}
    return of_fit | {
        "estimates": model.estimates,
        "relative_error": {estimate.name: relative_error(estimate) for estimate in model.estimates},
        "limits": {name: dict(zip(("initial", "min", "max"), values, strict=True)) for name, values in limits.items()},
        "variables": len([e for e in model.estimates if not e.derived]),
        "residual_floor": {c: value for c, value in model.residual_floor.items() if c in fit.options.channels},
    }


@section("criteria", "Single-law fits: criteria side by side")
def criteria(inputs: ReportInputs) -> Contents:
    """Build the section: one table for each channel that was measured."""
    fit = inputs.fit
    measured = [c for c in _JUDGED if any(c in m.criteria and m.criteria[c].samples for m in fit.models)]
    numbers = {
        m.name: {
            "criteria": criteria_json(m),
            "load_ratio": m.load_ratio,
            "coefficients": {e.name: e.value for e in m.estimates},
        }
        for m in fit.models
    }
    tables = [_criteria_table(fit, channel) for channel in measured or ["dp"]]
    return [*tables, _laws_table(fit)], {"slip_threshold": fit.slip_threshold, "models": numbers}


def _laws_table(fit: CampaignFit) -> Table:
    rows = [
        [
            style(model.name).label,
            ", ".join(
                f"{letter(e.name)} = {measured(e.value, e.sigma)} {unit(e.unit)}".rstrip() for e in model.estimates
            )
            or "none: no slip sinkage",
        ]
        for model in fit.models
    ]
    note = "With intervals, bounds and correlations under “Parameters”."
    return Table("Coefficients (the paper's Tab. 3)", ["model", "coefficients"], rows, note, left=2)


def _criteria_table(fit: CampaignFit, channel: str) -> Table:
    name, si = OUTPUTS[channel].name, OUTPUTS[channel].unit_text
    scores = [model.criteria[channel] for model in fit.models]
    rows = [
        [
            style(model.name).label,
            number(score.R0_N, 4),
            f"{score.R2:.4f}" if np.isfinite(score.R2) else "–",
            number(100 * score.R0_per_load),
            number(score.M0_percent),
            number(model.load_ratio.median, 4),
            interval(model.load_ratio.lowest, model.load_ratio.highest, 4),
        ]
        for model, score in zip(fit.models, scores, strict=True)
    ]
    errors = [score.R0_N for score in scores]
    share = "R₀ / load (%)" if channel == "dp" else "R₀ / (load × radius) (%)"
    head = ["model", f"R₀ ({si})", "R²", share, "M₀ (%)", "load of Eq. 7 / measured", "least … most"]
    role = "fitted" if channel in fit.options.channels else "not fitted"
    reasons = "; ".join(sorted({reason_text(score) for score in scores} - {""}))
    note = (
        "M₀ is the largest relative error of means in bins of slip. R² sees neither offset nor gain. Load of Eq. 7: "
        "what the model's sinkage would carry; 1 is consistent."
    )
    over = f"slip ≥ {number(fit.slip_threshold, 2)}"
    return Table(
        f"{name.capitalize()} ({role}; the paper's Tab. 2 and 4) over {count(scores[0].samples)} samples with {over}",
        head,
        rows,
        f"{note} {reasons}".strip(),
        strong=int(np.nanargmin(errors)) if np.isfinite(errors).any() else None,
    )
