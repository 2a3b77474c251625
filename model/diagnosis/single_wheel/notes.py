"""What is to be noted of a diagnosis of single-wheel tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from daq import Note, Severity
from model.diagnosis.core.result import PlotData
from model.diagnosis.single_wheel.noise import scatter_of_repeats
from model.diagnosis.single_wheel.problem import BenchProblem
from model.diagnosis.single_wheel.sets import SkidLaw
from model.diagnosis.single_wheel.weighing import Weighing
from model.notes import DiagnosisCode

MUCH_SCATTER = 0.05
"""Of the load, from which on repeats are hardly repeats."""
_USUAL_LOAD_N = 10_000.0


def mixed_repeats(problem: BenchProblem) -> tuple[Note, ...]:
    """Return a note where repeats of one test differ as different tests do; else nothing."""
    for noise in problem.noises:
        share = scatter_of_repeats(noise.measured, noise.groups) / problem.size_of(noise.channel)
        if noise.channel != "z" and share > MUCH_SCATTER:
            facts = {"channel": noise.channel, "share": share}
            return (Note(DiagnosisCode.REPEATS_MIXED, Severity.FAULT, facts),)
    return ()


def notes_of(
    problem: BenchProblem, seen: Sequence[PlotData], skids: Mapping[str, SkidLaw], weighing: Weighing
) -> list[Note]:
    """Return what a reader must know."""
    load_n = problem.typical_load_n
    notes = [Note(DiagnosisCode.PRIOR_SCALED, values={"share": load_n / _USUAL_LOAD_N, "load_n": load_n})]
    for noise in problem.noises:
        scatter = scatter_of_repeats(noise.measured, noise.groups)
        facts = {"channel": noise.channel, "scatter": scatter, "form_scale": noise.form_scale}
        notes.append(Note(DiagnosisCode.REPEATS_SCATTER, values=facts))
    laws = [Note(DiagnosisCode.SKID_LAW, values={"table": name, **asdict(law)}) for name, law in skids.items()]
    return [*notes, *_likeliest(weighing), *_unseen(seen), *laws]


def _likeliest(weighing: Weighing) -> list[Note]:
    """Return the most probable set, and how probable its families are without the gate of adequacy."""
    best = weighing.sets[0]
    if not weighing.any_adequate or not best.families:
        return []
    keys = tuple(use.key for use in best.hypothesis)
    ungated = {family: weighing.of_family(family, weighing.ungated) for family in sorted(best.families)}
    return [
        Note(DiagnosisCode.LIKELIEST_SET, values={"keys": keys, "probability": float(weighing.probabilities[0])}),
        Note(DiagnosisCode.WITHOUT_GATE, values={"families": ungated}),
    ]


def _unseen(seen: Sequence[PlotData]) -> list[Note]:
    """Return how far each candidate is from channels that it has not seen."""
    notes = []
    for table in seen:
        for channel in table.unseen:
            errors = {
                key: float(np.sqrt(np.nanmean((said[channel] - table.measured[channel]) ** 2)))
                for key, said in table.implied.items()
            }
            known = {key: error for key, error in errors.items() if np.isfinite(error)}
            if known:
                facts = {"table": table.campaign, "channel": channel, "errors": known}
                notes.append(Note(DiagnosisCode.UNSEEN_CHANNEL, values=facts))
    return notes
