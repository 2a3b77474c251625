"""Measure the strength of the tests: put one error at a time into a copy of the checkout, and see which test fails.

make mutants                                              every list, into out/mutants.md
PYTHONPATH=tests python -m mutants.run --only 'model/*'   one list, or ids; results.json keeps the others
PYTHONPATH=tests python -m mutants.run --check            only whether the lists still fit the source

The checkout is not touched. Public data (WHEELSOIL_DATA) is not used: a mutant has to be killed by what the repository
carries, without the slow tests.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from multiprocessing.connection import wait
from pathlib import Path

from mutants.checkout import Checkout, Outcome
from mutants.mutant import Mutant, all_mutants, problems
from mutants.table import write_results


def main() -> None:
    """Run the mutants that the command line names."""
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended"))  # as Ctrl-C: nothing goes on running
    mutants = all_mutants()
    wrong = problems(mutants)
    if wrong or options.check:
        sys.exit("\n".join(wrong) or None)
    named = {name: [mutant for mutant in mutants if _goes_by(mutant, name)] for name in options.only}
    if unknown := [name for name, found in named.items() if not found]:
        sys.exit(f"no mutant is named {' or '.join(unknown)}")
    chosen = [mutant for mutant in mutants if any(mutant in found for found in named.values())]
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copies = [Checkout(Path(folder).resolve() / str(number)) for number in range(min(options.jobs, len(chosen)))]
        try:
            if not options.passing:
                _require_passing_tests(copies[0], chosen)
            for outcome in _tested(chosen, copies, options.limit):
                outcomes.append(outcome)
                said = f"{outcome.state}, {outcome.seconds:.1f} s  {outcome.test}"
                print(f"{len(outcomes)}/{len(chosen)} {outcome.mutant.room}/{outcome.mutant.id}: {said}", flush=True)
        finally:
            for copy in copies:
                copy.stop()
            write_results(mutants, {o.mutant.id: o.test or f"**{o.state}**" for o in outcomes})
    killed = sum(outcome.state == "killed" for outcome in outcomes)
    numeric = [outcome.state == "killed" for outcome in outcomes if outcome.mutant.numeric]
    print(f"{killed} of {len(outcomes)} killed; {sum(numeric)} of the {len(numeric)} that change a number in silence")
    for outcome in (one for one in outcomes if one.state != "killed"):
        print(f"{outcome.state}: {outcome.mutant.id} ({outcome.mutant.why}), {outcome.mutant.file}")
    sys.exit(killed < len(outcomes))


def _goes_by(mutant: Mutant, name: str) -> bool:
    return fnmatch(mutant.id, name) or fnmatch(f"{mutant.room}/{mutant.id}", name)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only check that the lists fit the source")
    parser.add_argument("--only", nargs="+", default=["*"], metavar="ID", help="ids, or list/id; * stands for anything")
    parser.add_argument("--passing", action="store_true", help="take it that all tests pass, as after `make test`")
    parser.add_argument("--jobs", type=int, default=2, help="copies of the checkout at work at the same time")
    parser.add_argument("--limit", type=int, default=60, help="CPU seconds for the tests of one mutant")
    return parser.parse_args()


def _require_passing_tests(copy: Checkout, mutants: Sequence[Mutant]) -> None:
    """Run every test that is used once, without any error in the source."""
    start = time.monotonic()
    copy.start_tests(dict.fromkeys(test for mutant in mutants for test in mutant.tests))
    code, said = copy.end_tests()
    if code != 0:
        sys.exit(f"the tests do not pass without a mutant:\n{said}")
    print(f"without a mutant: {said.strip().splitlines()[-1]} ({time.monotonic() - start:.0f} s)", flush=True)


def _tested(mutants: Sequence[Mutant], copies: Sequence[Checkout], limit_s: int) -> Iterator[Outcome]:
    """Share the mutants out among the copies."""
    waiting, free, busy = list(reversed(mutants)), list(copies), []
    while waiting or busy:
        while waiting and free:
            busy.append(free.pop())
            busy[-1].start(waiting.pop(), limit_s)
        ready = wait([copy.sentinel for copy in busy], timeout=5.0)
        for copy in [copy for copy in busy if copy.sentinel in ready or copy.is_late]:
            busy.remove(copy)
            free.append(copy)
            yield copy.outcome()


if __name__ == "__main__":
    main()
