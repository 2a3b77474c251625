"""Vertical load under way: added mass, load transfer with acceleration, road roughness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

GRAVITY_MPS2 = 9.80665
_REFERENCE_WAVENUMBER_PER_M = 0.1  # of ISO 8608


@dataclass(frozen=True)
class VehicleSetup:
    """The vehicle around the instrumented (rear) wheel; the defaults are the paper's 3.6 t vehicle.

    Attributes
    ----------
    mass_kg, static_load_n : float
        Of the empty vehicle, and the share of it on the instrumented wheel.
    added_load_share : float
        Share of an added mass that the instrumented wheel carries.
    centre_of_gravity_height_m, wheelbase_m : float
    outboard_mass_kg, outboard_inertia_kgm2 : float
        On the soil side of the transducer.
    unsprung_mass_kg, body_frequency_hz, damping_ratio, contact_stiffness_n_per_m : float
        Of the quarter vehicle that rides over the road; the stiffness is that of soil and tyre in series.
    roughness_m3 : float
        ISO 8608 displacement density at 0.1 cycles/m (class C 256e-6, D 1024e-6).
    inflation_kpa : float
        Of the tyre, unless a run states another.
    """

    mass_kg: float = 3600.0
    static_load_n: float = 8000.0
    added_load_share: float = 0.4
    centre_of_gravity_height_m: float = 0.9
    wheelbase_m: float = 2.7
    outboard_mass_kg: float = 75.0
    outboard_inertia_kgm2: float = 8.0
    unsprung_mass_kg: float = 110.0
    body_frequency_hz: float = 1.4
    damping_ratio: float = 0.35
    contact_stiffness_n_per_m: float = 70e3
    roughness_m3: float = 512e-6
    inflation_kpa: float = 340.0


def vertical_load_n(
    setup: VehicleSetup,
    ground_speed_mps: FloatArray,
    ground_acceleration_mps2: FloatArray,
    rate_hz: float,
    added_load_kg: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the load between wheel and soil, positive up on the wheel; shape (n,).

    A rear wheel gains load m a h/(2 L) when the vehicle accelerates. The road acts through a linear quarter
    vehicle, so that the load swings at body and wheel frequency and rests at standstill.
    """
    static = static_load_n(setup, added_load_kg)
    mass = setup.mass_kg + added_load_kg
    lever = setup.centre_of_gravity_height_m / (2 * setup.wheelbase_m)
    return (
        static
        + mass * lever * ground_acceleration_mps2
        + road_load_n(setup, static, ground_speed_mps, rate_hz, rng.standard_normal(len(ground_speed_mps)))
    )


def static_load_n(setup: VehicleSetup, added_load_kg: float) -> float:
    """Return the load of the instrumented wheel at standstill."""
    return setup.static_load_n + setup.added_load_share * added_load_kg * GRAVITY_MPS2


def road_load_n(
    setup: VehicleSetup, static_n: float, ground_speed_mps: FloatArray, rate_hz: float, white: FloatArray
) -> FloatArray:
    """Return the load's swing about its mean from a road of ISO 8608's shape.

    Such a road's vertical velocity is white noise of density (2 pi n0)^2 Gd(n0) V at speed V.

    Parameters
    ----------
    white : float64 array, shape (n,)
        Standard normal.

    Notes
    -----
    Source: ISO 8608:2016 (road profiles, waviness 2); the quarter vehicle is the textbook's two-mass model.
    """
    from scipy.signal import bilinear_zpk, sosfilt, tf2zpk, zpk2sos

    unsprung = setup.unsprung_mass_kg
    sprung = max(static_n / GRAVITY_MPS2 - unsprung, unsprung)
    spring = sprung * (2 * np.pi * setup.body_frequency_hz) ** 2
    damper = 2 * setup.damping_ratio * np.sqrt(spring * sprung)
    contact = setup.contact_stiffness_n_per_m
    both = unsprung + sprung
    numerator = contact * np.array([unsprung * sprung, both * damper, both * spring, 0.0])
    denominator = np.array(
        [unsprung * sprung, both * damper, both * spring + contact * sprung, contact * damper, contact * spring]
    )
    zeros, poles, gain = tf2zpk(numerator, denominator)
    sections = zpk2sos(*bilinear_zpk(zeros, poles, gain, rate_hz))
    density = (2 * np.pi * _REFERENCE_WAVENUMBER_PER_M) ** 2 * setup.roughness_m3
    road_velocity = white * np.sqrt(density * ground_speed_mps * rate_hz / 2)
    return np.asarray(sosfilt(sections, road_velocity), np.float64)
