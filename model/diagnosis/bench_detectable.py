"""The smallest size of every cause that a bench's rows would have shown, linearised at the laboratory's soil."""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_adequacy import with_usual_form
from model.diagnosis.bench_columns import CauseUse
from model.diagnosis.bench_problem import BenchProblem
from model.diagnosis.bench_search import Optimum
from model.diagnosis.bench_sets import Library, family_of
from model.diagnosis.prior import SIZE_PRIOR
from model.diagnosis.result import Detectable
from model.effects import EFFECTS

FloatArray = NDArray[np.float64]


def detectable(problem: BenchProblem, library: Library, null: Optimum, name_at: float) -> dict[str, Detectable]:
    """Return the size of each cause from which on its family is expected to be named.

    Parameters
    ----------
    problem : BenchProblem
    library : Library
    null : Optimum
        Of no cause.
    name_at : float
        Probability from which on a family is named.
    """
    keys = [use.key for use in library.uses]
    count = len(library.families)
    found: dict[str, Detectable] = {}
    for use in library.uses:
        forms = sum(family_of(other) == family_of(use) for other in library.uses)
        odds = log(SIZE_PRIOR[1] / count / forms / SIZE_PRIOR[0])
        sizes = []
        for which, coordinate in enumerate(problem.coordinates(use)):
            spread = _spread(problem, null, use, which)
            wanted = 2.0 * (log(name_at / (1.0 - name_at)) - odds + 0.5 * log(1.0 + 1.0 / spread**2))
            sizes.append((spread * sqrt(max(wanted, 0.0)), coordinate))
        size, coordinate = min(sizes, key=lambda pair: pair[0])
        found[use.key] = Detectable(
            coordinate.name, coordinate.neutral + coordinate.side * coordinate.scale * size, coordinate.unit
        )
    return {key: found[key] for key in keys}


def _spread(problem: BenchProblem, null: Optimum, use: CauseUse, which: int) -> float:
    """Return the one-sigma of a parameter, in prior scales, with the soil projected out."""
    size = len(EFFECTS[use.key].parameters)
    soil = problem.soil_offsets[-1]
    standard = np.zeros((1, soil + size))
    standard[0, :soil] = null.standard[:soil]
    coordinates = problem.coordinates(use)
    for i, coordinate in enumerate(coordinates):
        value = coordinate.neutral + (0.5 * coordinate.side * coordinate.scale if i == which else 0.0)
        standard[0, soil + i] = coordinate.standard(value)
    said, _ = problem.evaluate([(use,)], standard)
    information = 0.0
    fixed = with_usual_form(problem)
    change, slopes, precision = [], [], []
    for noise, rows in zip(fixed.noises, fixed.rows, strict=True):
        change.append((said[noise.channel][0, rows] - null.said[noise.channel][rows]) / 0.5)
        slopes.append(null.slopes[noise.channel][rows, :soil])
        precision.append(noise.precision(np.ones(1)))
    information = sum(float(c @ p @ c) for c, p in zip(change, precision, strict=True))
    if not np.isfinite(information) or information <= 0:
        return np.inf
    cross = sum(s.T @ p @ c for s, p, c in zip(slopes, precision, change, strict=True))
    inner = np.eye(soil) + sum(s.T @ p @ s for s, p in zip(slopes, precision, strict=True))
    left = information - float(cross @ np.linalg.solve(inner, cross))
    return 1.0 / sqrt(left) if left > 0 else np.inf
