"""What a run does not carry, for a purpose that only looks: which roles, why, and what to do."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from daq.channel import Channel
from daq.config import VehicleConfig
from daq.errors import ConfigError, DataError, Fault
from processing.inputs import MODEL_ROLES
from processing.options import FORCE_ROLES, SLIP_ROLES

_ROTATING = (*FORCE_ROLES, "wheel_angle")


def noting(chunks: Iterable[Mapping[str, Channel]], came: set[str]) -> Iterator[Mapping[str, Channel]]:
    """Pass chunks through; `came` gets every role of which there is a sample."""
    for chunk in chunks:
        came |= {role for role, channel in chunk.items() if len(channel)}
        yield chunk


def require_any(seen: Collection[str], came: Collection[str], vehicle: VehicleConfig) -> None:
    """Check that there is something to look at.

    Parameters
    ----------
    seen, came : collection of str
        Roles that have a signal, and those of which a sample came.
    vehicle : VehicleConfig

    Raises
    ------
    ConfigError
        No signal has a role that can be shown.
    DataError
        None of those that have one holds a sample.
    """
    named = [role for role in MODEL_ROLES if role in seen]
    if not named:
        raise ConfigError(
            Fault(
                "no signal has a role that can be shown",
                where="[signals]",
                found=", ".join(sorted(seen)) or "no roles at all",
                expected=f"at least one of {', '.join(MODEL_ROLES)}",
                next_step='add wheel_speed = "Message.Signal" to [signals] of vehicle.toml, and the others alike',
            )
        )
    if not any(role in came for role in named):
        raise DataError(*(nothing_received(role, vehicle) for role in named))


def nothing_received(role: str, vehicle: VehicleConfig) -> Fault:
    """Return the fault of a role without samples."""
    return Fault(
        f"the run holds no sample of {role}",
        where=vehicle.signals.get(role, ""),
        next_step="check that its frames were recorded (wheelsoil info) and that the signal is the right one",
    )


def why_missing(
    roles: Collection[str], seen: Collection[str], came: Collection[str], vehicle: VehicleConfig
) -> dict[str, str]:
    """Return a sentence for each speed and force that a slip and a fit need and the run does not carry.

    Parameters
    ----------
    roles : collection of str
        Those that can be used.
    seen, came : collection of str
        As in `require_any`.
    vehicle : VehicleConfig

    Raises
    ------
    DataError
        Nothing of all that has a signal can be used; says why of each.
    """
    if not any(role in roles for role in MODEL_ROLES):
        raise DataError(*(Fault(_sentence(role, seen, came, vehicle)) for role in MODEL_ROLES if role in seen))
    return {role: _sentence(role, seen, came, vehicle) for role in (*SLIP_ROLES, *FORCE_ROLES) if role not in roles}


def _sentence(role: str, seen: Collection[str], came: Collection[str], vehicle: VehicleConfig) -> str:
    return f"{role} is missing; {_step(role, seen, came, vehicle)}"


def _step(role: str, seen: Collection[str], came: Collection[str], vehicle: VehicleConfig) -> str:
    rotating = vehicle.transducer.frame == "wheel" and role in FORCE_ROLES
    lacking = [one for one in (_ROTATING if rotating else (role,)) if one not in came]
    if not lacking:
        check = "check the sensor, and with GNSS its fix" if role == "ground_speed" else "check the sensor"
        return f"{vehicle.signals.get(role, 'its signal')} never has a usable value: {check}"
    one = role if role in lacking else lacking[0]
    name = "it" if one == role else f"{one}, which turns it into vehicle axes,"
    if one not in seen:
        return f"name {name} under [signals] of vehicle.toml"
    return f"{vehicle.signals.get(one, one)} holds no sample: check that its frames were recorded (wheelsoil info)"
