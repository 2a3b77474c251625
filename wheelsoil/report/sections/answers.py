"""What a test engineer asks of runs, with an answer each: a digest of the page, and what no other section says."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import nan
from typing import NamedTuple

import numpy as np

from daq import OUTPUTS, TRANSDUCER_ROLES
from model.diagnosis import Diagnosis, Scores
from model.effects import EFFECTS, Effect
from model.wheel_soil import Reading, Soil, Wheel
from wheelsoil.report.content import Contents, Links, section
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import biases, caution_text, rows_check
from wheelsoil.report.sections.glance import (
    confidence_tile,
    data_tile,
    ends_of_slip,
    only_driving,
    runs_again,
    steps_of_report,
)
from wheelsoil.report.sections.overview import faults_of
from wheelsoil.wording.cost_text import cost_meaning, cost_sentence, driving_text
from wheelsoil.wording.grounds_text import detectable_by_family, detectable_words, findings_text, unsure_words
from wheelsoil.wording.names import listed, page_unit, plain_name, upper
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import load_text, number, signed
from wheelsoil.wording.transducer_text import transducer_words
from wheelsoil.wording.verdict import doubt_of_the_peak, groups_of_runs, headline_of, several_terrains, size_text
from wheelsoil.workflows.cause_cost import (
    USUAL_SLIP,
    Cost,
    Driving,
    cost_of_verdict,
    costs_of,
    highest_slip_of,
    pull_beyond,
    usual_driving,
)
from wheelsoil.workflows.fit import wheel_of
from wheelsoil.workflows.traction import at_usual_slip

_MOST_CAUSES = 3


@section("answers", "In short")
def answers(inputs: ReportInputs) -> Contents:
    """Build the section: question, answer, and the section that shows it; what has changed is added by the page."""
    found = inputs.diagnosis
    again, faults = runs_again(inputs), {role: faults_of(role, inputs) for role in TRANSDUCER_ROLES}
    lines = [
        ("What is wrong?", _wrong(found), "#causes"),
        ("How sure is that?", _sure(found), "#causes"),
        ("How big is it?", _size(inputs), "#causes"),
        ("What does it cost?", _cost(inputs), "#cost" if found.verdict == "named" and inputs.runs else ""),
        ("Are the data good?", _data(inputs), "#signals" if inputs.runs else "#fit"),
        ("Which runs are bad?", upper(again) or _rows(inputs), "#runs" if again else "#fit"),
        ("What next?", " ".join(step.what for step in steps_of_report(inputs)[:1]), "#glance"),
        ("Can the transducer be trusted?", " ".join(transducer_words(found, faults)), "#detectable"),
        ("How good is the model elsewhere?", _elsewhere(inputs), "#gain"),
    ]
    return [Links("What a test engineer asks", lines)], {}


def _wrong(found: Diagnosis) -> str:
    """Return the headline, and what each of its causes is."""
    causes = () if several_terrains(found) else found.causes[:_MOST_CAUSES]
    meanings = ((c.name, EFFECTS.get(c.key, Effect).summary) for c in causes)
    return " ".join([headline_of(found), *(f"{upper(plain_name(name))}: {text}" for name, text in meanings if text)])


def _sure(found: Diagnosis) -> str:
    tile, doubt = confidence_tile(found), doubt_of_the_peak(found) if several_terrains(found) is None else None
    each = ", each alone or with others" if found.verdict == "one_of" and len(found.causes) > 1 else ""
    stated = f"{tile.value} {tile.unit} {tile.note}{each}." if tile.unit else f"{upper(tile.note)}."
    return " ".join([stated, *([f"{upper(note_text(doubt))}."] if doubt else [])])


def _data(inputs: ReportInputs) -> str:
    tile, runs = data_tile(inputs), f"{inputs.usable_runs}; " if inputs.runs else ""
    return f"{runs}{tile.value} {tile.unit}{'; ' if runs else ' '}{tile.note}."


def _rows(inputs: ReportInputs) -> str:
    recommendation = inputs.recommendation
    checks = [rows_check(recommendation, channel) for channel in recommendation.measured]
    more = "No more" if all(well for well, _ in checks) else "More"
    return " ".join([f"{more} rows are off than scatter explains.", *(text for _, text in checks)])


def _rests_on_nothing(inputs: ReportInputs) -> bool:
    """Return whether no model of these runs or rows may be relied on."""
    found = inputs.diagnosis
    undecided = found.verdict == "unexplained" or found.grounds.undecided is not None
    return undecided or inputs.several_terrains is not None


def _size(inputs: ReportInputs) -> str:
    found, note = inputs.diagnosis, inputs.several_terrains
    if note is not None:
        return f"{upper(note_text(note))}."
    if (groups := groups_of_runs(found)) and inputs.runs:
        pulls = [f"{_pull_over_load(inputs, ids)} on {name}" for name, ids in zip(groups[:2], groups.runs, strict=True)]
        return f"Pull over load near slip {USUAL_SLIP:g} is {' and '.join(pulls)}."
    if found.verdict == "unexplained":
        off = [caution_text(bias) for bias in biases(inputs.recommendation) if bias.driving]
        worst = findings_text(found.what_is_wrong[:1] or found.grounds.lack_of_fit.worst)
        return " ".join(off) or f"Residual: {worst or 'not known'}."
    if found.causes:
        sizes = [f"{plain_name(cause.name)}, {size_text(cause)}" for cause in found.causes[:_MOST_CAUSES]]
        return f"{upper('; '.join(sizes))}."
    sizes_seen = detectable_by_family(found)
    return f"No size is found; {detectable_words(sizes_seen)}." if sizes_seen else "Not known."


def _pull_over_load(inputs: ReportInputs, ids: Collection[str]) -> str:
    """Return between what the measured pull over load of runs lies near the usual slip."""
    pulls = [at_usual_slip((run,), "drawbar_pull_n") for run in inputs.runs if run.run.id in ids]
    ratios = [pull.pull_n / pull.load_n for pull in pulls if pull is not None]
    ends = dict.fromkeys(f"{end:.2f}" for end in (min(ratios), max(ratios))) if ratios else ["not known"]
    return " to ".join(ends)


class _Ground(NamedTuple):
    """Wheel and laboratory's soil, how the paper is read, and the usual driving; the speed of a table is not known."""

    wheel: Wheel
    soil: Soil
    reading: Reading
    driving: Driving


