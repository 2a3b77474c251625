"""The first screen: the verdict, three numbers, the figure that shows it, and what to do next."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from math import isfinite

import numpy as np

from daq import EARLIEST_DATE_NS, OUTPUTS, BoolArray, DataError, FloatArray
from model.diagnosis import Diagnosis, Scores
from wheelsoil.report.cause_figure import cause_figure, driven_slips, residual_figure, shares_of
from wheelsoil.report.content import MOST_STEPS, Contents, Drawing, Steps, Text, Tile, Tiles, section
from wheelsoil.report.drawing import Curve, Plane, beyond, drawn, figure_or_reason, reach
from wheelsoil.report.figures import EDGES, Bins, binned, by_load, by_slip, matched, repeated
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import (
    Bias,
    LoadShift,
    Recommendation,
    biases,
    caution_text,
    load_shift,
    recommended_causes,
    rows_not_used,
    slips_of_rows,
    unconfirmed,
)
from wheelsoil.report.sections.track import known_places
from wheelsoil.report.sections.verdict import fit_headline, fit_sentences, rank
from wheelsoil.wording.diagnosis_text import covered
from wheelsoil.wording.mending import Step, next_steps, step_of
from wheelsoil.wording.names import CALIBRATED, chance, family_of, listed, page_unit, plain_name
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import load_text, number, signed
from wheelsoil.wording.verdict import (
    MOST_WORDS,
    NO_CHANGE,
    Groups,
    alternatives,
    details_of,
    groups_of_runs,
    headline_of,
    peak_bars,
    reduction_in,
    sentences_of,
    several_terrains,
    stated_channel,
)
from wheelsoil.workflows.key_figures import CALIBRATED_SOIL, Z95, figures_of_diagnosis, figures_of_traction

_NAMED = 5
_ONE_PLACE_DEG = 0.02
"""Two kilometres: runs farther apart have no place in common."""


@section("glance", "Summary")
def glance(inputs: ReportInputs) -> Contents:
    """Build the section; it is there whatever is missing."""
    found, sentences = inputs.diagnosed, _sentences(inputs)
    steps = Steps(
        steps_of_report(inputs),
        runs_again(inputs),
        runs_again(inputs, "in the report under Runs"),
        [caution_text(bias) for bias in _cautions(inputs)],
    )
    headline, details = _headline(inputs, sentences)
    tiles = [_error_tile(inputs), confidence_tile(found), data_tile(inputs)]
    figure = figure_or_reason(lambda: hero(inputs))
    shared = figures_of_traction(inputs.traction) if inputs.runs and inputs.campaign else {}
    if found is not None:
        shared |= figures_of_diagnosis(found)
    numbers = {
        "headline": headline,
        "sentence": " ".join(sentences),
        "next_step": steps.steps[0].what,
        "steps": steps.steps,
        "grades": {run.run.id: grade for run, grade in zip(inputs.runs, inputs.grades, strict=True)},
        "tiles": {tile.title: {"before": tile.before, "value": tile.value, "unit": tile.unit} for tile in tiles},
        "cautions": list(steps.cautions),
        "key_figures": shared,
    }
    return [Text(headline, "verdict"), Text(" ".join(details), "lead"), Tiles(tiles), figure, steps], numbers


def only_driving(inputs: ReportInputs) -> list[str]:
    """Return that the model is confirmed for driving only, where braked samples are off and no driven one is."""
    found = inputs.diagnosed
    if inputs.tables or found is None or several_terrains(found) is not None:
        return []
    try:
        recommendation = inputs.recommendation
    except DataError:
        return []
    off = biases(recommendation)
    braked = bool(off) or any(unconfirmed(recommendation, channel) for channel in recommendation.measured)
    return ["Confirmed for driving only."] if braked and not any(bias.driving for bias in off) else []


def _headline(inputs: ReportInputs, sentences: list[str]) -> tuple[str, list[str]]:
    """Return the headline, of at most 25 words, and the sentences below it."""
    if inputs.diagnosed is not None:
        driving = only_driving(inputs) if inputs.diagnosed.verdict == "named" else []
        others, wheel = "if others are instrumented, all decide (wheelsoil report FOLDER).", inputs.vehicle.wheel
        alone = [f"Of wheel {wheel.id} alone: {others}"] if wheel and wheel.id and wheel.axle else []
        return headline_of(inputs.diagnosed), [*details_of(inputs.diagnosed), *driving, *alone]
    if len(sentences[0].split()) <= MOST_WORDS:
        return sentences[0], sentences[1:]
    if inputs.campaign is not None:
        return fit_headline(rank(inputs)), sentences
    return f"{'No diagnosis' if inputs.tables else 'No result'}: the reason is below.", sentences


def _sentences(inputs: ReportInputs) -> list[str]:
    """Return the result: a diagnosis says its own, so that no fault in judging the fit can take it."""
    if inputs.diagnosed is not None:
        return sentences_of(inputs.diagnosed)
    if inputs.tables:
        return [f"No diagnosis: {inputs.no_diagnosis or 'none was asked for'}."]
    try:
        return fit_sentences(inputs, rank(inputs))
    except DataError as error:
        return [f"No result: {error.what}."]


def _error_tile(inputs: ReportInputs) -> Tile:
    """Return the tile of the held-out error of the headline's channel."""
    found = inputs.diagnosed
    gain = found.gain if found is not None else None
    if found is None or gain is None or found.main_channel not in gain.base:
        return _in_sample_tile(inputs)
    main = stated_channel(found)
    channel = OUTPUTS[main]
    factor, unit = page_unit(main)
    figures = figures_of_diagnosis(found)
    was, now = (figures.get(f"error.{main}.{which}") for which in (CALIBRATED_SOIL, "with_causes"))
    before, after = (factor * scores[main].R0 for scores in (gain.base, gain.extended))
    change = reduction_in(gain, main)
    low, high = change.interval95
    title = f"{channel.name.capitalize()} error, held-out"
    if found.verdict not in ("named", "one_of") or abs(change.percent) < NO_CHANGE:
        others = [_errors_of(output, gain.base) for output in gain.base if output != main]
        stays = "the causes hardly change it" if found.verdict == "one_of" else "without a cause"
        return Tile(title, number(before), unit, " · ".join([f"{CALIBRATED}; {stays}", *others]), keys=(None, was))
    apart = several_terrains(found) is not None
    ends = f"interval {signed(-high, '.0f')} to {signed(-low, '.0f')} %"
    ends = f"{ends} ({right})" if (right := covered(found)) else f"95 % {ends}"
    notes = [ends] if isfinite(low) else []
    both = [output for output in gain.base if output != main and output in gain.extended]
    notes += [_errors_of(output, gain.base, gain.extended) for output in both]
    badge = f"{signed(-change.percent, '+.0f')} %" if isfinite(change.percent) else ""
    better = low > 0 and not apart
    return Tile(title, number(after), unit, " · ".join(notes), number(before), badge, (was, now), better=better)


