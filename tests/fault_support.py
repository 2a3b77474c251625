"""What tests of sensor faults share: recordings, and what of their channels is found to be faulty."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from daq import BoolArray, Channel, VehicleConfig
from daq.runs import Run, open_runs
from processing import ProcessedRun, RunCode
from processing.pipeline.collection import collect
from processing.pipeline.fault_gate import FaultGate

RECORDINGS = Path(__file__).parents[1] / "recordings"
NODE_NS = 10_000_000
RUNS = [(soil, number) for soil in ("clay", "sandy") for number in range(6)]
LOADS = ("vertical_load", "drawbar_pull")
ROLES = ("ground_speed", "wheel_speed", *LOADS, "driving_torque")


@cache
def recording(soil: str, number: int) -> tuple[Run, dict[str, Channel]]:
    run = open_runs([RECORDINGS / soil])[number]
    return run, {role: one for role, one in run.channels().items() if role in ROLES}


def facts_of(run: ProcessedRun) -> dict[tuple[str, str], dict[str, object]]:
    """Return the values of each note on a sensor fault, by role and kind."""
    notes = [dict(n.values) for n in run.quality.notes if n.code is RunCode.SENSOR_FAULT]
    return {(str(values["role"]), str(values["kind"])): values for values in notes}


def found(channels: dict[str, Channel], config: VehicleConfig) -> tuple[dict[str, BoolArray], set[tuple[str, str]]]:
    """Return which samples of each channel are excluded as faulty, and role and kind of each fault."""
    gate = FaultGate(NODE_NS, config)
    [sound] = gate.without_faults([channels])
    samples = collect([{role: sound[role] for role in ("ground_speed", "wheel_speed") if role in sound}], NODE_NS)
    bad = {role: ~np.isin(one.time_ns, sound[role].time_ns) for role, one in channels.items()}
    if "ground_speed" in samples:
        faulty_ns = gate.without_faulty_ground_speed(samples)["ground_speed"].faulty_ns
        bad["ground_speed"] |= np.isin(channels["ground_speed"].time_ns, faulty_ns)
    faults = {(str(n.values["role"]), str(n.values["kind"])) for n in gate.notes()}
    return bad, faults
