"""Sections of vehicle.toml about wheels, their sensors and transducers, and what several wheels must agree on."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, pairwise
from math import pi
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from daq import ROLES, nearest

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Section(BaseModel):
    """A table of a file that people write: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class BriefSection(Section):
    """A section that writes the keys of `only_if_set` where they differ from their default; it writes all others."""

    only_if_set: ClassVar[frozenset[str]]

    @model_serializer(mode="wrap")
    def _without_unset(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields = type(self).model_fields
        unset = {key for key in self.only_if_set if getattr(self, key) == fields[key].default}
        return {key: value for key, value in dump(self).items() if key not in unset}


Axle = Annotated[int, Field(ge=1, le=30)]
"""An axle, counted from the front, or a number of axles."""


_SMALLEST_RADIUS_M, _LARGEST_RADIUS_M = 0.02, 5.0
_STEEL_KGPM3 = 7850.0


_FARTHEST_M = 30.0


class Placed(BriefSection):
    """What has a place on the vehicle: ISO 8855, x forward, y left, from one origin of the user's choice."""

    x_m: Finite | None = None
    y_m: Finite | None = None

    @field_validator("x_m", "y_m", "z_m", check_fields=False)
    @classmethod
    def _on_the_vehicle(cls, value: float | None) -> float | None:
        if value is None or abs(value) <= _FARTHEST_M:
            return value
        metres = value * 1e-3
        hint = f"; {value:g} mm are {metres:.4g} m" if abs(metres) <= _FARTHEST_M else ""
        raise ValueError(f"{value:g} m is on no vehicle: a place is within {_FARTHEST_M:g} m of the origin{hint}")

    @model_validator(mode="after")
    def _both_ways(self) -> Self:
        if (self.x_m is None) != (self.y_m is None):
            raise ValueError("x_m and y_m go together: x forward, y to the left, in metres; add the other one")
        return self


_PLACE = ("x_m", "y_m", "z_m")


ALL_WHEELS = "all"
"""In place of a wheel's id in results: of all wheels together."""


class WheelSection(Placed):
    """``[wheel]``: the instrumented wheel; outboard = on the soil side of the transducer. Without a place: (0, 0).

    ``axle`` is counted from the front: the wheel of a rear axle runs in the rut of those before it.
    """

    only_if_set = frozenset({"x_m", "y_m", "axle", "id", "rolling_radius_m"})

    id: Annotated[str, Field(max_length=40)] = ""
    radius_m: Positive
    rolling_radius_m: Positive | None = None
    width_m: Annotated[float, Field(gt=0, lt=5)]
    position: str = ""
    axle: Axle | None = None
    outboard_mass_kg: NonNegative = 0.0
    outboard_inertia_kgm2: NonNegative = 0.0
    tyre: Literal["smooth", "lugged"] | None = None
    lug_height_m: NonNegative | None = None
    lug_count: Annotated[int, Field(ge=0, le=10_000)] | None = None

    @field_validator("id")
    @classmethod
    def _for_a_file_name(cls, value: str) -> str:
        if value == ALL_WHEELS:
            raise ValueError(f"{ALL_WHEELS!r} is what all wheels together are called: give the wheel another id")
        if all(letter.isalnum() or letter in "-_" for letter in value):
            return value
        raise ValueError("an id holds letters, digits, - and _ only: it becomes part of file names")

    @field_validator("radius_m", "rolling_radius_m")
    @classmethod
    def _in_metres(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is None or value < _LARGEST_RADIUS_M:
            return value
        metres = {unit: value * factor for unit, factor in (("mm", 1e-3), ("inches", 0.0254))}
        likely = [
            f"{value:g} {unit} are {radius:.4g} m: write {info.field_name} = {radius:.4g}"
            for unit, radius in metres.items()
            if _SMALLEST_RADIUS_M <= radius < _LARGEST_RADIUS_M
        ]
        hint = "; or ".join(likely) or "give the rolling radius in metres"
        raise ValueError(f"{value:g} m is the radius of no wheel, which is below {_LARGEST_RADIUS_M:g} m; {hint}")

    @model_validator(mode="after")
    def _no_heavier_than_steel(self) -> Self:
        solid_kg = _STEEL_KGPM3 * pi * self.radius_m**2 * self.width_m
        most = (self.outboard_mass_kg or solid_kg) * self.radius_m**2
        if self.outboard_mass_kg > solid_kg:
            raise ValueError(
                f"outboard_mass_kg = {self.outboard_mass_kg:g} is more than a wheel of solid steel of this radius and "
                f"width has, {solid_kg:.4g} kg; give it in kilograms: {self.outboard_mass_kg:g} g are "
                f"{self.outboard_mass_kg * 1e-3:g} kg"
            )
        if self.outboard_inertia_kgm2 > 1.2 * most:
            raise ValueError(
                f"outboard_inertia_kgm2 = {self.outboard_inertia_kgm2:g} is more than that of all the mass at the "
                f"tread, {most:.3g} kg m2; give it in kg m2: {self.outboard_inertia_kgm2:g} kg cm2 are "
                f"{self.outboard_inertia_kgm2 * 1e-4:g} kg m2"
            )
        return self

    @model_validator(mode="after")
    def _lugs_agree(self) -> Self:
        height = self.lug_height_m
        if height is not None and height >= self.radius_m:
            raise ValueError(
                f"lug_height_m = {height:g} is not below radius_m = {self.radius_m:g}; "
                "give the height from the rim to the tip, in metres"
            )
        if self.tyre is not None and height is not None and (self.tyre == "lugged") != (height > 0):
            raise ValueError(f'tyre = "{self.tyre}" contradicts lug_height_m = {height:g}; correct one of them')
        if self.lug_count and not height:
            raise ValueError(f"lug_count = {self.lug_count} needs lug_height_m; add it")
        return self

    @property
    def rolling_m(self) -> float:
        """Radius that makes a rim speed of the wheel speed; forces keep ``radius_m``."""
        return self.rolling_radius_m or self.radius_m

    @property
    def tread(self) -> Literal["smooth", "lugged", ""]:
        """Whether the wheel has lugs, as it is declared or as its lugs say; empty where neither does."""
        if self.tyre is None and self.lug_height_m is not None:
            return "lugged" if self.lug_height_m > 0 else "smooth"
        return self.tyre or ""


class SensorSection(Placed):
    """``[sensors.<role>]``: whole delay of the sensor, and sigma of one sample in SI units.

    The place is that of the antenna of ``ground_speed``, ``z_m`` above the wheel's centre; no other sensor has one.
    """

    only_if_set = frozenset(_PLACE)

    latency_s: Annotated[float, Field(ge=-5, le=5)] = 0.0
    sigma: NonNegative | None = None
    z_m: Finite | None = None


class TransducerSection(Section):
    """``[transducer]``: axes of the wheel force transducer and how its zero was taken."""

    frame: Literal["vehicle", "wheel"] = "vehicle"
    side: Literal["left", "right"] = "left"
    angle_offset_deg: Finite = 0.0
    angle_direction: Literal[1, -1] = 1
    zero: Literal["lifted", "spin", "none"] = "none"
    zero_file: str = ""
    serial: str = ""


class SignalName(Section):
    """Value of a role in ``[signals]``: a text, or ``{signal = "...", unit = "kN", sign = -1}``.

    ``signal`` is ``"Message.Signal"``, ``"can1:Message.Signal"``, or a column or topic of decoded series as its
    file writes it. A ``-`` in front of a text is the sign. A stated unit replaces the one of the DBC or of the file.
    """

    signal: Annotated[str, Field(min_length=1)]
    unit: str | None = None
    sign: Literal[1, -1] = 1

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        return {"signal": value.removeprefix("-"), "sign": -1 if value.startswith("-") else 1}

    @model_serializer(mode="wrap")
    def _as_text(self, dump: SerializerFunctionWrapHandler) -> Any:
        return str(self) if self.unit is None else dump(self)

    def __str__(self) -> str:
        return f"-{self.signal}" if self.sign < 0 else self.signal


def _known_roles(of_roles: dict[str, Any]) -> dict[str, Any]:
    unknown = [role for role in of_roles if role not in ROLES]
    if unknown:
        raise ValueError(
            "; ".join(f"no role is called {role!r} ({nearest(role, ROLES, label='known: ')})" for role in unknown)
        )
    return of_roles


def _only_the_antenna_has_a_place(sensors: dict[str, SensorSection]) -> dict[str, SensorSection]:
    for role, sensor in sensors.items():
        given = [key for key in _PLACE if getattr(sensor, key) is not None]
        if given and role != "ground_speed":
            raise ValueError(f"{role} takes no {given[0]}: only ground_speed has a place, that of its antenna")
    return sensors


Signals = Annotated[dict[str, SignalName], AfterValidator(_known_roles)]
"""By role."""
Sensors = Annotated[
    dict[str, SensorSection], AfterValidator(_known_roles), AfterValidator(_only_the_antenna_has_a_place)
]
"""By role."""


class InstrumentedWheel(WheelSection):
    """``[[wheel]]``: one of several instrumented wheels, with the signals, sensors and transducer of its own."""

    id: Annotated[str, Field(min_length=1, max_length=40)]
    signals: Signals = Field(default_factory=dict)
    sensors: Sensors = Field(default_factory=dict)
    transducer: TransducerSection = TransducerSection()

    @field_validator("signals", "sensors")
    @classmethod
    def _roles_of_a_wheel(cls, value: dict[str, Any]) -> dict[str, Any]:
        others = [role for role in value if not ROLES[role].of_wheel]
        if others:
            raise ValueError(f"{', '.join(others)}: of the whole vehicle, for [signals] or [sensors]")
        return value

    @property
    def section(self) -> WheelSection:
        """The wheel as a single ``[wheel]`` has it; without a position its id stands there."""
        known = {name: getattr(self, name) for name in WheelSection.model_fields.keys() & self.model_fields_set}
        return WheelSection(**(known | {"position": self.position or self.id}))


def contradictions(wheels: Sequence[InstrumentedWheel]) -> Iterator[str]:
    """Yield what cannot be so of the instrumented wheels of one vehicle."""
    for wheel in wheels:
        if "vertical_load" not in wheel.signals:
            yield (
                f"wheel {wheel.id} has no load: add vertical_load to its [wheel.signals]; "
                "a wheel without a transducer is no [[wheel]], and counts in axles only"
            )
        if wheel.y_m:
            yield from _on_another_side(wheel, wheel.y_m)
    if len(wheels) > 1 and any(wheel.axle is None for wheel in wheels):
        without = ", ".join(wheel.id for wheel in wheels if wheel.axle is None)
        yield f"{without}: axle is missing: with several wheels each needs it, from 1 at the front"
    for first, second in combinations(wheels, 2):
        yield from _contradict(first, second)


_SIDES = {
    "left": {"left", "fl", "lf", "ml", "rl", "lr", "vl", "hl"},
    "right": {"right", "fr", "rf", "mr", "rr", "vr", "hr"},
}


def _on_another_side(wheel: InstrumentedWheel, y_m: float) -> Iterator[str]:
    """Yield what names the other side than ``y_m``; the side of a transducer where it is stated or changes a sign."""
    side, other = ("left", "right") if y_m > 0 else ("right", "left")
    own = wheel.transducer
    of_it = own.side if own.frame == "wheel" or own.side == "right" else ""
    for key, text in (("id", wheel.id), ("position", wheel.position), ("side", of_it)):
        words = set(re.findall("[a-z]+", text.lower()))
        if words & _SIDES[other] and not words & _SIDES[side]:
            yield (
                f'wheel {wheel.id}: {key} = "{text}" contradicts y_m = {y_m:g}, which is on the {side}: '
                "y_m points to the left; correct one of them"
            )


_OnlyOnce = tuple[str, Callable[[InstrumentedWheel], str]]
_ONLY_ONCE: tuple[_OnlyOnce, ...] = (
    ("transducer serial", lambda wheel: wheel.transducer.serial),
    ("zero_file", lambda wheel: wheel.transducer.zero_file),
)


def _contradict(first: InstrumentedWheel, second: InstrumentedWheel) -> Iterator[str]:
    if first.id == second.id:
        yield f"two wheels have the id {first.id!r}; give each its own"
        return
    both = f"wheels {first.id} and {second.id}"
    for name, value_of in _ONLY_ONCE:
        if value_of(first) and value_of(first) == value_of(second):
            yield f"{both} have the same {name} {value_of(first)!r}; correct one of them"
    for role in first.signals.keys() & second.signals.keys():
        if first.signals[role].signal == second.signals[role].signal:
            yield f"{both} have the same signal {first.signals[role].signal!r} for {role}; correct one of them"
    if first.x_m is not None and (first.x_m, first.y_m) == (second.x_m, second.y_m):
        yield f"{both} have the same place (x_m = {first.x_m:g}, y_m = {first.y_m:g}); correct one of them"
    places = sorted((w.axle, w.x_m, w.id) for w in (first, second) if w.axle is not None and w.x_m is not None)
    for (axle, x_m, front), (rear_axle, rear_x_m, rear) in pairwise(places):
        if axle == rear_axle and rear_x_m - x_m > first.radius_m + second.radius_m:
            yield (
                f"{both} have the same axle = {axle}, but x_m = {x_m:g} and {rear_x_m:g}, one behind the other; "
                "correct one of them"
            )
        if axle != rear_axle and x_m <= rear_x_m:
            yield (
                f"wheel {front} (axle = {axle}, x_m = {x_m:g}) is not ahead of wheel {rear} (axle = {rear_axle}, "
                f"x_m = {rear_x_m:g}): axles count from the front, x_m points forward; correct one of them"
            )
