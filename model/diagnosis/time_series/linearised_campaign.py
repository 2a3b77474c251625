r"""Linearised model of campaigns: linearise, whiten and explain, and repeat about the best explanation to convergence.

**Most probable load, given the measured one.**
The load is measured, and its noise makes a line of force over load look flatter than it is: flatter about the middle
of the data, so that the zeros of load, torque and drawbar pull seem to be off where the soil cannot take it up
(docs/decisions/torque-zero-bias.md). So every run's load is drawn towards its mean as far as noise and movement say,

.. math:: \hat W = \mathrm{E}[W \mid W_m], \qquad W_m = W + e,

with W and e two first-order Markov processes: e that of the noise model, W what is left of the measured covariance.

Source: regression calibration; Carroll, Ruppert, Stefanski & Crainiceanu (2006), Measurement Error in Nonlinear Models,
ch. 4.

**Where the iteration does not converge.**
Cross products about one explanation weigh all others by a straight line from there. Where the explanation itself is far
from straight (an angle behind the wheel grows with the root of its parameter), its size moves with every iteration, and
its probability is not to be trusted at any of these points: such a pair once appeared e^27 times as probable as the
slip sinkage that was hidden. So the sets that were probable in other iterations are tried, each about its own point;
the first one that converges, and is the most probable set there, is taken.

Log evidences about different points are not compared: the slopes in the ground speed differ from point to point, and
with them the density of the speed's error, by ten nats for causes that the data do not separate.

**No sample is lost.** The evidence of no data is 0, more than that of any data, so that an iteration which goes where
the model has no answer stays there. A step that loses the answer of a sample is shortened; where no step keeps them
all, the iteration ends, not converged. Starts are compared by the samples that all of them answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from daq import BoolArray, FloatArray, IndexArray, Note
from model.cores import one_thread
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.clock import Clock
from model.diagnosis.core.information import Information
from model.diagnosis.core.result import Linearisation
from model.diagnosis.time_series.columns import Grams, columns_of
from model.diagnosis.time_series.evidence import SetEstimate, best_set, estimate, log_evidence, log_evidence_of_sets
from model.diagnosis.time_series.hyper import blocks_of, estimated
from model.diagnosis.time_series.joining import APART, OWN_SHARES, OWN_SPEED, joined, most_probable_shares, part_of
from model.diagnosis.time_series.linearisation_point import LinearisationPoint, first_point, linearisation_points
from model.diagnosis.time_series.linearise import Linear, linearise
from model.diagnosis.time_series.noise import Noise, hyper_priors, noise_notes, swing_seen
from model.diagnosis.time_series.samples import Samples, on_common_blocks, places_of, samples_of, steps_of
from model.diagnosis.time_series.selection import without_near_cuts, without_outliers
from model.diagnosis.time_series.start import (
    CampaignData,
    Start,
    begin,
    first_causes,
    not_identifiable_in_any,
    soil_places_of,
)
from model.diagnosis.time_series.whitening import StateSpace, smoothed
from model.effects.catalogue import parted

_LEAST_SHARE = 0.1
"""Of the measured variance, that is taken for movement whatever the noise."""
_LEAST_PAIRS = 10
_STEADY_N = 0.1
"""One-sigma of a load that does not move: nothing to be drawn anywhere."""


def with_likely_load(samples: Samples, values: Mapping[str, float]) -> Samples:
    """Return samples with the load's expectation, by the noise's hyper-parameters, instead of its measured value."""
    measured = np.asarray(samples.conditions.vertical_load_n)
    counts = np.bincount(samples.run, minlength=samples.runs)
    means = np.bincount(samples.run, measured, minlength=samples.runs) / np.maximum(counts, 1)
    swing = measured - means[samples.run]
    step_s = steps_of(samples.time_s, samples.run)
    near = np.flatnonzero((step_s > 0) & (step_s < 1.5 * samples.block_s))
    if len(near) < _LEAST_PAIRS:
        return samples
    noise, memory = values["load_noise_n"] ** 2, np.exp(-samples.block_s / values["load_noise_time_s"])
    total = float(np.mean(swing**2))
    if total <= _STEADY_N**2:
        return samples
    moving = max(total - noise, _LEAST_SHARE * total)
    kept = (float(np.mean(swing[near] * swing[near - 1])) - noise * memory) / moving
    kept = float(np.clip(kept, 0.01, 0.99))
    at = places_of(samples.run, samples.runs)
    decay = np.stack([kept ** (step_s / samples.block_s), memory ** (step_s / samples.block_s)], axis=-1)
    present = at.padded(np.ones((1, len(samples))))
    space = StateSpace(
        loadings=np.repeat(present[..., None], 2, axis=-1),
        decay=at.padded(decay[None])[:, :, 0],
        variance=np.array([moving, noise]),
        white=np.where(present > 0, 1e-4 * noise, 1.0),
    )
    means_of, _ = smoothed(space, at.padded(swing[None]))
    shift = at.flat(means_of[..., 0]) - swing
    return replace(
        samples,
        conditions=replace(samples.conditions, vertical_load_n=measured + shift),
        instants=replace(samples.instants, vertical_load_n=samples.instants.vertical_load_n + shift),
    )


MOST_ROUNDS = 8
"""Linearisations, each about the last one's explanation; once these swing, halfway to it."""
_STILL = 0.25
"""Change of a cause in its one-sigma, and of the soil in the laboratory's, below which the iteration has converged."""
_FINEST = 0.005


