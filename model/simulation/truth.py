"""True histories of a simulated run: the conditions along the track, and what the soil does to the wheel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from daq import DataError, Fault, FloatArray, RunInfo
from model.simulation.motion import Motion
from model.simulation.stance import StandingForces
from model.wheel_soil.conditions import Conditions
from model.wheel_soil.contact import Quadrature
from model.wheel_soil.stresses import speed_ratio
from model.wheel_soil.wheel_soil_model import WheelSoilModel

_USUAL_SPEED_MPS = 1.25
"""Mean ground speed of a run, about."""

TRUTH_QUADRATURE = Quadrature(nodes=36, power=4)
"""Of the simulated truth; a fitter uses another one (12 nodes, power 3 by default)."""

PITCH_RAD_PER_MPS2 = 0.006
"""By how much the body pitches, nose up, under acceleration: 3.4 deg per g."""

_SETTLED_SPEED_MPS = 0.2
_LEAST_LOAD_N = 200.0


@dataclass(frozen=True)
class Circumstances:
    """A run's place in its campaign.

    Attributes
    ----------
    inflation_kpa : of the tyre, whether or not the run's owner states it
    elapsed_s, campaign_s : from the start of the campaign to the start of the run, and to the end of the campaign
    line_m : (low, high)
        Where the campaign's line starts and ends, from where "out" starts.
    """

    info: RunInfo
    inflation_kpa: float
    elapsed_s: float
    campaign_s: float
    line_m: tuple[float, float]

    @property
    def direction(self) -> float:
        """1 "out", -1 "back"."""
        return -1.0 if self.info.direction == "back" else 1.0

    def campaign_time(self, time_s: FloatArray) -> FloatArray:
        """Return the campaign's clock, from -1/2 to 1/2, at times since the start of the run."""
        return (self.elapsed_s + time_s) / self.campaign_s - 0.5

    def line_position(self, track_position_m: FloatArray) -> FloatArray:
        """Return the place on the campaign's line, from -1 to 1."""
        low, high = self.line_m
        return 2.0 * (track_position_m - low) / (high - low) - 1.0

    def conditions(
        self,
        model: WheelSoilModel,
        motion: Motion,
        ground_jerk_mps3: FloatArray,
        vertical_load_n: FloatArray,
        track_position_m: FloatArray,
    ) -> Conditions:
        """Return what the wheel is put through, in full."""
        return Conditions(
            slip=motion.slip,
            vertical_load_n=vertical_load_n,
            ground_speed_mps=motion.ground_speed_mps,
            wheel_speed_radps=motion.wheel_speed_radps,
            ground_acceleration_mps2=motion.ground_acceleration_mps2,
            ground_jerk_mps3=ground_jerk_mps3,
            wheel_acceleration_radps2=motion.wheel_acceleration_radps2,
            line_position=self.line_position(track_position_m),
            campaign_time=self.campaign_time(motion.time_s),
            body_pitch_rad=PITCH_RAD_PER_MPS2 * motion.ground_acceleration_mps2,
            **self._of_run(model),
        )

    def usual_conditions(self, model: WheelSoilModel, slip: FloatArray, vertical_load_n: float) -> Conditions:
        """Return an even drive at the usual speed in the middle of the line, for slips below 0."""
        return Conditions(
            slip=slip,
            vertical_load_n=np.full(len(slip), vertical_load_n),
            ground_speed_mps=_USUAL_SPEED_MPS,
            wheel_speed_radps=_USUAL_SPEED_MPS / speed_ratio(slip) / model.wheel.radius_m,
            ground_acceleration_mps2=0.0,
            ground_jerk_mps3=0.0,
            wheel_acceleration_radps2=0.0,
            line_position=0.0,
            campaign_time=0.0,
            body_pitch_rad=0.0,
            **self._of_run(model),
        )

    def _of_run(self, model: WheelSoilModel) -> dict[str, float]:
        return {
            "direction": self.direction,
            "pass_number": float(self.info.pass_number),
            "inflation_kpa": self.inflation_kpa,
            "unit_weight_n_m3": model.soil.unit_weight_n_m3,
        }


def campaign_line_m(track_length_m: float, duration_s: float) -> tuple[float, float]:
    """Return the line that runs of a duration cover: "out" drives it from 0, "back" from the track's end."""
    driven = _USUAL_SPEED_MPS * duration_s
    return min(0.0, track_length_m - driven), max(track_length_m, driven)


