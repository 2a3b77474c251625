"""Processor time of functions that take turns, and the cost of whole commands."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

_LOOK_S = 0.05
"""Between two looks at the memory of the processes of a command."""


def cpu_seconds(function: Callable[[], object]) -> float:
    """Return the processor time of one call: of this process with all its threads, and of children that have ended."""
    start = _spent_s()
    function()
    return _spent_s() - start


def _spent_s() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


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
    """Processor time of a command and its children, wall time, and the largest memory of all that were alive at once.

    Memory is the proportional set size: a page that processes share counts once. Looked at every 50 ms, so that a
    shorter peak of several processes is missed; that of the largest one is exact, but Linux counts the memory of the
    process that starts it as the least: start it from a small one.
    """

    cpu_s: float
    wall_s: float
    peak_mb: float


def command_cost(
    command: Sequence[str], *, cores: set[int] | None = None, output: IO[bytes] | None = None
) -> CommandCost:
    """Run a command to its end, on these cores only where they are given; what it prints goes to `output`.

    Raises
    ------
    subprocess.CalledProcessError
        If the command fails.
    """
    pin = (lambda: os.sched_setaffinity(0, cores)) if cores else None
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=output or subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=pin)
    memory = _PeakMemory(process.pid)
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - start
    peak_mb = max(memory.ended(), usage.ru_maxrss / 1024)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return CommandCost(usage.ru_utime + usage.ru_stime, wall_s, peak_mb)


def spent_by(pid: int) -> float:
    """Return the processor time of a process that runs and of all that descend from it, ended or not."""
    ticks = 0
    for one in _with_descendants(pid):
        try:
            ticks += sum(
                int(field) for field in Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()[11:15]
            )
        except OSError:  # it has ended meanwhile, and its parent counts it
            continue
    return ticks / os.sysconf("SC_CLK_TCK")


class _PeakMemory:
    """Largest memory of a process and all that descend from it, at one time."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._most_mb = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def ended(self) -> float:
        """Stop looking, and return it in MB."""
        self._over.set()
        self._thread.join()
        return self._most_mb

    def _look(self) -> None:
        while not self._over.wait(_LOOK_S):
            alive = list(_with_descendants(self._pid))
            if len(alive) > 1:  # of one alone the system counts the peak
                self._most_mb = max(self._most_mb, sum(_resident_mb(pid) for pid in alive))


def _with_descendants(pid: int) -> Iterator[int]:
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended meanwhile
            continue
        children.setdefault(parent, []).append(int(folder.name))
    waiting = [pid]
    while waiting:
        yield (one := waiting.pop())
        waiting += children.get(one, [])


def _resident_mb(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:  # it has ended meanwhile
        return 0.0
    return sum(float(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


def wheelsoil_cost(*arguments: str, cores: set[int] | None = None, output: IO[bytes] | None = None) -> CommandCost:
    """Run a command of wheelsoil to its end, see `command_cost`."""
    command = [str(Path(sys.executable).with_name("wheelsoil")), *arguments]
    return command_cost(command, cores=cores, output=output)


@dataclass(frozen=True)
class DiagnoseCost:
    """Cost of ``wheelsoil diagnose``, its verdict, and whether this is the hidden cause."""

    cost: CommandCost
    verdict: str
    right: bool


def diagnose_cost(folder: Path, cause: str, cores: set[int] | None = None) -> DiagnoseCost:
    """Run ``wheelsoil diagnose`` to its end; right is a verdict that names the cause, alone or as one of several."""
    with tempfile.TemporaryFile() as answer:
        cost = wheelsoil_cost("diagnose", str(folder), "--json", cores=cores, output=answer)
        answer.seek(0)
        found = json.load(answer)
    named = [one["name"] for one in found["causes"]]
    right = found["verdict"] in ("named", "one_of") and cause in named
    return DiagnoseCost(cost, f"{found['verdict']} {', '.join(named)}".rstrip(), right)
