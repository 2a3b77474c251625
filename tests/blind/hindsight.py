"""What a saved model of several sets predicts, beside the set that turns out best.

PYTHONPATH=tests python -m blind.hindsight --out out/blind/block-11 --block 11

Of every `one_of` campaign of a block the last run is left out and the others are diagnosed anew. Where several sets
remain possible, their model predicts the run's drawbar pull at its measured slip: averaged as a file of the model does,
and by each set alone. The best of these is known in hindsight only.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from blind.engine import campaign_from_channels
from blind.jsonl import append_line
from blind.mix import WHOLE, Case, cases
from blind.study import ONE_THREAD, by_name

KINDS = ("single", "pair", "calibration")


def predicted(case: Case, truth: dict[str, Any]) -> dict[str, Any]:
    """Return R0 of the last run's drawbar pull, in N: averaged, of each set alone, and of the laboratory's soil."""
    from model import averaged_model
    from model.diagnosis import DiagnosisOptions, diagnose
    from model.fit import EXTENDED, FitOptions, fit_models

    sized = [(member["key"], member["size"]) for member in truth["members"] if "size" in member]
    campaign = campaign_from_channels(case.day, sized)
    *known, last = campaign.runs
    average = diagnose([replace(campaign, runs=tuple(known))], DiagnosisOptions(average=True)).average
    if average is None:
        return {"name": case.name}
    model = averaged_model(campaign.wheel, campaign.soil, average, campaign.ground)

    def error(**other: Any) -> float:
        options = FitOptions(models=("wong",), extended=replace(model, **other))
        fits = {fit.name: fit for fit in fit_models([last], campaign.wheel, campaign.soil, options).models}
        errors["wong"] = fits["wong"].criteria["dp"].R0_N
        return fits[EXTENDED].criteria["dp"].R0_N

    errors: dict[str, float] = {}
    averaged = error()
    alone = {
        "+".join(effect.key for effect in member.effects) or "no cause": error(
            sets=(replace(member, probability=1.0),), rest_probability=0.0
        )
        for member in model.sets
    }
    return {"name": case.name, "averaged": averaged, "alone": alone, "laboratory": errors["wong"]}


def summary(entries: list[dict[str, Any]]) -> str:
    """Return how the average compares, as lines."""
    done = [entry for entry in entries if "averaged" in entry]
    best = np.array([min(entry["alone"].values()) for entry in done])
    first = np.array([next(iter(entry["alone"].values())) for entry in done])
    averaged = np.array([entry["averaged"] for entry in done])
    laboratory = np.array([entry["laboratory"] for entry in done])
    return "\n".join(
        f"R0 of the average over that of {what}: median {np.median(ratio):.3f}, "
        f"{np.quantile(ratio, 0.1):.3f} to {np.quantile(ratio, 0.9):.3f} in four of five, n {len(done)}"
        for what, ratio in (
            ("its best set in hindsight", averaged / best),
            ("its most probable set", averaged / first),
            ("the laboratory's soil", averaged / laboratory),
        )
    )


def main() -> None:
    """Predict the last run of every `one_of` campaign of a block."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of a block")
    parser.add_argument("--block", type=int, default=-1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    truths, answers = by_name(options.out / "truth.jsonl"), by_name(options.out / "answers.jsonl")
    at = options.out / "hindsight.jsonl"
    done = by_name(at)
    os.environ.update(ONE_THREAD | {"WHEELSOIL_CACHE": "off"})
    with ProcessPoolExecutor(options.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        left = [
            pool.submit(predicted, case, truths[case.name])
            for case in cases(replace(WHOLE, block=options.block))
            if case.kind in KINDS and case.name not in done and answers.get(case.name, {}).get("verdict") == "one_of"
        ]
        for future in as_completed(left):
            append_line(at, future.result())
    print(summary(list(by_name(at).values())))


if __name__ == "__main__":
    main()
