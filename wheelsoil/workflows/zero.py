"""Recordings of a lifted wheel to zero.toml, and zero.toml to the runs that it is subtracted from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from math import isfinite
from pathlib import Path

import numpy as np

from daq import (
    ROLES,
    TRANSDUCER_ROLES,
    Channel,
    ChannelZero,
    ConfigError,
    Determination,
    FloatArray,
    IntArray,
    Note,
    Quantity,
    Unit,
    ZeroConfig,
    find_unit,
    load_zeros,
    zero_file_name,
    zeros_toml,
)
from daq.can import Decoder, RawKind, Signal, SignalRef, messages_by_bus, resolve_roles
from daq.runs import Collected, Run, one_wheel, open_runs
from daq.series import write_whole
from processing import ZeroCode, in_order, merge_equal_stamps, seconds_since
from processing.pipeline import latency_ns, status_at, wheel_angle
from processing.transducer_zero import (
    Drift,
    Lifted,
    RunZeros,
    TransducerSignal,
    WeightCheck,
    check_weight,
    determine,
    drift_between,
)
from wheelsoil.console import check_output
from wheelsoil.workflows.recordings import sha256_of

_LOOK_BATCHES = 20
Key = tuple[str, str]

_NOTABLE_RISE_K = 2.0


@dataclass(frozen=True)
class Sources:
    """Where everything comes from; keys are (bus, "Message.Signal").

    Attributes
    ----------
    signals : mapping key -> (signal, unit, role)
        Every force and moment of the messages that carry load, pull and torque.
    roles : mapping role -> SignalRef
    temperature : key and unit, or None
        Of the first temperature in those messages, or in that of the wheel angle.
    """

    signals: dict[Key, tuple[Signal, Unit, str]]
    roles: dict[str, SignalRef]
    temperature: tuple[Key, Unit] | None


@dataclass(frozen=True)
class TransducerData:
    """The transducer's part of a recording; times in s since `start_ns`.

    Attributes
    ----------
    start_ns : int
        First stamp of all.
    angle, speed : (time_s, values) or None
        psi, unwrapped, and wheel speed, SI.
    temperature_degc : (time_s, values) or None
    distrusted : int
        Samples left out for the transducer's status.
    """

    start_ns: int
    signals: tuple[TransducerSignal, ...]
    angle: tuple[FloatArray, FloatArray] | None
    speed: tuple[FloatArray, FloatArray] | None
    temperature_degc: tuple[FloatArray, FloatArray] | None
    distrusted: int


def sources_of(run: Run, needed: tuple[str, ...] = ()) -> Sources:
    """Find the transducer's signals; `ConfigError` where a needed role has none."""
    roles = resolve_roles(run.vehicle, run.databases, needed, ROLES)
    messages = messages_by_bus(run.databases)
    of_role = {roles[role].key: role for role in TRANSDUCER_ROLES if role in roles}
    places = dict.fromkeys((roles[role].bus, roles[role].message) for role in TRANSDUCER_ROLES if role in roles)
    signals: dict[Key, tuple[Signal, Unit, str]] = {}
    for bus, message in places:
        for signal in messages[bus][message].by_name.values():
            unit = find_unit(signal.unit, (Quantity.FORCE, Quantity.MOMENT))
            key = (bus, f"{message}.{signal.name}")
            if unit is not None:
                signals[key] = (signal, unit, of_role.get(key, ""))
    if "wheel_angle" in roles:
        places[roles["wheel_angle"].bus, roles["wheel_angle"].message] = None
    warm = (
        ((bus, f"{message}.{signal.name}"), unit)
        for bus, message in places
        for signal in messages[bus][message].by_name.values()
        if (unit := find_unit(signal.unit, (Quantity.TEMPERATURE,))) is not None
    )
    return Sources(signals, roles, next(warm, None))


