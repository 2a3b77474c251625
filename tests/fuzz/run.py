"""Damages files and reads them: `PYTHONPATH=tests python -m fuzz.run --count 1000000` by hand, fewer in the slow set.

A defect is an exception that is not ours, more than 1.5 GB, or more than 20 s for one file; and a well-formed file that
is read wrong without a word (`fuzz.well_formed`).
"""

from __future__ import annotations

import argparse
import logging
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np
from fuzz.mutators import mutated
from fuzz.readers import FORMATS, whole_file
from fuzz.well_formed import DECIMAL_IDENTIFIERS, KINDS, outcome_of

from daq import WheelsoilError

PATIENCE_S = 20
MEMORY_BYTES = 3 << 29
_PER_WELL_FORMED = 100
"""Damaged files for each well-formed one of a kind."""


class TooSlow(BaseException):  # the boundary around readers must not take it for theirs
    """One file took longer than `PATIENCE_S`."""


def defects_of(name: str, count: int, first_seed: int) -> list[str]:
    """Read `count` damaged files of a format; return what went wrong, with the seed of each."""
    found: list[str] = []
    known = FORMATS[name]
    with tempfile.TemporaryDirectory() as folder:
        whole = whole_file(name, Path(folder))
        path = Path(folder) / f"damaged{known.suffix}"
        known.read(Path(folder) / f"whole{known.suffix}")
        for seed in range(first_seed, first_seed + count):
            path.write_bytes(mutated(whole, np.random.default_rng(seed)))
            signal.alarm(PATIENCE_S)
            try:
                known.read(path)
            except WheelsoilError:
                pass
            except BaseException as error:  # this is what it looks for
                if isinstance(error, KeyboardInterrupt):
                    raise
                last = traceback.extract_tb(error.__traceback__)[-1]
                place = f"{Path(last.filename).name}:{last.lineno}"
                found.append(f"{name}, seed {seed}: {type(error).__name__} at {place}: {str(error)[:120]}")
            finally:
                signal.alarm(0)
            strangers = {one.name for one in Path(folder).iterdir()} - {path.name, f"whole{known.suffix}"}
            if strangers:
                found.append(f"{name}, seed {seed}: left {sorted(strangers)} behind")
    return found


def wrong_without_a_word(kind: str, count: int, first_seed: int) -> list[str]:
    """Read `count` well-formed files of a kind; return those that are read wrong and nothing says so."""
    with tempfile.TemporaryDirectory() as folder:
        seeds = range(first_seed, first_seed + count)
        wrong = [seed for seed in seeds if outcome_of(kind, seed, Path(folder)) == "wrong"]
    return [f"{kind}, seed {seed}: wrong without a word" for seed in wrong]


def main() -> int:
    """Fuzz every format, or one; print the defects."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000, help="damaged files in all")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--format", choices=FORMATS)
    asked = parser.parse_args()
    names = [asked.format] if asked.format else list(FORMATS)
    total = sum(FORMATS[name].weight for name in names)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES + (2 << 30), resource.RLIM_INFINITY))  # of addresses

    def ring(*_: object) -> None:
        raise TooSlow(f"more than {PATIENCE_S} s")

    signal.signal(signal.SIGALRM, ring)
    warnings.simplefilter("ignore")
    logging.disable()
    defects = []
    for name in names:
        count = round(asked.count * FORMATS[name].weight / total)
        new = defects_of(name, count, asked.first_seed)
        print(f"{name}: {count:,} inputs, {len(new)} defects", flush=True)
        defects += new
    each = max(asked.count // _PER_WELL_FORMED, 2)
    for kind in [] if asked.format else (*KINDS, DECIMAL_IDENTIFIERS):
        new = wrong_without_a_word(kind, each, asked.first_seed)
        print(f"well formed, {kind}: {each:,} inputs, {len(new)} wrong without a word", flush=True)
        defects += new
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
    if peak > MEMORY_BYTES:
        defects.append(f"the readers took {peak / 1e9:.2f} GB")
    print(*defects, f"{len(defects)} defects, peak {peak / 1e9:.2f} GB", sep="\n")
    return bool(defects)


if __name__ == "__main__":
    sys.exit(main())
