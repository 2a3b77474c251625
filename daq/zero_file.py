"""zero.toml: determinations of the transducer's zero, written by `wheelsoil zero`."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AwareDatetime, Field, model_validator

from daq.config import VehicleConfig, load_toml, parse_toml
from daq.vehicle_sections import Finite, NonNegative, Section

ZERO_FILE = "zero.toml"
"""Its name where vehicle.toml gives none."""
_HEAD = (
    "# Zeros of a wheel force transducer, written by `wheelsoil zero`. A comment is lost when it is written again.\n"
)


class ChannelZero(Section):
    """``[zero.channels."Message.Signal"]``: y0 = offset + cos * cos(psi) + sin * sin(psi), in the unit of the DBC.

    ``cos``, ``sin``, ``rotating_sigma`` and ``twice`` (amplitude of twice per revolution) are of a spin only.
    """

    offset: Finite
    offset_sigma: NonNegative
    cos: Finite | None = None
    sin: Finite | None = None
    rotating_sigma: NonNegative | None = None
    twice: NonNegative | None = None
    unit: str

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if len({self.cos is None, self.sin is None, self.rotating_sigma is None}) > 1:
            raise ValueError("cos, sin and rotating_sigma go together")
        return self


class Determination(Section):
    """``[[zero]]``: one determination.

    ``angle_offset_deg`` and ``angle_direction`` are those of vehicle.toml that psi was counted with; ``angle_deg`` is
    psi of a standstill, where it is known. ``speed_radps`` is that of the spin.
    """

    time_utc: AwareDatetime
    recording: str
    sha256: str
    method: Literal["spin", "standstill"]
    frame: Literal["vehicle", "wheel"]
    on_ground: bool = False
    start_s: Finite = 0.0
    duration_s: NonNegative = 0.0
    revolutions: Annotated[int, Field(ge=0)] = 0
    speed_radps: Finite | None = None
    angle_deg: Finite | None = None
    angle_offset_deg: Finite = 0.0
    angle_direction: Literal[1, -1] = 1
    temperature_degc: Finite | None = None
    channels: dict[str, ChannelZero] = Field(default_factory=dict)

    @property
    def time_ns(self) -> int:
        """UTC nanoseconds of the middle of what was used."""
        since = self.time_utc - datetime(1970, 1, 1, tzinfo=UTC)
        return ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * 1000

    @property
    def holds_outboard_weight(self) -> bool:
        """Whether subtracting this zero also subtracts the outboard weight, so that the reading is the ground force."""
        return self.frame == "vehicle" or self.method == "spin"

    @property
    def kind(self) -> tuple[object, ...]:
        """What two determinations must share to be compared, or interpolated between."""
        return self.method, self.frame, self.on_ground, self.angle_offset_deg, self.angle_direction


class ZeroConfig(Section):
    """zero.toml."""

    zero: tuple[Determination, ...] = ()

    def plus(self, *others: Determination) -> ZeroConfig:
        """Return the file with more determinations, in order of time; of the same samples the newest stays."""
        new = {(zero.sha256, zero.method, zero.start_s): zero for zero in (*self.zero, *others)}
        return ZeroConfig(zero=tuple(sorted(new.values(), key=lambda zero: zero.time_utc)))


def load_zeros(path: Path) -> ZeroConfig:
    """Read zero.toml.

    Raises
    ------
    ConfigError
        Lists every fault at once.
    """
    return load_toml(path, ZeroConfig)


def parse_zeros(content: bytes, where: str) -> ZeroConfig:
    """Parse a zero.toml that a recording carries; see `load_zeros`."""
    return parse_toml(content.decode("utf-8", errors="replace"), ZeroConfig, where)


def zeros_toml(zeros: ZeroConfig) -> str:
    """Return the text of zero.toml."""
    import tomli_w

    return _HEAD + tomli_w.dumps(zeros.model_dump(exclude_none=True))


def zero_file_name(vehicle: VehicleConfig) -> str:
    """Return the name of a wheel's zero file: as vehicle.toml gives it, else the usual one, with the wheel's id."""
    wheel = vehicle.wheel
    return vehicle.transducer.zero_file or (f"zero-{wheel.id}.toml" if wheel and wheel.id else ZERO_FILE)


def carried_zeros(vehicle: VehicleConfig, folder: Path) -> dict[str, bytes]:
    """Return the zero files that vehicle.toml names, by their names, for a recording to carry.

    Empty where vehicle.toml names none, and where there is none yet: the first one is determined from a recording that
    was made without it. `ConfigError` where one is there and is wrong.
    """
    names = [wheel.transducer.zero_file for wheel in vehicle.each_wheel if wheel.transducer.zero_file]
    there = [name for name in names if (folder / name).exists()]
    for name in there:
        load_zeros(folder / name)
    return {name: (folder / name).read_bytes() for name in there}
