"""How well each model predicts, and the load that its sinkage carries: the paper's Tab. 2 and 4."""

from __future__ import annotations

import numpy as np

from daq import OUTPUTS
from model.fit import CampaignFit
from wheelsoil.report.content import Section, Table
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.words import count, interval, letter, measured, number, unit
from wheelsoil.wording.fit_text import criteria_json, reason_text
from wheelsoil.wording.model_styles import style

KEY = "criteria"
TITLE = "The four models side by side"

_CHANNELS = ("dp", "t")


def build(material: ReportInputs) -> Section:
    """Build the section: one table for each channel that was measured."""
    fit = material.fit
    measured = [c for c in _CHANNELS if any(c in m.criteria and m.criteria[c].samples for m in fit.models)]
    numbers = {
        m.name: {
            "criteria": criteria_json(m),
            "load_ratio": m.load_ratio,
            "coefficients": {e.name: e.value for e in m.estimates},
        }
        for m in fit.models
    }
    tables = [_table(fit, channel) for channel in measured or ["dp"]]
    blocks = [*tables, _laws(fit)]
    return Section(KEY, TITLE, blocks, {"slip_threshold": fit.slip_threshold, "models": numbers})


def _laws(fit: CampaignFit) -> Table:
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


def _table(fit: CampaignFit, channel: str) -> Table:
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
        "M₀ is the largest relative error: one sample decides it, and it has no limit where the measured value passes "
        "zero. R² sees neither offset nor gain. Load of Eq. 7: what the model's sinkage would carry; 1 is consistent."
    )
    over = f"slip ≥ {number(fit.slip_threshold, 2)}"
    return Table(
        f"{name.capitalize()} ({role}; the paper's Tab. 2 and 4) over {count(scores[0].samples)} samples with {over}",
        head,
        rows,
        f"{note} {reasons}".strip(),
        strong=int(np.nanargmin(errors)) if np.isfinite(errors).any() else None,
    )
