"""Choice of the determinations a run is zeroed with, and subtraction at the transducer's own rate, before rotation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import hypot, nan
from typing import Literal

import numpy as np

from daq import (
    ROLES,
    TRANSDUCER_ROLES,
    ZERO_FILE,
    Channel,
    ChannelZero,
    ConfigError,
    Determination,
    FloatArray,
    IntArray,
    Note,
    VehicleConfig,
    find_unit,
)
from processing import RunCode, seconds_since
from processing.pipeline.resampling import OnBase
from processing.pipeline.wheel_frames import appended, interpolate_angle, merged_angle
from processing.processed_run import AppliedZero

_OLD_S = 86_400.0
_WARMER_K = 10.0
_SIGNIFICANT_SIGMAS = 3.0
_OVERLAP_NS = 1_000_000_000
"""Angles are kept so long, for forces that come a little later."""
_NOTABLE_SHARE = 0.001
_PATIENCE_NS = 5_000_000_000
"""How long the wheel angle may be away before forces stop waiting for it."""


@dataclass(frozen=True)
class Found:
    """What one determination says of one role, in SI and in the sense of the role."""

    of: Determination
    channel: ChannelZero
    si_factor: float

    @property
    def coefficients(self) -> FloatArray:
        """Offset, cos and sin, shape (3,)."""
        zero = self.channel
        return self.si_factor * np.array([zero.offset, zero.cos or 0.0, zero.sin or 0.0])

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma of the coefficients; NaN where the rotating part was not seen."""
        zero = self.channel
        turning = np.nan if zero.rotating_sigma is None else zero.rotating_sigma
        return abs(self.si_factor) * np.array([zero.offset_sigma, turning, turning])


@dataclass(frozen=True)
class RoleZero:
    """The zero of one role over a run: linear in time between two determinations, or that of one.

    Attributes
    ----------
    second : Found or None
        Later than `first`.
    """

    first: Found
    second: Found | None = None

    @property
    def turns(self) -> bool:
        """Whether it has a rotating part."""
        return self.first.channel.cos is not None

    @property
    def used(self) -> tuple[Found, ...]:
        """The determinations behind it."""
        return (self.first,) if self.second is None else (self.first, self.second)

    def at(self, time_ns: IntArray) -> FloatArray:
        """Return the coefficients at some instants, shape (3, n)."""
        first = self.first.coefficients[:, None]
        if self.second is None:
            return np.broadcast_to(first, (3, len(time_ns)))
        share = self._share(time_ns)
        return np.asarray(first + share * (self.second.coefficients[:, None] - first))

    def sigmas_at(self, time_ns: int) -> FloatArray:
        """Return the one-sigma of the coefficients at an instant, shape (3,)."""
        if self.second is None:
            return self.first.sigmas
        share = float(self._share(np.array([time_ns]))[0])
        return np.asarray(np.hypot((1 - share) * self.first.sigmas, share * self.second.sigmas))

    def drift(self) -> tuple[float, float]:
        """Return the change of the offset from the first to the second, and its one-sigma; zeros with one only."""
        if self.second is None:
            return 0.0, 0.0
        change = self.second.coefficients[0] - self.first.coefficients[0]
        return float(change), hypot(self.second.sigmas[0], self.first.sigmas[0])

    def _share(self, time_ns: IntArray) -> FloatArray:
        assert self.second is not None
        start, stop = self.first.of.time_ns, self.second.of.time_ns
        return np.clip((time_ns - start) / max(stop - start, 1), 0.0, 1.0)


@dataclass(frozen=True)
class RunZeros:
    """What is known of the transducer's zero.

    Attributes
    ----------
    source : str
        Where they were read, for messages.
    temperature_degc : float or None
        Of the transducer during the run, where it is known.
    """

    determinations: tuple[Determination, ...] = ()
    source: str = ZERO_FILE
    temperature_degc: float | None = None


