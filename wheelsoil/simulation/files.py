"""Configuration files of a simulated campaign, and the random draw of its soil."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, hypot

import numpy as np
import tomli_w
from pydantic import BaseModel, ValidationError

from daq import (
    SOIL_KEYS,
    BusSection,
    ConfigError,
    Fault,
    FloatArray,
    RunInfo,
    SensorSection,
    SoilSection,
    TerrainConfig,
    TransducerSection,
    UncertaintySection,
    VehicleConfig,
    VehicleSection,
    WheelSection,
)
from model.simulation import VirtualSetup, drawn_soil
from model.wheel_soil import LABORATORY_SPREAD, Soil, Wheel, soil_from_terrain
from wheelsoil.simulation.frames import BITRATE, DBC_FILES, FRAME_TIME_S

_TRIES = 1000
_ROUNDING = 1e-9
"""Tolerance of a covariance's positive definiteness, relative to the variances."""


def draw_field_soil(
    laboratory: Soil, terrain: TerrainConfig, width_m: float, rng: np.random.Generator, where: str
) -> Soil:
    """Draw a soil from the laboratory's uncertainty.

    Relative one-sigmas are used as in `model.simulation.drawn_soil`. With a covariance the soil is normally distributed
    in the keys and units of ``[soil]``; a draw with a value out of range or without stiffness is repeated.

    Parameters
    ----------
    terrain : TerrainConfig
        Contains the uncertainty; without one, `model.wheel_soil.LABORATORY_SPREAD`.
    width_m : float
        Wheel width.
    where : str
        File name for messages.

    Raises
    ------
    ConfigError
        The covariance is not positive semi-definite, or no soil can be drawn from it.
    """
    stated = terrain.uncertainty
    if stated is None:
        return drawn_soil(laboratory, rng)
    if stated.covariance is None:
        return drawn_soil(laboratory, rng, spread_of(stated))
    root = _root(np.array(stated.covariance), where)
    mean = np.array([getattr(terrain.soil, key) for key in SOIL_KEYS])
    for _ in range(_TRIES):
        values = mean + root @ rng.standard_normal(len(SOIL_KEYS))
        soil = _soil(terrain.soil, values)
        if soil and soil.stiffness(width_m) > 0:
            return soil
    raise ConfigError(
        Fault(
            "no soil can be drawn from the covariance",
            where,
            f"{_TRIES} draws, each with a value out of its range",
            next_step="check the covariance: its rows are " + ", ".join(SOIL_KEYS),
        )
    )


def spread_of(stated: UncertaintySection) -> dict[str, float]:
    """Return relative one-sigmas with the names of `model.wheel_soil.LABORATORY_SPREAD`; zero: exactly known."""
    return {name: getattr(stated, key) or 0.0 for name, key in zip(LABORATORY_SPREAD, SOIL_KEYS, strict=True)}


def _root(covariance: FloatArray, where: str) -> FloatArray:
    """Return the lower Cholesky factor of the covariance."""
    variances = np.diag(covariance)
    sigma = np.sqrt(np.where(variances > 0, variances, 0.0))
    scale = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / np.outer(scale, scale)
    try:
        if not (np.isfinite(covariance).all() and np.allclose(correlation, correlation.T) and (variances >= 0).all()):
            raise np.linalg.LinAlgError
        root = np.linalg.cholesky(correlation + _ROUNDING * np.eye(len(covariance)))
    except np.linalg.LinAlgError:
        raise ConfigError(
            Fault(
                "the covariance is not positive semi-definite",
                where,
                expected="symmetric, no variance or combination of them below zero",
                next_step="use the covariance that `wheelsoil soil` writes, or relative one-sigmas under [uncertainty]",
            )
        ) from None
    return np.asarray(sigma[:, np.newaxis] * root)


def _soil(laboratory: SoilSection, values: FloatArray) -> Soil | None:
    drawn = laboratory.model_dump() | dict(zip(SOIL_KEYS, values.tolist(), strict=True))
    try:
        return soil_from_terrain(TerrainConfig(soil=SoilSection(**drawn)))
    except ValidationError:
        return None


_SIGNALS = {
    "vertical_load": "WFT_Forces.Fz",
    "drawbar_pull": "WFT_Forces.Fx",
    "driving_torque": "WFT_Moments.My",
    "wheel_angle": "WFT_Wheel.Angle",
    "wheel_speed": "WheelSpeeds.RearLeft",
    "ground_speed": "GNSS_2.Speed",
    "ground_speed_valid": "GNSS_3.SpeedValid",
    "latitude": "GNSS_1.Latitude",
    "longitude": "GNSS_2.Longitude",
    "course": "GNSS_2.Course",
    "gnss_time": "GNSS_1.TimeOfDay",
}


