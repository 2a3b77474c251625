"""What the soil does to the wheel under way: the true histories of a virtual run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.errors import DataError, Fault
from model.conditions import Conditions
from model.contact import Quadrature
from model.virtual_test.motion import Motion
from model.wheel_soil import WheelSoilModel

FloatArray = NDArray[np.float64]

TRUTH_QUADRATURE = Quadrature(nodes=36, power=4)
"""Of the simulated truth; a fitter uses another one (12 nodes, power 3 by default)."""

_SETTLED_SPEED_MPS = 0.2
_LEAST_LOAD_N = 200.0


@dataclass(frozen=True)
class Truth:
    """True histories at the truth rate, shape (n,) each; what the soil does to the wheel, without any sensor.

    Attributes
    ----------
    time_s : since the start of the run
    slip : in the convention of both branches, 0 at standstill
    vertical_load_n, drawbar_pull_n, driving_torque_nm : between soil and wheel
    sinkage_m, static_sinkage_m
    ground_speed_mps, ground_acceleration_mps2, wheel_speed_radps, wheel_acceleration_radps2
    track_position_m : along the campaign's line, from where "out" starts
    """

    time_s: FloatArray
    slip: FloatArray
    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    sinkage_m: FloatArray
    static_sinkage_m: FloatArray
    ground_speed_mps: FloatArray
    ground_acceleration_mps2: FloatArray
    wheel_speed_radps: FloatArray
    wheel_acceleration_radps2: FloatArray
    track_position_m: FloatArray


def free_rolling_slip(model: WheelSoilModel, values: Mapping[str, float], vertical_load_n: float) -> float:
    """Return the slip at which the wheel transmits no torque: it is towed, and skids a little.

    Raises
    ------
    DataError
        The soil cannot carry the wheel.
    """
    slip = np.linspace(-0.6, 0.0, 121)
    torque = model.predict(Conditions(slip, np.full(len(slip), vertical_load_n)), dict(values)).driving_torque_nm
    if not np.isfinite(torque).all():
        raise DataError(_lost(model, "at standstill", 0.0, vertical_load_n))
    return float(np.interp(0.0, torque, slip))


def soil_reaction(
    model: WheelSoilModel,
    values: Mapping[str, float],
    motion: Motion,
    vertical_load_n: FloatArray,
    track_position_m: FloatArray,
) -> Truth:
    """Put a motion and a load through the wheel-soil model.

    The model knows rolling wheels only: towards standstill drawbar pull and torque fade out below 0.5 m/s.

    Parameters
    ----------
    model : WheelSoilModel
        With its effects and its quadrature.
    values : mapping
        Parameters of the effects.
    motion : Motion
    vertical_load_n, track_position_m : float64 array, shape (n,)

    Raises
    ------
    DataError
        The soil cannot carry the wheel at some moment of the run.
    """
    load = np.maximum(vertical_load_n, _LEAST_LOAD_N)
    prediction = model.predict(Conditions(slip=motion.slip, vertical_load_n=load), dict(values))
    lost = ~np.isfinite(prediction.drawbar_pull_n)
    if lost.any():
        i = int(np.flatnonzero(lost)[0])
        where = f"t = {motion.time_s[i]:.2f} s, {int(lost.sum())} of {len(lost)} samples"
        raise DataError(_lost(model, where, motion.slip[i], load[i]))
    rolling = -np.expm1(-((motion.ground_speed_mps / _SETTLED_SPEED_MPS) ** 2))
    return Truth(
        time_s=motion.time_s,
        slip=motion.slip,
        vertical_load_n=load,
        drawbar_pull_n=prediction.drawbar_pull_n * rolling,
        driving_torque_nm=prediction.driving_torque_nm * rolling,
        sinkage_m=prediction.sinkage_m,
        static_sinkage_m=prediction.static_sinkage_m,
        ground_speed_mps=motion.ground_speed_mps,
        ground_acceleration_mps2=motion.ground_acceleration_mps2,
        wheel_speed_radps=motion.wheel_speed_radps,
        wheel_acceleration_radps2=motion.wheel_acceleration_radps2,
        track_position_m=track_position_m,
    )


def _lost(model: WheelSoilModel, where: str, slip: float, load_n: float) -> Fault:
    return Fault(
        "the soil cannot carry the wheel: the model finds no sinkage for its load",
        where=where,
        found=f"slip {slip:.2f}, load {load_n:.0f} N on soil {model.soil.name!r}",
        next_step="choose a stiffer soil, less load, a weaker effect or a larger wheel",
    )