class ZeroRemoval:
    """Takes a + b cos psi + c sin psi off the transducer's roles.

    Parameters
    ----------
    zeros : RunZeros
        Without determinations nothing is taken off.

    Raises
    ------
    ConfigError
        A zero was taken in other axes than vehicle.toml declares.
    """

    def __init__(self, zeros: RunZeros, vehicle: VehicleConfig) -> None:
        frame = vehicle.transducer.frame
        others = [determination for determination in zeros.determinations if determination.frame != frame]
        if others:
            raise ConfigError.of(
                f"the zero was taken in {others[0].frame} axes, and vehicle.toml says {frame} axes",
                f"{zeros.source}, {others[0].recording}",
                next_step=f"determine it anew: wheelsoil zero RECORDING --vehicle vehicle.toml{vehicle.wheel_option}",
            )
        self._zeros = zeros
        self._vehicle = vehicle
        self._chosen: dict[str, RoleZero] = {}
        self._started = False
        self._span_ns = (0, 0)
        self._held: dict[str, tuple[IntArray, FloatArray]] = {}
        self._angle: tuple[IntArray, FloatArray] = (np.zeros(0, np.int64), np.zeros(0))
        self._angle_comes = False
        self._turning, self._without_angle = 0, 0

    @property
    def needs_angle(self) -> bool:
        """Whether some zero has a rotating part, so that the wheel angle is wanted."""
        return any(
            zero.cos is not None
            for determination in self._zeros.determinations
            for zero in determination.channels.values()
        )

    def removed(self, chunks: Iterable[Mapping[str, Channel]]) -> Iterator[dict[str, Channel]]:
        """Yield the chunks with the zero taken off; latencies must be off the stamps already.

        A force waits for the wheel angle of its instant, interpolated as `interpolate_angle` does; where there is none
        only the stationary part is taken off.
        """
        if not self._zeros.determinations:
            yield from map(dict, chunks)
            return
        for chunk in chunks:
            passed = dict(chunk)
            self._begin(passed)
            angle = passed.get("wheel_angle")
            if angle is not None:
                self._angle_comes = True
                self._angle = appended(self._angle, angle)
                if self._vehicle.transducer.frame == "vehicle":
                    del passed["wheel_angle"]
            for role, zero in self._chosen.items():
                if role in passed and len(passed[role]):
                    self._span_ns = (self._span_ns[0], int(passed[role].time_ns[-1]))
                    passed[role] = self._taken(passed[role], zero)
            # Drop the angles that no held force needs any more, but for the last before them.
            time_ns, values = self._angle
            firsts = [int(stamps[0]) for stamps, _ in self._held.values() if len(stamps)]
            keep_ns = min(firsts, default=int(time_ns[-1]) if len(time_ns) else 0) - _OVERLAP_NS
            keep = time_ns >= keep_ns
            self._angle = (time_ns[keep], values[keep])
            yield passed
        yield {role: self._corrected(role, held, np.iinfo(np.int64).max) for role, held in list(self._held.items())}

    def applied(self) -> dict[str, AppliedZero]:
        """Return what was taken off each role."""
        middle_ns = sum(self._span_ns) // 2
        found = {}
        for role, zero in self._chosen.items():
            offset, cos, sin = zero.at(np.array([middle_ns]))[:, 0]
            found[role] = AppliedZero(
                offset=float(offset),
                rotating=float(np.hypot(cos, sin)) if zero.turns else nan,
                systematic_sigma=_systematic_sigma(role, self._chosen, self._vehicle.transducer.frame, middle_ns),
                methods=tuple(estimate.of.method for estimate in zero.used),
                recordings=tuple(estimate.of.recording for estimate in zero.used),
                ages_s=tuple((self._span_ns[0] - estimate.of.time_ns) * 1e-9 for estimate in zero.used),
                lifted=not any(estimate.of.on_ground for estimate in zero.used),
                of_role=self._vehicle.transducer.frame == "vehicle",
            )
        return found

    def with_sigma(self, roles: dict[str, OnBase]) -> dict[str, OnBase]:
        """Return the roles with the systematic sigma in their facts."""
        out = dict(roles)
        for role, zero in self.applied().items():
            if role in out:
                facts = replace(out[role].facts, systematic_sigma=zero.systematic_sigma)
                out[role] = replace(out[role], facts=facts)
        return out

    def zero_of_load(self) -> Literal["lifted", "spin", "none"]:
        """Return what the zero of the vertical load means now, in the words of ``transducer.zero``."""
        load = self._chosen.get("vertical_load")
        if load is None:
            return self._vehicle.transducer.zero
        return "lifted" if load.first.of.holds_outboard_weight else "spin"

    def notes(self) -> list[Note]:
        """Return notes on what was taken off and how far it can be trusted."""
        if not self._zeros.determinations:
            return []
        chosen, source = self._chosen, self._zeros.source
        notes = []
        roles_by_use: dict[tuple[tuple[str, float], ...], list[str]] = {}
        for role, zero in chosen.items():
            use = tuple((str(estimate.of.method), _age_s(estimate.of, self._span_ns)) for estimate in zero.used)
            roles_by_use.setdefault(use, []).append(role)
        for use, roles in roles_by_use.items():
            methods, ages_s = zip(*use, strict=True)
            facts = {"roles": tuple(roles), "source": source, "methods": methods, "ages_s": ages_s}
            notes.append(Note(RunCode.ZERO_TAKEN_OFF, values=facts))
        for determination in (estimate.of for zero in chosen.values() for estimate in zero.used):
            doubts = _doubts(determination, self._span_ns, self._zeros.temperature_degc)
            notes += [doubt for doubt in doubts if doubt not in notes]
        for role, zero in chosen.items():
            change, sigma = zero.drift()
            if abs(change) > _SIGNIFICANT_SIGMAS * sigma:
                notes.append(Note(RunCode.ZERO_MOVED, values={"role": role, "change": change, "sigma": sigma}))
        missing = tuple(role for role in TRANSDUCER_ROLES if role in self._vehicle.signals and role not in chosen)
        if missing:
            notes.append(Note(RunCode.ZERO_LACKING, values={"roles": missing, "source": source}))
        if self._without_angle > _NOTABLE_SHARE * self._turning:
            counts = {"count": self._without_angle, "total": self._turning}
            notes.append(Note(RunCode.ZERO_WITHOUT_ANGLE, values=counts))
        return notes

    def _begin(self, chunk: dict[str, Channel]) -> None:
        if self._started:
            return
        starts = [int(chunk[role].time_ns[0]) for role in TRANSDUCER_ROLES if role in chunk and len(chunk[role])]
        if starts:
            self._started = True
            self._span_ns = (min(starts), min(starts))
            self._chosen = _choose(self._zeros.determinations, self._vehicle, min(starts))

    def _taken(self, channel: Channel, zero: RoleZero) -> Channel:
        """Return what is ready of a channel, and hold the rest."""
        if not (zero.turns and self._angle_comes):
            return self._corrected(channel.name, (channel.time_ns, channel.values), np.iinfo(np.int64).max)
        held = self._held.get(channel.name, (channel.time_ns[:0], channel.values[:0]))
        joined = (np.concatenate([held[0], channel.time_ns]), np.concatenate([held[1], channel.values]))
        newest = int(self._angle[0][-1]) if len(self._angle[0]) else 0
        return self._corrected(channel.name, joined, max(newest, int(joined[0][-1]) - _PATIENCE_NS))

    def _corrected(self, role: str, pair: tuple[IntArray, FloatArray], until_ns: int) -> Channel:
        time_ns, values = pair
        ready = time_ns <= until_ns
        self._held[role] = (time_ns[~ready], values[~ready])
        time_ns, values = time_ns[ready], values[ready]
        zero = self._chosen[role]
        offset, cos, sin = zero.at(time_ns)
        taken = offset
        if zero.turns and len(time_ns):
            psi = self._psi(time_ns, zero.first.of)
            self._turning += len(psi)
            self._without_angle += int(np.sum(~np.isfinite(psi)))
            taken = offset + np.nan_to_num(cos * np.cos(psi) + sin * np.sin(psi))
        return Channel(role, ROLES[role].unit, time_ns, values - taken)

    def _psi(self, time_ns: IntArray, determination: Determination) -> FloatArray:
        """Return psi as the determination counted it; NaN where the angle is not known."""
        stamps_ns, reading = merged_angle(*self._angle)
        if not len(stamps_ns):
            return np.full(len(time_ns), np.nan)
        origin_ns = int(stamps_ns[0])
        angle = interpolate_angle(seconds_since(time_ns, origin_ns), seconds_since(stamps_ns, origin_ns), reading)
        return np.asarray(determination.angle_direction * (angle - np.radians(determination.angle_offset_deg)))


