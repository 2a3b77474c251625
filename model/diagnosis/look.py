"""The look at the data: linearise, whiten, explain, and again about the best explanation, until it stands still."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from model.diagnosis.aim import first_aim
from model.diagnosis.campaign import Campaign, DiagnosisOptions
from model.diagnosis.evidence import SetEstimate, best_set
from model.diagnosis.grams import Grams
from model.diagnosis.noise import Noise, beliefs
from model.diagnosis.noise_words import remarks
from model.diagnosis.predictive import log_evidence
from model.diagnosis.rivals import still
from model.diagnosis.settle import Settled, settle
from model.diagnosis.start import Start, begin, delays_s, never_told
from model.diagnosis.view import Clock, View
from model.one_thread import one_thread

_NOTHING = 1e-8


@dataclass(frozen=True)
class Look:
    """What a look at some campaigns gives.

    Attributes
    ----------
    grams : Grams
        Of all runs of all campaigns, about the last point.
    views : tuple of View
        One for each campaign, in their order; runs follow each other in `grams` likewise.
    best : SetEstimate
        The likeliest set of causes, about which was linearised.
    cannot_tell : mapping family -> why
    excluded : set of str
        Effects (by key) that leave no trace in these data whatever their size; see `best_set`.
    most_causes : int
        Of a set.
    rounds : int
        Linearisations.
    settled : bool
        Whether the last one changed nothing.
    notes : tuple of str
    stages_s : mapping stage -> seconds
    """

    grams: Grams
    views: tuple[View, ...]
    best: SetEstimate
    cannot_tell: dict[str, str]
    excluded: frozenset[str]
    most_causes: int
    rounds: int
    settled: bool
    notes: tuple[str, ...]
    stages_s: dict[str, float]

    @property
    def noises(self) -> tuple[Noise, ...]:
        """The noise model of each campaign."""
        return tuple(view.noise for view in self.views)


@one_thread
def look(
    campaigns: Sequence[Campaign],
    options: DiagnosisOptions | None = None,
    noises: Sequence[Noise] | None = None,
) -> Look:
    """Look at one or several campaigns.

    Parameters
    ----------
    campaigns : sequence of Campaign
        Causes are shared, soils are not.
    options : DiagnosisOptions, optional
    noises : sequence of Noise, optional
        The noise model of each campaign; estimated where it is not given.

    Raises
    ------
    DataError
        A campaign has fewer than 50 usable samples, or neither drawbar pull nor torque.
    """
    options = options or DiagnosisOptions()
    clock = Clock()
    with clock.stage("samples"):
        starts = [begin(c, options, noises[i] if noises else None) for i, c in enumerate(campaigns)]
    found = [_first(starts, delay, options, clock) for delay in delays_s(starts)]
    likeliest = max(found, key=lambda f: log_evidence(f.grams, f.best.keys))
    if not likeliest.still:
        seemed = tuple(dict.fromkeys(keys for f in found for keys in f.seemed))
        likeliest = still(starts, likeliest, seemed, _choice(options), clock)
    return Look(
        grams=likeliest.grams,
        views=likeliest.views,
        best=likeliest.best,
        cannot_tell=never_told(starts),
        excluded=_traceless(likeliest.grams),
        most_causes=options.most_causes,
        rounds=len(likeliest.seemed),
        settled=likeliest.still,
        notes=tuple(note for view in likeliest.views for note in _notes(view)),
        stages_s=clock.stages_s,
    )


def _first(starts: Sequence[Start], delay_s: float, options: DiagnosisOptions, clock: Clock) -> Settled:
    """Settle at what is likeliest, from the laboratory's soil and no cause."""
    aims = [first_aim(s, delay_s) for s in starts]
    return settle(starts, aims, _choice(options), clock)


def _notes(view: View) -> tuple[str, ...]:
    return (*view.samples.notes, *remarks(view.noise, beliefs(view.samples), view.linear.channels))


def _choice(options: DiagnosisOptions) -> Callable[[Grams, SetEstimate | None], SetEstimate]:
    """Return how the set is chosen about which is linearised."""

    def choose(grams: Grams, before: SetEstimate | None) -> SetEstimate:
        return best_set(grams, _traceless(grams), options.most_causes, before.keys if before else None)

    return choose


def _traceless(grams: Grams) -> frozenset[str]:
    """Return the effects whose columns are zero in every run."""
    power = np.einsum("rii->i", grams.matrices)[grams.cause_columns]
    seen = {c.key for c, x in zip(grams.causes, power, strict=True) if x > _NOTHING}
    return frozenset(c.key for c in grams.causes) - seen
