"""Coverage of the 95 % intervals: simulated campaigns through CAN frames and back, without files.

``python -m benchmarks.recovery`` runs the whole study (clay and sandy soil, three laws, seeds 0 to 199) on both
cores and writes docs/recovery.md; the slow test runs its clay half.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from model.fit import FitOptions, fit_models
from model.wheel_soil import SOILS
from processing import ProcessedRun
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, simulated_roles

PARAMETER = {"vasilev": "H_m", "lyasko": "p", "ding": "n1"}
TRUTH: dict[str, dict[str, dict[str, float]]] = {
    "clay": {"vasilev": {"H_m": 0.02}, "lyasko": {"m1": 0.1, "m2": 0.05}, "ding": {"n1": 0.35}},
    "sandy": {"vasilev": {"H_m": 0.08}, "lyasko": {"m1": 0.6, "m2": 0.03}, "ding": {"n1": 0.53}},
}
"""The paper's Tab. 3."""
RUNS = 2
"""Of 40 s in a campaign."""


@dataclass(frozen=True)
class Coverage:
    """How many of `seeds` intervals contain the true value, and the ratio of the estimates' spread to their sigma."""

    soil: str
    law: str
    hits: int
    seeds: int
    spread: float

    def bounds(self) -> tuple[float, float]:
        """Return the 95 % Clopper-Pearson bounds of the coverage."""
        return clopper_pearson(self.hits, self.seeds)


def clopper_pearson(hits: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact bounds of a frequency."""
    from scipy.stats import binomtest

    bounds = binomtest(hits, n).proportion_ci(confidence, method="exact")
    return float(bounds.low), float(bounds.high)


def processed_campaign(options: SimulationOptions) -> tuple[ProcessedRun, ...]:
    """Simulate, encode, decode and process every run of a campaign."""
    return tuple(process(*simulated_roles(options, index)) for index in range(options.runs))


def one(soil: str, law: str, seed: int) -> tuple[bool, float]:
    """Return whether the interval contains the true value, and the error in sigmas."""
    options = SimulationOptions(soil=soil, effects={law: TRUTH[soil][law]}, runs=RUNS, seed=seed)
    fit = fit_models(processed_campaign(options), options.wheel, SOILS[soil], FitOptions(models=(law,))).models[0]
    estimate = fit.estimate(PARAMETER[law])
    truth = sum(TRUTH[soil][law].values())
    low, high = estimate.interval
    return low <= truth <= high, (estimate.value - truth) / estimate.sigma


def coverage(soil: str, law: str, seeds: int, workers: int | None = None) -> Coverage:
    """Run seeds 0 to `seeds` - 1."""
    with ProcessPoolExecutor(workers or os.cpu_count()) as pool:
        found = list(pool.map(partial(one, soil, law), range(seeds), chunksize=5))
    errors = sorted(abs(error) for _, error in found)
    return Coverage(soil, law, sum(hit for hit, _ in found), seeds, errors[round(0.683 * seeds) - 1])


def _markdown(rows: Iterable[Coverage], seconds: float) -> str:
    lines = [
        "# Coverage of the intervals",
        "",
        f"`python -m benchmarks.recovery` took {seconds / 60:.0f} min. Each seed is a campaign of {RUNS} runs of 40 s, "
        "simulated with Tab. 3 of the paper",
        "(load-consistent interpretation), sent through CAN frames, decoded, processed and fitted. Simulator "
        "and fitter differ in",
        "quadrature and rate. A 95 % interval should contain the true value in 0.95 of the seeds. Spread is the 68 % "
        "quantile of",
        "|error| over sigma; the ideal value is 1.",
        "",
        "| soil | law | parameter | coverage | n | 95 % Clopper-Pearson | spread |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        low, high = row.bounds()
        share = f"{row.hits / row.seeds:.3f}"
        lines.append(
            f"| {row.soil} | {row.law} | {PARAMETER[row.law]} | {share} | {row.seeds} | {low:.3f} to {high:.3f} | "
            f"{row.spread:.2f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run the study and write its page."""
    started = time.perf_counter()
    rows = []
    for soil in TRUTH:
        for law in PARAMETER:
            rows.append(coverage(soil, law, 200))
            print(rows[-1], rows[-1].bounds(), flush=True)
    target = Path(__file__).parent.parent / "docs" / "recovery.md"
    target.write_text(_markdown(rows, time.perf_counter() - started), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
