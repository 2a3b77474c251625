"""Where hypotheses fit best: starts for the search, from sets with a cause less."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_columns import Hypothesis
from model.diagnosis.bench_problem import BenchProblem
from model.diagnosis.bench_search import Optimum, log_likelihood, search

FloatArray = NDArray[np.float64]

_PARENTS = 2
"""Sets with a cause less that a search starts from."""
_SMALL = 0.05
"""Prior scales from neutral of a cause that starts near it."""
_STIFFER = (1.0, 1.0, 1.0)
"""One-sigmas by which the stiffness of a soil that carries nothing is raised, one after the other."""


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
            for left_out in range(len(hypothesis))
            if (parent := hypothesis[:left_out] + hypothesis[left_out + 1 :]) in self._found
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
        said = _likelihoods(problem, [h for h, _ in starts], found)
        lost = np.flatnonzero(~np.isfinite(said))
        if not len(lost):
            break
        for i in lost.tolist():
            found[i] = _nearly_neutral(problem, starts[i][0], found[i], stiffer)
    return found


def _likelihoods(problem: BenchProblem, hypotheses: Sequence[Hypothesis], starts: Sequence[FloatArray]) -> FloatArray:
    standard = np.zeros((len(starts), max(len(start) for start in starts)))
    for row, start in zip(standard, starts, strict=True):
        row[: len(start)] = start
    said, _ = problem.evaluate(hypotheses, standard)
    return log_likelihood(problem, said)


def _nearly_neutral(problem: BenchProblem, hypothesis: Hypothesis, start: FloatArray, stiffer: float) -> FloatArray:
    new = start.copy()
    for use, where in problem.positions(hypothesis).items():
        new[where] = [c.standard(c.neutral + c.side * _SMALL * c.scale) for c in problem.coordinates(use)]
    for soil, last in zip(problem.soils, problem.soil_offsets[1:], strict=True):
        if soil.names[-1:] == ("ln_stiffness",):
            new[last - 1] += stiffer
    return new
