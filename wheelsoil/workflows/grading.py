"""How good a run is, at a glance: good, fair or poor, and what speaks against it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from daq import SOIL_KEYS, Note, Severity, TerrainConfig
from processing import SLIP_ROLES, ProcessedRun, Reason, RunCode
from wheelsoil.wording.notes import runs_by_text, texts_of
from wheelsoil.wording.plausibility_text import without_numbers

Level = Literal["good", "fair", "poor"]

_BY_DESIGN = (Reason.STANDSTILL, Reason.TOO_SLOW, Reason.FILTER_EDGE, Reason.BY_HAND, Reason.STEERED)
"""Samples that no run has a use for: they speak against none."""
_GOOD_SHARE, _FAIR_SHARE = 0.8, 0.5
_GOOD_SLIP, _DRIVEN_SLIP = 0.5, 0.1
"""Low slip tells little; a run that was only braked or coasted is no bad data, so that it is never poor for it."""
_ZERO_SHARE, _MANY_SIGMAS = 0.02, 3.0
"""Of the load: a reading at standstill that is larger than this, and than its noise, spoils a run."""
_LARGE_COHESIVE_KN, _SMALL_FRICTIONAL_KN = 1e4, 10.0
"""Of k_c and k_phi: beyond both they are probably exchanged."""
_LARGEST_SIGMA = 3.0
"""Of a soil's value: a larger one-sigma is probably in percent."""
_SHORT, _FEWEST = 0.5, 3
"""Of the usual length, of so many runs: a shorter one is noted."""


@dataclass(frozen=True)
class Grade:
    """What a run is worth.

    Attributes
    ----------
    level : "good", "fair" or "poor"
    reasons : tuple of str
        What speaks against it, the worst first; empty for a good run.
    usable_share : float
        Of the samples in which the vehicle moved; NaN where it never did.
    highest_slip : float
        Of the usable samples; NaN without any.
    """

    level: Level
    reasons: tuple[str, ...]
    usable_share: float
    highest_slip: float


def grade_of(run: ProcessedRun, lost: Sequence[str] = (), named: Collection[str] = ()) -> Grade:
    """Grade a run; anything of its recording that was `lost`, in words, makes a good run fair.

    A channel of `named` has a zero that is named for all runs, and is not judged by this run.
    """
    moving = ~np.isin(run.reason, _BY_DESIGN)
    share = float(run.used.sum() / moving.sum()) if moving.any() else float("nan")
    slip = run.slip[run.used]
    highest = float(np.percentile(slip, 99.5)) if len(slip) else float("nan")
    notes, missing = run.quality.notes, run.quality.missing
    poor, fair = _of_samples(run, share, highest) if not set(missing) & set(SLIP_ROLES) else ([], [])
    faults = [note for note in notes if note.severity == Severity.FAULT and note.code != RunCode.ROLE_MISSING]
    doubts = [note for note in notes if note.severity == Severity.DOUBT]
    poor = [*texts_of(missing.values()), *poor, *texts_of(faults)]
    fair += [*lost, *texts_of(doubts), *_zeros(run, named)]
    level: Level = "poor" if poor else "fair" if fair else "good"
    return Grade(level, (*poor, *fair), share, highest)


def short_runs(runs: Sequence[ProcessedRun], apart: Mapping[str, Note] | None = None) -> list[list[str]]:
    """Return for each run whether it is suspiciously short beside the others, or `apart` from them, and why."""
    usual_s, lengths_s = _short_lengths_s(runs)
    return [
        [
            *([f"{length_s:.0f} s long, most runs {usual_s:.0f} s: check whether it was cut off"] if length_s else []),
            *texts_of(note for name, note in (apart or {}).items() if name == run.run.id),
        ]
        for run, length_s in zip(runs, lengths_s, strict=True)
    ]


def _short_lengths_s(runs: Sequence[ProcessedRun]) -> tuple[float, list[float]]:
    """Return the usual length of a run, and the length of each that is much shorter; 0 of the others."""
    lengths_s = [len(run) / run.rate_hz for run in runs]
    usual_s = float(np.median(lengths_s)) if len(runs) >= _FEWEST else 0.0
    return usual_s, [length_s if length_s < _SHORT * usual_s else 0.0 for length_s in lengths_s]


def runs_to_check(runs: Sequence[ProcessedRun], grades: Sequence[Grade]) -> dict[str, str]:
    """Return the runs that can be used but are short, or of which much is excluded, and why."""
    found: dict[str, str] = {}
    for run, grade, length_s in zip(runs, grades, _short_lengths_s(runs)[1], strict=True):
        lost = grade.usable_share < _GOOD_SHARE
        if grade.level == "fair" and (length_s or lost):
            excluded = f"{100 * (1 - grade.usable_share):.0f} % excluded"
            found[run.run.id] = f"{length_s:.0f} s long" if length_s else excluded
    return found


