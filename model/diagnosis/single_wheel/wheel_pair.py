"""Two wheels on one soil: whether the calibration of the first holds for the second, and if not, what is different.

If nothing is different, the second wheel's group means differ from the first one's by what their loads and slips
differ, predicted with the first wheel's soil and causes, and by the scatter of repeats; the model's error of form is
the same for both at one condition and drops out. Where that is rejected, causes that act on the second wheel alone,
each with a value of its own, are weighed with the rows of both wheels.

Repeats of one condition are often made on one day: what a soil differs from day to day is not in their scatter. Without
repeats each row may be off by the error of form that is given or assumed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from daq import DataError, Fault, FloatArray
from model.cores import one_thread
from model.diagnosis.core.campaign import Bench, DiagnosisOptions
from model.diagnosis.core.result import FormUsed
from model.diagnosis.single_wheel.findings import noise_of
from model.diagnosis.single_wheel.form_error import form_errors_of
from model.diagnosis.single_wheel.noise import ChannelNoise, FormError, scatter_of_repeats
from model.diagnosis.single_wheel.problem import BenchProblem, CauseUse, Hypothesis
from model.diagnosis.single_wheel.search import Optima
from model.diagnosis.single_wheel.sets import Library, driven_rows, family_of, library, listed_uses, sets_of
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, weigh, weighed

_DRAWS = 400
_SAME_SLIP = 0.05
_SAME_LOAD = 0.3
_SHARED = 0.9
"""Probability of the first wheel's sets that are carried over, and how many at most."""
_MOST_SHARED = 4
_PAIRED = 3
"""Families of causes of the second wheel alone that get another one beside them."""
_LEAST_ROWS = 4
OWN = 1
"""Position of the second wheel."""


@dataclass(frozen=True)
class WheelPair:
    """What became of the first wheel's calibration on the second wheel.

    Attributes
    ----------
    p_value : float
        Probability of differences as large as the measured ones, if nothing is different.
    predicted, predicted_sigma : mapping channel -> array, shape (groups,)
        Of the second wheel's groups; the one-sigma holds what the first wheel left unknown, and noise.
    measured, difference : mapping channel -> array, shape (groups,)
        Means of the second wheel's groups, and what they differ from the first one's at the same slip, less what
        load and slip differ; NaN where the first wheel has no such group.
    difference_sigma : mapping channel -> array, shape (groups,)
        Of the difference, if nothing is different.
    slip : array, shape (groups,)
    form_errors : tuple of FormUsed
    first, both : Weighing
        Of the first wheel alone; of both with causes of the second alone.
    library : Library
        Causes that the second wheel may have alone.
    """

    p_value: float
    predicted: dict[str, FloatArray]
    predicted_sigma: dict[str, FloatArray]
    measured: dict[str, FloatArray]
    difference: dict[str, FloatArray]
    difference_sigma: dict[str, FloatArray]
    slip: FloatArray
    form_errors: tuple[FormUsed, ...]
    first: Weighing
    both: Weighing
    library: Library

    @property
    def own_cause(self) -> float:
        """Probability that the second wheel has a cause of its own, among the sets that are right enough."""
        return self._own(self.both.probabilities)

    @property
    def own_cause_ungated(self) -> float:
        """The same without the gate."""
        return self._own(self.both.ungated)

    def _own(self, probabilities: FloatArray) -> float:
        return float(sum(p for p, w in zip(probabilities, self.both.sets, strict=True) if own_part(w.hypothesis)))

    def families(self, *, gated: bool = True) -> dict[str, float]:
        """Return the probability of each family to be the second wheel's alone, most probable first."""
        probabilities = self.both.probabilities if gated else self.both.ungated
        found = dict.fromkeys(self.library.families, 0.0)
        for p, w in zip(probabilities, self.both.sets, strict=True):
            for family in {family_of(use) for use in own_part(w.hypothesis)}:
                found[family] += float(p)
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def own_part(hypothesis: Hypothesis) -> Hypothesis:
    """Return the causes that act on the second wheel alone."""
    return tuple(use for use in hypothesis if use.table is not None)


