"""Jobs of a helper process. A processed run stays in a file; the page gets the data that it draws."""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from daq import ON_TIME_BASE, DataError, Use, VehicleConfig
from daq.runs import Run
from model.diagnosis import Diagnosis
from model.wheel_soil import SOIL_PARAMETERS, Conditions, Soil, Wheel, conditions_of
from processing import Interval, ProcessedRun, ProcessOptions, Reason, is_refused, keep_only, require_roles
from wheelsoil.report.inputs import source_of
from wheelsoil.to_json import plain
from wheelsoil.view.changes import changes_since_last
from wheelsoil.view.medians import medians_of
from wheelsoil.view.trace import Signals, Trace, signals_of, trace_of
from wheelsoil.wording.cost_text import cost_meaning, cost_note, cost_rows, cost_title
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.wording.figures import figure_value
from wheelsoil.wording.grounds_text import chances_of, verdict_words
from wheelsoil.wording.mending import first_steps
from wheelsoil.wording.notes import note_text, texts_of
from wheelsoil.wording.numbers import typeset
from wheelsoil.wording.verdict import (
    falling_channel,
    finding_of,
    model_title,
    reduction_in,
    refusal_words,
    several_terrains,
    size_text,
    stated_channel,
    statements_of,
)
from wheelsoil.workflows.cause_cost import (
    CausesCost,
    cost_of_verdict,
    highest_slip_of,
    steady_traction,
    usual_driving,
)
from wheelsoil.workflows.choice import FitChoices
from wheelsoil.workflows.diagnosis import (
    Processed,
    campaigns_of,
    diagnose_campaigns,
    diagnosis_options,
    known_diagnosis,
)
from wheelsoil.workflows.fit import fit_as_json, fit_runs, known_soil, wheel_of, whole_runs
from wheelsoil.workflows.grading import plausibility_of
from wheelsoil.workflows.key_figures import KeyFigure, figures_of_diagnosis
from wheelsoil.workflows.runs import on_soil, process_runs, repetitions

_UNIT_WEIGHT_N_M3 = float(Conditions.unit_weight_n_m3)
"""Until the soil is known: a curve takes that of its own."""
_DRAWN = tuple(channel.field for channel in ON_TIME_BASE if channel.use is not Use.EXTRA)


@dataclass(frozen=True, eq=False)
class PlotData:
    """Data of a processed run that the page keeps.

    Attributes
    ----------
    run : ProcessedRun
        All samples of the drawn quantities, in single precision except time and slip, so that counts and averages
        refer to all samples, not only to the drawn points. The other arrays are empty.
    lost : tuple of str
        Losses of its recording, as sentences.
    missing : mapping role -> str
        See `processing.processed_run.QualityReport`.
    no_use : str
        Why the run is impossible as it is declared, or on firm ground without having coasted; empty where not.
    conditions : Conditions
        Of the drawn samples; place on the line and clock as if the run were alone.
    medians : mapping
        See `wheelsoil.view.medians.medians_of`.
    marks : tuple of (seconds since the run's time base begins, text)
        That were set in the field.
    """

    run: ProcessedRun
    trace: Trace
    lost: tuple[str, ...]
    notes: tuple[str, ...]
    sha256: str
    missing: dict[str, str]
    no_use: str
    conditions: Conditions
    medians: dict[str, float | None]
    marks: tuple[tuple[float, str], ...]

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return float(self.run.time_s[-1])

    def kept(self, keep: Sequence[Interval] | None) -> ProcessedRun:
        """Return the run with the manual exclusions; an interval is cut at the end of the run."""
        if keep is None:
            return self.run
        return keep_only(self.run, [(first, min(last, self.end_s)) for first, last in keep if first <= self.end_s])


@dataclass(frozen=True)
class Member:
    """A run that is used: its file of `process_run`, and the parts that are kept (None: all)."""

    file: Path
    keep: tuple[Interval, ...] | None


