"""Four wheels of one vehicle, together and one by one: is the cause found, and at which wheel?

PYTHONPATH=tests python -m blind.wheels --jobs 1                        all of it, resumable
PYTHONPATH=tests python -m blind.wheels --seeds --report docs/wheels_results.md   only the page, and d_sep

100 campaigns of `wheelsoil simulate --wheels 4`: a gain or a zero of one transducer (40), slip sinkage (20), a shift of
the stress peak (10), an error of the ground speed (10), nothing (20). An error of a transducer has a size at which its
own wheel alone says `one_of` several families: where it leaves one only, it is a zero that its standstills show, to
which no other wheel adds anything. Each is written as frames, read and processed as `wheelsoil diagnose FOLDER` does.
What its data can tell is measured from the simulation's truth (`blind.wheels_truth`).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from blind.figures import clopper_pearson
from blind.ground import PATCH
from blind.growth import ONE_THREAD
from blind.jsonl import append_line, read_lines
from blind.provenance import engine_of, engine_words
from scipy.stats import binomtest

if TYPE_CHECKING:
    from model.diagnosis import Campaign, Diagnosis
    from wheelsoil.simulation import SimulationOptions
    from wheelsoil.workflows.diagnosis import Processed

WHEELS = ("FL", "FR", "RL", "RR")
ONE = "FL"
"""The wheel that stands for a vehicle with one transducer."""
TRANSDUCER = {
    "torque_gain": ("relative", 0.05),
    "drawbar_pull_gain": ("relative", 0.1),
    "load_gain": ("relative", 0.05),
    "torque_zero": ("offset_nm", 30.0),
    "drawbar_pull_zero": ("offset_n", 100.0),
    "load_zero": ("offset_n", 200.0),
}
"""Parameter, and the size at which the search for one that a wheel alone leaves open begins."""
SHARED = {
    "vasilev": ("slip_sinkage", "H_m", 0.03, 0.08),
    "lyasko": ("slip_sinkage", "m1", 0.2, 0.5),
    "ding": ("slip_sinkage", "n1", 0.15, 0.35),
    "stress_peak_shift": ("stress_peak_shift", "c2", 0.15, 0.4),
    "speed_bias": ("speed_bias", "offset_mps", 0.05, 0.12),
    "speed_latency": ("speed_latency", "extra_delay_s", 0.08, 0.2),
}
"""Family, parameter, smallest and largest size."""
BESIDE = {"lyasko": {"m2": 0.05}, "stress_peak_shift": {"c1": 0.3}}
"""What such an effect has, too."""
_KINDS = ("transducer",) * 4 + ("sinkage",) * 2 + ("peak", "speed", "nothing", "nothing")
_KEYS = {
    "transducer": tuple(TRANSDUCER),
    "sinkage": ("vasilev", "lyasko", "ding"),
    "peak": ("stress_peak_shift",),
    "speed": ("speed_bias", "speed_latency"),
}
COUNT = 100
DURATION_S = 20.0
RUNS = 6
_STEP, _MOST_TRIES = 1.4, 6
SEPARABLE = 5.0
"""d_sep from which on the data can tell the name, as in the blind study."""
_CHANNEL = {"crosstalk": "drawbar_pull", "zero_drift": "drawbar_pull"}

Line = dict[str, Any]


@dataclass(frozen=True)
class Hidden:
    """What is hidden in a campaign: `key` is empty where nothing is, `wheel` where it acts at all of them."""

    seed: int
    key: str = ""
    size: float = 0.0
    wheel: str = ""

    @property
    def family(self) -> str:
        """Name that the diagnosis should give."""
        return SHARED[self.key][0] if self.key in SHARED else self.key

    @property
    def kind(self) -> str:
        """Which of the mix."""
        return _KINDS[self.seed % len(_KINDS)]

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the effect."""
        parameter = SHARED[self.key][1] if self.key in SHARED else TRANSDUCER[self.key][0]
        return {parameter: self.size, **BESIDE.get(self.key, {})}


def drawn(seed: int) -> Hidden:
    """Return what a seed hides, of a transducer with the size at which the search begins."""
    rng = np.random.default_rng([seed, 36])
    kind = _KINDS[seed % len(_KINDS)]
    if kind == "nothing":
        return Hidden(seed)
    key = str(rng.choice(_KEYS[kind]))
    if kind == "transducer":
        sign = float(rng.choice((-1.0, 1.0)))
        return Hidden(seed, key, sign * TRANSDUCER[key][1], str(rng.choice(WHEELS)))
    *_, least, most = SHARED[key]
    return Hidden(seed, key, float(rng.uniform(least, most)))


