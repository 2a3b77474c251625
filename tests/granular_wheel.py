"""A wheel in granular ground by resistive force theory, and campaigns that drive it: physics that Wong's model lacks.

Every piece of the rim that moves into the ground is pushed back by a stress that grows with its depth, and by nothing
else than its inclination and direction of motion. There is no pressure-sinkage law and no shear displacement.

Source: Li, Zhang & Goldman (2013), Science 339:1408, tab. S3 (generic coefficients).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from diagnosis_support import LEVEL

from benchmarks.recovery import processed_campaign
from daq import FloatArray
from model.diagnosis import Campaign
from model.simulation import VirtualSetup
from model.wheel_soil import prior_of
from processing import ProcessedRun
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import simulated_run

_ARCS = 60
_EVERY = 10
"""Of the true history's samples, between which the forces go straight."""


def stresses(beta: FloatArray, gamma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the stress against the motion and upwards per depth and scale; of a surface that rises ahead by beta."""
    back = gamma > np.pi / 2
    beta, gamma, sign = np.where(back, -beta, beta), np.where(back, np.pi - gamma, gamma), np.where(back, -1.0, 1.0)
    up = 0.206 + 0.169 * np.cos(2 * beta) + 0.358 * np.sin(gamma)
    up += 0.212 * np.sin(2 * beta + gamma) + 0.055 * np.sin(gamma - 2 * beta)
    along = -0.124 * np.cos(2 * beta + gamma) + 0.253 * np.cos(gamma) + 0.007 * np.cos(gamma - 2 * beta)
    along += 0.088 * np.sin(2 * beta)
    return sign * along, up


def forces(
    slip: FloatArray, load_n: FloatArray, radius_m: float, width_m: float, scale_n_m3: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return drawbar pull, torque and sinkage of a driven or braked wheel; slip in the convention of both branches."""
    ratio = np.where(slip >= 0, 1.0 - slip, 1.0 / (1.0 + np.minimum(slip, 0.0)))[:, None]
    low, high = np.full(len(slip), 1e-3), np.full(len(slip), 1.5)
    place = (np.arange(_ARCS) + 0.5) / _ARCS

    def sums(entry: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        theta = entry[:, None] * place
        gamma = np.arctan2(np.sin(theta), ratio - np.cos(theta))
        along, up = stresses(theta, gamma)
        share = scale_n_m3 * width_m * radius_m**2 * (np.cos(theta) - np.cos(entry)[:, None]) * entry[:, None] / _ARCS
        pull, lift = -(along * share), up * share
        torque = radius_m * (pull * np.cos(theta) + lift * np.sin(theta))
        return lift.sum(axis=1), pull.sum(axis=1), torque.sum(axis=1)

    for _ in range(40):
        entry = 0.5 * (low + high)
        less = sums(entry)[0] < load_n
        low, high = np.where(less, entry, low), np.where(less, high, entry)
    _, pull, torque = sums(entry)
    return pull, torque, radius_m * (1.0 - np.cos(entry))


def _driven(seed: int, runs: int, duration_s: float) -> SimulationOptions:
    return SimulationOptions(soil="sandy", seed=seed, runs=runs, duration_s=duration_s, **LEVEL)


@lru_cache(maxsize=2)
def _granular_runs(seed: int, runs: int, duration_s: float, scale_n_m3: float) -> tuple[ProcessedRun, ...]:
    options = _driven(seed, runs, duration_s)
    late = VirtualSetup().clock
    wheel, found = options.wheel, []
    for index, run in enumerate(processed_campaign(options)):
        virtual = simulated_run(options, index)
        truth, few = virtual.truth, slice(None, None, _EVERY)
        rolls = np.abs(truth.ground_speed_mps[few]) > 0.05
        pull, torque, _ = forces(truth.slip[few], truth.vertical_load_n[few], wheel.radius_m, wheel.width_m, scale_n_m3)
        at = run.time_s + (run.start_ns - virtual.start_ns) * 1e-9
        at = at - late.offset_s - index * 600.0 * late.drift_ppm * 1e-6
        more = [
            np.interp(at, truth.time_s[few], np.where(rolls, x - y[few], 0.0))
            for x, y in ((pull, truth.drawbar_pull_n), (torque, truth.driving_torque_nm))
        ]
        pulls, torques = run.drawbar_pull_n + more[0], run.driving_torque_nm + more[1]
        found.append(replace(run, drawbar_pull_n=pulls, driving_torque_nm=torques))
    return tuple(found)


@lru_cache(maxsize=4)
def granular_campaign(
    seed: int = 0, runs: int = 3, duration_s: float = 15.0, scale_n_m3: float = 1e6, spread: float = 1.0
) -> Campaign:
    """Return runs on granular ground, which the laboratory takes for the sandy soil, each parameter to `spread`."""
    options = _driven(seed, runs, duration_s)
    soil = options.laboratory_soil
    prior = prior_of(soil)
    wide = replace(prior, covariance=np.diag((spread * prior.mean) ** 2))
    return Campaign("granular", _granular_runs(seed, runs, duration_s, scale_n_m3), options.wheel, soil, wide)
