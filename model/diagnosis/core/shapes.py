"""What a shape of misfit stands for, as values: its kind, its channel, the range that it covers, and of what."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Kind(StrEnum):
    """What a shape of the catch-all hangs on; shapes of one kind are judged together."""

    SLIP = "slip"
    BRAKING_SLIP = "braking slip"
    LOAD_DRIVING = "load, driving"
    LOAD_BRAKING = "load, braking"
    LOAD_SQUARED = "load squared"
    GROUND_SPEED = "ground speed"
    LINE_POSITION = "line position"
    TIME_IN_RUN = "time in a run"
    DIRECTION_DRIVING = "direction, driving"
    DIRECTION_BRAKING = "direction, braking"
    CONSTANT_DRIVING = "constant, driving"
    CONSTANT_BRAKING = "constant, braking"
    ACCELERATION_DRIVING = "acceleration, driving"
    ACCELERATION_BRAKING = "acceleration, braking"
    SLIP_RATE_DRIVING = "slip rate, driving"
    SLIP_RATE_BRAKING = "slip rate, braking"
    DRAWBAR_PULL = "drawbar pull"
    DRAWBAR_PULL_SQUARED = "drawbar pull squared"
    DRAWBAR_PULL_DRIFT = "drawbar pull over the campaign"
    TORQUE = "torque"
    TORQUE_SQUARED = "torque squared"
    TORQUE_DRIFT = "torque over the campaign"
    ZERO_WITH_LOAD = "zero that grows with the load"
    SPEED_ERROR = "error of the ground speed"
    LOAD_ERROR = "error of the load"
    LOAD_ERROR_WITH_LOAD = "error of the load that grows with it"


@dataclass(frozen=True)
class Shape:
    """One shape of the catch-all.

    Attributes
    ----------
    kind : str
        A `Kind`.
    channel : str
        "dp", "t" or "z"; of an error of an input its key in `daq.INPUTS`.
    range : (float, float), optional
        Of a hat: the neighbours of its knot, in the order of the knots; an outer hat's ends at its own knot.
    unit : str
        Of the range.
    knot : float
        Where a hat is one.
    run, campaign : str
        Where the shape is one run's own, or one campaign's among several.
    cause : str
        Key of the effect whose formula it changes.
    vehicle, wheel : str
        Campaign of all wheels, and the wheel's id, where the shape is of one of several wheels of a vehicle.
    """

    kind: str
    channel: str = ""
    range: tuple[float, float] | None = None
    unit: str = ""
    knot: float = float("nan")
    run: str = ""
    campaign: str = ""
    cause: str = ""
    vehicle: str = ""
    wheel: str = ""

    @property
    def slips(self) -> tuple[float, float] | None:
        """Slip that a hat over slip covers; the outer ones go on to no slip and to all of it."""
        if self.range is None or self.kind not in (Kind.SLIP, Kind.BRAKING_SLIP):
            return None
        whole = 1.0 if self.kind == Kind.SLIP else -1.0
        near, far = self.range
        covered = (0.0 if near == self.knot else near, whole if far == self.knot else far)
        return min(covered), max(covered)


@dataclass(frozen=True)
class Rows:
    """Rows of a single-wheel table that were measured under one condition.

    Attributes
    ----------
    slip, vertical_load_n : float
        Means over the rows.
    campaign : str
        Name of the table where there are several.
    """

    slip: float
    vertical_load_n: float
    count: int
    campaign: str = ""

    @property
    def slips(self) -> None:
        """No range: the rows are one condition."""
        return
