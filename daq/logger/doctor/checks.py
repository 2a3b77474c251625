"""The doctor's checks: each is a small function, and `CHECKS` lists them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from daq.logger.doctor import Line, Situation, buses, files, host


@dataclass(frozen=True)
class Check:
    """One check of the doctor."""

    name: str
    run: Callable[[Situation], Iterator[Line]]
    """Yields a line for each bus, file or role; none where the check does not apply."""


CHECKS = (
    Check("vehicle.toml", files.vehicle_file),
    Check("DBC files", files.dbc_files),
    Check("roles", files.roles),
    Check("interface", buses.interface),
    Check("bit rate", buses.bit_rate),
    Check("controller", buses.controller),
    Check("bus-off", buses.restart),
    Check("send queue", buses.send_queue),
    Check("receive buffer", buses.receive_buffer),
    Check("time stamps", buses.time_stamps),
    Check("traffic", buses.arrivals),
    Check("bus load", buses.load),
    Check("error frames", buses.error_frames),
    Check("DBC coverage", buses.dbc_coverage),
    Check("silent messages", buses.silent_messages),
    Check("signals", buses.role_values),
    Check("wheel load", buses.wheel_load),
    Check("GNSS fix", host.gnss_fix),
    Check("GNSS time", host.gnss_time),
    Check("host clock", host.host_time),
    Check("clock steps", host.clock_steps),
    Check("clock synchronised", host.clock_sync),
    Check("folder", host.folder),
    Check("other logger", host.other_logger),
    Check("disk space", host.space),
    Check("disk speed", host.disk_speed),
    Check("status page", host.page),
    Check("Python", host.python),
    Check("zero", files.zero),
    Check("service", host.service),
)
"""Every check, in the order of the lines."""


def examine(situation: Situation) -> Iterator[Line]:
    """Yield the lines of every check."""
    for check in CHECKS:
        yield from (replace(line, check=check.name) for line in check.run(situation))
