"""Every number of docs/paper.md, from the paper's tables, its equations and the sample recordings.

``python -m studies.paper.study`` writes the page, ``--check`` says whether it holds, and ``python -m
studies.paper.figures`` draws its figures.
"""

from __future__ import annotations

import argparse
import re
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from daq import FloatArray
from model.fit import MODELS, CampaignFit, Criteria, ModelFit
from model.wheel_soil import SOILS, Reading
from processing import ProcessedRun, ProcessOptions
from studies.paper import published
from studies.paper.published import STATIC_LOAD_N, WHEEL, Published
from wheelsoil.workflows import FitChoices, fit_runs, open_and_process

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "paper.md"
NAMES = {"wong": "Wong", "vasilev": "Vasil'ev", "lyasko": "Lyasko", "ding": "Ding"}
LIKE_THE_PAPERS = {"clay": "run-2", "sandy": "run-3"}
"""Runs with about the added load of the paper's: 300 kg for its 3 kN, 500 kg for its 5 kN, over four wheels."""
READINGS: dict[str, Reading] = {"load-consistent": "balanced", "as published": "literal"}
TOLERANCE = 2e-3
"""Relative, of a number on the page: another processor rounds another way."""


@lru_cache
def fitted(
    soil: str, run: str, reading: Reading, channels: tuple[str, ...] = ("dp",)
) -> tuple[CampaignFit, tuple[ProcessedRun, ...]]:
    """Return the fit to a sample campaign, or to one of its runs."""
    folder = ROOT / "recordings" / soil
    processed = open_and_process([folder / f"{run}.mcap" if run else folder], ProcessOptions())
    return fit_runs(processed, FitChoices(reading, channels), None), tuple(run for _, run in processed)


