"""Planning: the minimum detectable effect of every cause, and the next run, which parts the candidates best."""

from __future__ import annotations

from itertools import compress
from math import exp, isfinite, log10

import numpy as np

from model.effects import EFFECTS, Effect
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, section
from wheelsoil.report.figures import axes, form_name, points
from wheelsoil.report.figures import numbers as plotted
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.diagnosis_json import next_run_json
from wheelsoil.wording.diagnosis_text import NOT_IDENTIFIABLE
from wheelsoil.wording.grounds_text import NOT_IN_THESE_DATA, undetectable
from wheelsoil.wording.names import effect_name, family_of, letter, listed, plain_name
from wheelsoil.wording.notes import key_text, naming_text, odds_text, step_text
from wheelsoil.wording.numbers import number, unit
from wheelsoil.wording.verdict import deciding_runs, several_terrains

_READING = (
    "how large an effect must be to be found by these runs, as a share of what is plausible before any data. Left of "
    "the dotted line a plausible effect is detectable; far to the right these runs say nothing about it."
)

_NAME_NOTE = (
    "Right name: the share of truths, drawn from what is still possible, of which the right cause is named after the "
    "step; below 20 % for all, no single step decides, and they stand in the order of their odds; so they do where a "
    "rule bars a name of which no step can be foreseen to lift it. "
)
_ODDS_NOTE = (
    "Expected odds: by how much one such run is expected to favour the true candidate over the one with the most "
    "similar signature. 3 : 1 is hardly anything, 150 : 1 is strong. They count noise only: above 1000 : 1 the limit "
    "is not the noise, but the errors of the models themselves. Cost: time in runs like the others, an estimate."
)


@section("detectable", "Minimum detectable effect")
def detectable(inputs: ReportInputs) -> Contents:
    """Build the section."""
    found = inputs.diagnosis.minimum_detectable
    if not found:
        return [Text("The diagnosis gave no minimum detectable sizes.")], {}
    wheel = inputs.vehicle.wheel
    radius = wheel.radius_m if wheel else float("nan")
    plausible = {key: _plausible(key, least.parameter, radius) for key, least in found.items()}
    shares = {key: abs(least.value) / plausible[key] for key, least in found.items() if plausible[key] > 0}
    hidden = undetectable(found, inputs.diagnosis.notes)
    never = [key for key in found if family_of(key) in inputs.diagnosis.not_identifiable]
    rows = [
        [
            form_name(effect_name(key)) + (" *" if key in never else ""),
            letter(least.parameter),
            NOT_IN_THESE_DATA if key in hidden else number(least.value),
            number(plausible[key]),
            unit(least.unit),
        ]
        for key, least in found.items()
    ]
    head = ["cause", "parameter", "smallest size", "plausible size", "unit"]
    note = (
        "Smallest size: found in half of such campaigns, if it is the only cause; the soil is re-calibrated beside it."
    )
    if never:
        note += f" * {NOT_IDENTIFIABLE[0].lower()}{NOT_IDENTIFIABLE[1:]}: see the candidates."
    blocks: list[Block] = [Table("Minimum detectable effect", head, rows, note, left=2, words=("unit",))]
    drawn = {key: share for key, share in shares.items() if isfinite(share) and share > 0}
    if drawn:
        blocks.insert(0, Panels([_figure(drawn)], _READING))
    return blocks, {"minimum_detectable": found, "plausible": plausible, "share": shares}


def _plausible(key: str, parameter: str, radius_m: float) -> float:
    known = next((p for p in EFFECTS.get(key, Effect).parameters if p.name == parameter), None)
    return known.prior_scale * (radius_m if known.in_radii else 1.0) if known else float("nan")


def _figure(shares: dict[str, float]) -> Figure:
    ordered = sorted(shares, key=lambda key: shares[key])
    names = [form_name(effect_name(key)) for key in ordered]
    least = np.array([shares[key] for key in ordered])
    parts = (("detectable", least <= 1, ("#0072B2", "circle")), ("not detectable", least > 1, ("#D55E00", "x")))
    marks = [
        points(plotted(least[rows], 4), list(compress(names, rows)), name, look, 9.0)
        for name, rows, look in parts
        if rows.any()
    ]
    layout = axes("smallest / plausible size", "", height=110 + 22 * len(ordered), dotted=[1.0])
    low, high = log10(least[0]), log10(least[-1])
    layout["xaxis"] |= {"log": True, "range": [min(low, -1.0) - 0.1, max(high, 1.0) + 0.1]}
    layout["yaxis"] |= {"order": names}
    return Figure("detectable", "Minimum detectable effect", marks, layout)


@section("next_run", "Next run")
def next_run(inputs: ReportInputs) -> Contents:
    """Build the section."""
    runs = inputs.diagnosis.next_run
    if not runs:
        text = (
            "No run can be ranked: no candidate explains these runs. See the residuals of the simulation."
            if inputs.diagnosis.verdict == "unexplained"
            else "The verdict asks for no further run; --next-run ranks them all the same."
        )
        return [Text(text)], {}
    odds = [exp(min(max(run.expected_log_bayes_factor, 0.0), 50.0)) for run in runs]
    rows = [
        [
            step_text(run) + (f" (write {key})" if (key := key_text(run)) else ""),
            listed([plain_name(name) for name in run.separates]),
            naming_text(run) or "-",
            odds_text(run.expected_log_bayes_factor),
            number(run.cost_runs, 2),
        ]
        for run in runs
    ]
    head = ["what to do", "separates", "right name", "expected odds", "cost, runs"]
    numbers = {"next_run": [next_run_json(run) for run in runs], "odds_to_1": odds}
    if not deciding_runs(inputs.diagnosis):
        apart = several_terrains(inputs.diagnosis) is not None
        text = (
            "These runs are probably not of one soil: part them first."
            if apart
            else ("No run is needed: what has a similar signature is separable in these data.")
        )
        return [Text(text)], numbers
    title = "Best first: of steps that tell enough, the cheapest"
    return [Table(title, head, rows, _NAME_NOTE + _ODDS_NOTE, left=2, words=("right name",))], numbers
