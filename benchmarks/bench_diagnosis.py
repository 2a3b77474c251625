"""The diagnosis of a campaign: its evidence stage, the whole command on one core, and how its cost grows."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.row import Row, median_seconds
from model.diagnosis.campaign import Campaign, DiagnosisOptions
from model.diagnosis.look import look
from model.effects import EFFECTS
from model.soil_prior import prior_of
from processing.pipeline import process
from wheelsoil.virtual_campaign import simulated_roles
from wheelsoil.virtual_options import SimulationOptions, parse_effect

EFFECT = "vasilev:H_m=0.02"
ALL = DiagnosisOptions(effects=tuple(key for key, effect in EFFECTS.items() if effect.reading == "any"))


def rows() -> list[Row]:
    """Measure on simulated campaigns with slip sinkage."""
    return [_evidence(), _whole_command(), _long_runs()]


def _campaign(runs: int, duration_s: float) -> Campaign:
    options = SimulationOptions(
        soil="clay", runs=runs, duration_s=duration_s, seed=1, draw_soil=True, effects=dict([parse_effect(EFFECT)])
    )
    processed = tuple(process(*simulated_roles(options, index)) for index in range(runs))
    soil = options.laboratory_soil
    return Campaign("clay", processed, options.wheel, soil, prior_of(soil, options.terrain))


def _evidence() -> Row:
    campaign = _campaign(6, 40.0)
    noises = look([campaign], ALL).noises
    seconds = median_seconds(lambda: look([campaign], ALL, noises))
    stages = look([campaign], ALL, noises).stages_s
    told = ", ".join(f"{name} {1e3 * took:.0f} ms" for name, took in stages.items())
    return Row(
        "evidence of every set of causes, 6 runs of 40 s, noise given",
        f"{seconds:.2f} s",
        told,
        "",
        "<= 1 s",
        seconds <= 1,
    )


def _whole_command() -> Row:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "clay"
        _run("simulate", "--soil", "clay", "--runs", "6", "--duration", "40", "--effect", EFFECT, "-o", str(folder))
        took = median_seconds(lambda: _run("diagnose", str(folder), "--json", cores={0}), 3)
    return Row("wheelsoil diagnose, recordings to verdict, one core", f"{took:.1f} s", "", "", "<= 15 s", took <= 15)


def _run(*arguments: str, cores: set[int] | None = None) -> None:
    subprocess.run(
        [str(Path(sys.executable).with_name("wheelsoil")), *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=(lambda: os.sched_setaffinity(0, cores)) if cores else None,
    )


def _long_runs() -> Row:
    took = []
    for duration_s in (300.0, 600.0):
        campaign = _campaign(2, duration_s)
        noises = look([campaign], ALL).noises
        start = time.process_time()
        found = look([campaign], ALL, noises)
        took.append((time.process_time() - start) / found.rounds)
    return Row(
        "the same, a round of 2 runs of 10 min",
        f"{took[1]:.2f} s",
        f"of 5 min: {took[0]:.2f} s",
        f"{took[1] / took[0]:.2f}x",
        "linear: <= 2.3x",
        took[1] <= 2.3 * took[0],
    )
