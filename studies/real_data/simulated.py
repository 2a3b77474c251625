"""How often the machine is right on simulated tables of this size: ``python -m studies.real_data.simulated [tables]``.

Soils are drawn from terrain.toml's covariance, repeats scatter as the real ones do, and the truth has an error of form
of its own at every speed. Simulator and engine share their physics: this shows the machine, not nature.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from daq import TerrainConfig, load_toml
from model.diagnosis import Bench, DiagnosisOptions, diagnose_bench
from model.diagnosis.single_wheel import SoilCoordinates
from model.effects import EFFECTS
from model.fit import Observations
from model.wheel_soil import Conditions, Wheel, WheelSoilModel, prior_of, soil_from_terrain
from studies.real_data.study import HERE

SLIPS = np.repeat([0.0, 0.23, 0.5, 0.75, 0.9], 3)
SCATTER = {"dp": 0.3, "z": 0.6e-3}
FORM = {"dp": 0.3, "z": 0.6e-3}
TRUTHS: dict[str, Mapping[str, Mapping[str, float]]] = {
    "nothing": {},
    "interface friction": {"interface_friction": {"ln_mu": -0.5}},
    "slip sinkage": {"vasilev": {"H_m": 0.013}},
    "both": {"vasilev": {"H_m": 0.013}, "interface_friction": {"ln_mu": -0.5}},
}
CHANNELS = (("dp",), ("dp", "z"))


def table(truth: Mapping[str, Mapping[str, float]], rng: np.random.Generator) -> Bench | None:
    """Return a simulated table; None where the drawn soil does not carry the wheel."""
    terrain = load_toml(HERE / "terrain.toml", TerrainConfig)
    wheel, soil = Wheel(0.058, 0.05), soil_from_terrain(terrain)
    load = 25.0 * (1.0 + 0.05 * rng.standard_normal(len(SLIPS)))
    nothing = np.zeros(len(SLIPS))
    rows = Observations(
        SLIPS,
        load,
        nothing,
        nothing * np.nan,
        nothing,
        nothing,
        nothing,
        nothing,
        np.unique(SLIPS, return_inverse=True)[1],
        (),
        True,
    )
    bench = Bench("simulated", rows, wheel, soil, prior_of(soil, terrain), {}, "smooth")
    coordinates = SoilCoordinates.of(bench)
    values, _ = coordinates.values(rng.standard_normal((1, len(coordinates.names))))
    drawn = {name: float(v[0]) for name, v in coordinates.soil_parameters(values, wheel.width_m).items()}
    effects = {name: v for key, own in truth.items() for name, v in EFFECTS[key].keyed(own).items()}
    model = WheelSoilModel(wheel, soil, [EFFECTS[key] for key in truth])
    said = model.predict(Conditions(SLIPS, load), drawn | effects)
    if not np.isfinite(said.drawbar_pull_n).all():
        return None

    def measured(true: np.ndarray, channel: str) -> np.ndarray:
        form = FORM[channel] * rng.standard_normal(5)[rows.run]
        return true + form + SCATTER[channel] * rng.standard_normal(len(SLIPS))

    pull, sinkage = measured(said.drawbar_pull_n, "dp"), measured(said.sinkage_m, "z")
    return replace(bench, rows=replace(rows, drawbar_pull_n=pull, sinkage_m=sinkage))


def main(count: int) -> None:
    """Print verdicts and named families of `count` tables of each truth."""
    for name, truth in TRUTHS.items():
        verdicts = {channels: Counter[str]() for channels in CHANNELS}
        rng, done = np.random.default_rng(sum(map(ord, name))), 0
        while done < count:
            bench = table(truth, rng)
            if bench is None:
                continue
            done += 1
            for channels in CHANNELS:
                found = diagnose_bench([bench], DiagnosisOptions(channels=channels, most_causes=2))
                named = " and ".join(sorted(cause.name for cause in found.causes)) if found.verdict == "named" else ""
                top = f" {found.causes[0].name} first" if found.verdict == "one_of" else ""
                verdicts[channels][f"{found.verdict} {named}{top}".strip()] += 1
            print(f"{name}, {done}:", {",".join(c): dict(v) for c, v in verdicts.items()}, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
