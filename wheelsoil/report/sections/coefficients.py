"""The fitted coefficients with their intervals: the paper's Tab. 3."""

from __future__ import annotations

from model.effects import EFFECTS
from model.fit_result import ModelFit
from model.observations import CHANNELS
from wheelsoil.report.content import Block, Section, Table, Text
from wheelsoil.report.figures import style
from wheelsoil.report.material import Material
from wheelsoil.report.words import PARAMETERS, count, interval, listed, number, unit

KEY = "coefficients"
TITLE = "Coefficients"


def build(material: Material) -> Section:
    """Build the section."""
    fit = material.fit
    rows = [row for model in fit.models for row in _rows(model)]
    percent = f"{100 * fit.options.confidence:g} % interval"
    channels = listed([CHANNELS[channel].rpartition("_")[0].replace("_", " ") for channel in fit.options.channels])
    soil = "free within the laboratory's uncertainty" if fit.options.soil_prior else "the laboratory's"
    note = (
        f"Fitted to the {channels} of the driven samples (slip > 0); the soil is {soil}. Neighbouring samples are "
        "correlated and the slip is measured: the intervals allow for both, not for an error that is the same in every "
        "run (zero, gain, angle, soil values)."
    )
    blocks: list[Block] = [
        Table(
            "Estimates of the slip-sinkage coefficients (the paper's Tab. 3)",
            ["model", "coefficient", "value", percent, "sigma", "unit", "samples", "iterations"],
            rows,
            note,
            left=2,
        ),
        *(Text(_meaning(model)) for model in fit.models if model.effects),
    ]
    blocks += [Text(f"{style(m.name).label}: {w}.") for m in fit.models for w in m.warnings]
    numbers = {
        model.name: {
            "estimates": model.estimates,
            "correlation": {" ".join(pair): value for pair, value in model.correlation.items()},
            "warnings": model.warnings,
            "stop_reason": model.stop_reason,
            "iterations": model.iterations,
            "samples": model.samples,
            "independent_blocks": model.blocks.count,
            "block_length_s": model.blocks.length_s,
        }
        for model in fit.models
    }
    return Section(KEY, TITLE, blocks, numbers)


def _rows(model: ModelFit) -> list[list[str]]:
    label = style(model.name).label
    if not model.estimates:
        return [[label, "none", "–", "–", "–", "", count(model.samples), "–"]]
    return [
        [
            label if i == 0 else "",
            PARAMETERS.get(estimate.name, estimate.name),
            number(estimate.value, 4) + (" (bound)" if estimate.at_bound else ""),
            interval(*estimate.interval, 4),
            number(estimate.sigma, 2),
            unit(estimate.unit),
            count(model.samples) if i == 0 else "",
            f"{model.iterations}" if i == 0 else "",
        ]
        for i, estimate in enumerate(model.estimates)
    ]


def _meaning(model: ModelFit) -> str:
    said = " ".join(f"{EFFECTS[name].summary} ({EFFECTS[name].source})" for name in model.effects)
    return f"{style(model.name).label}: {said}"
