"""Study of the physics referee: listed mistakes, sound runs, runs with a measurement cause; by hand.

``python tests/referee_study.py`` prints counts with Clopper-Pearson bounds, and every case that is lost. Its result is
in docs/referee.md. Seeds are 0 to n - 1 of each part, or from `--first` on; the densities were fitted on others
(`fit_referee.py`, from 100,000 on), and the scales of a run as a whole chosen on seeds 100 to 180.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np
from referee_world import WAYS, World, cycles, firm, loaded, mistaken, sound_world
from scipy.stats import beta

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Soil, Wheel
from processing import is_refused
from processing.referee import BY_KEY, LISTED, Ruling, evidence_of, judge
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import simulated_run, simulated_setup
from wheelsoil.simulation.vehicle import vehicle_config

SOIL_NAMES = ("clay", "sandy", "firm")
CHANGES = ("unit:ground_speed=km/h", "unit:wheel_speed=rpm", "unit:wheel_speed=deg/s")
_EQUAL_SHARE = 0.05


def soil_named(name: str) -> Soil:
    """Return one of the study's soils."""
    return firm(SOILS["sandy_loam"]) if name == "firm" else SOILS[name]


def simulated_world(soil: str, seed: int, effects: dict[str, dict[str, float]] | None = None) -> World:
    """Return a run of `wheelsoil simulate`: all its sensors, positions too, with cycles between two standstills."""
    options = SimulationOptions(soil=soil, seed=seed, effects=effects or {})
    run, vehicle = simulated_run(options, seed % 3), vehicle_config(simulated_setup(options), options.wheel, "can0")
    channels = {
        role: channel
        for sensor in run.sensors.values()
        for role, channel in sensor.items()
        if role in vehicle.signals and role != "gnss_time"
    }
    for role in ("latitude", "longitude"):
        channels[role] = replace(channels[role], values=np.rad2deg(channels[role].values))
    return World(channels, vehicle)


def base_world(soil: str, *, quiet: bool, seed: int) -> World:
    """Return a sound run of the study with or without quiet stretches."""
    if quiet and soil != "firm":
        return simulated_world(soil, seed)
    rng = np.random.default_rng(seed)
    way = cycles if quiet else loaded
    return sound_world(rng, soil_named(soil), way, wheel=Wheel(0.47, 0.318), speed_mps=4.0, declared=True)


def ruling_of(world: World) -> Ruling:
    """Return the ruling on the processed run."""
    return judge(evidence_of(world.processed(), world.vehicle))


def is_right(ruling: Ruling, key: str) -> bool:
    """Return whether the mistake is named alone, or with an equal one that is as probable."""
    named = [mend.key for mend in ruling.named]
    return ruling.doubted and (named == [key] or (key in named and len(named) == 2 and _equal(ruling)))


def _equal(ruling: Ruling) -> bool:
    first, second = (share for _, share in ruling.mends[:2])
    return abs(first - second) < _EQUAL_SHARE


def bounds(count: int, of: int) -> str:
    """Return the 95 % Clopper-Pearson bounds of a frequency."""
    low = beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return f"{count} of {of} ({low:.4f} to {high:.4f})"


def study_mistakes(seed: int) -> None:
    """Print the listed mistakes on three soils, with and without quiet stretches."""
    right, refused, lost = 0, 0, Counter[str]()
    for soil in SOIL_NAMES:
        for quiet in (True, False):
            world = base_world(soil, quiet=quiet, seed=seed)
            for key in LISTED:
                ruling = ruling_of(mistaken(world, key))
                refused += ruling.refused
                if is_right(ruling, key):
                    right += 1
                    continue
                lost[key] += 1
                named = [(mend.key, round(share, 4)) for mend, share in ruling.mends[:3]]
                print(
                    f"  {soil}, {'quiet' if quiet else 'loaded'}, {key}: sound {ruling.sound:.2g}, {named}", flush=True
                )
    total = len(LISTED) * len(SOIL_NAMES) * 2
    print(
        f"seed {seed}: named with the right mend {bounds(right, total)}, refused {refused}; lost {dict(lost)}",
        flush=True,
    )


