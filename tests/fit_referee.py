"""Fits the constants of `processing/referee/densities.py` on simulated sound runs; by hand.

``python tests/fit_referee.py 400`` prints, of so many runs from seed 100,000 on, how often each ground is the best
one, and the robust scale of every residual on it. The study and the tests draw from other seeds.
"""

from __future__ import annotations

import sys

import numpy as np
from referee_world import WAYS, sound_world

from processing.referee import densities, evidence_of
from processing.referee.judgement import _LEAST_QUANTILE, _effective_samples, _odds, _rows, _wheel_ratios

FIRST_SEED = 100_000


def main(count: int) -> None:
    """Print the constants."""
    grid = [densities.TRACTIONS, densities.SLIPS, densities.RESISTANCES]
    shape = tuple(map(len, grid))
    posterior = np.zeros(shape)
    weights = np.exp(densities.ground_weights()).reshape(shape)
    names = ("traction", "resistance", "track", "share", "least slip", "least sliding")
    residuals: dict[str, list[float]] = {name: [] for name in names}
    curve, _, resistance = densities.grounds()
    for number in range(count):
        world = sound_world(np.random.default_rng(FIRST_SEED + number), way=WAYS[number % len(WAYS)])
        evidence = evidence_of(world.processed(), world.vehicle)
        rows = _rows(evidence)
        if rows is None:
            continue
        wheel = _wheel_ratios(rows[np.newaxis], np.array([evidence.radius_m]))
        logs = -(densities.TAIL + 1) / 2 * np.log(_odds(wheel))
        each = _effective_samples(rows) * (logs * wheel.weight).sum(axis=2)[:, 0]
        share = np.exp(each - each.max()).reshape(shape) * weights
        posterior += share / share.sum()
        best = int(np.argmax(each))
        node = np.rint((np.clip(wheel.slip[0], -1, 1) + 1) * (len(densities.NODES) - 1) / 2).astype(int)
        steady = np.abs(wheel.slip[0]) > 0.3
        residuals["traction"] += list((wheel.traction[0] - curve[best, node])[steady])
        residuals["resistance"] += list((wheel.traction - wheel.pull)[0][wheel.slip[0] < 0.1] - resistance[best])
        for name, size in ("least slip", wheel.slip), ("least sliding", wheel.slip * wheel.faster):
            residuals[name].append(np.quantile(np.abs(size), _LEAST_QUANTILE))
        residuals["track"].append(np.log(evidence.against_track.get("ground_speed", np.nan)))
        if evidence.mass_kg:
            residuals["share"].append(np.log(np.median(rows[2]) / evidence.mass_kg / 9.80665))
    posterior = (posterior + 0.02 * posterior.sum() / posterior.size) / posterior.sum()
    for axis, values in enumerate(grid):
        marginal = posterior.sum(axis=tuple({0, 1, 2} - {axis}))
        print(values, "weights", tuple(np.round(marginal / marginal.max(), 2).tolist()))
    for name, found in residuals.items():
        known = np.array(found)[np.isfinite(found)]
        middle = float(np.median(known))
        print(
            f"{name}: median {middle:.3f}, scale {1.4826 * np.median(np.abs(known - middle)):.3f}, n {len(known)}, "
            f"1 and 99 % quantiles {np.round(np.quantile(known, [0.01, 0.99]), 3).tolist()}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 400)
