"""Start and result of the linearisation of one campaign, and why a campaign may be unfit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from daq import REACTIONS, DataError, Fault, FloatArray, IndexArray, Note
from model.diagnosis.core.campaign import Campaign, Coverage, considered, not_identifiable
from model.diagnosis.time_series.columns import Columns, soil_places
from model.diagnosis.time_series.linearise import Linear, Simulation, soil_space
from model.diagnosis.time_series.noise import Noise
from model.diagnosis.time_series.samples import FEWEST, Samples, coverage_of
from model.diagnosis.time_series.whitening import RunGrams, run_grams
from model.effects.catalogue import EFFECTS, parted
from model.notes import LackCode
from model.wheel_soil.wheel_soil_model import Reading


@dataclass(frozen=True)
class CampaignData:
    """Linearised data of one campaign and what whitens them.

    Attributes
    ----------
    samples : Samples
        With the most probable load, see `model.diagnosis.time_series.linearised_campaign`.
    linear : Linear
        About the last point.
    speed_variance : array, shape (n,)
        Of what is left of the ground speed's error about the point.
    """

    campaign: Campaign
    samples: Samples
    simulation: Simulation
    linear: Linear
    columns: Columns
    noise: Noise
    speed_variance: FloatArray

    @cached_property
    def grams(self) -> RunGrams:
        """Gram matrices of this campaign alone; of a wheel of a vehicle only its outliers need them."""
        return run_grams(self.samples, self.linear, self.columns, self.noise.values, self.speed_variance)


def soil_places_of(campaigns: Sequence[CampaignData]) -> tuple[IndexArray, ...]:
    """Return where the soil of each campaign stands among those of all."""
    return soil_places([(data.campaign.of_vehicle, data.columns.soil) for data in campaigns])


@dataclass(frozen=True)
class Start:
    """A campaign before it is linearised."""

    campaign: Campaign
    samples: Samples
    simulation: Simulation
    noise: Noise | None


def begin(campaign: Campaign, samples: Samples, effects: Sequence[str], reading: Reading, noise: Noise | None) -> Start:
    """Return what the linearisation of a campaign starts from.

    The keys are of the effects to consider. `DataError` where the samples do not suffice (`unfit`), or no run shows by
    its sensors what was chosen.
    """
    coverage = coverage_of(campaign, samples)
    fault = unfit(campaign, samples) or _unseen(campaign, coverage, effects)
    if fault:
        raise DataError(fault)
    in_runs = tuple(key for key in effects if not EFFECTS[key].of_tables) or effects
    simulation = Simulation(
        campaign.wheel,
        campaign.soil,
        soil_space(campaign.soil_prior),
        considered(coverage, in_runs, reading, campaign.of_vehicle),
        reading,
        campaign.runs[0].rolling_radius_m,
    )
    return Start(campaign, samples, simulation, noise)


def _unseen(campaign: Campaign, coverage: Coverage, effects: Sequence[str]) -> Fault | None:
    """Return which roles all the chosen effects would need; None where one is a hypothesis without."""
    lacking = [[role for role in EFFECTS[key].needs.roles if role not in coverage.roles] for key in effects]
    if not lacking or not all(lacking):
        return None
    return Fault(
        f"{', '.join(effects)} can only be considered where every run has {', '.join(dict.fromkeys(chain(*lacking)))}",
        campaign.name,
        next_step="name its signal under [signals] of vehicle.toml, or choose other --effects",
    )


def unfit(campaign: Campaign, samples: Samples) -> Fault | None:
    """Return why a campaign cannot be diagnosed; None where it can."""
    if len(samples) < FEWEST:
        return _too_few(campaign, samples)
    if samples.measured.keys() & REACTIONS:
        return None
    there = [
        channel.name
        for channel in REACTIONS.values()
        if any(np.isfinite(getattr(run, channel.field)).any() for run in campaign.runs)
    ]
    if there:
        return Fault(
            f"{' and '.join(there)} {'was' if len(there) == 1 else 'were'} measured and not looked at",
            campaign.name,
            next_step="take dp or t into --channels",
        )
    return Fault(
        "neither drawbar pull nor torque was measured",
        campaign.name,
        next_step="name their signals under [signals] of vehicle.toml",
    )


def _too_few(campaign: Campaign, samples: Samples) -> Fault:
    excluded = ", ".join(f"{why.replace('_', ' ')} {n}" for why, n in samples.excluded.items() if n)
    return Fault(
        "too few usable samples for a diagnosis",
        campaign.name,
        found=f"{len(samples)} samples of {samples.block_s:g} s (excluded: {excluded or 'nothing'})",
        expected=f"at least {FEWEST}",
        next_step="drive longer, with more slip, above 0.5 m/s",
    )


def first_causes(starts: Sequence[Start]) -> tuple[dict[str, float], ...]:
    """Return the values of causes to start from: none, and for each effect that the runs' quality estimates that one.

    A late ground speed is one: near s = 0 forces are so steep in it that a wrong delay confirms itself once it is
    linearised about, and from none a large one is not found.
    """
    found: list[dict[str, float]] = [{}]
    for effect in starts[0].simulation.effects if starts else ():
        if effect.first_estimate is None or not all(effect in s.simulation.effects for s in starts):
            continue
        estimates = [getattr(run.quality, effect.first_estimate.quality) for s in starts for run in s.campaign.runs]
        known = [value for value in estimates if np.isfinite(value)]
        middle = float(np.median(known)) if known else 0.0
        if abs(middle) > effect.first_estimate.notable:
            found.append(effect.keyed({effect.parameters[0].name: middle}))
    return tuple(found)


def not_identifiable_in_any(starts: Sequence[Start]) -> dict[str, Note]:
    """Return what is not identifiable in any campaign; of what may act at one wheel alone, in any of that wheel."""
    passages: dict[str, set[int]] = {}
    for start in starts:
        if vehicle := start.campaign.of_vehicle:
            passages.setdefault(vehicle.campaign, set()).update(run.passage for run in start.campaign.runs)
    each = [_not_identifiable(start, passages) for start in starts]
    found = _in_all(each)
    wheels = dict.fromkeys(start.campaign.of_vehicle.wheel for start in starts if start.campaign.of_vehicle)
    for wheel in wheels:
        own = [i for i, s in enumerate(starts) if s.campaign.of_vehicle and s.campaign.of_vehicle.wheel == wheel]
        alone = {parted(e.name)[0]: e.name for i in own for e in starts[i].simulation.effects if parted(e.name)[1]}
        found |= {alone[family]: why for family, why in _in_all([each[i] for i in own]).items() if family in alone}
    return found


def _not_identifiable(start: Start, passages: Mapping[str, set[int]]) -> dict[str, Note]:
    """Return what one campaign does not identify; the axles of a vehicle are several passes."""
    coverage, vehicle = coverage_of(start.campaign, start.samples), start.campaign.of_vehicle
    several = coverage.several_passes or bool(vehicle and len(passages[vehicle.campaign]) > 1)
    return not_identifiable(replace(coverage, several_passes=several))


def _in_all(each: Sequence[dict[str, Note]]) -> dict[str, Note]:
    """Return what all have, with the first reason that is not the want of a channel."""
    shared = [family for family in each[0] if all(family in found for found in each)] if each else []
    reasons = {family: [found[family] for found in each] for family in shared}
    return {
        family: next((why for why in own if why.code is not LackCode.CHANNEL_MISSING), own[0])
        for family, own in reasons.items()
    }