@dataclass(frozen=True)
class Relinearised:
    """Outcome of the iterated linearisation from one start.

    Attributes
    ----------
    starts : tuple of Start
        Of the campaigns.
    best : SetEstimate
        Chosen from `grams`.
    converged : bool
        Whether the last iteration changed nothing.
    chosen_sets : tuple of sets of causes
        The best of each iteration.
    """

    starts: tuple[Start, ...]
    grams: Grams
    campaigns: tuple[CampaignData, ...]
    best: SetEstimate
    converged: bool
    chosen_sets: tuple[tuple[str, ...], ...]


Progress = tuple[SetEstimate, tuple[tuple[str, ...], ...]]
"""Of iterations: the last explanation, and the best set of each; their campaigns are large and need not be held."""


def relinearise(
    starts: Sequence[Start],
    points: Sequence[LinearisationPoint],
    choose: Callable[[Grams, SetEstimate | None], SetEstimate],
    clock: Clock,
    *,
    before: Progress | None = None,
    keep_noise: bool = False,
    most: int = MOST_ROUNDS,
) -> Relinearised:
    """Iterate the linearisation about the explanation, beginning at `points`, until it converges.

    `choose` picks the explanation from cross products, given the one before. `before` is of the iterations that this
    goes on with; `most` counts them, too. With `keep_noise` the noise of the first iteration is taken as it is;
    otherwise it is estimated from the second one on.
    """
    best, earlier = before or (None, ())
    last: SetEstimate | None = None
    share = 1.0
    chosen_sets = list(earlier)
    while True:
        kept = keep_noise or not chosen_sets
        campaigns, step = campaigns_at(starts, points, clock, keep_noise=kept, catch_all=not kept)
        with clock.stage("whitening"):
            grams = joined_grams(campaigns)
        with clock.stage("evidence"):
            found = choose(grams, best)
        converged = best is not None and step == 1.0 and _same(best, found)
        if best is not None and _swings(last, best, found):
            share = 0.5
        last, best = best, found
        chosen_sets.append(best.keys)
        if converged or not step or len(chosen_sets) == most:
            return Relinearised(tuple(starts), grams, campaigns, best, converged, tuple(chosen_sets))
        with clock.stage("smoothing"):
            points = linearisation_points(campaigns, grams, best, share)
        del campaigns, grams  # as large as those that come


