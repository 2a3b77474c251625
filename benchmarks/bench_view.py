"""The analyst's page: a slider's curve, the list of a folder of 48 runs, and what the page's process holds of them."""

from __future__ import annotations

import json
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

from benchmarks.table import Row, at_most, judged
from model.effects import EFFECTS

RECORDINGS = Path(__file__).parents[1] / "recordings" / "clay"
COPIES = 8
"""Of six runs of 40 s."""
TURNS = 7


def rows() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder, _page(_campaign(Path(folder))) as (process, address):
        first_s, _ = _timed(address, "/api/list")
        began_s = time.monotonic()
        lists_s = []
        while _waiting(found := _timed(address, "/api/list")):
            lists_s.append(found[0])
            time.sleep(0.1)
        whole_s = time.monotonic() - began_s
        curves_ms = {key: _curve_ms(address, key) for key in EFFECTS}
        held = _resident_mb(process.pid)
    slowest = max(curves_ms, key=lambda key: curves_ms[key])
    worst_ms = curves_ms[slowest]
    runs = 6 * COPIES
    what = (
        f"analyst's page: a slider's curve of 120 slips, {len(EFFECTS)} effects, shortest of {TURNS} round trips, wall"
    )
    curve = f"median effect {statistics.median(curves_ms.values()):.1f} ms, slowest {worst_ms:.1f} ms ({slowest})"
    listing = f"first {1e3 * first_s:.0f} ms, then {1e3 * statistics.median(lists_s):.0f} ms"
    return [
        judged(what, curve, worst_ms, at_most(100, "ms (slowest)"), "seen as immediate: 100 ms (Nielsen 1993)"),
        Row(f"analyst's page: list of {runs} runs of 40 s while they are processed, wall", listing),
        Row(f"analyst's page: until {runs} runs of 40 s are processed, wall", f"{whole_s:.1f} s"),
        Row(f"analyst's page: resident memory of its process with {runs} runs of 40 s", f"{held:.0f} MB"),
    ]


def _campaign(folder: Path) -> Path:
    for name in ("vehicle.toml", "terrain.toml"):
        shutil.copy(RECORDINGS / name, folder)
    for dbc in RECORDINGS.glob("*.dbc"):
        shutil.copy(dbc, folder)
    for copy in range(COPIES):
        for run in RECORDINGS.glob("*.mcap"):
            shutil.copy(run, folder / f"{run.stem}-{copy}.mcap")
    return folder


@contextmanager
def _page(folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    code = "from wheelsoil.cli.app import main; main()"
    command = [sys.executable, "-c", code, "view", str(folder), "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            yield process, next(found[0] for line in process.stderr if (found := re.search(r"http://[^\s/]+", line)))
        finally:
            process.send_signal(signal.SIGINT)


def _timed(address: str, path: str, asked: dict[str, Any] | None = None) -> tuple[float, Any]:
    body = None if asked is None else json.dumps(asked).encode()
    began_s = time.perf_counter()
    with urlopen(Request(address + path, body, {"Content-Type": "application/json"})) as answer:
        said = answer.read()
    return time.perf_counter() - began_s, json.loads(said)


def _waiting(answer: tuple[float, Any]) -> bool:
    return any(run["state"] in ("waiting", "processing") for one in answer[1]["campaigns"] for run in one["runs"])


def _curve_ms(address: str, key: str) -> float:
    """Return the shortest of some round trips: a busy machine must not pass for a slow model."""
    effect = EFFECTS[key]
    values = {name: p.start for name, p in zip(effect.parameter_keys().values(), effect.parameters, strict=True)}
    asked = {"campaign": "c1", "effects": [key], "values": values}
    return 1e3 * min(_timed(address, "/api/curve", asked)[0] for _ in range(TURNS))


def _resident_mb(pid: int) -> float:
    [line] = [line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS")]
    return float(line.split()[1]) / 1e3
