"""The evidence in four short sections: how the recommended model fits, why this cause, which runs, which sensors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from math import isfinite
from typing import Any

import numpy as np

from daq import EARLIEST_DATE_NS, OUTPUTS, ROLES, DataError, FloatArray
from daq.runs import SetAsideRun
from model import DiagnosisCode
from model.diagnosis import Cause, Diagnosis
from model.effects import EFFECTS
from processing import RunCode
from wheelsoil.report.cause_figure import residual_figure
from wheelsoil.report.content import (
    Bar,
    Bars,
    Block,
    Check,
    Checks,
    Contents,
    Drawing,
    Pair,
    Table,
    Text,
    Tile,
    Tiles,
    section,
)
from wheelsoil.report.drawing import Curve, Plane, drawn, figure_or_reason, reach
from wheelsoil.report.figures import Bins, by_slip_or_each, form_name, parted_at_zero, repeated
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import (
    Bias,
    Recommendation,
    biases,
    caution_text,
    recommended_causes,
    rows_check,
    slips_of_rows,
    unconfirmed,
)
from wheelsoil.report.sections.quality import channels_of
from wheelsoil.wording.diagnosis_text import set_shares
from wheelsoil.wording.figures import figure_interval, figure_value
from wheelsoil.wording.grounds_text import NOT_IN_THESE_DATA, adequacy_words, chances_of, rival_words, undetectable
from wheelsoil.wording.names import (
    CALIBRATED,
    LABORATORY,
    family_of,
    letter,
    listed,
    page_unit,
    parameter_name,
    plain_name,
    soil_unit,
    upper,
)
from wheelsoil.wording.notes import note_text, runs_by_text
from wheelsoil.wording.numbers import count, interval, load_text, measured, number, signed, unit
from wheelsoil.wording.verdict import NOT_JUDGED, model_title, not_corrected, refusal_words, several_terrains
from wheelsoil.workflows.key_figures import (
    CALIBRATED_SOIL,
    MODELS,
    Z95,
    KeyFigure,
    figures_of_diagnosis,
    figures_of_traction,
    sizes_of,
)
from wheelsoil.workflows.traction import PullAtSlip, Traction, traction_of

_MOST_CAUSES, _MOST_RUNS = 6, 40
_OTHER_SOIL, _ITS_SOIL = ("▲", "other soil"), "not of the soil of the first runs: see Do next"
_DECISIONS = {"good": ("✓", "go"), "fair": ("▲", "go, check"), "poor": ("✕", "drive again")}
_SIGNED = ("cohesion_pa", "cohesive_modulus")
"""Parameters of a soil that may be 0 or less; see `model.bevameter.joint.POSITIVE`."""
_SHORT = {LABORATORY: "Laboratory soil", CALIBRATED: "Calibrated soil"}
_NO_BIAS = (
    "each median is within the noise of a single sample, give or take two of its own errors, and the medians do not "
    "keep to one side of zero"
)
_SENSORS_NOTE = (
    "Complete: no gap too long to be bridged. Delay: as declared. Sigma: before the means over 0.2 s "
    "to which the errors on this page refer."
)
_NAMED_RUNS = 5
_WIDE = (560, 340, 124)
"""Size of a residual's figure on a wide screen."""
_FAULTS = {"mark": "without a value", "spike": "of spikes"}
_READING = (
    "A line is the median of measured − predicted in bins of slip, the grey band 95 % of the noise of a single sample. "
    "A right model stays at zero everywhere; where a line leaves zero and stays away, that model is wrong."
)

_READING_ROWS = (
    "A point is measured − predicted of one row, at its slip and load; a line joins the medians of repeats. Grey is "
    "what 95 % of the rows may be off under a right model: their scatter, and the error of form that every model has."
)


