"""Which determinations a run is zeroed with: the last before and the first after it, per channel."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from daq import ROLES, TRANSDUCER_ROLES, ChannelZero, Determination, FloatArray, IntArray, VehicleConfig, find_unit


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
        one = self.first.coefficients[:, None]
        if self.second is None:
            return np.broadcast_to(one, (3, len(time_ns)))
        share = self._share(time_ns)
        return np.asarray(one + share * (self.second.coefficients[:, None] - one))

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


def choose(determinations: tuple[Determination, ...], vehicle: VehicleConfig, start_ns: int) -> dict[str, RoleZero]:
    """Return the zero of every role that has one.

    Parameters
    ----------
    start_ns : int
        Start of the run. Two determinations are interpolated between where they are of one kind; otherwise the nearer
        one holds.
    """
    chosen = {}
    for role in TRANSDUCER_ROLES:
        found = [one for one in (_find(d, role, vehicle) for d in determinations) if one is not None]
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


def systematic_sigma(role: str, zeros: dict[str, RoleZero], frame: str, time_ns: int) -> float:
    """Return what the zero leaves uncertain of a role's mean over whole revolutions, in vehicle axes, SI.

    In wheel axes a stationary error turns away, and what stays is the rotating one: both forces share it,
    delta F_x = (delta b_x + delta c_z) / 2. NaN of a force whose zero is of a standstill: in vehicle axes its mean is
    wrong by the rotating zero at that wheel angle, in wheel axes by what the declared weight is; neither is known.
    """
    sigmas = zeros[role].sigmas_at(time_ns)
    if role == "driving_torque":
        return float(sigmas[0])
    if frame == "vehicle":
        return float(sigmas[0]) if zeros[role].turns else float("nan")
    if "drawbar_pull" not in zeros or "vertical_load" not in zeros:
        return float("nan")
    turning = [zeros[one].sigmas_at(time_ns)[1] for one in ("drawbar_pull", "vertical_load")]
    return sqrt(turning[0] ** 2 + turning[1] ** 2) / 2


def _find(determination: Determination, role: str, vehicle: VehicleConfig) -> Found | None:
    text = vehicle.signals.get(role, "")
    plain = text.removeprefix("-")
    channel = determination.channels.get(plain) or determination.channels.get(plain.rpartition(":")[2])
    if channel is None:
        return None
    unit = find_unit(channel.unit, ROLES[role].quantities)
    if unit is None:
        return None
    return Found(determination, channel, (-1.0 if text.startswith("-") else 1.0) * unit.factor)