def vehicle_config(setup: VirtualSetup, wheel: Wheel, bus: str) -> VehicleConfig:
    """Return vehicle.toml: the known data of the vehicle and the declared ones of its sensors."""
    vehicle, transducer, gnss = setup.vehicle, setup.transducer, setup.gnss
    sigmas = {
        "vertical_load": hypot(transducer.load_noise_n, transducer.white_noise_n),
        "drawbar_pull": hypot(transducer.drawbar_pull_noise_n, transducer.white_noise_n),
        "driving_torque": hypot(transducer.torque_noise_nm, transducer.white_noise_nm),
        "ground_speed": hypot(gnss.speed_noise_mps, gnss.speed_white_noise_mps),
    }
    # a sample's three messages follow each other on the bus
    on_bus = {"vertical_load": 1, "drawbar_pull": 1, "driving_torque": 2, "wheel_angle": 3}
    delays = {role: transducer.latency_s + place * FRAME_TIME_S for role, place in on_bus.items()}
    delays |= dict.fromkeys(("gnss_time", "latitude", "longitude"), gnss.transport_s)
    delays |= {"wheel_speed": setup.wheel_speed.latency_s, "ground_speed": gnss.latency_s, "course": gnss.latency_s}
    return VehicleConfig(
        vehicle=VehicleSection(name="virtual test vehicle", mass_kg=vehicle.mass_kg),
        wheel=WheelSection(
            radius_m=wheel.radius_m,
            width_m=wheel.width_m,
            position=f"rear {transducer.side}",
            outboard_mass_kg=vehicle.outboard_mass_kg,
            outboard_inertia_kgm2=vehicle.outboard_inertia_kgm2,
        ),
        bus=(BusSection(channel=bus, dbc=DBC_FILES, bitrate=BITRATE),),
        signals=_SIGNALS,
        sensors={
            role: SensorSection(latency_s=round(delay, 5), sigma=round(sigmas[role], 4) if role in sigmas else None)
            for role, delay in delays.items()
        },
        transducer=TransducerSection(
            frame=transducer.frame,
            side=transducer.side,
            angle_offset_deg=transducer.angle_offset_deg,
            angle_direction=transducer.angle_direction,
            zero=transducer.zero,
        ),
    )


def terrain_config(soil: Soil, spread: Mapping[str, float]) -> TerrainConfig:
    """Return terrain.toml: the laboratory's values and their uncertainty.

    Parameters
    ----------
    spread : mapping
        Relative one-sigma per parameter, as `model.wheel_soil.LABORATORY_SPREAD`; zero: unknown.
    """
    return TerrainConfig(
        soil=SoilSection(
            name=soil.name,
            cohesion_kpa=_rounded(soil.cohesion_pa / 1e3),
            friction_angle_deg=_rounded(degrees(soil.friction_angle_rad)),
            shear_modulus_m=_rounded(soil.shear_modulus_m),
            sinkage_exponent=_rounded(soil.sinkage_exponent),
            cohesive_modulus_kn=_rounded(soil.cohesive_modulus / 1e3),
            frictional_modulus_kn=_rounded(soil.frictional_modulus / 1e3),
            unit_weight_kn_m3=_rounded(soil.unit_weight_n_m3 / 1e3),
        ),
        uncertainty=UncertaintySection(
            cohesion_kpa=spread["cohesion_pa"] or None,
            friction_angle_deg=spread["tan_phi"] or None,
            shear_modulus_m=spread["shear_modulus_m"] or None,
            sinkage_exponent=spread["sinkage_exponent"] or None,
            cohesive_modulus_kn=spread["cohesive_modulus"] or None,
            frictional_modulus_kn=spread["frictional_modulus"] or None,
        ),
    )


def runs_toml(infos: list[RunInfo]) -> bytes:
    """Return runs.toml, one ``[[run]]`` table each."""
    tables = (tomli_w.dumps(info.model_dump(mode="json", exclude_none=True)) for info in infos)
    return "\n".join(f"[[run]]\n{table}" for table in tables).encode()


def to_toml(config: BaseModel) -> bytes:
    """Return a validated model as TOML, without keys at their default."""
    return tomli_w.dumps(config.model_dump(mode="json", exclude_none=True, exclude_defaults=True)).encode()


def _rounded(value: float) -> float:
    """Round to 12 digits, which removes the rounding errors of unit conversion."""
    return float(f"{value:.12g}")