def samples(
    model: ModelFit, runs: tuple[ProcessedRun, ...], threshold: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return slip, measured and predicted pull of the samples that the criteria are of."""
    slip = np.concatenate([run.slip[run.used] for run in runs])
    measured = np.concatenate([run.drawbar_pull_n[run.used] for run in runs])
    predicted = np.concatenate([p.drawbar_pull_n[r.used] for p, r in zip(model.predictions, runs, strict=True)])
    counts = slip >= threshold
    return slip[counts], measured[counts], predicted[counts]


def affine(soil: str) -> dict[str, float]:
    """Return R0 of Wong's model on a sample campaign, plain and with the best offset and gain; N."""
    fit, runs = fitted(soil, "", "balanced")
    _, measured, predicted = samples(fit.model("wong"), runs, fit.slip_threshold)
    gain, offset = np.polyfit(predicted, measured, 1)
    plain, left = (published.rms(measured - p) for p in (predicted, gain * predicted + offset))
    return {"plain": plain, "left": left, "share": 100 * (1 - (left / plain) ** 2), "gain": gain, "offset": offset}


def scores(soil: str, run: str, reading: Reading) -> dict[str, dict[str, Criteria]]:
    """Return the criteria of every model and channel."""
    return {m.name: m.criteria for m in fitted(soil, run, reading)[0].models}


def carried(soil: str, reading: Reading) -> dict[str, tuple[float, float]]:
    """Return the least and the largest load of Eq. 7 over the measured one."""
    return {m.name: (m.load_ratio.lowest, m.load_ratio.highest) for m in fitted(soil, "", reading)[0].models}


def searched(paper: Published) -> dict[str, Any]:
    """Return what the search over wheels and constant loads finds."""
    found = list(published.grid(paper))
    allowed = published.bounds(paper)
    without_ding = [one for one in found if one.fits(allowed, ("wong", "vasilev"))]
    loaded = [one for one in found if one.load_n == STATIC_LOAD_N + paper.added_load_n]
    return {
        "tried": len(found),
        "fit": sum(one.fits(allowed, tuple(one.R2)) for one in found),
        "without_ding": len(without_ding),
        "heaviest_kn": 1e-3 * max((one.load_n for one in without_ding), default=np.nan),
        "spread": max(float(one.pull_n.std()) for one in found if one.pull_n.min() > 0),
        "least_at_full_load": min(one.distance_n["wong"] for one in loaded),
    }


def of_soil(paper: Published) -> dict[str, Any]:
    """Return everything of one soil that the page prints."""
    ours = SOILS[paper.name]
    loads = (STATIC_LOAD_N, STATIC_LOAD_N + paper.added_load_n / 4, STATIC_LOAD_N + paper.added_load_n)
    return {
        "paper": paper,
        "same_soil": np.allclose(
            [
                ours.cohesion_pa / 1e3,
                np.degrees(ours.friction_angle_rad),
                ours.shear_modulus_m,
                ours.sinkage_exponent,
                ours.cohesive_modulus / 1e3,
                ours.frictional_modulus / 1e3,
            ],
            list(paper.soil.values()),
        ),
        "equations": published.equations(paper),
        "equivalents": [published.equivalents(paper, load) for load in loads],
        "affine_share": published.affine_share(paper),
        "spread": published.largest_spread_n(paper),
        "bounds": published.bounds(paper),
        "at_load": [published.at_constant_load(paper, WHEEL, load) for load in loads],
        "searched": searched(paper),
        "affine": affine(paper.name),
        "run": LIKE_THE_PAPERS[paper.name],
        "of_run": scores(paper.name, LIKE_THE_PAPERS[paper.name], "balanced"),
        "readings": {name: scores(paper.name, "", reading) for name, reading in READINGS.items()},
        "carried": {name: carried(paper.name, reading) for name, reading in READINGS.items()},
        "fit": fitted(paper.name, "", "balanced")[0],
        "with_torque": fitted(paper.name, "", "literal", ("dp", "t"))[0],
    }


def page() -> str:
    """Return the page."""
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters["g"] = lambda value, digits=3: _plain(float(value), digits)
    template = environment.from_string((HERE / "page.md.j2").read_text(encoding="utf-8"))
    papers = published.read()
    return template.render(
        clay=of_soil(papers["clay"]),
        sandy=of_soil(papers["sandy"]),
        models=MODELS,
        names=NAMES,
        wheel=WHEEL,
        misaligned_n=11e3 * np.sin(np.radians(1.0)),
    )


def _plain(value: float, digits: int) -> str:
    """Return a number with at least that many significant digits, never with an exponent."""
    if not np.isfinite(value):
        return "-"
    if not value:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    places = max(digits - 1 - int(np.floor(np.log10(abs(rounded)))), 0)
    return f"{value:,.{places}f}"


_NUMBER = re.compile(r"-?\d[\d,]*(?:\.\d+)?")


def differences(old: str, new: str) -> list[str]:
    """Return the lines whose words differ, or whose numbers differ by more than `TOLERANCE` and the last digit."""
    before, after = old.splitlines(), new.splitlines()
    if len(before) != len(after):
        return [f"{len(before)} lines, expected {len(after)}"]
    return [f"- {b}\n+ {a}" for b, a in zip(before, after, strict=True) if not _alike(b, a)]


def _alike(before: str, after: str) -> bool:
    if _NUMBER.sub("#", before) != _NUMBER.sub("#", after):
        return False
    pairs = zip(_NUMBER.findall(before), _NUMBER.findall(after), strict=True)
    return all(_near(b.replace(",", ""), a.replace(",", "")) for b, a in pairs)


def _near(before: str, after: str) -> bool:
    last = 10.0 ** -len(after.partition(".")[2]) if "." in after else 0.0
    return abs(float(before) - float(after)) <= max(TOLERANCE * abs(float(after)), 1.001 * last)


def main() -> int:
    """Write or check the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only say whether docs/paper.md holds")
    options = parser.parse_args()
    new = page()
    if not options.check:
        PAGE.write_text(new, encoding="utf-8")
        return 0
    found = differences(PAGE.read_text(encoding="utf-8"), new)
    print("\n".join(found) or "docs/paper.md holds")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