@section("fit", "Fit")
def fit(inputs: ReportInputs) -> Contents:
    """Build the section: residuals of baseline and recommended model, its parameters, checks, traction."""
    recommendation = inputs.recommendation
    found = biases(recommendation)
    summary = repeated if inputs.tables else by_slip_or_each
    figures = [_residuals(recommendation, channel, of_rows=bool(inputs.tables)) for channel in recommendation.measured]
    checks = [Check(False, caution_text(bias)) for bias in found]
    for c in recommendation.measured:
        if inputs.tables:
            checks.append(Check(*rows_check(recommendation, c)))
        else:
            checks += _other_checks(recommendation, c, [b for b in found if b.channel == c])
    one_soil = inputs.several_terrains is None
    checks = [check for check in (*checks, *_adequacy(inputs.diagnosed)) if one_soil or not check.good]
    blocks: list[Block] = [Pair(figures)]
    beside = _parameters(inputs.diagnosed) if inputs.diagnosed is not None else []
    if checks:
        model = recommendation.title if recommendation.is_base else recommendation.title.lower()
        beside.append(Checks("Checks", f"Bias and lack of fit of the model: {model}.", checks))
    blocks += [Pair(beside)] if beside else []
    numbers: dict[str, Any] = {
        "recommended": recommendation.name,
        "baseline": recommendation.base_name,
        "biases": found,
        "checks": [check.text for check in checks],
        "causes": recommended_causes(inputs.diagnosed) if inputs.diagnosed is not None else (),
        "soils": inputs.diagnosed.soils if inputs.diagnosed is not None else (),
        "residual": {
            c: {
                name: summary(recommendation.slip, recommendation.residual(c, base=base))
                for name, base in (("baseline", True), ("recommended", False))
            }
            for c in recommendation.measured
        },
    }
    if inputs.fitted:
        if not one_soil:
            blocks.append(Text("Over all runs, which are probably not of one soil; each run is under Runs.", "warning"))
        blocks.append(Tiles(_traction_tiles(inputs.traction, inputs.diagnosed), small=True))
        numbers["traction"] = inputs.traction
    return blocks, numbers


def _other_checks(recommendation: Recommendation, channel: str, found: Sequence[Bias]) -> list[Check]:
    """Return the checks of a channel beside its biases: braked samples that confirm nothing, and what is well."""
    if not np.isfinite(recommendation.noise[channel]).any():
        return []
    braking_is_off = any(not bias.driving for bias in found)
    swings = "" if braking_is_off else unconfirmed(recommendation, channel)
    checks = [Check(False, swings)] if swings else []
    if any(bias.driving for bias in found):
        return checks
    side = ", driving" if swings or braking_is_off or (recommendation.slip >= 0).all() else ""
    name = f"{OUTPUTS[channel].name.capitalize()}{side}"
    return [*checks, Check(True, f"{name}: {_NO_BIAS} ({_noise(recommendation, channel, driving_only=bool(side))}).")]


def _noise(recommendation: Recommendation, channel: str, *, driving_only: bool) -> str:
    """Return the noise of a sample, driving and braking: a smaller bias need not show."""
    factor, text = page_unit(channel)
    sides = (("driving", recommendation.slip > 0), ("braking", recommendation.slip < 0))[: 1 if driving_only else 2]
    known = [
        (name, recommendation.noise[channel][rows & np.isfinite(recommendation.noise[channel])]) for name, rows in sides
    ]
    unit_text = text.replace(" ", "\u00a0")
    return ", ".join(
        f"{name} {number(factor * float(np.median(x)), 2)}\u00a0{unit_text}" for name, x in known if len(x)
    )


def _residuals(recommendation: Recommendation, channel: str, *, of_rows: bool) -> Drawing:
    """Return the residual against slip: of rows of tables each, with the medians of repeats; else medians in bins."""
    (factor, text), slip = page_unit(channel), recommendation.slip
    curve_of = repeated if of_rows else _parted
    noise = curve_of(slip, factor * recommendation.noise[channel])
    edges = (-Z95 * noise.median, Z95 * noise.median)
    curves = [Curve("", noise.centre, 0 * noise.median, "noise", *edges)]
    looks = [] if recommendation.is_base else [(True, recommendation.base_name, "base")]
    for base, name, look in [*looks, (False, recommendation.title, "model")]:
        left = factor * recommendation.residual(channel, base=base)
        line = curve_of(slip, left)
        each = of_rows or bool(line.count.max(initial=0) < 5)
        points = (slip, left) if of_rows else (line.centre, line.median)
        curves += [
            Curve(_SHORT.get(name, name), line.centre, line.median, look),
            *[Curve("", *points, look, points=True)] * each,
        ]
    slips, heights = slips_of_rows(recommendation), reach(*(curve.y for curve in curves), *edges)
    caption = "Points: rows. Grey: 95 % of scatter and error of form."
    if not of_rows:
        slips = (float(np.floor(np.nanmin(slip) / 0.1) * 0.1), float(np.ceil(np.nanmax(slip) / 0.1) * 0.1))
        driving = (*(curve.y[curve.x > 0] for curve in curves), *(edge[noise.centre > 0] for edge in edges))
        heights = reach(1.3 * np.array(reach(*driving)), line.median)
        caption = (
            f"{'Readings' if each else 'Medians in bins of slip'}; braking, left of zero, may be cut. "
            "Grey: 95 % of the noise."
        )
    return drawn(
        f"residual-{channel}",
        f"{OUTPUTS[channel].name.capitalize()}: residual",
        caption,
        Plane(slips, heights, "Slip ratio", f"Measured − predicted ({text})"),
        curves,
        shades=[(slips[0], 0.0)] if slips[0] < 0 and not of_rows else [],
        reading=_READING_ROWS if of_rows else _READING,
        wide=_WIDE,
    )


