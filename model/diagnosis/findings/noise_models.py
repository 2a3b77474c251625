"""Other models of the noise than the most probable one: what instruments and soil can have, and what lies around it.

The most probable hyper-parameters are those of the saturated model, in which every shape may be large. Where nothing
unlisted acts, slow noise and the soil within a run may well be larger: a shape is worth less then. Whether something
unlisted acts is weighed over several models where it is in doubt, each by its prior density and its own evidence.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from math import exp

import numpy as np

from daq import REACTIONS
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.joining import joined, part_of
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.noise import Noise, hyper_priors, named
from model.diagnosis.time_series.start import CampaignData

MARGIN = 1.5
"""Times the stated one-sigma."""
USUAL_MPS = 0.05
"""One-sigma that any receiver may have: data sheets say .03 (0.1 km/h); slow drift comes on top."""
LOG_SIGMAS = 2.0
"""One-sigmas of its logarithm by which the soil's scatter in a run may be larger than thought."""
_SPEED = ("speed_noise_mps", "speed_white_mps")
_IN_RUN = ("stiffness_in_run", "friction_in_run")
STEP = 1.5
"""One-sigmas of the logarithm of each deviation from the most probable model to those around it."""
_DIRECTIONS = ([named(channel, "slow_noise") for channel in REACTIONS], _IN_RUN)
"""Deviations that grow or fall together."""


def plausible_grams(linearised: LinearisedCampaign) -> Grams:
    """Return the Gram matrices under a noise that sensors and soil can have; those of the campaigns where it is."""
    return _grams(linearised, [_plausible(data, data.noise) for data in linearised.campaigns])


def grams_around(linearised: LinearisedCampaign) -> Iterator[tuple[Grams, float]]:
    """Yield the Gram matrices under several plausible models of the noise, the most probable one first.

    With the logarithm of each model's prior density.
    """
    at_centre = [data.noise for data in linearised.campaigns]
    models = [at_centre]
    for names in _DIRECTIONS:
        models += [[_moved(noise, names, step) for noise in at_centre] for step in (STEP, -STEP)]
    for model in models:
        noises = [_plausible(data, noise) for data, noise in zip(linearised.campaigns, model, strict=True)]
        log_prior = sum(_log_prior(data, noise) for data, noise in zip(linearised.campaigns, noises, strict=True))
        yield _grams(linearised, noises), log_prior


def _moved(noise: Noise, names: Collection[str], step: float) -> Noise:
    own = [name for name in noise.log_sigmas if name in names]
    return replace(noise, values=noise.values | {n: noise.values[n] * exp(step * noise.log_sigmas[n]) for n in own})


def _log_prior(data: CampaignData, noise: Noise) -> float:
    priors = hyper_priors(data.samples)
    off = [np.log(noise.values[name] / prior.centre) / prior.log_sigma for name, prior in priors.items()]
    return -0.5 * float(np.square(off).sum())


def _plausible(data: CampaignData, noise: Noise) -> Noise:
    priors = hyper_priors(data.samples)
    most = {name: max(MARGIN * priors[name].centre, USUAL_MPS) for name in _SPEED}
    for name in _IN_RUN:
        most[name] = priors[name].centre * exp(LOG_SIGMAS * priors[name].log_sigma)
    if all(noise.values.get(name, 0.0) <= largest for name, largest in most.items()):
        return noise
    return replace(noise, values={k: min(x, most.get(k, x)) for k, x in noise.values.items()})


def _grams(linearised: LinearisedCampaign, noises: Sequence[Noise]) -> Grams:
    """Return the Gram matrices under some noises; those of the campaigns where they are theirs."""
    if all(noise is data.noise for noise, data in zip(noises, linearised.campaigns, strict=True)):
        return linearised.grams
    each = zip(linearised.campaigns, noises, strict=True)
    return joined([part_of(replace(data, noise=noise)) for data, noise in each])
