"""Advice carried out: the first step that a `one_of` is told, and one at random, driven and diagnosed again.

PYTHONPATH=tests python -m blind.advice --out out/blind/block-3 --count 60
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from blind.driving import ADDED_SHARE, load_history, moments_of, motion
from blind.engine import OPTIONS, campaign_from_channels
from blind.field import FieldDay, physics_of, true_run
from blind.figures import clopper_pearson
from blind.folders import run_info, vehicle_config
from blind.ground import run_scatter
from blind.jsonl import append_line
from blind.mix import WHOLE, Case, cases
from blind.sensors import START_NS, measured
from blind.standing import towed
from blind.study import ONE_THREAD, by_name
from blind.world import GRAVITY_MPS2
from scipy.stats import binomtest

from daq import Channel, FloatArray, Note, RutReading
from model import StepCode
from model.diagnosis import Campaign, Diagnosis, NextRun, samples_of
from model.diagnosis.planning.manoeuvres import manoeuvres
from processing import ProcessedRun
from processing.pipeline import process

DRIVEN = frozenset(
    {
        StepCode.LIKE_OTHERS,
        StepCode.MORE_LOAD,
        StepCode.LESS_LOAD,
        StepCode.OTHER_DIRECTION,
        StepCode.SECOND_PASS,
        StepCode.HALF_SPEED,
        StepCode.RUT,
        StepCode.SINKAGE,
    }
)
"""Steps that this world can drive."""
KINDS = ("single", "pair", "calibration")
BETWEEN_S = 400.0
SENSOR_ZERO_M, SENSOR_NOISE_M = 0.003, 0.002
RULER_M, REBOUND_M, REBOUND_SIGMA_M, READINGS = 0.004, 0.006, 0.002, 5


def with_one_more(day: FieldDay, step: Note) -> FieldDay:
    """Return the day with the run that a step asks for, driven after all others."""
    rng = np.random.default_rng((*day.seed, 77))
    vehicle, last = day.world.vehicle, day.plans[-1]
    middle = float(np.median([plan.load_n for plan in day.plans]))
    like = min(day.plans, key=lambda plan: abs(plan.load_n - middle))
    load_n = float(step.values["load_n"]) if step.code in (StepCode.MORE_LOAD, StepCode.LESS_LOAD) else like.load_n
    turned = step.code == StepCode.OTHER_DIRECTION
    plan = replace(
        like,
        index=last.index + 1,
        load_n=load_n,
        direction=(1 if step.values["outward"] else -1) if turned else like.direction,
        passes=max(p.passes for p in day.plans) + 1 if step.code == StepCode.SECOND_PASS else like.passes,
        start_s=last.start_s + last.duration_s + BETWEEN_S,
        added_load_kg=(load_n - vehicle.loads_n[0]) / ADDED_SHARE / GRAVITY_MPS2,
    )
    coast, rut_n = towed(day.ground, load_n, vehicle, day.foreign)
    paced = replace(vehicle, pace=0.5 * vehicle.pace) if step.code == StepCode.HALF_SPEED else vehicle
    driven = motion(rng, coast, paced, plan.duration_s)
    length = max(float(m.distance_m[-1]) for m in day.motions)
    span = last.start_s + last.duration_s
    loads = load_history(plan, driven, rng, vehicle)
    along = driven.distance_m if plan.direction > 0 else length - driven.distance_m
    return replace(
        day,
        plans=(*day.plans, plan),
        motions=(*day.motions, driven),
        moments=(*day.moments, moments_of(plan, driven, loads, (0.0, length), span, vehicle)),
        along_m=(*day.along_m, along),
        scatter=(*day.scatter, run_scatter(rng, day.world.scatter)),
        rut_n=day.rut_n | {load_n: rut_n},
    )


def driven_run(day: FieldDay, hidden: Sequence[tuple[str, float]], step: Note) -> ProcessedRun:
    """Return the run that a step asks for, processed."""
    day = with_one_more(day, step)
    index, plan = len(day.plans) - 1, day.plans[-1]
    patches, sensing, ruler = (
        np.random.default_rng(np.random.SeedSequence(day.seed, spawn_key=(index, which))) for which in (0, 1, 2)
    )
    reading, sinkage = true_run(day, index, physics_of(hidden, day.foreign), patches)
    seen = measured(day.suite, plan, day.motions[index], reading, day.along_m[index], sensing)
    channels = day.world.received(seen, sensing)
    info, vehicle = run_info(plan), vehicle_config(day)
    time_s = day.motions[index].time_s
    if step.code == StepCode.SINKAGE:
        zero, noise = SENSOR_ZERO_M * ruler.standard_normal(), SENSOR_NOISE_M * ruler.standard_normal(len(time_s))
        at = START_NS + np.round(1e9 * (plan.start_s + time_s)).astype(np.int64)
        channels["sinkage"] = Channel("sinkage", "m", at, sinkage + zero + noise)
    if step.code == StepCode.RUT:
        info = info.model_copy(update={"rut": rut_of(day, sinkage, ruler)})
    return process(channels, vehicle, info, OPTIONS)


def rut_of(day: FieldDay, sinkage: FloatArray, rng: np.random.Generator) -> tuple[RutReading, ...]:
    """Return readings of the last run's rut, from the least slip to the largest."""
    driven = day.motions[-1]
    moving = np.flatnonzero(driven.speed > 0.3)
    slip = 1.0 - driven.speed[moving] / (day.world.vehicle.radius_m * driven.omega[moving])
    rows = moving[np.argsort(slip)[np.linspace(0, len(moving) - 1, READINGS + 2).round().astype(int)[1:-1]]]
    rebound = REBOUND_M + REBOUND_SIGMA_M * rng.standard_normal()
    depth = np.maximum(sinkage[rows] - rebound + RULER_M * rng.standard_normal(READINGS), 0.0)
    return tuple(
        RutReading(depth_m=float(d), sigma_m=RULER_M, time_s=float(t))
        for d, t in zip(depth, driven.time_s[rows], strict=True)
    )


