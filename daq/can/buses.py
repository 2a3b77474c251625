"""The databases of every bus of a vehicle, cross-checked."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from daq.can.bits import Message
from daq.can.databases import Database, load_database, shipped_dbc
from daq.config import VehicleConfig
from daq.errors import DatabaseError, Fault


def load_for_vehicle(vehicle: VehicleConfig, folder: Path, *, lenient: bool = False) -> dict[str, tuple[Database, ...]]:
    """Load the DBCs of every ``[[bus]]`` of a vehicle and cross-check them.

    Parameters
    ----------
    folder : Path
        Where relative names start (the folder of vehicle.toml); a bare name that is not there may be a shipped one.
    lenient : bool
        See `load_database`.

    Returns
    -------
    dict
        Bus name to its databases; one file on several buses is loaded once.

    Raises
    ------
    DatabaseError
        All faults of all files at once.
    """
    loaded: dict[str, Database] = {}
    faults: list[Fault] = []
    for name in dict.fromkeys(name for bus in vehicle.bus for name in bus.dbc):
        try:
            loaded[name] = load_database(_locate(name, folder), lenient=lenient)
        except DatabaseError as error:
            faults += error.faults
    if faults:
        raise DatabaseError(*faults)
    databases: dict[str, tuple[Database, ...]] = {}
    for bus in vehicle.bus:
        more = tuple(loaded[name] for name in bus.dbc)
        databases[bus.channel] = (*databases.get(bus.channel, ()), *more)
    messages_by_bus(databases)
    return databases


def no_bus_in_common(vehicle: VehicleConfig, buses: Collection[str]) -> str:
    """Return a note where no bus of a log is in vehicle.toml, else an empty text."""
    described = {bus.channel for bus in vehicle.bus}
    if not (described and buses) or described & set(buses):
        return ""
    return f"no bus of vehicle.toml ({', '.join(sorted(described))}) is in the log ({', '.join(buses)})"


def messages_by_bus(databases: Mapping[str, Sequence[Database]]) -> dict[str, dict[str, Message]]:
    """Merge the databases of each bus; the keys are the names by which channels and roles know the messages.

    A name that several identifiers of one bus carry gets the identifier behind it: ``STATUS@0x200``.

    Raises
    ------
    DatabaseError
        Lists every identifier that two databases of one bus lay out differently.
    """
    faults: list[Fault] = []
    merged = {bus: _merge(bus, files, faults) for bus, files in databases.items()}
    if faults:
        raise DatabaseError(*faults)
    return {bus: _named(list(messages.values())) for bus, messages in merged.items()}


def _merge(bus: str, files: Sequence[Database], faults: list[Fault]) -> dict[int, Message]:
    owner: dict[int, tuple[Message, str]] = {}
    for database in files:
        for message in database.messages:
            other, name = owner.setdefault(message.key, (message, database.name))
            if other != message:
                faults.append(
                    Fault(
                        f"two DBCs lay out identifier {message.id_text()} differently",
                        f"bus {bus}",
                        f"{other.name} in {name}, {message.name} in {database.name}",
                        "one layout per identifier on a bus",
                        "give this bus only one of the two files, or take the message out of one",
                    )
                )
    return {key: message for key, (message, _) in owner.items()}


def _named(messages: list[Message]) -> dict[str, Message]:
    count: dict[str, int] = {}
    for message in messages:
        count[message.name] = count.get(message.name, 0) + 1
    return {(m.name if count[m.name] == 1 else f"{m.name}@{m.id_text()}"): m for m in messages}


def _locate(name: str, folder: Path) -> Path:
    path = folder / name
    if path.is_file() or Path(name).name != name:
        return path
    try:
        return shipped_dbc(name)
    except DatabaseError:
        return path
