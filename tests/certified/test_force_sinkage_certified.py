"""Sinkage from forces on published wheels: their authors' sinkage, not ours."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from support import shared_file

from model.sinkage_from_forces import ShapeRanges, draw_shapes, sinkage_of_forces
from model.sinkage_from_forces.sinkage import entry_angle_of_forces

POUND_N = 4.4482216
INCH_M = 0.0254

LABORATORY = [
    # load N, slip, sinkage mm, drawbar pull N, torque N m, radius m, c1, n
    # the rover wheel of melanz/wheel-soil: c1 .43, c2 .32
    (64, 0.1, 19.806, 23.5339, 5.21226, 0.13, 0.43, 1.387),
    (64, 0.3, 21.235, 21.9615, 5.18767, 0.13, 0.43, 1.387),
    (64, 0.7, 25.597, 17.8494, 5.12402, 0.13, 0.43, 1.387),
    (130, 0.1, 28.639, 38.6053, 10.29670, 0.13, 0.43, 1.387),
    (130, 0.3, 30.736, 34.6497, 10.23402, 0.13, 0.43, 1.387),
    (130, 0.7, 37.170, 24.4741, 10.11178, 0.13, 0.43, 1.387),
    (130, 0.9, 42.440, 17.5501, 10.06718, 0.13, 0.43, 1.387),
    # Wong & Reece (1967), compact sand (c1 .43) and loose sand (c1 .18), c2 .32, as pyTerramechanics has them
    (2006 * POUND_N, 0.1, 122.707, 673.760, 2154.161, 24.7 * INCH_M, 0.43, 0.47),
    (2006 * POUND_N, 0.221, 123.318, 1292.512, 2553.459, 24.7 * INCH_M, 0.43, 0.47),
    (2006 * POUND_N, 0.6, 133.244, 1744.612, 2966.029, 24.7 * INCH_M, 0.43, 0.47),
    (1986 * POUND_N, 0.1, 272.364, 1045.550, 2808.972, 24.7 * INCH_M, 0.18, 1.15),
    (1986 * POUND_N, 0.6, 300.454, 666.423, 2937.492, 24.7 * INCH_M, 0.18, 1.15),
    (2085 * POUND_N, 0.221, 201.687, 1541.619, 2937.060, 24.7 * INCH_M, 0.18, 1.15),
]
Row = tuple[float, float, float, float, float, float, float, float]


@pytest.mark.parametrize("row", LABORATORY)
def test_laboratory_wheels_whose_shape_is_known(row: Row) -> None:
    load, slip, sinkage_mm, pull, torque, radius, c1, n = row
    angle = entry_angle_of_forces(pull / load, torque / (radius * load), c1 + 0.32 * slip, n, 0.0)
    assert 1e3 * radius * (1 - np.cos(angle)) == pytest.approx(sinkage_mm, rel=0.006)
    assert torque / radius - pull <= load * np.tan(angle)


def test_the_band_holds_laboratory_wheels_whose_shape_is_not_known() -> None:
    """Both ends of c1 are among them, one with an exponent beyond the range."""
    shapes = draw_shapes(ShapeRanges(), 2000, np.random.default_rng(0))
    inside = []
    for load, slip, sinkage_mm, pull, torque, radius, _, _ in LABORATORY:
        one = (np.array([x]) for x in (slip, pull / load, torque / (radius * load)))
        low, high = np.percentile(1e3 * sinkage_of_forces(*one, radius, shapes), [2.5, 97.5])
        inside.append(low <= sinkage_mm <= high)
    assert sum(inside) >= 11


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.slow)])
def test_the_reference_table(every: int) -> None:
    """Yang's soils, peak at the bottom: exact to 1 % with the shape known, within the band without."""
    with shared_file("reference_values.csv").open() as file:
        rows = list(csv.DictReader(file))
    load, pull, torque, radius, slip, sinkage, n = (
        np.array([float(row[k]) for row in rows]) for k in ("Wmodel_N", "Dp_N", "T_Nm", "r_m", "s", "z_m", "n")
    )
    pull_ratio, torque_ratio = pull / load, torque / (radius * load)
    angle = entry_angle_of_forces(pull_ratio, torque_ratio, 0.0, n, 0.0)
    np.testing.assert_allclose(radius * (1 - np.cos(angle)), sinkage, rtol=0.01)
    assert (torque_ratio - pull_ratio <= np.sqrt(1 / (1 - sinkage / radius) ** 2 - 1)).all()
    shapes = draw_shapes(ShapeRanges(), 400, np.random.default_rng(0))
    for size in np.unique(radius):
        of = np.flatnonzero((radius == size) & (slip > 0))[::every]
        drawn = sinkage_of_forces(slip[of], pull_ratio[of], torque_ratio[of], float(size), shapes)
        low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
        assert ((low <= sinkage[of]) & (sinkage[of] <= high)).all()
