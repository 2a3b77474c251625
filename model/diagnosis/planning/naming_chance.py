r"""With what probability a step ends in the right name.

Odds between two members are not yet a name: the rest of the set has to lose too, the name has to survive runs drawn
anew, and a physical cause also what soils usually do. So truths are drawn from the posterior: a set of causes by its
probability, its soil and sizes from the fit given that set. Each is measured: with cross products G' of what the step
adds, its score is

.. math:: G'c + G'^{1/2} z, \qquad z \sim N(0, I),

and the rule of `model.diagnosis.core.naming` is applied to the sum, as far as cross products give it: probabilities
averaged over runs drawn anew (a run to be driven is one of them; one that measures more than the others, and a static
test, are in each), "none" by all runs,
zeros that no standstill shows, the usual stress peak. Adequacy, convergence and the gain on held-out runs are taken as
passed. Where one of those rules bars a name today (`_NOT_FORESEEN`), no probability is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from daq import BoolArray, FloatArray, IndexArray, Note
from model.diagnosis.core.hypotheses import Hypotheses, Posterior, probabilities
from model.diagnosis.core.naming import AVERAGED_AT, BESIDE_USUAL, NOTHING_AT, SHOWN_AT, SURE_AT, is_physical
from model.diagnosis.findings.held_out import FEWEST_RUNS, design_of, drawn_anew, kinds_of
from model.diagnosis.findings.usual_soil import usual_effects, with_usual_soil
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import box, hypotheses, log_evidences, set_columns, without_soil
from model.effects.catalogue import EFFECTS
from model.notes import LackCode, StepCode

DRAWS = 64
_REPLICATES = 24
_LEVEL, _MOST_SETS = 0.99, 40
"""Sets that are weighed: as many as hold this probability, so many at most."""

_MOST_BESIDE = 2
"""Causes in the largest set that is weighed beside what soils usually do."""

STATIC = frozenset({StepCode.LIFTED_ZERO, StepCode.KNOWN_PULL, StepCode.KNOWN_TORQUE, StepCode.HARD_GROUND})
"""Steps that are no run."""
_SENSORS = frozenset({StepCode.RUT, StepCode.SINKAGE, StepCode.TORQUE})
"""Runs for which no run that was driven stands, where none has that channel."""
_SETTLES: Mapping[str, frozenset[StepCode]] = {
    LackCode.NOT_AT_STANDSTILL: frozenset({StepCode.STANDSTILLS}),
    LackCode.ONE_DIRECTION: frozenset({StepCode.OTHER_DIRECTION}),
    LackCode.SAME_PASS: frozenset({StepCode.SECOND_PASS}),
    LackCode.PRESSURE_UNKNOWN: frozenset({StepCode.HALF_PRESSURE}),
    LackCode.ONE_LOAD: frozenset({StepCode.MORE_LOAD, StepCode.LESS_LOAD}),
}
"""After which steps a family is identified that is not yet."""


# Rules that bar a name today and of which cross products do not say whether they will after a step.
_NOT_FORESEEN = frozenset(
    {
        LackCode.NO_BETTER,
        LackCode.CHANNEL_WORSE,
        LackCode.AGAINST_STATIC,
        LackCode.PARTS_CANCEL,
        LackCode.VALUE_AT_LIMIT,
        LackCode.VALUE_MAY_BE_NEUTRAL,
    }
)


@dataclass(frozen=True)
class Outlook:
    """What is known, and what may be true.

    Attributes
    ----------
    grams : Grams
        With the columns of the likely sets only: m, residual, soil and k causes.
    totals : array, shape (2, 1 + replicates, m, m)
        Sums over the runs as they are, then over runs drawn anew: without one to be driven, and with it among them.
    times : array, shape (2, 1 + replicates)
        How often what a step adds counts.
    kept : int array, shape (m,)
        Places of these columns among all.
    listed : Hypotheses
        The likely sets.
    acts : bool array, shape (draws, families)
        Truths.
    coefficients : array, shape (draws, m - 1)
        Of soil and causes.
    noise : array, shape (draws, m - 1)
        z.
    not_foreseen : LackCode or ""
        The rule that bars a name today, where no step can be foreseen to lift it.
    """

    grams: Grams
    totals: FloatArray
    times: FloatArray
    kept: IndexArray
    listed: Hypotheses
    acts: BoolArray
    coefficients: FloatArray
    noise: FloatArray
    excess: float
    not_identifiable: Mapping[str, Note]
    name_at: float
    adequate: float
    measures_more: bool
    not_foreseen: str

    def chance(self, code: StepCode, added: FloatArray) -> float | None:
        """Return the probability that a step ends in the right name; None where that cannot be foreseen.

        `added`, shape (all columns, same), has the cross products of what the step adds.
        """
        if self.not_foreseen:
            return None
        if len(self.grams.run_names) + (code not in STATIC) < FEWEST_RUNS:
            return 0.0
        drawn = int(code not in STATIC and not (code in _SENSORS and self.measures_more))
        measured = self._measured(added[np.ix_(self.kept, self.kept)] / self.excess)
        totals = self.totals[drawn] + self.times[drawn][:, None, None] * measured[:, None]
        named = self._named(totals, self._allowed(code))
        rows = np.flatnonzero(named.any(axis=1))
        lost = (named[rows] & ~self._beside_usual_soil(totals[rows])).any(axis=1)
        named[rows[lost]] = False
        return float(np.mean(named.any(axis=1) & ~(named & ~self.acts).any(axis=1)))

    def _measured(self, products: FloatArray) -> FloatArray:
        """Return the cross products of a step with what it measures of every truth, shape (draws, m, m)."""
        value, vector = np.linalg.eigh(products[1:, 1:])
        root = (vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T
        score = self.coefficients @ products[1:, 1:] + self.noise @ root
        found = np.tile(products, (len(score), 1, 1))
        found[:, 0, 1:] = found[:, 1:, 0] = score
        return found

    def _allowed(self, code: StepCode) -> FloatArray:
        """Return what probability by the runs as they are a name needs after a step, shape (families,)."""
        least = np.full(len(self.listed.families), max(SURE_AT, self.name_at / self.adequate))
        zeros = {effect.name for effect in EFFECTS.values() if effect.needs.zero_of}
        for i, family in enumerate(self.listed.families):
            why = self.not_identifiable.get(family)
            lifted = code is StepCode.LIFTED_ZERO and family in zeros
            if why is None:
                continue
            if why.code == LackCode.FORM_NOT_LISTED or not (lifted or code in _SETTLES.get(why.code, ())):
                shown = why.code == LackCode.NOT_AT_STANDSTILL
                least[i] = max(least[i], SHOWN_AT / self.adequate) if shown else np.inf
        return least

    def _named(self, totals: FloatArray, least: FloatArray) -> BoolArray:
        """Return which families are named of every truth, shape (draws, families)."""
        found = log_evidences(self.grams, without_soil(self.grams, totals), self.listed)
        each = probabilities(found, self.listed.log_prior)
        none, mean = each[:, 0, 0], each[:, 1:].mean(axis=1)
        mean[:, 1:] *= ((1.0 - none) / np.maximum(mean[:, 1:].sum(axis=1), 1e-300))[:, None]
        sure = each[:, 0] @ self.listed.has_family >= least
        return np.asarray((mean @ self.listed.has_family > AVERAGED_AT) & sure & (none < NOTHING_AT)[:, None])

    def _beside_usual_soil(self, totals: FloatArray) -> BoolArray:
        """Return which families keep a name beside what soils usually do, shape (draws, families)."""
        usual = usual_effects(self.grams)
        exempt = {EFFECTS[key].name for key in usual}
        found = np.ones((len(totals), len(self.listed.families)), bool)
        if not usual or not len(totals):
            return found
        moved = with_usual_soil(replace(self.grams, matrices=totals))
        listed = hypotheses(moved, most=min(_MOST_BESIDE, self.listed.members.shape[1]))
        each = probabilities(log_evidences(moved, without_soil(moved, moved.matrices), listed), listed.log_prior)
        chances = dict(zip(listed.families, (each[:, 1:].mean(axis=1) @ listed.has_family).T, strict=True))
        for i, family in enumerate(self.listed.families):
            if family in chances and family not in exempt and is_physical(family):
                found[:, i] = chances[family] > BESIDE_USUAL
        return found


def outlook(
    grams: Grams,
    found: Posterior,
    rng: np.random.Generator,
    *,
    excess: float = 1.0,
    not_identifiable: Mapping[str, Note] | None = None,
    name_at: float = 0.9,
    adequate: float = 1.0,
    barred: Note | None = None,
) -> Outlook:
    """Draw what may be true, and the runs anew.

    `found` is averaged over resampled runs; `excess` is a factor on the noise's variance, `adequate` the probability
    that nothing unlisted acts, `barred` why a family that is likely enough is not named today.
    """
    listed, chances = _likely(found)
    keys = {listed.effects[i] for i in listed.members[listed.members >= 0]} | set(usual_effects(grams))
    own = [i for i, cause in enumerate(grams.causes) if cause.key in keys]
    kept = np.r_[0, grams.soil_columns, [grams.cause_columns.start + i for i in own]].astype(np.intp)
    few = replace(grams, causes=tuple(grams.causes[i] for i in own), basis=(), order=None, own=(), form=0.0, static=0.0)
    runs = len(grams.run_names)
    design = design_of(grams)
    weights = np.ones((2, 1 + _REPLICATES, runs + 1))
    weights[0, 1:, :runs] = drawn_anew(design, _REPLICATES, rng)
    weights[1, 1:] = _with_one_more(design, rng)
    summed = np.tensordot(weights[..., :runs], grams.matrices / excess, 1) + grams.static
    totals = grams.without_form(summed)[..., kept[:, None], kept]
    set_of = rng.choice(len(listed), DRAWS, p=chances)
    return Outlook(
        grams=few,
        totals=totals,
        times=weights[..., runs],
        kept=kept,
        listed=listed,
        acts=listed.has_family[set_of],
        coefficients=_truths(few, totals[0, 0], set_columns(few, listed)[set_of], rng),
        noise=rng.standard_normal((DRAWS, len(kept) - 1)),
        excess=excess,
        not_identifiable=not_identifiable or {},
        name_at=name_at,
        adequate=adequate,
        measures_more=len(np.unique(design[:, 0])) == 1,
        not_foreseen=barred.code if barred is not None and barred.code in _NOT_FORESEEN else "",
    )


def _likely(found: Posterior) -> tuple[Hypotheses, FloatArray]:
    """Return the likely sets, none among them, and their probabilities, which sum to 1."""
    order = np.argsort(-found.probability, kind="stable")
    enough = 1 + int(np.searchsorted(np.cumsum(found.probability[order]), _LEVEL))
    rows = np.union1d(0, order[: min(enough, _MOST_SETS)])
    listed, chances = found.hypotheses, found.probability[rows]
    few = replace(listed, members=listed.members[rows], log_prior=listed.log_prior[rows])
    return few, chances / chances.sum()


def _with_one_more(design: IndexArray, rng: np.random.Generator) -> FloatArray:
    """Return how often each run counts where one more of the commonest kind is among them; it is the last one.

    How often that one is drawn is spread evenly over its distribution: few draws by chance would leave it out more
    often or less often than many do.
    """
    kinds = kinds_of(design)
    common = np.flatnonzero(kinds == np.bincount(kinds).argmax())
    found = np.c_[drawn_anew(design, _REPLICATES, rng), np.zeros(_REPLICATES)]
    count = common.size + 1
    at_most = scipy.special.bdtr(np.arange(count + 1.0), count, 1.0 / count)
    times = np.searchsorted(at_most, (np.arange(_REPLICATES) + 0.5) / _REPLICATES)
    found[:, -1] = rng.permutation(times)
    for row in found:
        row[common] = rng.multinomial(count - int(row[-1]), np.full(common.size, 1.0 / common.size))
    return np.asarray(found)


def _truths(grams: Grams, total: FloatArray, columns: IndexArray, rng: np.random.Generator) -> FloatArray:
    """Draw soil and causes from the fit given each set, within bounds; shape (draws, m - 1)."""
    soils, (lower, upper) = len(grams.soil), box(grams.causes)
    found = np.zeros((len(columns), soils + len(grams.causes)))
    for draw, own in enumerate(columns):
        at = np.r_[np.arange(soils), soils + own[own >= 0]]
        precision = total[np.ix_(1 + at, 1 + at)] + np.eye(at.size)
        root = np.linalg.cholesky(precision)
        found[draw, at] = np.linalg.solve(precision, total[1 + at, 0]) + np.linalg.solve(
            root.T, rng.standard_normal(at.size)
        )
    found[:, soils:] = np.clip(found[:, soils:], lower, upper)
    return found