def transducer_data(run: Run, *, from_s: float | None = None, to_s: float | None = None) -> TransducerData:
    """Read the transducer's part of a recording; `from_s` and `to_s` count from its first sample.

    `ConfigError` where the vertical load has no signal (or the pull or the wheel angle, for a transducer in wheel
    axes); `RecordingError` where the file cannot be read.
    """
    turning = ("drawbar_pull", "wheel_angle") if run.vehicle.transducer.frame == "wheel" else ()
    sources = sources_of(run, ("vertical_load", *turning))
    others = [
        sources.roles[role] for role in ("wheel_angle", "wheel_speed", "transducer_status") if role in sources.roles
    ]
    keys = [*sources.signals, *(reference.key for reference in others)]
    if sources.temperature:
        keys.append(sources.temperature[0])
    read = _read(run, keys)
    start_ns = min((int(channel.time_ns[0]) for channel in read.values() if len(channel)), default=0)
    span_s = (-np.inf if from_s is None else from_s, np.inf if to_s is None else to_s)

    def pair(channel: Channel, late_ns: int) -> tuple[FloatArray, FloatArray]:
        return _between(*_ordered(channel.time_ns - late_ns, channel.values), start_ns, span_s)

    def of_role(role: str) -> tuple[FloatArray, FloatArray] | None:
        reference = sources.roles.get(role)
        return pair(reference.to_si(read[reference.key]), latency_ns(run.vehicle, role)) if reference else None

    angle, speed = of_role("wheel_angle"), of_role("wheel_speed")
    if angle is not None:
        angle = (angle[0], wheel_angle(np.unwrap(angle[1]), run.vehicle.transducer))
    status = sources.roles.get("transducer_status")
    signals, distrusted = [], 0
    for key, (signal, unit, role) in sources.signals.items():
        channel, bad = _trusted(read[key], read[status.key] if status else None)
        distrusted = max(distrusted, bad)
        time_s, values = pair(channel, _latency_ns(run, sources, key))
        factor = sources.roles[role].si_factor if role else unit.factor
        step = 0.0 if signal.kind is RawKind.FLOAT else abs(float(signal.scale))
        signals.append(TransducerSignal(_name(key, sources), role, signal.unit, factor, step, time_s, values))
    warm = None
    if sources.temperature:
        key, unit = sources.temperature
        time_s, values = pair(read[key], 0)
        warm = (time_s, values * unit.factor + unit.offset - 273.15)
    return TransducerData(start_ns, tuple(signals), angle, speed, warm, distrusted)


def first_temperature_degc(run: Run) -> float | None:
    """Return the transducer's temperature at the start of a run, None where nothing tells it."""
    sources = sources_of(run)
    if sources.temperature is None:
        return None
    key, unit = sources.temperature
    decoder = Decoder(run.databases, {key[1]})
    for _, batch in zip(range(_LOOK_BATCHES), run.frame_batches(), strict=False):
        values = decoder.decode(batch)[key].values
        values = values[np.isfinite(values)]
        if len(values):
            return float(np.median(values)) * unit.factor + unit.offset - 273.15
    return None


def _read(run: Run, keys: list[Key]) -> dict[Key, Channel]:
    decoder = Decoder(run.databases, {name for _, name in keys})
    pieces: dict[Key, list[Channel]] = {key: [] for key in keys}
    for batch in run.frame_batches():
        decoded = decoder.decode(batch)
        for key in pieces:
            pieces[key].append(decoded[key])
    return {key: _joined(key[1], parts) for key, parts in pieces.items()}


def _joined(name: str, parts: list[Channel]) -> Channel:
    time_ns = np.concatenate([np.zeros(0, np.int64), *(part.time_ns for part in parts)])
    return Channel(name, "", time_ns, np.concatenate([np.zeros(0), *(part.values for part in parts)]))


