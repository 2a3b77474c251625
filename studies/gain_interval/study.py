"""How often the gain's interval holds on runs that were driven afterwards.

``python -m studies.gain_interval.study [campaigns] [runs]``. A campaign of three to five runs of 20 s with a hidden law
of slip sinkage is diagnosed: its held-out runs give the reduction of drawbar pull R0 with an interval. Twelve more runs
on the same soil are predicted from all of the first ones: their reduction is what the interval is of. Seeds 0 to n - 1.
Finished campaigns are in results.json; a second start continues there.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import beta

from model.cores import one_thread
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.findings.held_out import held_out
from model.diagnosis.findings.set_fit import SetFit, fit_sets
from model.diagnosis.time_series.linearise import simulated
from model.diagnosis.time_series.linearised_campaign import linearise_campaigns
from model.diagnosis.time_series.samples import samples_of
from model.fit import FitOptions
from model.wheel_soil.soils import prior_of
from processing.pipeline import process
from wheelsoil.simulation.campaign import simulated_roles
from wheelsoil.simulation.options import SimulationOptions

RUNS, FRESH = (3, 4, 5), 12
LAWS = {"vasilev": {"H_m": 0.05}, "lyasko": {"m1": 0.4, "m2": 0.05}, "ding": {"n1": 0.4}}
RESULTS = Path(__file__).with_name("results.json")


@one_thread
def one(seed: int) -> dict[str, float] | None:
    """Return the interval and what fresh runs say, in per cent; None where no fold chose a cause."""
    runs, law = RUNS[seed % len(RUNS)], list(LAWS)[seed // len(RUNS) % len(LAWS)]
    options = SimulationOptions(
        soil=("clay", "sandy")[seed % 2],
        effects={law: LAWS[law]},
        runs=runs + FRESH,
        duration_s=20.0,
        seed=seed,
        draw_soil=True,
    )
    processed = tuple(process(*simulated_roles(options, index)) for index in range(options.runs))
    soil = options.laboratory_soil
    first = Campaign("first", processed[:runs], options.wheel, soil, prior_of(soil, options.terrain))
    linearised = linearise_campaigns([first], DiagnosisOptions())
    keys = linearised.best.keys
    gain, _ = held_out(linearised)
    if gain is None or not keys:
        return None
    fits = fit_sets(linearised, [(), keys], starts="one")
    later = replace(first, runs=processed[runs:])
    before, after = (squared_error(fits[chosen], later) for chosen in ((), keys))
    low, high = gain.interval95
    return {
        "runs": runs,
        "reduction": gain.reduction_percent,
        "low": low,
        "high": high,
        "fresh": 100.0 * (1.0 - np.sqrt(after / before)),
    }


def squared_error(fit: SetFit, later: Campaign) -> float:
    """Return the sum of squared errors of the drawbar pull of runs that the fit has not seen, above the threshold."""
    samples = samples_of(later)
    [point], [part] = fit.problem.points(fit.estimate), fit.problem.parts
    said = simulated(part.simulation, samples, replace(point, speed_mps=np.zeros(len(samples))))
    pull = said[part.frozen.channels.index("dp")]
    judged = np.asarray(samples.conditions.slip) >= FitOptions().threshold_on(later.soil)
    error = (samples.measured["dp"] - pull)[judged]
    return float(np.nansum(error**2))


def main() -> None:
    """Add what is missing of campaigns 0 to n - 1, and print how many intervals hold."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    done = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    for seed in range(count):
        if str(seed) not in done:
            found = one(seed)
            done[str(seed)] = found and {key: float(f"{value:.4g}") for key, value in found.items()}
            lines = ",\n".join(f'"{key}": {json.dumps(value)}' for key, value in done.items())
            RESULTS.write_text("{\n" + lines + "\n}\n")
            print(seed, done[str(seed)], flush=True)
    for runs in (*RUNS, None):
        known = [x for x in done.values() if x and runs in (None, x["runs"])]
        held = sum(x["low"] <= x["fresh"] <= x["high"] for x in known)
        least = beta.ppf(0.025, held, len(known) - held + 1)
        print(f"{runs or 'all'} runs: {held} of {len(known)} hold (at least {least:.3f})")


if __name__ == "__main__":
    main()
