"""Simulated campaigns that tests of the diagnosis share."""

from __future__ import annotations

from functools import lru_cache

from model.diagnosis.campaign import Campaign
from model.soil_prior import prior_of
from processing.pipeline import process
from wheelsoil.virtual_campaign import simulated_roles
from wheelsoil.virtual_options import SimulationOptions, parse_effect


@lru_cache(maxsize=8)
def simulated_campaign(soil: str = "clay", seed: int = 0, runs: int = 6, effect: str = "") -> Campaign:
    """Return a campaign of 40 s runs, with an effect as ``--effect`` takes it, or with none."""
    options = SimulationOptions(
        soil=soil, seed=seed, runs=runs, draw_soil=True, effects=dict([parse_effect(effect)] if effect else [])
    )
    processed = tuple(process(*simulated_roles(options, index)) for index in range(runs))
    laboratory = options.laboratory_soil
    return Campaign(f"{soil} {seed}", processed, options.wheel, laboratory, prior_of(laboratory, options.terrain))