def _choose(determinations: tuple[Determination, ...], vehicle: VehicleConfig, start_ns: int) -> dict[str, RoleZero]:
    """Return the zero of every role: between two determinations of one kind around the start, else the nearer one."""
    chosen = {}
    for role in TRANSDUCER_ROLES:
        found = [estimate for estimate in (_find(d, role, vehicle) for d in determinations) if estimate is not None]
        before = max((f for f in found if f.of.time_ns <= start_ns), key=lambda f: f.of.time_ns, default=None)
        after = min((f for f in found if f.of.time_ns > start_ns), key=lambda f: f.of.time_ns, default=None)
        if (
            before
            and after
            and before.of.kind == after.of.kind
            and (before.channel.cos is None) == (after.channel.cos is None)
        ):
            chosen[role] = RoleZero(before, after)
        elif before or after:
            chosen[role] = RoleZero(min((f for f in (before, after) if f), key=lambda f: abs(f.of.time_ns - start_ns)))
    return chosen


def _systematic_sigma(role: str, zeros: dict[str, RoleZero], frame: str, time_ns: int) -> float:
    """Return what the zero leaves uncertain of a role's mean over whole revolutions, in vehicle axes, SI.

    In wheel axes a stationary error turns away, and what stays is the rotating one: both forces share it,
    delta F_x = (delta b_x + delta c_z) / 2. NaN of a force whose zero is of a standstill: in vehicle axes its mean is
    wrong by the rotating zero at that wheel angle, in wheel axes by what the declared weight is; neither is known.
    """
    sigmas = zeros[role].sigmas_at(time_ns)
    if role == "driving_torque":
        return float(sigmas[0])
    if frame == "vehicle":
        return float(sigmas[0]) if zeros[role].turns else nan
    if "drawbar_pull" not in zeros or "vertical_load" not in zeros:
        return nan
    return hypot(*(zeros[force].sigmas_at(time_ns)[1] for force in ("drawbar_pull", "vertical_load"))) / 2


