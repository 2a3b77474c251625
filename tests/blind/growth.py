"""Does a true name stay when runs are added? 24 campaigns of `wheelsoil simulate`, diagnosed with 6 to 200 runs.

PYTHONPATH=tests python -m blind.growth --jobs 1                     all of it, resumable
PYTHONPATH=tests python -m blind.growth --seeds 7 3 --counts 6 24    some campaigns with few runs
PYTHONPATH=tests python -m blind.growth --seeds --report docs/growth_results.md   only the page

Each campaign is written as frames, read and processed as `wheelsoil diagnose FOLDER` does; a diagnosis of n runs takes
the first n. One JSON line for each seed and n.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

from blind.jsonl import append_line, read_lines
from blind.provenance import engine_of, engine_words

if TYPE_CHECKING:
    from model.diagnosis import Campaign, Diagnosis

COUNTS = (6, 24, 100, 200)
DURATION_S = 15.0
SOILS = ("clay", "sandy")
STAGES = ("samples", "noise", "evidence", "adequacy", "bagging", "final")
"""Of every diagnosis; "held_out" also, unless it is `unexplained`."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "WHEELSOIL_CACHE": "off"}

Line = dict[str, Any]


@dataclass(frozen=True)
class GrowingCampaign:
    """One campaign: `effect` as ``--effect`` takes it, the family and the parameter whose interval is judged."""

    seed: int
    effect: str = ""
    family: str = ""
    parameter: str = ""
    value: float = 0.0

    @property
    def soil(self) -> str:
        """Clay and sandy by turns."""
        return SOILS[self.seed % 2]

    @property
    def draw_soil(self) -> bool:
        """The field differs from the laboratory in half of the campaigns."""
        return self.seed % 4 >= 2

    @property
    def brakes(self) -> Literal["released"] | None:
        """Released where a standstill has to show the cause, for it to be named; else drawn."""
        return "released" if self.key in ("torque_zero", "crosstalk") else None

    @property
    def key(self) -> str:
        """Key of the effect."""
        return self.effect.partition(":")[0]


_HIDDEN = (
    ("vasilev:H_m=0.03", "slip_sinkage", "H_m", 0.03),
    ("vasilev:H_m=0.08", "slip_sinkage", "H_m", 0.08),
    ("lyasko:m1=0.3,m2=0.05", "slip_sinkage", "p", 0.35),
    ("lyasko:m1=0.6,m2=0.03", "slip_sinkage", "p", 0.63),
    ("ding:n1=0.2", "slip_sinkage", "n1", 0.2),
    ("ding:n1=0.3", "slip_sinkage", "n1", 0.3),
    ("vasilev:H_m=0.05", "slip_sinkage", "H_m", 0.05),
    ("lyasko:m1=0.3,m2=0.05", "slip_sinkage", "p", 0.35),
    ("rate_stiffness:exponent=0.1", "rate_stiffness", "exponent", 0.1),
    ("track_drift:log_stiffness_half_span=0.2", "track_drift", "log_stiffness_half_span", 0.2),
    ("skid_sinkage:H2_m=0.4", "skid_sinkage", "H2_m", 0.4),
    ("grouser:height_m=0.03", "grouser", "height_m", 0.03),
    ("wheel_radius:relative=0.03", "wheel_radius", "relative", 0.03),
    ("speed_latency:extra_delay_s=0.15", "speed_latency", "extra_delay_s", 0.15),
    ("speed_bias:offset_mps=0.1", "speed_bias", "offset_mps", 0.1),
    ("torque_zero:offset_nm=60", "torque_zero", "offset_nm", 60.0),
    ("drawbar_pull_gain:relative=0.15", "drawbar_pull_gain", "relative", 0.15),
    ("torque_gain:relative=0.08", "torque_gain", "relative", 0.08),
    ("crosstalk:coefficient=0.03", "crosstalk", "coefficient", 0.03),
    ("wheel_radius:relative=-0.03", "wheel_radius", "relative", -0.03),
    *(("", "", "", 0.0),) * 4,
)
"""8 slip sinkage, 4 other soil, 8 measurement, 4 without a cause; sizes that 24 runs of 15 s show."""

CAMPAIGNS = tuple(GrowingCampaign(seed, *hidden) for seed, hidden in enumerate(_HIDDEN))


