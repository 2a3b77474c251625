"""The virtual test: a simulated instrumented vehicle on a soil, any effect switched on; channels out, no I/O.

Kinematics (V, slip) are prescribed, forces on the wheel come from the wheel-soil model at the true slip and load.
Truth and fitter differ in rate and quadrature, so that recovering a parameter means something.
"""

from model.virtual_test.clock import HostClock
from model.virtual_test.load import VehicleSetup
from model.virtual_test.motion import SHORTEST_RUN_S, DrivingStyle
from model.virtual_test.run import TRUTH_RATE_HZ, VirtualRun, VirtualSetup, virtual_run
from model.virtual_test.soil_draw import drawn_soil
from model.virtual_test.speed_sensors import GnssSetup, Track, WheelSpeedSetup
from model.virtual_test.transducer import TransducerSetup
from model.virtual_test.truth import TRUTH_QUADRATURE, Truth

__all__ = [
    "SHORTEST_RUN_S",
    "TRUTH_QUADRATURE",
    "TRUTH_RATE_HZ",
    "DrivingStyle",
    "GnssSetup",
    "HostClock",
    "Track",
    "TransducerSetup",
    "Truth",
    "VehicleSetup",
    "VirtualRun",
    "VirtualSetup",
    "WheelSpeedSetup",
    "drawn_soil",
    "virtual_run",
]
