"""Filtered roles to a `ProcessedRun`: slip ratio, distance, segments, exclusion reasons, quality, readings at rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from daq import (
    ON_TIME_BASE,
    TRANSDUCER_ROLES,
    BoolArray,
    Brakes,
    ChannelDefinition,
    ClockFit,
    FloatArray,
    Note,
    RunInfo,
    Use,
    VehicleSection,
    WheelSection,
)
from processing import SLIP_ROLES, ProcessOptions, RunCode
from processing.pipeline.filters import standstill_sigma
from processing.pipeline.inputs import MODEL_ROLES
from processing.pipeline.kinematics import (
    least_slip_speed,
    pace_of,
    runs_of,
    segment,
    slip_of,
    slip_sigma,
    stalled,
)
from processing.pipeline.latency import SpeedComparison, compare_speeds
from processing.pipeline.quality import combine_reasons, run_notes, sensor_notes, shares_of, speed_notes
from processing.pipeline.resampling import OnBase
from processing.processed_run import GROUND_SPEED, ProcessedRun, QualityReport, Reason, Segment, Standstill
from processing.robust import robust_spread

_BRAKED_SHARE = 0.05
"""Of the largest brake signal of a run, above which the brakes are held: a pressure, a pedal or a switch alike."""


def standstills(
    time_s: FloatArray,
    segments: NDArray[np.uint8],
    channels: Mapping[str, FloatArray],
    cutoff_hz: float,
    brake: FloatArray | None = None,
    declared: Brakes = "unknown",
) -> tuple[Standstill, ...]:
    """Return one `Standstill` per standing period; arrays of shape (n,).

    A channel without values in a period is not named there. A second holds about 2.5 times `cutoff_hz` of the filter
    independent samples. `declared` is what vehicle.toml says of the brakes, where no channel `brake` shows it.
    """
    found = []
    for start, stop in runs_of(segments):
        if segments[start] != Segment.STANDSTILL:
            continue
        levels, sigmas = {}, {}
        for role, values in channels.items():
            part = values[start:stop]
            part = part[np.isfinite(part)]
            if len(part) < 2:
                continue
            independent = max(2.5 * cutoff_hz * len(part) * float(time_s[1] - time_s[0]), 1.0)
            middle = float(np.median(part))
            levels[role] = middle
            sigmas[role] = 1.25 * robust_spread(part - middle) / sqrt(independent)
        brakes = declared if brake is None else _brakes(brake, slice(start, stop))
        duration_s = float(time_s[stop - 1] - time_s[start])
        found.append(Standstill(float(time_s[start]), duration_s, levels, sigmas, brakes))
    return tuple(found)


def _brakes(brake: FloatArray, period: slice) -> Brakes:
    """Return whether the brake's channel exceeds a share of its largest value of the run within a period."""
    part = brake[period]
    if not np.isfinite(part).any():
        return "unknown"
    return "held" if np.nanmax(part) > _BRAKED_SHARE * np.nanmax(brake) else "released"


def distance_of(time_s: FloatArray, ground_speed_mps: FloatArray) -> tuple[FloatArray, float]:
    """Integrate ground speed by the trapezium rule; arrays of shape (n,), the distance 0 at the first known speed.

    Inside a gap the distance is NaN. Behind it the distance goes on as if the mean of the speeds at its ends had held:
    that is an offset of what follows, not a sample, and the second value says how much of it there is.
    """
    known = np.flatnonzero(np.isfinite(ground_speed_mps))
    distance = np.full(len(time_s), np.nan)
    if not len(known):
        return distance, 0.0
    speed = ground_speed_mps[known]
    parts = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s[known])
    distance[known] = np.concatenate([[0.0], np.cumsum(parts)])
    return distance, float(np.abs(parts[np.diff(known) > 1]).sum())


@dataclass(frozen=True)
class FilteredRun:
    """Everything on one time base; arrays of shape (n,), NaN where not known.

    `roles` has those that the run carries, one of them at least; `missing` is that of `QualityReport`. `brake` is in
    whatever unit, None without its channel. `steered` is that of `combine_reasons`, `outboard_role` of `ProcessedRun`.
    """

    start_ns: int
    time_s: FloatArray
    cutoff_hz: float
    roles: dict[str, OnBase]
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    brake: FloatArray | None
    clock: ClockFit | None
    notes: tuple[Note, ...]
    missing: dict[str, Note]
    steered: BoolArray | None = None
    outboard_role: str = GROUND_SPEED

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