def _errors_of(channel: str, *scores: Mapping[str, Scores]) -> str:
    factor, unit = page_unit(channel)
    errors = " → ".join(number(factor * each[channel].R0) for each in scores)
    return f"{OUTPUTS[channel].name} {errors}\u00a0{unit.replace(' ', chr(160))}"


def _in_sample_tile(inputs: ReportInputs) -> Tile:
    title = "Drawbar pull error"
    try:
        recommendation = inputs.recommendation
    except DataError:
        return Tile(title, "–", "", "there is no fit")
    if "dp" not in recommendation.measured:
        return Tile(title, "–", "", "the drawbar pull was not measured")
    base, after = (
        float(np.sqrt(np.nanmean(recommendation.residual("dp", base=base)[recommendation.slip > 0] ** 2)))
        for base in (True, False)
    )
    if recommendation.is_base:
        braked = recommendation.residual("dp")[recommendation.slip < 0]
        known = braked[np.isfinite(braked)]
        also = f"; braking {number(float(np.sqrt(np.mean(known**2))))}\u00a0N" if len(known) else ""
        note = f"in sample, driving{also}; nothing better than {recommendation.base_name} is known"
        return Tile(title, number(after), "N", note)
    return Tile(title, number(after), "N", "in sample, driving; no run was held out", number(base))


