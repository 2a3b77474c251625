"""A small fleet, commands on it as processes that can be killed, and what two stores have in common."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TypeVar

import pyarrow as pa
import pytest
from cli_support import invoke, ok

from wheelsoil.fleet import COLUMNS, Store, holdings_of, open_store

S, T = TypeVar("S"), TypeVar("T")
PATIENCE_S = 120.0
WHEELSOIL = (sys.executable, "-c", "from wheelsoil.cli.app import main; main()")


def small_fleet(folder: Path, campaigns: int = 6) -> Path:
    """Simulate one-run campaigns of 20 s in two folders, and put a table and a broken campaign beside them.

    Each folder has a transducer of its own; that of autumn reads a quarter too much drawbar pull.
    """
    for i in range(1, campaigns + 1):
        place = folder / ("spring" if i % 2 else "autumn")
        place.mkdir(parents=True, exist_ok=True)
        wrong = () if i % 2 else ("--effect", "drawbar_pull_gain:relative=0.25")
        ok("simulate", "-o", place / f"day-{i}", "--runs", 1, "--duration", 20, "--seed", i, *wrong)
        vehicle = place / f"day-{i}" / "vehicle.toml"
        told = vehicle.read_text().replace("[transducer]", f'[transducer]\nserial = "WFT-{1 + (i + 1) % 2}"')
        vehicle.write_text(told)
    bench = folder / "bench"
    bench.mkdir()
    shutil.copy(folder / "spring" / "day-1" / "terrain.toml", bench)
    rows = [f"{s},200,{80 * (1 - 2.7 ** (-9 * s)) - 20},0.1,0.1" for s in (0.1, 0.2, 0.4)]
    (bench / "wheel.csv").write_text("\n".join(["slip,vertical_load_n,drawbar_pull_n,radius_m,width_m", *rows]))
    broken = shutil.copytree(folder / "spring" / "day-1", folder / "broken")
    (broken / "run-1.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(400))
    return folder


@contextmanager
def in_one_process() -> Iterator[None]:
    """Have `fleet run` work in this process, where it does not matter that its workers are processes of their own."""

    def here(task: Callable[[S], T], items: Sequence[S], *_: int) -> Iterator[tuple[S, T]]:
        return ((item, task(item)) for item in items)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wheelsoil.fleet.running.in_processes", here)
        yield


class KilledError(BaseException):
    """As if the process had ended here."""


def killed_at(step: int, *call: object) -> None:
    """Run a command in this process, which ends where it writes the n-th file of a store."""
    write, steps = Store._write, count()

    def counted(store: Store, path: str, data: bytes, *, once: bool = False) -> None:
        if next(steps) == step:
            raise KilledError
        write(store, path, data, once=once)

    with in_one_process(), pytest.MonkeyPatch.context() as patch, pytest.raises(KilledError):
        patch.setattr(Store, "_write", counted)
        invoke(*call)


def rows_of(url: object, tables: Iterable[str] = tuple(COLUMNS)) -> dict[str, pa.Table]:
    """Return tables of a store, each of them read once."""
    holdings = holdings_of(open_store(str(url)))
    return {name: holdings.table(name) for name in tables}


def differing(url: object, expected: Mapping[str, pa.Table]) -> list[str]:
    """Return the tables of a store whose rows are others than expected, which should be none."""
    return [name for name, table in rows_of(url, expected).items() if not table.equals(expected[name])]


def contents(url: object) -> dict[str, str]:
    """What the store has of each campaign, by name."""
    return {name: one.content for name, one in holdings_of(open_store(str(url))).manifests.items()}


@dataclass
class Program:
    """A program that runs, and what it has printed so far."""

    process: subprocess.Popen[bytes]
    printed: IO[bytes]
    read: list[str] = field(default_factory=list)

    def line_with(self, words: str) -> None:
        """Wait until it prints a line with some words, after those that were waited for before."""
        end, rest = time.monotonic() + PATIENCE_S, b""
        while True:
            ended = self.process.poll() is not None
            rest += self.printed.read()
            while b"\n" in rest:
                line, _, rest = rest.partition(b"\n")
                self.read.append(line.decode())
                if words in self.read[-1]:
                    self.printed.seek(-len(rest), 1)
                    return
            assert not ended and time.monotonic() < end, f"no {words!r}:\n" + "\n".join(self.read)
            time.sleep(0.02)

    def kill(self) -> None:
        """End it and all that it has started, at once."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@contextmanager
def running(*args: object, env: Mapping[str, str] | None = None) -> Iterator[Program]:
    """A program, which is gone afterwards with all that it has started."""
    with TemporaryFile() as out:  # a pipe that nobody empties would stop it
        process = subprocess.Popen(
            [str(arg) for arg in args], stdout=out, stderr=out, env=os.environ | (env or {}), start_new_session=True
        )
        with Path(f"/proc/self/fd/{out.fileno()}").open("rb") as printed:  # with a place of its own in the file
            program = Program(process, printed)
            try:
                yield program
            finally:
                program.kill()
