"""Filtered roles to a `ProcessedRun`: slip, segments, reasons, quality."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from daq.clock import ClockFit
from daq.config import RunInfo
from processing.distance import distance_of
from processing.inputs import MODEL_ROLES
from processing.noise import standstill_sigma
from processing.on_base import OnBase
from processing.options import SLIP_ROLES, ProcessOptions
from processing.processed_run import ProcessedRun, QualityReport, Reason
from processing.quality import combine_reasons, run_notes, sensor_notes, shares_of, speed_notes
from processing.segments import segment
from processing.slip import slip_of, slip_sigma
from processing.speeds import SpeedComparison, compare_speeds
from processing.timebase import FloatArray
from processing.zeroing import standstills

FORCES = ("drawbar_pull", "driving_torque", "vertical_load")


@dataclass(frozen=True)
class Material:
    """Everything on one time base; arrays of shape (n,), NaN where not known.

    Attributes
    ----------
    start_ns, time_s, cutoff_hz
        As in `ProcessedRun`.
    roles : mapping role -> OnBase
        Those that the run carries, one of them at least.
    latitude_deg, longitude_deg : float64 arrays
    clock : ClockFit or None
    notes : tuple of str
    missing : mapping role -> str
        See `QualityReport`.
    """

    start_ns: int
    time_s: FloatArray
    cutoff_hz: float
    roles: dict[str, OnBase]
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    clock: ClockFit | None
    notes: tuple[str, ...]
    missing: dict[str, str] = field(default_factory=dict)

    def values(self, role: str) -> FloatArray:
        """Return a role's values, NaN where the run does not carry it."""
        return self.roles[role].values if role in self.roles else self._constant(nan)

    def slope(self, role: str) -> FloatArray:
        """Return the derivative of a role, per second; NaN where the run does not carry it."""
        return self.roles[role].slope if role in self.roles else self._constant(nan)

    @property
    def has_slip(self) -> bool:
        """Whether both speeds were measured."""
        return all(role in self.roles for role in SLIP_ROLES)

    def sigma(self, role: str) -> FloatArray:
        """Return the one-sigma of each sample of a role."""
        return self._constant(self.roles[role].facts.sigma if role in self.roles else nan)

    def reasons(self) -> dict[str, NDArray[np.uint8]]:
        """Return the reasons of every channel that a used sample must have."""
        return {role: self.roles[role].reason for role in MODEL_ROLES if role in self.roles}

    def _constant(self, value: float) -> FloatArray:
        return np.broadcast_to(np.float64(value), self.time_s.shape)


def assemble(material: Material, radius_m: float, run: RunInfo, options: ProcessOptions) -> ProcessedRun:
    """Form slip, segments and reasons.

    Parameters
    ----------
    material : Material
    radius_m : float
        Nominal radius of the wheel, as in Eq. 6.
    run : RunInfo
    options : ProcessOptions
    """
    ground, rim = material.values("ground_speed"), radius_m * material.values("wheel_speed")
    slip = slip_of(rim, ground, options.min_speed_mps)
    sigma = slip_sigma(
        rim,
        ground,
        radius_m * material.sigma("wheel_speed"),
        material.sigma("ground_speed"),
        options.min_speed_mps,
    )
    acceleration = material.slope("ground_speed")
    torque, load = material.values("driving_torque"), material.values("vertical_load")
    segments = segment(rim, ground, acceleration, slip, torque / radius_m, load, options.rate_hz)
    material = with_standstill_noise(material, segments, options.rate_hz)
    reason = combine_reasons(material.reasons().values(), segments, slip, load, slip_is_measured=material.has_slip)
    distance, bridged_m = distance_of(material.time_s, ground)
    notes = [f"distance: {bridged_m:.1f} m were not seen and are bridged with the speeds around them"] * (bridged_m > 0)
    return ProcessedRun(
        run=run,
        rate_hz=options.rate_hz,
        cutoff_hz=material.cutoff_hz,
        wheel_radius_m=radius_m,
        start_ns=material.start_ns,
        time_s=material.time_s,
        slip=slip,
        slip_sigma=sigma,
        ground_speed_mps=ground,
        ground_speed_sigma_mps=material.sigma("ground_speed"),
        wheel_speed_radps=material.values("wheel_speed"),
        wheel_speed_sigma_radps=material.sigma("wheel_speed"),
        vertical_load_n=load,
        vertical_load_sigma_n=material.sigma("vertical_load"),
        drawbar_pull_n=material.values("drawbar_pull"),
        drawbar_pull_sigma_n=material.sigma("drawbar_pull"),
        driving_torque_nm=torque,
        driving_torque_sigma_nm=material.sigma("driving_torque"),
        sinkage_m=material.values("sinkage"),
        sinkage_sigma_m=material.sigma("sinkage"),
        ground_acceleration_mps2=acceleration,
        wheel_acceleration_radps2=material.slope("wheel_speed"),
        distance_m=distance,
        latitude_deg=material.latitude_deg,
        longitude_deg=material.longitude_deg,
        segment=segments,
        reason=reason,
        quality=_quality(material, slip, segments, reason, radius_m, options, notes),
    )