def process_run(run: Run, options: ProcessOptions, zero: Path | None, target: Path) -> PlotData:
    """Process a run, write it to `target` and return the data that the page draws; see `process_runs` for errors."""
    stderr = io.StringIO()
    with redirect_stderr(stderr):
        [(_, processed)] = process_runs([run], options, zero=zero, accept_implausible=True)
    known = replace(run, databases={}, attachments={}, recording=None)
    target.write_bytes(pickle.dumps((known, processed), pickle.HIGHEST_PROTOCOL))
    no_use = _no_use(processed)
    # One that no soil is fitted to is drawn without a used sample.
    why = Reason.SET_ASIDE if no_use else Reason.FIRM_GROUND if processed.run.ground == "firm" else Reason.USED
    processed = replace(processed, reason=np.where(processed.used, np.uint8(why), processed.reason))
    source, trace = source_of(run), trace_of(processed)
    [conditions] = conditions_of([processed], _UNIT_WEIGHT_N_M3)
    # The run without the arrays that the page does not use; see `PlotData`.
    arrays = {field.name for field in fields(processed) if isinstance(getattr(processed, field.name), np.ndarray)}
    changed: dict[str, Any] = {name: np.zeros(0) for name in arrays - {"time_s", "slip", "reason"}}
    changed["extras"] = {}
    changed |= {name: getattr(processed, name).astype(np.float32) for name in _DRAWN}
    return PlotData(
        run=replace(processed, **changed),
        trace=trace,
        lost=tuple(source.lost),
        notes=(*map(typeset, texts_of(processed.quality.notes)), *filter(None, stderr.getvalue().splitlines())),
        sha256=source.sha256,
        missing={role: note_text(note) for role, note in processed.quality.missing.items()},
        no_use=no_use,
        conditions=conditions.rows(trace.rows),
        medians=medians_of(processed),
        marks=tuple(
            ((event.time_ns - processed.start_ns) * 1e-9, event.text) for event in source.events if event.name == "mark"
        ),
    )


def _no_use(processed: ProcessedRun) -> str:
    from model.diagnosis import coasted

    if is_refused(processed):
        return texts_of(plausibility_of(processed))[0]
    try:
        if processed.run.ground == "firm":
            coasted(processed)
    except DataError as error:
        return typeset(str(error).replace("\n ", ";"))
    return ""


def decode_run(run: Run, start_ns: int, target: Path) -> None:
    """Write every decoded signal of a run, thinned, to `target`; raises as `daq.runs.Run.frame_batches` does."""
    target.write_bytes(pickle.dumps(signals_of(run, start_ns), pickle.HIGHEST_PROTOCOL))


def decoded(file: Path) -> Signals:
    """Return what `decode_run` wrote."""
    found: Signals = pickle.loads(file.read_bytes())
    return found


def fit_members(members: Sequence[Member], choices: FitChoices, soil: str | None) -> dict[str, Any]:
    """Return the fit as `fit --json` prints it, and the curve request of each model by its name; see `fit_runs`."""
    fit = fit_runs(_taken(members, choices.purpose), choices, soil)
    curves = {
        model.name: {
            "sinkage": choices.reading,
            "effects": model.effects,
            "values": {name: x for name, x in model.values.items() if name not in SOIL_PARAMETERS},
            "soil": {name: x for name, x in model.values.items() if name in SOIL_PARAMETERS},
        }
        for model in fit.models
    }
    found: dict[str, Any] = plain(fit_as_json(fit) | {"curves": curves})
    return found


def diagnose_members(
    members: Sequence[Member], paths: Sequence[Path], soil: str | None, choices: FitChoices, against: str = ""
) -> dict[str, Any]:
    """Return the diagnosis as `diagnose --json` prints it, and what the page writes; see `diagnose_campaigns`."""
    taken = _taken(members, "diagnose")
    diagnosis = diagnose_campaigns(campaigns_of(paths, taken, soil), diagnosis_options(choices.reading))
    return _on_page(diagnosis, taken, soil, choices, against)


def kept_diagnosis(
    members: Sequence[Member], paths: Sequence[Path], soil: str | None, choices: FitChoices, against: str = ""
) -> dict[str, Any] | None:
    """Return what `diagnose_members` returns if it is kept from before; else None, without computing it."""
    taken = _taken(members, "diagnose")
    diagnosis = known_diagnosis(campaigns_of(paths, taken, soil), diagnosis_options(choices.reading))
    return None if diagnosis is None else _on_page(diagnosis, taken, soil, choices, against)