STEPS = (1.0, 0.5, 0.25, 0.125, 0.0)
"""Shares of a step that are tried, until no sample loses its answer."""


def campaigns_at(
    starts: Sequence[Start],
    points: Sequence[LinearisationPoint],
    clock: Clock,
    *,
    keep_noise: bool,
    catch_all: bool = True,
) -> tuple[tuple[CampaignData, ...], float]:
    """Linearise campaigns about points, or as near to them as no sample loses its answer, and whiten them.

    The number is the share of the step to the points that keeps every answer. With `keep_noise` the noise of the points
    is taken as it is. `catch_all` is whether to take up the catch-all's shapes: where anything is judged by the
    linearisation.
    """
    samples = [with_likely_load(s.samples, at.noise.values) for s, at in zip(starts, points, strict=True)]
    neutral = {key: e.parameters[i].neutral for s in starts for e, i, key in s.simulation.parameters}
    for step in STEPS:
        tried = [at.shortened(step, neutral) for at in points]
        with clock.stage("linearise"):
            models = [linearise(s.simulation, x, at.point) for s, x, at in zip(starts, samples, tried, strict=True)]
        if not any(at.loses(linear) for at, linear in zip(tried, models, strict=True)):
            break
    each = zip(starts, samples, models, tried, strict=True)
    return tuple(_campaign_data(*parts, clock, keep_noise=keep_noise, catch_all=catch_all) for parts in each), step


def _campaign_data(
    start: Start,
    samples: Samples,
    linear: Linear,
    at: LinearisationPoint,
    clock: Clock,
    *,
    keep_noise: bool,
    catch_all: bool,
) -> CampaignData:
    """Linearise a campaign about a point; see `campaigns_at`."""
    variance, noise = at.speed_variance, at.noise
    with clock.stage("columns"):
        columns = columns_of(start.simulation, samples, linear, variance, catch_all=catch_all)
    if start.noise is None and not keep_noise:
        with clock.stage("noise"):
            blocks = blocks_of(samples, linear, columns, variance, noise.values)
            share = {name: noise.values[name] for name in (OWN_SPEED,) if name in noise.values}
            noise = estimated(blocks, hyper_priors(samples), noise.values)
            noise = replace(noise, values=noise.values | share)
    return CampaignData(start.campaign, samples, start.simulation, linear, columns, noise, variance)


def joined_grams(campaigns: Sequence[CampaignData]) -> Grams:
    """Return the Gram matrices of all campaigns as one."""
    return joined(
        [part_of(data) for data in campaigns],
        [None if data.campaign.of_vehicle else data.grams for data in campaigns],
    )


_MOST_BESIDE = 2
"""Causes of the sets over which a share is judged."""


def _other_shares(campaigns: Sequence[CampaignData]) -> list[float | None] | None:
    """Return the share of the speed's error that belongs next to each campaign; None where all stay."""

    def evidence(grams: Grams) -> float:
        return log_evidence_of_sets(grams, _traceless(grams), _MOST_BESIDE)

    now = [data.noise.values.get(OWN_SPEED) for data in campaigns]
    if APART in now:
        shares = [None if share is None else OWN_SHARES[0] for share in now]
    else:
        shares = most_probable_shares([part_of(data) for data in campaigns], evidence)
    return None if shares == now else shares


def _with_shares(found: Relinearised, shares: Sequence[float | None]) -> Relinearised:
    return replace(
        found,
        grams=replace(found.grams, constants=None),
        campaigns=tuple(
            data if share is None else replace(data, noise=data.noise.with_value(OWN_SPEED, share))
            for data, share in zip(found.campaigns, shares, strict=True)
        ),
    )


def _same(before: SetEstimate, after: SetEstimate) -> bool:
    """Return whether two explanations are equal within their uncertainty."""
    return before.keys == after.keys and bool((np.abs(_change(before, after)) < _STILL).all())