def options_of(hidden: Hidden) -> SimulationOptions:
    """Return how a campaign is simulated."""
    from wheelsoil.simulation import SimulationOptions

    return SimulationOptions(
        soil=("clay", "sandy")[hidden.seed % 2],
        seed=hidden.seed,
        runs=RUNS,
        duration_s=DURATION_S,
        draw_soil=hidden.seed % 4 >= 2,
        effects={hidden.key: hidden.values} if hidden.key else {},
        wheels=len(WHEELS),
        faulty_wheel=hidden.wheel,
    )


def runs_of_wheels(hidden: Hidden) -> dict[str, Processed]:
    """Simulate a campaign, write it as frames, and read and process it as `wheelsoil diagnose` does."""
    from processing import ProcessOptions
    from wheelsoil.simulation import simulate_campaign
    from wheelsoil.workflows import Files, process_runs

    with TemporaryDirectory(prefix="wheels-") as name:
        folder = Path(name) / "campaign"
        simulate_campaign(folder, options_of(hidden))
        opened = Files().runs_of_wheels([folder], lambda _: None)
        purpose = ProcessOptions(purpose="diagnose")
        return {wheel: process_runs(runs, purpose) for wheel, runs in opened.items()}


def _found(campaigns: Sequence[Campaign]) -> Line:
    from wheelsoil.workflows import diagnose_campaigns, diagnosis_options

    cpu = time.process_time()
    found = diagnose_campaigns(campaigns, diagnosis_options())
    return _kept(found) | {"cpu_s": time.process_time() - cpu}


def _kept(found: Diagnosis) -> Line:
    barred = {kept.cause.name for kept in found.grounds.kept_back}
    names = [cause.name for cause in found.causes]
    return {
        "verdict": found.verdict,
        "names": [name for name in names if found.verdict != "named" or name not in barred],
        "candidates": {c.name: round(c.probability, 4) for c in found.candidates[:6]},
        "unlisted": found.adequacy.statistic if found.adequacy else None,
        "values": {
            f"{cause.name}.{p.name}": [p.value, *p.interval95] for cause in found.causes for p in cause.parameters
        },
    }


def _by_one(processed: Processed) -> Line:
    from wheelsoil.workflows import campaigns_of

    return _found(campaigns_of([], processed))


def searched(hidden: Hidden) -> tuple[Hidden, dict[str, Processed], Line | None]:
    """Return a campaign whose faulty wheel alone leaves several families open.

    Where no size of an error does, which a few tries tell, the next kind of error takes its place.
    """
    keys = tuple(TRANSDUCER)
    for tried in range(_MOST_TRIES * len(keys)):
        wheels = runs_of_wheels(hidden)
        if not hidden.wheel:
            return hidden, wheels, None
        alone = _by_one(wheels[hidden.wheel])
        if leaves_open(alone):
            break
        larger = alone["verdict"] != "named"
        hidden = replace(hidden, size=hidden.size * (_STEP if larger else 0.93 / _STEP))
        if tried % _MOST_TRIES == _MOST_TRIES - 1:
            key = keys[(keys.index(hidden.key) + 1) % len(keys)]
            hidden = replace(hidden, key=key, size=float(np.sign(hidden.size)) * TRANSDUCER[key][1])
    return hidden, wheels, alone


def with_told(lines: Sequence[Line], out: Path) -> list[Line]:
    """Return the lines; those of one transducer with what the data can tell, which is measured where it is not yet."""
    from blind.wheels_truth import WheelsYardstick

    path = out / "told.jsonl"
    known = {_hidden_in(x): x["told"] for x in read_lines(path)}
    found = []
    for line in lines:
        hidden = _hidden_in(line)
        if hidden.wheel and hidden not in known:
            grounds = {"": False, "_usual": True}
            told = {name: WheelsYardstick(options_of(hidden), patchy=patchy) for name, patchy in grounds.items()}
            known[hidden] = {
                f"{key}{name}": value
                for name, yardstick in told.items()
                for key, value in asdict(yardstick.told(hidden.key, hidden.size, hidden.wheel)).items()
            }
            append_line(path, asdict(hidden) | {"told": known[hidden]})
        found.append(line | {"told": known.get(hidden)})
    return found


def _hidden_in(line: Line) -> Hidden:
    return Hidden(line["seed"], line["key"], line["size"], line["wheel"])


def leaves_open(answer: Line) -> bool:
    """Return whether an answer is one of several families."""
    return answer["verdict"] == "one_of" and len(answer["names"]) > 1


