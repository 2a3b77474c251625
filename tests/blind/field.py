"""A campaign in the field: soil drawn, runs driven, something hidden or nothing; channels or frames out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from blind.causes import ALL
from blind.driving import RATE_HZ, Motion, Plan, load_history, moments_of, motion, plans
from blind.ground import LABORATORY, Ground, Patchiness, drawn_field, run_scatter
from blind.sensors import Suite, measured
from blind.standing import Stance, on_tilted_ground, towed
from blind.vendors import VENDORS, Vendor
from blind.wheel import Care, Moments, Physics, Reading, readings
from blind.world import World

from daq import Channel, FloatArray

_SOLVE_EVERY = 4
OWN = World()


@dataclass(frozen=True)
class FieldDay:
    """Everything about a campaign that does not depend on what is hidden.

    Attributes
    ----------
    laboratory : Ground
        As terrain.toml states it.
    ground : Ground
        Of the field, without scatter from run to run.
    plans, motions, moments : tuples, one entry a run
        At `RATE_HZ`.
    scatter : tuple of mapping
        Of each run's soil.
    patchiness, suite, vendor
    stance : Stance
    rut_n : mapping load -> towing resistance, N
    seed : tuple of int
        Of what is drawn while the runs are driven: the same whatever is hidden.
    world : World
    foreign : Physics, optional
        In place of Wong's wheel.
    """

    laboratory: Ground
    ground: Ground
    plans: tuple[Plan, ...]
    motions: tuple[Motion, ...]
    moments: tuple[Moments, ...]
    along_m: tuple[FloatArray, ...] = field(repr=False)
    scatter: tuple[dict[str, float], ...] = field(repr=False)
    patchiness: Patchiness
    suite: Suite
    vendor: Vendor
    stance: Stance
    rut_n: dict[float, float]
    seed: tuple[int, ...]
    world: World = OWN
    foreign: Physics | None = None


def field_day(
    soil: str | Ground,
    seed: Sequence[int],
    vendor: str | None = None,
    *,
    world: World = OWN,
    foreign: Physics | None = None,
    slips: tuple[float, float] = (-0.45, 0.92),
) -> FieldDay:
    """Draw a campaign on a laboratory's soil, or on one of `LABORATORY` by its name."""
    laboratory, vehicle = LABORATORY[soil] if isinstance(soil, str) else soil, world.vehicle
    sequence = np.random.SeedSequence(list(seed))
    drawing, driving = sequence.spawn(2)
    rng = np.random.default_rng(drawing)
    ground = drawn_field(laboratory, rng)
    chosen = VENDORS[vendor] if vendor else list(VENDORS.values())[rng.integers(len(VENDORS))]
    suite = world.instruments(chosen.suite.louder(float(np.exp(0.15 * rng.standard_normal()))))
    patchiness = world.ground(Patchiness.drawn(rng))
    planned = plans(rng, world.runs, vehicle, world.duration_s)
    streams = [np.random.default_rng(s) for s in driving.spawn(len(planned))]
    tow = {load: towed(ground, load, vehicle, foreign) for load in vehicle.loads_n}
    driven = [
        motion(r, tow[p.load_n][0], vehicle, world.duration_s, slips) for r, p in zip(streams, planned, strict=True)
    ]
    length = max(float(m.distance_m[-1]) for m in driven)
    line, span = (0.0, length), planned[-1].start_s + world.duration_s
    loads = [load_history(p, m, r, vehicle) for p, m, r in zip(planned, driven, streams, strict=True)]
    moments = [moments_of(p, m, w, line, span, vehicle) for p, m, w in zip(planned, driven, loads, strict=True)]
    along = [m.distance_m if p.direction > 0 else length - m.distance_m for p, m in zip(planned, driven, strict=True)]
    scatter = [run_scatter(rng, world.scatter) for _ in planned]
    return FieldDay(
        laboratory,
        ground,
        tuple(planned),
        tuple(driven),
        tuple(moments),
        tuple(along),
        tuple(scatter),
        patchiness,
        suite,
        chosen,
        Stance.drawn(np.random.default_rng((*seed, 11))),
        {load: resistance for load, (_, resistance) in tow.items()},
        (*seed, 7),
        world,
        foreign,
    )


def physics_of(hidden: Sequence[tuple[str, float]], wheel: Physics | None = None) -> Physics:
    """Return Wong's wheel, or another, with causes put in."""
    physics = wheel or Physics()
    for key, size in hidden:
        physics = ALL[key].put(physics, size)
    return physics


def driven(day: FieldDay, hidden: Sequence[tuple[str, float]]) -> list[dict[str, Channel]]:
    """Drive every run and return its channels by role."""
    physics = physics_of(hidden, day.foreign)
    out = []
    for index in range(len(day.plans)):
        patches, sensing = (
            np.random.default_rng(np.random.SeedSequence(day.seed, spawn_key=(index, which))) for which in (0, 1)
        )
        reading = true_reading(day, index, physics, patches)
        seen = measured(day.suite, day.plans[index], day.motions[index], reading, day.along_m[index], sensing)
        out.append(day.world.received(seen, sensing))
    return out


def true_reading(day: FieldDay, index: int, physics: Physics, rng: np.random.Generator) -> Reading:
    """Return what perfect sensors would say of a run over soil that varies along it, at `RATE_HZ`."""
    return true_run(day, index, physics, rng)[0]


def true_run(day: FieldDay, index: int, physics: Physics, rng: np.random.Generator) -> tuple[Reading, FloatArray]:
    """Return what perfect sensors would say of a run, and the wheel's sinkage, m."""
    moments, plan = day.moments[index], day.plans[index]
    standing = np.random.default_rng((*day.seed, index, 2))
    physics = on_tilted_ground(physics, day.stance, plan, day.world.vehicle, day.rut_n[plan.load_n], standing)
    patchy = day.patchiness.along(moments.distance_m, rng)
    soil = day.ground.changed(day.scatter[index]).changed(patchy)
    return readings(physics, soil, moments, Care(every=_SOLVE_EVERY))


__all__ = ["RATE_HZ", "FieldDay", "driven", "field_day", "physics_of"]