def doubted_runs(runs: Sequence[ProcessedRun]) -> list[str]:
    """Return what makes runs implausible as declared, unused rut readings and spikes, with the names of the runs."""
    about = runs_by_text(
        (run.run.id, map(without_numbers, [*plausibility_of(run), *_unused_ruts(run)])) for run in runs
    )
    for run in runs:
        if roles := [note.values["role"] for note in run.quality.notes if note.values.get("kind") in ("spike", "mark")]:
            about.setdefault(f"isolated values excluded of {', '.join(dict.fromkeys(roles))}", []).append(run.run.id)
    return [f"{', '.join(names)}: {text}" for text, names in about.items()]


def doubted_soils(terrains: Iterable[TerrainConfig | None]) -> list[str]:
    """Return what of soils is improbable as it is declared, each text once."""
    return list(dict.fromkeys(text for terrain in terrains if terrain for text in _doubts_of_soil(terrain)))


def _doubts_of_soil(terrain: TerrainConfig) -> Iterator[str]:
    soil, uncertainty = terrain.soil, terrain.uncertainty
    where = f"terrain.toml of {soil.name}"
    cohesive, frictional = soil.cohesive_modulus_kn, soil.frictional_modulus_kn
    if cohesive > _LARGE_COHESIVE_KN and frictional < _SMALL_FRICTIONAL_KN:
        yield (
            f"{where}: cohesive_modulus_kn = {cohesive:g} beside frictional_modulus_kn = {frictional:g} is rare: check "
            "whether k_c and k_phi are exchanged"
        )
    for key in SOIL_KEYS if uncertainty else ():
        share = getattr(uncertainty, key)
        if share is not None and share > _LARGEST_SIGMA:
            yield (
                f"{where}: the one-sigma [uncertainty] {key} = {share:g} is {share:g} times the value: if it is in "
                f"percent, write {share / 100:g}"
            )


def plausibility_of(run: ProcessedRun) -> list[Note]:
    """Return why a run is implausible as it is declared; nothing where it is sound."""
    codes = (RunCode.IMPLAUSIBLE, RunCode.OVERLOADED, RunCode.WRONG_SIZE)
    return [note for note in run.quality.notes if note.code in codes]


def _unused_ruts(run: ProcessedRun) -> list[Note]:
    return [note for note in run.quality.notes if note.code == RunCode.RUT_NOT_USED]


def _of_samples(run: ProcessedRun, share: float, highest: float) -> tuple[list[str], list[str]]:
    """Return what is poor and what is only fair about the samples that are left."""
    if not run.used.any():
        return [f"no sample can be used; most: {_mostly(run)}"], []
    poor: list[str] = []
    fair: list[str] = []
    if share < _GOOD_SHARE:
        text = f"{100 * share:.0f} % of the samples in motion can be used; most others: {_mostly(run)}"
        (poor if share < _FAIR_SHARE else fair).append(text)
    if highest < _GOOD_SLIP:
        hardly = "hardly driven: " if highest < _DRIVEN_SLIP else ""
        fair.append(f"{hardly}slip reaches {highest:.2f} only")
    return poor, fair


def _mostly(run: ProcessedRun) -> str:
    """Return the reason that cost most samples, by its name in the run's shares."""
    kinds = [reason for reason in Reason if reason != Reason.USED and reason not in _BY_DESIGN]
    counts = [int(np.count_nonzero(run.reason == reason)) for reason in kinds]
    if not any(counts):
        return "at standstill or too slow"
    return kinds[int(np.argmax(counts))].name.lower().replace("_", " ")


def _zeros(run: ProcessedRun, named: Collection[str]) -> list[str]:
    """Return what forces read at standstills with released brakes, where that is more than a little."""
    load = run.vertical_load_n[np.isfinite(run.vertical_load_n)]
    if not len(load):
        return []
    reasons = []
    for role, unit, arm_m in (("drawbar_pull", "N", 1.0), ("driving_torque", "N m", run.wheel_radius_m)):
        seen = [(s.levels[role], s.sigmas[role]) for s in run.quality.standstills if s.released and role in s.levels]
        levels = np.array([level for level, _ in seen])
        sure = all(abs(level) > _MANY_SIGMAS * sigma for level, sigma in seen)
        one_sided = len(levels) > 0 and (bool((levels > 0).all()) or bool((levels < 0).all()))
        least = _ZERO_SHARE * abs(np.median(load)) * arm_m
        if role not in named and sure and one_sided and abs(np.median(levels)) > least:
            limit = f"{100 * _ZERO_SHARE:.0f} % of load{' x radius' if arm_m != 1 else ''}"
            reasons.append(
                f"{role.replace('_', ' ')} reads {np.median(levels):.0f} {unit} at standstill, more than {limit} "
                f"({least:.0f} {unit}): take a zero"
            )
    return reasons