def _find(determination: Determination, role: str, vehicle: VehicleConfig) -> Found | None:
    name = vehicle.signals.get(role)
    if name is None:
        return None
    channel = determination.channels.get(name.signal) or determination.channels.get(name.signal.rpartition(":")[2])
    if channel is None:
        return None
    unit = find_unit(channel.unit, ROLES[role].quantities)
    if unit is None:
        return None
    return Found(determination, channel, name.sign * unit.factor)


def _doubts(determination: Determination, span_ns: tuple[int, int], temperature_degc: float | None) -> Iterator[Note]:
    age_s, there = _age_s(determination, span_ns), determination.temperature_degc
    if abs(age_s) > _OLD_S:
        yield Note(RunCode.ZERO_OLD, values={"age_s": age_s})
    if there is not None and temperature_degc is not None and abs(there - temperature_degc) > _WARMER_K:
        yield Note(RunCode.ZERO_TEMPERATURE, values={"zero_degc": there, "run_degc": temperature_degc})
    if determination.method == "standstill":
        yield Note(RunCode.ZERO_WEIGHT_DECLARED if determination.frame == "wheel" else RunCode.ZERO_NOT_TURNED)


def _age_s(determination: Determination, span_ns: tuple[int, int]) -> float:
    """Return how long before the run (negative: after its end) a zero was taken."""
    if determination.time_ns > span_ns[1]:
        return (span_ns[1] - determination.time_ns) * 1e-9
    return max(span_ns[0] - determination.time_ns, 0) * 1e-9
