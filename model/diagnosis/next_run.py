"""Which manoeuvre would split a set of causes best: the engine designs the next run.

Every manoeuvre of `model.diagnosis.manoeuvres` is linearised and whitened as if it had been driven, with the noise
model of the campaign; two more need no soil (`model.diagnosis.off_soil`). What its cross products would add to those of
the runs that were driven is said by `model.diagnosis.split`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.columns import columns_of
from model.diagnosis.grams import Grams
from model.diagnosis.linearise import Point, Simulation, linearise
from model.diagnosis.look import Look
from model.diagnosis.manoeuvres import LIKE_OTHERS, Manoeuvre, manoeuvres, typical_run
from model.diagnosis.noise import beliefs
from model.diagnosis.off_soil import hard_ground, lifted_wheel
from model.diagnosis.result import NextRun
from model.diagnosis.samples import Samples
from model.diagnosis.split import Member, split
from model.diagnosis.view import View
from model.diagnosis.whitening import run_grams

FloatArray = NDArray[np.float64]

MOST = 5
COASTING = "coasting on hard ground for two minutes, speeding up and slowing down"
_WORTH_SAYING = 0.05
_BETTER = 1.05
"""Times what one more run like the others would give: less is no reason to drive another way."""


def next_runs(look: Look, members: tuple[Member, ...], most: int = MOST) -> tuple[NextRun, ...]:
    """Rank manoeuvres by what one more run of them does to a set of causes.

    Parameters
    ----------
    look : Look
    members : tuple of Member
        The causes that could not be told apart, at their estimated sizes.
    most : int
        Manoeuvres to return.

    Returns
    -------
    tuple of NextRun
        Best first; what does no better than one more run like the others is left out. What a run separates are
        families. Empty where there is but one member.
    """
    known = {c.key: c.family for c in look.grams.causes}
    own = tuple(member for member in members if member.key in known)
    if len(own) < 2:
        return ()
    keys = tuple(dict.fromkeys((*(member.key for member in own), *look.best.keys)))
    found: dict[str, NextRun] = {}
    for change, added in _candidates(look, keys):
        result = split(look.grams, added, own)
        families = tuple(dict.fromkeys(known[key] for key in result.parted))
        said = NextRun(change, families, result.expected_log_bayes_factor)
        if change not in found or found[change].expected_log_bayes_factor < said.expected_log_bayes_factor:
            found[change] = said
    ranked = sorted(found.values(), key=lambda run: -run.expected_log_bayes_factor)
    plain = max((r.expected_log_bayes_factor for r in ranked if r.change.endswith(LIKE_OTHERS)), default=0.0)
    least = max(_BETTER * plain, _WORTH_SAYING)
    return tuple(r for r in ranked if r.expected_log_bayes_factor > least or r.change.endswith(LIKE_OTHERS))[:most]


def _candidates(look: Look, keys: tuple[str, ...]) -> Iterator[tuple[str, FloatArray]]:
    """Yield what could be done and the cross products that it would give."""
    for index, view in enumerate(look.views):
        if not len(view.samples):
            continue
        several = f"{view.campaign.name}: " if len(look.views) > 1 else ""
        effects = tuple(e for e in view.simulation.effects if e.key() in keys)
        simulation = replace(view.simulation, effects=effects)
        for manoeuvre in manoeuvres(view.samples):
            yield several + manoeuvre.change, embedded(look, index, simulation, run_matrix(view, simulation, manoeuvre))
        typical = typical_run(view.samples)
        for change, causes in (
            ("the zero with the wheel lifted, at standstill", lifted_wheel(view, simulation, typical)),
            (COASTING, hard_ground(view, simulation, typical)),
        ):
            q = len(simulation.space)
            matrix = np.zeros((1 + q + len(causes), 1 + q + len(causes)))
            matrix[1 + q :, 1 + q :] = causes
            yield several + change, embedded(look, index, simulation, matrix)


def run_matrix(view: View, simulation: Simulation, manoeuvre: Manoeuvre) -> FloatArray:
    """Return the cross products of a run that was not driven: residual (void), soil, causes.

    Parameters
    ----------
    view : View
        Of the campaign it would belong to.
    simulation : Simulation
        Its own, perhaps with fewer effects.
    manoeuvre : Manoeuvre
    """
    samples = manoeuvre.samples
    linear = linearise(simulation, samples, _point(view, simulation, samples))
    columns = columns_of(simulation, samples, linear)
    values = {name: belief.centre for name, belief in beliefs(samples).items()} | view.noise.values
    variance = np.full(len(samples), float(np.median(view.speed_variance)))
    keep = 1 + len(columns.soil) + len(columns.causes)
    return run_grams(samples, linear, columns, values, variance).matrices[0, :keep, :keep]


def _point(view: View, simulation: Simulation, samples: Samples) -> Point:
    known = {key for _, _, key in simulation.parameters}
    causes = {key: value for key, value in view.linear.point.causes.items() if key in known}
    return Point(view.linear.point.soil, causes, np.zeros(len(samples)))


def embedded(look: Look, index: int, simulation: Simulation, matrix: FloatArray) -> FloatArray:
    """Return cross products of one campaign in the layout of all campaigns' Grams, shape (m, m); the rest is zero.

    Parameters
    ----------
    look : Look
    index : int
        Of the campaign.
    simulation : Simulation
        Whose effects are the causes in `matrix`.
    matrix : array, shape (1 + q + k, 1 + q + k)
    """
    grams: Grams = look.grams
    q = len(simulation.space)
    before = sum(len(view.simulation.space) for view in look.views[:index])
    turn = np.zeros((len(matrix), grams.matrices.shape[1]))
    turn[np.arange(1, 1 + q), 1 + before + np.arange(q)] = 1.0
    shared: Mapping[tuple[str, str], int] = {(c.key, c.parameter): i for i, c in enumerate(grams.causes)}
    for row, (effect, i, _) in enumerate(simulation.parameters):
        parameter = effect.parameters[i]
        at = shared[effect.key(), parameter.name]
        stretch = grams.causes[at].scale / parameter.towards(simulation.wheel)
        turn[1 + q + row, grams.cause_columns.start + at] = stretch
    return np.asarray(turn.T @ matrix @ turn)