def _parted(slip: FloatArray, y: FloatArray) -> Bins:
    return parted_at_zero(by_slip_or_each(slip, y))


def _adequacy(found: Diagnosis | None) -> list[Check]:
    if found is None or found.adequacy is None or not isfinite(found.adequacy.statistic):
        return []
    judged = found.adequacy
    if (note := several_terrains(found)) is not None:
        return [Check(False, f"{upper(note_text(note))}.")]
    left = "no more than noise is left" if judged.ok else "do not rely on the probabilities of causes"
    soils = found.grounds.terrains is not None
    return [Check(judged.ok, f"{upper(adequacy_words(judged, soils=soils))}: {left}.")]


def _parameters(found: Diagnosis) -> list[Block]:
    """Return the parameters of the recommended model: the causes', and the soil's as the data leave it."""
    rows: list[list[str | KeyFigure]] = [row for cause in recommended_causes(found) for row in _of_cause(cause)]
    several = len(found.soils) > 1
    for soil in found.soils:
        for name, value in soil.values.items():
            sigma, (scale, text) = soil.sigmas.get(name, float("nan")), soil_unit(name)
            # The 95 % interval of a soil's parameter; log-normal for one that is above 0 in every soil.
            if name in _SIGNED or not (value > 0 and sigma > 0):
                ends = (value - Z95 * sigma, value + Z95 * sigma)
            else:
                factor = float(np.exp(Z95 * np.sqrt(np.log1p((sigma / value) ** 2))))
                ends = (value / factor, value * factor)
            interval_text = interval(scale * ends[0], scale * ends[1]) if ends[0] < ends[1] else "–"
            off = f"{signed(soil.off_laboratory[name], '+.1f')} σ" if name in soil.off_laboratory else "–"
            before = number(scale * soil.laboratory[name][0], 4) if name in soil.laboratory else "–"
            label = _with_unit(f"{letter(name)}, {soil.campaign}" if several else letter(name), text)
            rows.append([label, measured(scale * value, scale * sigma), interval_text, before, off])
    if not rows:
        return []
    head = ["parameter", "estimate", "95 % interval", "laboratory", "off by"]
    causes = listed(
        [f"{plain_name(c.name)}{f' ({form_name(c.form)})' if c.form else ''}" for c in recommended_causes(found)]
    )
    of_soil = (
        "soil fitted with it"
        if found.verdict == "named"
        else "the soil listed is that of the fit without a cause, the line has its own"
    )
    model = f"Wong with {causes}; {of_soil}" if causes else CALIBRATED
    title = f"{model_title(found)} model" if causes else CALIBRATED
    return [Table(title, head, rows, f"{model}. σ: of the laboratory's value.")]


def _with_unit(name: str, text: str) -> str:
    return f"{name} ({unit(text)})" if unit(text) else name


def _of_cause(cause: Cause) -> list[list[str | KeyFigure]]:
    return [
        [_with_unit(letter(parameter_name(cause.key, p.name)), p.unit), figure, figure_interval(figure, " … "), "", ""]
        for p, figure in zip(cause.parameters, sizes_of(cause), strict=True)
    ]


