"""Simulated campaigns that tests of the diagnosis share."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from kept_runs import kept

from model.diagnosis import Campaign, DiagnosisOptions, samples_of
from model.diagnosis.time_series.linearise import Linear, Point, Simulation, linearise, soil_space
from model.diagnosis.time_series.samples import Samples
from model.simulation import VirtualSetup
from model.simulation.transducer import ColouredNoise
from model.wheel_soil import prior_of
from processing import ProcessedRun
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, parse_effect, simulated_roles
from wheelsoil.simulation.campaign import simulated_run

LEVEL: Any = {"tilt_deg": 0.0, "brakes": "released"}
"""Of `SimulationOptions`: every standstill shows the zeros exactly."""


def _options(soil: str, seed: int, effect: str) -> SimulationOptions:
    effects = dict([parse_effect(effect)] if effect else [])
    return SimulationOptions(soil=soil, seed=seed, draw_soil=True, **LEVEL, effects=effects)


@lru_cache(maxsize=24)
def _run(soil: str, seed: int, effect: str, index: int) -> ProcessedRun:
    """Return a run, which does not depend on how many others there are."""
    name = f"40 s: {soil}, {seed}, {effect}, {index}"
    return kept(name, lambda: process(*simulated_roles(_options(soil, seed, effect), index)))


@lru_cache(maxsize=12)
def simulated_campaign(soil: str = "clay", seed: int = 0, runs: int = 6, effect: str = "") -> Campaign:
    """Return a campaign of 40 s runs, with an effect as ``--effect`` takes it, or with none."""
    options = _options(soil, seed, effect)
    laboratory = options.laboratory_soil
    driven = tuple(_run(soil, seed, effect, index) for index in range(runs))
    return Campaign(f"{soil} {seed}", driven, options.wheel, laboratory, prior_of(laboratory, options.terrain))


def linearised(runs: int) -> tuple[Simulation, Samples, Linear]:
    """Return every fourth sample of a campaign on clay, and Wong's model on the laboratory's soil about it."""
    campaign = simulated_campaign(runs=runs)
    samples = samples_of(campaign, DiagnosisOptions().channels)
    samples = samples[np.arange(len(samples)) % 4 == 0]
    simulation = Simulation(campaign.wheel, campaign.soil, soil_space(campaign.soil_prior), (), "balanced")
    return simulation, samples, at_speed(simulation, samples, 0.0)


def at_speed(simulation: Simulation, samples: Samples, offset_mps: float) -> Linear:
    """Return a model about samples whose ground speed is higher by an offset."""
    point = Point(np.zeros(len(simulation.space)), {}, np.full(len(samples), offset_mps))
    return linearise(simulation, samples, point)


def with_sinkage(campaign: Campaign, effect: str = "", sigma_m: float = 0.003) -> Campaign:
    """Return a campaign of `simulated_campaign` with a sinkage sensor: the truth and coloured noise."""
    soil, seed = campaign.name.split()
    options = _options(soil, int(seed), effect)
    runs = []
    for index, run in enumerate(campaign.runs):
        virtual = simulated_run(options, index)
        late_s = VirtualSetup().clock.offset_s + index * 600.0 * VirtualSetup().clock.drift_ppm * 1e-6
        at = run.time_s + (run.start_ns - virtual.start_ns) * 1e-9 - late_s
        noise = ColouredNoise(run.rate_hz, sigma_m, 0.3, np.random.default_rng(index)).next(len(run))
        sinkage = np.interp(at, virtual.truth.time_s, virtual.truth.sinkage_m) + noise
        runs.append(replace(run, sinkage_m=sinkage, sinkage_sigma_m=np.full(len(run), sigma_m)))
    return replace(campaign, runs=tuple(runs))