def _ordered(time_ns: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    known = np.isfinite(values)
    time_ns, values = time_ns[known], values[known]
    keep = in_order(time_ns)
    return merge_equal_stamps(time_ns[keep], values[keep])


def _between(
    time_ns: IntArray, values: FloatArray, start_ns: int, span_s: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    at = seconds_since(time_ns, start_ns)
    rows = (at >= span_s[0]) & (at <= span_s[1])
    return at[rows], values[rows]


def _trusted(channel: Channel, status: Channel | None) -> tuple[Channel, int]:
    """Return a channel without the samples whose status is not 0, and how many those are."""
    if status is None or not len(status):
        return channel, 0
    statuses = status_at(channel.time_ns, status.time_ns, status.values, np.diff(status.time_ns))
    good = (statuses == 0) | np.isneginf(statuses)
    return Channel(channel.name, channel.unit, channel.time_ns[good], channel.values[good]), int(np.sum(~good))


def _latency_ns(run: Run, sources: Sources, key: Key) -> int:
    """Return the declared delay of a signal: that of a role in its message."""
    message = key[1].partition(".")[0]
    for role in TRANSDUCER_ROLES:
        reference = sources.roles.get(role)
        if reference and (reference.bus, reference.message) == (key[0], message):
            return latency_ns(run.vehicle, role)
    return 0


def _name(key: Key, sources: Sources) -> str:
    """Return "Message.Signal", with the bus before it where another bus has one of that name."""
    same = [other for other in sources.signals if other[1] == key[1]]
    return key[1] if len(same) == 1 else f"{key[0]}:{key[1]}"


@dataclass(frozen=True)
class Found:
    """One determination, as `wheelsoil zero` tells it.

    Attributes
    ----------
    outliers : mapping str -> int
        Samples of each channel that did not count.
    """

    run: Run
    determination: Determination
    check: WeightCheck | None
    outliers: dict[str, int]
    remarks: tuple[Note, ...]


def find_zeros(
    paths: Sequence[Path],
    *,
    vehicle: Path | None = None,
    wheel: str | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    on_ground: bool = False,
    lenient_dbc: bool = False,
) -> list[Found]:
    """Determine the zero from each recording, in order of time; of several wheels one is named.

    Raises
    ------
    WheelsoilError
        What is wrong with any of the recordings, of all of them at once.
    """
    collected = Collected()
    found = []
    for run in one_wheel(open_runs(paths, vehicle=vehicle, lenient_dbc=lenient_dbc), wheel):
        with collected.catch(str(run.path)):
            found.append(_find(run, from_s, to_s, on_ground=on_ground))
    collected.stop_if_any()
    return sorted(found, key=lambda result: result.determination.time_utc)


def _find(run: Run, from_s: float | None, to_s: float | None, *, on_ground: bool) -> Found:
    data = transducer_data(run, from_s=from_s, to_s=to_s)
    lifted = determine(data.signals, data.angle, data.speed, run.vehicle, on_ground=on_ground)
    determination = _determination(run, data, lifted, on_ground=on_ground)
    forces = {
        signal.role: (determination.channels[signal.name], signal.si_factor)
        for signal in data.signals
        if signal.role in ("drawbar_pull", "vertical_load") and signal.name in determination.channels
    }
    check = check_weight(forces, run.vehicle)
    remarks = [*lifted.remarks, *(check.remarks if check else ())]
    if data.distrusted:
        remarks.append(Note(ZeroCode.DISTRUSTED, values={"count": data.distrusted}))
    remarks += _warming(data, lifted)
    return Found(run, determination, check, lifted.outliers, tuple(remarks))


def _determination(run: Run, data: TransducerData, lifted: Lifted, *, on_ground: bool) -> Determination:
    part, transducer = lifted.part, run.vehicle.transducer
    middle_us = (data.start_ns + round((part.start_s + part.stop_s) / 2 * 1e9)) // 1000
    warm = _temperatures(data, lifted)
    return Determination(
        time_utc=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=middle_us),
        recording=run.path.name,
        sha256=sha256_of(*run.files),
        method=part.method,
        frame=transducer.frame,
        on_ground=on_ground,
        start_s=max(round(part.start_s, 3), 0.0),
        duration_s=round(part.stop_s - part.start_s, 3),
        revolutions=part.revolutions,
        speed_radps=round(part.mean_speed_radps, 4) if part.method == "spin" else None,
        angle_deg=round(float(np.degrees(part.angle_rad)) % 360, 2) if isfinite(part.angle_rad) else None,
        angle_offset_deg=transducer.angle_offset_deg,
        angle_direction=transducer.angle_direction,
        temperature_degc=round(float(np.median(warm)), 1) if len(warm) else None,
        channels={name: _rounded(zero) for name, zero in lifted.channels.items()},
    )


def _rounded(zero: ChannelZero) -> ChannelZero:
    """Take out digits that mean nothing."""
    numbers = {key: value for key, value in zero.model_dump(exclude_none=True).items() if key != "unit"}
    return zero.model_copy(update={key: float(f"{value:.7g}") for key, value in numbers.items()})


def _temperatures(data: TransducerData, lifted: Lifted) -> FloatArray:
    if data.temperature_degc is None:
        return np.zeros(0)
    time_s, values = data.temperature_degc
    return values[(time_s >= lifted.part.start_s) & (time_s < lifted.part.stop_s)]


def _warming(data: TransducerData, lifted: Lifted) -> list[Note]:
    warm = _temperatures(data, lifted)
    if not len(warm) or not np.ptp(warm) > _NOTABLE_RISE_K:
        return []
    return [Note(ZeroCode.WARMED_UP, values={"from_degc": float(warm[0]), "to_degc": float(warm[-1])})]


def drifts(found: Sequence[Found]) -> tuple[list[Drift], list[Note]]:
    """Return the drift from each determination to the next, and what cannot be compared."""
    rows: list[Drift] = []
    remarks: list[Note] = []
    for before, after in pairwise(found):
        changes, doubts = drift_between(before.determination, after.determination)
        rows += changes
        remarks += doubts
    return rows, remarks


def all_compared(found: Sequence[Found]) -> bool:
    """Return whether there is a drift to tell from each determination to the next; False of a single one."""
    pairs = list(pairwise(found))
    return bool(pairs) and all(drift_between(earlier.determination, later.determination)[0] for earlier, later in pairs)


def too_far(rows: Sequence[Drift], most: Mapping[Quantity, float]) -> list[Drift]:
    """Return the drifts that exceed what is allowed, in N and Nm."""
    out = []
    for row in rows:
        unit = find_unit(row.unit, tuple(most))
        if unit is not None and abs(row.change) * unit.factor > most[unit.quantity]:
            out.append(row)
    return out


def zero_path(run: Run, vehicle: Path | None, output: Path | None) -> Path:
    """Return the file that a determination goes to: beside vehicle.toml, under the name it gives."""
    if output is not None:
        return output
    return (vehicle or run.path).parent / zero_file_name(run.vehicle)


def check_place(path: Path) -> ZeroConfig:
    """Return what a zero file holds already; nothing where it is not there yet.

    `ConfigError` where it is wrong, is a folder, or its folder does not exist.
    """
    check_output(path, force=True)
    return load_zeros(path) if path.exists() else ZeroConfig()


def append(path: Path, found: Sequence[Found]) -> ZeroConfig:
    """Add determinations to a zero file, in order of time; the file is replaced in one step.

    `ConfigError` as from `check_place`.
    """
    zeros = check_place(path).plus(*(result.determination for result in found))
    try:
        write_whole(path, zeros_toml(zeros))
    except OSError as error:
        step = "check the folder, and whether another program holds the file"
        raise ConfigError.of(
            "the zeros cannot be written", path, error.strerror or str(error), next_step=step
        ) from None
    return zeros


def zeros_for(run: Run, given: Path | None = None) -> RunZeros:
    """Return the determinations that a run is to be zeroed with, and its temperature; raises as `Run.zeros`."""
    determinations, source = run.zeros(given)
    return RunZeros(determinations, source, first_temperature_degc(run)) if determinations else RunZeros()