def partly_mistaken(world: World, key: str, *, share: float, first: bool) -> World:
    """Return a run of which the first share, or the rest, has a mistake of a unit."""
    wrong, channels = mistaken(world, key).channels, dict(world.channels)
    for role in BY_KEY[key].roles:
        right = channels[role]
        there = (np.arange(len(right)) < share * len(right)) == first
        channels[role] = replace(right, values=np.where(there, wrong[role].values, right.values))
    return World(channels, world.vehicle)


def study_changes(seed: int) -> None:
    """Print in how many runs a unit of speed that changes after 60 % is refused, and named with its time."""
    cases = named = refused = 0
    for soil, quiet in product(SOIL_NAMES, (True, False)):
        world = base_world(soil, quiet=quiet, seed=seed)
        for key, first in product(CHANGES, (True, False)):
            run = partly_mistaken(world, key, share=0.6, first=first).processed()
            notes = [note.values for note in run.quality.notes if note.values.get("why") == "changed"]
            units = [f"unit:{v['role']}={v['units'][0]}" for v in notes if abs(v["size"] / run.time_s[-1] - 0.6) < 0.02]
            cases, refused, named = cases + 1, refused + is_refused(run), named + (units == [key])
    print(f"seed {seed}: units that change: refused {bounds(refused, cases)}, named {bounds(named, cases)}", flush=True)


def study_sound(seeds: range) -> None:
    """Print how many sound runs are refused or noted."""
    refused = noted = 0
    spent_s = 0.0
    for seed in seeds:
        way = WAYS[seed % len(WAYS)]
        world = sound_world(np.random.default_rng(seed), way=way)
        run = world.processed()
        evidence = evidence_of(run, world.vehicle)
        start_s = time.process_time()
        ruling = judge(evidence)
        spent_s += time.process_time() - start_s
        refused, noted = refused + is_refused(run), noted + (ruling.doubted and not ruling.refused)
        if ruling.doubted or is_refused(run):
            print(f"  sound {seed}, {way.__name__}: {ruling.sound:.2g}, {[m.key for m in ruling.named]}", flush=True)
    each_ms, count = 1e3 * spent_s / max(len(seeds), 1), len(seeds)
    print(f"sound runs: refused {bounds(refused, count)}, noted {bounds(noted, count)}, {each_ms:.1f} ms each")


def study_causes(seeds: range) -> None:
    """Print how many runs with a measurement cause of up to three prior scales are refused."""
    causes = [effect for effect in EFFECTS.values() if effect.kind == "measurement" and not effect.needs.roles]
    refused = noted = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        effect = causes[seed % len(causes)]
        sizes = {
            p.name: float(np.clip(p.neutral + rng.uniform(-3, 3) * p.prior_scale, p.lower, p.upper))
            for p in effect.parameters
        }
        name = next(key for key, one in EFFECTS.items() if one is effect)
        world = simulated_world(("clay", "sandy", "sandy_loam")[seed % 3], seed, {name: sizes})
        run, ruling = world.processed(), ruling_of(world)
        refused, noted = refused + is_refused(run), noted + (ruling.doubted and not ruling.refused)
        if ruling.doubted:
            print(f"  cause {seed}, {name} {sizes}: {ruling.sound:.2g}, {[m.key for m in ruling.named]}", flush=True)
    print(f"measurement causes: refused {bounds(refused, len(seeds))}, noted {bounds(noted, len(seeds))}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--mistakes", type=int, default=1, help="seeds of the 180 cases")
    parser.add_argument("--changes", type=int, default=0, help="seeds of the 36 runs in which a unit changes")
    parser.add_argument("--sound", type=int, default=200)
    parser.add_argument("--causes", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed of each part")
    given = parser.parse_args()
    mistakes, changes, sound, causes = (
        range(given.first, given.first + count) for count in (given.mistakes, given.changes, given.sound, given.causes)
    )
    for number in mistakes:
        study_mistakes(number)
    for number in changes:
        study_changes(number)
    study_sound(sound)
    study_causes(causes)
