"""Checks of the files that people write: vehicle.toml, the DBCs, zero.toml."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from daq import TRANSDUCER_ROLES, ConfigError, VehicleConfig, load_zeros, zero_file_name
from daq.can.databases import signals_of
from daq.can.roles import unused_validity
from daq.logger.doctor.situation import Line, Situation, failed, from_fault, passed, warned
from daq.logger.health.watched_messages import unknown_names

_SLIP_ROLES = ("wheel_speed", "ground_speed")
_FRESH_ZERO_H = 12.0
_NOT_CHECKED = "not checked, because vehicle.toml has faults: DBC files, roles, interfaces, traffic, zero"


def vehicle_file(now: Situation) -> Iterator[Line]:
    """Check whether vehicle.toml can be used and names a bus."""
    where = str(now.vehicle_file)
    if now.vehicle_faults:
        yield from (from_fault(fault, where) for fault in now.vehicle_faults)
        yield warned("", _NOT_CHECKED, "correct vehicle.toml and run the doctor again")
    elif not now.vehicle.bus:
        yield failed(where, "no [[bus]]: there is nothing to record", "add a [[bus]] with its channel and its DBCs")
    else:
        yield passed(where, f"{now.vehicle.vehicle.name}, buses {', '.join(now.sections)}")


def dbc_files(now: Situation) -> Iterator[Line]:
    """Check whether the DBCs load and each bus has one."""
    yield from (from_fault(fault) for fault in now.database_faults)
    for bus, databases in now.databases.items():
        if databases:
            messages = sum(len(database.messages) for database in databases)
            yield passed(bus, f"{', '.join(database.name for database in databases)}: {messages} messages")
        else:
            step = "name its DBC in vehicle.toml; raw frames are recorded all the same, and can be decoded later"
            yield warned(bus, "no DBC: nothing of this bus is shown or watched", step)


def roles(now: Situation) -> Iterator[Line]:
    """Check whether the roles and [health] name what there is, and the roles are there that slip needs."""
    if now.vehicle_faults:
        return
    yield from (from_fault(fault) for fault in now.role_faults)
    for fault in unknown_names(now.vehicle, now.databases):
        yield warned(fault.where, f"{fault.what} ({fault.expected})", fault.next_step)
    unused = unused_validity(now.roles, signals_of(now.databases))
    if unused is not None:
        step = f'add ground_speed_valid = "{unused}", so that invalid fixes are excluded'
        yield warned("[signals]", f"{unused} is not used", step)
    lacking = [
        wheel.named(role) for wheel in now.vehicle.each_wheel for role in _SLIP_ROLES if role not in wheel.signals
    ]
    missing = dict.fromkeys(lacking)
    if missing:
        yield warned("[signals]", f"no {' and no '.join(missing)}: no slip", 'add them: role = "Message.Signal"')
    if not missing and not now.role_faults:
        count = len(now.vehicle.signals) + sum(len(wheel.signals) for wheel in now.vehicle.wheels)
        yield passed("[signals]", f"{count} roles")


def zero(now: Situation) -> Iterator[Line]:
    """Check whether there is a fresh zero of the transducer."""
    for wheel in () if now.vehicle_faults else now.vehicle.each_wheel:
        yield from _zero_of(wheel, now.vehicle_file.parent)


def _zero_of(vehicle: VehicleConfig, folder: Path) -> Iterator[Line]:
    named = vehicle.transducer.zero_file
    path = folder / zero_file_name(vehicle)
    step = f"lift the wheel or spin it, record that, then: wheelsoil zero RECORDING{vehicle.wheel_option}"
    if not path.is_file():
        if named:
            found = (
                "not there, and vehicle.toml names it: `log` records without it, `process` refuses until it is there"
            )
            yield warned(str(path), found, step)
        elif any(role in vehicle.signals for role in TRANSDUCER_ROLES):
            yield warned(str(path), "not there: the transducer's own zero is taken as it is", step)
        else:
            yield passed(str(path), "not there, and no force is measured")
        return
    try:
        zeros = load_zeros(path).zero
    except ConfigError as error:
        yield from (from_fault(fault, str(path)) for fault in error.faults)
        return
    if not zeros:
        yield warned(str(path), "it holds no determination", step)
        return
    age_h = (time.time_ns() - zeros[-1].time_ns) / 3.6e12
    found = f"zero of {zeros[-1].time_utc:%Y-%m-%d %H:%M} UTC, {age_h:.1f} h old"
    if not named:
        section = f"[wheel.transducer] of wheel {vehicle.wheel_ids[0]} in" if vehicle.wheel_ids else "[transducer] of"
        line = f'add under {section} vehicle.toml: zero_file = "{path.name}"'
        yield warned(str(path), f"{found}, but vehicle.toml does not name it: `log` will not carry it", line)
    elif 0 <= age_h <= _FRESH_ZERO_H:
        yield passed(str(path), found)
    else:
        yield warned(str(path), found, f"take one before each test: {step}")
