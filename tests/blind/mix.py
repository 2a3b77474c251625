"""The cases of the study: what is hidden, how large, from which seed; each campaign draws its own world."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from blind.causes import ALL, FAMILIES, OUTSIDE
from blind.field import FieldDay, field_day
from blind.foreign import FOREIGN
from blind.prior import drawn_causes
from blind.world import GRAVITY_MPS2, World, drawn_world

FIRST_SEED, BLOCK_SEEDS = 20_000, 1000
FRAMES_EVERY = 20
"""One case in so many goes through frames."""
UNLISTED_SHARE = 0.30
"""Of the campaigns with something hidden, foreign wheels and calibration apart: causes that the library has not."""
_LEAST_MASS_SHARE = 0.06

Hidden = tuple[str, float, float]


@dataclass(frozen=True)
class Case:
    """One campaign of the study.

    Attributes
    ----------
    kind : "null", "single", "pair", "outside", "left_out", "literal", "foreign" or "calibration"
    seed : int
    hidden : tuple of (key, L, sign)
        Of a pair: empty until it is drawn from `candidates`.
    without : str
        Family that is taken out of the engine's library.
    frames : bool
    """

    kind: str
    seed: int
    hidden: tuple[Hidden, ...] = ()
    without: str = ""
    frames: bool = False

    @property
    def name(self) -> str:
        """Key of the case: a line of the results has it."""
        what = "+".join(f"{key}@{level:g}" if level else key for key, level, _ in self.hidden) or self.kind
        return f"{self.kind}/{what}/{self.seed}"

    @property
    def entropy(self) -> tuple[int, ...]:
        """Seed of the campaign: no two cases drive the same one."""
        return (zlib.crc32(self.name.encode()), self.seed)

    def _rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng((*self.entropy, stream))

    @cached_property
    def day(self) -> FieldDay:
        """The campaign, with nothing hidden yet."""
        if self.kind == "foreign":
            campaign = FOREIGN[self.hidden[0][0]].drawn(self._rng(1))
            return field_day(
                campaign.laboratory, self.entropy, world=campaign.world, foreign=campaign.physics, slips=campaign.slips
            )
        return field_day(self.world.soil, self.entropy, world=self.world)

    @property
    def world(self) -> World:
        """The world that the campaign draws; where a slope may be hidden, the wheel has an outboard mass."""
        world = drawn_world(self._rng(1))
        may_slope = self.kind in ("pair", "calibration") or any(key == "slope" for key, _, _ in self.hidden)
        return with_outboard_mass(world) if may_slope else world

    def drawn_from_prior(self) -> tuple[tuple[str, float], ...]:
        """Return causes and sizes as the engine's prior has them."""
        return drawn_causes(self._rng(2), self.world.vehicle.radius_m)

    def candidates(self, tries: int = 80) -> Iterator[tuple[Hidden, Hidden]]:
        """Yield pairs of different families, for a pair to be chosen from by what the truth alone says."""
        rng = self._rng(3)
        for number in range(tries):
            first, second = (int(i) for i in rng.choice(len(FAMILIES), 2, replace=False))
            one, other = (float(x) for x in rng.choice([2.0, 5.0], 2))
            yield _hidden(FAMILIES[first], first, number, one), _hidden(FAMILIES[second], second, number, other)


def with_outboard_mass(world: World) -> World:
    """Return a world whose wheel has an outboard mass, the least that a slope shows by where it had less."""
    vehicle = world.vehicle
    least = round(_LEAST_MASS_SHARE * vehicle.loads_n[0] / GRAVITY_MPS2, 2)
    if vehicle.outboard_kg >= least:
        return world
    inertia = round(0.48 * least * vehicle.radius_m**2, 4)
    return replace(world, vehicle=replace(vehicle, outboard_kg=least, outboard_kgm2=inertia))


