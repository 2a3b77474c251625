"""The mistakes in vehicle.toml that the referee knows, each with what undoes it in the channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

from daq import Quantity, find_unit

JUDGED_ROLES = ("ground_speed", "wheel_speed", "vertical_load", "drawbar_pull", "driving_torque")
"""The channels that are judged, in the order of their rows."""
RADIUS = "radius_m"


def _factors(quantity: Quantity, *names: str) -> dict[str, float]:
    """Return what the values in each unit are multiplied by to be in SI."""
    found = {name: find_unit(name, (quantity,)) for name in names}
    return {name: unit.factor for name, unit in found.items() if unit is not None}


_SPEEDS = _factors(Quantity.SPEED, "km/h", "mph", "kt")
_WHEEL_SPEEDS = _factors(Quantity.ANGULAR_SPEED, "rpm", "deg/s")
_FORCES = _factors(Quantity.FORCE, "kN", "kgf", "lbf")
_MOMENTS = _factors(Quantity.MOMENT, "kNm", "lbf ft")
_LENGTHS = _factors(Quantity.LENGTH, "in", "mm")
_FORCE_ROLES = ("vertical_load", "drawbar_pull")
_OF_FORCE = {"kN": "kNm", "lbf": "lbf ft"}


class Kind(StrEnum):
    """What kind of mistake it is."""

    UNIT = "unit"
    """The values are in `unit`, and were taken for SI."""
    DECLARED = "declared"
    """The values are in SI, and were taken for `unit`."""
    SIGN = "sign"
    EXCHANGED = "exchanged"
    UNLISTED = "unlisted"
    """None of these, or several."""


@dataclass(frozen=True, eq=False)
class Mend:
    """One mistake, and what undoes it.

    Attributes
    ----------
    factors : mapping role -> float
        What the values as declared are multiplied by, of the radius, too.
    units : mapping role -> str
        The unit that was mistaken.
    """

    kind: Kind
    factors: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    exchanged: tuple[str, ...] = ()

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles that it changes."""
        return self.exchanged or tuple(self.factors)

    @property
    def key(self) -> str:
        """Short name: ``unit:ground_speed=km/h``, ``sign:drawbar_pull``, ``exchanged:ground_speed,wheel_speed``."""
        return f"{self.kind}:" + ",".join(
            f"{role}={self.units[role]}" if role in self.units else role for role in self.roles
        )


def _units() -> list[Mend]:
    single = [
        ("ground_speed", _SPEEDS),
        ("wheel_speed", _WHEEL_SPEEDS),
        *((role, _FORCES) for role in _FORCE_ROLES),
        ("driving_torque", _MOMENTS),
        (RADIUS, _LENGTHS),
    ]
    found = [Mend(Kind.UNIT, {role: f}, {role: unit}) for role, units in single for unit, f in units.items()]
    both = [(dict.fromkeys(_FORCE_ROLES, f), dict.fromkeys(_FORCE_ROLES, unit)) for unit, f in _FORCES.items()]
    found += [Mend(Kind.UNIT, factors, units) for factors, units in both]
    return found + [
        Mend(
            Kind.UNIT,
            factors | {"driving_torque": _MOMENTS[_OF_FORCE[units["vertical_load"]]]},
            units | {"driving_torque": _OF_FORCE[units["vertical_load"]]},
        )
        for factors, units in both
        if units["vertical_load"] in _OF_FORCE
    ]


def _declared() -> list[Mend]:
    return [
        Mend(Kind.DECLARED, {role: 1 / f}, {role: unit})
        for role, units in (("ground_speed", _SPEEDS), ("wheel_speed", _WHEEL_SPEEDS))
        for unit, f in units.items()
    ]


MENDS = (
    *_units(),
    *_declared(),
    *(Mend(Kind.SIGN, {role: -1.0}) for role in JUDGED_ROLES),
    *(Mend(Kind.EXCHANGED, exchanged=pair) for pair in combinations(JUDGED_ROLES, 2)),
)
"""Every mistake that the referee knows; one at a time."""
UNLISTED = Mend(Kind.UNLISTED)
LISTED = tuple(mend.key for mend in MENDS if mend.kind is not Kind.DECLARED and len(mend.factors) < 2)
"""The thirty that the documentation lists, each of one channel or one pair."""
BY_KEY = {mend.key: mend for mend in (*MENDS, UNLISTED)}