@dataclass(frozen=True)
class Truth:
    """True histories at the truth rate, shape (n,) each; what the soil does to the wheel, without any sensor.

    Attributes
    ----------
    time_s : since the start of the run
    slip : in the convention of both branches, 0 at standstill
    vertical_load_n, drawbar_pull_n, driving_torque_nm : between soil and wheel
    track_position_m : along the campaign's line, from where "out" starts
    conditions : what the wheel was put through, in full
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
    conditions: Conditions


def free_rolling_slip(
    model: WheelSoilModel, values: Mapping[str, float], vertical_load_n: float, circumstances: Circumstances
) -> float:
    """Return the slip at which the wheel transmits no torque: it is towed, and skids a little; see `towed`."""
    return towed(model, values, vertical_load_n, circumstances)[0]


def towed(
    model: WheelSoilModel, values: Mapping[str, float], vertical_load_n: float, circumstances: Circumstances
) -> tuple[float, float]:
    """Return the slip of a wheel that transmits no torque, and its resistance in N.

    `DataError` where the soil cannot carry the wheel.
    """
    slip = np.linspace(-0.6, 0.0, 121)
    conditions = circumstances.usual_conditions(model, slip, vertical_load_n)
    prediction = model.predict(conditions, dict(values))
    torque = prediction.driving_torque_nm
    if not np.isfinite(torque).all():
        raise DataError(_lost(model, "at standstill", 0.0, vertical_load_n))
    free = float(np.interp(0.0, torque, slip))
    return free, -float(np.interp(free, slip, prediction.drawbar_pull_n))


def soil_reaction(
    model: WheelSoilModel,
    values: Mapping[str, float],
    motion: Motion,
    ground_jerk_mps3: FloatArray,
    vertical_load_n: FloatArray,
    track_position_m: FloatArray,
    circumstances: Circumstances,
    standing: tuple[FloatArray, FloatArray],
) -> Truth:
    """Put a motion and a load through the wheel-soil model; a long run stretch by stretch.

    The model knows rolling wheels only: towards standstill drawbar pull and torque fade out below 0.5 m/s, to what acts
    at rest too. The model has its physical effects and its quadrature, `values` the effects' parameters. Samples have
    the shape (n,); `standing` is the pull and the torque that hold the vehicle at rest. `DataError` where the soil
    cannot carry the wheel at some moment of the run.
    """
    load = np.maximum(vertical_load_n, _LEAST_LOAD_N)
    conditions = circumstances.conditions(model, motion, ground_jerk_mps3, load, track_position_m)
    prediction = model.predict(conditions, dict(values))
    lost = ~np.isfinite(prediction.drawbar_pull_n)
    if lost.any():
        i = int(np.flatnonzero(lost)[0])
        raise DataError(_lost(model, f"t = {motion.time_s[i]:.2f} s", motion.slip[i], load[i]))
    rolling = -np.expm1(-((motion.ground_speed_mps / _SETTLED_SPEED_MPS) ** 2))
    pull_at_rest, torque_at_rest = model.at_rest(conditions, dict(values))
    pull_at_rest, torque_at_rest = pull_at_rest + standing[0], torque_at_rest + standing[1]
    return Truth(
        time_s=motion.time_s,
        slip=motion.slip,
        vertical_load_n=load,
        drawbar_pull_n=pull_at_rest + (prediction.drawbar_pull_n - pull_at_rest) * rolling,
        driving_torque_nm=torque_at_rest + (prediction.driving_torque_nm - torque_at_rest) * rolling,
        sinkage_m=prediction.sinkage_m,
        static_sinkage_m=prediction.static_sinkage_m,
        ground_speed_mps=motion.ground_speed_mps,
        ground_acceleration_mps2=motion.ground_acceleration_mps2,
        wheel_speed_radps=motion.wheel_speed_radps,
        wheel_acceleration_radps2=motion.wheel_acceleration_radps2,
        track_position_m=track_position_m,
        conditions=conditions,
    )


def reaction_at_rest(
    model: WheelSoilModel,
    values: Mapping[str, float],
    time_s: FloatArray,
    vertical_load_n: FloatArray,
    circumstances: Circumstances,
    standing: StandingForces,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return load, drawbar pull and torque of `soil_reaction` when the vehicle stands again; shape (n,) each."""
    load = np.maximum(vertical_load_n, _LEAST_LOAD_N)
    conditions = circumstances.usual_conditions(model, np.zeros(len(load)), 0.0)
    conditions = replace(conditions, vertical_load_n=load, campaign_time=circumstances.campaign_time(time_s))
    pull, torque = model.at_rest(conditions, dict(values))
    return load, np.asarray(pull) + standing.drawbar_pull_n[-1:], np.asarray(torque) + standing.driving_torque_nm[-1:]


def _lost(model: WheelSoilModel, where: str, slip: float, load_n: float) -> Fault:
    return Fault(
        "the soil cannot carry the wheel: the model finds no sinkage for its load",
        where=where,
        found=f"slip {slip:.2f}, load {load_n:.0f} N on soil {model.soil.name!r}",
        next_step="choose a stiffer soil, less load, a weaker effect or a larger wheel",
    )
