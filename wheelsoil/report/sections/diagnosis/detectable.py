"""Minimum detectable effect of every cause."""

from __future__ import annotations

from math import isfinite, log10

from model.effects import EFFECTS
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import Trace, axes, words
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.words import form_name, letter, number, unit
from wheelsoil.wording.diagnosis_text import NOT_IDENTIFIABLE
from wheelsoil.wording.names import effect_name, family_of

KEY = "detectable"
TITLE = "What could have been seen"

_READING = (
    "how large an effect must be to be found by these runs, as a share of what is plausible before any data. Left of "
    "the dotted line a plausible effect is detectable; far to the right these runs say nothing about it."
)


def build(material: ReportInputs) -> Section:
    """Build the section."""
    found = material.diagnosis.minimum_detectable
    if not found:
        return Section(KEY, TITLE, [Text("The diagnosis gave no minimum detectable sizes.")], {})
    wheel = material.vehicle.wheel
    radius = wheel.radius_m if wheel else float("nan")
    plausible = {key: _plausible(key, least.parameter, radius) for key, least in found.items()}
    shares = {key: abs(least.value) / plausible[key] for key, least in found.items() if plausible[key] > 0}
    rows = [
        [
            form_name(effect_name(key)) + (" *" if family_of(key) in material.diagnosis.not_identifiable else ""),
            letter(least.parameter),
            number(least.value) if isfinite(least.value) else "at no size",
            number(plausible[key]),
            unit(least.unit),
        ]
        for key, least in found.items()
    ]
    head = ["cause", "parameter", "smallest size", "plausible size", "unit"]
    note = (
        "Smallest size: found in half of such campaigns, if it is the only cause; the soil is re-calibrated beside it."
    )
    if any(row[0].endswith(" *") for row in rows):
        note += f" * {NOT_IDENTIFIABLE[0].lower()}{NOT_IDENTIFIABLE[1:]}: see the candidates."
    blocks: list[Block] = [Table("Minimum detectable effect", head, rows, note, left=2)]
    drawn = {key: share for key, share in shares.items() if isfinite(share) and share > 0}
    if drawn:
        blocks.insert(0, Panels([_figure(drawn)], _READING))
    return Section(KEY, TITLE, blocks, {"minimum_detectable": found, "plausible": plausible, "share": shares})


def _plausible(key: str, parameter: str, radius_m: float) -> float:
    effect = EFFECTS.get(key)
    known = {p.name: p for p in effect.parameters} if effect else {}
    if parameter not in known:
        return float("nan")
    return known[parameter].prior_scale * (radius_m if known[parameter].in_radii else 1.0)


def _figure(shares: dict[str, float]) -> Figure:
    ordered = sorted(shares, key=lambda key: shares[key])
    marks: Trace = {
        "type": "scatter",
        "mode": "markers",
        "name": "smallest size found",
        "x": [float(f"{shares[key]:.4g}") for key in ordered],
        "y": [words(form_name(effect_name(key))) for key in ordered],
        "marker": {
            "size": 9,
            "color": ["#0072B2" if shares[key] <= 1 else "#D55E00" for key in ordered],
            "symbol": ["circle" if shares[key] <= 1 else "x" for key in ordered],
        },
    }
    layout = axes("smallest / plausible size", "", height=110 + 22 * len(ordered), showlegend=False)
    low, high = log10(min(shares.values())), log10(max(shares.values()))
    layout["xaxis"] |= {"type": "log", "dtick": 1, "range": [min(low, -1.0) - 0.1, max(high, 1.0) + 0.1]}
    layout["yaxis"] |= {"autorange": "reversed", "type": "category"}
    edge = {"type": "line", "xref": "x", "yref": "paper", "x0": 1, "x1": 1, "y0": 0, "y1": 1}
    layout["shapes"] = [edge | {"line": {"color": "#555", "width": 1.2, "dash": "dot"}}]
    return Figure("detectable", "Minimum detectable effect", [marks], layout)
