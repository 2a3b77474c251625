"""Planned campaigns, and the causes that are detectable and separable in them or in driven runs.

Planned runs are processed runs without any noise: motion, load and what the simulation says. They are linearised as
measured ones are, with the noise of the prior. Measured values are not used, only what is driven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from daq import OUTPUTS, REACTIONS, BoolArray, ConfigError, DataError, FloatArray, Note, RunInfo, VehicleConfig
from model.cores import one_thread
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.result import Detectable, NextRun
from model.diagnosis.findings.isolability import DETECTABLE_D, Isolability, detectable_in_runs, isolability
from model.diagnosis.planning.next_run import Member, next_runs
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, linearise_campaigns
from model.diagnosis.time_series.noise import Noise, hyper_priors
from model.diagnosis.time_series.samples import samples_of
from model.simulation import DrivingStyle, VehicleSetup
from model.simulation.motion import Motion, WheelLoad, drawn_drive, static_load_n
from model.simulation.truth import Circumstances, free_rolling_slip
from model.wheel_soil.conditions import Conditions, Wheel
from model.wheel_soil.soils import Soil, SoilPrior, prior_of
from model.wheel_soil.wheel_soil_model import WheelSoilModel
from processing import ProcessedRun, QualityReport, Reason, Segment, Standstill
from processing.pipeline import kernel_sigma_s

ADDED_LOAD_KG = (0.0, 300.0, 500.0)
"""On the paper's vehicle of 3.6 t."""
_RATE_HZ = 100.0
_CUTOFF_HZ = 4.0
_LEAST_SPEED_MPS = 0.5
_BETWEEN_RUNS_S = 600.0
_START_NS = 1_780_000_000_000_000_000
_LEAST_STANDSTILL_S = 1.0
_STILL_MPS = 0.1
_USUAL_NOISE_SHARE = 4e-3
"""Of the load: noise of a channel whose sigma is not known."""


@dataclass(frozen=True)
class CampaignPlan:
    """A campaign that is to be driven.

    Attributes
    ----------
    runs : tuple of RunInfo
        Direction, added load, inflation pressure and pass of each.
    soil_prior : SoilPrior, optional
        How sure the laboratory is; the usual uncertainty otherwise.
    tyre : "smooth", "lugged" or ""
    duration_s : float
        Of each run.
    vehicle : VehicleSetup
        Loads and how they move.
    channels : of "dp", "t", "z"
        What will be measured.
    sigmas : mapping of "dp", "t", "z", "speed", "load" -> float
        One-sigma of a filtered sample, N, N m, m, m/s, N; usual ones where it is not known.
    seed : int
        Of the drivers' choices and the road.
    """

    wheel: Wheel
    soil: Soil
    runs: tuple[RunInfo, ...]
    soil_prior: SoilPrior | None = None
    tyre: str = ""
    name: str = "plan"
    duration_s: float = 40.0
    vehicle: VehicleSetup = field(default_factory=VehicleSetup)
    channels: tuple[str, ...] = tuple(REACTIONS)
    sigmas: dict[str, float] = field(default_factory=dict)
    seed: int = 0


def usual_runs(count: int = 6, added_load_kg: tuple[float, ...] = ADDED_LOAD_KG) -> tuple[RunInfo, ...]:
    """Return runs that take turns in direction and load."""
    return tuple(
        RunInfo(
            id=f"run-{i + 1}",
            direction="back" if i % 2 else "out",
            added_load_kg=added_load_kg[i % len(added_load_kg)],
        )
        for i in range(count)
    )


def plan_for(
    vehicle: VehicleConfig,
    soil: Soil,
    soil_prior: SoilPrior | None = None,
    runs: tuple[RunInfo, ...] = (),
    *,
    duration_s: float = 40.0,
    name: str = "plan",
    seed: int = 0,
) -> CampaignPlan:
    """Return the plan for the vehicle of a vehicle.toml.

    Parameters
    ----------
    vehicle : VehicleConfig
        Its wheel, its mass, and which of drawbar pull, torque and sinkage it measures.
    runs : tuple of RunInfo, optional
        As runs.toml has them; `usual_runs` where there are none, added loads in proportion to the mass.
    duration_s, name, seed
        See `CampaignPlan`.

    Raises
    ------
    ConfigError
        The wheel is not described.
    """
    if vehicle.wheel is None:
        raise ConfigError.of(
            "the wheel is not described", "vehicle.toml", next_step="add [wheel] with radius_m and width_m"
        )
    usual = VehicleSetup()
    mass = vehicle.vehicle.mass_kg or usual.mass_kg
    share = mass / usual.mass_kg
    default = usual_runs(added_load_kg=tuple(share * added for added in ADDED_LOAD_KG))
    measured = tuple(key for key, channel in OUTPUTS.items() if channel.role in vehicle.signals)
    return CampaignPlan(
        wheel=Wheel(vehicle.wheel.radius_m, vehicle.wheel.width_m),
        soil=soil,
        runs=runs or default,
        soil_prior=soil_prior,
        tyre=vehicle.wheel.tread,
        name=name,
        duration_s=duration_s,
        vehicle=replace(usual, mass_kg=mass, static_load_n=usual.static_load_n * share),
        channels=measured or tuple(REACTIONS),
        seed=seed,
    )


