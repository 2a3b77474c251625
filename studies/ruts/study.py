"""How often ten rut readings separate slip sinkage from a shifted stress peak.

``PYTHONPATH=tests:. python studies/ruts/study.py [campaigns] [cause]``. Campaigns on clay are those of the independent
simulator (tests/blind). Hidden is slip sinkage of H = 0.03 m, or a shifted stress peak (cause stress_peak_shift). Each
is diagnosed from forces alone, then with ten readings of the rut's depth, each to 5 mm, at slips from 0.05 to 0.8,
dealt to the six runs in turn. Finished campaigns are in CAUSE.json; a second start continues there.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from blind.driving import RATE_HZ
from blind.engine import OPTIONS
from blind.field import FieldDay, field_day, physics_of
from blind.folders import run_info, terrain_config, vehicle_config
from blind.sensors import measured
from blind.standing import on_tilted_ground
from blind.wheel import Care, readings

from daq import FloatArray, RutReading
from model.diagnosis import Campaign, Diagnosis, DiagnosisOptions, diagnose
from model.wheel_soil import Wheel, prior_of, soil_from_terrain
from processing.pipeline import process

HIDDEN = {"slip_sinkage": ("vasilev", 0.03), "stress_peak_shift": ("stress_peak_shift", 0.2)}
SLIPS = np.linspace(0.05, 0.8, 10)
SIGMA_M = 0.005
REBOUND_M, REBOUND_SIGMA_M = 0.005, 0.003
_DRIVEN_MPS = 0.2
_STREAM = 23


def campaigns(hidden: tuple[str, float], seed: int) -> tuple[Campaign, Campaign]:
    """Return one campaign from forces alone, and with rut readings."""
    day = field_day("clay", (seed, _STREAM))
    rng = np.random.default_rng((seed, _STREAM, 1))
    rebound = max(rng.normal(REBOUND_M, REBOUND_SIGMA_M), 0.0)
    vehicle, terrain = vehicle_config(day), terrain_config(day.laboratory)
    without, with_ruts = [], []
    for index, plan in enumerate(day.plans):
        channels, sinkage = _driven(day, index, hidden)
        info = run_info(plan)
        read = _rut(day, index, sinkage - rebound, rng)
        without.append(process(channels, vehicle, info, OPTIONS))
        with_ruts.append(process(channels, vehicle, info.model_copy(update={"rut": read}), OPTIONS))
    assert vehicle.wheel is not None
    wheel = Wheel(vehicle.wheel.radius_m, vehicle.wheel.width_m)
    soil = soil_from_terrain(terrain)
    of_all = (wheel, soil, prior_of(soil, terrain))
    mass = vehicle.wheel.outboard_mass_kg
    return (
        Campaign("forces", tuple(without), *of_all, outboard_mass_kg=mass),
        Campaign("ruts", tuple(with_ruts), *of_all, outboard_mass_kg=mass),
    )


def _driven(day: FieldDay, index: int, hidden: tuple[str, float]) -> tuple[dict[str, Any], FloatArray]:
    """Return the channels of a run as `blind.field.driven` makes them, and its sinkage."""
    patches, sensing = (
        np.random.default_rng(np.random.SeedSequence(day.seed, spawn_key=(index, which))) for which in (0, 1)
    )
    moments, plan = day.moments[index], day.plans[index]
    standing = np.random.default_rng((*day.seed, index, 2))
    own, rut_n = day.world.vehicle, day.rut_n[plan.load_n]
    physics = on_tilted_ground(physics_of([hidden]), day.stance, plan, own, rut_n, standing)
    patchy = day.patchiness.along(moments.distance_m, patches)
    soil = day.ground.changed(day.scatter[index]).changed(patchy)
    reading, sinkage = readings(physics, soil, moments, Care(every=4))
    return measured(day.suite, plan, day.motions[index], reading, day.along_m[index], sensing), np.ravel(sinkage)


def _rut(day: FieldDay, index: int, depth: FloatArray, rng: np.random.Generator) -> tuple[RutReading, ...]:
    moments = day.moments[index]
    slip = np.where(moments.speed > _DRIVEN_MPS, moments.slip, np.nan)
    rows = [int(np.nanargmin(np.abs(slip - target))) for target in SLIPS[index :: len(day.plans)]]
    return tuple(
        RutReading(
            depth_m=max(float(depth[row] + SIGMA_M * rng.standard_normal()), 0.0), sigma_m=SIGMA_M, time_s=row / RATE_HZ
        )
        for row in rows
    )


def _said(found: Diagnosis) -> dict[str, Any]:
    return {
        "verdict": found.verdict,
        "causes": [cause.name for cause in found.causes],
        "probabilities": {c.name: round(float(c.probability), 4) for c in found.causes},
    }


def _lines(done: dict[str, Any]) -> str:
    """Return one line a campaign."""
    return "{\n" + ",\n".join(f'"{seed}": {json.dumps(said)}' for seed, said in done.items()) + "\n}\n"


def main() -> None:
    """Diagnose campaigns 0 to n - 1 that are not in the results yet."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    cause = sys.argv[2] if len(sys.argv) > 2 else "slip_sinkage"
    results = Path(__file__).with_name(f"{cause}.json")
    done = json.loads(results.read_text()) if results.is_file() else {}
    for seed in range(count):
        if str(seed) in done:
            continue
        forces, ruts = (_said(diagnose([campaign], DiagnosisOptions())) for campaign in campaigns(HIDDEN[cause], seed))
        done[str(seed)] = {"forces": forces, "ruts": ruts}
        results.write_text(_lines(done))
        print(seed, forces["verdict"], forces["causes"], ruts["verdict"], ruts["causes"], flush=True)


if __name__ == "__main__":
    main()