def assemble(
    filtered: FilteredRun, wheel: WheelSection, run: RunInfo, options: ProcessOptions, vehicle: VehicleSection
) -> ProcessedRun:
    """Form slip, with the declared rolling radius of the wheel as in Eq. 6, segments and reasons."""
    radius_m = wheel.radius_m
    ground, rim = filtered.values("ground_speed"), wheel.rolling_m * filtered.values("wheel_speed")
    rim_sigma, ground_sigma = wheel.rolling_m * filtered.sigma("wheel_speed"), filtered.sigma("ground_speed")
    pace = pace_of(rim, ground)
    least_mps = least_slip_speed(pace) if options.min_speed_mps is None else options.min_speed_mps
    slip = slip_of(rim, ground, least_mps)
    sigma = slip_sigma(rim, ground, rim_sigma, ground_sigma, least_mps)
    acceleration = filtered.slope("ground_speed")
    torque, load = filtered.values("driving_torque"), filtered.values("vertical_load")
    segments = segment(rim, ground, acceleration, slip, torque / radius_m, load, options.rate_hz, pace)
    stuck = stalled(segments, torque)
    filtered = _with_standstill_noise(filtered, np.where(stuck, Segment.COAST, segments), options.rate_hz)
    reason = combine_reasons(
        filtered.reasons().values(),
        segments,
        slip,
        load,
        slip_is_measured=filtered.has_slip,
        steered=filtered.steered,
    )
    distance, bridged_m = distance_of(filtered.time_s, ground)
    notes = [Note(RunCode.DISTANCE_BRIDGED, values={"length_m": bridged_m})] * (bridged_m > 0)
    if pace < 1 and options.min_speed_mps is None:
        notes.append(Note(RunCode.SLOW_VEHICLE, values={"least_mps": least_mps}))
    if stuck.any():
        notes.append(Note(RunCode.STALLED, values={"time_s": float(stuck.sum()) / options.rate_hz}))
    return ProcessedRun(
        run=run,
        rate_hz=options.rate_hz,
        cutoff_hz=filtered.cutoff_hz,
        wheel_radius_m=radius_m,
        rolling_radius_m=wheel.rolling_radius_m,
        start_ns=filtered.start_ns,
        time_s=filtered.time_s,
        slip=slip,
        slip_sigma=sigma,
        **_columns(filtered, (channel for channel in ON_TIME_BASE if channel.use is not Use.EXTRA)),
        extras=_columns(filtered, (c for c in ON_TIME_BASE if c.use is Use.EXTRA and c.role in filtered.roles)),
        ground_acceleration_mps2=acceleration,
        wheel_acceleration_radps2=filtered.slope("wheel_speed"),
        distance_m=distance,
        latitude_deg=filtered.latitude_deg,
        longitude_deg=filtered.longitude_deg,
        segment=segments,
        reason=reason,
        outboard_mass_kg=wheel.outboard_mass_kg,
        outboard_inertia_kgm2=wheel.outboard_inertia_kgm2,
        outboard_role=filtered.outboard_role,
        axle=wheel.axle or 1,
        axles=vehicle.axles or 1,
        least_speed_mps=least_mps,
        quality=_quality(filtered, segments, stuck, reason, wheel, options, vehicle.standstill_brakes, notes, pace),
    )


def _columns(filtered: FilteredRun, channels: Iterable[ChannelDefinition]) -> dict[str, FloatArray]:
    """Return values and one-sigma of some channels by the names of their columns."""
    found = {}
    for channel in channels:
        found[channel.field] = filtered.values(channel.role)
        found[channel.sigma_field] = filtered.sigma(channel.role)
    return found


def _with_standstill_noise(filtered: FilteredRun, segments: NDArray[np.uint8], rate_hz: float) -> FilteredRun:
    """Raise the estimated sigma of each force to what it does at standstill, see `processing.pipeline.filters`."""
    roles = dict(filtered.roles)
    for role in TRANSDUCER_ROLES:
        if role not in roles or roles[role].facts.sigma_source == "declared":
            continue
        sigma = standstill_sigma(roles[role].values, segments, rate_hz, filtered.cutoff_hz)
        if not sigma <= roles[role].facts.sigma and isfinite(sigma):
            facts = replace(roles[role].facts, sigma=sigma, sigma_source="standstill")
            roles[role] = replace(roles[role], facts=facts)
    return replace(filtered, roles=roles)


def _quality(
    filtered: FilteredRun,
    segments: NDArray[np.uint8],
    stuck: BoolArray,
    reason: NDArray[np.uint8],
    wheel: WheelSection,
    options: ProcessOptions,
    brakes: Brakes,
    notes: list[Note],
    pace: float,
) -> QualityReport:
    speeds = _compare(filtered, wheel, options.rate_hz, pace)
    standing = standstills(
        filtered.time_s,
        np.where(stuck, Segment.COAST, segments),
        {role: filtered.values(role) for role in (*TRANSDUCER_ROLES, "ground_speed") if role in filtered.roles},
        filtered.cutoff_hz,
        filtered.brake,
        brakes,
    )
    sensors = {role: on_base.facts for role, on_base in filtered.roles.items()}
    clock = filtered.clock
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
            *filtered.notes,
            *notes,
            *sensor_notes(sensors),
            *speed_notes(speeds, sensors),
            *run_notes(segments, filtered.reasons(), standing),
        ),
        sensors=sensors,
        standstills=standing,
        missing=filtered.missing,
    )


def _compare(filtered: FilteredRun, wheel: WheelSection, rate_hz: float, pace: float) -> SpeedComparison:
    """Compare the speeds where both went through the whole filter."""
    if not filtered.has_slip:
        return SpeedComparison()
    sound = {role: filtered.roles[role].reason == Reason.USED for role in SLIP_ROLES}
    return compare_speeds(
        np.where(sound["ground_speed"], filtered.values("ground_speed"), nan),
        np.where(sound["wheel_speed"], wheel.rolling_m * filtered.values("wheel_speed"), nan),
        filtered.values("driving_torque"),
        filtered.values("vertical_load"),
        filtered.values("drawbar_pull"),
        wheel.radius_m,
        rate_hz,
        pace,
    )
