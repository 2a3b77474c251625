"""Names in ``[health]`` of vehicle.toml that nothing goes by: what they were to excuse is not excused."""

from __future__ import annotations

from collections.abc import Mapping

from daq.buses import messages_by_bus
from daq.config import VehicleConfig
from daq.databases import Database
from daq.errors import Fault, nearest

_OF_MESSAGES = ("may_be_silent", "may_be_constant", "may_leave_range")
_STEP = "mend [health] in vehicle.toml"


def unknown_names(vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]) -> list[Fault]:
    """Return a fault for each name that no DBC and no bus has.

    Parameters
    ----------
    vehicle : VehicleConfig
    databases : mapping bus -> databases
        Without any, nothing can be said of messages and signals.

    Raises
    ------
    DatabaseError
        The databases of a bus contradict each other.
    """
    messages: set[str] = set()
    signals: set[str] = set()
    for of_bus in messages_by_bus(databases).values():
        messages |= set(of_bus)
        signals |= {f"{name}.{signal}" for name, message in of_bus.items() for signal in message.by_name}
    faults = []
    for key in _OF_MESSAGES if messages else ():
        for name in getattr(vehicle.health, key):
            known = signals if "." in name else messages
            if name not in messages | signals:
                what = f"no {'signal' if known is signals else 'message'} of the DBCs is called {name!r}"
                faults.append(Fault(what, f"[health] {key}", expected=nearest(name, known), next_step=_STEP))
    buses = {bus.channel for bus in vehicle.bus}
    for name in vehicle.health.may_carry_unknown:
        if name not in buses:
            what = f"no bus is called {name!r}"
            faults.append(Fault(what, "[health] may_carry_unknown", expected=nearest(name, buses), next_step=_STEP))
    return faults
