"""Gram matrices with a known truth, without any vehicle: columns are drawn, the residual is made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq import FloatArray
from model.diagnosis import Shape
from model.diagnosis.time_series.columns import CauseColumn, Grams
from model.diagnosis.time_series.evidence import LARGE, LARGE_SHARE

WIDTHS = ((1.0, 1.0 - LARGE_SHARE), (LARGE, LARGE_SHARE))
"""One-sigma of the prior of the sizes of a cause alone, and its share."""


def widths_of(causes: Sequence[object]) -> tuple[tuple[float, float], ...]:
    """Return the same of a set."""
    return WIDTHS if len(causes) == 1 else ((1.0, 1.0),)


@dataclass(frozen=True)
class World:
    """Whitened columns of every run: soil (runs, n, q), causes (runs, n, k), basis (runs, n, b)."""

    soil: FloatArray
    causes: FloatArray
    basis: FloatArray
    columns: tuple[CauseColumn, ...]

    def grams(
        self,
        coefficients: FloatArray,
        rng: np.random.Generator,
        noise: float = 1.0,
        extra: FloatArray | None = None,
        runs: int | None = None,
    ) -> Grams:
        """Draw soil and noise, build the residual and its cross products."""
        count, n, q = self.soil.shape
        residual = self.soil @ rng.normal(size=q) + self.causes @ coefficients + noise * rng.normal(size=(count, n))
        if extra is not None:
            residual = residual + extra
        everything = np.concatenate([residual[..., None], self.soil, self.causes, self.basis], axis=2)[:runs]
        return Grams(
            np.swapaxes(everything, 1, 2) @ everything,
            np.zeros(len(everything)),
            np.full(len(everything), n),
            tuple(f"run {i}" for i in range(len(everything))),
            tuple(f"soil {i}" for i in range(q)),
            self.columns,
            tuple(Shape(f"shape {i}", "dp") for i in range(self.basis.shape[2])),
        )


def column(family: str, form: str = "", parameter: str = "a", **other: object) -> CauseColumn:
    given = {"scale": 0.1, "centre": 0.0, "neutral": 0.0, "lower": -10.0, "upper": 10.0, "one_sided": False}
    key = form or family
    return CauseColumn(key, family, parameter, "m", **{**given, **other})  # type: ignore[arg-type]


def library(families: int = 24) -> tuple[CauseColumn, ...]:
    """Families of one form each, every third one-sided, and one with three forms of which one has two parameters."""
    single = [column(f"cause{i:02d}", one_sided=i % 3 == 0) for i in range(families - 1)]
    digging = [
        column("digging", "linear", one_sided=True),
        column("digging", "convex", "m1", one_sided=True),
        column("digging", "convex", "m2", one_sided=True),
        column("digging", "exponent", one_sided=True),
    ]
    return tuple(single + digging)


def world(
    seed: int, columns: tuple[CauseColumn, ...], runs: int = 6, n: int = 120, strength: tuple[float, float] = (2, 40)
) -> World:
    """Draw columns that are smooth functions of slip, load, time and speed, as real signatures are.

    `strength` bounds d of a coefficient of one, before the soil is taken out.
    """
    rng = np.random.default_rng(seed)
    count = len(columns)
    slip = np.abs(np.sin(np.linspace(0, 3 * np.pi, n)))[None] * np.ones((runs, 1))
    slip = slip + 0.05 * rng.normal(size=slip.shape)
    load = np.repeat(np.resize([0.8, 1.1, 1.3], runs)[:, None], n, 1)
    direction = np.repeat(np.resize([1.0, -1.0], runs)[:, None], n, 1)
    time = np.linspace(-1, 1, n)[None] + np.arange(runs)[:, None] / runs
    features = np.stack([
        np.ones_like(slip), slip, slip**2, np.exp(-slip / 0.1), load, load * slip, direction, time, np.sin(3 * time),
        np.cos(9 * time), np.sin(20 * time), load**2,
    ], axis=2)  # fmt: skip
    scale = np.exp(rng.uniform(*np.log(strength), size=count))

    def mixed(k: int, d: FloatArray) -> FloatArray:
        x = features @ (rng.normal(size=(features.shape[2], k)) * (rng.uniform(size=(features.shape[2], k)) < 0.35))
        x += 0.02 * rng.normal(size=x.shape)
        return np.asarray(x * d / np.sqrt((x**2).sum(axis=(0, 1))))

    soil = mixed(6, np.full(6, 60.0))
    causes = mixed(count, scale)
    hats = np.stack([np.maximum(1 - np.abs(slip - c) / 0.1, 0) for c in np.arange(0, 1.01, 0.1)], axis=2)
    hats_t = np.stack([np.maximum(1 - np.abs(time - c) / 0.2, 0) for c in np.arange(-1, 1.9, 0.2)], axis=2)
    basis = np.concatenate([hats, hats_t, hats * direction[..., None]], axis=2)
    return World(soil, causes, basis, columns)
