"""Checks of the machine and of what is installed on it."""

from __future__ import annotations

import errno
import importlib.util
import platform
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from daq.doctor.line import Line, failed, passed, warned
from daq.doctor.situation import Situation

_SLOW_IMPORT_S = 5.0
_UNITS = (Path("/etc/systemd/system"), Path("/usr/lib/systemd/system"), Path("/lib/systemd/system"))
_UNIT = "wheelsoil-log.service"
_UNIT_KEYS = ("Type=notify", "WatchdogSec=", "Restart=")


def python(now: Situation) -> Iterator[Line]:
    """Tell whether the logger starts quickly."""
    del now
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import can"], check=False, capture_output=True)
    took_s = time.perf_counter() - began
    found = f"Python {platform.python_version()}, python-can imported in {took_s:.1f} s"
    if importlib.util.find_spec("asammdf") is not None:
        step = "keep asammdf out of the logger's environment: python-can imports it and starts seconds later"
        yield warned("", f"{found}, with asammdf beside it", step)
    elif took_s > _SLOW_IMPORT_S:
        yield warned("", found, "a restart of the logger loses that time; use a faster card, or fewer packages")
    else:
        yield passed("", found)


def page(now: Situation) -> Iterator[Line]:
    """Tell whether the status page's port is free."""
    where = f"127.0.0.1:{now.page_port}"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            made.bind(("127.0.0.1", now.page_port))
        except OSError as error:
            taken = error.errno == errno.EADDRINUSE
            found = "another program has the port" if taken else f"the port cannot be had: {error.strerror}"
            yield failed(
                where, found, f"end it (`ss -ltnp 'sport = :{now.page_port}'`), or log with another: --page-port"
            )
            return
    yield passed(where, "free")


def service(now: Situation) -> Iterator[Line]:
    """Tell whether the logger is a service that is started again when it dies."""
    del now
    yield judged_unit([folder / _UNIT for folder in _UNITS])


def judged_unit(places: list[Path]) -> Line:
    """Return the line for the first unit file of some places that is there."""
    unit = next((place for place in places if place.is_file()), None)
    if unit is None:
        step = f"for a test day install deploy/{_UNIT}: it starts with the machine and comes back after a fault"
        return warned("", f"{_UNIT} is not installed: a logger started by hand ends with its terminal", step)
    text = unit.read_text(encoding="utf-8", errors="replace")
    lacking = [key.rstrip("=") for key in _UNIT_KEYS if key not in text]
    if lacking:
        return warned(str(unit), f"it lacks {', '.join(lacking)}", f"take deploy/{_UNIT} again")
    return passed(str(unit), "installed, with a watchdog")