def planned_campaign(plan: CampaignPlan) -> Campaign:
    """Return the campaign as a diagnosis would get it from sensors without noise.

    Raises
    ------
    ConfigError
        No run is planned, or one is too short.
    DataError
        The soil cannot carry the wheel.
    """
    if not plan.runs:
        raise ConfigError.of("no run is planned", plan.name, expected="at least one run")
    model = WheelSoilModel(plan.wheel, plan.soil)
    streams = np.random.default_rng(plan.seed).spawn(len(plan.runs))
    runs = tuple(_run(plan, model, info, i, rng) for i, (info, rng) in enumerate(zip(plan.runs, streams, strict=True)))
    return Campaign(plan.name, runs, plan.wheel, plan.soil, plan.soil_prior or prior_of(plan.soil), plan.tyre)


def _run(
    plan: CampaignPlan, model: WheelSoilModel, info: RunInfo, index: int, rng: np.random.Generator
) -> ProcessedRun:
    driving, road = rng.spawn(2)
    pressure = info.inflation_kpa or plan.vehicle.inflation_kpa
    here = Circumstances(info, pressure, 0.0, plan.duration_s, (0.0, 1.0))
    coast = free_rolling_slip(model, {}, static_load_n(plan.vehicle, info.added_load_kg), here)
    motion = drawn_drive(
        plan.duration_s, plan.wheel.radius_m, driving, rate_hz=_RATE_HZ, coast_slip=coast, style=DrivingStyle()
    ).motion()
    load = _load(plan, info, motion, road)
    prediction = model.predict(Conditions(motion.slip, load))
    lost = ~np.isfinite(prediction.drawbar_pull_n)
    if lost.any():
        raise DataError.of(
            "the soil cannot carry the wheel on this run",
            f"{plan.name}: {info.id}",
            found=f"{load[lost].min():.0f} to {load[lost].max():.0f} N on soil {plan.soil.name!r}",
            next_step="plan less load, or check the soil and the wheel",
        )
    moving = motion.ground_speed_mps >= _LEAST_SPEED_MPS
    still = motion.ground_speed_mps < _STILL_MPS
    reason = np.where(moving, Reason.USED, np.where(still, Reason.STANDSTILL, Reason.TOO_SLOW)).astype(np.uint8)
    segment = np.where(motion.slip > 0, Segment.DRIVE, Segment.BRAKE)
    segment = np.where(still, Segment.STANDSTILL, segment).astype(np.uint8)
    swing = _swing(plan, load)
    measured = {
        "dp": np.where(moving, prediction.drawbar_pull_n, swing["dp"]),
        "t": np.where(moving, prediction.driving_torque_nm, swing["t"]),
        "z": prediction.sinkage_m,
    }
    nothing = np.full(len(load), np.nan)
    channel = {c: x if c in plan.channels else nothing for c, x in measured.items()}
    sigma = {c: np.full(len(load), plan.sigmas.get(c, np.nan)) for c in (*OUTPUTS, "speed", "load")}
    return ProcessedRun(
        run=info,
        rate_hz=_RATE_HZ,
        cutoff_hz=_CUTOFF_HZ,
        wheel_radius_m=plan.wheel.radius_m,
        start_ns=_START_NS + round(index * (plan.duration_s + _BETWEEN_RUNS_S) * 1e9),
        time_s=motion.time_s,
        slip=np.where(moving, motion.slip, np.nan),
        slip_sigma=nothing,
        ground_speed_mps=motion.ground_speed_mps,
        ground_speed_sigma_mps=sigma["speed"],
        wheel_speed_radps=motion.wheel_speed_radps,
        wheel_speed_sigma_radps=nothing,
        vertical_load_n=load,
        vertical_load_sigma_n=sigma["load"],
        drawbar_pull_n=channel["dp"],
        drawbar_pull_sigma_n=sigma["dp"],
        driving_torque_nm=channel["t"],
        driving_torque_sigma_nm=sigma["t"],
        sinkage_m=channel["z"],
        sinkage_sigma_m=sigma["z"],
        ground_acceleration_mps2=motion.ground_acceleration_mps2,
        wheel_acceleration_radps2=motion.wheel_acceleration_radps2,
        distance_m=motion.distance_m,
        latitude_deg=nothing,
        longitude_deg=nothing,
        segment=segment,
        reason=reason,
        least_speed_mps=_LEAST_SPEED_MPS,
        quality=QualityReport(standstills=_standstills(still, load)),
    )


def _load(plan: CampaignPlan, info: RunInfo, motion: Motion, rng: np.random.Generator) -> FloatArray:
    """Return the load as the common filter leaves it."""
    from scipy.ndimage import gaussian_filter1d

    wheel_load = WheelLoad(plan.vehicle, _RATE_HZ, info.added_load_kg, rng)
    raw = wheel_load.next_n(motion.ground_speed_mps, motion.ground_acceleration_mps2)
    return np.asarray(gaussian_filter1d(raw, kernel_sigma_s(_CUTOFF_HZ) * _RATE_HZ, mode="nearest"))


