"""Search for the best values of many hypotheses at once, from those of sets with a cause less, and their evidence.

The search is Gauss-Newton with damping (Levenberg 1944) in standard-normal coordinates; docs/decisions/one-newton.md
says why it is not `model.fit.gauss_newton`. The noise is a mixture over its one-sigmas; its gradient is that of the
mixture's mean precision, which is renewed at every step. The evidence is Laplace's;
`model.diagnosis.single_wheel.evidence` corrects it by importance sampling where it counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from daq import FloatArray, IndexArray
from model.diagnosis.single_wheel.problem import BenchProblem, Hypothesis

_ITERATIONS = 40
_ENOUGH = 1e-3
"""Predicted gain in nats below which a search ends."""
_BATCH_ROWS = 1536
"""Rows of all hypotheses that are evaluated at once: enough that they cost more than calling for them."""
_STEADY = 0.1
"""Damping below which a step that gained nothing ends a search."""

_PARENTS = 2
"""Sets with a cause less that a search starts from."""
_SMALL = 0.05
"""Prior scales from neutral of a cause that starts near it."""
_STIFFER = (1.0, 1.0, 1.0)
"""One-sigmas by which the stiffness of a soil that carries nothing is raised, one after the other."""


@dataclass(frozen=True)
class Optimum:
    """Where a hypothesis fits best.

    Attributes
    ----------
    standard : array, shape (p,)
        Coordinates, without padding.
    information : array, shape (p, p)
        Prior's included; its inverse is the covariance.
    log_likelihood : float
        NaN never; -inf where the model has no answer.
    predicted, slopes : mapping channel -> arrays, shapes (n,) and (n, p)
    log_evidence : float
        Laplace's.
    """

    hypothesis: Hypothesis
    standard: FloatArray
    information: FloatArray
    log_likelihood: float
    predicted: dict[str, FloatArray]
    slopes: dict[str, FloatArray]

    @property
    def log_posterior(self) -> float:
        """Likelihood times prior, without the prior's constant."""
        return self.log_likelihood - 0.5 * float(self.standard @ self.standard)

    @property
    def log_evidence(self) -> float:
        """Laplace's approximation."""
        sign, log_det = np.linalg.slogdet(self.information)
        return self.log_posterior - 0.5 * float(log_det) if sign > 0 else -np.inf


def log_likelihood(
    problem: BenchProblem, predicted: dict[str, FloatArray], rows: FloatArray | None = None
) -> FloatArray:
    """Return ln p of all channels, shape (B,); `rows`, shape (n,): 1 counts, 0 is excluded."""
    total: FloatArray = np.zeros(len(next(iter(predicted.values()))))
    for noise, chosen in zip(problem.noises, problem.rows, strict=True):
        error = noise.measured - predicted[noise.channel][:, chosen]
        bad = ~np.isfinite(error).all(axis=1)
        error[bad] = 0.0
        total += np.where(bad, -np.inf, noise.log_likelihood(error, None if rows is None else rows[chosen]))
    return total


