"""How a zero moved from one determination to the next."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from daq.zero_file import ChannelZero, Determination

_SIGNIFICANT_SIGMAS = 3.0
_SAME_ANGLE_DEG = 5.0


@dataclass(frozen=True)
class Drift:
    """The change of one part of one channel, in its unit.

    Attributes
    ----------
    channel, unit : str
    part : str
        "offset", "cos" or "sin".
    change, sigma : float
    """

    channel: str
    unit: str
    part: str
    change: float
    sigma: float

    @property
    def significant(self) -> bool:
        """Whether it is more than 3 sigma."""
        return abs(self.change) > _SIGNIFICANT_SIGMAS * self.sigma


def drift_between(before: Determination, after: Determination) -> tuple[list[Drift], list[str]]:
    """Return the drift of every channel that both have, and what cannot be compared.

    Stationary parts are compared where both are of one kind (method, axes, on the ground or not), rotating parts where
    both have them.
    """
    if before.kind != after.kind:
        return [], [f"{before.recording} ({_kind(before)}) and {after.recording} ({_kind(after)}) cannot be compared"]
    remarks = []
    if before.angle_deg is not None and after.angle_deg is not None:
        apart = abs((after.angle_deg - before.angle_deg + 180) % 360 - 180)
        if apart > _SAME_ANGLE_DEG:
            remarks.append(f"the wheel stood {apart:.0f} deg further on: a rotating zero looks like drift")
    rows = []
    for name, old in before.channels.items():
        new = after.channels.get(name)
        if new is None or new.unit != old.unit:
            remarks.append(f"{name}: not in both, or in another unit")
        else:
            rows += _of_channel(name, old, new)
    return rows, remarks


def _of_channel(name: str, old: ChannelZero, new: ChannelZero) -> list[Drift]:
    rows = [Drift(name, old.unit, "offset", new.offset - old.offset, hypot(new.offset_sigma, old.offset_sigma))]
    if old.cos is None or new.cos is None or old.sin is None or new.sin is None:
        return rows
    sigma = hypot(old.rotating_sigma or 0.0, new.rotating_sigma or 0.0)
    return [
        *rows,
        Drift(name, old.unit, "cos", new.cos - old.cos, sigma),
        Drift(name, old.unit, "sin", new.sin - old.sin, sigma),
    ]


def _kind(one: Determination) -> str:
    where = ", on the ground" if one.on_ground else ""
    return f"{one.method}, {one.frame} axes{where}, angle offset {one.angle_offset_deg:g} deg"