def whole_campaign(growing: GrowingCampaign, runs: int) -> Campaign:
    """Simulate a campaign's first runs, write them as frames and read them as `wheelsoil diagnose` does."""
    from daq.runs import open_runs
    from processing import ProcessOptions
    from wheelsoil.simulation import SimulationOptions, parse_effect, simulate_campaign
    from wheelsoil.workflows import campaigns_of, process_runs

    options = SimulationOptions(
        soil=growing.soil,
        seed=growing.seed,
        runs=runs,
        duration_s=DURATION_S,
        draw_soil=growing.draw_soil,
        brakes=growing.brakes,
        effects=dict([parse_effect(growing.effect)] if growing.effect else []),
    )
    with TemporaryDirectory(prefix="growth-") as name:
        folder = Path(name) / "campaign"
        simulate_campaign(folder, options)
        processed = process_runs(open_runs([folder]), ProcessOptions(purpose="diagnose"))
        [campaign] = campaigns_of([folder], processed)
    return replace(campaign, runs=tuple(sorted(campaign.runs, key=lambda run: run.start_ns)))


def answer_of(growing: GrowingCampaign, campaign: Campaign, count: int) -> Line:
    """Diagnose the first runs of a campaign."""
    from wheelsoil.workflows import diagnose_campaigns, diagnosis_options

    begin, cpu = time.perf_counter(), time.process_time()
    found = diagnose_campaigns([replace(campaign, runs=campaign.runs[:count])], diagnosis_options())
    return {
        "seed": growing.seed,
        "soil": growing.soil,
        "effect": growing.effect,
        "family": growing.family,
        "runs": count,
        **_kept(found),
        "cpu_s": time.process_time() - cpu,
        "wall_s": time.perf_counter() - begin,
    }


def _kept(found: Diagnosis) -> Line:
    from model import DiagnosisCode
    from wheelsoil.wording.diagnosis_json import diagnosis_json

    full = diagnosis_json(found)
    names = ("verdict", "sentence", "causes", "candidates", "adequacy", "noise", "stages_s", "notes", "gain", "soils")
    several = any(note.code == DiagnosisCode.SEVERAL_TERRAINS for note in found.grounds.cautions)
    kept = {name: full[name] for name in names} | {
        "samples": sum(len(one.run) for one in found.plot_data),
        "two_soils": several or found.grounds.terrains is not None,
        "converged": full.get("converged"),
    }
    return dict(json.loads(json.dumps(kept, default=float)))


def rank(line: Line) -> int:
    """Return how right a verdict is: 2 exactly right, 1 one of a few with the true cause, 0 nothing yet, -1 wrong."""
    names = [cause["name"] for cause in line["causes"] if line["verdict"] != "named" or not cause.get("barred")]
    if not line["family"]:
        return 2 if line["verdict"] == "nothing_detectable" else -1
    if line["verdict"] == "named":
        return 2 if names == [line["family"]] else -1
    if line["verdict"] == "one_of":
        return 1 if line["family"] in names else -1
    return 0 if line["verdict"] == "nothing_detectable" else -1


def stays_right(lines: Sequence[Line]) -> bool:
    """Return whether a campaign's verdict is never wrong and never gets worse with more runs."""
    ranks = [rank(line) for line in sorted(lines, key=lambda line: int(line["runs"]))]
    return ranks == sorted(ranks) and min(ranks) >= 0


def contains_true_value(line: Line) -> bool:
    """Return whether the interval of the hidden parameter holds its true value; False where it is not stated."""
    hidden = CAMPAIGNS[line["seed"]]
    for cause in line["causes"]:
        for one in cause["parameters"]:
            low, high = (float("nan") if x is None else x for x in one["interval95"])
            same = cause["name"] == hidden.family and cause["form"] in ("", hidden.key)
            if same and one["name"] == hidden.parameter:
                return bool(low <= hidden.value <= high)
    return False


def every_stage(line: Line) -> bool:
    """Return whether no stage of the diagnosis was skipped."""
    wanted = STAGES if line["verdict"] == "unexplained" else (*STAGES, "held_out")
    return all(stage in line["stages_s"] for stage in wanted)


def _grow(growing: GrowingCampaign, counts: Sequence[int], path: Path, engine: Line) -> str:
    begin = time.process_time()
    campaign = whole_campaign(growing, max(counts))
    made = time.process_time() - begin
    said = []
    for count in sorted(counts):
        line = answer_of(growing, campaign, count) | {"made_cpu_s": made, "engine": engine}
        append_line(path, line)
        names = ", ".join(cause["name"] for cause in line["causes"])
        said.append(f"{count} runs: {line['verdict']} {names} ({line['cpu_s']:.0f} s)")
    return f"seed {growing.seed} {growing.effect or 'nothing'}: " + "; ".join(said)