def offered(campaign: Campaign) -> dict[str, Note]:
    """Return the steps that this world can drive, by code."""
    found = manoeuvres(samples_of(campaign), [run.run.added_load_kg for run in campaign.runs])
    return {one.step.code: one.step for one in found if one.step.code in DRIVEN}


def tried(case: Case, truth: dict[str, Any]) -> dict[str, Any]:
    """Diagnose a campaign, carry out the first step of it and one at random, and return what came of them."""
    from model.diagnosis import diagnose

    sized = [(member["key"], member["size"]) for member in truth["members"] if "size" in member]
    families = {member["family"] for member in truth["members"]}
    campaign = campaign_from_channels(case.day, sized)
    first = diagnose([campaign])
    out: dict[str, Any] = {"name": case.name, "verdict": first.verdict, "families": sorted(families)}
    advised = next((run for run in first.next_run if run.step.code in DRIVEN), None)
    if first.verdict != "one_of" or advised is None:
        return out
    steps = offered(campaign)
    drawn = steps[str(np.random.default_rng(case.entropy).choice(sorted(steps)))]
    for name, step in (("advised", advised.step), ("random", drawn)):
        run = driven_run(case.day, sized, step)
        again = diagnose([replace(campaign, runs=(*campaign.runs, run))])
        out[name] = {"step": str(step.code), **_outcome(again, families)}
    return out | {"stated": advised.naming_chance, "best_stated": _best(first.next_run)}


def _best(runs: Sequence[NextRun]) -> float:
    return max((run.naming_chance or 0.0 for run in runs), default=0.0)


def _outcome(found: Diagnosis, families: set[str]) -> dict[str, Any]:
    named = [cause.name for cause in found.causes] if found.verdict == "named" else []
    barred = found.grounds.barred
    return {
        "verdict": found.verdict,
        "named": named,
        "right": bool(named) and set(named) <= families,
        "barred": str(barred.code) if barred else "",
        "candidates": {one.name: round(one.probability, 3) for one in found.candidates[:3]},
    }


def summary(entries: Sequence[dict[str, Any]]) -> str:
    """Return what came of the advice, as lines."""
    done = [entry for entry in entries if "advised" in entry]
    n = len(done)
    right = {name: [entry[name]["right"] for entry in done] for name in ("advised", "random")}
    wrong = {name: sum(bool(e[name]["named"]) and not e[name]["right"] for e in done) for name in right}
    stated = [(entry["stated"], entry["advised"]["right"]) for entry in done if entry["stated"] is not None]
    low, high = clopper_pearson(sum(right["advised"]), n)
    pairs = list(zip(right["advised"], right["random"], strict=True))
    only = [sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs)]
    p = binomtest(only[0], sum(only), 0.5).pvalue if sum(only) else 1.0
    return "\n".join(
        [
            f"{n} campaigns of verdict one_of; steps that the blind world can drive",
            f"right name after the first step stated for {len(stated)}: of {sum(p for p, _ in stated):.1f}; "
            f"{sum(right for _, right in stated)} got it",
            f"right names after it: {sum(right['advised'])} of {n} ({low:.2f} to {high:.2f}); wrong {wrong['advised']}",
            f"right names after a step at random: {sum(right['random'])} of {n}; wrong {wrong['random']}",
            f"only by advice {only[0]}, only at random {only[1]}, McNemar p {p:.3g}",
        ]
    )


def main() -> None:
    """Carry out the advice of the first campaigns of a block."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of a block")
    parser.add_argument("--block", type=int, default=-1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    truths, answers = by_name(options.out / "truth.jsonl"), by_name(options.out / "answers.jsonl")
    listed = [case for case in cases(replace(WHOLE, block=options.block)) if case.kind in KINDS]
    one_of = [case for case in listed if answers.get(case.name, {}).get("verdict") == "one_of"][: options.count]
    at = options.out / "advice.jsonl"
    done = by_name(at)
    os.environ.update(ONE_THREAD | {"WHEELSOIL_CACHE": "off"})
    with ProcessPoolExecutor(options.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        left = [pool.submit(tried, case, truths[case.name]) for case in one_of if case.name not in done]
        for future in as_completed(left):
            append_line(at, future.result())
            print(future.result(), flush=True)
    print(summary(list(by_name(at).values())))


if __name__ == "__main__":
    main()
