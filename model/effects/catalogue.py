"""Every effect that ships: `EFFECTS` lists them by their short name, and takes up those of installed packages."""

from __future__ import annotations

from model.effects.base import Effect
from model.effects.library import Library
from model.effects.slip_sinkage.closed_form_sinkage import ClosedFormSinkage
from model.effects.slip_sinkage.ding import Ding
from model.effects.slip_sinkage.lyasko import Lyasko
from model.effects.slip_sinkage.second_order import SecondOrder
from model.effects.slip_sinkage.skid_sinkage import SkidSinkage
from model.effects.slip_sinkage.vasilev import Vasilev
from model.effects.soil.bulldozing import Bulldozing
from model.effects.soil.exit_angle import ExitAngle
from model.effects.soil.grouser import Grouser
from model.effects.soil.interface_friction import InterfaceFriction
from model.effects.soil.multi_pass import MultiPass
from model.effects.soil.rate_stiffness import RateStiffness
from model.effects.soil.shear_softening import ShearSoftening
from model.effects.soil.stress_peak_shift import StressPeakShift
from model.effects.soil.track_drift import TrackDrift
from model.effects.transducer.crosstalk import Crosstalk
from model.effects.transducer.drawbar_pull_gain import DrawbarPullGain
from model.effects.transducer.drawbar_pull_zero import DrawbarPullZero
from model.effects.transducer.load_gain import LoadGain
from model.effects.transducer.load_zero import LoadZero
from model.effects.transducer.torque_gain import TorqueGain
from model.effects.transducer.torque_zero import TorqueZero
from model.effects.transducer.zero_drift import ZeroDrift
from model.effects.vehicle.slope import Slope
from model.effects.vehicle.speed_bias import SpeedBias
from model.effects.vehicle.speed_latency import SpeedLatency
from model.effects.vehicle.tyre_flattening import TyreFlattening
from model.effects.vehicle.wheel_inertia import WheelInertia
from model.effects.vehicle.wheel_radius import WheelRadius

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
