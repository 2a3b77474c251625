"""Bands of the sinkage from forces on published wheels, laboratories left out one at a time.

``WHEELSOIL_DATA=... python -m studies.published_wheels.bands`` prints the rows of docs/sinkage.md and writes
studies/published_wheels/bands.json. Only tests with torque and sinkage can say something; those of CMU and of Hurrell
et al. have no torque. The wheels of wheels.csv are read off publications whose authors computed them with a moved peak;
those of Ding et al. were measured.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from model.sinkage_from_forces import ShapeRanges, draw_shapes, sinkage_of_forces

HERE = Path(__file__).parent
_DRAWS = 2000
_BOW_WAVES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
_WANTED = 0.95
_BARE = replace(ShapeRanges(), bow_wave=(0.0, 0.0), wheel_sigma=0.0)
"""Without what is calibrated."""


@dataclass(frozen=True)
class Row:
    """One row of a single-wheel test; SI."""

    laboratory: str
    wheel: str
    load_n: float
    slip: float
    sinkage_m: float
    pull_n: float
    torque_nm: float
    radius_m: float
    lug_height_m: float

    def log_ratios(self, ranges: ShapeRanges) -> tuple[float, float, float]:
        """Return ln of both ends of the band and of the measured sinkage, over the median."""
        shapes = draw_shapes(ranges, _DRAWS, np.random.default_rng(0))
        ratios = (np.array([self.pull_n / self.load_n]), np.array([self.torque_nm / (self.radius_m * self.load_n)]))
        drawn = sinkage_of_forces(np.array([self.slip]), *ratios, self.radius_m, shapes, self.lug_height_m)
        low, middle, high = np.log(np.percentile(drawn, [2.5, 50.0, 97.5]))
        return float(low - middle), float(high - middle), float(np.log(self.sinkage_m) - middle)

    def inside(self, ranges: ShapeRanges) -> bool:
        """Return whether the measured sinkage is in the band."""
        low, high, measured = self.log_ratios(ranges)
        return low <= measured <= high


def published_rows() -> list[Row]:
    """Return the driven rows with torque and sinkage."""
    with (HERE / "wheels.csv").open(encoding="utf-8") as file:
        found = [
            Row(r["laboratory"], r["wheel"], *(float(r[k]) for k in list(Row.__dataclass_fields__)[2:]))
            for r in csv.DictReader(file)
        ]
    path = Path(os.environ["WHEELSOIL_DATA"], "published-single-wheel", "single_wheel.csv")
    with path.open(encoding="utf-8") as file:
        for r in csv.DictReader(file):
            if r["meas_torque_nm"] and float(r["slip"]) > 0:
                names = ("vertical_load_n", "slip", "meas_sinkage_m", "meas_drawbar_pull_n", "meas_torque_nm")
                sizes = ("wheel_radius_m", "grouser_height_m")
                wheel = f"{r['source']}, lugs {1e3 * float(r['grouser_height_m']):g} mm"
                found.append(Row(r["source"], wheel, *(float(r[k]) for k in (*names, *sizes))))
    return found


def calibrated(rows: Iterable[Row]) -> ShapeRanges:
    """Return the ranges that rows ask for: the least bow wave with which 95 % are inside, and the wheels' scatter."""
    known = list(rows)
    found = _BARE
    for bow_wave in _BOW_WAVES:
        found = replace(_BARE, bow_wave=(0.0, bow_wave))
        if np.mean([row.inside(found) for row in known]) >= _WANTED:
            break
    wheels = dict.fromkeys(row.wheel for row in known)
    means = [np.mean([row.log_ratios(found)[2] for row in known if row.wheel == wheel]) for wheel in wheels]
    return replace(found, wheel_sigma=float(np.sqrt(np.mean(np.square(means)))))


def counted(rows: Iterable[Row], ranges: ShapeRanges) -> dict[str, Any]:
    """Return how many rows are inside, and the mean ends of the band over the median."""
    known = list(rows)
    ends = np.exp(np.mean([row.log_ratios(ranges) for row in known], axis=0))
    return {
        "rows": len(known),
        "inside": sum(row.inside(ranges) for row in known),
        "low": float(ends[0]),
        "high": float(ends[1]),
        "measured": float(ends[2]),
    }


def study() -> dict[str, Any]:
    """Return the coverage by wheel, as shipped and bare, and by laboratory calibrated on the others."""
    rows = published_rows()
    laboratories = dict.fromkeys(row.laboratory for row in rows)
    left_out = {}
    for laboratory in laboratories:
        ranges = calibrated(row for row in rows if row.laboratory != laboratory)
        own = [row for row in rows if row.laboratory == laboratory]
        left_out[laboratory] = {
            **counted(own, ranges),
            "bow_wave": ranges.bow_wave[1],
            "wheel_sigma": ranges.wheel_sigma,
        }
    wheels = {row.wheel: [r for r in rows if r.wheel == row.wheel] for row in rows}
    return {
        "shipped": {wheel: counted(own, ShapeRanges()) for wheel, own in wheels.items()},
        "bare": {wheel: counted(own, _BARE) for wheel, own in wheels.items()},
        "left_out": left_out,
    }


if __name__ == "__main__":
    found = json.loads(json.dumps(study(), default=float), parse_float=lambda text: float(f"{float(text):.3g}"))
    for part, lines in found.items():
        print(part)
        for name, line in lines.items():
            print(f"  {name}: {line}")
    (HERE / "bands.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
