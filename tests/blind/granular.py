"""A wheel from a granular simulation: pull, torque and sinkage interpolated in studies/granular/table.csv.

No formula of the engine is in it: the table is from material points (studies/granular). `SOIL` is what virtual plate
and shear tests on the same material points gave (studies/granular/terrain.toml).
"""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path

import numpy as np
from blind.ground import Ground
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from daq import FloatArray

STUDY = Path(__file__).resolve().parents[2] / "studies" / "granular"
RADIUS_M, WIDTH_M = 0.15, 0.1
SOIL_KEYS = (
    "cohesion_kpa",
    "friction_angle_deg",
    "shear_modulus_m",
    "sinkage_exponent",
    "cohesive_modulus_kn",
    "frictional_modulus_kn",
)


def table_rows(path: Path = STUDY / "table.csv") -> list[dict[str, float]]:
    """Return the table's rows: one per slip and load."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def soil_of_terrain(path: Path = STUDY / "terrain.toml") -> tuple[dict[str, float], dict[str, float]]:
    """Return the six soil parameters and their relative one-sigma (friction angle: of tan phi)."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    values = {key: float(content["soil"][key]) for key in SOIL_KEYS}
    sigmas = np.sqrt(np.diag(np.array(content["uncertainty"]["covariance"], dtype=np.float64)))
    phi = np.radians(values["friction_angle_deg"])
    relative = {key: float(s / max(abs(values[key]), 1e-9)) for key, s in zip(SOIL_KEYS, sigmas.tolist(), strict=True)}
    sigma_phi = np.radians(float(sigmas[SOIL_KEYS.index("friction_angle_deg")]))
    relative["friction_angle_deg"] = float(sigma_phi / (np.cos(phi) ** 2 * np.tan(phi)))
    return values, relative


def ground_of_terrain() -> Ground:
    """Return the same soil as the generator has it."""
    values, _ = soil_of_terrain()
    c, phi, shear, exponent, cohesive, frictional = (values[key] for key in SOIL_KEYS)
    return Ground(
        "granular", 1e3 * c, float(np.tan(np.radians(phi))), shear, exponent, 1e3 * cohesive, 1e3 * frictional
    )


ROWS = table_rows()
LOADS_N = tuple(sorted({row["load_n"] for row in ROWS}))
SOIL, SOIL_RELATIVE_SIGMA = soil_of_terrain()


class GranularWheel:
    """Drawbar pull, driving torque and sinkage of the simulated wheel by slip and load.

    D/W, T/(r W) and z/r, with W the load that was carried, are interpolated by monotone cubics (PCHIP) over slip at
    each load, and by the parabola through the three loads.

    Pull comes only from rows whose two cell sizes agree. Most of them are of the lightest load; another load's D/W is
    the lightest load's plus a difference, which is linear between the slips at which that load's rows agree, and
    constant beyond them.

    Slip is (r omega - V) over the larger of both; it is limited to the table, and so is the load. The table does not
    contain braking: down to `BRAKING_LIMIT` pull and torque are continued so that their change from slip 0 is odd, and
    sinkage stays that of slip 0.

    Parameters
    ----------
    rows : of the table, optional
    """

    BRAKING_LIMIT = -0.3

    def __init__(self, rows: list[dict[str, float]] | None = None) -> None:
        self._rows = ROWS if rows is None else rows
        self.loads_n = np.array(sorted({row["load_n"] for row in self._rows}))
        self._sinkage = [self._curve(load, "sinkage_m") for load in self.loads_n]
        self._torque = [self._curve(load, "driving_torque_nm") for load in self.loads_n]
        self._pull = [self._curve(load, "drawbar_pull_n", agreeing=True) for load in self.loads_n]

    def _curve(self, load_n: float, name: str, *, agreeing: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return slips and dimensionless values at a load."""
        rows = [row for row in self._rows if row["load_n"] == load_n and (row["pull_agrees"] or not agreeing)]
        unit = {"sinkage_m": lambda w: RADIUS_M, "driving_torque_nm": lambda w: RADIUS_M * w, "drawbar_pull_n": float}
        pairs = sorted((row["slip"], row[name] / unit[name](row["carried_load_n"])) for row in rows)
        slip, value = np.array(pairs).T
        return slip, value

    def _pull_ratio(self, slip: FloatArray, which: int) -> FloatArray:
        """Return D/W at a load of the table: the lightest load's and the difference from it."""
        lightest = PchipInterpolator(*self._pull[0])
        at, value = self._pull[which]
        return np.asarray(lightest(slip) + np.interp(slip, at, value - lightest(at)), dtype=np.float64)

    def _over_load(self, values: list[FloatArray], load_n: FloatArray) -> FloatArray:
        """Return the parabola through the values at the three loads."""
        total = np.zeros(np.broadcast_shapes(values[0].shape, load_n.shape))
        for i, value in enumerate(values):
            others = np.delete(self.loads_n, i)
            total += value * np.prod([(load_n - other) / (self.loads_n[i] - other) for other in others], axis=0)
        return total

    def _driven(self, slip: FloatArray, load_n: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return D/W, T/(r W) and z/r within the table."""
        pull = [self._pull_ratio(slip, i) for i in range(len(self.loads_n))]
        torque, sinkage = ([PchipInterpolator(*curve)(slip) for curve in x] for x in (self._torque, self._sinkage))
        return self._over_load(pull, load_n), self._over_load(torque, load_n), self._over_load(sinkage, load_n)

    def resultants(self, slip: ArrayLike, vertical_load_n: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return drawbar pull (N), driving torque (N m) and sinkage (m)."""
        load = np.clip(np.asarray(vertical_load_n, dtype=np.float64), self.loads_n[0], self.loads_n[-1])
        s = np.clip(np.asarray(slip, dtype=np.float64), self.BRAKING_LIMIT, self._sinkage[0][0][-1])
        pull, torque, sinkage = self._driven(np.abs(s), load)
        pull_0, torque_0, sinkage_0 = self._driven(np.zeros_like(s), load)
        braking = s < 0
        pull = np.where(braking, 2 * pull_0 - pull, pull)
        torque = np.where(braking, 2 * torque_0 - torque, torque)
        w = np.asarray(vertical_load_n, dtype=np.float64)
        return pull * w, torque * w * RADIUS_M, np.where(braking, sinkage_0, sinkage) * RADIUS_M
