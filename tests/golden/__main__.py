"""``make golden`` and ``make golden-keep``: compare the cases with the kept numbers, or renew those."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: as in the tests
os.environ["WHEELSOIL_CACHE"] = "off"  # the numbers are those of this code

from golden.cases import CASES, Case
from golden.comparison import report
from golden.inputs import Inputs, public_data_are_there
from golden.store import compared, forget_unknown, keep, note


def main(argv: Sequence[str] | None = None) -> int:
    """Run the chosen cases; return 1 if a number moved that is not to be kept."""
    parser = argparse.ArgumentParser(prog="golden", description=__doc__)
    parser.add_argument("cases", nargs="*", default=["*"], help="names or patterns such as 'clay-*'; all by default")
    parser.add_argument("--keep", metavar="WHY", help="renew the numbers that moved, and note why")
    options = parser.parse_args(argv)
    if options.keep is not None and not options.keep.strip():
        parser.error('keeping new numbers needs a reason: make golden-keep WHY="..."')
    chosen = _chosen(options.cases)
    missing = [] if public_data_are_there() else [case.name for case in chosen if case.needs_public_data]
    if missing and options.keep is not None:
        parser.error(f"set WHEELSOIL_DATA, or choose other CASES: public data are needed by {' '.join(missing)}")
    moved, failed = _run([case for case in chosen if case.name not in missing], renew=options.keep is not None)
    if missing:
        named = os.environ.get("WHEELSOIL_DATA")
        why = f"WHEELSOIL_DATA, {named}, is no folder" if named else "WHEELSOIL_DATA is not set"
        print(f"\nSKIPPED {len(missing)} of {len(chosen)} cases, for {why}: {' '.join(missing)}")
    if options.keep is not None:
        gone = forget_unknown(CASES) if options.cases == ["*"] else []
        if moved or gone:
            note(options.keep.strip(), [*moved, *gone])
    return 1 if failed or (moved and options.keep is None) else 0


def _chosen(patterns: Sequence[str]) -> list[Case]:
    unknown = [text for text in patterns if not any(fnmatchcase(name, text) for name in CASES)]
    if unknown:
        sys.exit(f"no such case: {' '.join(unknown)}; there are {' '.join(CASES)}")
    return [case for name, case in CASES.items() if any(fnmatchcase(name, text) for text in patterns)]


def _run(cases: Sequence[Case], *, renew: bool) -> tuple[list[str], list[str]]:
    """Run the cases and print what moved; return the names of those that moved, and of those that failed."""
    moved, failed = [], []
    with TemporaryDirectory(prefix="golden-") as folder:
        inputs = Inputs(Path(folder))
        for case in cases:
            start = time.process_time()
            try:
                found, outputs = compared(case, inputs)
            except Exception as error:  # noqa: BLE001 - the other cases are to be compared all the same
                failed.append(case.name)
                print(f"{case.name}: FAILED, {type(error).__name__}: {error}", flush=True)
                continue
            verdict = f"{len(found)} difference{'s' * (len(found) > 1)}" if found else "as kept"
            print(f"{case.name}: {verdict} ({time.process_time() - start:.1f} s CPU)", flush=True)
            if found:
                moved.append(case.name)
                print(report(found), flush=True)
                if renew:
                    keep(case.name, outputs)
    for what, names in (("moved", moved), ("failed", failed)):
        print(f"{len(names)} of {len(cases)} cases {what}{': ' if names else ''}{' '.join(names)}")
    return moved, failed


if __name__ == "__main__":
    sys.exit(main())
