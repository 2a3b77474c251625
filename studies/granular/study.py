"""Virtual single-wheel tests and bevameter tests on one granular soil; by hand, resumable.

``pip install 'wheelsoil[granular]'``, then in the repository's folder:

``python -m studies.granular.study wheel`` appends finished cases to cases.csv; a second start continues there.
``python -m studies.granular.study bevameter`` writes plate_*.csv and shear.csv, from which `wheelsoil soil` makes
terrain.toml.
``python -m studies.granular.study table`` writes table.csv from cases.csv.

A wheel case takes 8 s (coarser cells) to 76 s (finer cells, slip 0.8) of one core, the bevameter tests 4 minutes.
"""

from __future__ import annotations

import csv
import sys
import time
from dataclasses import asdict, fields
from itertools import product
from pathlib import Path

from daq import FloatArray
from studies.granular.bevameter import press_plate, shear_box
from studies.granular.mpm import Soil
from studies.granular.wheel import SMALL_BED_SLIP, Case, Steady, drive

HERE = Path(__file__).parent
SOIL = Soil()
SLIPS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8, 0.05, 0.7, -0.1)
"""In the order in which they are run."""
LOADS_N = (60.0, 90.0, 130.0)
SMALL_BED_CELLS_M, LARGE_BED_CELLS_M = (0.003, 0.0045), (0.0035, 0.00525)
"""Finer and coarser cell up to a slip of `SMALL_BED_SLIP`, and above it; the table's values are those of the finer."""
PLATES_M, PLATE_DEPTH_M = (0.06, 0.12), 0.05
PLATE_CELLS_M = (0.0045, 0.00675)
NORMAL_STRESSES_PA, SHEAR_TO_M = (5e3, 10e3, 20e3), 0.006
REPEATS = 3
"""With points scattered anew."""
AGREES = 0.03
"""Largest difference of drawbar pull between the cell sizes, as a share of the load."""


def run_wheel() -> None:
    """Run the cases that cases.csv does not contain."""
    path = HERE / "cases.csv"
    names = [*(f.name for f in fields(Case)), *(f.name for f in fields(Steady)), "cpu_s"]
    done = {case for case, _ in finished_cases()} if path.exists() else set()
    for slip, load, which in product(SLIPS, LOADS_N, (1, 0)):
        case = Case(slip, load, cells_m(slip)[which])
        if case in done:
            continue
        start = time.process_time()
        steady, _ = drive(case, SOIL)
        row = {**asdict(case), **asdict(steady), "cpu_s": time.process_time() - start}
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, names, lineterminator="\n")
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow({name: f"{value:.5g}" for name, value in row.items()})


def cells_m(slip: float) -> tuple[float, float]:
    """Return the finer and the coarser cell of a slip."""
    return SMALL_BED_CELLS_M if slip <= SMALL_BED_SLIP else LARGE_BED_CELLS_M


def finished_cases() -> list[tuple[Case, dict[str, float]]]:
    """Return the rows of cases.csv."""
    with (HERE / "cases.csv").open(newline="") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    return [(Case(row["slip"], row["load_n"], row["cell_m"]), row) for row in rows]


def run_bevameter() -> None:
    """Write the plate tests and the shear tests as `wheelsoil soil` reads them."""
    for width in PLATES_M:
        for cell in PLATE_CELLS_M:
            repeats = REPEATS if cell == PLATE_CELLS_M[0] else 1
            tests = [press_plate(SOIL, width, PLATE_DEPTH_M, cell, seed) for seed in range(repeats)]
            coarse = "" if cell == PLATE_CELLS_M[0] else "_coarse"
            _write_tests(f"plate_{1e3 * width:03.0f}mm{coarse}.csv", ("sinkage_m", "pressure_pa"), tests)
    tests = [shear_box(SOIL, stress, SHEAR_TO_M, seed) for stress in NORMAL_STRESSES_PA for seed in range(REPEATS)]
    _write_tests("shear.csv", ("displacement_m", "shear_stress_pa", "normal_stress_pa"), tests)


def _write_tests(name: str, columns: tuple[str, ...], tests: list[FloatArray]) -> None:
    with (HERE / name).open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["test", *columns])
        for number, rows in enumerate(tests):
            writer.writerows([number, *(f"{value:.4g}" for value in row)] for row in rows.tolist())


def write_table() -> None:
    """Write table.csv: the finer cells' values and the coarser cells' pull, in the order of load and slip."""
    cases = dict(finished_cases())
    rows = []
    for load, slip in product(LOADS_N, sorted(SLIPS)):
        fine, coarse = (cases.get(Case(slip, load, cell)) for cell in cells_m(slip))
        if fine is None or coarse is None:
            continue
        row = {name: value for name, value in fine.items() if name != "cpu_s"}
        for name in ("drawbar_pull_n", "driving_torque_nm", "sinkage_m"):
            row[f"coarse_{name}"] = coarse[name]
        row["pull_agrees"] = float(abs(coarse["drawbar_pull_n"] - fine["drawbar_pull_n"]) <= AGREES * load)
        rows.append(row)
    with (HERE / "table.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: f"{value:.5g}" for name, value in row.items()} for row in rows)


if __name__ == "__main__":
    {"wheel": run_wheel, "bevameter": run_bevameter, "table": write_table}[sys.argv[1]]()