def _swing(plan: CampaignPlan, load: FloatArray) -> dict[str, FloatArray]:
    """Return what the channels show at rest: as far from zero as their noise is, so that it is known to be there."""
    usual = _USUAL_NOISE_SHARE * float(np.median(load))
    sign = np.where(np.arange(len(load)) % 2 == 0, 1.0, -1.0)
    typical = {"dp": usual, "t": usual * plan.wheel.radius_m}
    return {c: sign * plan.sigmas.get(c, size) for c, size in typical.items()}


def _standstills(still: BoolArray, load: FloatArray) -> tuple[Standstill, ...]:
    edges = np.flatnonzero(np.diff(np.r_[False, still, False].astype(np.int8))).reshape(-1, 2)
    found = []
    for first, last in edges:
        duration = (last - first) / _RATE_HZ
        if duration >= _LEAST_STANDSTILL_S:
            levels = {
                "drawbar_pull": 0.0,
                "driving_torque": 0.0,
                "vertical_load": float(np.median(load[first:last])),
                "ground_speed": 0.0,
            }
            nothing = dict.fromkeys(levels, float("nan"))
            found.append(Standstill(float(first / _RATE_HZ), float(duration), levels, nothing, "released"))
    return tuple(found)


@dataclass(frozen=True)
class Advice:
    """Confounded causes, and the runs that would separate them, best first."""

    families: tuple[str, ...]
    next_runs: tuple[NextRun, ...]


@dataclass(frozen=True)
class Plan:
    """Detectable and separable causes of a campaign.

    Attributes
    ----------
    isolability : Isolability
        At one prior one-sigma of every parameter, or the sizes that were asked for.
    minimum_detectable : mapping effect key -> Detectable
        That something is there.
    minimum_separable : mapping effect key -> Detectable
        That it is this and no other family.
    """

    isolability: Isolability
    confounded: tuple[Advice, ...]
    minimum_detectable: dict[str, Detectable]
    minimum_separable: dict[str, Detectable]
    not_identifiable: dict[str, Note] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()


@one_thread
def plan_of(
    campaigns: Sequence[Campaign],
    options: DiagnosisOptions | None = None,
    *,
    advise: bool = True,
) -> Plan:
    """Return which causes campaigns can separate: planned ones (`model.diagnosis.planning.plan`) or driven ones.

    Parameters
    ----------
    advise : bool
        List for confounded causes the runs that would separate them.

    Raises
    ------
    DataError
        As `linearise_campaigns`.
    """
    chosen = options or DiagnosisOptions()
    linearised = linearise_campaigns(
        campaigns, chosen, [_prior_noise(campaign, chosen.channels) for campaign in campaigns]
    )
    return plan_from_linearised(linearised, chosen.name_at, advise=advise)


@one_thread
def plan_from_linearised(
    linearised: LinearisedCampaign,
    name_at: float,
    sizes: Mapping[str, Sequence[float]] | None = None,
    *,
    advise: bool = True,
) -> Plan:
    """Return which causes linearised runs can separate, with the noise that they have.

    From the probability `name_at` on a family is named. The sizes are coefficients in units of the prior scale
    (`isolability`); `advise` is as for `plan_of`.
    """
    found = isolability(linearised.grams, sizes)
    groups = found.confounded()
    detectable = detectable_in_runs(linearised.grams, name_at=name_at)
    return Plan(
        isolability=found,
        confounded=tuple(Advice(g, _advice(linearised, found, g) if advise else ()) for g in groups),
        minimum_detectable=detectable,
        minimum_separable={key: _separable(linearised.grams, found, i) for i, key in enumerate(found.keys)},
        not_identifiable=linearised.not_identifiable,
        notes=linearised.notes,
    )


def _prior_noise(campaign: Campaign, channels: tuple[str, ...]) -> Noise:
    return Noise({name: b.centre for name, b in hyper_priors(samples_of(campaign, channels)).items()})


def _advice(linearised: LinearisedCampaign, found: Isolability, group: tuple[str, ...]) -> tuple[NextRun, ...]:
    """Return what would part a group of families, each by its first form, at twice the size that is seen."""
    members = []
    for family in group:
        i = found.families.index(family)
        if found.deviation[i] > 0:
            key = found.keys[i]
            members.append(Member(key, found.sizes[key] * 2.0 * DETECTABLE_D / float(found.deviation[i])))
    return next_runs(linearised, tuple(members), most=3)


def _separable(grams: Grams, found: Isolability, i: int) -> Detectable:
    """Return the size of an effect's first parameter from which on it is separable from every other family."""
    key = found.keys[i]
    cause = next(c for c in grams.causes if c.key == key)
    apart = float(found.separation[i])
    share = DETECTABLE_D / apart if apart > 0 else float("inf")
    return Detectable(cause.parameter, cause.neutral + share * float(found.sizes[key][0]) * cause.scale, cause.unit)
