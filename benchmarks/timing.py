"""Processor time of functions that take turns, and the cost of whole commands."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path


def cpu_seconds(function: Callable[[], object]) -> float:
    """Return the processor time that this process, with all its threads, takes for one call."""
    start = time.process_time()
    function()
    return time.process_time() - start


def side_by_side(functions: Mapping[str, Callable[[], object]], repeats: int = 5) -> dict[str, list[float]]:
    """Return the processor times of functions that take turns (A B A B), after one call of each that does not count."""
    for function in functions.values():
        function()
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            times[name].append(cpu_seconds(function))
    return times


def median_cpu_seconds(function: Callable[[], object], repeats: int = 5) -> float:
    """Return the median processor time of `repeats` calls after one call that does not count."""
    [times] = side_by_side({"": function}, repeats).values()
    return statistics.median(times)


@dataclass(frozen=True)
class CommandCost:
    """Processor time of a command and its children, wall time, and its largest resident memory.

    Linux counts the memory of the process that starts it as the least; start it from a small one.
    """

    cpu_s: float
    wall_s: float
    peak_mb: float


def command_cost(command: Sequence[str], *, cores: set[int] | None = None) -> CommandCost:
    """Run a command to its end, on these cores only where they are given.

    Raises
    ------
    subprocess.CalledProcessError
        If the command fails.
    """
    pin = (lambda: os.sched_setaffinity(0, cores)) if cores else None
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=pin)
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return CommandCost(usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss / 1024)


def wheelsoil_cost(*arguments: str, cores: set[int] | None = None) -> CommandCost:
    """Run a command of wheelsoil to its end, see `command_cost`."""
    return command_cost([str(Path(sys.executable).with_name("wheelsoil")), *arguments], cores=cores)
