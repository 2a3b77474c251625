"""Simulated runs that several tests share."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from daq import RunInfo
from model.effects import EFFECTS
from model.simulation import TRUTH_QUADRATURE, VirtualRun, VirtualSetup, virtual_run
from model.wheel_soil import SOILS, Wheel, WheelSoilModel

WHEEL = Wheel(0.47, 0.318)
LYASKO = {"clay": {"m1": 0.1, "m2": 0.05}, "sandy": {"m1": 0.6, "m2": 0.03}}
START_NS = 1_780_000_000_000_000_000


def lyasko_model(soil: str = "clay") -> WheelSoilModel:
    return WheelSoilModel(WHEEL, SOILS[soil], (EFFECTS["lyasko"],), "balanced", TRUTH_QUADRATURE)


@lru_cache(maxsize=16)
def simulated(setup: VirtualSetup, seed: int = 0, soil: str = "clay", info: RunInfo | None = None) -> VirtualRun:
    return virtual_run(
        setup,
        lyasko_model(soil),
        LYASKO[soil],
        info or RunInfo(id="run"),
        start_ns=START_NS,
        elapsed_s=0.0,
        rng=np.random.default_rng(seed),
        ring=np.random.default_rng(99),
    )
