"""Channels of one run to a `ProcessedRun`; and which roles a run lacks, with the reason and what to do."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from daq import (
    ON_TIME_BASE,
    ROLES,
    Channel,
    ClockFit,
    ConfigError,
    DataError,
    Fault,
    FloatArray,
    Note,
    RunInfo,
    Severity,
    VehicleConfig,
    WheelSection,
)
from processing.notes import RunCode
from processing.options import FORCE_ROLES, LOOK, NEEDED_ROLES, SLIP_ROLES, ProcessOptions, require_roles
from processing.pipeline.assembly import FilteredRun, assemble
from processing.pipeline.bridging import little_used, many_holes
from processing.pipeline.collection import Samples, collect
from processing.pipeline.fault_gate import FaultGate
from processing.pipeline.filters import kernel_sigma_s
from processing.pipeline.inputs import (
    MODEL_ROLES,
    StatusGate,
    fit_gnss_clock,
    latency_ns,
    ready,
    without_invalid_fixes,
    without_jitter,
    without_null_island,
)
from processing.pipeline.motion import speed_at_wheel, usable_accelerometers
from processing.pipeline.quality import without_frozen
from processing.pipeline.resampling import (
    OnBase,
    choose_cutoff,
    gap_limit_s,
    interpolated_on_base,
    put_on_base,
    received_span_ns,
)
from processing.pipeline.rut import with_ruts
from processing.pipeline.wheel_frames import at_soil, to_vehicle_axes
from processing.processed_run import GROUND_SPEED, ProcessedRun
from processing.referee import plausibility_of
from processing.timebase import make_time_base
from processing.transducer_zero.application import RunZeros, ZeroRemoval

_ROTATING = (*FORCE_ROLES, "wheel_angle")

_SLOPES = (*SLIP_ROLES, "pitch")

_MOST_ADDED = 10.0
"""Times its own mass that a vehicle may be loaded with."""
_NOTABLE_END_S = 1.0
_FAR_BELOW, _FAR_ABOVE = 100.0, 10.0
"""Times that a declared sigma in SI is below what differs from one sample to the next, or above the largest values."""

Base = tuple[int, FloatArray]
"""UTC nanoseconds of the first sample, and the seconds since, shape (n,)."""


def _noting(chunks: Iterable[Mapping[str, Channel]], came: set[str]) -> Iterator[Mapping[str, Channel]]:
    """Pass chunks through; `came` gets every role of which there is a sample."""
    for chunk in chunks:
        came |= {role for role, channel in chunk.items() if len(channel)}
        yield chunk


def _require_any(seen: Collection[str], came: Collection[str], vehicle: VehicleConfig) -> None:
    """Check that there is something to look at: roles that have a signal (`seen`) and of which a sample came."""
    named = [role for role in MODEL_ROLES if role in seen]
    if not named:
        raise ConfigError.of(
            "no signal has a role that can be shown",
            where="[signals]",
            found=", ".join(sorted(seen)) or "no roles at all",
            expected=f"at least one of {', '.join(MODEL_ROLES)}",
            next_step='add wheel_speed = "Message.Signal" to [signals] of vehicle.toml, and the others alike',
        )
    if not any(role in came for role in named):
        raise DataError(*(_nothing_received(role, vehicle) for role in named))


def _nothing_received(role: str, vehicle: VehicleConfig) -> Fault:
    return Fault(
        f"the run holds no sample of {role}",
        where=str(vehicle.signals.get(role, "")),
        next_step="check that its frames were recorded (wheelsoil info) and that the signal is the right one",
    )


def _why_missing(
    roles: Collection[str], seen: Collection[str], came: Collection[str], vehicle: VehicleConfig
) -> dict[str, Note]:
    """Return a note for each speed and force that is not among the usable `roles`; it is an error if none is."""
    if not any(role in roles for role in MODEL_ROLES):
        raise DataError(*(_fault(_missing(role, seen, came, vehicle)) for role in MODEL_ROLES if role in seen))
    return {role: _missing(role, seen, came, vehicle) for role in (*SLIP_ROLES, *FORCE_ROLES) if role not in roles}


def _fault(note: Note) -> Fault:
    role, lacking, signal = (note.values[name] for name in ("role", "lacking", "signal"))
    turns = "" if lacking == role else ", which turns it into vehicle axes"
    found, step = {
        "no_signal": (f"no signal of {lacking}", f"name {lacking}{turns}, under [signals] of vehicle.toml"),
        "no_sample": (f"no sample of {lacking}{turns}", "check that its frames were recorded (wheelsoil info)"),
        "never_usable": ("never a usable value", "check the sensor"),
    }[note.values["cause"]]
    return Fault(f"{role} is missing", signal, found, next_step=step)


def _missing(role: str, seen: Collection[str], came: Collection[str], vehicle: VehicleConfig) -> Note:
    lacking = _lacking(role, came, vehicle)
    cause = "never_usable" if not lacking else "no_sample" if lacking in seen else "no_signal"
    absent = lacking or role
    facts = {"role": role, "lacking": absent, "cause": cause, "signal": str(vehicle.signals.get(absent, absent))}
    return Note(RunCode.ROLE_MISSING, Severity.FAULT, facts)


def _lacking(role: str, came: Collection[str], vehicle: VehicleConfig) -> str:
    """Return the role without a sample for which a role is missing: itself, or what turns it into vehicle axes."""
    rotating = vehicle.transducer.frame == "wheel" and role in FORCE_ROLES
    lacking = [name for name in (_ROTATING if rotating else (role,)) if name not in came]
    return role if role in lacking else next(iter(lacking), "")


def process(
    channels: Mapping[str, Channel],
    vehicle: VehicleConfig,
    run: RunInfo | None = None,
    options: ProcessOptions | None = None,
    zeros: RunZeros | None = None,
) -> ProcessedRun:
    """Process one run whose channels are in memory.

    Parameters
    ----------
    channels : mapping role -> Channel
        SI units and radians (positions in degrees), each with its own stamps.
    vehicle : VehicleConfig
        Needs ``[wheel]``.
    zeros : RunZeros, optional
        Of the transducer; taken off before rotation and filter.

    Raises
    ------
    ConfigError
        A role that the purpose needs is missing (to look: all of them), or ``[wheel]`` is, or a zero was taken in other
        axes.
    DataError
        Nothing was received of a needed role (to look: nothing usable of any), the channels share no time, or the run
        is too short or absurdly long.
    """
    return process_stream([channels], vehicle, run, options, zeros)


def process_stream(
    chunks: Iterable[Mapping[str, Channel]],
    vehicle: VehicleConfig,
    run: RunInfo | None = None,
    options: ProcessOptions | None = None,
    zeros: RunZeros | None = None,
) -> ProcessedRun:
    """Process one run that comes in chunks, for recordings larger than memory; otherwise as `process`.

    Kilohertz channels are thinned to the time base as they come, so that what is held grows with the duration of the
    run at the rate of the time base, not with the number of frames.

    Parameters
    ----------
    chunks : iterable of mapping role -> Channel
        Consecutive in time; a role may be absent from a chunk.
    """
    options = options or ProcessOptions()
    wheel = _wheel(vehicle)
    _refuse_added_load(vehicle, run or RunInfo())
    gate = StatusGate(round(1e9 / options.rate_hz), declared="transducer_status" in vehicle.signals)
    faults = FaultGate(round(1e9 / options.rate_hz), vehicle)
    removal = ZeroRemoval(zeros or RunZeros(), vehicle)
    seen: set[str] = set()
    came: set[str] = set()
    samples = _collect(_noting(chunks, came), vehicle, options, removal, gate, faults, seen)
    if options.purpose == LOOK:
        _require_any(seen, came, vehicle)
    clock, notes = _settle_gnss(samples, vehicle)
    samples = faults.without_faulty_ground_speed(samples)
    notes += faults.notes()
    dead = _drop_dead(samples, options)
    notes += _odd_sigmas(samples, vehicle)
    missing = _why_missing(samples, seen, came, vehicle) if options.purpose == LOOK else {}
    notes += [Note(RunCode.NOT_MEASURED, Severity.DOUBT, {"role": role}) for role in dead if role not in missing]
    notes += missing.values()
    cutoff_hz, lowered = choose_cutoff(_of_model(samples), options)
    notes += [*lowered, *gate.notes(), *removal.notes()]
    ready_run = _ReadyRun(vehicle, wheel, run or RunInfo(), cutoff_hz, clock, tuple(notes), missing, gate, removal)
    processed, little = _with_remark(ready_run, samples, options)
    doubts, frozen = plausibility_of(processed, vehicle)
    processed = without_frozen(processed, frozen) if frozen else processed
    found = (*processed.quality.notes, *doubts, *little)
    quality = replace(processed.quality, notes=found, zeros=removal.applied(), transducer_status=gate.words)
    return replace(processed, quality=quality)


@dataclass(frozen=True)
class _ReadyRun:
    """All of a run but its samples; `notes` are of what was done to them."""

    vehicle: VehicleConfig
    wheel: WheelSection
    info: RunInfo
    cutoff_hz: float
    clock: ClockFit | None
    notes: tuple[Note, ...]
    missing: dict[str, Note]
    gate: StatusGate
    removal: ZeroRemoval

    def processed(self, samples: dict[str, Samples], options: ProcessOptions) -> ProcessedRun:
        """Put the samples, which are used up, onto a time base, and form slip, segments and reasons there."""
        base, ends = _time_base(samples, self.cutoff_hz, options)
        roles = _put_all(samples, base, self.cutoff_hz, options, self.vehicle)
        roles = self.gate.with_counts(self.removal.with_sigma(roles))
        kernel_s = kernel_sigma_s(self.cutoff_hz)
        accelerometers, doubts = usable_accelerometers(roles, self.cutoff_hz)
        roles, steered, carried = speed_at_wheel(
            roles, self.vehicle, base[1], options.rate_hz, kernel_s, accelerometers
        )
        outboard_role = next(iter(accelerometers), GROUND_SPEED)
        roles, outboard_role, left = at_soil(roles, self.wheel, kernel_s, self.removal.zero_of_load(), outboard_role)
        position = _position(samples, base)
        brake = interpolated_on_base(samples["brake"], *base) if "brake" in samples else None
        notes = (*self.notes, *ends, *doubts, *carried, *left)
        filtered = FilteredRun(
            *base, self.cutoff_hz, roles, *position, brake, self.clock, notes, self.missing, steered, outboard_role
        )
        return with_ruts(assemble(filtered, self.wheel, self.info, options, self.vehicle.vehicle))


def _with_remark(
    ready_run: _ReadyRun, samples: dict[str, Samples], options: ProcessOptions
) -> tuple[ProcessedRun, list[Note]]:
    """Process a run, and return what would change it where little of it is used; to look, nothing has to be used."""
    if options.purpose == LOOK:
        return ready_run.processed(samples, options), []
    kernel_s = kernel_sigma_s(ready_run.cutoff_hz)
    held = dict(samples) if many_holes(_of_model(samples), kernel_s, options) else {}
    processed = ready_run.processed(samples, options)

    def again(other: ProcessOptions) -> ProcessedRun:
        return ready_run.processed(dict(held), other)

    return processed, little_used(processed, _of_model(held), kernel_s, options, again)


def _of_model(samples: Mapping[str, Samples]) -> dict[str, Samples]:
    """Return the samples of the roles that a used sample must have."""
    return {role: samples[role] for role in MODEL_ROLES if role in samples}


def _wheel(vehicle: VehicleConfig) -> WheelSection:
    if vehicle.wheel is None:
        raise ConfigError.of(
            "the wheel is not described", "vehicle.toml", next_step="add [wheel] with radius_m and width_m"
        )
    return vehicle.wheel


def _refuse_added_load(vehicle: VehicleConfig, run: RunInfo) -> None:
    mass_kg, added_kg = vehicle.vehicle.mass_kg, run.added_load_kg
    if mass_kg is not None and added_kg > _MOST_ADDED * mass_kg:
        raise ConfigError.of(
            "the added load is one that the vehicle cannot carry",
            f"runs.toml: run {run.id or run.file!r}",
            f"added_load_kg = {added_kg:g}",
            f"at most {_MOST_ADDED:g} times mass_kg = {mass_kg:g} of vehicle.toml",
            f"correct one of them, in kilograms; {added_kg:g} g are {added_kg * 1e-3:.4g} kg",
        )


def _collect(
    chunks: Iterable[Mapping[str, Channel]],
    vehicle: VehicleConfig,
    options: ProcessOptions,
    removal: ZeroRemoval,
    gate: StatusGate,
    faults: FaultGate,
    seen: set[str],
) -> dict[str, Samples]:
    """Thin the channels to the time base; `seen` gets every role that has a signal."""
    rotating = vehicle.transducer.frame == "wheel"
    stream: Iterable[Mapping[str, Channel]] = ready(
        gate.without_distrusted(chunks), vehicle, seen, with_angle=rotating or removal.needs_angle
    )
    stream = removal.removed(faults.without_faults(stream))
    if rotating:
        stream = to_vehicle_axes(stream, vehicle.transducer)
    samples = faults.marked(gate.marked(collect(stream, round(1e9 / options.rate_hz)), vehicle))
    if options.purpose == LOOK:
        return samples
    require_roles(seen, options.purpose, rotating=rotating)
    needed = NEEDED_ROLES[options.purpose]
    empty = [role for role in needed if role not in samples or not len(samples[role].received_ns())]
    DataError.stop_if_any(_nothing_received(role, vehicle) for role in empty)
    return samples


def _settle_gnss(samples: dict[str, Samples], vehicle: VehicleConfig) -> tuple[ClockFit | None, list[Note]]:
    """Take out invalid fixes and the jitter of arrival; returns the clock fit."""
    flags = samples.pop("ground_speed_valid", None)
    if flags is not None and "ground_speed" in samples:
        samples["ground_speed"] = without_invalid_fixes(samples["ground_speed"], flags)
    if "latitude" in samples and "longitude" in samples:
        samples["latitude"], samples["longitude"] = without_null_island(samples["latitude"], samples["longitude"])
    if "gnss_time" not in samples:
        return None, []
    gnss_time = samples.pop("gnss_time")
    clock = fit_gnss_clock(gnss_time)
    if clock is None:
        return None, [Note(RunCode.GNSS_CLOCK_UNKNOWN)]
    lag_ns = latency_ns(vehicle, "ground_speed") - latency_ns(vehicle, "gnss_time")
    if "ground_speed" in samples:
        samples["ground_speed"] = without_jitter(samples["ground_speed"], gnss_time, clock, lag_ns)
    return clock, []


def _drop_dead(samples: dict[str, Samples], options: ProcessOptions) -> list[str]:
    """Drop channels without a single usable value, unless the purpose needs what came of them; return their roles.

    To look needs none: a speed that is never there must not take the force with it that it carries to the soil.
    """
    needed = NEEDED_ROLES.get(options.purpose, ())
    dead = [
        role
        for role, held in samples.items()
        if not len(held.time_ns) and not (role in needed and len(held.received_ns()))
    ]
    for role in dead:
        del samples[role]
    return dead


def _odd_sigmas(samples: Mapping[str, Samples], vehicle: VehicleConfig) -> Iterator[Note]:
    """Yield a note for each declared sigma that is far below the noise, or above nearly all values."""
    measured = (role for role, held in samples.items() if len(held.values))
    for role in (name for name in measured if name in MODEL_ROLES and name in vehicle.sensors):
        sigma, rough = vehicle.sensors[role].sigma, samples[role].rough
        largest = float(np.quantile(np.abs(samples[role].values), 0.98))
        if sigma and (sigma * _FAR_BELOW < rough or sigma > _FAR_ABOVE * largest > 0):
            facts = {"role": role, "size": sigma, "least": rough, "most": largest, "units": (ROLES[role].unit_text,)}
            yield Note(RunCode.WRONG_SIZE, Severity.DOUBT, {**facts, "why": "sigma", "signal": ""})


def _time_base(samples: dict[str, Samples], cutoff_hz: float, options: ProcessOptions) -> tuple[Base, list[Note]]:
    """Return the time base, over everything that was received, and a note where one channel ends before others."""
    kernel_s = kernel_sigma_s(cutoff_hz)
    spans = {
        role: received_span_ns(samples[role], gap_limit_s(samples[role], kernel_s, options))
        for role in MODEL_ROLES
        if role in samples
    }
    base = make_time_base(spans, options.rate_hz)
    first, last = max(spans, key=lambda role: spans[role][0]), min(spans, key=lambda role: spans[role][1])
    begin_s = (spans[first][0] - min(span[0] for span in spans.values())) * 1e-9
    end_s = (max(span[1] for span in spans.values()) - spans[last][1]) * 1e-9
    if max(begin_s, end_s) < _NOTABLE_END_S:
        return base, []
    return base, [Note(RunCode.ENDS_LOST, values={"begin_s": begin_s, "first": first, "end_s": end_s, "last": last})]


def _put_all(
    samples: dict[str, Samples], base: Base, cutoff_hz: float, options: ProcessOptions, vehicle: VehicleConfig
) -> dict[str, OnBase]:
    """Filter every role onto the base; what is not required may be slow and does not lower the others' cut-off."""
    roles = {}
    for channel in ON_TIME_BASE:
        role = channel.role
        if role in samples:
            own_hz = cutoff_hz if channel.required else choose_cutoff({role: samples[role]}, options)[0]
            sensor = vehicle.sensors.get(role)
            declared = (vehicle.latency_s(role), sensor.sigma if sensor else None)
            roles[role] = put_on_base(
                samples.pop(role), *base, min(own_hz, cutoff_hz), options, declared, keep_slope=role in _SLOPES
            )
    return roles


def _position(samples: dict[str, Samples], base: Base) -> tuple[FloatArray, FloatArray]:
    if "latitude" not in samples or "longitude" not in samples:
        nowhere = np.broadcast_to(np.float64(np.nan), base[1].shape)
        return nowhere, nowhere
    latitude = interpolated_on_base(samples["latitude"], *base)
    return latitude, interpolated_on_base(samples["longitude"], *base, turn=360.0)
