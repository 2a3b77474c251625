"""Sinkage from forces where the physics is foreign: how many rows get a number, and how many bands are right.

``PYTHONPATH=tests:. python studies/foreign_sinkage/study.py [campaigns] [rows]``. The worlds are the foreign wheels of
the blind study (tests/blind/foreign.py), campaigns with seeds 0 to n - 1 of each, with its instruments. A row is a
range of slip, as `wheelsoil sinkage` gives it, from load, pull, torque and radius alone; the true sinkage, averaged
over the same samples, is put beside it afterwards. The constant band of a row is the middle 95 % of the true Z/r of
all other wheels. Every world has the same number of rows, drawn from what its campaigns give. Results: results.json.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from blind.driving import RATE_HZ
from blind.engine import OPTIONS
from blind.field import physics_of, true_run
from blind.folders import run_info, vehicle_config
from blind.foreign import FOREIGN
from blind.mix import Case
from blind.sensors import measured
from scipy.stats import beta

from daq import FloatArray
from model.sinkage_from_forces import SlipBin, cells_of_runs, sinkage_from_forces
from processing import ProcessedRun
from processing.pipeline import process

_MISS = 2 / 0.05
"""Weight of a miss in the interval score of a 95 % band."""


@dataclass(frozen=True)
class Row:
    """A range of slip of one campaign; sinkages over the radius.

    Attributes
    ----------
    wheel : str
        Rows of the same wheel are left out together.
    number : bool
        Whether the program gives one.
    """

    world: str
    wheel: str
    slip: float
    low: float
    middle: float
    high: float
    true: float
    number: bool

    def score(self, band: FloatArray | None = None) -> float:
        """Return the interval score (Winkler) of a band, the row's own by default."""
        low, high = (self.low, self.high) if band is None else band.tolist()
        return float(high - low + _MISS * (max(low - self.true, 0.0) + max(self.true - high, 0.0)))


def processed_runs(case: Case) -> Iterator[ProcessedRun]:
    """Yield the runs of a foreign campaign; their measured sinkage is the true one."""
    day = case.day
    vehicle, physics = vehicle_config(day), physics_of((), day.foreign)
    for index, (plan, motion, along) in enumerate(zip(day.plans, day.motions, day.along_m, strict=True)):
        patches, sensing = (
            np.random.default_rng(np.random.SeedSequence(day.seed, spawn_key=(index, which))) for which in (0, 1)
        )
        reading, sinkage = true_run(day, index, physics, patches)
        channels = day.world.received(measured(day.suite, plan, motion, reading, along, sensing), sensing)
        run = process(channels, vehicle, run_info(plan), OPTIONS)
        true = np.interp(run.time_s, np.arange(len(sinkage)) / RATE_HZ, np.ravel(sinkage))
        yield replace(run, sinkage_m=true)


def rows_of(world: str, seed: int) -> list[Row]:
    """Return the rows of a campaign."""
    case = Case("foreign", seed, ((world, 0.0, 1.0),))
    runs = list(processed_runs(case))
    radius = runs[0].wheel_radius_m
    bins = sinkage_from_forces(cells_of_runs(runs), np.random.default_rng(0)).bins()

    def row(own: SlipBin) -> Row:
        (low, high), middle = own.sinkage_m.interval95, own.sinkage_m.value
        wheel = world if world == "granular" else f"{world} {seed}"  # one wheel, by its table
        sinkages = (low / radius, middle / radius, high / radius, own.measured_m / radius)
        return Row(world, wheel, own.slip, *sinkages, own.tells)

    return [row(own) for own in bins]


def bounds(right: int, rows: int) -> tuple[float, float]:
    """Return the 95 % bounds of Clopper and Pearson (1934)."""
    low = beta.ppf(0.025, right, rows - right + 1) if right else 0.0
    return float(low), float(beta.ppf(0.975, right + 1, rows - right)) if right < rows else 1.0


def figures(rows: list[Row], chosen: list[Row]) -> dict[str, Any]:
    """Return the figures of some rows; the constant bands come from all of them."""
    given = [row for row in chosen if row.number]
    inside = sum(row.low <= row.true <= row.high for row in given)
    constant = [np.quantile([r.true for r in rows if r.wheel != row.wheel], [0.025, 0.975]) for row in given]
    return {
        "rows": len(chosen),
        "with_number": len(given),
        "inside": inside,
        "bounds95": bounds(inside, len(given)) if given else None,
        "below": sum(row.true < row.low for row in given),
        "inside_without_number": sum(r.low <= r.true <= r.high for r in chosen if not r.number),
        "score": float(np.mean([row.score() for row in given])) if given else None,
        "constant_score": float(np.mean([r.score(b) for r, b in zip(given, constant, strict=True)])) if given else None,
        "median_over_true": float(np.median([row.middle / row.true for row in chosen])),
    }


def main() -> None:
    """Estimate every campaign, print the figures by world and write them."""
    campaigns, count = (int(x) for x in (*sys.argv[1:], *("16", "200")[len(sys.argv) - 1 :]))
    rng = np.random.default_rng(0)
    rows: list[Row] = []
    for world in FOREIGN:
        own = [row for seed in range(campaigns) for row in rows_of(world, seed)]
        kept = rng.permutation(len(own))[: count // len(FOREIGN)]
        rows += [own[i] for i in sorted(kept)]
        print(world, len(own), "rows", flush=True)
    found = {world: figures(rows, [r for r in rows if r.world == world]) for world in FOREIGN}
    found["all"] = figures(rows, rows)
    for world, own_figures in found.items():
        print(world, own_figures)
    Path(__file__).with_name("results.json").write_text(_text(found, rows), encoding="utf-8")


def _text(found: dict[str, dict[str, Any]], rows: list[Row]) -> str:
    """Return the figures of each world, and one line a row."""
    worlds = [f'"{world}": {json.dumps(_short(own))}' for world, own in found.items()]
    lines = [json.dumps(_short(asdict(row))) for row in rows]
    return '{"figures": {\n' + ",\n".join(worlds) + '},\n"rows": [\n' + ",\n".join(lines) + "]}\n"


def _short(content: dict[str, Any]) -> Any:
    return json.loads(json.dumps(content), parse_float=lambda text: float(f"{float(text):.4g}"))


if __name__ == "__main__":
    main()
