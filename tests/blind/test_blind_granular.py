"""The granular wheel's table and its interpolation, and the material points themselves where numba is installed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from blind.granular import (
    LOADS_N,
    RADIUS_M,
    ROWS,
    SOIL,
    SOIL_KEYS,
    SOIL_RELATIVE_SIGMA,
    GranularWheel,
)

AGREES = 0.03


def column(name: str, load_n: float | None = None) -> np.ndarray:
    """Return a column, of one load by slip."""
    rows = ROWS if load_n is None else sorted((row for row in ROWS if row["load_n"] == load_n), key=lambda r: r["slip"])
    return np.array([row[name] for row in rows])


def test_pull_is_used_where_cell_sizes_agree() -> None:
    share = np.abs(column("coarse_drawbar_pull_n") - column("drawbar_pull_n")) / column("load_n")
    assert np.array_equal(column("pull_agrees"), (share <= AGREES).astype(float))
    assert np.mean(column("pull_agrees")) > 0.5


def test_the_wheel_carries_its_load() -> None:
    assert np.max(np.abs(column("carried_load_n") / column("load_n") - 1)) < 0.035


def test_work_is_lost() -> None:
    lost_w = column("driving_torque_nm") / RADIUS_M - column("drawbar_pull_n") * (1 - np.maximum(column("slip"), 0))
    assert np.all(lost_w[column("slip") >= 0] > 0)


@pytest.mark.parametrize("load_n", LOADS_N)
def test_sinkage_grows_with_slip(load_n: float) -> None:
    driven = column("slip", load_n) >= 0
    assert np.all(np.diff(column("sinkage_m", load_n)[driven]) > 0)


def test_sinkage_grows_with_load() -> None:
    for lighter, heavier in pairwise(LOADS_N):
        common = np.isin(column("slip", lighter), column("slip", heavier))
        assert np.all(column("sinkage_m", lighter)[common] < column("sinkage_m", heavier))


def test_interpolation_reproduces_rows() -> None:
    pull, torque, sinkage = GranularWheel().resultants(column("slip"), column("load_n"))
    agrees, share = column("pull_agrees") > 0, column("load_n") / column("carried_load_n")
    assert pull[agrees] == pytest.approx((column("drawbar_pull_n") * share)[agrees], abs=1e-9)
    assert torque == pytest.approx(column("driving_torque_nm") * share, abs=1e-9)
    assert sinkage == pytest.approx(column("sinkage_m"), abs=1e-12)


def test_pull_of_rows_that_disagree_is_not_used() -> None:
    changed = [{**row, "drawbar_pull_n": row["drawbar_pull_n"] * row["pull_agrees"]} for row in ROWS]
    slip = np.linspace(-0.2, 0.8, 21)[:, None]
    assert np.array_equal(GranularWheel().resultants(slip, LOADS_N), GranularWheel(changed).resultants(slip, LOADS_N))


def test_interpolation_is_monotone_and_smooth_through_slip_0() -> None:
    slip = np.linspace(-0.25, 0.8, 106)[:, None]
    pull, torque, sinkage = GranularWheel().resultants(slip, np.linspace(60.0, 130.0, 8))
    assert np.all(np.diff(pull, axis=0) > 0) and np.all(np.diff(torque, axis=0) > 0)
    assert np.all(np.diff(sinkage, axis=0) >= 0)
    assert np.all(np.diff(sinkage, axis=1) > 0)


def test_slip_is_limited() -> None:
    wheel = GranularWheel()
    far, end = wheel.resultants([-1.0, 1.0], 80.0), wheel.resultants([wheel.BRAKING_LIMIT, 0.8], 80.0)
    assert np.array_equal(far, end)


def test_virtual_tests_give_six_parameters() -> None:
    assert set(SOIL) == set(SOIL_RELATIVE_SIGMA) == set(SOIL_KEYS)
    assert 25 < SOIL["friction_angle_deg"] < 35 and SOIL["cohesion_kpa"] < 1.5
    assert all(sigma > 0 for sigma in SOIL_RELATIVE_SIGMA.values())


def test_bed_under_a_plate_has_the_stress_and_strain_of_elasticity() -> None:
    pytest.importorskip("numba", reason="the extra wheelsoil[granular] is not installed")
    from studies.granular.mpm import GRAVITY_M_S2, PLATE, Bed, Body, Soil

    soil, surcharge_pa = Soil(youngs_modulus_pa=2e5), 4000.0
    bed = Bed(soil, 0.02, 0.3, 0.2, 0.1)
    start = bed.points[:, 1].copy()
    depth = bed.surface_m - start
    at = np.array([bed.left_m, bed.surface_m, 0.0, 0.0, 0.0])
    plate = Body(PLATE, np.array([0.5, 0.0, 0.0, 0.0]), at, 0.6, load_n_m=surcharge_pa * 0.3)
    carried = bed.run(plate, 0.6).rows[-20:, 2]
    assert np.mean(carried) == pytest.approx(surcharge_pa * 0.3, rel=0.01)

    middle = (depth > 0.04) & (depth < 0.16)
    vertical = soil.bulk_modulus_pa * -bed.points[middle, 8] + bed.points[middle, 9]
    weight = soil.density_kg_m3 * GRAVITY_M_S2 * depth[middle]
    assert vertical == pytest.approx(weight + surcharge_pa, rel=0.05)
    strain = np.polyfit(depth[middle], (start - bed.points[:, 1])[middle], 1)[0]
    assert -strain == pytest.approx(surcharge_pa / (soil.bulk_modulus_pa + soil.shear_modulus_pa), rel=0.02)


def test_strength_is_mohr_and_coulomb() -> None:
    pytest.importorskip("numba", reason="the extra wheelsoil[granular] is not installed")
    from studies.granular.mpm import Soil, _update_stress

    soil = Soil()
    points, rates = np.zeros((1, 12)), np.ones((4, 4, 2))
    points[0, :2], points[0, 8], points[0, 5] = 0.015, -0.01, 1.0
    rates[..., 0] = 0.0
    for _ in range(200):
        _update_stress(points, rates, np.array([0.01, 1e-3, 1600.0, 0.0]), soil.constants())
    pressure = soil.bulk_modulus_pa * 0.01
    phi = np.radians(soil.friction_angle_deg)
    expected = pressure * np.sin(phi) + soil.cohesion_pa * np.cos(phi)
    assert np.hypot(points[0, 9], points[0, 10]) == pytest.approx(expected, rel=1e-6)