def confidence_tile(found: Diagnosis | None) -> Tile:
    """Return the tile of how sure the verdict is."""
    title = "Confidence"
    if found is None:
        return Tile(title, "–", "", "no diagnosis was made")
    if several_terrains(found) is not None:
        return Tile(title, "–", "", "no cause is judged: these runs are probably not of one soil")
    sure = figures_of_diagnosis(found).get("confidence")
    if sure is not None:
        share, keys = _share(sure.value), (None, sure)
    if found.verdict == "named":
        named = listed([plain_name(cause.name) for cause in found.causes])
        return Tile(title, *share, f"in {named}, alone or with others{_chosen(found)}", keys=keys)
    if found.verdict == "one_of":
        names = alternatives([(f"{plain_name(c.name)} {chance(c.probability)}", c.probability) for c in found.causes])
        if found.grounds.barred is not None and peak_bars(found):
            names = listed([plain_name(cause.name) for cause in found.causes], "or")
        return Tile(title, *share, f"that a cause acts: {names}", keys=keys)
    if found.verdict == "nothing_detectable":
        return Tile(title, *share, "that no cause acts", keys=keys)
    judged = found.adequacy
    if judged is not None and judged.measure == "probability" and found.grounds.barred is None:
        soils = "the runs are of two soils, or " if groups_of_runs(found) else ""
        return Tile(title, *_share(judged.statistic), f"that {soils}an unknown cause acts; no name")
    why = "no known cause explains these data" if judged else "nothing was decided"
    why = note_text(found.grounds.barred) if found.grounds.barred else why
    return Tile(title, "none", "", why)


def _share(value: float) -> tuple[str, str]:
    return (chance(value).removesuffix(" %"), "%") if isfinite(value) else ("–", "")


def _chosen(found: Diagnosis) -> str:
    """Return in how many of the fits with a run left out all named causes were chosen."""
    chosen = found.gain.chosen if found.gain is not None else ()
    named = {cause.name for cause in found.causes}
    held = sum(named <= {family_of(key) for key in keys} for keys in chosen)
    return f"; chosen in {held} of {len(chosen)} held-out fits" if chosen else ""


def ends_of_slip(inputs: ReportInputs) -> tuple[float, float]:
    """Return the lowest and the highest slip of the used samples; NaN where there are none."""
    pieces = [run.slip[run.used] for run in inputs.runs] or [seen.slip for seen in inputs.diagnosis.plot_data]
    slip = np.concatenate([piece[np.isfinite(piece)] for piece in pieces])
    return (float(slip.min()), float(slip.max())) if len(slip) else (np.nan, np.nan)


def data_tile(inputs: ReportInputs) -> Tile:
    """Return the tile of what can be used."""
    title = "Usable data"
    if inputs.tables:
        total = sum(len(wheel_test.rows) for wheel_test in inputs.tables)
        if inputs.diagnosed is None:
            return Tile(title, str(total), "rows", "of single-wheel tests")
        rows = sum(len(seen.slip) for seen in inputs.diagnosed.plot_data)
        return Tile(title, str(rows), f"of {total} rows", rows_not_used(inputs.diagnosed) or "of single-wheel tests")
    if not inputs.runs or not isfinite(ends_of_slip(inputs)[0]):
        return Tile(title, "0", "%", "no sample can be used")
    low, high = (signed(end, ".2f") for end in ends_of_slip(inputs))
    used = np.concatenate([run.used for run in inputs.runs])
    note = f"{100 * used.mean():.0f} % of all samples · slip {low} to {high}"
    share = float(np.nanmean([grade.usable_share for grade in inputs.grades]))
    return Tile(title, number(100 * share), "% of motion", note)


def hero(inputs: ReportInputs) -> Drawing:
    """Return the figure in which the cause shows, in the channel that it changes most.

    That is this channel against slip, with and without the cause, unless another abscissa shows the cause better.
    `DataError` where no driven sample has a measured channel.
    """
    recommendation = inputs.recommendation
    if inputs.tables and inputs.diagnosed is not None:
        return _hero_of_rows(inputs.diagnosed, recommendation)
    channel = recommendation.main_channel
    driven = recommendation.slip > 0
    found = inputs.diagnosed
    if inputs.runs and (groups := groups_of_runs(found)):
        return _of_two_terrains(inputs, groups)
    if found is not None and found.verdict == "unexplained" and found.what_is_wrong:
        return residual_figure(recommendation, found, "hero", (720, 340, 14))
    if channel not in recommendation.measured or not np.isfinite(recommendation.measured[channel][driven]).any():
        raise DataError("no driven sample has a measured drawbar pull or torque")
    if (of_cause := cause_figure(inputs, recommendation, channel)) is not None:
        return of_cause
    return _against_slip(inputs, recommendation, channel)


