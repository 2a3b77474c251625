"""What a diagnosis of bench tables says in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

import numpy as np

from daq import OUTPUTS
from model.diagnosis.core.result import Cause, Gain, NextRun, Seen, Verdict
from model.diagnosis.core.verdict_words import gain_words
from model.diagnosis.single_wheel.noise import scatter_of_repeats
from model.diagnosis.single_wheel.problem import BenchProblem
from model.diagnosis.single_wheel.sets import SkidLaw
from model.diagnosis.single_wheel.weighing import Weighing
from model.effects.catalogue import EFFECTS

MUCH_SCATTER = 0.05
"""Of the load, from which on repeats are hardly repeats."""
_UNITS = {"dp": (1.0, "N"), "t": (1.0, "N m"), "z": (1e3, "mm")}


def sentence_of(
    verdict: Verdict,
    weighing: Weighing,
    causes: Sequence[Cause],
    beside: Mapping[str, float],
    barred: str,
    gain: Gain | None,
    runs: Sequence[NextRun],
) -> str:
    """Return the verdict for people, and what to do next."""
    channels = " and ".join([OUTPUTS[c].name for c in weighing.problem.channels][-2:])
    channels = ", ".join([*(OUTPUTS[c].name for c in weighing.problem.channels[:-2]), channels])
    onward = f" Next: {runs[0].change}." if runs else ""
    if verdict == "named":
        names = " and ".join(f"{plain(c.name)} ({chance(c.probability)})" for c in causes)
        others = [f"{plain(name)} ({chance(p)})" for name, p in beside.items()]
        more = f" Beside it, one of: {', '.join(others)}." if others else ""
        worth = gain_words(gain)
        left_out = f" On conditions left out {worth}." if worth else ""
        seen = f"{names.capitalize()} is seen in {channels}, among explanations that are right enough."
        return f"{seen}{left_out}{more}{onward}"
    if verdict == "one_of":
        names = ", ".join(f"{plain(c.name)} ({chance(c.probability)})" for c in causes)
        if len(causes) == 1:
            return f"Most likely {names}, but not sure enough for a name{f': {barred}' if barred else ''}.{onward}"
        return f"One of {names}: {channels} of these rows cannot part them.{onward}"
    if verdict == "unexplained":
        return (
            f"No cause of the library, alone or with two others, explains {channels} to within what repeats scatter "
            "and a right model may miss."
        )
    return f"Nothing can be seen in {channels}: the simulation with its soil within the laboratory's spread is enough."


def mixed_words(problem: BenchProblem) -> str:
    """Return a warning where repeats of one test differ as different tests do; else nothing."""
    for noise in problem.noises:
        share = scatter_of_repeats(noise.measured, noise.groups) / problem.size_of(noise.channel)
        if noise.channel != "z" and share > MUCH_SCATTER:
            return (
                f" Rows of one group scatter by {100.0 * share:.0f} % of the load in "
                f"{OUTPUTS[noise.channel].name}: they may be of different wheels or tests; choose them with --where."
            )
    return ""


def notes_of(
    problem: BenchProblem, seen: Sequence[Seen], skids: Mapping[str, SkidLaw], weighing: Weighing
) -> list[str]:
    """Return what a reader must know."""
    share = problem.typical_load_n / 10_000.0
    notes = [
        f"prior scales in N and N m are stated for a wheel under 10 kN; here {share:.3g} of them (median load "
        f"{problem.typical_load_n:.3g} N)"
    ]
    for noise in problem.noises:
        factor, unit = _UNITS[noise.channel]
        scatter = factor * scatter_of_repeats(noise.measured, noise.groups)
        usual = f"a right model may have an error of form of {factor * noise.form_scale:.2g} {unit}"
        notes.append(f"{OUTPUTS[noise.channel].name}: repeats scatter by {scatter:.2g} {unit}; {usual}")
    if weighing.any_adequate:
        best = weighing.sets[0]
        families = ", ".join(
            sorted({f"{plain(f)} {chance(weighing.of_family(f, weighing.ungated))}" for f in best.families})
        )
        if families:
            names = " and ".join(_effect(use.key) for use in best.hypothesis)
            notes.append(f"likeliest set: {names} ({chance(float(weighing.probabilities[0]))})")
            notes.append(f"without the gate of adequacy: {families}")
    return [*notes, *_unseen(seen), *(_skid(name, law) for name, law in skids.items())]


def _unseen(seen: Sequence[Seen]) -> list[str]:
    """Return how far each candidate is from channels that it has not seen."""
    notes = []
    for bench in seen:
        for channel in bench.unseen:
            factor, unit = _UNITS[channel]
            errors = {
                key: factor * float(np.sqrt(np.nanmean((said[channel] - bench.measured[channel]) ** 2)))
                for key, said in bench.implied.items()
            }
            words = ", ".join(f"{_effect(key)} {error:.2g}" for key, error in errors.items() if isfinite(error))
            if words:
                notes.append(
                    f"{bench.campaign}: the {OUTPUTS[channel].name} that each candidate implies misses the measured "
                    f"one, which it has not seen, by (rms, {unit}): {words}"
                )
    return notes


def _skid(name: str, law: SkidLaw) -> str:
    return (
        f"{name}: {law.rows} rows with s <= 0 have a law of their own, Z = {1e3 * law.static_sinkage_m:.1f} mm + "
        f"({1e3 * law.H2_m:.1f} +- {1e3 * law.H2_sigma_m:.1f}) mm s^2, left-out rms {1e3 * law.left_out_rms_m:.2f} mm; "
        "laws of a driven wheel are not asked there"
    )


def _effect(key: str) -> str:
    effect = EFFECTS[key]
    return f"{plain(effect.name)} ({effect.form})" if effect.form else plain(effect.name)


def plain(name: str) -> str:
    """Return a name as people write it."""
    return name.replace("_", " ")


def chance(p: float) -> str:
    """Return a probability; never 1 or 0, which no data give."""
    return "> .999" if p > 0.9995 else "< .001" if p < 0.0005 else f"{p:.3f}".lstrip("0")
