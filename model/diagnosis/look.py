"""The look at the data: linearise, whiten, explain, and again about the best explanation, until it stands still."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from daq.errors import DataError, Fault
from model.diagnosis.campaign import Campaign, DiagnosisOptions
from model.diagnosis.columns import Columns, columns_of
from model.diagnosis.evidence import SetEstimate, best_set
from model.diagnosis.grams import Grams
from model.diagnosis.hyper import estimated
from model.diagnosis.joint import joined
from model.diagnosis.linearise import Linear, Point, Simulation, linearise
from model.diagnosis.noise import Noise, beliefs
from model.diagnosis.noise_blocks import blocks_of
from model.diagnosis.samples import FEWEST, Samples, samples_of
from model.diagnosis.soil_space import soil_space
from model.diagnosis.tellable import cannot_tell, considered
from model.diagnosis.whitening import RunGrams, run_grams, smoothed_speed

FloatArray = NDArray[np.float64]

MOST_ROUNDS = 4
_STILL = 0.1
"""Change of the coefficients, in units of their priors, below which the linearisation stands still."""
_LONGEST_STEP = 2.0
_NOTHING = 1e-8


@dataclass(frozen=True)
class View:
    """One campaign as it was looked at.

    Attributes
    ----------
    campaign : Campaign
    samples : Samples
        Those that the model has an answer for.
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
class _Start:
    """A campaign before it was looked at."""

    campaign: Campaign
    samples: Samples
    simulation: Simulation
    noise: Noise | None


@dataclass(frozen=True)
class _Aim:
    """Where to linearise, by which noise, and how well the ground speed is known there."""

    point: Point
    noise: Noise
    speed_variance: FloatArray


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
        starts = [_begin(c, options, noises[i] if noises else None) for i, c in enumerate(campaigns)]
    aims = [_first_aim(s) for s in starts]
    views: list[View] = []
    best: SetEstimate | None = None
    settled = False
    rounds = 0
    while rounds < MOST_ROUNDS and not settled:
        views = [_viewed(s, aim, rounds, clock) for s, aim in zip(starts, aims, strict=True)]
        rounds += 1
        grams = _joined(views)
        with clock.stage("evidence"):
            excluded = _traceless(grams)
            found = best_set(grams, excluded, options.most_causes)
        settled = best is not None and _same(best, found)
        best = found
        with clock.stage("smoothing"):
            aims = _aims(views, grams, best)
    assert best is not None
    return Look(
        grams=grams,
        views=tuple(views),
        best=best,
        cannot_tell=_never_told(starts),
        excluded=excluded,
        rounds=rounds,
        settled=settled,
        notes=tuple(note for s in starts for note in s.samples.notes),
        stages_s=clock.stages_s,
    )


def _begin(campaign: Campaign, options: DiagnosisOptions, noise: Noise | None) -> _Start:
    """Collect the samples that the laboratory's soil has an answer for."""
    samples = samples_of(campaign, options.channels)
    fault = unfit(campaign, samples)
    if fault:
        raise DataError(fault)
    simulation = Simulation(
        campaign.wheel,
        campaign.soil,
        soil_space(campaign.soil_prior),
        considered(campaign, samples, options),
        options.reading,
    )
    return _Start(campaign, samples, simulation, noise)


def unfit(campaign: Campaign, samples: Samples) -> Fault | None:
    """Return why a campaign cannot be looked at; None where it can.

    Parameters
    ----------
    campaign : Campaign
    samples : Samples
        Of it.
    """
    if not set(samples.measured) & {"dp", "t"}:
        return Fault(
            "neither drawbar pull nor torque was measured",
            campaign.name,
            next_step="name their signals under [signals] of vehicle.toml",
        )
    return _too_few(campaign, samples) if len(samples) < FEWEST else None


def _too_few(campaign: Campaign, samples: Samples) -> Fault:
    left_out = ", ".join(f"{why.replace('_', ' ')} {n}" for why, n in samples.left_out.items() if n)
    return Fault(
        "too few usable samples for a diagnosis",
        campaign.name,
        found=f"{len(samples)} samples of {samples.block_s:g} s (left out: {left_out or 'nothing'})",
        expected=f"at least {FEWEST}",
        next_step="drive longer, with more slip, above 0.5 m/s",
    )


