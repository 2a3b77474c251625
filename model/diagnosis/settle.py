"""Linearise, whiten and explain, and again about the best explanation, until it stands still."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from model.diagnosis.aim import Aim, aims_of
from model.diagnosis.columns import columns_of
from model.diagnosis.evidence import SetEstimate
from model.diagnosis.grams import Grams
from model.diagnosis.hyper import estimated
from model.diagnosis.joint import joined
from model.diagnosis.linearise import linearise
from model.diagnosis.loads import with_likely_load
from model.diagnosis.noise import beliefs
from model.diagnosis.noise_blocks import blocks_of
from model.diagnosis.start import Start
from model.diagnosis.view import Clock, View
from model.diagnosis.whitening import run_grams

MOST_ROUNDS = 6
_STILL = 0.25
"""Change of a cause in its one-sigma, and of the soil in the laboratory's, at which the linearisation stands still."""
_FINEST = 0.005


@dataclass(frozen=True)
class Settled:
    """Where the linearisation came to from one start.

    Attributes
    ----------
    grams : Grams
    views : tuple of View
    best : SetEstimate
        Chosen from `grams`.
    still : bool
        Whether the last round changed nothing.
    seemed : tuple of sets of causes
        The best of each round.
    """

    grams: Grams
    views: tuple[View, ...]
    best: SetEstimate
    still: bool
    seemed: tuple[tuple[str, ...], ...]


def settle(
    starts: Sequence[Start],
    aims: Sequence[Aim],
    choose: Callable[[Grams, SetEstimate | None], SetEstimate],
    clock: Clock,
    *,
    believe: bool = False,
    most: int = MOST_ROUNDS,
) -> Settled:
    """Settle at an explanation.

    Parameters
    ----------
    starts : sequence of Start
    aims : sequence of Aim
        Where to begin.
    choose : callable
        Picks the explanation from cross products, given the one before.
    clock : Clock
    believe : bool
        Take the noise of the first round as it is; otherwise it is estimated from the second round on.
    most : int
        Rounds.
    """
    best: SetEstimate | None = None
    seemed: list[tuple[str, ...]] = []
    while True:
        fixed = believe or not seemed
        views = [viewed(s, aim, clock, fixed=fixed) for s, aim in zip(starts, aims, strict=True)]
        grams = joined([(v.campaign.name, v.samples.run_names, v.columns, v.grams) for v in views])
        with clock.stage("evidence"):
            found = choose(grams, best)
        still = best is not None and _same(best, found)
        best = found
        seemed.append(best.keys)
        if still or len(seemed) == most:
            return Settled(grams, tuple(views), best, still, tuple(seemed))
        with clock.stage("smoothing"):
            aims = aims_of(views, grams, best)


def viewed(start: Start, aim: Aim, clock: Clock, *, fixed: bool) -> View:
    """Linearise a campaign about a point and whiten it.

    Parameters
    ----------
    start : Start
    aim : Aim
    clock : Clock
    fixed : bool
        Take the noise of the aim as it is.
    """
    variance, noise = aim.speed_variance, aim.noise
    samples = with_likely_load(start.samples, noise.values)
    with clock.stage("linearise"):
        linear = linearise(start.simulation, samples, aim.point)
    with clock.stage("columns"):
        columns = columns_of(start.simulation, samples, linear)
    if start.noise is None and not fixed:
        with clock.stage("noise"):
            blocks = blocks_of(samples, linear, columns, variance, noise.values)
            noise = estimated(blocks, beliefs(samples), noise.values)
    with clock.stage("whitening"):
        grams = run_grams(samples, linear, columns, noise.values, variance)
    return View(start.campaign, samples, start.simulation, linear, columns, noise, grams, variance)


def _same(one: SetEstimate, other: SetEstimate) -> bool:
    """Return whether two explanations are the same to what can be told of them."""
    if one.keys != other.keys:
        return False
    change = np.concatenate([one.soil - other.soil, (one.coefficients - other.coefficients)[list(other.columns)]])
    sigma = np.concatenate([np.ones(len(other.soil)), np.maximum(other.sigmas, _FINEST)])
    return bool((np.abs(change) < _STILL * sigma).all())