def _traction_tiles(traction: Traction, found: Diagnosis | None) -> list[Tile]:
    tiles: list[Tile] = []
    figures = figures_of_traction(traction)
    measured = "" if traction.model == MODELS["named"] else "measured "
    if traction.pull is not None:
        pull, coefficient = list(figures.values())[:2]
        at = f"at slip {traction.pull.slip:g}" if traction.model else f"near slip {traction.pull.slip:g}, measured"
        tiles.append(_tile(f"Pull {at}", pull, _of_pull(traction.pull, traction), "N"))
        tiles.append(_tile(f"Dp/W {at}", coefficient, "drawbar coefficient"))
    if isfinite(traction.drawbar_coefficient):
        note = f"at slip {traction.at_slip:.2f}"
        tiles.append(_tile(f"Highest {measured}Dp/W", figures["drawbar_coefficient"], note))
    if isfinite(traction.efficiency):
        errors = not_corrected(found, "driving_torque", "drawbar_pull", "ground_speed") if measured else ""
        known = " where slip exceeds twice its error" if measured else ""
        note = f"at slip {traction.efficiency_at_slip:.2f}; Dp v / (T ω){known}{errors and f'; {errors}'}"
        tiles.append(_tile(f"Highest {measured}tractive efficiency", figures["tractive_efficiency"], note))
    return tiles


def _tile(title: str, figure: KeyFigure, note: str, unit_text: str = "") -> Tile:
    return Tile(title, figure_value(figure), unit_text, note, keys=(None, figure))


def _of_pull(pull: PullAtSlip, traction: Traction) -> str:
    """Return the interval of the pull, and for which driving it holds by which model."""
    interval_text = f"95 % {interval(*pull.interval95)} N; " if isfinite(pull.interval95[0]) else "no interval; "
    load = load_text(pull.load_n)
    if not traction.model:
        return f"{interval_text}{count(pull.passes)} passes, loads and speeds as driven, {load} on average"
    if traction.model == MODELS["named"]:
        return f"{interval_text}steady driving at {load} and {pull.speed_mps:.1f} m/s, recommended model"
    by = CALIBRATED if traction.model == CALIBRATED_SOIL else LABORATORY
    return f"{interval_text}measured, shifted to {load} and {pull.speed_mps:.1f} m/s by {by}"


@section("causes", "Causes")
def causes(inputs: ReportInputs) -> Contents:
    """Build the section: sets of causes, which add up, and each cause with its size."""
    found = inputs.diagnosis
    blocks: list[Block] = []
    if found.verdict == "unexplained":
        return _refused(inputs, found)
    sets = set_shares(found.sets)
    bars = [
        Bar(f"{share.name}{' alone' * (share.causes == 1)}", share.percent / 100, f"{share.percent:.1f} %", i == 0)
        for i, share in enumerate(sets)
    ]
    if bars:
        as_if = f"{NOT_JUDGED} As if of one soil: " if several_terrains(found) is not None else ""
        caption = f"{as_if}Sets exclude each other; with the rest they add up to 100 %."
        blocks.append(Bars("Which set of causes acts", caption, bars))
    rivals, figures = found.grounds.confounded, figures_of_diagnosis(found)
    stated = [cause.name for cause in found.causes]
    rows: list[list[str | KeyFigure]] = [
        [plain_name(candidate.name), figures[f"candidate.{candidate.name}"], *_size(found, candidate.name)]
        for i, candidate in enumerate(found.candidates)
        if candidate.name != "none" and (i < _MOST_CAUSES or candidate.name in (*rivals, *stated))
    ]
    if rows:
        note = (
            "Each cause alone or with others: these need not add up. "
            "Minimum detectable: alone, in half of such campaigns."
        )
        note += "".join(
            f" {sentence}." for sentence in rival_words([f for f in rivals if f not in stated], chances_of(found))
        )
        if found.verdict == "one_of" and found.grounds.barred is not None:
            note += f" {upper(plain_name(stated[0]))} is not named: {note_text(found.grounds.barred)}."
        head = ["cause", "probability", "estimate", "minimum detectable"]
        blocks.append(Table("Each cause", head, rows, note, words=head[2:]))
    if not blocks:
        raise DataError("no cause was weighed")
    shares = [{"causes": share.name, "probability": share.probability, "percent": share.percent} for share in sets]
    barred = [cause.name for cause, why in found.stated if why is not None]
    return blocks, {"sets": shares} | _weighed(found) | ({"barred": barred} if barred else {})


def _weighed(found: Diagnosis) -> dict[str, Any]:
    sizes = found.minimum_detectable
    return {"candidates": found.candidates, "causes": found.causes, "minimum_detectable": sizes}