def _on_page(
    diagnosis: Diagnosis, taken: Processed, soil: str | None, choices: FitChoices, against: str
) -> dict[str, Any]:
    """Return a diagnosis for the page; `against` is the place of the last report or of a store, if there is one."""
    shown = shown_of(diagnosis, _cost(diagnosis, taken, soil, choices), taken[0][0].vehicle)
    found: dict[str, Any] = plain(diagnosis_json(diagnosis) | shown)
    if not against:
        return found | {"since": None}
    runs = whole_runs(run for _, run in taken)
    traction = steady_traction(diagnosis, runs, *_ground_of(taken, soil), choices.reading)
    return found | {"since": changes_since_last(against, found, taken, traction)}


def _ground_of(taken: Processed, soil: str | None) -> tuple[Wheel, Soil]:
    """Return the wheel and the laboratory soil."""
    first = taken[0][0]
    return wheel_of(first.vehicle, first.vehicle_source), known_soil(soil, first.terrain)


def _cost(diagnosis: Diagnosis, taken: Processed, soil: str | None, choices: FitChoices) -> CausesCost | None:
    """Return what the causes cost; None where none is named, or the model has no answer."""
    runs = whole_runs(run for _, run in taken)
    try:
        ground, highest = _ground_of(taken, soil), highest_slip_of(runs)
        return cost_of_verdict(diagnosis, usual_driving(runs), *ground, choices.reading, highest_slip=highest)
    except DataError:
        return None


def shown_of(
    diagnosis: Diagnosis, cost: CausesCost | None = None, vehicle: VehicleConfig | None = None
) -> dict[str, Any]:
    """Return what the page writes of a diagnosis: its sentences, its key figures as text and unrounded, its cost."""
    channel = stated_channel(diagnosis)
    figures = figures_of_diagnosis(diagnosis)
    rows = cost_rows(cost) if cost else []
    figures |= {cell.key: cell for row in rows for cell in row if isinstance(cell, KeyFigure)}
    _, *others = statements_of(diagnosis)
    return {
        "words": typeset(verdict_words(diagnosis.verdict, chances_of(diagnosis))),
        "finding": typeset(finding_of(diagnosis)),
        "details": typeset(
            " ".join(statement.text for statement in others if statement.about not in ("next", "as_if"))
        ),
        "next": typeset(" ".join(text for text, _ in first_steps(diagnosis, vehicle or VehicleConfig()))),
        "model_title": model_title(diagnosis).lower(),
        "refused": typeset(refusal_words(diagnosis)),
        "main_channel": channel,
        "change_percent": None if diagnosis.gain is None else reduction_in(diagnosis.gain, channel).percent,
        "better": falling_channel(diagnosis) == channel and several_terrains(diagnosis) is None,
        "sizes": [typeset(size_text(cause)) for cause in diagnosis.causes],
        "figures": {
            key: {"value": figure.value, "text": figure_value(figure), "unit": figure.unit, "model": figure.model}
            for key, figure in figures.items()
        },
        "cost": cost
        and {
            "title": cost_title(cost),
            "says": f"{cost_meaning(cost)} {cost_note(cost)}",
            "rows": [[cell.key if isinstance(cell, KeyFigure) else cell for cell in row] for row in rows],
        },
    }


def not_identifiable(members: Sequence[Member], paths: Sequence[Path], soil: str | None) -> dict[str, str]:
    """Return the families of effects that these runs cannot identify, each with a sentence that gives the reason."""
    from model.diagnosis import not_identifiable, samples_of
    from model.diagnosis.time_series import coverage_of

    taken = _taken(members, "diagnose")
    if not taken:
        raise DataError("no run is used")
    [campaign] = campaigns_of(paths, taken, soil)
    lacking = not_identifiable(coverage_of(campaign, samples_of(campaign)))
    return {family: typeset(note_text(why)) for family, why in lacking.items()}


def _taken(members: Sequence[Member], purpose: str) -> Processed:
    found: list[tuple[Run, ProcessedRun]] = []
    for member in members:
        run, processed = pickle.loads(member.file.read_bytes())
        rotating = run.vehicle.transducer.frame == "wheel"
        require_roles(run.vehicle.signals, purpose, rotating=rotating, where=f"run {run.id}, {run.vehicle_source}")
        found.append((run, processed if member.keep is None else keep_only(processed, member.keep, f"run {run.id}")))
    for i, j in repetitions([processed for _, processed in found]).items():
        same, run = found[j][0], found[i][0]
        where, step = f"run {run.id}, {run.path}", f"switch {run.id} off"
        raise DataError.of(f"the same measurement as run {same.id}", where, str(same.path), "one of them", step)
    return on_soil(found)
