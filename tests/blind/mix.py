"""The cases of the study: what is hidden, where, how large, from which seed."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from blind.causes import ALL, FAMILIES, OUTSIDE
from blind.field import FieldDay, field_day
from blind.world import World

SOILS = ("clay", "sandy")
FRAMES_EVERY = 20
"""One case in so many goes through frames."""


@dataclass(frozen=True)
class Case:
    """One campaign of the study.

    Attributes
    ----------
    kind : "null", "single", "pair", "outside", "left_out" or "literal"
    seed : int
    soil : "clay" or "sandy"
    hidden : tuple of (key, L, sign)
    without : str
        Family that is taken out of the engine's library.
    frames : bool
    beyond : bool
        In a world whose noise is outside the engine's beliefs.
    """

    kind: str
    seed: int
    soil: str
    hidden: tuple[tuple[str, float, float], ...] = ()
    without: str = ""
    frames: bool = False
    beyond: bool = False

    @property
    def name(self) -> str:
        """Key of the case: a line of the results has it."""
        what = "+".join(f"{key}@{level:g}" for key, level, _ in self.hidden) or "none"
        return f"{self.kind}/{what}/{self.soil}/{self.seed}" + "/beyond" * self.beyond

    @property
    def entropy(self) -> tuple[int, ...]:
        """Seed of the campaign: no two cases drive the same one."""
        return (zlib.crc32(self.name.encode()), self.seed)

    @property
    def day(self) -> FieldDay:
        """The campaign, with nothing hidden yet."""
        return field_day(self.soil, self.entropy, world=World())


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
    outside : int
        Seeds for each kind at L = 2 and 5.
    left_out : int
        Seeds for each family at L = 1, 2, 5.
    literal : int
        Load-consistent soil under a literal simulation.
    beyond : bool
        All in a world whose noise is outside the engine's beliefs.
    """

    nulls: int = 20
    singles: int = 1
    levels: tuple[float, ...] = (0.5, 1.0, 2.0, 5.0)
    pairs: int = 10
    outside: int = 1
    left_out: int = 0
    literal: int = 2
    beyond: bool = False


FULL = Mix(nulls=200, singles=6, pairs=60, outside=16, left_out=4, literal=10)
FRESH = {"outside": 8, "left_out": 2}
"""First seed that nobody had seen when the gate's shapes were last changed."""


def cases(mix: Mix) -> list[Case]:
    """Return every case of a mix; cases of a smaller mix are among those of a larger one."""
    found = [*_nulls(mix), *_singles(mix), *_pairs(mix), *_outside(mix), *_left_out(mix), *_literal(mix)]
    found = [replace(case, beyond=mix.beyond) for case in found]
    return [replace(case, frames=zlib.crc32(case.name.encode()) % FRAMES_EVERY == 0) for case in found]


def forms(family: str) -> list[str]:
    """Return the keys that a family is hidden as, variants among them."""
    return [key for key, hidden in ALL.items() if hidden.family == family]


def _nulls(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.nulls):
        yield Case("null", seed, SOILS[seed % 2])


def _hidden(family: str, place: int, seed: int, level: float) -> tuple[str, float, float]:
    own = forms(family)
    key = own[(place + seed) % len(own)]
    sign = 1.0 if not ALL[key].both or (place + seed // 2) % 2 else -1.0
    return key, level, sign


def _singles(mix: Mix) -> Iterator[Case]:
    for place, family in enumerate(FAMILIES):
        for seed in range(mix.singles * (4 if family == "slip_sinkage" else 1)):
            for rank, level in enumerate(mix.levels):
                soil = SOILS[(place + seed + rank + seed // 4) % 2]
                yield Case("single", seed, soil, (_hidden(family, place + rank, seed, level),))


def _pairs(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.pairs):
        rng = np.random.default_rng((77, seed))
        first, second = rng.choice(len(FAMILIES), 2, replace=False)
        levels = rng.choice([2.0, 5.0], 2)
        hidden = tuple(
            _hidden(FAMILIES[i], int(i), seed, float(level)) for i, level in zip((first, second), levels, strict=True)
        )
        yield Case("pair", seed, SOILS[seed % 2], hidden)


def _outside(mix: Mix) -> Iterator[Case]:
    for place, hidden in enumerate(OUTSIDE):
        for seed in range(mix.outside):
            for level in (2.0, 5.0):
                sign = -1.0 if hidden.both and seed % 2 else 1.0
                yield Case("outside", seed, SOILS[(place + seed) % 2], ((hidden.key, level, sign),))


def _left_out(mix: Mix) -> Iterator[Case]:
    for place, family in enumerate(FAMILIES):
        for seed in range(mix.left_out):
            for rank, level in enumerate((1.0, 2.0, 5.0)):
                hidden = _hidden(family, place + rank, seed, level)
                yield Case("left_out", seed, SOILS[(place + seed) % 2], (hidden,), without=family)


def _literal(mix: Mix) -> Iterator[Case]:
    for seed in range(mix.literal):
        yield Case("literal", seed, SOILS[seed % 2])
