"""Measured plate tests of a public single-wheel test bed, as tables."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from support import data_dir

TESTBED = ("cmu-terramech-testbed", "pressure_sinkage")
CLOCKS_S = 18_000  # the kinematics are stamped in local time


def measured_plates(folder: Path, *, whole: bool) -> list[Path]:
    """Join each plate's kinematics and forces to a table; in the authors' window and from their zero, or all of it."""
    source = data_dir(*TESTBED)
    written = []
    with (source / "index.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["body"].startswith("circular plate")]
    for row in rows:
        kinematics = np.loadtxt(source / f"{row['run']}.txt", delimiter=",")
        t_s, force = np.loadtxt(source / f"{row['run']}_ft.csv", delimiter=",", skiprows=1, usecols=(0, 3)).T
        time, down = kinematics[:, 6] + CLOCKS_S - float(row["bag_start_unix"]), -kinematics[:, 4] * 1e-3
        start, end = (t_s[0], t_s[-1]) if whole else (float(row["window_start_s"]), float(row["window_end_s"]))
        kept = (time >= start) & (time <= end)
        load = -np.interp(time[kept], t_s, force) - (0.0 if whole else float(row["Fz_offset_N"]))
        sinkage = down[kept] + (0.0 if whole else float(row["z_zero_mm"]) * 1e-3)
        radius = np.full(sinkage.size, float(row["body"].split()[2]) / 2e3)
        written.append(folder / f"{row['run']}.csv")
        write_table(written[-1], ["sinkage_m", "force_n", "radius_m"], [sinkage, load, radius])
    return written


def write_table(path: Path, names: Sequence[str], columns: Sequence[Any]) -> None:
    """Write columns as a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(zip(*columns, strict=True))
