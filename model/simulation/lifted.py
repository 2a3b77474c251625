"""A recording of the lifted wheel: it stands, turns evenly in the air and stands again, for the transducer's zero."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np

from daq import RunInfo
from model.simulation.motion import Motion, integrated, smooth_steps
from model.simulation.run import Faults, Faulty, SensedRun, Sensors, VirtualSetup
from model.simulation.transducer import HubLoads, TransducerSetup
from model.simulation.truth import Circumstances

LIFTED_S = 14.0
_RATE_HZ = 1000.0
_TURNING_RADPS = 2.0 * pi
_SPEED_KNOTS = np.array([(1.0, 0.0), (2.5, _TURNING_RADPS), (12.5, _TURNING_RADPS), (13.5, 0.0)]).T
_SENSORS_SHARE = 0.35
"""Of the coloured noise on soil."""


def lifted_run(
    setup: VirtualSetup,
    info: RunInfo,
    *,
    start_ns: int,
    elapsed_s: float,
    campaign_s: float,
    wheel_radius_m: float,
    rng: np.random.Generator,
    ring: np.random.Generator,
    faults: Faults = (),
) -> SensedRun:
    """Turn the lifted wheel once a second by the engine: nothing but inertia acts on it; see `virtual_run`."""
    time_s = np.arange(round(LIFTED_S * _RATE_HZ)) / _RATE_HZ
    omega, alpha = smooth_steps(time_s, _SPEED_KNOTS)
    nothing = np.zeros(len(time_s))
    angle = integrated(omega, _RATE_HZ)
    motion = Motion(time_s, nothing, nothing, omega, alpha, angle, nothing, nothing)
    torque = setup.vehicle.outboard_inertia_kgm2 * alpha
    hub = HubLoads(time_s, nothing, nothing, torque, angle, omega)
    here = Circumstances(info, setup.vehicle.inflation_kpa, elapsed_s, campaign_s, (0.0, 1.0))
    quiet = replace(setup, transducer=_in_the_air(setup.transducer))
    sensors = Sensors(quiet, here, start_ns, len(time_s), wheel_radius_m, rng.spawn(4), ring)
    return SensedRun(info, start_ns, sensors.read(*Faulty(faults, here).of(hub, motion)))


def _in_the_air(setup: TransducerSetup) -> TransducerSetup:
    """Return the transducer without what the soil adds to its noise."""
    return replace(
        setup,
        drawbar_pull_noise_n=_SENSORS_SHARE * setup.drawbar_pull_noise_n,
        load_noise_n=_SENSORS_SHARE * setup.load_noise_n,
        lateral_noise_n=_SENSORS_SHARE * setup.lateral_noise_n,
        torque_noise_nm=_SENSORS_SHARE * setup.torque_noise_nm,
    )