def _swings(first: SetEstimate | None, second: SetEstimate, third: SetEstimate) -> bool:
    """Return whether an explanation goes back: to a set of before the last, or against the last step."""
    if first is None:
        return False
    if second.keys != third.keys:
        return first.keys == third.keys
    return first.keys == second.keys and float(_change(second, third) @ _change(first, second)) < 0.0


def _change(before: SetEstimate, after: SetEstimate) -> FloatArray:
    """Return how far two explanations by the same causes are apart, in their uncertainty, shape (q + c,)."""
    change = np.concatenate([before.soil - after.soil, (before.coefficients - after.coefficients)[list(after.columns)]])
    return np.asarray(change / np.concatenate([np.ones(len(after.soil)), np.maximum(after.sigmas, _FINEST)]))


MOST_TRIED = 4
_ROUNDS = 6


def converged_alternative(
    starts: Sequence[Start],
    moving: Relinearised,
    others: Sequence[tuple[str, ...]],
    choose: Callable[[Grams, SetEstimate | None], SetEstimate],
    clock: Clock,
) -> Relinearised:
    """Return the explanation at which the iteration converges; the one that moves, where there is none.

    `moving` is what did not converge, `others` are the sets of causes that seemed likely. `choose` picks the
    explanation from cross products, given the one before.
    """
    ranked = sorted(
        {keys for keys in others if keys != moving.best.keys}, key=lambda keys: -log_evidence(moving.grams, keys)
    )
    for keys in ranked[:MOST_TRIED]:

        def hold(grams: Grams, _: SetEstimate | None, keys: tuple[str, ...] = keys) -> SetEstimate:
            return estimate(grams, keys)

        points = linearisation_points(moving.campaigns, moving.grams, estimate(moving.grams, keys))
        about = relinearise(starts, points, hold, clock, keep_noise=True, most=_ROUNDS)
        points = linearisation_points(about.campaigns, about.grams, about.best)
        del about
        found = relinearise(starts, points, choose, clock, most=_ROUNDS)
        if found.converged:
            return replace(found, chosen_sets=(*moving.chosen_sets, *found.chosen_sets))
    return moving


def most_probable(found: Sequence[Relinearised]) -> Relinearised:
    """Return the one whose explanation is the most probable, by the samples that all of them answer."""
    each = zip(*(result.campaigns for result in found), strict=True)
    shared = [np.logical_and.reduce([data.columns.present for data in of_one]) for of_one in each]

    def evidence(result: Relinearised) -> float:
        campaigns = [_of_samples(data, kept) for data, kept in zip(result.campaigns, shared, strict=True)]
        return log_evidence(joined_grams(campaigns), result.best.keys)

    return max(found, key=evidence)


def _of_samples(data: CampaignData, kept: BoolArray) -> CampaignData:
    """Return a campaign whitened by some of its measured values only, shape (c, n)."""
    if (kept == data.columns.present).all():
        return data
    columns = replace(data.columns, rows=np.where(kept[..., None], data.columns.rows, 0.0), present=kept)
    return replace(data, columns=columns)


_NOTHING = 1e-8