def _refused(inputs: ReportInputs, found: Diagnosis) -> Contents:
    """Return the residual where it is largest, and the best set of the library with why it is refused."""
    refusal, of_rows = refusal_words(found) or "Nothing can be decided from these data.", bool(inputs.tables)
    figures: list[Block] = [
        figure_or_reason(
            lambda: residual_figure(inputs.recommendation, found, "largest-residual", (1000, 340, 14), of_rows=of_rows)
        )
    ]
    if several_terrains(found) is not None:
        refusal, figures = NOT_JUDGED, []
    return [Text(refusal, "warning"), *figures], {"sets": [], "refused": refusal} | _weighed(found)


def _size(found: Diagnosis, family: str) -> tuple[str, str]:
    """Return the estimate of a cause, and its minimum detectable size; "–" for what is not known."""
    causes = [cause for cause in found.causes if cause.name == family]
    sizes = [
        f"{letter(parameter_name(cause.key, p.name))} = {measured(p.value, p.sigma)} {unit(p.unit)}".rstrip()
        for cause in causes[:1]
        for p in cause.parameters
        if isfinite(p.interval95[0])
    ]
    size = ", ".join(sizes) or "–"
    key = causes[0].key if causes else next((k for k in found.minimum_detectable if family_of(k) == family), "")
    least = found.minimum_detectable.get(key)
    if family in found.not_identifiable:
        return size, "not identifiable"
    if least is None:
        return size, "–"
    if key in undetectable(found.minimum_detectable, found.notes):
        return size, NOT_IN_THESE_DATA
    name = letter(parameter_name(key, least.parameter))
    name = f"|{name}|" if least.value < 0 else name
    return size, f"{name} ≥ {number(abs(least.value))} {unit(least.unit)}".rstrip()


@section("runs", "Runs")
def runs(inputs: ReportInputs) -> Contents:
    """Build the section: go or drive again, per run, with the reason and the traction."""
    if not inputs.runs:
        raise DataError("there are no runs")
    note, rows, numbers = inputs.several_terrains, [], {}
    others = note.values.get("groups", ((), ()))[1] if note is not None else ()
    for run, grade in zip(inputs.runs, inputs.grades, strict=True):
        sign, decision = _OTHER_SOIL if run.run.id in others else _DECISIONS[grade.level]
        traction = traction_of((run,))
        load = run.vertical_load_n[np.isfinite(run.vertical_load_n)]
        dated = run.start_ns > EARLIEST_DATE_NS
        start = f"{datetime.fromtimestamp(run.start_ns / 1e9, UTC):%H:%M}" if dated else None
        rows.append(
            [
                run.run.id,
                f"{sign} {decision}",
                start or "–",
                f"{np.median(load) / 1e3:.1f}" if len(load) else "–",
                f"{grade.highest_slip:.2f}" if isfinite(grade.highest_slip) else "–",
                f"{100 * grade.usable_share:.0f}" if isfinite(grade.usable_share) else "–",
                number(traction.pull.pull_n) if traction.pull else "–",
                "; ".join([_ITS_SOIL] * (run.run.id in others) + [*map(_with_names, grade.reasons[:2])])
                or "complete, slip covered",
            ]
        )
        numbers[run.run.id] = {
            "start_utc": start,
            "load_n": float(np.median(load)) if len(load) else None,
            "highest_slip": grade.highest_slip,
            "usable_share": grade.usable_share,
            "decision": decision,
            "reasons": grade.reasons,
            "traction": traction,
        }
    head = [
        "run",
        "decision",
        "start UTC",
        "load (kN)",
        "slip up to",
        "usable (%)",
        "measured pull near slip 0.2 (N)",
        "reason",
    ]
    shown = _shown_runs([grade.level for grade in inputs.grades])
    more = f"{len(shown)} of {len(rows)}, the worst; the others are in the appendix. " if len(shown) < len(rows) else ""
    below = f"{more}Usable: share of the samples in motion. Measured pull: of a cubic through slip 0 to 0.4."
    listed_rows = [*(_set_aside_row(run, len(head)) for run in inputs.set_aside), *(rows[i] for i in shown)]
    return [Table("Go or drive again", head, listed_rows, below, left=2, words=("reason",))], numbers


def _with_names(text: str) -> str:
    """Return a note with the channel at its beginning as people call it."""
    first, _, rest = text.partition(" ")
    return f"{ROLES[first].name} {rest}" if first in ROLES else text


def _shown_runs(levels: Sequence[str]) -> list[int]:
    """Return the places of the runs that the table has room for, in their order: the worst, then the first."""
    ranks = list(_DECISIONS)
    worst = sorted(range(len(levels)), key=lambda i: -ranks.index(levels[i]))
    return sorted(worst[:_MOST_RUNS])


