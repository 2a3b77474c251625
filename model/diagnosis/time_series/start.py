"""What a look starts from: samples, the simulation under test, and why a campaign may be unfit.

One campaign as it is looked at, and the clock of the stages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from daq import REACTIONS, DataError, Fault
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.tellable import cannot_tell, considered
from model.diagnosis.time_series.columns import Columns
from model.diagnosis.time_series.linearise import Linear, Simulation, soil_space
from model.diagnosis.time_series.noise import Noise
from model.diagnosis.time_series.samples import FEWEST, Samples, samples_of
from model.diagnosis.time_series.whitening import RunGrams

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """One campaign as it was looked at.

    Attributes
    ----------
    campaign : Campaign
    samples : Samples
        With the likeliest load, see `model.diagnosis.time_series.looks`.
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


LATENCY = "speed_latency"
_NOTABLE_DELAY_S = 0.06
"""Delay between the speeds from which on it is tried as a start."""


@dataclass(frozen=True)
class Start:
    """A campaign before it was looked at."""

    campaign: Campaign
    samples: Samples
    simulation: Simulation
    noise: Noise | None


def begin(campaign: Campaign, options: DiagnosisOptions, noise: Noise | None) -> Start:
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
    return Start(campaign, samples, simulation, noise)


def unfit(campaign: Campaign, samples: Samples) -> Fault | None:
    """Return why a campaign cannot be looked at; None where it can.

    Parameters
    ----------
    campaign : Campaign
    samples : Samples
        Of it.
    """
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
    left_out = ", ".join(f"{why.replace('_', ' ')} {n}" for why, n in samples.left_out.items() if n)
    return Fault(
        "too few usable samples for a diagnosis",
        campaign.name,
        found=f"{len(samples)} samples of {samples.block_s:g} s (left out: {left_out or 'nothing'})",
        expected=f"at least {FEWEST}",
        next_step="drive longer, with more slip, above 0.5 m/s",
    )


def delays_s(starts: Sequence[Start]) -> tuple[float, ...]:
    """Return the delays of ground speed to start from: none, and what the two speeds say of it themselves.

    Near s = 0 forces are so steep in the ground speed that a wrong delay confirms itself once it is linearised about;
    and from none a large one is not found.
    """
    known = all(any(e.key() == LATENCY for e in s.simulation.effects) for s in starts)
    seen = [run.quality.residual_latency_s for s in starts for run in s.campaign.runs]
    seen = [delay for delay in seen if np.isfinite(delay)]
    middle = float(np.median(seen)) if seen else 0.0
    return (0.0, middle) if known and abs(middle) > _NOTABLE_DELAY_S else (0.0,)


def never_told(starts: Sequence[Start]) -> dict[str, str]:
    """Return what no campaign can tell."""
    each = [cannot_tell(s.campaign, s.samples, s.simulation.effects) for s in starts]
    shared = set.intersection(*(set(found) for found in each)) if each else set()
    return {family: why for family, why in each[0].items() if family in shared} if each else {}