@dataclass(frozen=True)
class LinearisedCampaign:
    """Linearised and whitened model of one or several campaigns.

    Attributes
    ----------
    grams : Grams
        Of all runs of all campaigns, about the last point.
    campaigns : tuple of CampaignData
        One for each campaign, in their order; runs follow each other in `grams` likewise.
    starts : tuple of Start
        What each campaign's linearisation started from.
    best : SetEstimate
        The most probable set of causes, about which was linearised.
    not_identifiable : mapping family -> why
    excluded : set of str
        Effects (by key) that leave no trace in these data whatever their size; see `best_set`.
    most_causes : int
        Of a set.
    rounds : int
        Linearisations.
    converged : bool
        Whether the last one changed nothing.
    """

    grams: Grams
    campaigns: tuple[CampaignData, ...]
    starts: tuple[Start, ...]
    best: SetEstimate
    not_identifiable: dict[str, Note]
    excluded: frozenset[str]
    most_causes: int
    rounds: int
    converged: bool
    notes: tuple[Note, ...]
    stages_s: dict[str, float]

    def information(self, excess: float) -> Information | None:
        """Return what can be pooled with other campaigns; None for several, whose soils differ, but those of a vehicle.

        `excess` is a factor on the noise's variance.
        """
        if len({data.campaign.ground for data in self.campaigns}) > 1:
            return None
        grams = self.grams.scaled(1.0 / excess)
        return Information(
            soil=grams.soil,
            effects=tuple(c.key for c in grams.causes),
            parameters=tuple(c.parameter for c in grams.causes),
            units=tuple(c.unit for c in grams.causes),
            scales=tuple(c.scale for c in grams.causes),
            neutrals=tuple(c.neutral for c in grams.causes),
            one_sided=tuple(c.one_sided for c in grams.causes),
            matrix=grams.net,
            samples=int(grams.samples.sum()),
            about=self.best.keys,
        )

    def soil_of(self, index: int) -> IndexArray:
        """Return where the soil of a campaign stands among those of all."""
        return soil_places_of(self.campaigns)[index]

    @property
    def linearisation(self) -> Linearisation:
        """How far it came, and by how many samples."""
        used = sum(int(data.columns.present.any(axis=0).sum()) for data in self.campaigns)
        return Linearisation(sum(len(data.samples) for data in self.campaigns), used, self.rounds, self.converged)

    @property
    def rows(self) -> int:
        """How many numbers were measured while driving."""
        return sum(int(data.columns.present.sum()) for data in self.campaigns)

    @property
    def of_vehicles(self) -> bool:
        """Whether wheels of one vehicle are weighed together."""
        return any(data.campaign.of_vehicle for data in self.campaigns)

    @property
    def noises(self) -> tuple[Noise, ...]:
        """The noise model of each campaign."""
        return tuple(data.noise for data in self.campaigns)


@one_thread
def linearise_campaigns(
    campaigns: Sequence[Campaign],
    options: DiagnosisOptions | None = None,
    noises: Sequence[Noise] | None = None,
) -> LinearisedCampaign:
    """Linearise and whiten one or several campaigns about their best explanation.

    Parameters
    ----------
    campaigns : sequence of Campaign
        Causes are shared, soils are not.
    noises : sequence of Noise, optional
        The noise model of each campaign; estimated where it is not given.

    Raises
    ------
    DataError
        A campaign has fewer than 50 usable samples, or neither drawbar pull nor torque.
    """
    options = options or DiagnosisOptions()
    clock, campaigns = Clock(), on_common_blocks(campaigns)
    with clock.stage("samples"):
        starts = [
            begin(c, samples_of(c, options.channels), options.effects, options.reading, noises[i] if noises else None)
            for i, c in enumerate(campaigns)
        ]
    choose = _choice(options.most_causes)
    found = [_from_first(starts, causes, choose, clock) for causes in first_causes(starts)]
    tried = [each.chosen_sets for each in found]
    found = [most_probable(found)]
    if cleaned := without_outliers(found[0].starts, found[0].campaigns, found[0].grams, found[0].best):
        found = [_again(replace(found.pop(), starts=cleaned), choose, clock)]
    for _ in range(_MOST_SHARES):
        shares = _other_shares(found[0].campaigns) if found[0].converged else None
        if shares is None:
            break
        found = [_again(_with_shares(found.pop(), shares), choose, clock)]
    [best_found] = found
    if not best_found.converged:
        sets = tried if best_found.chosen_sets in tried else [best_found.chosen_sets]
        best_found = converged_alternative(best_found.starts, best_found, list(chain(*sets)), choose, clock)
    return LinearisedCampaign(
        grams=best_found.grams,
        campaigns=best_found.campaigns,
        starts=best_found.starts,
        best=best_found.best,
        not_identifiable=not_identifiable_in_any(best_found.starts),
        excluded=_traceless(best_found.grams),
        most_causes=options.most_causes,
        rounds=len(best_found.chosen_sets),
        converged=best_found.converged,
        notes=tuple(note for data in best_found.campaigns for note in notes_of(data, named=len(starts) > 1)),
        stages_s=clock.stages_s,
    )


