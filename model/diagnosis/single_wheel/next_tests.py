"""Further test of the wheel that would best separate the most probable sets of causes.

Every design is predicted by both sets, with what each has left unknown; the expected log Bayes factor is the divergence
of the two predictions from each other, taken as normal, after three repeats at every slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import OUTPUTS, FloatArray
from model.diagnosis.core.next_test import WORTH_SAYING, best_first, expected_nats
from model.diagnosis.core.result import NextRun
from model.diagnosis.single_wheel.noise import FORM_SHARE
from model.diagnosis.single_wheel.problem import BenchProblem
from model.diagnosis.single_wheel.sets import family_of
from model.diagnosis.single_wheel.weighing import Weighed, Weighing

_LOADS = ((0.5, "half the load"), (2.0, "twice the load"))
_DRAWS = 160
_SETS = 5
_REPEATS = 3


@dataclass(frozen=True)
class _Design:
    words: str
    problem: BenchProblem
    channels: tuple[str, ...]


def next_tests(weighing: Weighing, rng: np.random.Generator) -> tuple[NextRun, ...]:
    """Return designs, best first."""
    rivals = _rivals(weighing)
    found = []
    for design in _designs(weighing.problem) if len(rivals) > 1 else []:
        said = [_prediction_of_design(design, weighed, rng) for _, weighed in rivals]
        known = [foretold for foretold in said if foretold is not None]
        if len(known) < len(said):
            continue
        nats = np.array([[_divergence(a, b) for b in known] for a in known])
        expected = expected_nats(nats, [p for p, _ in rivals])
        if expected > WORTH_SAYING:
            found.append(NextRun(design.words, _parted(rivals, nats), expected))
    return tuple(best_first(found))


def _parted(rivals: Sequence[tuple[float, Weighed]], nats: FloatArray) -> tuple[str, str]:
    """Return in what the two sets differ that come apart most, as likely as they are."""
    p = np.array([probability for probability, _ in rivals])
    i, j = divmod(int(np.argmax(np.outer(p, p) * (nats + nats.T))), len(rivals))
    return _name(rivals[i][1], rivals[j][1]), _name(rivals[j][1], rivals[i][1])


def _rivals(weighing: Weighing) -> list[tuple[float, Weighed]]:
    """Return the most probable sets, one for each combination of families."""
    found: dict[frozenset[str], tuple[float, Weighed]] = {}
    for p, weighed in zip(weighing.probabilities, weighing.sets, strict=True):
        if weighed.posterior is not None and p > 0:
            found.setdefault(weighed.families, (float(p), weighed))
    return sorted(found.values(), key=lambda pair: -pair[0])[:_SETS]


def _name(weighed: Weighed, other: Weighed) -> str:
    own = [family_of(use) for use in weighed.hypothesis]
    return " and ".join([family for family in own if family not in other.families] or own) or "nothing more"


def _designs(problem: BenchProblem) -> list[_Design]:
    groups = np.unique(problem.group)
    first = np.array([np.flatnonzero(problem.group == g)[0] for g in groups])
    slip, load = (np.array([x[problem.group == g].mean() for g in groups]) for x in (problem.slip, problem.load_n))
    at_centres = replace(problem, slip=slip, load_n=load, bench=problem.bench[first], group=np.arange(len(groups)))
    used = problem.channels
    missing = [channel for channel in OUTPUTS if channel not in used]
    designs = [_Design(f"measure the {OUTPUTS[c].name} too", at_centres, (*used, c)) for c in missing]
    for factor, words in _LOADS:
        designs.append(_Design(words, replace(at_centres, load_n=load * factor), used))
    if missing:
        more = tuple(dict.fromkeys((*used, *missing)))
        for factor, words in _LOADS:
            together = f"{words}, with {' and '.join(OUTPUTS[c].name for c in missing)} measured"
            designs.append(_Design(together, replace(at_centres, load_n=load * factor), more))
    return designs


def _prediction_of_design(
    design: _Design, weighed: Weighed, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """Return mean and covariance of what a set foretells of a design; None where the model has no answer."""
    posterior = weighed.posterior
    assert posterior is not None
    drawn = rng.choice(len(posterior.weights), _DRAWS, p=posterior.weights)
    said, _ = design.problem.evaluate([weighed.hypothesis] * _DRAWS, posterior.standard[drawn])
    values = np.concatenate([said[channel] for channel in design.channels], axis=1)
    possible = np.isfinite(values).all(axis=1)
    if possible.mean() < 0.9:
        return None
    noise = np.concatenate([_variance(design, channel) for channel in design.channels])
    return values[possible].mean(axis=0), np.atleast_2d(np.cov(values[possible].T)) + np.diag(noise)


def _variance(design: _Design, channel: str) -> FloatArray:
    problem = design.problem
    known = {noise.channel: noise for noise in problem.noises}
    if channel in known:
        form, scatter = known[channel].form_scale, float(np.median(known[channel].scatter))
    else:
        form = scatter = FORM_SHARE * problem.size_of(channel)
    return np.full(len(problem.slip), form**2 + scatter**2 / _REPEATS)


def _divergence(a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray]) -> float:
    """Return the expected log Bayes factor for a over b if a is true."""
    gap = a[0] - b[0]
    inverse = np.linalg.inv(b[1])
    determinants = float(np.linalg.slogdet(b[1])[1] - np.linalg.slogdet(a[1])[1])
    return 0.5 * (float(np.trace(inverse @ a[1])) - len(gap) + float(gap @ inverse @ gap) + determinants)