@one_thread
def compare_wheels(first: Bench, second: Bench, options: DiagnosisOptions | None = None) -> WheelPair:
    """Carry the soil and the causes of one wheel over to another, and weigh what is different.

    Parameters
    ----------
    first, second : Bench
        Rows of driven wheels; the second takes the first one's laboratory soil.
    options : DiagnosisOptions, optional

    Raises
    ------
    ConfigError
        A laboratory soil that cannot carry a wheel.
    DataError
        A wheel without driven rows, too few conditions of the first one, or no soil near the laboratory's carries it.
    """
    options = options or DiagnosisOptions()
    rng = np.random.default_rng(options.seed)
    first_driven = driven_rows(first)
    second_driven = replace(driven_rows(second), soil=first.soil, soil_prior=first.soil_prior)
    _refuse_few(first_driven, second_driven)
    form_error = FormError(options.error_of_form)
    alone = BenchProblem.of([first_driven], options.channels, options.reading, form_error)
    weighing = weigh(alone, library(alone, options.effects).uses, options.most_causes, rng)
    both = BenchProblem.of([first_driven, second_driven], options.channels, options.reading, form_error)
    known = library(both, options.effects, OWN)
    carried = _Carried.of(weighing, both, rng)
    p_value, difference, sigma = carried.paired()
    return WheelPair(
        p_value,
        {c: carried.predicted(c) for c in both.channels},
        {c: carried.sigma(c) for c in both.channels},
        {c: carried.measured(c, OWN) for c in both.channels},
        difference,
        sigma,
        np.array([both.slip[both.group == g].mean() for g in carried.groups(OWN)]),
        form_errors_of(both, given=options.error_of_form is not None),
        weighing,
        _weigh_own(weighing, both, known, options.most_causes, rng),
        known,
    )


@dataclass(frozen=True)
class _Carried:
    """What the first wheel's soil and causes say of both wheels' rows; `predictions`: channel -> (draws, n)."""

    weighing: Weighing
    both: BenchProblem
    predictions: dict[str, FloatArray]

    @staticmethod
    def of(weighing: Weighing, both: BenchProblem, rng: np.random.Generator) -> _Carried:
        parts: dict[str, list[FloatArray]] = {channel: [] for channel in both.channels}
        for p, w in zip(weighing.probabilities.tolist(), weighing.sets, strict=True):
            count = round(_DRAWS * p)
            if w.posterior is None or not count:
                continue
            drawn = rng.choice(len(w.posterior.weights), count, p=w.posterior.weights)
            predicted, _ = both.evaluate([w.hypothesis] * count, w.posterior.standard[drawn])
            possible = np.isfinite(predicted["dp"]).all(axis=1)
            for channel, values in parts.items():
                values.append(predicted[channel][possible])
        return _Carried(weighing, both, {channel: np.concatenate(values) for channel, values in parts.items()})

    def groups(self, table: int) -> NDArray[np.intp]:
        return np.unique(self.both.group[self.both.table == table])

    def measured(self, channel: str, table: int) -> FloatArray:
        values = self.both.measured(channel)
        return np.array([np.nanmean(values[self.both.group == g]) for g in self.groups(table)])

    def _draws(self, channel: str, table: int) -> FloatArray:
        """Return the predicted group means of a table, shape (draws, groups)."""
        predicted = self.predictions[channel]
        return np.stack([predicted[:, self.both.group == g].mean(axis=1) for g in self.groups(table)], axis=1)

    def predicted(self, channel: str) -> FloatArray:
        return np.asarray(self._draws(channel, OWN).mean(axis=0))

    def sigma(self, channel: str) -> FloatArray:
        noise = noise_of(self.weighing.problem, _means_of(self.weighing))[channel]
        repeats = np.array([np.count_nonzero(self.both.group == g) for g in self.groups(OWN)])
        variance = self._draws(channel, OWN).var(axis=0) + noise[1] ** 2 + noise[0] ** 2 / repeats
        return np.asarray(np.sqrt(variance))

    def paired(self) -> tuple[float, dict[str, FloatArray], dict[str, FloatArray]]:
        """Return the probability of the differences if there are none, and the differences of each channel.

        With their one-sigmas if there are none.
        """
        total, count, freedom = 0.0, 0, 0
        found, sigmas = {}, {}
        for noise, rows in zip(self.both.noises, self.both.rows, strict=True):
            channel = noise.channel
            partner = [self._partner(g) for g in self.groups(OWN)]
            theirs, ours = self._draws(channel, 0), self._draws(channel, OWN)
            first = self.measured(channel, 0)
            difference, sigma = np.full((2, len(partner)), np.nan)
            scatter, known = _scatter(noise)
            freedom += 0 if known else len(rows) - len(np.unique(noise.groups))
            for i, j in enumerate(partner):
                if j is None:
                    continue
                apart = ours[:, i] - theirs[:, j]
                difference[i] = self.measured(channel, OWN)[i] - first[j] - apart.mean()
                sizes = [np.count_nonzero(self.both.group == g) for g in (self.groups(OWN)[i], self.groups(0)[j])]
                sigma[i] = np.sqrt(scatter**2 * sum(1.0 / size for size in sizes) + apart.var())
                if np.isfinite(difference[i]):
                    total += (difference[i] / sigma[i]) ** 2
                    count += 1
            found[channel], sigmas[channel] = difference, sigma
        if not count:
            return 1.0, found, sigmas
        # F distribution: the scatter is itself estimated from the repeats, where it is not known
        p_value = scipy.special.fdtrc(count, freedom, total / count) if freedom else scipy.special.chdtrc(count, total)
        return float(p_value), found, sigmas

    def _partner(self, group: int) -> int | None:
        """Return the first wheel's group at the same slip and load, None where there is none."""
        both = self.both
        own = both.group == group
        slip, load = both.slip[own].mean(), both.load_n[own].mean()
        for j, other in enumerate(self.groups(0)):
            rows = both.group == other
            if (
                abs(both.slip[rows].mean() - slip) < _SAME_SLIP
                and abs(np.log(both.load_n[rows].mean() / load)) < _SAME_LOAD
            ):
                return j
        return None