def answer_of(seed: int) -> Line:
    """Diagnose one campaign: by the front left wheel, by the faulty one and by all together."""
    from wheelsoil.workflows import vehicles_of

    begin = time.process_time()
    hidden, wheels, alone = searched(drawn(seed))
    made = time.process_time() - begin
    return {
        "seed": seed,
        "kind": hidden.kind,
        "key": hidden.key,
        "size": hidden.size,
        "wheel": hidden.wheel,
        "family": hidden.family,
        "alone": alone,
        "one": alone if hidden.wheel == ONE else _by_one(wheels[ONE]),
        "all": _found(vehicles_of([], wheels)),
        "made_cpu_s": made,
    }


def run(seeds: Iterable[int], out: Path, jobs: int) -> int:
    """Diagnose what is not diagnosed yet with this engine; return the number of campaigns that raised an error."""
    out.mkdir(parents=True, exist_ok=True)
    path, engine = out / "wheels.jsonl", engine_of()
    done = {line["seed"] for line in read_lines(path) if line["engine"] == engine}
    os.environ.update(ONE_THREAD)
    failed = 0
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        pending = {pool.submit(answer_of, seed): seed for seed in seeds if seed not in done}
        for future in as_completed(pending):
            if error := future.exception():
                failed += 1
                print(f"seed {pending[future]}: {error!r}", flush=True)
                continue
            line = future.result()
            append_line(path, line | {"engine": engine})
            said = "; ".join(f"{by}: {_said(line[by])}" for by in ("one", "all"))
            print(f"seed {line['seed']} {line['key'] or 'nothing'} {line['wheel']}: {said}", flush=True)
    return failed


def _said(answer: Line) -> str:
    return " ".join([answer["verdict"], *answer["names"]])


def truth_of(line: Line, by: str) -> str:
    """Return the name that is right: of one wheel what acts there, of all of them with the wheel where it acts."""
    if by == "all" and line["wheel"]:
        return f"{line['family']}@{line['wheel']}"
    return "" if line["wheel"] not in ("", ONE) and by == "one" else str(line["family"])


def right(line: Line, by: str) -> bool:
    """Return whether the one right cause is named."""
    return bool(truth_of(line, by)) and line[by]["verdict"] == "named" and line[by]["names"] == [truth_of(line, by)]


def right_wheel(line: Line) -> bool:
    """Return whether every family of the answer of all wheels is of the faulty wheel, the right one among them."""
    answer, wheel = line["all"], f"@{line['wheel']}"
    found = answer["verdict"] in ("named", "one_of") and truth_of(line, "all") in answer["names"]
    return bool(found and all(name.endswith(wheel) for name in answer["names"]))


def right_channel(line: Line) -> bool:
    """Return whether every family of the answer is an error of the faulty channel of the faulty wheel."""
    return right_wheel(line) and {_channel(name) for name in line["all"]["names"]} == {_channel(line["family"])}


def _channel(name: str) -> str:
    family = name.partition("@")[0]
    return _CHANNEL.get(family, family.rpartition("_")[0])


def wrong(line: Line, by: str) -> bool:
    """Return whether a cause is named that does not act."""
    return line[by]["verdict"] == "named" and bool(set(line[by]["names"]) - {truth_of(line, by)})