def _first_aim(start: _Start) -> _Aim:
    """Return the laboratory's soil without any cause, and the noise as it is thought of beforehand."""
    samples = start.samples
    noise = start.noise or Noise({name: b.centre for name, b in beliefs(samples).items()})
    variance = noise.values["speed_noise_mps"] ** 2 + noise.values["speed_white_mps"] ** 2
    point = Point(np.zeros(len(start.simulation.space)), {}, np.zeros(len(samples)))
    return _Aim(point, noise, np.full(len(samples), variance))


def _viewed(start: _Start, aim: _Aim, rounds: int, clock: Clock) -> View:
    """Linearise a campaign about a point and whiten it."""
    samples, variance, noise = start.samples, aim.speed_variance, aim.noise
    with clock.stage("linearise"):
        linear = linearise(start.simulation, samples, aim.point)
    with clock.stage("columns"):
        columns = columns_of(start.simulation, samples, linear, np.zeros_like(linear.value))
    if start.noise is None and 0 < rounds < 3:
        with clock.stage("noise"):
            blocks = blocks_of(samples, linear, columns, variance, noise.values)
            noise = estimated(blocks, beliefs(samples), noise.values)
    with clock.stage("whitening"):
        grams = run_grams(samples, linear, columns, noise.values, variance)
    return View(start.campaign, samples, start.simulation, linear, columns, noise, grams, variance)


def _joined(views: Sequence[View]) -> Grams:
    return joined([(v.campaign.name, v.samples.run_names, v.columns, v.grams) for v in views])


def _traceless(grams: Grams) -> frozenset[str]:
    """Return the effects whose columns are zero in every run."""
    power = np.einsum("rii->i", grams.matrices)[grams.cause_columns]
    seen = {c.key for c, x in zip(grams.causes, power, strict=True) if x > _NOTHING}
    return frozenset(c.key for c in grams.causes) - seen


def _same(one: SetEstimate, other: SetEstimate) -> bool:
    """Return whether two explanations are the same to what a linearisation notices."""
    if one.keys != other.keys:
        return False
    change = np.concatenate([one.coefficients - other.coefficients, one.soil - other.soil])
    return bool(np.abs(change).max(initial=0.0) < _STILL)


def _aims(views: Sequence[View], grams: Grams, best: SetEstimate) -> list[_Aim]:
    """Return where to linearise next: the best soil and causes, and the ground speed that goes with them."""
    aims = []
    soil_at = 0
    for view in views:
        own = len(view.columns.soil)
        soil = best.soil[soil_at : soil_at + own]
        soil_at += own
        coefficient = {
            (c.key, c.parameter): float(x) for c, x in zip(grams.causes, best.coefficients, strict=True) if x != 0.0
        }
        scale = {(c.key, c.parameter): c.scale for c in grams.causes}
        causes, at = {}, np.zeros(len(view.columns.causes))
        for i, ((_, _, name), c) in enumerate(zip(view.simulation.parameters, view.columns.causes, strict=True)):
            size = coefficient.get((c.key, c.parameter), 0.0) * scale[c.key, c.parameter]
            if size != 0.0:
                causes[name] = float(np.clip(c.neutral + size, c.lower, c.upper))
                at[i] = size / c.scale
        soil = view.linear.point.soil + np.clip(soil - view.linear.point.soil, -_LONGEST_STEP, _LONGEST_STEP)
        speed, variance = _speed(view, soil, at)
        aims.append(_Aim(Point(soil, causes, speed), view.noise, variance))
    return aims


def _speed(view: View, soil: FloatArray, causes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smoothed error of the ground speed under a soil and causes, and its variance."""
    columns = view.columns
    shared = np.concatenate([[1.0], -soil, -causes, np.zeros(len(columns.basis))])
    by_run = view.grams.constants @ shared
    scale = np.array([view.noise.values[name] for name in columns.constants])
    coefficients = np.concatenate([np.tile(shared, (len(by_run), 1)), -by_run * scale], axis=1)
    return smoothed_speed(view.samples, view.linear, columns, view.noise.values, view.speed_variance, coefficients)


def _never_told(starts: Sequence[_Start]) -> dict[str, str]:
    """Return what no campaign can tell."""
    each = [cannot_tell(s.campaign, s.samples, s.simulation.effects) for s in starts]
    shared = set.intersection(*(set(found) for found in each)) if each else set()
    return {family: why for family, why in each[0].items() if family in shared} if each else {}
