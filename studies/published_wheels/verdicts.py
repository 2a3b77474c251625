"""Verdicts on published single-wheel tests: ``WHEELSOIL_DATA=... python -m studies.published_wheels.verdicts``.

Every wheel by its drawbar pull alone and by all that was measured; with one-sigmas as read off a figure (.5 N,
.5 mm, .1 N m; CMU: its repeats), the prior one-sigma of c2 of stress_peak_shift at .1 and .3, and an error of form of 1
and 2.5 %. Writes studies/published_wheels/verdicts.json and prints the tables of docs/published_wheels.md.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from model.diagnosis import Bench, Diagnosis, DiagnosisOptions, diagnose_bench
from model.effects import EFFECTS
from studies.real_data.study import bench as cmu_bench
from wheelsoil.workflows import TableFiles, bench_of, read_benches

HERE = Path(__file__).parent
FILES = HERE.parents[1] / "tests" / "golden" / "published"
RENAME = ("drawbar_pull_n=meas_drawbar_pull_n", "sinkage_m=meas_sinkage_m", "driving_torque_nm=meas_torque_nm")
READ_OFF = {"dp": 0.5, "t": 0.1, "z": 0.5e-3}
"""One-sigma of a value that is read off a figure, N, N m, m."""
PULL, ALL = ("dp",), ("dp", "t", "z")
C2_SIGMAS, FORMS = (0.1, 0.3), (0.01, 0.025)
SHOWN = 0.05
LEADING = 3
"""How many candidates the page shows; verdicts.json has all above `SHOWN`."""
_TURNED = ("half", "twice")
WHEELS = {
    "ding smooth": ("source=ding2011,grouser_height_m=0.0", "ding-smooth.toml", "ding-soil.toml"),
    "ding lugged": ("source=ding2011,grouser_height_m=0.01", "ding-lugged.toml", "ding-soil.toml"),
    "hurrell, lugs undeclared": ("source=hurrell2025_rashid1", "", "hurrell-soil.toml"),
}


def published_bench(name: str) -> Bench:
    """Return a published wheel's rows with the errors of a figure; of Hurrell's wheel nothing says that it has lugs."""
    where, wheel, soil = WHEELS[name]
    table = Path(os.environ["WHEELSOIL_DATA"], "published-single-wheel", "single_wheel.csv")
    sizes = () if wheel else ("radius_m=wheel_radius_m", "width_m=wheel_width_m")
    files = TableFiles((str(FILES / wheel),) if wheel else (), (FILES / soil,))
    (found,) = read_benches([table], files, rename=(*RENAME, *sizes), where=(where,))
    return replace(bench_of(found), name=name, sigmas=dict(READ_OFF))


@contextmanager
def prior_of_c2(sigma: float) -> Iterator[None]:
    """Give c2 of stress_peak_shift another prior one-sigma."""
    effect = EFFECTS["stress_peak_shift"]
    usual = effect.parameters
    effect.parameters = tuple(replace(p, prior_scale=sigma) if p.name == "c2" else p for p in usual)
    try:
        yield
    finally:
        effect.parameters = usual


def facts(found: Diagnosis) -> dict[str, Any]:
    """Return what a verdict says."""
    return {
        "verdict": found.verdict,
        "causes": [cause.name for cause in found.causes],
        "candidates": {c.name: c.probability for c in found.candidates if c.probability >= SHOWN},
        "lack_of_fit": found.adequacy.statistic if found.adequacy else None,
        "threshold": found.adequacy.threshold if found.adequacy else None,
        "log_likelihood_gain": found.gain.log_likelihood_gain if found.gain else None,
        "turned": dict(found.grounds.form_matters.values) if found.grounds.form_matters else {},
    }


def study() -> dict[str, dict[str, Any]]:
    """Return the verdicts, by wheel, channels and assumptions."""
    found: dict[str, dict[str, Any]] = {}
    for name, channels, c2, form in product(WHEELS, (PULL, ALL), C2_SIGMAS, FORMS):
        with prior_of_c2(c2):
            options = DiagnosisOptions(channels=channels, error_of_form=form)
            key = f"{name}: {','.join(channels)}"
            found.setdefault(key, {})[f"c2 {c2:g}, form {100 * form:g} %"] = facts(
                diagnose_bench([published_bench(name)], options)
            )
            print(key, c2, form, found[key][f"c2 {c2:g}, form {100 * form:g} %"], flush=True)
    for name, channels, c2 in product(("smooth", "grousered"), (PULL, ALL), C2_SIGMAS):
        with prior_of_c2(c2):
            key = f"cmu {name}: {','.join(channels)}"
            found.setdefault(key, {})[f"c2 {c2:g}, repeats"] = facts(
                diagnose_bench([cmu_bench(name)], DiagnosisOptions(channels=channels))
            )
            print(key, c2, found[key][f"c2 {c2:g}, repeats"], flush=True)
    return found


def table(found: dict[str, dict[str, Any]]) -> list[str]:
    """Return the rows of the page's table: one a verdict, with the figures of the last assumption that gives it."""
    lines = [
        "| rows and channels | assumed | verdict | probabilities, % | lack of fit, most probable set (threshold) |",
        "|---|---|---|---|---|",
    ]
    for name, cases in found.items():
        alike: dict[str, list[str]] = {}
        for assumed, one in cases.items():
            alike.setdefault(_verdict(one), []).append(assumed)
        for verdict, assumptions in alike.items():
            one = cases[assumptions[-1]]
            leading = list(one["candidates"].items())[:LEADING]
            likely = ", ".join(f"{n.replace('_', ' ')} {100 * p:.0f}" for n, p in leading)
            fit = f"{one['lack_of_fit']:.1f} ({one['threshold']:.1f})"
            lines.append(f"| {name} | {' or '.join(assumptions)} | {verdict} | {likely} | {fit} |")
    return lines


def _verdict(one: dict[str, Any]) -> str:
    causes = f" {', '.join(c.replace('_', ' ') for c in one['causes'])}" if one["causes"] else ""
    turned = "".join(f"; {how}: {v[0].replace('_', ' ')}" for how, v in one["turned"].items() if how in _TURNED)
    if "share" in one["turned"]:
        names = ", ".join(f.replace("_", " ") for f in one["turned"]["families"])
        turned = f"; adequate at {100 * one['turned']['share']:.2g} %: {names}"
    return f"{one['verdict'].replace('_', ' ')}{causes}{turned}"


if __name__ == "__main__":
    everything = json.loads(json.dumps(study()), parse_float=lambda text: float(f"{float(text):.3g}"))
    print("\n".join(table(everything)))
    (HERE / "verdicts.json").write_text(json.dumps(everything, indent=1) + "\n", encoding="utf-8")
