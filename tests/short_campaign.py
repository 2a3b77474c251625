"""A short simulated campaign with its noise model given: quick to look at."""

from __future__ import annotations

from functools import lru_cache

from diagnosis_support import LEVEL
from kept_runs import kept

from benchmarks.recovery import processed_campaign
from model.diagnosis import Campaign, DiagnosisOptions, samples_of
from model.diagnosis.time_series import linearise_campaigns
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.noise import Noise, hyper_priors
from model.wheel_soil import prior_of
from wheelsoil.simulation import SimulationOptions, parse_effect


@lru_cache(maxsize=12)
def driven(effect: str = "", soil: str = "clay", runs: int = 4, seed: int = 3) -> Campaign:
    """Return runs of 20 s at three loads, every second one back, with effects as ``--effect`` takes them."""
    effects = dict(map(parse_effect, effect.split()))
    options = SimulationOptions(soil=soil, runs=runs, duration_s=20.0, seed=seed, effects=effects, **LEVEL)
    simulated = kept(f"20 s: {soil}, {seed}, {effect}, {runs}", lambda: processed_campaign(options))
    return Campaign(soil, simulated, options.wheel, options.laboratory_soil, prior_of(options.laboratory_soil))


def noise_of(campaign: Campaign) -> Noise:
    """Return the noise as it is thought of beforehand."""
    found = hyper_priors(samples_of(campaign))
    return Noise({n: b.centre for n, b in found.items()}, {n: 0.3 * b.log_sigma for n, b in found.items()})


_LOOKED: dict[tuple[int, tuple[str, ...]], tuple[Campaign, LinearisedCampaign]] = {}
_MOST_KEPT = 16


def looked(campaign: Campaign, *effects: str) -> LinearisedCampaign:
    """Look with a given noise model; of the same campaign, as `driven` keeps it, once."""
    key = (id(campaign), effects)  # the campaign is kept beside: no other one has its id
    if key not in _LOOKED:
        if len(_LOOKED) == _MOST_KEPT:
            _LOOKED.clear()
        found = linearise_campaigns([campaign], DiagnosisOptions(effects=effects), [noise_of(campaign)])
        _LOOKED[key] = campaign, found
    return _LOOKED[key][1]