def run(seeds: Iterable[int], counts: Sequence[int], out: Path, jobs: int) -> int:
    """Diagnose what is not diagnosed yet with this engine; return the number of campaigns that raised an error."""
    out.mkdir(parents=True, exist_ok=True)
    path, engine = out / "growth.jsonl", engine_of()
    done = {(line["seed"], line["runs"]) for line in read_lines(path) if line["engine"] == engine}
    left = [(CAMPAIGNS[seed], [n for n in counts if (seed, n) not in done]) for seed in seeds]
    left = [(growing, missing) for growing, missing in left if missing]
    os.environ.update(ONE_THREAD)
    failed = 0
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        pending = {pool.submit(_grow, growing, missing, path, engine): growing for growing, missing in left}
        for future in as_completed(pending):
            error = future.exception()
            failed += error is not None
            print(f"seed {pending[future].seed}: {error!r}" if error else future.result(), flush=True)
    return failed


def page(lines: Sequence[Line]) -> str:
    """Return the page of the study: the figures, and each campaign's verdicts."""
    by_seed = {seed: [x for x in lines if x["seed"] == seed] for seed in sorted({x["seed"] for x in lines})}
    whole = {seed: own for seed, own in by_seed.items() if len(own) > 1}
    largest = max((x["runs"] for x in lines), default=0)
    caused = [x for x in lines if x["runs"] == largest and x["family"]]
    engines = dict.fromkeys(engine_words(x["engine"]) for x in lines)
    counts = sorted({x["runs"] for x in lines})
    figures = (
        ("right verdict that stays right at every larger number of runs", sum(map(stays_right, whole.values())), whole),
        ("diagnoses that speak of two soils", sum(x["two_soils"] for x in lines), lines),
        ("diagnoses without a skipped stage", sum(map(every_stage, lines)), lines),
        (f"intervals with the true value, {largest} runs", sum(map(contains_true_value, caused)), caused),
    )
    text = [
        "# Growing campaigns: does a true name stay?",
        "",
        "Written by `python -m blind.growth --report`. 24 campaigns of `wheelsoil simulate --duration 15`, each",
        "diagnosed with its first 6, 24, 100 and 200 runs. `nothing_detectable` may turn into the right name; a name",
        "may not be lost. A cause that is not named by its form has no interval, and counts as missed.",
        "",
        f"Engine: {'; '.join(engines) or 'none'}.",
        "",
        "| figure | to reach | reached |",
        "|---|---|---|",
        *(f"| {what} | {aim} | {hits} of {len(of)} |" for (what, hits, of), aim in zip(figures, _AIMS, strict=True)),
        "",
        "Each cell: verdict, probability of something unlisted, samples, CPU seconds.",
        "",
        "| seed | soil | hidden | " + " | ".join(f"{n} runs" for n in counts) + " | stays right |",
        "|---|---|---|" + "---|" * len(counts) + "---|",
        *(_row(own, counts) for own in by_seed.values()),
    ]
    return "\n".join(text) + "\n"


_AIMS = ("all of 24", "0", "all", "18 of 20")


def _row(own: Sequence[Line], counts: Sequence[int]) -> str:
    first = own[0]
    cells = []
    for n in counts:
        [*found] = (x for x in own if x["runs"] == n)
        cells.append(_cell(found[-1]) if found else "-")
    right = "yes" if stays_right(own) else "**no**"
    return f"| {first['seed']} | {first['soil']} | {first['effect'] or 'nothing'} | {' | '.join(cells)} | {right} |"


def _cell(line: Line) -> str:
    said = " ".join([line["verdict"], *(cause["name"] for cause in line["causes"])])
    fit = line["adequacy"]
    judged = f"{fit['statistic']:.3f}" if fit else "-"
    soils = ", two soils" if line["two_soils"] else ""
    return f"{said}{soils}, {judged}, {line['samples']}, {line['cpu_s']:.0f} s"


def main() -> int:
    """Run the study and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/growth"))
    parser.add_argument("--seeds", type=int, nargs="*", default=range(len(CAMPAIGNS)))
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--report", type=Path, help="write the page here, e.g. docs/growth_results.md")
    options = parser.parse_args()
    failed = run(options.seeds, options.counts, options.out, options.jobs)
    if options.report:
        lines = {(x["seed"], x["runs"]): x for x in read_lines(options.out / "growth.jsonl")}
        options.report.write_text(page(list(lines.values())), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
