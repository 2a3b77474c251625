"""The diagnosis of a campaign: its evidence stage, the whole command on one core, and how its cost grows."""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from benchmarks.recovery import processed_campaign
from benchmarks.table import Row, at_most, judged, times, with_verdict
from benchmarks.timing import diagnose_cost, median_cpu_seconds, wheelsoil_cost
from model.diagnosis import Campaign, DiagnosisOptions
from model.diagnosis.time_series import linearise_campaigns
from model.effects import EFFECTS
from model.wheel_soil import prior_of
from wheelsoil.simulation import SimulationOptions, parse_effect

EFFECT = "vasilev:H_m=0.02"
ALL = DiagnosisOptions(effects=tuple(key for key, effect in EFFECTS.items() if effect.reading == "any"))


def rows() -> list[Row]:
    """Measure on simulated campaigns with slip sinkage."""
    return [_evidence(), _whole_command(), _long_runs()]


def _campaign(runs: int, duration_s: float) -> Campaign:
    options = SimulationOptions(
        soil="clay", runs=runs, duration_s=duration_s, seed=1, draw_soil=True, effects=dict([parse_effect(EFFECT)])
    )
    soil = options.laboratory_soil
    return Campaign("clay", processed_campaign(options), options.wheel, soil, prior_of(soil, options.terrain))


def _evidence() -> Row:
    campaign = _campaign(6, 40.0)
    noises = linearise_campaigns([campaign], ALL).noises
    seconds = median_cpu_seconds(lambda: linearise_campaigns([campaign], ALL, noises))
    what = "evidence of every set of causes, 6 runs of 40 s, noise given"
    return Row(what, f"{seconds:.2f} s")


def _whole_command() -> Row:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "clay"
        wheelsoil_cost(
            "simulate", "--soil", "clay", "--runs", "6", "--duration", "40", "--effect", EFFECT, "-o", str(folder)
        )
        took = [diagnose_cost(folder, "slip_sinkage", cores={0}) for _ in range(3)]
    seconds = statistics.median(one.cost.cpu_s for one in took)
    wall_s = statistics.median(one.cost.wall_s for one in took)
    what = "wheelsoil diagnose, recordings to verdict, on one core"
    row = Row(what, f"{seconds:.1f} s (wall {wall_s:.1f} s)")
    return with_verdict(row, took[0].verdict, right=all(one.right for one in took))


def _long_runs() -> Row:
    took = [_round_s(_campaign(2, duration_s)) for duration_s in (300.0, 600.0)]
    growth = took[1] / took[0]
    what = "evidence of 2 runs, one linearisation: 10 min over 5 min each"
    as_text = f"{times(growth)}: {took[1]:.2f} s over {took[0]:.2f} s"
    return judged(what, as_text, growth, at_most(2.3, "x"), "in proportion: 2x")


def _round_s(campaign: Campaign) -> float:
    """Return the processor time of a round of linearisation and evidence; how many there are depends on the data."""
    noises = linearise_campaigns([campaign], ALL).noises
    rounds = linearise_campaigns([campaign], ALL, noises).rounds
    return median_cpu_seconds(lambda: linearise_campaigns([campaign], ALL, noises), 3) / rounds
