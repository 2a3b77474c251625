"""The blind study: hide, hand over recordings, diagnose, compare; resumable, one JSON line a case.

make blind                      a small one
make blind BLIND="--full"       hours
PYTHONPATH=tests python -m blind.study --out out/blind --nulls 20 --singles 1 --only 'single/torque_zero'
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import time
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from blind.mix import FULL, Case, Mix, cases

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def truth_of(case: Case) -> dict[str, Any]:
    """Return what is hidden in a case, how large it is, and what the data can tell of it."""
    from blind.causes import ALL
    from blind.measures import Yardstick, forms_apart, left_by_three, oracle, told

    day = case.day
    yardstick = Yardstick(day)
    sized = [(key, yardstick.size_for(key, level, sign)[0]) for key, level, sign in case.hidden]
    members = []
    for i, (key, size) in enumerate(sized):
        one = told(yardstick, sized, i, without=case.without)
        members.append(
            {
                "key": key,
                "family": ALL[key].family,
                "parameter": ALL[key].parameter,
                "variant": ALL[key].variant,
                "size": size,
                "L": one.loudness,
                "d": one.detectability,
                "d_sep": one.separability,
                "rival": one.rival,
                "d_forms": forms_apart(yardstick, sized, i),
            }
        )
    known = oracle(yardstick, sized) if len(sized) < 2 else None
    return {
        "name": case.name,
        **asdict(case),
        "vendor": day.vendor.name,
        "members": members,
        "left_by_three": left_by_three(yardstick, sized, case.without) if sized else 0.0,
        "oracle": asdict(known) if known else None,
    }


def answer_of(case: Case, truth: dict[str, Any]) -> dict[str, Any]:
    """Hand the recordings over and return what the engine says."""
    from blind.engine import asked, campaign_from_channels, campaign_from_frames

    day = case.day
    sized = [(member["key"], member["size"]) for member in truth["members"]]
    begin = time.perf_counter()
    campaign = (campaign_from_frames if case.frames else campaign_from_channels)(day, sized)
    made = time.perf_counter()
    said = asked(campaign, case, truth)
    return {"name": case.name, "seconds": {"recordings": made - begin, "asked": time.perf_counter() - made}, **said}


def _one(case: Case, truth: dict[str, Any] | None, *, only_truth: bool) -> tuple[dict[str, Any], dict[str, Any] | None]:
    truth = truth or truth_of(case)
    return truth, None if only_truth else answer_of(case, truth)


def read_lines(path: Path) -> dict[str, dict[str, Any]]:
    """Return the lines of a results file by case; a line cut off by a kill is left out."""
    found = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        if line.endswith("}"):
            entry = json.loads(line)
            found[entry["name"]] = entry
    return found


def _append(path: Path, entry: dict[str, Any]) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")


def run(wanted: list[Case], out: Path, jobs: int, *, only_truth: bool = False) -> int:
    """Do what is not done yet; return the number of cases that raised an error."""
    out.mkdir(parents=True, exist_ok=True)
    truths, answers = read_lines(out / "truth.jsonl"), read_lines(out / "answers.jsonl")
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
                _append(out / "errors.jsonl", {"name": case.name, "error": repr(error)})
                print(f"{count}/{len(left)} {case.name}: {error!r}", flush=True)
                continue
            truth, answer = future.result()
            if case.name not in truths:
                _append(out / "truth.jsonl", truth)
            if answer is not None:
                _append(out / "answers.jsonl", answer)
                top = ", ".join(f"{c['name']} {c['probability']:.2f}" for c in answer["candidates"][:2])
                print(f"{count}/{len(left)} {case.name}: {answer['verdict']} ({top})", flush=True)
    return failed


def main() -> int:
    """Run the study and write its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/blind"))
    parser.add_argument("--full", action="store_true", help="the whole mix; hours")
    for name in ("nulls", "singles", "pairs", "outside", "left-out", "literal"):
        parser.add_argument(f"--{name}", type=int)
    parser.add_argument("--levels", type=float, nargs="+")
    parser.add_argument("--beyond", action="store_true", help="noise outside the engine's beliefs")
    parser.add_argument("--only", help="regular expression for names of cases")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--truth", action="store_true", help="only what is hidden and the oracle, no engine")
    parser.add_argument("--report", type=Path, help="write tables here, e.g. docs/blind_results.md")
    options = parser.parse_args()
    given = {
        name: getattr(options, name)
        for name in ("nulls", "singles", "pairs", "outside", "left_out", "literal")
        if getattr(options, name) is not None
    }
    mix = replace(FULL if options.full else Mix(), **given, beyond=options.beyond)
    if options.levels:
        mix = replace(mix, levels=tuple(options.levels))
    wanted = [case for case in cases(mix) if not options.only or re.search(options.only, case.name)]
    failed = run(wanted, options.out, options.jobs, only_truth=options.truth)
    if options.report:
        from blind.tables import write_report

        write_report(options.out, {case.name for case in wanted}, options.report)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
