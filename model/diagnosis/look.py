"""The look at the data: linearise, whiten, explain, and again about the best explanation, until it stands still."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.aim import Aim, aims_of, first_aim
from model.diagnosis.campaign import Campaign, DiagnosisOptions
from model.diagnosis.columns import Columns, columns_of
from model.diagnosis.evidence import SetEstimate, best_set
from model.diagnosis.grams import Grams
from model.diagnosis.hyper import estimated
from model.diagnosis.joint import joined
from model.diagnosis.linearise import Linear, Simulation, linearise
from model.diagnosis.loads import with_likely_load
from model.diagnosis.noise import Noise, beliefs, remarks
from model.diagnosis.noise_blocks import blocks_of
from model.diagnosis.predictive import log_evidence
from model.diagnosis.samples import Samples
from model.diagnosis.start import Start, begin, delays_s, never_told
from model.diagnosis.whitening import RunGrams, run_grams
from model.one_thread import one_thread

FloatArray = NDArray[np.float64]

MOST_ROUNDS = 6
_STILL = 0.25
"""Change of a cause in its one-sigma, and of the soil in the laboratory's, at which the linearisation stands still."""
_FINEST = 0.005
_NOTHING = 1e-8


@dataclass(frozen=True)
class View:
    """One campaign as it was looked at.

    Attributes
    ----------
    campaign : Campaign
    samples : Samples
        With the likeliest load, see `model.diagnosis.loads`.
    simulation : Simulation
    linear : Linear
        About the last point.
    columns : Columns
    noise : Noise
    grams : RunGrams
        Of this campaign alone.
    speed_variance : array, shape (n,)
        Of what is left of the ground speed's error about the point.
    """

    campaign: Campaign
    samples: Samples
    simulation: Simulation
    linear: Linear
    columns: Columns
    noise: Noise
    grams: RunGrams
    speed_variance: FloatArray


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
    rounds: int
    settled: bool
    notes: tuple[str, ...]
    stages_s: dict[str, float]

    @property
    def noises(self) -> tuple[Noise, ...]:
        """The noise model of each campaign."""
        return tuple(view.noise for view in self.views)


@dataclass
class Clock:
    """Seconds by stage."""

    stages_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside for a stage."""
        start = perf_counter()
        yield
        self.stages_s[name] = self.stages_s.get(name, 0.0) + perf_counter() - start


@dataclass(frozen=True)
class _Settled:
    """Where the linearisation came to from one start."""

    grams: Grams
    views: tuple[View, ...]
    best: SetEstimate
    excluded: frozenset[str]
    rounds: int
    settled: bool


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
    found = [_settle(starts, delay, options, clock) for delay in delays_s(starts)]
    likeliest = max(found, key=lambda f: log_evidence(f.grams, f.best.keys))
    return Look(
        grams=likeliest.grams,
        views=likeliest.views,
        best=likeliest.best,
        cannot_tell=never_told(starts),
        excluded=likeliest.excluded,
        rounds=likeliest.rounds,
        settled=likeliest.settled,
        notes=tuple(n for v in likeliest.views for n in (*v.samples.notes, *remarks(v.noise, v.linear.channels))),
        stages_s=clock.stages_s,
    )


def _settle(starts: Sequence[Start], delay_s: float, options: DiagnosisOptions, clock: Clock) -> _Settled:
    """Linearise, whiten and explain until the linearisation stands still."""
    aims = [first_aim(s, delay_s) for s in starts]
    best: SetEstimate | None = None
    settled = False
    rounds = 0
    while True:
        views = [_viewed(s, aim, rounds, clock) for s, aim in zip(starts, aims, strict=True)]
        rounds += 1
        grams = joined([(v.campaign.name, v.samples.run_names, v.columns, v.grams) for v in views])
        with clock.stage("evidence"):
            excluded = _traceless(grams)
            found = best_set(grams, excluded, options.most_causes)
        settled = best is not None and _same(best, found)
        best = found
        if settled or rounds == MOST_ROUNDS:
            return _Settled(grams, tuple(views), best, excluded, rounds, settled)
        with clock.stage("smoothing"):
            aims = aims_of(views, grams, best)


def _viewed(start: Start, aim: Aim, rounds: int, clock: Clock) -> View:
    """Linearise a campaign about a point and whiten it."""
    variance, noise = aim.speed_variance, aim.noise
    samples = with_likely_load(start.samples, noise.values)
    with clock.stage("linearise"):
        linear = linearise(start.simulation, samples, aim.point)
    with clock.stage("columns"):
        columns = columns_of(start.simulation, samples, linear)
    if start.noise is None and rounds:
        with clock.stage("noise"):
            blocks = blocks_of(samples, linear, columns, variance, noise.values)
            noise = estimated(blocks, beliefs(samples), noise.values)
    with clock.stage("whitening"):
        grams = run_grams(samples, linear, columns, noise.values, variance)
    return View(start.campaign, samples, start.simulation, linear, columns, noise, grams, variance)


def _traceless(grams: Grams) -> frozenset[str]:
    """Return the effects whose columns are zero in every run."""
    power = np.einsum("rii->i", grams.matrices)[grams.cause_columns]
    seen = {c.key for c, x in zip(grams.causes, power, strict=True) if x > _NOTHING}
    return frozenset(c.key for c in grams.causes) - seen


def _same(one: SetEstimate, other: SetEstimate) -> bool:
    """Return whether two explanations are the same to what can be told of them."""
    if one.keys != other.keys:
        return False
    change = np.concatenate([one.soil - other.soil, (one.coefficients - other.coefficients)[list(other.columns)]])
    sigma = np.concatenate([np.ones(len(other.soil)), np.maximum(other.sigmas, _FINEST)])
    return bool((np.abs(change) < _STILL * sigma).all())
