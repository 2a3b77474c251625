"""A small fleet, commands on it as processes that can be killed, and what two stores have in common."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
from cli_support import ok

from wheelsoil.fleet import COLUMNS, open_store

PATIENCE_S = 120.0
WHEELSOIL = (sys.executable, "-c", "from wheelsoil.cli.app import main; main()")


def small_fleet(folder: Path, campaigns: int = 6) -> Path:
    """Simulate one-run campaigns of 20 s in two folders, and put a table and a broken campaign beside them."""
    for i in range(1, campaigns + 1):
        place = folder / ("spring" if i % 2 else "autumn")
        place.mkdir(parents=True, exist_ok=True)
        ok("simulate", "-o", place / f"day-{i}", "--runs", 1, "--duration", 20, "--seed", i)
    bench = folder / "bench"
    bench.mkdir()
    shutil.copy(folder / "spring" / "day-1" / "terrain.toml", bench)
    rows = [f"{s},200,{80 * (1 - 2.7 ** (-9 * s)) - 20},0.1,0.1" for s in (0.1, 0.2, 0.4)]
    (bench / "wheel.csv").write_text("\n".join(["slip,vertical_load_n,drawbar_pull_n,radius_m,width_m", *rows]))
    broken = shutil.copytree(folder / "spring" / "day-1", folder / "broken")
    (broken / "run-1.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(400))
    return folder


def rows_of(url: object) -> dict[str, pa.Table]:
    """Every table of a store."""
    store = open_store(str(url))
    return {name: store.table(name) for name in COLUMNS}


def contents(url: object) -> dict[str, str]:
    """What the store has of each campaign, by name."""
    return {name: one.content for name, one in open_store(str(url)).manifests().items()}


@contextmanager
def running(*args: object, env: Mapping[str, str] | None = None) -> Iterator[subprocess.Popen[str]]:
    """A program with its own group of processes, all of which are gone afterwards."""
    process = subprocess.Popen(
        [str(arg) for arg in args],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | (env or {}),
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with_group(process, signal.SIGKILL)
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def with_group(process: subprocess.Popen[str], number: signal.Signals) -> None:
    """Send a signal to a process and all that it has started."""
    try:
        os.killpg(process.pid, number)
    except ProcessLookupError:
        pass


def line_with(process: subprocess.Popen[str], words: str) -> str:
    """The next line of a process that has some words."""
    assert process.stdout is not None
    end = time.monotonic() + PATIENCE_S
    seen = []
    while line := process.stdout.readline():
        if words in line:
            return line
        seen.append(line)
        assert time.monotonic() < end
    raise AssertionError(f"{process.args} ended without {words!r}:\n{''.join(seen)}")
