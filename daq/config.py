"""vehicle.toml, terrain.toml and runs.toml as checked models: unknown keys refused, all faults at once."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from math import degrees, hypot
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    BaseModel,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo

from daq.channels import REACTIONS, ROLES
from daq.errors import ConfigError, Fault, every_error_as, nearest, shortened
from daq.limits import DEEPEST_KEY, LARGEST_TOML_BYTES, MOST_FAULTS, MOST_RUNS, MOST_WHEELS
from daq.vehicle_sections import (
    Axle,
    BriefSection,
    Finite,
    InstrumentedWheel,
    NonNegative,
    Positive,
    Section,
    Sensors,
    Signals,
    contradictions,
)
from daq.vehicle_sections import SensorSection as SensorSection
from daq.vehicle_sections import TransducerSection as TransducerSection
from daq.vehicle_sections import WheelSection as WheelSection

SOIL_KEYS = (
    "cohesion_kpa",
    "friction_angle_deg",
    "shear_modulus_m",
    "sinkage_exponent",
    "cohesive_modulus_kn",
    "frictional_modulus_kn",
)
"""Order of the rows of ``[uncertainty] covariance``."""


Brakes = Literal["held", "released", "unknown"]
"""What holds the vehicle at a standstill; `unknown` is taken for held."""

ConfigT = TypeVar("ConfigT", bound=BaseModel)

# in a line of its own, where TOML takes no comma
_DECIMAL_COMMA = re.compile(r"(?m)=[ \t]*([-+]?\d+),(\d+)[ \t]*(?:#.*)?\r?$")
_DEEP_KEY = re.compile(rf"""(?<![\w.-])(?:["']?[\w-]+["']?[ \t]*\.[ \t]*){{{DEEPEST_KEY}}}""")


_LIGHT_KG = 50.0
"""Mass of a vehicle below which it is rather in tonnes than that of its wheel in grams."""
LEAST_LOAD_SHARE = 0.03
"""Least share of a vehicle's mass on a wheel that stands on the ground."""


class VehicleSection(BriefSection):
    """``[vehicle]``; ``axles`` counts those without an instrumented wheel, too."""

    only_if_set = frozenset({"axles"})

    name: str = "unnamed vehicle"
    mass_kg: Positive | None = None
    standstill_brakes: Brakes = "unknown"
    axles: Axle | None = None


class BusSection(Section):
    """``[[bus]]``: one CAN bus and the DBC files that describe it."""

    channel: str
    dbc: tuple[str, ...] = ()
    interface: str | None = None
    fd: bool = False
    bitrate: int | None = None


class LoggerSection(Section):
    """``[logger]``: how `wheelsoil log` records. A new file of the same run is begun at either rotation limit."""

    rotate_mb: Positive = 1000.0
    rotate_min: Positive | None = None
    flush_s: Positive = 0.2
    sync_s: Positive = 1.0
    decoded_rate_hz: Positive = 100.0
    receive_buffer_kb: Positive = 8192.0
    queue_mb: Positive = 64.0
    disk_warn_min: Positive = 60.0
    disk_reserve_mb: Positive = 100.0

    @property
    def receive_buffer_bytes(self) -> int:
        """What is asked of the kernel for each bus."""
        return int(self.receive_buffer_kb * 1024)


class HealthSection(Section):
    """``[health]``: what is no fault of this vehicle, as ``"Message"`` or ``"Message.Signal"``; buses by their name."""

    may_be_silent: tuple[str, ...] = ()
    may_be_constant: tuple[str, ...] = ()
    may_leave_range: tuple[str, ...] = ()
    may_carry_unknown: tuple[str, ...] = ()


class SeriesSection(Section):
    """``[series]``: how a file of decoded time series is laid out, where it does not say so itself.

    ``time`` names the time column, or several: a column belongs to the last of them before it. ``rate_hz`` is for files
    without one. ``time_format`` is as in strptime, for stamps that are not ISO 8601. ``thousands`` is what parts the
    thousands of numbers in text.
    """

    time: str | tuple[str, ...] = ()
    time_unit: Literal["s", "ms", "us", "ns", "min", "h"] | None = None
    time_format: str = ""
    rate_hz: Positive | None = None
    decimal: Literal[".", ","] | None = None
    thousands: Literal[".", ",", "'", " "] | None = None

    @property
    def times(self) -> tuple[str, ...]:
        """The time columns that are named."""
        return ((self.time,) if self.time else ()) if isinstance(self.time, str) else self.time


class VehicleConfig(Section):
    """vehicle.toml. A role that is not in ``signals`` is not there; commands say which they need.

    ``[[wheel]]`` tables are ``wheels``, and ``wheel`` is None; `for_wheel` has one of them as a single ``[wheel]``.
    """

    vehicle: VehicleSection = VehicleSection()
    wheel: WheelSection | None = None
    wheels: Annotated[tuple[InstrumentedWheel, ...], Field(validation_alias="wheel", max_length=MOST_WHEELS)] = ()
    bus: tuple[BusSection, ...] = ()
    signals: Signals = Field(default_factory=dict)
    series: SeriesSection = SeriesSection()
    sensors: Sensors = Field(default_factory=dict)
    transducer: TransducerSection = TransducerSection()
    logger: LoggerSection = LoggerSection()
    health: HealthSection = HealthSection()

    @field_validator("wheel", mode="before")
    @classmethod
    def _the_only_one(cls, value: Any) -> Any:
        return None if isinstance(value, list | tuple) else value

    @field_validator("wheels", mode="before")
    @classmethod
    def _of_several(cls, value: Any) -> Any:
        return value if isinstance(value, list | tuple) else ()

    @model_validator(mode="after")
    def _signals_of_a_bus(self) -> Self:
        of_wheels = [(f"wheel {wheel.id}: signals", wheel.signals) for wheel in self.wheels]
        for where, signals in [("signals", self.signals), *of_wheels] if self.bus else ():
            for role, name in signals.items():
                if name.signal.count(".") != 1 or not all(name.signal.split(".")):
                    raise ValueError(f'{where}.{role} = "{name}" is not "Message.Signal"')
        return self

    @model_validator(mode="after")
    def _axle_of_the_vehicle(self) -> Self:
        axles = self.vehicle.axles
        if axles is not None and self.wheel and self.wheel.axle is None:
            raise ValueError(f"vehicle.axles = {axles} needs the wheel's: add axle under [wheel], 1 at the front")
        single = [("wheel.axle", self.wheel.axle)] if self.wheel else []
        for key, axle in [*single, *((f"wheel {wheel.id}: axle", wheel.axle) for wheel in self.wheels)]:
            if axle is not None and axles is None:
                raise ValueError(f"{key} = {axle} needs the number of axles: add axles under [vehicle]")
            if axle is not None and axles is not None and axle > axles:
                raise ValueError(
                    f"{key} = {axle} is not on a vehicle with vehicle.axles = {axles}; correct one of them"
                )
        return self

    @model_validator(mode="after")
    def _wheels_lighter_than_the_vehicle(self) -> Self:
        mass_kg = self.vehicle.mass_kg
        single = [("wheel", self.wheel)] if self.wheel else []
        for key, wheel in [*single, *((f"wheel {wheel.id}:", wheel) for wheel in self.wheels)]:
            outboard_kg = wheel.outboard_mass_kg
            if mass_kg is not None and outboard_kg > mass_kg:
                name = f"{key}.outboard_mass_kg" if key == "wheel" else f"{key} outboard_mass_kg"
                grams = f"{outboard_kg:g} g are {outboard_kg / 1e3:g} kg"
                tonnes = f"{mass_kg:g} t are {mass_kg * 1e3:g} kg"
                raise ValueError(
                    f"{name} = {outboard_kg:g} is more than vehicle.mass_kg = {mass_kg:g}, of which it is a part; "
                    f"correct one of them, in kilograms: {tonnes if mass_kg < _LIGHT_KG else grams}"
                )
        return self

    @model_validator(mode="after")
    def _wheels_agree(self) -> Self:
        if not self.wheels:
            return self
        faults = list(contradictions(self.wheels))
        if misplaced := [role for role in self.signals if ROLES[role].of_wheel]:
            faults.append(f"{', '.join(misplaced)} in [signals]: of one wheel, for its [wheel.signals]")
        if self.transducer != TransducerSection():
            faults.append("[transducer] beside several [[wheel]]: write [wheel.transducer] under its wheel")
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @model_serializer(mode="wrap")
    def _as_in_the_file(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = dump(self)
        wheels = values.pop("wheels", ())
        return values | {"wheel": wheels} if wheels else values

    @property
    def wheel_ids(self) -> tuple[str, ...]:
        """Of the instrumented wheels; a single ``[wheel]`` needs none."""
        return tuple(wheel.id for wheel in self.wheels or (self.wheel,) if wheel and wheel.id)

    @property
    def each_wheel(self) -> tuple[Self, ...]:
        """The configuration of each wheel, see `for_wheel`; of a file without several wheels the file itself."""
        return tuple(map(self.for_wheel, self.wheel_ids)) if self.wheels else (self,)

    def for_wheel(self, name: str | None = None, where: str = "vehicle.toml") -> Self:
        """Return the configuration of one wheel, as a file with a single ``[wheel]`` gives it.

        Parameters
        ----------
        name : str, optional
            Its id; not needed where there is one wheel.
        where : str
            Name of the file, for messages.

        Raises
        ------
        ConfigError
            There is no such wheel, or there are several and none is named.
        """
        ids = self.wheel_ids
        if name is None and len(self.wheels) > 1:
            step = f"name one: --wheel {ids[0]}"
            raise ConfigError.of("several wheels, and this takes one", where, ", ".join(ids), next_step=step)
        if name is not None and name not in ids:
            expected, step = (
                (nearest(name, ids), f"name one of {', '.join(ids)} by --wheel")
                if ids
                else ("one [wheel] without an id", "omit --wheel")
            )
            raise ConfigError.of(f"no wheel has the id {name!r}", where, expected=expected, next_step=step)
        if not self.wheels:
            return self
        wheel = next(wheel for wheel in self.wheels if name in (None, wheel.id))
        return self.model_copy(
            update={
                "wheel": wheel.section,
                "wheels": (),
                "signals": self.signals | wheel.signals,
                "sensors": self.sensors | wheel.sensors,
                "transducer": wheel.transducer,
            }
        )

    def named(self, role: str) -> str:
        """Return a role with the id of its wheel, where that has one: ``vertical_load of FL``."""
        return f"{role} of {self.wheel.id}" if self.wheel and self.wheel.id and ROLES[role].of_wheel else role

    @property
    def wheel_option(self) -> str:
        """The option that chooses this wheel, behind a command: `` --wheel FL``; empty for a wheel without an id."""
        return f" --wheel {quote(self.wheel.id)}" if self.wheel and self.wheel.id else ""

    def latency_s(self, role: str) -> float:
        """Return the declared delay of a role's sensor, 0 where none is declared."""
        sensor = self.sensors.get(role)
        return sensor.latency_s if sensor else 0.0


_SMALLEST_ANGLE_DEG, _LARGEST_ANGLE_DEG = 1.5, 60.0
"""Of friction angles: a smaller one is taken for radians."""


class SoilSection(Section):
    """``[soil]``: the laboratory's values, in the units of the paper's Tab. 1."""

    name: str
    cohesion_kpa: Annotated[float, Field(ge=0, lt=1000)]
    friction_angle_deg: Annotated[float, Field(ge=0, lt=_LARGEST_ANGLE_DEG)]
    shear_modulus_m: Annotated[float, Field(gt=0, lt=1)]
    sinkage_exponent: Annotated[float, Field(gt=0, lt=3)]
    cohesive_modulus_kn: Finite
    frictional_modulus_kn: Finite
    unit_weight_kn_m3: Positive | None = None
    plate_speed_mps: Positive | None = None

    @field_validator("friction_angle_deg")
    @classmethod
    def _in_degrees(cls, value: float) -> float:
        if value == 0 or value >= _SMALLEST_ANGLE_DEG:
            return value
        angle = degrees(value)
        hint = f"{value:g} rad are {angle:.1f} degrees: write friction_angle_deg = {angle:.1f}"
        raise ValueError(
            f"{value:g} degrees is the friction angle of no soil: 0 for one of cohesion alone, else at least "
            f"{_SMALLEST_ANGLE_DEG:g}; {hint if angle < _LARGEST_ANGLE_DEG else 'give the angle in degrees'}"
        )


class UncertaintySection(Section):
    """``[uncertainty]``: relative one-sigma per key (friction angle: of tan phi), or a covariance.

    ``covariance`` is 6 x 6 in the order of `SOIL_KEYS`, in the units of ``[soil]`` (friction angle in degrees).
    """

    cohesion_kpa: NonNegative | None = None
    friction_angle_deg: NonNegative | None = None
    shear_modulus_m: NonNegative | None = None
    sinkage_exponent: NonNegative | None = None
    cohesive_modulus_kn: NonNegative | None = None
    frictional_modulus_kn: NonNegative | None = None
    unit_weight_kn_m3: NonNegative | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None

    @field_validator("covariance")
    @classmethod
    def _six_by_six(cls, value: tuple[tuple[float, ...], ...] | None) -> tuple[tuple[float, ...], ...] | None:
        if value is not None and (len(value) != 6 or any(len(row) != 6 for row in value)):
            raise ValueError(f"covariance must be 6 x 6, in the order {', '.join(SOIL_KEYS)}")
        return value


class TerrainConfig(Section):
    """terrain.toml."""

    soil: SoilSection
    uncertainty: UncertaintySection | None = None


class OfWheel(BriefSection):
    """What belongs to one wheel of several, by its id."""

    only_if_set = frozenset({"wheel"})

    wheel: str = ""


class RutReading(OfWheel):
    """``[[run.rut]]``: the depth of the rut that the run left, by a ruler, at a time, a distance or a position."""

    depth_m: NonNegative
    sigma_m: Positive
    time_s: NonNegative | None = None
    distance_m: NonNegative | None = None
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    after_pass: Annotated[int, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise ValueError("latitude_deg and longitude_deg go together")
        if sum(x is not None for x in (self.time_s, self.distance_m, self.latitude_deg)) != 1:
            raise ValueError("give one place: time_s, distance_m, or latitude_deg and longitude_deg")
        return self


class RunInfo(BriefSection):
    """``[[run]]``: what is known of one run besides its frames.

    On firm ground it has no soil: its speeds while the wheel rolls freely are a `StaticTest`.
    """

    only_if_set = frozenset({"rut", "ground"})

    file: str = ""
    id: str = ""
    direction: Literal["out", "back"] = "out"
    pass_number: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    added_load_kg: Finite = 0.0
    inflation_kpa: Positive | None = None
    ground: Literal["soft", "firm"] = "soft"
    rut: tuple[RutReading, ...] = ()


_STATIC_KEYS = (("drawbar_pull_n", "drawbar_pull_sigma_n"), ("driving_torque_nm", "driving_torque_sigma_nm"))
"""Keys of a reading and of its one-sigma."""
_COASTED = (
    {"driving_torque_nm", "driving_torque_sigma_nm", "drag_nm", "drag_sigma_nm"},
    {"ground_speed_mps", "ground_speed_sigma_mps", "wheel_speed_radps"},
)
"""Keys that go together of a wheel that coasts: of its torque, and of its speeds."""


class StaticTest(OfWheel):
    """``[[static]]``: what is read without soil, of a wheel lifted, under a known force, or coasting on firm ground.

    Readings are raw, with the signs of the roles. A known torque is given as it is, or as a force on a lever. Of a
    wheel that coasts they are means, and its drag is what bearings and brake hold back; `run` is where they are from.
    A zero of a lifted wheel is read before or after the runs, if `when` says so.
    """

    only_if_set = frozenset({"wheel", "run", "when"})

    test: Literal["lifted", "known_pull", "known_torque", "coasting"]
    run: str = ""
    when: Literal["before", "after"] | None = None
    applied_n: Finite | None = None
    lever_m: Positive | None = None
    applied_nm: Finite | None = None
    applied_share: Annotated[float, Field(ge=0, le=0.05)] = 0.005
    drawbar_pull_n: Finite | None = None
    drawbar_pull_sigma_n: Positive | None = None
    driving_torque_nm: Finite | None = None
    driving_torque_sigma_nm: Positive | None = None
    drag_nm: NonNegative | None = None
    drag_sigma_nm: Positive | None = None
    ground_speed_mps: Positive | None = None
    ground_speed_sigma_mps: Positive | None = None
    wheel_speed_radps: Positive | None = None
    ground_acceleration_mps2: Finite | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for (key, sigma_key), (reading, sigma) in zip(_STATIC_KEYS, self._pairs(), strict=True):
            if (reading is None) != (sigma is None):
                known, missing = (key, sigma_key) if sigma is None else (sigma_key, key)
                raise ValueError(f"{missing} is missing: a reading and its one-sigma go together, and {known} is given")
        given = {key for key in ("applied_n", "lever_m", "applied_nm") if getattr(self, key) is not None}
        if self.when and self.test != "lifted":
            raise ValueError('when is of a zero, before or after the runs: test = "lifted", or take it out')
        if self.test == "coasting":
            return self._of_coasting()
        if odd := [key for key, x in self if key.startswith(("drag_", "ground_", "wheel_speed_")) and x is not None]:
            raise ValueError(f'{odd[0]} is of a wheel that coasts: test = "coasting"')
        if not self.readings:
            raise ValueError("give a reading: drawbar_pull_n or driving_torque_nm, each with its one-sigma")
        if self.test == "lifted" and given:
            raise ValueError('nothing is applied to a wheel that is only lifted: test = "known_pull" or "known_torque"')
        if self.test == "known_pull" and (given != {"applied_n"} or self.drawbar_pull_n is None):
            raise ValueError("a known pull needs applied_n alone, and the reading drawbar_pull_n")
        whole = given in ({"applied_n", "lever_m"}, {"applied_nm"})
        if self.test == "known_torque" and len(given) == 3:
            raise ValueError("a known torque is given twice: applied_nm, or applied_n with lever_m, not both")
        if self.test == "known_torque" and (self.driving_torque_nm is None or not whole):
            lacks = {"applied_n": "lever_m", "lever_m": "applied_n"}.get("".join(given))
            missing = f"; {lacks} is missing" if lacks else ""
            raise ValueError(
                f"a known torque needs driving_torque_nm, and applied_nm or applied_n with lever_m{missing}"
            )
        if self.test != "lifted" and not any(self.applied.values()):
            raise ValueError('what is applied is 0: test = "lifted"')
        for channel, (reading, _) in self.readings.items():
            force = self.applied[channel]
            if force and not _LEAST <= reading / force <= _MOST:
                raise ValueError(
                    f"the reading {reading:g} is {reading / force:.3g} times what was applied; check unit and sign "
                    "(positive as the role has it), or apply a force that is large beside the zero"
                )
        return self

    def _of_coasting(self) -> Self:
        there = {key for key, value in self if value is not None}
        if odd := sorted(there & {"drawbar_pull_n", "applied_n", "applied_nm", "lever_m"}):
            raise ValueError(
                f"{odd[0]} is not of a wheel that coasts: nothing is applied, and its pull is a rolling resistance "
                "that is not known; take it out"
            )
        lacking = [keys - there for keys in _COASTED if keys & there]
        if any(lacking) or not lacking:
            needed = "; or ".join(", ".join(sorted(keys)) for keys in _COASTED)
            missing = ", ".join(sorted(set().union(*lacking))) or "all of them"
            raise ValueError(f"{missing} missing: a wheel that coasts needs {needed}")
        return self

    @property
    def applied(self) -> dict[str, float]:
        """Known pull and torque, N and N m; of a wheel that coasts its drag."""
        pull = self.applied_n or 0.0 if self.test == "known_pull" else 0.0
        torque = (self.applied_nm or 0.0) + (self.applied_n or 0.0) * (self.lever_m or 0.0)
        return {"dp": pull, "t": torque if self.test == "known_torque" else 0.0 - (self.drag_nm or 0.0)}

    @property
    def readings(self) -> dict[str, tuple[float, float]]:
        """Reading and its one-sigma by channel; the one-sigma includes that of the applied force."""
        return {
            channel: (reading, hypot(sigma, self.drag_sigma_nm or self.applied_share * self.applied[channel]))
            for channel, (reading, sigma) in zip(("dp", "t"), self._pairs(), strict=True)
            if reading is not None and sigma is not None
        }

    def _pairs(self) -> list[tuple[float | None, float | None]]:
        return [(getattr(self, key), getattr(self, sigma_key)) for key, sigma_key in _STATIC_KEYS]


SURE = 5.0
"""One-sigmas beyond which two readings contradict each other."""
_KNOWN = {"dp": "known_pull", "t": "known_torque"}
_TOO_FAR = f"which are further apart than {SURE:g} sigmas; take out the wrong one, or state larger sigmas"
_LEAST, _MOST = 0.5, 1.5
"""Shares of a known force between which a reading of it is accepted."""
_MOST_STATIC = 100


def contradict(reading: float, sigma: float, other: float, other_sigma: float) -> bool:
    """Return whether two readings of one quantity are further apart than `SURE` one-sigmas."""
    return abs(reading - other) > SURE * hypot(sigma, other_sigma)


class RunsConfig(Section):
    """runs.toml."""

    run: Annotated[tuple[RunInfo, ...], Field(max_length=MOST_RUNS)] = ()
    static: Annotated[tuple[StaticTest, ...], Field(max_length=_MOST_STATIC)] = ()

    @field_validator("run")
    @classmethod
    def _once(cls, runs: tuple[RunInfo, ...]) -> tuple[RunInfo, ...]:
        named = [run.file for run in runs if run.file]
        if twice := sorted({file for file in named if named.count(file) > 1}):
            raise ValueError(f"{', '.join(twice)} is there twice: leave one [[run]] of each file")
        return runs

    @field_validator("static")
    @classmethod
    def _agree(cls, static: tuple[StaticTest, ...]) -> tuple[StaticTest, ...]:
        """Refuse readings of one wheel that contradict each other; a zero may have moved from before to after."""
        placed = list(enumerate(static, 1))
        for (i, test), (j, other) in combinations(placed, 2):
            alike = test.applied == other.applied and _one_time(test, other)
            for channel in test.readings.keys() & other.readings.keys() if alike else ():
                (a, a_sigma), (b, b_sigma) = test.readings[channel], other.readings[channel]
                if contradict(a, a_sigma, b, b_sigma):
                    raise ValueError(
                        f"[[static]] {i} and {j} contradict each other: {a:g} and {b:g} "
                        f"{REACTIONS[channel].unit_text} under one force, {_TOO_FAR}"
                    )
        for channel, known in _KNOWN.items():
            shown = [each for each in placed if each[1].test in ("lifted", known) and channel in each[1].readings]
            for three in combinations(shown, 3):
                numbers, tests = [i for i, _ in three], [each for _, each in three]
                if _one_time(*tests) and _bent(sizes := [(t.applied[channel], *t.readings[channel]) for t in tests]):
                    raise ValueError(
                        "[[static]] {}, {} and {} contradict each other: no zero and gain give ".format(*numbers)
                        + ", ".join(f"{reading:g} under {applied:g}" for applied, reading, _ in sizes)
                        + f" {REACTIONS[channel].unit_text}, {_TOO_FAR}"
                    )
        return static


def _one_time(*tests: StaticTest) -> bool:
    """Return whether tests are of one wheel, and none is of before the runs and another of after them: a zero moves."""
    return len({test.wheel for test in tests}) == 1 and not {"before", "after"} <= {test.when for test in tests}


def _bent(sizes: Sequence[tuple[float, float, float]]) -> bool:
    """Return whether no straight line fits three tests: what is applied, the reading and its one-sigma of each."""
    (low, a, a_sigma), (mid, b, b_sigma), (high, c, c_sigma) = sorted(sizes)
    share = (mid - low) / (high - low) if low < mid < high else 0.0
    return share > 0.0 and contradict(b, b_sigma, a + share * (c - a), hypot((1.0 - share) * a_sigma, share * c_sigma))


def parse_toml(text: str, kind: type[ConfigT], where: str) -> ConfigT:
    """Parse and check TOML text.

    Parameters
    ----------
    kind : VehicleConfig, TerrainConfig, RunsConfig or another checked model
    where : str
        Name of the file or attachment, for messages.

    Raises
    ------
    ConfigError
        Lists every fault at once, each with the key it is at.
    """
    return parse_mapping(_toml_mapping(text, where), kind, where)


def _toml_mapping(text: str, where: str) -> dict[str, Any]:
    if len(text) > LARGEST_TOML_BYTES:
        step = "check that this is the right file"
        raise ConfigError.of("a TOML file that is too large", where, "", f"at most {LARGEST_TOML_BYTES:,} bytes", step)
    if deep := _DEEP_KEY.search(text):
        found = shortened(deep[0])
        raise ConfigError.of("a key of too many parts", where, found, f"at most {DEEPEST_KEY}, as in vehicle.name")
    with every_error_as(ConfigError, "the TOML cannot be read", lambda: where):
        try:
            return tomllib.loads(text.removeprefix("\ufeff"))  # Windows' editors may begin a file with it
        except tomllib.TOMLDecodeError as error:
            step = _twice(text, str(error)) or _with_point(text, "correct the line named above")
            raise ConfigError.of("not valid TOML", where, str(error), "", step) from None


def _twice(text: str, error: str) -> str:
    """Return where a table or key stands that is there twice, and what to do; empty where it is another error."""
    stated = re.compile(r"\s*(\[[^=]*\]|[^=\[\]]+=)")  # no line within a value
    lines = [re.split("[=#]", each)[0].strip(" \t[]") if stated.match(each) else "" for each in text.splitlines()]
    at = next((int(number) for number in re.findall(r"(?:twice|value) \(at line (\d+)", error)), 0)
    first = next((i for i in range(at - 1, 0, -1) if lines[i - 1] == lines[at - 1]), 0)
    step = "move what is new to the first, and delete the second"
    return f"{lines[at - 1]} is given in line {first} and in line {at}: {step}" if first and lines[at - 1] else ""


def _with_point(text: str, step: str) -> str:
    """Return what to do about a value that has a decimal comma; `step` where none has."""
    comma = _DECIMAL_COMMA.search(text)
    return f"write a decimal point, without quotes: {comma[1]}.{comma[2]}" if comma else step


def parse_mapping(raw: Mapping[str, Any], kind: type[ConfigT], where: str) -> ConfigT:
    """Check what a TOML or JSON file holds; see `parse_toml`."""
    with every_error_as(ConfigError, "the values cannot be checked", lambda: where):
        try:
            return kind.model_validate(raw)
        except ValidationError as error:
            raise ConfigError(*_faults(error, kind, where)) from None


def load_toml(path: Path, kind: type[ConfigT]) -> ConfigT:
    """Read a TOML file; see `parse_toml`."""
    return parse_mapping(read_toml(path), kind, str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file holds, unchecked.

    Raises
    ------
    ConfigError
        There is no such file, or it is no TOML.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_TOML_BYTES + 1).decode()
    except FileNotFoundError:
        raise ConfigError.of("no such file", path, next_step="check the path") from None
    except UnicodeDecodeError as error:
        raise ConfigError.of("the file is not UTF-8", path, str(error), next_step="save it as UTF-8") from None
    except OSError as error:
        raise ConfigError.of("the file cannot be read", path, str(error), "", "check the path and its rights") from None
    return _toml_mapping(text, str(path))


def _faults(error: ValidationError, kind: type[BaseModel], file: str) -> Iterator[Fault]:
    for item in error.errors()[:MOST_FAULTS]:
        where, location = _place(file, item["loc"], of_table=isinstance(item["input"], Mapping))
        message = str(item["ctx"]["error"]) if item["type"] == "value_error" else item["msg"]
        if item["type"] == "extra_forbidden":
            known = _known_keys(kind, item["loc"])
            expected, step = nearest(str(item["loc"][-1]), known), "correct the key, or take it out"
            yield Fault(f"unknown key {location!r}", where, "", expected, step)
        elif item["type"] == "missing":
            yield Fault(f"key {location!r} is missing", where, next_step="add it")
        elif item["type"] == "literal_error":
            what, found = f"{location} has a value that is not known", repr(item["input"])
            expected = item["ctx"]["expected"].replace("'", '"')
            yield Fault(what, where, found, expected, next_step="write one of these")
        elif item["type"] == "tuple_type" and isinstance(item["input"], Mapping):
            yield Fault(
                f"[{location}] is one table",
                where,
                "",
                f"[[{location}]], one or more",
                "correct it, or the schema of the file",
            )
        elif not location:
            yield Fault(message, where)
        else:
            found = "" if isinstance(item["input"], Mapping | list) else shortened(repr(item["input"]))
            step = _with_point("=" + found.strip("'"), "correct it")
            yield Fault(f"{location}: {message}", where, found, next_step=step)
    if error.error_count() > MOST_FAULTS:
        yield Fault(f"{error.error_count() - MOST_FAULTS} more faults", file)


def _place(file: str, location: tuple[int | str, ...], *, of_table: bool) -> tuple[str, str]:
    """Return the file with the numbered sections that a fault is in, counted from 1, and the key within the last.

    `of_table`: the fault is of a section as a whole.
    """
    sections = [i for i, part in enumerate(location if of_table else location[:-1]) if isinstance(part, int)]
    tables = [f"[[{location[i - 1]}]] {int(location[i]) + 1}" for i in sections]
    last = max(sections, default=-1)
    return ", ".join([file, *tables]), ".".join(map(str, location[last + 1 :]))


def _known_keys(kind: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Return the keys that are known beside the last part of `location`."""
    current: type[BaseModel] | None = kind
    for part, after in pairwise(location):
        if current is None or isinstance(part, int):
            continue
        fields = [field.annotation for name, field in current.model_fields.items() if part == _key(name, field)]
        current = _model_in(fields[-1 if isinstance(after, int) else 0]) if fields else None
    return list(dict.fromkeys(_key(*item) for item in current.model_fields.items())) if current else []


def _key(name: str, field: FieldInfo) -> str:
    """Return the key of a field in the file: ``[wheel]`` and ``[[wheel]]`` have one."""
    return field.validation_alias if isinstance(field.validation_alias, str) else name


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        found = _model_in(inner)
        if found is not None:
            return found
    return None
