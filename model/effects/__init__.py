"""The library of effects: one hypothesis a file; `EFFECTS` lists them by their short name.

Installed packages add theirs by an entry point (`model.effects.library`).
"""

from __future__ import annotations

from model.effects.base import Effect, Parameter, Values
from model.effects.bulldozing import Bulldozing
from model.effects.closed_form_sinkage import ClosedFormSinkage
from model.effects.crosstalk import Crosstalk
from model.effects.ding import Ding
from model.effects.drawbar_pull_gain import DrawbarPullGain
from model.effects.drawbar_pull_zero import DrawbarPullZero
from model.effects.exit_angle import ExitAngle
from model.effects.grouser import Grouser
from model.effects.interface_friction import InterfaceFriction
from model.effects.library import Library
from model.effects.load_gain import LoadGain
from model.effects.load_zero import LoadZero
from model.effects.lyasko import Lyasko
from model.effects.multi_pass import MultiPass
from model.effects.rate_stiffness import RateStiffness
from model.effects.second_order import SecondOrder
from model.effects.shear_softening import ShearSoftening
from model.effects.skid_sinkage import SkidSinkage
from model.effects.slope import Slope
from model.effects.speed_bias import SpeedBias
from model.effects.speed_latency import SpeedLatency
from model.effects.stress_peak_shift import StressPeakShift
from model.effects.torque_gain import TorqueGain
from model.effects.torque_zero import TorqueZero
from model.effects.track_drift import TrackDrift
from model.effects.tyre_flattening import TyreFlattening
from model.effects.vasilev import Vasilev
from model.effects.wheel_inertia import WheelInertia
from model.effects.wheel_radius import WheelRadius
from model.effects.zero_drift import ZeroDrift

PHYSICAL: tuple[type[Effect], ...] = (
    Vasilev,
    Lyasko,
    Ding,
    SecondOrder,
    SkidSinkage,
    StressPeakShift,
    InterfaceFriction,
    Bulldozing,
    ExitAngle,
    RateStiffness,
    MultiPass,
    TrackDrift,
    ShearSoftening,
    Grouser,
    TyreFlattening,
    Slope,
    WheelInertia,
    ClosedFormSinkage,
)
MEASUREMENT: tuple[type[Effect], ...] = (
    WheelRadius,
    SpeedLatency,
    SpeedBias,
    DrawbarPullGain,
    TorqueGain,
    Crosstalk,
    LoadGain,
    DrawbarPullZero,
    TorqueZero,
    LoadZero,
    ZeroDrift,
)

EFFECTS = Library((*PHYSICAL, *MEASUREMENT))
"""Every known effect: form where the family has several, else family."""

__all__ = ["EFFECTS", "MEASUREMENT", "PHYSICAL", "Effect", "Parameter", "Values"]