def _against_slip(inputs: ReportInputs, recommendation: Recommendation, channel: str) -> Drawing:
    """Return a channel against slip, driving, with and without the cause, at one load."""
    factor, driven = page_unit(channel)[0], recommendation.slip > 0
    shift = load_shift(recommendation, channel)
    left, off = (recommendation.residual(channel, base=base) for base in (False, True))
    rows = driven & np.isfinite(left) & np.isfinite(off)
    added = shift.of(recommendation.slip, recommendation.vertical_load_n)
    slip, measured = recommendation.slip[rows], factor * (recommendation.measured[channel] + added)[rows]
    above = binned(slip, factor * (recommendation.recommended[channel] + added)[rows], EDGES)
    off_by = binned(slip, factor * left[rows], EDGES)
    noise = binned(recommendation.slip, factor * recommendation.noise[channel], EDGES)  # as Fit has it
    # the line and the residual, so that figures of both agree
    middle, lower, upper = (above.median + part for part in (off_by.median, off_by.lower, off_by.upper))
    half = Z95 * matched(above.centre, noise)
    curves = []
    if not recommendation.is_base:
        below = middle - binned(slip, factor * off[rows], EDGES).median
        curves.append(Curve(recommendation.base_name, above.centre, below, "base", note="without a cause"))
    edges = (above.median - half, above.median + half)
    name = "" if recommendation.is_base else _lines(recommendation.name)
    curves += [
        Curve(recommendation.title, above.centre, above.median, "model", *edges, note=name),
        Curve("", above.centre, middle, "measured", lower, upper, points=True),
    ]
    samples = _samples(inputs, channel, shift) or (slip, measured)
    inner = np.percentile(samples[1][samples[0] > EDGES[EDGES > 0][0]], [0.5, 99.5])  # beside slip 0 all forces occur
    plane = Plane(
        driven_slips(slip),
        reach(inner, *edges, lower, upper, *(curve.y for curve in curves)),
        "Slip ratio, driving",
        _axis(channel),
    )
    at = f"{'shifted to ' if shift.slope.any() else ''}{number(shift.load_n / 1e3, 2)} kN"
    band = " Band: 95 % of the noise." if np.isfinite(half).any() else ""
    caption = (
        f"All runs, {at}. Grey: samples{beyond(samples, plane)}. Points: median and middle half about the line.{band}"
    )
    return drawn("hero", _finding(recommendation, channel, by_slip), caption, plane, curves, samples=samples)


def _hero_of_rows(found: Diagnosis, recommendation: Recommendation) -> Drawing:
    """Return the driven rows of tables and the models at their slips and loads, in the channel that shows the cause."""
    shares = [shares_of(found, cause, recommendation.measured) for cause in recommended_causes(found)[:1]]
    channel = max(shares[0], key=shares[0].__getitem__) if shares and shares[0] else recommendation.main_channel
    factor = page_unit(channel)[0]
    curves, several = [], len(found.plot_data) > 1
    for seen in found.plot_data:
        if channel not in seen.base:
            continue
        of_wheel = f"{seen.campaign}: " if several else ""
        for load, rows in by_load(seen.vertical_load_n):
            slip, at = seen.slip[rows], f", {load}" if load else ""
            if not recommendation.is_base:
                below = repeated(slip, factor * seen.base[channel][rows])
                curves.append(Curve(f"{of_wheel}{recommendation.base_name}{at}", below.centre, below.median, "base"))
            model = seen.base if recommendation.is_base else seen.extended
            above = repeated(slip, factor * model[channel][rows])
            half = Z95 * matched(above.centre, repeated(slip, factor * seen.base_sigma[channel][rows]))
            edges = (above.median - half, above.median + half)
            curves += [
                Curve(f"{of_wheel}{recommendation.title}{at}", above.centre, above.median, "model", *edges, mark=load),
                Curve("", slip, factor * seen.measured[channel][rows], "measured", points=True),
            ]
    ends = [end for curve in curves for end in (curve.y, curve.lower, curve.upper) if end is not None]
    plane = Plane(slips_of_rows(recommendation), reach(*ends), "Slip ratio, driving", _axis(channel))
    unused = f"; {words}" if (words := rows_not_used(found)) else ""
    lines = "Lines: the models at each load. Band: 95 % of scatter and error of form."
    caption = f"Points: rows{unused}. {lines}"
    title = _finding(recommendation, channel, repeated, by_load(recommendation.vertical_load_n))
    return drawn("hero", title, caption, plane, curves, wide=(740, 340, 235))


