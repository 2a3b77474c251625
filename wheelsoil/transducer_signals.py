"""The signals of a transducer, whole, from the messages that carry its roles."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from daq.buses import messages_by_bus
from daq.channel import Channel
from daq.config import ROLES
from daq.decode import Decoder
from daq.layout import RawKind, Signal
from daq.roles import SignalRef, resolve_roles
from daq.run import Run
from daq.units import Quantity, Unit, find_unit
from processing.inputs import latency_ns
from processing.timebase import FloatArray, IntArray, in_order, merge_equal_stamps, seconds_since
from processing.transducer_status import FORCE_ROLES, status_at
from processing.transducer_zero import TransducerSignal
from processing.wheel_frames import wheel_angle

_LOOK_BATCHES = 20
Key = tuple[str, str]


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
    signals : tuple of TransducerSignal
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
    distrusted: int = field(default=0)


def sources_of(run: Run, needed: tuple[str, ...] = ()) -> Sources:
    """Find the transducer's signals.

    Raises
    ------
    ConfigError
        A needed role has no signal.
    """
    roles = resolve_roles(run.vehicle, run.databases, needed, ROLES)
    messages = messages_by_bus(run.databases)
    of_role = {roles[role].key: role for role in FORCE_ROLES if role in roles}
    places = dict.fromkeys((roles[role].bus, roles[role].message) for role in FORCE_ROLES if role in roles)
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

    Raises
    ------
    ConfigError
        The vertical load has no signal (or the pull or the wheel angle, for a transducer in wheel axes).
    RecordingError
        The file cannot be read.
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
    said = status_at(channel.time_ns, status.time_ns, status.values, np.diff(status.time_ns))
    good = (said == 0) | np.isneginf(said)
    return Channel(channel.name, channel.unit, channel.time_ns[good], channel.values[good]), int(np.sum(~good))


def _latency_ns(run: Run, sources: Sources, key: Key) -> int:
    """Return the declared delay of a signal: that of a role in its message."""
    message = key[1].partition(".")[0]
    for role in FORCE_ROLES:
        reference = sources.roles.get(role)
        if reference and (reference.bus, reference.message) == (key[0], message):
            return latency_ns(run.vehicle, role)
    return 0


def _name(key: Key, sources: Sources) -> str:
    """Return "Message.Signal", with the bus before it where another bus has one of that name."""
    same = [other for other in sources.signals if other[1] == key[1]]
    return key[1] if len(same) == 1 else f"{key[0]}:{key[1]}"
