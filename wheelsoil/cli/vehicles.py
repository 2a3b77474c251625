"""Vehicle, terrain and DBCs as the options of a command give them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from daq.buses import messages_by_bus
from daq.config import VehicleConfig, parse_toml
from daq.databases import Database, load_database
from daq.errors import ConfigError, Fault
from daq.open import Collected
from daq.run import VEHICLE_FILE, Configuration, terrain_from_file, vehicle_from_file


def configuration(
    vehicle: Path | None, terrain: Path | None, dbc: Iterable[tuple[str, str]] = (), *, lenient_dbc: bool = False
) -> Configuration:
    """Load what the options name; DBCs alone become a vehicle.toml that says only which bus they are of.

    Raises
    ------
    ConfigError
        Everything that is wrong, at once.
    """
    files = list(dbc)
    if vehicle and files:
        raise ConfigError(Fault("--dbc and --vehicle exclude each other", next_step="name the DBCs in vehicle.toml"))
    collected = Collected()
    known = Configuration()
    with collected.catch():
        if vehicle:
            known = vehicle_from_file(vehicle, lenient_dbc=lenient_dbc)
        elif files:
            known = _only_databases(files, lenient=lenient_dbc)
    with collected.catch():
        if terrain:
            known = known.over(terrain_from_file(terrain))
    collected.stop_if_any()
    return known


def pairs(texts: Iterable[str] | None, option: str, form: str) -> list[tuple[str, str]]:
    """Parse ``a=b`` values of a repeated option.

    Raises
    ------
    ConfigError
        One is not of that form.
    """
    parsed = [tuple(text.partition("=")[::2]) for text in texts or ()]
    faults = [
        Fault(f"{option} {text} is not understood", expected=form)
        for text, (left, right) in zip(texts or (), parsed, strict=True)
        if not left or not right
    ]
    if faults:
        raise ConfigError(*faults)
    return [(left, right) for left, right in parsed]


def _only_databases(files: Iterable[tuple[str, str]], *, lenient: bool) -> Configuration:
    """Return a vehicle of which only the buses and their DBCs are known."""
    import tomli_w

    buses: dict[str, list[Path]] = {}
    for bus, file in files:
        buses.setdefault(bus, []).append(Path(file))
    collected = Collected()
    databases: dict[str, tuple[Database, ...]] = {}
    for bus, paths in buses.items():
        for path in paths:
            with collected.catch():
                databases[bus] = (*databases.get(bus, ()), load_database(path, lenient=lenient))
    collected.stop_if_any()
    messages_by_bus(databases)
    text = tomli_w.dumps({"bus": [{"channel": bus, "dbc": [p.name for p in paths]} for bus, paths in buses.items()]})
    carried = {database.name: database.content for bus in databases.values() for database in bus}
    vehicle = parse_toml(text, VehicleConfig, "--dbc")
    return Configuration(vehicle, databases, attachments={VEHICLE_FILE: text.encode(), **carried})