def _axis(channel: str) -> str:
    return f"{OUTPUTS[channel].name.capitalize()} ({page_unit(channel)[1]})"


def _of_two_terrains(inputs: ReportInputs, groups: Groups) -> Drawing:
    """Return pull over load against slip of two groups of runs that are probably not of one soil, as the text does."""
    curves, titles = [], groups[:2]
    for title, group, look in zip(titles, groups.runs, ("base", "model"), strict=True):
        used = [(run, run.used & (run.slip > 0)) for run in inputs.runs if run.run.id in group]
        slip, pull, load = (
            np.concatenate([getattr(run, name)[rows] for run, rows in used])
            for name in ("slip", "drawbar_pull_n", "vertical_load_n")
        )
        found = by_slip(slip, pull / load)
        curves.append(Curve(title, found.centre, found.median, look))
    slips, ratios = driven_slips(np.concatenate([curve.x for curve in curves])), reach(*(curve.y for curve in curves))
    return drawn(
        "hero",
        f"Drawbar pull over load: {' and '.join(titles)} differ",
        "As measured. Lines: median of the samples. Shaded: about slip 0.2, where they are compared.",
        Plane(slips, ratios, "Slip ratio, driving", "Drawbar pull / load"),
        curves,
        shades=[(0.1, 0.3)],
    )


def _samples(inputs: ReportInputs, channel: str, shift: LoadShift) -> tuple[FloatArray, FloatArray] | None:
    """Return slip and channel of every used driven sample of the runs; None where there are no runs."""
    field = OUTPUTS[channel].field
    if not inputs.runs or not hasattr(inputs.runs[0], field):
        return None
    slip, load, values = (
        np.concatenate([getattr(run, name)[run.used] for run in inputs.runs])
        for name in ("slip", "vertical_load_n", field)
    )
    values = page_unit(channel)[0] * (values + shift.of(slip, load))
    rows = (slip > 0) & np.isfinite(values)
    return (slip[rows], values[rows]) if rows.any() else None


def _lines(text: str) -> str:
    return text if len(text) <= 22 else "\n".join(text.rsplit(" ", 1)) if len(text) < 40 else text[:38] + "…"


def _finding(
    recommendation: Recommendation,
    channel: str,
    summary: Callable[[FloatArray, FloatArray], Bins],
    loads: Sequence[tuple[str, BoolArray]] = (),
) -> str:
    """Return what the figure shows: where the model without the cause is off most, of the lines at its loads."""
    name, (factor, unit) = OUTPUTS[channel].name, page_unit(channel)
    slip, left = recommendation.slip, factor * recommendation.residual(channel, base=True)
    found = []
    for load, rows in loads or [("", np.ones(len(slip), np.bool_))]:
        off = summary(slip[(slip > 0) & rows], left[(slip > 0) & rows])
        if len(off.median) and not recommendation.is_base:
            worst = int(np.argmax(certain := np.abs(off.median) * np.sqrt(off.count)))
            at = f"at slip {off.centre[worst]:.2f}{load and f' and {load}'}"
            found.append((certain[worst], float(off.median[worst]), at))
    if not found:
        return f"{name.capitalize()} against slip: measured and {recommendation.base_name}"
    _, size, at = max(found)
    how = "too much" if size < 0 else "too little"
    return f"{recommendation.base_name}, predicts {number(abs(size), 2)} {unit} {how} {name} {at}"


def _cautions(inputs: ReportInputs) -> list[Bias]:
    first = [finding.channel for finding in inputs.diagnosed.what_is_wrong[:1]] if inputs.diagnosed else []
    try:
        return sorted(biases(inputs.recommendation), key=lambda bias: OUTPUTS[bias.channel].role not in first)
    except DataError:
        return []


def runs_again(inputs: ReportInputs, place: str = "under Runs") -> str:
    """Return which runs to drive again, or which are not used for another reason; `place` has the reasons."""
    if not inputs.runs:
        return ""
    set_aside, count = inputs.set_aside, len(inputs.runs)
    poor = [*(run.run for run in set_aside if run.drive_again), *inputs.poor]
    others = [run.run for run in set_aside if not run.drive_again]
    if not poor and others:
        return f"none. Set aside: {_few(others, f'{len(others)} runs')}; the reasons stand {place}."
    if not poor and inputs.several_terrains is not None:
        groups = groups_of_runs(inputs.diagnosis)
        apart = f": {groups.second} are not of the soil of {groups.first}" if groups else ""
        return f"none. Each run is usable, but not all together{apart}."
    if not poor and inputs.to_check:
        to_check = [f"{name} ({why})" for name, why in inputs.to_check.items()]
        runs = _few(to_check, f"{len(to_check)} runs; the reasons stand {place}")
        return f"{'none' if count > 1 else 'no'}. Check {runs}."
    if not poor and (groups := groups_of_runs(inputs.diagnosed)):
        return f"none is broken, but {groups.first} ask for another soil than {groups.second}."
    if not poor:
        return "none. All runs are usable." if count > 1 else "no. The run is usable."
    return f"{_few(poor, f'{len(poor)} of {count + len(set_aside)} runs')}; the reasons stand {place}."


