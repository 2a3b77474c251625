"""The verdict, in the published order, of driven runs and of single-wheel tables alike.

1. Lack of fit above its threshold, or nothing to judge it by, or no convergence of the linearisation: `unexplained`.
2. "None" not unlikely: above `NOTHING_AT`, or above `IDLE_AT` where the causes that are chosen do not predict
   held-out runs any better: `nothing_detectable`; but `unexplained` where the held-out error of a channel is more than
   `MOST_ERROR` times what soil and noise give, and more than few runs show by chance.
3. A family above `name_at` (runs: as they are), also where something unlisted may act, is `named` where

   - of driven runs, its probability by the runs as they are is `SURE_AT` or more, and averaged over resampled runs
     above `AVERAGED_AT`: the average is careful of what is confounded, and too kind to what is barely there;
   - the log score of held-out runs, over all channels, rises by `LEAST_NATS`, or the held-out error of a channel falls
     for certain: the score is of linearised models, and that of one far from the truth is too high;
   - the held-out error of no measured channel grows notably and for certain, also where the channel was not used;
   - the named causes do not cancel each other to a small remainder that one of them less explains as well;
   - the data identify the family (what stands in ``not_identifiable`` may be a member of a set only); a zero that no
     standstill shows may be shown by driving, see `unshown`;
   - its value bears the name, see `confirmed`;
   - it is no physical cause that is less probable than not once the stress peak may lie ahead of the bottom, as it
     does in nature (`model.diagnosis.findings.usual_soil`).

   That R0 of the drawbar pull falls is no demand: a zero of the torque or a cause of the braked wheel shows in the
   score only (docs/decisions/naming.md).
4. Else `one_of`: the shortest set of families of which one acts with 95 % probability, given that any cause acts; a
   family that is alone in it and not named stands beside its nearest rival. Of a table also every family that is
   more probable than a member, or than `PROBABLE_AT`.

A name needs three runs or more (of a table: three conditions), since its probability must be calibrated and its gain
be measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import log

import numpy as np
import scipy

from daq import Note
from model.diagnosis.core.hypotheses import Posterior, cause_of, most_probable_form, nearest_rival, short_set
from model.diagnosis.core.result import Adequacy, BarredCause, Cause, Gain, PriorShift, Verdict
from model.effects.catalogue import EFFECTS, parted
from model.notes import DiagnosisCode, LackCode

NOTHING_AT = 0.2
"""Probability of "none" from which on no cause is reported: a false alarm costs more than a further run."""
IDLE_AT = 0.05
"""The same where the causes that are chosen are of no use on held-out runs."""
LEAST_NATS = 3.0
"""Rise of the held-out log score that a name needs, where no held-out error falls for certain."""
MOST_ERROR = 1.5
"""Held-out error over the one that is predicted of soil and noise up to which these are an explanation."""
_BY_CHANCE = 1e-4
"""Chance of so large an error of few runs. A run is worth one error, as its own soil is one value, and each is
predicted from the others: of n runs n - 1 are free."""
AVERAGED_AT = 0.8
"""Probability averaged over resampled runs that a name of driven runs needs (docs/decisions/naming.md). One run that
decides, which a third of the resampled campaigns lack, gives .83 where the others say even chances."""
SURE_AT = 0.97
"""Probability by the runs as they are that it needs, too."""
BESIDE_USUAL = 0.5
"""Probability beside what soils usually do that a physical name of driven runs needs; below `name_at` it is told."""
SHOWN_AT = 0.98
"""Probability, as the runs are, from which a zero is named though no standstill shows it
(docs/decisions/standstill.md)."""
PROBABLE_AT = 0.5
"""Probability from which on a family stands in the set of a single-wheel table, whichever others do."""
REMAINDER = 0.5
"""Share of the smaller of two causes below which what they leave together is a small remainder."""


@dataclass(frozen=True)
class Judgement:
    """A verdict and what it is about.

    Attributes
    ----------
    families : tuple of str
        The named ones; under "one_of" the set.
    beside : tuple of str
        Beside named ones: the families of which one more probably acts; empty where none is needed.
    barred : Note or None
        Why a family that is likely enough is not named; or what makes it "unexplained" where lack of fit does not.
    kept_back : tuple of (family, Note)
        Every family that is likely enough and not named, with the rule that bars it.
    """

    verdict: Verdict
    families: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    barred: Note | None = None
    kept_back: tuple[tuple[str, Note], ...] = field(default=(), compare=False)

    @property
    def peak_bar(self) -> Note | None:
        """Why a name is kept back, where it is because the stress peak may lie ahead of the bottom; else None."""
        return self.barred if self.barred is not None and self.barred.code == LackCode.PEAK_MAY_SHIFT else None


def judgement(
    found: Posterior,
    judged: Adequacy,
    gain: Gain | None,
    not_identifiable: Mapping[str, Note] | None = None,
    name_at: float = 0.9,
    converged: bool = True,
    contradiction: Note | None = None,
    of_runs: bool = False,
) -> Judgement:
    """Return the verdict.

    `found` is of samples averaged over resampled runs, `judged` of the most probable set, `gain` on held-out runs, the
    causes chosen anew in each fold. `converged` is whether the linearisation did. `contradiction` says which of the
    most probable causes cancel each other, or which static test the runs contradict. `of_runs` is whether driven runs
    are judged, with their average over resampled runs; else a table.
    """
    if not judged.ok:
        return Judgement("unexplained", barred=Note(LackCode.NOTHING_JUDGED) if np.isnan(judged.statistic) else None)
    if not converged:
        return Judgement("unexplained", barred=Note(LackCode.NOT_SETTLED))
    idle = gain is not None and not gain.log_likelihood_gain > 0
    if found.none >= (IDLE_AT if idle else NOTHING_AT):
        left = _more_than_noise(gain)
        return Judgement("unexplained" if left else "nothing_detectable", barred=left)
    averaged = found.families()
    chances, least = (found.as_they_are().families(), AVERAGED_AT) if of_runs else (averaged, 0.0)
    likely = tuple(f for f, p in averaged.items() if p > least and max(p, chances[f]) > name_at)
    unsure = _unsure(chances, likely) if of_runs else {}
    sure = [family for family in likely if family in unsure or chances[family] * judged.listed > name_at]
    doubted = _each(
        [x for x in likely if x not in sure],
        Note(LackCode.UNLISTED_MAY_ACT, values={"probability": 1.0 - judged.listed}),
    )
    barred = _barred(found, gain) or contradiction
    if barred:
        return one_of(found, barred if sure else None, likely, (*_each(sure, barred), *doubted))
    unsure |= not_identifiable or {}
    lacking = tuple((family, unsure[family]) for family in sure if family in unsure)
    named = tuple(family for family in sure if family not in unsure)
    if named:
        return Judgement("named", named, short_set(found, named), kept_back=(*lacking, *doubted))
    return one_of(found, lacking[0][1] if lacking else None, likely, (*lacking, *doubted))


def _unsure(chances: Mapping[str, float], families: Sequence[str]) -> dict[str, Note]:
    return {
        family: Note(LackCode.NOT_SURE, values={"family": family, "probability": chances[family], "least": SURE_AT})
        for family in families
        if chances[family] < SURE_AT
    }


def _each(families: Sequence[str], why: Note) -> tuple[tuple[str, Note], ...]:
    return tuple((family, why) for family in families)


def unshown(not_identifiable: Mapping[str, Note], found: Posterior, judged: Adequacy) -> dict[str, Note]:
    """Return the families that the data do not identify, without the zeros that are above `SHOWN_AT` by driving alone.

    `not_identifiable` says why, by family, of what was driven and recorded.
    """
    chances = found.as_they_are().families()
    return {
        family: why
        for family, why in not_identifiable.items()
        if why.code is not LackCode.NOT_AT_STANDSTILL or chances.get(family, 0.0) * judged.listed <= SHOWN_AT
    }


def beside_formed(formed: str, found: Posterior) -> dict[str, Note]:
    """Return why no other family is named beside one that acts by an unlisted formula: it may make up for that one."""
    why = Note(LackCode.FORM_NOT_LISTED, values={"family": formed})
    return {family: why for family in found.hypotheses.families if formed and family != formed}


def one_of(
    found: Posterior,
    barred: Note | None,
    likely: Sequence[str] = (),
    kept_back: Sequence[tuple[str, Note]] = (),
) -> Judgement:
    """Return the verdict that one of a set of families acts; one that is alone and barred with its nearest rival.

    Families of `likely` would be named but for a rule; they stand in the set, needed or not. See `Judgement` for
    `kept_back`.
    """
    families = tuple(dict.fromkeys((*short_set(found), *likely)))
    if barred is not None and len(families) == 1:
        families = (*families, *nearest_rival(found, families[0]))
    return Judgement("one_of", families, barred=barred, kept_back=tuple(kept_back))


def with_more_probable(verdict: Judgement, found: Posterior) -> Judgement:
    """Return "one_of" with every family that is more probable than a member of its set or than not, in their order.

    The shortest set does not hold what acts beside its members, and readers compare probabilities. A member that the
    rule of the stress peak put there asks for none beside it.
    """
    if verdict.verdict != "one_of":
        return verdict
    chances = found.families()
    members = [family for family in verdict.families if verdict.peak_bar is None or not is_usual(family)]
    least = min([PROBABLE_AT, *(chances[family] for family in members)])
    families = tuple(family for family, p in chances.items() if p >= least or family in verdict.families)
    return replace(verdict, families=families)


def barred_causes(found: Posterior, verdict: Judgement) -> tuple[BarredCause, ...]:
    """Return the causes that are likely enough for a name and that a rule bars."""
    return tuple(
        BarredCause(cause_of(found, family, most_probable_form(found, family), ()), why)
        for family, why in verdict.kept_back
    )


def _more_than_noise(gain: Gain | None) -> Note | None:
    """Return which held-out error soil and noise do not explain; None where they do, or none is known."""
    if gain is None:
        return None
    free = max(len(gain.chosen) - 1, 1)
    most = max(MOST_ERROR, float(np.sqrt(scipy.special.chdtri(free, _BY_CHANCE) / free)))
    for channel, expected in gain.expected.items():
        error = gain.base[channel].R0
        if not error <= most * expected:
            return Note(LackCode.MORE_THAN_NOISE, values={"channel": channel, "error": error, "expected": expected})
    return None


def _barred(found: Posterior, gain: Gain | None) -> Note | None:
    if not found.calibrated or gain is None:
        return Note(LackCode.NOT_CHECKED)
    if gain.log_likelihood_gain < LEAST_NATS and not any(change.falls for change in gain.reductions.values()):
        return Note(LackCode.NO_BETTER, values={"nats": gain.log_likelihood_gain, "least": LEAST_NATS})
    for channel, change in gain.reductions.items():
        if change.grows:
            low, high = sorted(-x for x in change.interval95)
            facts = {"channel": channel, "percent": -change.percent, "low": low, "high": high}
            return Note(LackCode.CHANNEL_WORSE, values=facts)
    return None


def confirmed(verdict: Judgement, found: Posterior, causes: Sequence[Cause]) -> Judgement:
    """Return the verdict once its causes have their values: a value that does not bear its name takes the name back."""
    if verdict.verdict == "named" and (why := doubtful(causes)):
        return one_of(found, why, verdict.families, (*_each(verdict.families, why), *verdict.kept_back))
    return verdict


def asked_again(verdict: Judgement, chances: Mapping[str, float], rivals: Sequence[str], least: float) -> Judgement:
    """Return the verdict once its physical causes were asked again beside what soils usually do.

    One that does not stay above `least` loses its name to the set of it and its rivals; the others that stay keep
    theirs, beside one of that set. Errors of measurement are exempt. `chances` are the probabilities beside what soils
    usually do, and `rivals` are families of that.
    """
    lost = [note.values["family"] for note in less_beside_usual(verdict, chances, rivals, least)]
    if not lost:
        return verdict
    whys = {f: Note(LackCode.PEAK_MAY_SHIFT, values={"family": f, "probability": chances.get(f, 0.0)}) for f in lost}
    why = whys[lost[0]]
    kept = tuple(f for f in verdict.families if f != lost[0])
    sure = tuple(f for f in kept if f not in rivals and chances.get(f, 0.0) > least)
    if sure:
        beside = tuple(dict.fromkeys(f for f in (*lost, *rivals, *verdict.beside) if f not in sure))
        return Judgement("named", sure, beside, barred=why, kept_back=(*whys.items(), *verdict.kept_back))
    families = tuple(dict.fromkeys((lost[0], *rivals, *kept)))
    barred = (*((f, whys.get(f, why)) for f in verdict.families), *verdict.kept_back)
    return Judgement("one_of", families, barred=why, kept_back=barred)


def less_beside_usual(
    verdict: Judgement, chances: Mapping[str, float], rivals: Sequence[str], name_at: float
) -> tuple[Note, ...]:
    """Return which physical names are less probable than a name must be beside what soils usually do."""
    asked = [f for f in verdict.families if verdict.verdict == "named" and is_physical(f) and f not in rivals]
    return tuple(
        Note(DiagnosisCode.LESS_BESIDE_USUAL, values={"family": f, "probability": p})
        for f in asked
        if (p := chances.get(f, 0.0)) <= name_at
    )


def is_physical(family: str) -> bool:
    """Return whether a family is a cause in wheel or soil, not an error of measurement."""
    return any(e.name == parted(family)[0] and e.kind == "physical" for e in EFFECTS.values())


def is_usual(family: str) -> bool:
    """Return whether soils usually have a family."""
    return any(e.name == family and e.is_usual() for e in EFFECTS.values())


def doubtful(causes: Sequence[Cause]) -> Note | None:
    """Return why a cause's value does not bear its name; None where all do."""
    for cause in causes:
        limits = {p.name: p for p in EFFECTS[cause.key].parameters}
        for found in cause.parameters:
            own = limits.get(found.name)
            if own is None:  # a combination, as Lyasko's p
                continue
            edges = [edge for edge in (own.lower, own.upper) if edge != own.neutral]
            if np.isclose(found.value, edges, rtol=1e-3, atol=0.0).any():
                facts = {"family": cause.name, "parameter": found.name, "value": found.value, "unit": found.unit}
                return Note(LackCode.VALUE_AT_LIMIT, values=facts)
            low, high = found.interval95
            if len(cause.parameters) == 1 and low <= own.neutral <= high:
                facts = {"family": cause.name, "parameter": found.name, "neutral": own.neutral, "unit": found.unit}
                return Note(LackCode.VALUE_MAY_BE_NEUTRAL, values={**facts, "low": low, "high": high})
    return None


def prior_shifts(
    found: Posterior, verdict: Judgement, judge: Callable[[Posterior], Judgement], factor: float = 3.0
) -> tuple[PriorShift, ...]:
    """Return every change of one family's prior by a factor, up or down, that changes the verdict.

    `judge` returns the verdict of other probabilities, all else being the same.
    """
    shifts = []
    for i, family in enumerate(found.hypotheses.families):
        for times in (factor, 1.0 / factor):
            weighted = found.probability * np.where(found.hypotheses.has_family[:, i], times, 1.0)
            evidence = found.log_evidence + log(times) * found.hypotheses.has_family[:, i]
            other = judge(replace(found, probability=weighted / weighted.sum(), log_evidence=evidence))
            if (other.verdict, set(other.families)) != (verdict.verdict, set(verdict.families)):
                shifts.append(PriorShift(family, times, other.verdict, other.families))
    return tuple(shifts)
