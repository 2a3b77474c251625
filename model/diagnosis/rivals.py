"""Another place to settle at, where the linearisation never stood still.

Cross products about one explanation weigh all others by a straight line from there. Where the explanation itself is far
from straight (an angle behind the wheel grows with the root of its parameter), its size moves from round to round, and
about none of its points can it be believed: such a pair once seemed e^27 times as likely as the slip sinkage that was
hidden. So what seemed likely in other rounds is tried, each about its own point; the first at which everything stands
still, itself the likeliest there, is taken.

Log evidences about different points are not compared: the slopes in the ground speed differ from point to point, and
with them the density of the speed's error, by ten nats for causes that the data do not tell apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from model.diagnosis.aim import aims_of
from model.diagnosis.evidence import SetEstimate, estimate
from model.diagnosis.grams import Grams
from model.diagnosis.predictive import log_evidence
from model.diagnosis.settle import Settled, settle
from model.diagnosis.start import Start
from model.diagnosis.view import Clock

MOST_TRIED = 4
_ROUNDS = 3


def still(
    starts: Sequence[Start],
    moving: Settled,
    others: Sequence[tuple[str, ...]],
    choose: Callable[[Grams, SetEstimate | None], SetEstimate],
    clock: Clock,
) -> Settled:
    """Return where it stands still; the explanation that moves, where that is nowhere.

    Parameters
    ----------
    starts : sequence of Start
    moving : Settled
        What did not stand still.
    others : sequence of sets of causes
        That seemed likely.
    choose : callable
        Picks the explanation from cross products, given the one before.
    clock : Clock
    """
    ranked = sorted(
        {keys for keys in others if keys != moving.best.keys}, key=lambda keys: -log_evidence(moving.grams, keys)
    )
    for keys in ranked[:MOST_TRIED]:

        def hold(grams: Grams, _: SetEstimate | None, keys: tuple[str, ...] = keys) -> SetEstimate:
            return estimate(grams, keys)

        aims = aims_of(moving.views, moving.grams, estimate(moving.grams, keys))
        about = settle(starts, aims, hold, clock, believe=True, most=_ROUNDS)
        found = settle(starts, aims_of(about.views, about.grams, about.best), choose, clock, most=_ROUNDS)
        if found.still:
            return replace(found, seemed=(*moving.seemed, *found.seemed))
    return moving
