"""Whether the verdict on a table rests on the error of form that was assumed or given for it.

Without repeats nothing in a table says by how much a right model may be off. A share of load, load x radius and radius
is taken instead, and the verdict is made again with half and with twice that share. Where it turns, the rows do not
decide it:

- `named`, and one of the two does not name the same families: `one_of`;
- `unexplained`, and twice the error has an adequate explanation: `one_of`, of what twice the error leaves;
- `nothing_detectable`, and half the error names a family: `one_of`, of what half the error leaves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from daq import Note
from model.diagnosis.core.hypotheses import Posterior, short_set
from model.diagnosis.core.naming import Judgement
from model.diagnosis.core.result import FormUsed
from model.diagnosis.single_wheel.problem import BenchProblem
from model.notes import LackCode

HALF, TWICE = 0.5, 2.0
_NAMES = {HALF: "half", TWICE: "twice"}

_ASKED: dict[str, tuple[float, ...]] = {"named": (HALF, TWICE), "unexplained": (TWICE,), "nothing_detectable": (HALF,)}
"""Factors that may turn a verdict."""


@dataclass(frozen=True)
class Judged:
    """A verdict with the probabilities that it rests on."""

    judgement: Judgement
    posterior: Posterior


def steady(base: Judged, judged_with: Callable[[float], Judged]) -> tuple[Judgement, Note | None]:
    """Return the verdict that half and twice the error of form leave, and what they turn, where they do.

    Parameters
    ----------
    judged_with : callable
        The verdict with the error of form times a factor.
    """
    own = base.judgement
    others = {factor: judged_with(factor) for factor in _ASKED.get(own.verdict, ())}
    turned = {factor: one for factor, one in others.items() if not _same(one.judgement, own)}
    if not turned:
        return own, None
    values = {_NAMES[factor]: (one.judgement.verdict, one.judgement.families) for factor, one in turned.items()}
    why = Note(LackCode.FORM_DECIDES, values=values)
    if own.verdict == "named":
        families = tuple(dict.fromkeys((*short_set(base.posterior), *own.families)))
        kept_back = (*((family, why) for family in own.families), *own.kept_back)
        return Judgement("one_of", families, barred=why, kept_back=kept_back), why
    decisive = next(iter(turned.values()))
    if own.verdict == "nothing_detectable" and decisive.judgement.verdict != "named":
        return own, why
    families = short_set(decisive.posterior)
    return (Judgement("one_of", families, barred=why) if families else Judgement("nothing_detectable")), why


def _same(one: Judgement, other: Judgement) -> bool:
    named = one.verdict == "named"
    return one.verdict == other.verdict and (not named or set(one.families) == set(other.families))


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