def _ground(inputs: ReportInputs) -> _Ground:
    if inputs.tables:
        table, load_n = inputs.tables[0], float(np.median(inputs.recommendation.vertical_load_n))
        return _Ground(table.wheel, table.soil, "balanced", Driving(load_n, nan))
    wheel, fit = wheel_of(inputs.vehicle, "vehicle.toml"), inputs.fit
    return _Ground(wheel, fit.soil, fit.options.reading, usual_driving(inputs.fitted))


def _cost(inputs: ReportInputs) -> str:
    found = inputs.diagnosis
    if _rests_on_nothing(inputs):
        return "Not known: no cause is named."
    if not found.causes:
        none = "Nothing that these data show: no cause is detected."
        return f"Not known. {unsure_words(found)}." if unsure_words(found) else none
    wheel, soil, reading, driving = _ground(inputs)
    if found.verdict == "named":
        highest = highest_slip_of(inputs.fitted) if inputs.runs else ends_of_slip(inputs)[1]
        whole = cost_of_verdict(found, driving, wheel, soil, reading, highest_slip=highest)
        cost_text = _at_the_ends(whole.costs)
        error = " It is an error of the reading." if {cause.kind for cause in found.causes} == {"measurement"} else ""
        return f"{driving_text(whole.driving)}, {cost_text}.{error}" if cost_text else cost_meaning(whole)
    texts = []
    for cause in found.causes[:_MOST_CAUSES]:
        costs, _ = costs_of([cause], wheel, soil, found.soils[0], driving, reading)
        reads = " (an error of the reading)" if cause.kind == "measurement" else ""
        texts.append(f"{plain_name(cause.name)}{reads}: {_at_the_ends(costs) or 'nothing in steady driving'}")
    doubt = "No cause is named. If one acts alone, against the same soil without it: "
    return f"{doubt}{driving_text(driving)}, {'; '.join(texts)}."


def _at_the_ends(costs: Sequence[Cost]) -> str:
    """Return what causes change at the usual slip and at the highest one."""
    ends = dict.fromkeys((costs[0].slip, max(cost.slip for cost in costs)))
    return "; ".join(text for slip in ends if (text := cost_sentence(costs, slip)))


def _errors(scores: Mapping[str, Scores]) -> str:
    return listed(
        [
            f"{OUTPUTS[channel].name} {number(factor * score.R0)} {text}"
            for channel, score in scores.items()
            for factor, text in [page_unit(channel)]
        ]
    )


def _elsewhere(inputs: ReportInputs) -> str:
    found, recommendation = inputs.diagnosis, inputs.recommendation
    if _rests_on_nothing(inputs):
        return "Rely on no model of these data."
    load_n, runs = recommendation.vertical_load_n, set(recommendation.run)
    loads = load_n.tolist() if inputs.tables else [float(np.median(load_n[recommendation.run == i])) for i in runs]
    slips = [signed(end, ".2f") for end in ends_of_slip(inputs)]
    tested = f"Tested at {load_text(min(loads), max(loads))}, slip {' to '.join(slips)}"
    if found.gain is not None:
        without, whole = _errors(found.gain.base), _errors(found.gain.extended)
        tested += f": error on held-out data {whole if found.verdict == 'named' else without}"
        tested += (
            f" without a cause, {whole} with {plain_name(found.causes[0].name)}" if found.verdict == "one_of" else ""
        )
    wheel, soil, reading, driving = _ground(inputs)
    beyond_n, pull, read = pull_beyond(found, max(loads), wheel, soil, reading, driving)
    model = {"named": "recommended model", "one_of": "calibrated soil without a cause"}.get(found.verdict, "model")
    physical = f", without the cause {number(pull.without)} N" if pull.with_causes != pull.without else ""
    reads = f"; the transducer as it is would read {number(read)} N" if abs(read - pull.with_causes) > 0 else ""
    passage = f" on passage {driving.passage:.0f}" if driving.passage > 1 else ""
    at = f"at {load_text(beyond_n)} and slip {pull.slip:g}{passage}"
    says = f"the {model} says {number(pull.with_causes)} N of pull{physical}{reads}"
    return " ".join([f"{tested}.", *only_driving(inputs), f"Not tested beyond, nor on another soil: {at} {says}."])
