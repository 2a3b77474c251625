"""Diagnosis of single-wheel tables: few independent rows, a strongly nonlinear model, a soil that is barely known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq import OUTPUTS, DataError, FloatArray, Note, Severity
from model.cores import one_thread
from model.diagnosis.core.campaign import Bench, DiagnosisOptions
from model.diagnosis.core.clock import OF_TABLES, Clock
from model.diagnosis.core.consistency import inconsistencies
from model.diagnosis.core.hypotheses import (
    Posterior,
    candidates,
    cause_of,
    likely_sets,
    most_probable_form,
    notes_of_more_alike,
)
from model.diagnosis.core.naming import (
    Judgement,
    asked_again,
    barred_causes,
    confirmed,
    judgement,
    prior_shifts,
    with_more_probable,
)
from model.diagnosis.core.result import Adequacy, Cause, Diagnosis, Gain, Grounds, LackOfFit, Verdict, undecided
from model.diagnosis.single_wheel.checks import cancelling, chances_beside_usual_soil, usual_families
from model.diagnosis.single_wheel.findings import (
    detectable_in_rows,
    estimates_of,
    findings_of,
    mean_of,
    mixed_repeats,
    noise_of,
    notes_of,
    plot_data_of,
    soils_of,
    with_posterior,
)
from model.diagnosis.single_wheel.form_error import Judged, adequate_at, form_errors_of, steady
from model.diagnosis.single_wheel.noise import FormError
from model.diagnosis.single_wheel.predictions import held_out, next_tests
from model.diagnosis.single_wheel.problem import BenchProblem, CauseUse
from model.diagnosis.single_wheel.sets import NO_SLIP, Library, library, skid_law
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, weigh, weighed_again
from model.notes import DiagnosisCode, LackCode

_LEAST_ROWS = 4
_MOST_SIGNATURES = 6


@one_thread
def diagnose_bench(benches: Sequence[Bench], options: DiagnosisOptions | None = None) -> Diagnosis:
    """Diagnose single-wheel tables jointly: causes are shared, and the soil where two tables name the same one.

    Rows of a driven wheel (s >= 0) are diagnosed; rows with s < 0 have a law of their own and do not enter. A table
    with rows of a braked wheel alone is diagnosed by its sinkage.

    Raises
    ------
    ConfigError
        A laboratory soil that cannot carry a wheel.
    DataError
        No rows, or a wheel that no soil near the laboratory's carries.
    """
    options = options or DiagnosisOptions()
    if not any(len(table.rows) for table in benches):
        raise DataError.of("the table has no rows to diagnose", ", ".join(b.name for b in benches))
    clock = Clock(shares=OF_TABLES)
    with clock.stage("rows"):
        chosen, channels, remarks = _rows(benches, options.channels)
        problem = BenchProblem.of(chosen, channels, options.reading, FormError(options.error_of_form))
        known = library(problem, options.effects)
    few = _too_few(problem)
    if few:
        lacking = {**known.not_identifiable, **dict.fromkeys(known.families, few)}
        return undecided(few, lacking, tuple(remarks), clock.stages_s)
    rng = np.random.default_rng(options.seed)
    with clock.stage("evidence"):
        weighing = weigh(problem, known.uses, options.most_causes, rng)
    with clock.stage("held_out"):
        gain = held_out(weighing, rng)
    with clock.stage("verdict"):
        verdict, causes = _judged(weighing, known, gain, options, rng)
        shifts = prior_shifts(
            weighing.posterior,
            _verdict(weighing.posterior, weighing, known, gain, options),
            lambda other: _verdict(other, weighing, known, gain, options),
        )
    turned = None
    with clock.stage("error_of_form"):
        if not weighing.any_adequate:
            turned = adequate_at(weighing, rng)
        elif problem.form_is_taken:
            plain = _verdict(weighing.posterior, weighing, known, gain, options)
            base = Judged(verdict, plain, weighing.posterior)
            after, turned = steady(base, lambda factor: _again(weighing, known, gain, options, factor))
            after = with_more_probable(after, weighing.posterior)
            if after != verdict:
                verdict, causes = after, _causes(weighing, after.families, rng)
    worst = findings_of(weighing, weighing.sets[0])[:3] if verdict.verdict == "unexplained" else ()
    grounds = Grounds(
        barred=verdict.barred,
        beside=verdict.beside,
        most_probable=likely_sets(weighing.posterior)[0].causes,
        kept_back=barred_causes(weighing.posterior, verdict),
        lack_of_fit=LackOfFit(tuple(worst)),
        prior_shifts=shifts,
        cautions=(
            *notes_of_more_alike(weighing.posterior, verdict.verdict, verdict.families),
            *mixed_repeats(problem),
        ),
        table_channels=problem.channels,
        form_errors=form_errors_of(problem, given=options.error_of_form is not None),
        form_matters=turned,
    )
    with clock.stage("verdict"):
        found = _diagnosis(benches, weighing, known, (verdict, causes), remarks, options, rng)
    return replace(found, gain=gain, grounds=grounds, stages_s=clock.stages_s)


def _rows(tables: Sequence[Bench], channels: tuple[str, ...]) -> tuple[list[Bench], tuple[str, ...], list[Note]]:
    """Return the rows to diagnose, the channels to use, and what is to be noted of the choice."""
    driven = [table.rows.slip > -NO_SLIP for table in tables]
    braked = not any(int(np.count_nonzero(table.rows.slip > NO_SLIP)) for table in tables)
    kept, remarks = [], []
    for table, rows in zip(tables, driven, strict=True):
        usable = np.isfinite(table.rows.slip) & np.isfinite(table.rows.vertical_load_n)
        wanted = usable & ((table.rows.slip < NO_SLIP) if braked else rows)
        left = int(np.count_nonzero(usable & ~wanted))
        if left:
            remarks.append(Note(DiagnosisCode.BRAKED_ROWS_EXCLUDED, values={"table": table.name, "rows": left}))
        part = table.rows[wanted]
        slip = np.minimum(part.slip, 0.0) if braked else np.maximum(part.slip, 0.0)
        kept.append(replace(table, rows=replace(part, slip=slip)))
    if braked:
        remarks.append(Note(DiagnosisCode.BRAKED_ROWS_ONLY))
        return kept, tuple(c for c in channels if c == "z"), remarks
    return kept, channels, remarks


def _too_few(problem: BenchProblem) -> Note | None:
    """Return why nothing can be decided; None where something can."""
    rows = sum(len(chosen) for chosen in problem.rows)
    if not problem.noises:
        return Note(LackCode.NO_CHANNEL_MEASURED, Severity.FAULT)
    if rows < _LEAST_ROWS or len(np.unique(problem.group)) < 2:
        facts = {"rows": len(problem.slip), "conditions": len(np.unique(problem.group))}
        return Note(LackCode.FEW_ROWS, Severity.FAULT, facts)
    return None


def _diagnosis(
    tables: Sequence[Bench],
    weighing: Weighing,
    known: Library,
    judged: tuple[Judgement, tuple[Cause, ...]],
    remarks: Sequence[Note],
    options: DiagnosisOptions,
    rng: np.random.Generator,
) -> Diagnosis:
    problem = weighing.problem
    found = weighing.posterior
    judgement, causes = judged
    verdict = judgement.verdict
    best = with_posterior(weighing, _extension(weighing, verdict, causes), rng)
    shown = _shown(weighing, causes)
    plot_data = plot_data_of(weighing, best, shown)
    runs = next_tests(weighing, judgement, rng) if verdict == "one_of" or options.next_run else ()
    skids = {table.name: law for table in tables if (law := skid_law(table)) is not None}
    null = weighing.of_set(())
    return Diagnosis(
        verdict=verdict,
        causes=causes,
        candidates=candidates(found),
        what_is_wrong=findings_of(weighing),
        inconsistent=inconsistencies(tables),
        adequacy=_adequacy(weighing),
        proposal=None,
        minimum_detectable=detectable_in_rows(problem, known, null.optima[0], options.name_at),
        next_run=runs,
        not_identifiable=known.not_identifiable,
        notes=(*remarks, *notes_of(problem, plot_data, skids, weighing)),
        noise=_noise(problem, mean_of(weighing.sets[0].posterior)),
        soils=soils_of(weighing, best),
        plot_data=plot_data,
        sets=likely_sets(found),
    )


def _judged(
    weighing: Weighing, known: Library, gain: Gain | None, options: DiagnosisOptions, rng: np.random.Generator
) -> tuple[Judgement, tuple[Cause, ...]]:
    """Return the verdict, and its causes with their values."""
    found = weighing.posterior
    verdict = _verdict(found, weighing, known, gain, options)
    causes = _causes(weighing, verdict.families, rng)
    after = confirmed(verdict, found, causes)
    if after.verdict == "named" and (usual := usual_families(known.uses)):
        own = np.random.default_rng(options.seed)
        chances = chances_beside_usual_soil(weighing, known.uses, options.most_causes, own)
        after = asked_again(after, chances, usual, options.name_at)
    after = with_more_probable(after, found)
    return (verdict, causes) if after == verdict else (after, _causes(weighing, after.families, rng))


def _verdict(
    found: Posterior, weighing: Weighing, known: Library, gain: Gain | None, options: DiagnosisOptions
) -> Judgement:
    lacking, cancel = known.not_identifiable, cancelling(weighing)
    plain = judgement(found, _adequacy(weighing), gain, lacking, options.name_at, contradiction=cancel)
    return with_more_probable(plain, found)


def _again(
    weighing: Weighing, known: Library, gain: Gain | None, options: DiagnosisOptions, factor: float
) -> Judgement:
    """Return the verdict that the sets which count lead to with the error of form times a factor."""
    problem = weighing.problem.with_form_error(FormError(options.error_of_form, factor))
    other = weighed_again(weighing, problem, np.random.default_rng(options.seed))
    return _verdict(other.posterior, other, known, gain, options)


def _adequacy(weighing: Weighing) -> Adequacy:
    return Adequacy(weighing.sets[0].misfit, weighing.threshold, weighing.any_adequate)


def _causes(weighing: Weighing, families: Sequence[str], rng: np.random.Generator) -> tuple[Cause, ...]:
    found = weighing.posterior
    forms = {family: most_probable_form(found, family) for family in families}
    return tuple(
        cause_of(found, family, key, estimates_of(weighing, CauseUse(key), rng)) for family, key in forms.items()
    )


def _extension(weighing: Weighing, verdict: Verdict, causes: Sequence[Cause]) -> Weighed:
    """Return the set that extends the simulation: the named causes, a set's most probable member, or the least bad."""
    if verdict == "unexplained":
        return weighing.sets[0]
    keys = [cause.key for cause in (causes if verdict == "named" else causes[:1])]
    return next((w for w in weighing.sets if {use.key for use in w.hypothesis} == set(keys)), weighing.sets[0])


def _shown(weighing: Weighing, causes: Sequence[Cause]) -> list[str]:
    """Return the candidates to draw: the causes, then the most probable others, each by its most probable form."""
    ranked = [w for w in sorted(weighing.sets, key=lambda w: -w.score) if len(w.hypothesis) == 1]
    keys = [cause.key for cause in causes] + [w.hypothesis[0].key for w in ranked]
    return list(dict.fromkeys(keys))[:_MOST_SIGNATURES]


def _noise(problem: BenchProblem, predicted: dict[str, FloatArray]) -> dict[str, float]:
    found = {}
    for channel, (scatter, form) in noise_of(problem, predicted).items():
        found[f"{channel}_repeats_{OUTPUTS[channel].suffix}"] = scatter
        found[f"{channel}_form_{OUTPUTS[channel].suffix}"] = form
    return found
