"""Every number and figure of docs/real_data.md: ``WHEELSOIL_DATA=... python -m studies.real_data.study``.

Writes studies/real_data/numbers.json; with a Chromium also the figures in docs/images.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from daq import FloatArray
from model.diagnosis import Bench, Diagnosis, DiagnosisOptions, diagnose_bench
from model.diagnosis.core import rms
from model.diagnosis.single_wheel import (
    OWN,
    BenchProblem,
    CauseUse,
    Hypothesis,
    Weighing,
    WheelPair,
    compare_wheels,
    driven_rows,
    library,
    parameter_draws,
    predict_held_out,
    skid_law,
    weigh,
)
from model.diagnosis.single_wheel import noise as bench_noise
from model.effects.catalogue import EFFECTS
from wheelsoil.to_json import to_json
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.workflows import Files, bench_of, read_bench

HERE = Path(__file__).parent
TABLE = ("cmu-terramech-testbed", "wheel_trials.csv")
RENAME = (
    "vertical_load_n=load_N",
    "drawbar_pull_n=drawbar_pull_N",
    "sinkage_m=sinkage_mm*0.001",
    "group=Vry_nominal_mm_s",
)
LOCAL_TIME_S = 18_000
"""The kinematics are stamped in local time, the forces in UTC."""
WHEELS = {"smooth": ("smooth", "smooth.toml"), "grousered": ("grouser", "grousered.toml")}
CHANNELS = {"dp": ("dp",), "dp,z": ("dp", "z")}
SETS = (
    "",
    "vasilev",
    "lyasko",
    "ding",
    "interface_friction",
    "stress_peak_shift",
    "shear_softening",
    "vasilev+interface_friction",
    "ding+interface_friction",
    "lyasko+interface_friction",
    "vasilev+stress_peak_shift",
)


def bench(wheel: str, name: str = "") -> Bench:
    """Return the straight runs of a wheel, 27 rows: nine speeds, three repeats."""
    kind, vehicle = WHEELS[wheel]
    files = read_bench(
        Path(os.environ["WHEELSOIL_DATA"], *TABLE),
        Files(vehicle=HERE / vehicle, terrain=HERE / "terrain.toml"),
        rename=RENAME,
        where=(f"wheel={kind}", "beta_deg=0"),
    )
    return replace(bench_of(files), name=name or wheel)


def plate_tests(*, whole: bool = False) -> list[tuple[str, FloatArray, FloatArray, float]]:
    """Return run, sinkage in m, force in N and radius in m of every plate test.

    In the authors' window and from their zeros, or the whole recording as it is.
    """
    source = Path(os.environ["WHEELSOIL_DATA"], "cmu-terramech-testbed", "pressure_sinkage")
    with (source / "index.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["body"].startswith("circular plate")]
    found = []
    for row in rows:
        kinematics = np.loadtxt(source / f"{row['run']}.txt", delimiter=",")
        t_s, force = np.loadtxt(source / f"{row['run']}_ft.csv", delimiter=",", skiprows=1, usecols=(0, 3)).T
        time = kinematics[:, 6] + LOCAL_TIME_S - float(row["bag_start_unix"])
        start, end = (t_s[0], t_s[-1]) if whole else (float(row["window_start_s"]), float(row["window_end_s"]))
        kept = (time >= start) & (time <= end)
        load = -np.interp(time[kept], t_s, force) - (0.0 if whole else float(row["Fz_offset_N"]))
        sinkage = -kinematics[kept, 4] * 1e-3 + (0.0 if whole else float(row["z_zero_mm"]) * 1e-3)
        found.append((row["run"], sinkage, load, float(row["body"].split()[2]) / 2e3))
    return found


def weighed(one: Bench, channels: Sequence[str], effects: Sequence[str] = (), most: int = 2, seed: int = 0) -> Weighing:
    """Weigh the sets of causes of a driven wheel."""
    problem = BenchProblem.of([driven_rows(one)], channels)
    return weigh(problem, library(problem, effects or tuple(EFFECTS)).uses, most, np.random.default_rng(seed))


def sets_table(weighing: Weighing) -> dict[str, dict[str, float]]:
    """Return evidence, misfit and left-out errors of some sets."""
    rows: dict[str, dict[str, float]] = {}
    for name in SETS:
        wanted: Hypothesis = tuple(CauseUse(key) for key in name.split("+") if key)
        found = next((w for w in weighing.sets if set(w.hypothesis) == set(wanted)), None)
        if found is None:
            continue
        left_out = predict_held_out(weighing.problem, found.optima, np.random.default_rng(1))
        p, ungated = (float(x[weighing.sets.index(found)]) for x in (weighing.probabilities, weighing.ungated))
        rows[name or "wong"] = {
            "log_evidence": found.log_evidence,
            "misfit": found.misfit,
            "probability": p,
            "ungated": ungated,
            "left_out_dp_n": rms(left_out, "dp"),
            "left_out_z_mm": 1e3 * rms(left_out, "z"),
            "left_out_log_likelihood": float(sum(fold.log_likelihood for fold in left_out)),
        }
    return rows


def families(weighing: Weighing) -> dict[str, tuple[float, float]]:
    """Return the probability of every family, with and without the gate."""
    names = {family for w in weighing.sets for family in w.families}
    both = {n: (weighing.of_family(n), weighing.of_family(n, weighing.ungated)) for n in names}
    return dict(sorted(both.items(), key=lambda item: -item[1][0]))


def slip_sinkage(one: Bench) -> dict[str, Any]:
    """Return H of Vasil'ev's law by drawbar pull alone and with sinkage: as the only cause, and over all sets."""
    found: dict[str, Any] = {}
    for name, channels in CHANNELS.items():
        for how, effects in (("alone", ("vasilev",)), ("over all sets", ())):
            weighing = weighed(one, channels, effects)
            estimate = parameter_draws(weighing, CauseUse("vasilev"), np.random.default_rng(0))["H_m"].estimate(
                "H", "m"
            )
            found[f"{name}, {how}"] = {
                "mm": 1e3 * estimate.value,
                "interval95_mm": [1e3 * x for x in estimate.interval95],
            }
    return found


def sensitivity(one: Bench) -> dict[str, dict[str, float]]:
    """Return what the choices that nobody can prove do to the answer."""

    def answer(changed: Bench, channels: Sequence[str]) -> dict[str, float]:
        weighing = weighed(changed, channels)
        names = ("slip_sinkage", "interface_friction", "stress_peak_shift")
        values = {name: weighing.of_family(name) for name in names}
        return {**values, "slip_sinkage_ungated": weighing.of_family("slip_sinkage", weighing.ungated)}

    found = {}
    usual = bench_noise.FORM_PER_SCATTER
    for channels in CHANNELS.values():
        label = ",".join(channels)
        for factor in (1.0, 2.0, 3.0, 4.0):
            bench_noise.FORM_PER_SCATTER = factor
            found[f"{label}: error of form {factor:g} x scatter"] = answer(one, channels)
        bench_noise.FORM_PER_SCATTER = usual
        larger = replace(one, wheel=replace(one.wheel, radius_m=0.0625))
        found[f"{label}: radius 62.5 mm"] = answer(larger, channels)
        prior = one.soil_prior
        for name, factor in (("half", 0.25), ("twice", 4.0)):
            other = replace(one, soil_prior=replace(prior, covariance=prior.covariance * factor))
            found[f"{label}: spread of the soil {name}"] = answer(other, channels)
    return found


def transfer_numbers(found: WheelPair) -> dict[str, Any]:
    """Return what became of the smooth wheel's calibration on the grousered one."""
    own_h = [
        w for w in found.both.sets if CauseUse("vasilev", OWN) in w.hypothesis and CauseUse("vasilev") in w.hypothesis
    ]
    numbers: dict[str, Any] = {
        "p_value": found.p_value,
        "own_cause": found.own_cause,
        "own_cause_ungated": found.own_cause_ungated,
        "families": found.families(),
        "families_ungated": found.families(gated=False),
        "slip": found.slip,
        "difference": found.difference,
        "threshold": found.both.threshold,
        "sets": [
            {
                "causes": [u.key + (" (own)" if u.table is not None else "") for u in w.hypothesis],
                "probability": float(p),
                "log_evidence": w.log_evidence,
                "misfit": w.misfit,
            }
            for p, w in list(zip(found.both.probabilities, found.both.sets, strict=True))[:12]
        ],
        "least_misfit_without_own": min(
            w.misfit for w in found.both.sets if not any(u.table is not None for u in w.hypothesis)
        ),
    }
    if own_h:
        chosen = replace(found.both, sets=tuple(w for w in own_h if w.posterior is not None))
        if chosen.sets:
            for use, name in ((CauseUse("vasilev", OWN), "own"), (CauseUse("vasilev"), "shared")):
                draws = parameter_draws(chosen, use, np.random.default_rng(0))["H_m"].estimate("H", "m")
                numbers[f"H_{name}_mm"] = [1e3 * draws.value, *(1e3 * x for x in draws.interval95)]
    return numbers


