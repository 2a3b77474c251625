"""Whether the verdict on a table rests on the error of form that a right model may have.

Names and probabilities come from one posterior, that of the error of form that the table says, that was given, or that
was assumed. Without repeats nothing in a table says it: a share of load, load x radius and radius is taken, and the
verdict is asked again with half and with twice that share.

- `named`, and one of the two does not name the same families: `one_of`;
- `nothing_detectable`, and half the error leads elsewhere: it stays, and what half leads to is noted.

Where no explanation is adequate the verdict is `unexplained`. The least error of form at which one would be is noted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq import Note
from model.diagnosis.core.hypotheses import Posterior
from model.diagnosis.core.naming import Judgement, one_of
from model.diagnosis.core.result import FormUsed
from model.diagnosis.single_wheel.problem import BenchProblem
from model.diagnosis.single_wheel.weighing import Weighing, misfits, threshold
from model.notes import LackCode

HALF, TWICE = 0.5, 2.0
_NAMES = {HALF: "half", TWICE: "twice"}

_ASKED: dict[str, tuple[float, ...]] = {"named": (HALF, TWICE), "nothing_detectable": (HALF,)}
"""Factors that may turn a verdict."""
_MOST_FACTOR = 16.0
_LIKELY = 0.9
"""Probability above which a family stands in the set, needed or not."""
_STEPS = 5
"""Of a bisection of the logarithm: to within 9 %."""
_RIVALS = 6
"""Sets of the least lack of fit, and as many of the most probable, that may be the first to be adequate."""


@dataclass(frozen=True)
class Judged:
    """A verdict, what it was before its names were asked again beside a usual soil, and the probabilities of both."""

    judgement: Judgement
    plain: Judgement
    posterior: Posterior


def steady(base: Judged, judged_with: Callable[[float], Judgement]) -> tuple[Judgement, Note | None]:
    """Return the verdict that half and twice the error of form leave, and what they turn, where they do.

    `judged_with` gives the verdict with the error of form times a factor, its names not asked again.
    """
    own = base.judgement
    others = {factor: judged_with(factor) for factor in _ASKED.get(own.verdict, ())}
    turned = {factor: judgement for factor, judgement in others.items() if not _same(judgement, base.plain)}
    if not turned:
        return own, None
    why = Note(
        LackCode.FORM_DECIDES,
        values={_NAMES[f]: (judgement.verdict, judgement.families) for f, judgement in turned.items()},
    )
    if own.verdict != "named":
        return own, why
    likely = tuple(family for family, p in base.posterior.families().items() if p > _LIKELY)
    kept_back = (*((family, why) for family in own.families), *own.kept_back)
    return one_of(base.posterior, why, likely, kept_back), why


def _same(judgement: Judgement, other: Judgement) -> bool:
    named = judgement.verdict == "named"
    return judgement.verdict == other.verdict and (not named or set(judgement.families) == set(other.families))


def adequate_at(weighing: Weighing, rng: np.random.Generator) -> Note | None:
    """Return the least factor on the error of form at which a set is adequate, and the most probable one's families.

    None where that of `_MOST_FACTOR` times has no adequate explanation either. `weighing` has no adequate set.
    """
    known = [w for w in weighing.sets if np.isfinite(w.misfit)]
    least = sorted(known, key=lambda w: w.misfit)[:_RIVALS]
    rivals = {w.hypothesis: w for w in (*known[:_RIVALS], *least)}
    tried = sorted(rivals.values(), key=lambda w: -w.score)

    def first(factor: float) -> int | None:
        problem = _with_form_times(weighing.problem, factor)
        left = misfits(problem, [w.optima[0] for w in tried])
        adequate = np.flatnonzero(left <= threshold(problem, rng))
        return int(adequate[0]) if len(adequate) else None

    low, high = 0.0, float(np.log(_MOST_FACTOR))
    found = first(_MOST_FACTOR) if tried else None
    if found is None:
        return None
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        at_middle = first(float(np.exp(middle)))
        low, high, found = (middle, high, found) if at_middle is None else (low, middle, at_middle)
    factor = float(np.exp(high))
    facts: dict[str, Any] = {"factor": factor, "families": tuple(sorted(tried[found].families))}
    shares = {noise.form_share for noise in weighing.problem.noises if noise.form_share is not None}
    if len(shares) == 1:
        facts["share"] = factor * shares.pop()
    return Note(LackCode.FORM_ADEQUATE, values=facts)


def _with_form_times(problem: BenchProblem, factor: float) -> BenchProblem:
    return replace(problem, noises=tuple(replace(n, form_scale=factor * n.form_scale) for n in problem.noises))


def form_errors_of(problem: BenchProblem, *, given: bool) -> tuple[FormUsed, ...]:
    """Return the error of form of every channel, and where it comes from."""
    found = []
    for noise in problem.noises:
        if noise.form_share is None:
            basis = "stated" if noise.scatter_is_known else "repeats"
        else:
            basis = "given" if given else "assumed"
        found.append(FormUsed(noise.channel, noise.form_scale, basis, noise.form_share))
    return tuple(found)