def figures(lines: Sequence[Line]) -> Iterator[tuple[str, str, str]]:
    """Yield each figure, what is to be reached and what is."""

    def share(hits: Iterable[bool], of: Sequence[Line]) -> str:
        return f"{sum(hits)} of {len(of)}"

    faulty = [x for x in lines if x["kind"] == "transducer"]
    open_alone = [x for x in faulty if leaves_open(x["alone"])]
    yield (
        "one transducer's error named with its wheel",
        "36 of 40",
        share((right(x, "all") for x in open_alone), open_alone),
    )
    yield (
        "its wheel found: named, or one of several errors of that wheel",
        "",
        share((right_wheel(x) for x in open_alone), open_alone),
    )
    yield (
        "its wheel and channel found: named, or one of several errors of that channel",
        "",
        share((right_channel(x) for x in open_alone), open_alone),
    )
    for name, ground in (("", "as simulated"), ("_usual", "as usual")):
        apart = [x for x in open_alone if x["told"] and x["told"][f"d_sep{name}"] > SEPARABLE]
        hits = sum(right(x, "all") for x in apart)
        low, high = clopper_pearson(hits, len(apart))
        what = f"named with its wheel, of those that the data separate, d_sep > {SEPARABLE:g}, on ground {ground}"
        yield what, "", f"{hits} of {len(apart)} (95 %: {low:.2f} to {high:.2f})"
    yield "named by that wheel alone", "", share((x["alone"]["verdict"] == "named" for x in open_alone), open_alone)
    both = [x for x in lines if x["family"]]
    for by, aim in (("all", "at least as many"), ("one", "")):
        which = "all wheels" if by == "all" else f"wheel {ONE} alone"
        yield f"right names, {which}", aim, share((right(x, by) for x in both), both)
        yield f"wrong names, {which}", "no more" if by == "all" else "", share((wrong(x, by) for x in lines), lines)
    shared = [x for x in both if not x["wheel"]]
    for which, own in (("all causes", both), ("causes that act at all wheels", shared)):
        gained = sum(right(x, "all") and not right(x, "one") for x in own)
        lost = sum(right(x, "one") and not right(x, "all") for x in own)
        p = binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
        yield f"names gained and lost by all wheels, {which}", "", f"{gained} and {lost} (McNemar's p {p:.2g})"
    nothing = [x for x in lines if x["kind"] == "nothing"]
    yield "campaigns without a cause: a cause named", "0 of 20", share((wrong(x, "all") for x in nothing), nothing)
    soil = [x for x in lines if x["kind"] in ("sinkage", "peak")]
    yield (
        "slip sinkage or stress peak, decided by all wheels",
        "more than by one",
        share((right(x, "all") for x in soil), soil),
    )
    yield f"the same, by wheel {ONE}", "", share((right(x, "one") for x in soil), soil)
    unexplained = [x for x in lines if x["all"]["verdict"] == "unexplained"]
    yield "unexplained, all wheels", "", share((True for _ in unexplained), lines)
    ratio = [x["all"]["cpu_s"] / x["one"]["cpu_s"] for x in lines]
    yield f"CPU of all wheels together over that of {ONE}", "6 aimed at", f"{float(np.median(ratio)):.1f} (median)"
    both_cpu = [sum(x[by]["cpu_s"] for x in lines) for by in ("all", "one")]
    yield f"the same, of all campaigns in sum ({both_cpu[0]:.0f} s)", "", f"{both_cpu[0] / both_cpu[1]:.1f}"
    faulty_cpu = [x["all"]["cpu_s"] / x["alone"]["cpu_s"] for x in faulty if x["alone"]]
    if faulty_cpu:
        yield "the same over that of the faulty wheel", "", f"{float(np.median(faulty_cpu)):.1f} (median)"


def page(lines: Sequence[Line]) -> str:
    """Return the page of the study: the figures, and each campaign's verdicts."""
    engines = dict.fromkeys(engine_words(x["engine"]) for x in lines)
    text = [
        "# Four wheels together and one by one",
        "",
        f"Written by `python -m blind.wheels --report`. {len(lines)} campaigns of `wheelsoil simulate --wheels 4`",
        f"({RUNS} runs of {DURATION_S:g} s), seeds 0 to {COUNT - 1}, each diagnosed by its front left wheel and by all",
        "wheels together. An error of one transducer has a size at which that wheel leaves several families open.",
        "",
        "The data show an error of one transducer with d one-sigmas; d_sep is what is left if the best other family,",
        "at any wheel, explains it, too. Both come from the truth of the simulation, with the laboratory's soil, the",
        "scatter of runs and the tilt projected out: on the ground as simulated, which is even, and with what usually",
        f"varies along a track ({PATCH:.0%} of the stiffness) and between runs (zeros by 6 N, 1.5 N m), for which a",
        "diagnosis has to allow.",
        "",
        f"Engine: {'; '.join(engines) or 'none'}.",
        "",
        "| figure | to reach | reached |",
        "|---|---|---|",
        *(f"| {what} | {aim} | {found} |" for what, aim, found in figures(lines)),
        "",
        f"| seed | hidden | size | at wheel | d | d_sep | d_sep, usual | that wheel alone | wheel {ONE} | all wheels |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *map(_row, sorted(lines, key=lambda x: int(x["seed"]))),
    ]
    return "\n".join(text) + "\n"


def _row(line: Line) -> str:
    alone = _said(line["alone"]) if line["alone"] else ""
    told = [f"{line['told'][key]:.1f}" if line["told"] else "" for key in ("d", "d_sep", "d_sep_usual")]
    size = f"{line['size']:.3g}" if line["key"] else ""
    cells = [line["seed"], line["key"] or "nothing", size, line["wheel"], *told, alone]
    mark = " (right)" if right(line, "all") else " **(wrong)**" if wrong(line, "all") else ""
    return f"| {' | '.join(map(str, cells))} | {_said(line['one'])} | {_said(line['all'])}{mark} |"


def main() -> int:
    """Run the study and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/wheels"))
    parser.add_argument("--seeds", type=int, nargs="*", default=range(COUNT))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--report", type=Path, help="write the page here, e.g. docs/wheels_results.md")
    options = parser.parse_args()
    failed = run(options.seeds, options.out, options.jobs)
    if options.report:
        lines = {x["seed"]: x for x in read_lines(options.out / "wheels.jsonl")}
        options.report.write_text(page(with_told(list(lines.values()), options.out)), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