def _scatter(noise: ChannelNoise) -> tuple[float, bool]:
    """Return the one-sigma of a row, and whether it is stated or taken rather than estimated from repeats."""
    if noise.scatter_is_known:
        return float(noise.scatter[0]), True
    scatter = scatter_of_repeats(noise.measured, noise.groups)
    return (scatter, False) if scatter > 0 else (noise.form_scale, True)


def _refuse_few(first: Bench, second: Bench) -> None:
    faults = [
        Fault(
            "too few driven rows to compare wheels",
            table.name,
            f"{len(table.rows)} with slip of 0 or more",
            f"{least} or more",
            "measure at the same slips with both wheels",
        )
        for table, least in ((first, _LEAST_ROWS), (second, 1))
        if len(table.rows) < least
    ]
    if faults:
        raise DataError(*faults)


def _means_of(weighing: Weighing) -> dict[str, FloatArray]:
    posterior = weighing.sets[0].posterior
    assert posterior is not None
    return {channel: posterior.weights @ values for channel, values in posterior.predicted.items()}


def _weigh_own(weighing: Weighing, both: BenchProblem, known: Library, most: int, rng: np.random.Generator) -> Weighing:
    """Weigh the first wheel's most probable sets, each with every set of causes of the second wheel alone."""
    shared = _carried_over(weighing)
    own = sets_of(known.uses, listed_uses(known.uses, min(most, 2)))
    log_prior = {(*a.hypothesis, *b): a.log_prior + p for a in shared for b, p in own.items() if len(b) < 2}
    found = Optima(both)
    found.add_from([(a.hypothesis, a.optima[0].standard) for a in shared])
    found.add_all(h for h in log_prior if own_part(h))
    for a in shared:
        for b in _promising(a, found, own):
            log_prior[*a.hypothesis, *b] = a.log_prior + own[b]
    found.add_all(log_prior)
    return weighed(found, log_prior, rng)


def _promising(shared: Weighed, found: Optima, own: Mapping[Hypothesis, float]) -> list[Hypothesis]:
    """Return the pairs of own causes that hold one of the best single ones, of each family the best."""
    singles = [b[0] for b in own if len(b) == 1]
    singles.sort(key=lambda use: -found.best((*shared.hypothesis, use)).log_evidence - own[(use,)])
    families: dict[str, CauseUse] = {}
    for use in singles:
        families.setdefault(family_of(use), use)
    best = set(list(families.values())[:_PAIRED])
    return [b for b in own if len(b) == 2 and best & set(b)]


def _carried_over(weighing: Weighing) -> list[Weighed]:
    chosen: list[Weighed] = []
    reached = 0.0
    for p, w in sorted(zip(weighing.probabilities, weighing.sets, strict=True), key=lambda pair: -pair[0]):
        if reached >= _SHARED or len(chosen) == _MOST_SHARED:
            break
        chosen.append(w)
        reached += float(p)
    return chosen
