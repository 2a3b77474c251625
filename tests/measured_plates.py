"""Measured plate tests of a public single-wheel test bed, as tables."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from support import data_dir

from studies.real_data.study import plate_tests

TESTBED = ("cmu-terramech-testbed", "pressure_sinkage")


def measured_plates(folder: Path, *, whole: bool) -> list[Path]:
    """Write each plate's sinkage and force to a table; in the authors' window and from their zero, or all of it."""
    data_dir(*TESTBED)
    written = []
    for run, sinkage_m, force_n, radius_m in plate_tests(whole=whole):
        written.append(folder / f"{run}.csv")
        columns = [sinkage_m, force_n, np.full(sinkage_m.size, radius_m)]
        write_table(written[-1], ["sinkage_m", "force_n", "radius_m"], columns)
    return written


def write_table(path: Path, names: Sequence[str], columns: Sequence[Any]) -> None:
    """Write columns as a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(zip(*columns, strict=True))