def search(
    problem: BenchProblem,
    hypotheses: Sequence[Hypothesis],
    starts: Sequence[FloatArray],
    rows: FloatArray | None = None,
) -> list[Optimum]:
    """Return the best values of every hypothesis from its start.

    The starts are the coordinates of each. `rows`, shape (n,) or (B, n), is 1 for those that count and 0 for those that
    are excluded; the same for all B hypotheses, or each its own.
    """
    found: list[Optimum] = []
    batch = max(64, _BATCH_ROWS // len(problem.slip))
    for first in range(0, len(hypotheses), batch):
        part = slice(first, first + batch)
        counted = rows if rows is None or rows.ndim == 1 else rows[part]
        found += _search(problem, hypotheses[part], starts[part], counted)
    return found


@dataclass
class _Batch:
    """State of a search; every array has the batch first."""

    standard: FloatArray
    objective: FloatArray
    predicted: dict[str, FloatArray]
    slopes: dict[str, FloatArray]
    information: FloatArray
    gradient: FloatArray
    damping: FloatArray


def _search(
    problem: BenchProblem, hypotheses: Sequence[Hypothesis], starts: Sequence[FloatArray], rows: FloatArray | None
) -> list[Optimum]:
    size = max(problem.size(h) for h in hypotheses)
    standard = np.zeros((len(hypotheses), size))
    for member, start in enumerate(starts):
        standard[member, : len(start)] = start
    state = _linearised(problem, hypotheses, standard, rows)
    state.damping = np.full(len(hypotheses), 1e-3)
    todo = np.flatnonzero(np.isfinite(state.objective))
    for _ in range(_ITERATIONS):
        if not len(todo):
            break
        eye = np.eye(size)
        step = -np.linalg.solve(
            state.information[todo] + state.damping[todo, None, None] * eye, state.gradient[todo][..., None]
        )[..., 0]
        expected = -np.einsum("bp,bp->b", state.gradient[todo], step) / 2
        counted = rows if rows is None or rows.ndim == 1 else rows[todo]
        trial = _linearised(problem, [hypotheses[i] for i in todo.tolist()], state.standard[todo] + step, counted)
        better = trial.objective < state.objective[todo]
        idle = better & (state.objective[todo] - trial.objective < _ENOUGH) & (state.damping[todo] < _STEADY)
        kept = todo[better]
        for name in ("standard", "objective", "information", "gradient"):
            getattr(state, name)[kept] = getattr(trial, name)[better]
        for channel in state.predicted:
            state.predicted[channel][kept] = trial.predicted[channel][better]
            state.slopes[channel][kept] = trial.slopes[channel][better]
        state.damping[todo] = np.where(better, state.damping[todo] * 0.2, np.maximum(state.damping[todo], 0.02) * 6.0)
        ended = (expected < _ENOUGH) | idle | (state.damping[todo] > 1e7)
        todo = todo[~ended]
    return [_optimum(problem, state, member, hypothesis) for member, hypothesis in enumerate(hypotheses)]


def _optimum(problem: BenchProblem, state: _Batch, member: int, hypothesis: Hypothesis) -> Optimum:
    own = problem.size(hypothesis)
    standard = state.standard[member, :own]
    return Optimum(
        hypothesis,
        standard,
        state.information[member, :own, :own],
        float(-state.objective[member] + 0.5 * standard @ standard),
        {channel: values[member] for channel, values in state.predicted.items()},
        {channel: values[member, :, :own] for channel, values in state.slopes.items()},
    )


def _linearised(
    problem: BenchProblem, hypotheses: Sequence[Hypothesis], standard: FloatArray, rows: FloatArray | None
) -> _Batch:
    count, size = standard.shape
    predicted, slopes = problem.evaluate(hypotheses, standard, slopes=True)
    information = np.tile(np.eye(size), (count, 1, 1))
    gradient = standard.copy()
    objective = 0.5 * np.einsum("bp,bp->b", standard, standard)
    for members, counted in _alike(rows, count):
        for noise, chosen in zip(problem.noises, problem.rows, strict=True):
            error = noise.measured - predicted[noise.channel][members][:, chosen]
            slope = slopes[noise.channel][members][:, chosen]
            bad = ~(np.isfinite(error).all(axis=1) & np.isfinite(slope).all(axis=(1, 2)))
            error[bad], slope[bad] = 0.0, 0.0
            own = None if counted is None else counted[chosen]
            shares, likelihood = noise.weighed_nodes(error, own)
            weighted = noise.precision(shares, own) @ slope
            information[members] += slope.transpose(0, 2, 1) @ weighted
            gradient[members] -= (error[:, None] @ weighted)[:, 0]
            objective[members] -= np.where(bad, -np.inf, likelihood)
    return _Batch(standard, objective, predicted, slopes, information, gradient, np.zeros(count))


def _alike(rows: FloatArray | None, count: int) -> list[tuple[IndexArray, FloatArray | None]]:
    """Return which hypotheses count the same rows, and these rows."""
    if rows is None or rows.ndim == 1:
        return [(np.arange(count), rows)]
    patterns, of = np.unique(rows, axis=0, return_inverse=True)
    return [(np.flatnonzero(of.ravel() == i), pattern) for i, pattern in enumerate(patterns)]


class Optima:
    """Where hypotheses fit best, from starts at what fits best with a cause less."""

    def __init__(self, problem: BenchProblem) -> None:
        self.problem = problem
        self._found: dict[Hypothesis, tuple[Optimum, ...]] = {}

    def ranked(self, hypothesis: Hypothesis) -> tuple[Optimum, ...]:
        """Return the optima of a hypothesis, best first."""
        return self._found[hypothesis]

    def best(self, hypothesis: Hypothesis) -> Optimum:
        """Return the best optimum of a hypothesis."""
        return self._found[hypothesis][0]

    def add_all(self, hypotheses: Iterable[Hypothesis]) -> None:
        """Search for hypotheses that have not been searched for; those with a cause less come first."""
        new = [h for h in hypotheses if h not in self._found]
        self.add_from([(h, start) for h in new for start in self._starts(h)])

    def add_from(self, starts: Sequence[tuple[Hypothesis, FloatArray]]) -> None:
        """Search for hypotheses from given starts; each may come several times."""
        if not starts:
            return
        hypotheses = [h for h, _ in starts]
        found: dict[Hypothesis, list[Optimum]] = {}
        for optimum in search(self.problem, hypotheses, answered(self.problem, starts)):
            found.setdefault(optimum.hypothesis, []).append(optimum)
        for hypothesis, optima in found.items():
            self._found[hypothesis] = tuple(sorted(optima, key=lambda o: -o.log_evidence))

    def _starts(self, hypothesis: Hypothesis) -> list[FloatArray]:
        size, soil = self.problem.size(hypothesis), self.problem.soil_offsets[-1]
        parents = [
            self.best(parent)
            for i in range(len(hypothesis))
            if (parent := hypothesis[:i] + hypothesis[i + 1 :]) in self._found
        ]
        parents.sort(key=lambda o: -o.log_evidence)
        starts = [self._extended(parent, hypothesis) for parent in parents[:_PARENTS]]
        if len(hypothesis) < 2:
            plain = np.zeros(size)
            plain[soil:] = 1.0
            starts.append(plain)
        return starts

    def _extended(self, parent: Optimum, hypothesis: Hypothesis) -> FloatArray:
        """Return the coordinates of the parent with the new cause at its median."""
        start = np.zeros(self.problem.size(hypothesis))
        soil = self.problem.soil_offsets[-1]
        start[:soil] = parent.standard[:soil]
        own = self.problem.positions(hypothesis)
        for use, where in self.problem.positions(parent.hypothesis).items():
            start[own[use]] = parent.standard[where]
        return start


def answered(problem: BenchProblem, starts: Sequence[tuple[Hypothesis, FloatArray]]) -> list[FloatArray]:
    """Return starts from which the model has an answer for every row, as far as there are any.

    A cause of its usual size may put the axle under ground: it then starts near neutral, and on a stiffer soil.
    """
    found = [start for _, start in starts]
    for stiffer in (0.0, 0.0, *_STIFFER):
        likelihoods = _likelihoods(problem, [h for h, _ in starts], found)
        lost = np.flatnonzero(~np.isfinite(likelihoods))
        if not len(lost):
            break
        for i in lost.tolist():
            found[i] = _nearly_neutral(problem, starts[i][0], found[i], stiffer)
    return found


def _likelihoods(problem: BenchProblem, hypotheses: Sequence[Hypothesis], starts: Sequence[FloatArray]) -> FloatArray:
    standard = np.zeros((len(starts), max(len(start) for start in starts)))
    for row, start in zip(standard, starts, strict=True):
        row[: len(start)] = start
    predicted, _ = problem.evaluate(hypotheses, standard)
    return log_likelihood(problem, predicted)


def _nearly_neutral(problem: BenchProblem, hypothesis: Hypothesis, start: FloatArray, stiffer: float) -> FloatArray:
    new = start.copy()
    for use, where in problem.positions(hypothesis).items():
        new[where] = [c.standard(c.neutral + c.side * _SMALL * c.scale) for c in problem.coordinates(use)]
    for soil, last in zip(problem.soils, problem.soil_offsets[1:], strict=True):
        if soil.names[-1:] == ("ln_stiffness",):
            new[last - 1] += stiffer
    return new