def with_standstill_noise(material: Material, segments: NDArray[np.uint8], rate_hz: float) -> Material:
    """Raise the estimated sigma of each force to what it does at standstill, see `processing.noise`."""
    roles = dict(material.roles)
    for role in FORCES:
        if role not in roles or roles[role].facts.sigma_source == "declared":
            continue
        sigma = standstill_sigma(roles[role].values, segments, rate_hz, material.cutoff_hz)
        if not sigma <= roles[role].facts.sigma and isfinite(sigma):
            facts = replace(roles[role].facts, sigma=sigma, sigma_source="standstill")
            roles[role] = replace(roles[role], facts=facts)
    return replace(material, roles=roles)


def _quality(
    material: Material,
    slip: FloatArray,
    segments: NDArray[np.uint8],
    reason: NDArray[np.uint8],
    radius_m: float,
    options: ProcessOptions,
    notes: list[str],
) -> QualityReport:
    speeds = _compare(material, radius_m, options.rate_hz)
    standing = standstills(
        material.time_s,
        segments,
        {role: material.values(role) for role in (*FORCES, "ground_speed") if role in material.roles},
        material.cutoff_hz,
    )
    sensors = {role: on_base.facts for role, on_base in material.roles.items()}
    clock = material.clock
    return QualityReport(
        shares=shares_of(reason),
        residual_latency_s=speeds.latency_s,
        residual_latency_sigma_s=speeds.latency_sigma_s,
        speed_scale=speeds.scale,
        speed_scale_sigma=speeds.scale_sigma,
        clock={"offset_s": clock.offset_s, "drift_ppm": clock.drift_ppm, "residual_s": clock.residual_s}
        if clock
        else {},
        notes=(
            *material.notes,
            *notes,
            *sensor_notes(sensors),
            *speed_notes(speeds, sensors),
            *run_notes(
                reason,
                material.reasons(),
                standing,
                material.values("driving_torque"),
                material.values("drawbar_pull"),
                slip,
                material.slope("ground_speed"),
                material.values("vertical_load"),
            ),
        ),
        sensors=sensors,
        standstills=standing,
        missing=material.missing,
    )


def _compare(material: Material, radius_m: float, rate_hz: float) -> SpeedComparison:
    """Compare the speeds where both went through the whole filter."""
    if not material.has_slip:
        return SpeedComparison()
    sound = {role: material.roles[role].reason == Reason.USED for role in SLIP_ROLES}
    return compare_speeds(
        np.where(sound["ground_speed"], material.values("ground_speed"), nan),
        np.where(sound["wheel_speed"], radius_m * material.values("wheel_speed"), nan),
        material.values("driving_torque"),
        material.values("vertical_load"),
        material.values("drawbar_pull"),
        radius_m,
        rate_hz,
    )
