"""Layouts of several vendors: their own DBC text, names, byte orders, scales, axes and rates."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from blind.colour import Colour
from blind.sensors import Suite


@dataclass(frozen=True)
class Vendor:
    """A vehicle's electronics.

    Attributes
    ----------
    name : str
    dbc : str
        Text of its DBC.
    signals : mapping role -> (``"Message.Signal"``, factor from SI to the DBC's unit)
        A leading minus is the sensor's axis.
    rim_speed : bool
        The wheel speed is sent as the speed of the rim.
    suite : Suite
    log : "mcap" or "candump"
        How its logger writes.
    fd : bool
    wheel_axes : bool
        Frames carry forces in axes that turn with the wheel.
    declares_sigma : bool
    """

    name: str
    dbc: str
    signals: dict[str, tuple[str, float]]
    suite: Suite
    log: str
    fd: bool = False
    wheel_axes: bool = False
    declares_sigma: bool = False
    rim_speed: bool = False


_ALPINE = """VERSION ""
BU_: HUB ESP SAT LOG
BO_ 784 HubForce: 8 HUB
 SG_ Longitudinal : 7|16@0- (3,0) [-98301|98301] "N" LOG
 SG_ Lateral : 23|16@0- (3,0) [-98301|98301] "N" LOG
 SG_ Vertical : 39|16@0- (3,0) [-98301|98301] "N" LOG
 SG_ Tick : 55|8@0+ (1,0) [0|255] "" LOG
BO_ 785 HubMoment: 6 HUB
 SG_ Spin : 7|20@0- (0.05,0) [-26000|26000] "Nm" LOG
 SG_ Angle : 27|16@0+ (0.0055,0) [0|360.4] "deg" LOG
BO_ 512 WheelSpd: 8 ESP
 SG_ LR_RPM : 7|16@0+ (0.015,0) [0|983] "rpm" LOG
 SG_ RR_RPM : 23|16@0+ (0.015,0) [0|983] "rpm" LOG
BO_ 1280 SatSpeed: 4 SAT
 SG_ Groundspeed : 7|16@0+ (0.01,0) [0|655] "km/h" LOG
BO_ 1281 SatPos: 8 SAT
 SG_ Lat : 7|32@0- (1e-07,0) [-90|90] "deg" LOG
 SG_ Lon : 39|32@0- (1e-07,0) [-180|180] "deg" LOG
"""

_FJORD = """VERSION ""
BU_: WFS EBS NAV
BO_ 2566844926 EBC_WheelEnd: 8 EBS
 SG_ RimSpeedRear : 0|16@1+ (0.00390625,0) [0|251] "km/h" NAV
BO_ 2364541182 WFS_A: 8 WFS
 SG_ FZ_kN : 0|24@1- (0.0005,0) [-4000|4000] "kN" NAV
 SG_ FX_kN : 24|24@1- (0.0005,0) [-4000|4000] "kN" NAV
 SG_ MY_hi : 48|16@1- (0.001,0) [-32|32] "kNm" NAV
BO_ 2364541438 NAV_Vel: 8 NAV
 SG_ Speed2D : 0|16@1+ (0.002,0) [0|131] "m/s" EBS
 SG_ NorthPos : 16|24@1- (1.2e-05,0) [-100|100] "deg" EBS
 SG_ EastPos : 40|24@1- (2.4e-05,0) [-200|200] "deg" EBS
"""

_PAMPA = """VERSION ""
BU_: ROT AUX
BO_ 1000 Rotor: 32 ROT
 SG_ Fx : 0|32@1- (1,0) [0|0] "N" AUX
 SG_ Fz : 32|32@1- (1,0) [0|0] "N" AUX
 SG_ My : 64|32@1- (1,0) [0|0] "Nm" AUX
 SG_ Psi : 96|32@1- (1,0) [0|0] "rad" AUX
BO_ 1001 Axle: 8 AUX
 SG_ Omega : 0|32@1- (1,0) [0|0] "rad/s" ROT
BO_ 1002 Gps: 24 AUX
 SG_ V : 0|32@1- (1,0) [0|0] "m/s" ROT
 SG_ La : 64|64@1- (1,0) [0|0] "deg" ROT
 SG_ Lo : 128|64@1- (1,0) [0|0] "deg" ROT
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD","ExtendedCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 1000 2;
BA_ "VFrameFormat" BO_ 1001 2;
BA_ "VFrameFormat" BO_ 1002 2;
SIG_VALTYPE_ 1000 Fx : 1;
SIG_VALTYPE_ 1000 Fz : 1;
SIG_VALTYPE_ 1000 My : 1;
SIG_VALTYPE_ 1000 Psi : 1;
SIG_VALTYPE_ 1001 Omega : 1;
SIG_VALTYPE_ 1002 V : 1;
SIG_VALTYPE_ 1002 La : 2;
SIG_VALTYPE_ 1002 Lo : 2;
"""

VENDORS = {
    vendor.name: vendor
    for vendor in (
        Vendor(
            "alpine",
            _ALPINE,
            {
                "vertical_load": ("HubForce.Vertical", 1.0),
                "drawbar_pull": ("HubForce.Longitudinal", 1.0),
                "driving_torque": ("HubMoment.Spin", 1.0),
                "wheel_angle": ("HubMoment.Angle", 180 / pi),
                "wheel_speed": ("WheelSpd.LR_RPM", 30 / pi),
                "ground_speed": ("SatSpeed.Groundspeed", 3.6),
                "latitude": ("SatPos.Lat", 1.0),
                "longitude": ("SatPos.Lon", 1.0),
            },
            Suite(gnss_hz=20.0),
            "mcap",
            declares_sigma=True,
        ),
        Vendor(
            "fjord",
            _FJORD,
            {
                "vertical_load": ("WFS_A.FZ_kN", 1e-3),
                "drawbar_pull": ("-WFS_A.FX_kN", -1e-3),
                "driving_torque": ("WFS_A.MY_hi", 1e-3),
                "wheel_speed": ("EBC_WheelEnd.RimSpeedRear", 3.6),  # of the rim: times the radius
                "ground_speed": ("NAV_Vel.Speed2D", 1.0),
                "latitude": ("NAV_Vel.NorthPos", 1.0),
                "longitude": ("NAV_Vel.EastPos", 1.0),
            },
            Suite(force_hz=500.0, gnss_hz=50.0, receiver="first order", receiver_s=0.06, wheel_window_s=0.03),
            "candump",
            rim_speed=True,
        ),
        Vendor(
            "pampa",
            _PAMPA,
            {
                "vertical_load": ("Rotor.Fz", 1.0),
                "drawbar_pull": ("Rotor.Fx", 1.0),
                "driving_torque": ("Rotor.My", 1.0),
                "wheel_angle": ("Rotor.Psi", 1.0),
                "wheel_speed": ("Axle.Omega", 1.0),
                "ground_speed": ("Gps.V", 1.0),
                "latitude": ("Gps.La", 1.0),
                "longitude": ("Gps.Lo", 1.0),
            },
            Suite(
                force_hz=200.0,
                gnss_hz=100.0,
                wheel_hz=50.0,
                force=Colour(((0.99, 0.06), (0.01, 0.0))),
                gnss_transport_s=0.015,
            ),
            "mcap",
            fd=True,
            wheel_axes=True,
        ),
    )
}