def study() -> tuple[dict[str, Any], dict[str, Diagnosis], dict[str, WheelPair]]:
    """Return all numbers, the diagnoses and the transfers."""
    smooth, grousered = bench("smooth"), bench("grousered")
    diagnoses = {
        name: diagnose_bench([smooth], DiagnosisOptions(channels=channels, next_run=True))
        for name, channels in CHANNELS.items()
    }
    transfers = {
        name: compare_wheels(smooth, grousered, DiagnosisOptions(channels=channels))
        for name, channels in CHANNELS.items()
    }
    weighings = {name: weighed(smooth, channels) for name, channels in CHANNELS.items()}
    numbers = {
        "diagnoses": {name: diagnosis_json(d) for name, d in diagnoses.items()},
        "sets": {name: sets_table(w) for name, w in weighings.items()},
        "families": {name: families(w) for name, w in weighings.items()},
        "slip_sinkage": slip_sinkage(smooth),
        "transfer": {name: transfer_numbers(t) for name, t in transfers.items()},
        "skid": {name: vars(skid_law(b)) for name, b in (("smooth", smooth), ("grousered", grousered))},
        "sensitivity": sensitivity(smooth),
    }
    return numbers, diagnoses, transfers


if __name__ == "__main__":
    found, *_ = study()
    for one in found["diagnoses"].values():
        one.pop("stages_s")
    rounded = json.loads(to_json(found), parse_float=lambda text: float(f"{float(text):.4g}"))
    (HERE / "numbers.json").write_text(json.dumps(rounded, indent=1) + "\n", encoding="utf-8")
