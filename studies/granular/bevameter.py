"""Virtual bevameter on the granular soil: strip plates that are pressed in, and a shear box."""

from __future__ import annotations

from math import radians, tan

import numpy as np

from daq import FloatArray
from studies.granular.mpm import BOX, PLATE, Bed, Body, Soil

PRESS_MPS, SHEAR_MPS = 0.025, 0.01
_BED_M = (0.36, 0.22, 0.08)
"""Half of the bed under a plate: length, depth, room above."""
_RAMP = np.linspace(0.05, 0.95, 10)
"""Shares of the speed at which a plate starts, 5 ms each; at once would send a shock through the soil."""
_BOX_LENGTH_M, _BOX_HEIGHT_M, _BOX_ROOM_M = 0.06, 0.04, 0.03
_BOX_CELL_M = 0.002


def press_plate(soil: Soil, width_m: float, depth_m: float, cell_m: float, seed: int) -> FloatArray:
    """Press a rough strip plate in; return sinkage (m) and pressure (Pa), shape (n, 2).

    Half of the plate and of the soil is simulated.
    """
    bed = Bed(soil, cell_m, *_BED_M, seed)
    state = np.array([bed.left_m, bed.surface_m, 0.0, 0.0, 0.0])
    plate = Body(PLATE, np.array([width_m / 2, 0.0, 0.0, 0.0]), state, tan(radians(soil.friction_angle_deg)))
    for share in _RAMP:
        plate.state[3] = -share * PRESS_MPS
        bed.run(plate, 5e-3)
    plate.state[3] = -PRESS_MPS
    rows = bed.run(plate, (depth_m - (bed.surface_m - state[1])) / PRESS_MPS, every_s=1e-3 / PRESS_MPS).rows
    middle = bed.surface_m - rows[:, 5] - 0.5e-3
    return np.column_stack([middle, rows[:, 2] / (width_m / 2)])


def shear_box(soil: Soil, normal_stress_pa: float, displacement_m: float, seed: int) -> FloatArray:
    """Shear a box of 60 mm by 40 mm under a lid with a dead load; return displacement, shear and applied stress."""
    bed = Bed(soil, _BOX_CELL_M, _BOX_LENGTH_M + 2 * _BOX_ROOM_M, _BOX_HEIGHT_M, _BOX_ROOM_M, seed)
    left, base = bed.left_m + _BOX_ROOM_M, bed.bottom_m
    right, lid = left + _BOX_LENGTH_M, base + _BOX_HEIGHT_M
    bed.points = bed.points[(bed.points[:, 0] > left) & (bed.points[:, 0] < right)]
    at_rest = soil.earth_pressure_at_rest
    bed.points[:, 8] = -normal_stress_pa * (1 + at_rest) / 2 / soil.bulk_modulus_pa
    bed.points[:, 9] = normal_stress_pa * (1 - at_rest) / 2
    box = Body(
        BOX,
        np.array([left, right, base, (base + lid) / 2]),
        np.array([0.0, lid, 0.0, 0.0, 0.0]),
        tan(radians(soil.friction_angle_deg)),
        load_n_m=normal_stress_pa * _BOX_LENGTH_M,
        stiffness_n_m2=soil.youngs_modulus_pa * _BOX_LENGTH_M / _BOX_HEIGHT_M,
    )
    bed.run(box, 0.05, gravity=0.0)
    box.state[2] = SHEAR_MPS
    rows = bed.run(box, displacement_m / SHEAR_MPS, every_s=0.2e-3 / SHEAR_MPS, gravity=0.0).rows
    applied = np.full(len(rows), normal_stress_pa)
    return np.column_stack([rows[:, 4] - 0.1e-3, -rows[:, 1] / _BOX_LENGTH_M, applied])