@dataclass(frozen=True)
class Mix:
    """How many cases of each kind.

    Attributes
    ----------
    nulls : int
    singles : int
        Seeds for each family and level; slip sinkage has four times as many.
    levels : tuple of float
        L.
    pairs : int
        Of which both members stand apart.
    outside : int
        Seeds for each kind at L = 2 and 5.
    left_out : int
        Seeds for each family at L = 1, 2, 5.
    literal : int
        Load-consistent soil under a literal simulation.
    foreign : int
        Seeds for each foreign wheel.
    calibration : int
        Drawn from the engine's own prior.
    block : int
        Of seeds: block k starts at 20,000 + 1,000 k; -1: seeds from 0, for work on the engine.
    """

    nulls: int = 20
    singles: int = 1
    levels: tuple[float, ...] = (0.5, 1.0, 2.0, 5.0)
    pairs: int = 4
    outside: int = 1
    left_out: int = 0
    literal: int = 2
    foreign: int = 1
    calibration: int = 10
    block: int = -1

    @property
    def first(self) -> int:
        """First seed."""
        return FIRST_SEED + BLOCK_SEEDS * self.block if self.block >= 0 else 0


WHOLE = Mix(nulls=300, singles=3, pairs=60, outside=8, left_out=1, literal=10, foreign=10, calibration=200)
"""Of a block."""


def cases(mix: Mix, share: float = 1.0) -> list[Case]:
    """Return every case of a mix, or a share of them; cases of a smaller mix are among those of a larger one."""
    kinds = (_nulls, _singles, _pairs, _outside, _left_out, _literal, _foreign, _calibration)
    found = [case for kind in kinds for case in kind(mix)]
    found = [replace(case, seed=mix.first + case.seed) for case in found]
    marks = [zlib.crc32(case.name.encode()) for case in found]
    kept = [case for case, mark in zip(found, marks, strict=True) if mark // 64 % 1000 < 1000 * share]
    return [replace(case, frames=zlib.crc32(case.name.encode()) % FRAMES_EVERY == 0) for case in kept]


def forms(family: str) -> list[str]:
    """Return the keys that a family is hidden as, variants among them."""
    return [key for key, hidden in ALL.items() if hidden.family == family]


def _nulls(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.nulls):
        yield Case("null", seed)


def _hidden(family: str, place: int, seed: int, level: float) -> Hidden:
    own = forms(family)
    key = own[(place + seed) % len(own)]
    sign = 1.0 if not ALL[key].both or (place + seed // 2) % 2 else -1.0
    return key, level, sign


def _singles(mix: Mix) -> Iterator[Case]:
    for place, family in enumerate(FAMILIES):
        for seed in range(mix.singles * (4 if family == "slip_sinkage" else 1)):
            for rank, level in enumerate(mix.levels):
                yield Case("single", seed, (_hidden(family, place + rank, seed, level),))


def _pairs(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.pairs):
        yield Case("pair", seed)


def _outside(mix: Mix) -> Iterator[Case]:
    for hidden in OUTSIDE:
        for seed in range(mix.outside):
            for level in (2.0, 5.0):
                sign = -1.0 if hidden.both and seed % 2 else 1.0
                yield Case("outside", seed, ((hidden.key, level, sign),))


def _left_out(mix: Mix) -> Iterator[Case]:
    for place, family in enumerate(FAMILIES):
        for seed in range(mix.left_out):
            for rank, level in enumerate((1.0, 2.0, 5.0)):
                yield Case("left_out", seed, (_hidden(family, place + rank, seed, level),), without=family)


def _literal(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.literal):
        yield Case("literal", seed)


def _foreign(mix: Mix) -> Iterator[Case]:
    for key in FOREIGN:
        for seed in range(mix.foreign):
            yield Case("foreign", seed, ((key, 0.0, 1.0),))


def _calibration(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.calibration):
        yield Case("calibration", seed)


def unlisted_share(wanted: Sequence[Case]) -> float:
    """Return the share of causes that the library has not, of the campaigns with something hidden."""
    listed = sum(case.kind in ("single", "pair") for case in wanted)
    unlisted = sum(case.kind in ("outside", "left_out") for case in wanted)
    return unlisted / max(listed + unlisted, 1)
