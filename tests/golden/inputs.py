"""What the cases are run on: sample recordings, simulated campaigns, public tables and tests of a bevameter."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
from cli_support import ok
from measured_plates import measured_plates, write_table

ROOT = Path(__file__).parents[2]
PUBLIC = ("cmu", "plates", "published")
"""Inputs that are made of the public data (WHEELSOIL_DATA)."""

SIMULATED = {
    "biased": "--soil sandy --effect ding:n1=0.4 --effect speed_bias:offset_mps=0.08 --runs 3 --duration 20 --seed 11",
    "braked": "--soil clay --effect vasilev:H_m=0.05 --effect skid_sinkage:H2_m=0.05 --runs 4 --duration 20 --seed 12",
    "literal": "--soil sandy_loam --sinkage literal --effect lyasko:m1=0.3,m2=0.05 --runs 3 --duration 20 --seed 13"
    " --pass-number 1 --pass-number 2 --inflation 180 --wheel-axes",
    "short": "--soil clay --effect lyasko:m1=0.1,m2=0.05 --runs 2 --duration 15 --seed 14",
}
"""Campaigns by the options of ``simulate``: an error of measurement, braking, the laws as published, a short one."""
_STANCE = "--tilt 0 --brakes released"


WHERE: dict[str, Path] = {
    "clay": ROOT / "recordings" / "clay",
    "sandy": ROOT / "recordings" / "sandy",
    "real": ROOT / "studies" / "real_data",
    "wheels": Path(__file__).parent / "published",
}


def public_data_are_there() -> bool:
    """Return whether WHEELSOIL_DATA names a folder."""
    named = os.environ.get("WHEELSOIL_DATA", "")
    return bool(named) and Path(named).is_dir()


class Inputs(dict[str, Path]):
    """Folders and files by name, made in `folder` when they are first asked for."""

    def __init__(self, folder: Path) -> None:
        super().__init__(WHERE)
        self.folder = folder

    def __missing__(self, name: str) -> Path:
        if name in SIMULATED:
            target = self.folder / name
            ok("simulate", *shlex.split(f"{SIMULATED[name]} {_STANCE}"), "-o", target)
        else:
            target = _MADE[name](self.folder)
        self[name] = target
        return target


def _public(*parts: str) -> Callable[[Path], Path]:
    return lambda _: Path(os.environ["WHEELSOIL_DATA"], *parts)


def _plates(folder: Path) -> Path:
    target = folder / "plates"
    target.mkdir()
    measured_plates(target, whole=False)
    return target


def _bevameter(folder: Path) -> Path:
    """Write plate and shear tests of a known soil, with errors that repeat after some points."""
    target = folder / "bevameter"
    target.mkdir()
    z, j = np.linspace(0.0005, 0.03, 60), np.linspace(0.0, 0.08, 60)
    for i, radius in enumerate((0.05, 0.05, 0.1, 0.1)):
        error = 1.0 + 0.02 * i + 0.01 * np.sin(np.arange(60) * (i + 1))
        write_table(
            target / f"plate-{i}.csv", ("sinkage_m", "pressure_pa"), (z, (13.19e3 / radius + 692.15e3) * z**0.8 * error)
        )
    for i, stress in enumerate((10e3, 10e3, 30e3, 30e3, 60e3, 60e3)):
        error = 1.0 + 0.02 * i + 0.01 * np.sin(np.arange(60) * (i + 1))
        strength = (4140.0 + 0.4 * stress) * (1.0 - np.exp(-j / 0.012)) * error
        columns = ("displacement_m", "shear_stress_pa", "normal_stress_pa")
        write_table(target / f"shear-{i}.csv", columns, (j, strength, np.full(60, stress)))
    return target


def _single_wheel(folder: Path) -> Path:
    """Write a single-wheel test whose sinkage grows with slip: six slips, each twice."""
    slip = np.repeat(np.linspace(0.0, 0.75, 6), 2)
    error = 1.0 + 0.02 * np.sin(7.0 * np.arange(slip.size))
    load, pull = np.full(slip.size, 24.5), (9.0 * (1.0 - np.exp(-slip / 0.2)) - 3.0) * error
    columns = (slip, load, pull, (1.0 + 0.1 * pull) * error, (0.006 + 0.016 * slip) * error)
    names = ("slip", "vertical_load_n", "drawbar_pull_n", "driving_torque_nm", "sinkage_m")
    write_table(folder / "single_wheel.csv", names, columns)
    return folder / "single_wheel.csv"


_MADE: dict[str, Callable[[Path], Path]] = {
    "cmu": _public("cmu-terramech-testbed", "wheel_trials.csv"),
    "published": _public("published-single-wheel", "single_wheel.csv"),
    "plates": _plates,
    "bevameter": _bevameter,
    "single_wheel": _single_wheel,
}