_MOST_SHARES = 3
"""Times that another share of the speed's error is taken, the first included."""
_NOISE_KNOWN = 2
"""Iterations after which the noise is estimated, and with it which samples are near a cut."""


def _from_first(
    starts: Sequence[Start],
    causes: dict[str, float],
    choose: Callable[[Grams, SetEstimate | None], SetEstimate],
    clock: Clock,
) -> Relinearised:
    """Iterate from the laboratory's soil and some causes; once the noise is known, without samples near the cuts."""
    rough = relinearise(starts, [first_point(s, causes) for s in starts], choose, clock, most=_NOISE_KNOWN)
    points = linearisation_points(rough.campaigns, rough.grams, rough.best)
    before = rough.best, rough.chosen_sets
    del rough  # as large as what comes
    return relinearise(without_near_cuts(starts, points), points, choose, clock, before=before)


def _again(
    found: Relinearised, choose: Callable[[Grams, SetEstimate | None], SetEstimate], clock: Clock
) -> Relinearised:
    """Iterate anew from an explanation, with its samples and noise as they are now."""
    points = linearisation_points(found.campaigns, found.grams, found.best)
    starts, before = found.starts, found.chosen_sets
    del found  # as large as what comes
    again = relinearise(starts, points, choose, clock)
    return replace(again, chosen_sets=(*before, *again.chosen_sets))


def notes_of(data: CampaignData, *, named: bool = False) -> tuple[Note, ...]:
    """Return what the samples and the noise of one campaign tell; `named`: with its name, where there are several."""
    seen = float(np.sqrt(np.mean(swing_seen(data.samples) ** 2)))
    told = noise_notes(data.noise, hyper_priors(data.samples), data.linear.channels, seen)
    if named:
        told = tuple(replace(note, values={**note.values, "campaign": data.campaign.name}) for note in told)
    return (*data.samples.notes, *told)


def _choice(most_causes: int) -> Callable[[Grams, SetEstimate | None], SetEstimate]:
    """Return how the set is chosen about which is linearised: one cause at first, and one more in each iteration.

    From the laboratory's soil it is far to the first point, and of three causes at once some pair of angles fits the
    straight line, and no model behind it.
    """

    def choose(grams: Grams, before: SetEstimate | None) -> SetEstimate:
        held = before.keys if before else ()
        return best_set(grams, _traceless(grams), min(most_causes, len(held) + 1), held or None)

    return choose


def _traceless(grams: Grams) -> frozenset[str]:
    """Return the effects whose columns are zero in every run, and those of all wheels that show at one of them only."""
    power = np.einsum("rii->i", grams.matrices)[grams.cause_columns]
    traced = {c.key for c, x in zip(grams.causes, power, strict=True) if x > _NOTHING}
    alone = {parted(c.key)[0] for c in grams.causes if parted(c.key)[1] and _alike(grams, c.key)}
    return frozenset(c.key for c in grams.causes) - traced | alone


def _alike(grams: Grams, key: str) -> bool:
    """Return whether an effect at one wheel has the columns of that at all of them, but for their length."""
    own, every = (list(grams.columns_of(key)) for key in (key, parted(key)[0]))
    both = np.diag(grams.total)[own] * np.diag(grams.total)[every]
    return bool((both > _NOTHING).any() and (grams.total[own, every] ** 2 >= (1.0 - _NOTHING) * both).all())