def _few(runs: list[str], many: str) -> str:
    """Return the names of runs, or a text in place of many."""
    return listed(runs) if len(runs) <= _NAMED else many


def steps_of_report(inputs: ReportInputs) -> list[Step]:
    """Return the next steps: repair what spoils runs, then what the diagnosis asks for."""
    found, steps = inputs.diagnosed, _before_diagnosis(inputs)
    if found is not None:
        steps = [*steps, *next_steps(found, inputs.vehicle)] or [step_of(found)]
    return steps[:MOST_STEPS]


def _before_diagnosis(inputs: ReportInputs) -> list[Step]:
    if poor := inputs.poor:
        poor_runs = _few(poor, f"{len(poor)} of {len(inputs.runs)} runs")
        return [Step(f"Look at data quality first; {poor_runs} {'is' if len(poor) == 1 else 'are'} poor.")]
    if inputs.campaign is None and not inputs.tables:
        return [Step("See below why the runs could not be fitted.")]
    if inputs.diagnosed is not None:
        return []
    if inputs.no_diagnosis:
        return [Step("See below why there is no diagnosis.")]
    advice = "Diagnose the runs: it says what the model gets wrong, and why."
    return [Step(advice, paste="wheelsoil diagnose FOLDER")]


def header_facts(inputs: ReportInputs) -> list[tuple[str, str]]:
    """Return what the head of the page names: dates, loads, runs, tyre, transducer, place; (label, value)."""
    found = [("", f"{_dates([run.start_ns for run in inputs.runs])}")] if inputs.runs else []
    loads = [float(np.nanmedian(run.vertical_load_n)) for run in inputs.runs if np.isfinite(run.vertical_load_n).any()]
    if loads:
        found.append(("Load", load_text(min(loads), max(loads))))
    if inputs.runs:
        found.append(("Runs", str(len(inputs.runs) + len(inputs.set_aside))))
    pressures = sorted({run.run.inflation_kpa for run in inputs.runs if run.run.inflation_kpa})
    wheel = inputs.vehicle.wheel
    tyre = [f"{wheel.tyre}"] if wheel and wheel.tyre else []
    tyre += [f"{listed([f'{pressure:g}' for pressure in pressures])} kPa"] if pressures else []
    found += [("Tyre", ", ".join(tyre))] if tyre else []
    serial = inputs.vehicle.transducer.serial
    found += [("Transducer", serial)] if serial else []
    place = _place(inputs)
    return [*found, ("", place)] if place else found


def _place(inputs: ReportInputs) -> str:
    """Return the median position of the runs; nothing where none is known, or they are kilometres apart."""
    known = [known_places(run) for run in inputs.runs]
    places = [
        (float(np.median(run.latitude_deg[rows])), float(np.median(run.longitude_deg[rows])))
        for run, rows in zip(inputs.runs, known, strict=True)
        if rows.any()
    ]
    if not places or np.ptp(places, axis=0).max() > _ONE_PLACE_DEG:
        return ""
    north, east = np.median(places, axis=0).tolist()
    return f"{abs(north):.3f}° {'N' if north >= 0 else 'S'}, {abs(east):.3f}° {'E' if east >= 0 else 'W'}"


def _dates(starts_ns: list[int]) -> str:
    dated = [datetime.fromtimestamp(start / 1e9, UTC) for start in starts_ns if start > EARLIEST_DATE_NS]
    if not dated:
        return "date unknown"
    first, last = min(dated), max(dated)
    if first.date() == last.date():
        times = f"{first:%H:%M}" if first == last else f"{first:%H:%M} to {last:%H:%M}"
        return f"{first.day} {first:%b %Y}, {times} UTC"
    return f"{first.day} {first:%b %Y} to {last.day} {last:%b %Y}"
