"""The blind study: hide, hand over recordings, diagnose, compare; resumable, one JSON line a case.

make blind                                     a small one, seeds from 0
make blind BLIND="--block 0 --jobs 2"          a whole block of seeds, hours; the engine must be committed
make blind BLIND="--block 0 --share 0.1"       a tenth of it
PYTHONPATH=tests python -m blind.study --out out/blind --nulls 20 --singles 1 --only 'single/torque_zero'
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import time
from collections.abc import Iterable
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from blind.jsonl import append_line, read_lines
from blind.mix import WHOLE, Case, Mix, cases
from blind.provenance import Engine, engine_of, generator_of

COUNTS = ("nulls", "singles", "pairs", "outside", "left_out", "literal", "foreign", "calibration")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


APART = 5.0
"""d_sep that each member of a pair must have."""


def truth_of(case: Case) -> dict[str, Any]:
    """Return what is hidden in a case, how large it is, and what the data can tell of it."""
    told = {"members": [], "left_by_three": 0.0, "oracle": None, "tries": 0}
    if case.kind in ("null", "single", "pair", "outside", "left_out"):
        told |= _measured_truth(case)
    elif case.kind == "foreign":
        told["members"] = [{"key": case.hidden[0][0]}]
    elif case.kind == "calibration":
        told["members"] = [_member(key, size) for key, size in case.drawn_from_prior()]
    return {"name": case.name, **asdict(case), "world": asdict(case.day.world), "vendor": case.day.vendor.name, **told}


def _member(key: str, size: float) -> dict[str, Any]:
    from blind.causes import ALL

    hidden = ALL[key]
    return {
        "key": key,
        "family": hidden.family,
        "parameter": hidden.parameter,
        "variant": hidden.variant,
        "size": size,
    }


def _measured_truth(case: Case) -> dict[str, Any]:
    """Return the members with L, d and d_sep; a pair is drawn again until both of its members stand apart."""
    from blind.measures import Yardstick, forms_apart, left_by_three, oracle, told

    yardstick = Yardstick(case.day)
    tries = 0
    for hidden in case.candidates() if case.kind == "pair" else [case.hidden]:
        tries += 1
        sized = [(key, yardstick.size_for(key, level, sign)[0]) for key, level, sign in hidden]
        found = [told(yardstick, sized, i, without=case.without) for i in range(len(sized))]
        if case.kind != "pair" or min(one.separability for one in found) > APART:
            break
    else:
        raise RuntimeError("no pair stands apart")
    members = [
        _member(*each)
        | {
            "L": one.loudness,
            "d": one.detectability,
            "d_sep": one.separability,
            "rival": one.rival,
            "d_forms": forms_apart(yardstick, sized, i),
        }
        for i, (each, one) in enumerate(zip(sized, found, strict=True))
    ]
    return {
        "members": members,
        "left_by_three": left_by_three(yardstick, sized, case.without),
        "oracle": asdict(oracle(yardstick, sized)) if case.kind in ("null", "single") else None,
        "tries": tries,
    }


def answer_of(case: Case, truth: dict[str, Any]) -> dict[str, Any]:
    """Hand the recordings over and return what the engine says."""
    from blind.engine import asked, campaign_from_channels, campaign_from_frames

    sized = [(member["key"], member["size"]) for member in truth["members"] if "size" in member]
    begin = time.process_time()
    campaign = (campaign_from_frames if case.frames else campaign_from_channels)(case.day, sized)
    made = time.process_time()
    said = asked(campaign, case, truth)
    return {"name": case.name, "cpu_s": {"recordings": made - begin, "asked": time.process_time() - made}, **said}


def _one(case: Case, truth: dict[str, Any] | None, *, only_truth: bool) -> tuple[dict[str, Any], dict[str, Any] | None]:
    begin = time.process_time()
    truth = truth or truth_of(case) | {"truth_cpu_s": time.process_time() - begin}
    return truth, None if only_truth else answer_of(case, truth)


def by_name(path: Path) -> dict[str, dict[str, Any]]:
    """Return the lines of a results file by case."""
    return {entry["name"]: entry for entry in read_lines(path)}


def check_engine(engine: Engine, answers: Iterable[dict[str, Any]]) -> None:
    """Refuse a block whose answers would be of more than one engine, or of one that git does not have.

    Raises
    ------
    ValueError
    """
    if engine["dirty"]:
        raise ValueError("model/ or processing/ differ from HEAD: commit them before a block is run")
    if any(answer["engine"] != engine for answer in answers):
        raise ValueError("this folder has answers of another engine: take the next block, and another --out")


def run(wanted: list[Case], out: Path, jobs: int, *, only_truth: bool = False, block: int = -1) -> int:
    """Do what is not done yet; return the number of cases that raised an error.

    Raises
    ------
    ValueError
        A block's engine is not committed, or the answers that are there are another engine's.
    """
    out.mkdir(parents=True, exist_ok=True)
    engine = engine_of()
    stamp = {"block": block, "engine": engine, "generator": generator_of()}
    truths, answers = by_name(out / "truth.jsonl"), by_name(out / "answers.jsonl")
    if block >= 0 and not only_truth:
        check_engine(engine, answers.values())
    done = truths if only_truth else answers
    left = [case for case in wanted if case.name not in done]
    os.environ.update(ONE_THREAD | {"WHEELSOIL_CACHE": "off"})
    failed = 0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        pending: dict[Future[Any], Case] = {
            pool.submit(_one, case, truths.get(case.name), only_truth=only_truth): case for case in left
        }
        for count, future in enumerate(as_completed(pending), 1):
            case = pending[future]
            error = future.exception()
            if error is not None:
                failed += 1
                append_line(out / "errors.jsonl", {"name": case.name, "error": repr(error)})
                print(f"{count}/{len(left)} {case.name}: {error!r}", flush=True)
                continue
            truth, answer = future.result()
            if case.name not in truths:
                append_line(out / "truth.jsonl", truth | stamp)
            if answer is not None:
                append_line(out / "answers.jsonl", answer | stamp)
                top = ", ".join(f"{c['name']} {c['probability']:.2f}" for c in answer["candidates"][:2])
                print(f"{count}/{len(left)} {case.name}: {answer['verdict']} ({top})", flush=True)
    return failed


def main() -> int:
    """Run the study and write its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/blind"))
    parser.add_argument("--block", type=int, default=-1, help="of seeds, 0 or more: the whole mix; hours")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases")
    for name in COUNTS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=int)
    parser.add_argument("--levels", type=float, nargs="+")
    parser.add_argument("--only", help="regular expression for names of cases")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--truth", action="store_true", help="only what is hidden and the oracle, no engine")
    parser.add_argument("--report", type=Path, help="write tables here, e.g. docs/blind_results.md")
    options = parser.parse_args()
    given = {name: getattr(options, name) for name in COUNTS if getattr(options, name) is not None}
    mix = replace(WHOLE if options.block >= 0 else Mix(), **given, block=options.block)
    if options.levels:
        mix = replace(mix, levels=tuple(options.levels))
    wanted = [case for case in cases(mix, options.share) if not options.only or re.search(options.only, case.name)]
    out = options.out / f"block-{options.block}" if options.block >= 0 else options.out
    try:
        failed = run(wanted, out, options.jobs, only_truth=options.truth, block=options.block)
    except ValueError as error:
        parser.error(str(error))
    if options.report:
        from blind.tables import write_report

        write_report(out, {case.name for case in wanted}, options.report)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