def _set_aside_row(run: SetAsideRun, columns: int) -> list[str]:
    decision = "✕ set aside" if run.cause not in ("repeated", "switched_off", "not_read") else "– set aside"
    return [run.run, decision, *["–"] * (columns - 3), f"{run.reason}. Next: {run.next_step}"]


def _counted(value: int, what: str) -> str:
    return f"{count(value)} {what}{'s' * (value != 1)}"


@section("signals", "Sensors")
def signals(inputs: ReportInputs) -> Contents:
    """Build the section: whether all channels arrived, at which rate, with which noise."""
    if not inputs.runs:
        raise DataError("there are no runs")
    rows, numbers = [], {}
    for role, found in channels_of(inputs.runs).items():
        gaps, late = int(found["gaps"]), int(found["late"] + found["distrusted"])
        missing = sum(role not in run.quality.sensors for run in inputs.runs)
        faults = faults_of(role, inputs)
        well = not gaps and not late and not missing and not faults
        losses = [_counted(gaps, "gap")] * bool(gaps) + [f"{count(late)} distrusted"] * bool(late)
        losses += [f"missing in {_counted(missing, 'run')}"] * bool(missing) + faults
        rows.append(
            [
                ROLES[role].name,
                "✓ complete" if well else f"▲ {', '.join(losses)}",
                number(found["rate_hz"], 4),
                number(found["longest_gap_ms"]),
                number(found["latency_ms"]),
                f"{number(found['sigma'], 2)} {ROLES[role].unit_text}".rstrip(),
            ]
        )
        numbers[role] = {
            "rate_hz": found["rate_hz"],
            "longest_gap_ms": found["longest_gap_ms"],
            "delay_ms": found["latency_ms"],
            "sigma": found["sigma"],
            "complete": well,
            "gaps": gaps,
            "distrusted": late,
            "missing_runs": missing,
        }
    blocks: list[Block] = []
    if rows:
        head = ["channel", "state", "rate (Hz)", "longest gap (ms)", "delay (ms)", "sigma of a filtered sample"]
        blocks.append(Table("All channels, all runs", head, rows, _SENSORS_NOTE, left=2))
    lost = [f"{source.run_id}: {'; '.join(source.lost)}" for source in inputs.sources if source.lost]
    blocks += [Text(f"Lost while recording: {listed(lost)}.", "warning")] if lost else []
    notes = runs_by_text((run.run.id, run.quality.notes) for run in inputs.runs)
    blocks += [Text(_of_runs(text, names, len(inputs.runs))) for text, names in list(notes.items())[:3]]
    told = inputs.diagnosed.notes if inputs.diagnosed is not None else ()
    blocks += [Text(f"{upper(note_text(note))}.", "warning") for note in told if note.code == DiagnosisCode.WHEEL_ORDER]
    return blocks, numbers


def faults_of(role: str, inputs: ReportInputs) -> list[str]:
    """Return what a channel lost to faults of its sensor, by their kind, and the delay that is the named cause."""
    seen: dict[str, dict[str, float]] = {}
    for run in inputs.runs:
        for note in run.quality.notes:
            if note.code == RunCode.SENSOR_FAULT and note.values["role"] == role:
                times = seen.setdefault(_FAULTS.get(note.values["kind"], note.values["kind"]), {})
                times[run.run.id] = times.get(run.run.id, 0.0) + note.values["time_s"]
    faults = [
        f"{sum(times.values()):.1f} s {kind} in {listed(list(times)) if len(times) < 3 else f'{len(times)} runs'}"
        for kind, times in seen.items()
    ]
    found = inputs.diagnosed
    named = found.causes if found is not None and found.verdict == "named" else ()
    known = [cause for cause in named if cause.kind == "measurement" and cause.key in EFFECTS]
    late = any(cause.parameters[0].unit == "s" and role in EFFECTS[cause.key].shows for cause in known)
    return [*faults, "delayed: the named cause"] if late else faults


def _of_runs(text: str, names: Sequence[str], of: int) -> str:
    """Return what is noted of runs as a sentence that names them, and channels as people call them."""
    sentence = _with_names(text)
    who = "all runs" if len(names) == of and of > 1 else listed(names)
    who = who if len(names) <= _NAMED_RUNS or len(names) == of else f"{len(names)} of {of} runs"
    return re.sub(r"(?<![\w.])-(?=\d)", "−", f"In {who}: {sentence}.")
