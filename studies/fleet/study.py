"""A thousand campaigns end to end: throughput, memory, bytes, faults, questions, the page; two workers against one.

``python -m studies.fleet.study [campaigns]``. A hundred campaigns of two runs of 20 s are simulated, with nothing
hidden or one of six causes; the others are these under other names, linked. One in a hundred is broken.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wheelsoil.fleet import ask, holdings_of, open_store, overview_of

SIMULATED, RUNS, DURATION_S = 100, 2, 20
CAUSES = (
    "",
    "",
    "lyasko:m1=0.2,m2=0.05",
    "drawbar_pull_zero:offset_n=150",
    "drawbar_pull_gain:relative=0.15",
    "torque_zero:offset_nm=60",
    "speed_latency:extra_delay_s=0.2",
    "wheel_radius:relative=0.03",
)
FOLDER = Path("out") / "fleet"
RESULTS = Path(__file__).with_name("results.json")
PAIRED, TIMES = 20, 3
"""Campaigns that one worker and two workers do in turn, and how often."""


def made(folder: Path, count: int) -> int:
    """Make the campaigns; return how many are broken."""
    originals = []
    for i in range(min(SIMULATED, count)):
        place = FOLDER / "simulated" / f"s{i:03d}"
        cause = CAUSES[i % len(CAUSES)]
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            options = ["--runs", str(RUNS), "--duration", str(DURATION_S), "--seed", str(i), "--draw-soil"]
            _wheelsoil("simulate", "-o", str(place), *options, *(["--effect", cause] if cause else []))
        originals.append(place)
    shutil.rmtree(folder, ignore_errors=True)
    broken = 0
    for i in range(count):
        place = folder / f"vehicle-{i % 10}" / f"day-{i:05d}"
        shutil.copytree(originals[i % len(originals)], place, copy_function=os.link)
        if i % 100 == 99:
            _broken(place, broken)
            broken += 1
    return broken


def _broken(place: Path, which: int) -> None:
    """Damage a campaign in one of four ways; its files are links."""
    name, content = (
        ("run-1.mcap", b"\x89MCAP0\r\n" + bytes(100)),
        ("terrain.toml", b"[soil\n"),
        ("runs.toml", b'[[run]]\nfile = "nowhere.mcap"\n'),
        ("vehicle.toml", b"[wheel]\nradius_m = -1\n"),
    )[which % 4]
    (place / name).unlink()
    (place / name).write_bytes(content)


def _wheelsoil(*args: str) -> subprocess.CompletedProcess[str]:
    start = [sys.executable, "-c", "from wheelsoil.cli.app import main; main()"]
    return subprocess.run([*start, *args], capture_output=True, text=True, check=False)


def timed(root: Path, store: Path, jobs: int) -> tuple[float, float]:
    """Return wall seconds and CPU seconds of a fleet into a new store."""
    shutil.rmtree(store, ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start_s = time.monotonic()
    _wheelsoil("fleet", "run", str(root), "--store", str(store), "--jobs", str(jobs))
    wall_s = time.monotonic() - start_s
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def paired() -> dict[str, Any]:
    """Return how much faster two workers are, in turns with one."""
    root = FOLDER / "paired"
    made(root, PAIRED)
    rows = [(timed(root, FOLDER / "store-1", 1), timed(root, FOLDER / "store-2", 2)) for _ in range(TIMES)]
    return {
        "campaigns": PAIRED,
        "wall_s_of_one": _middle([one[0] for one, _ in rows]),
        "wall_s_of_two": _middle([two[0] for _, two in rows]),
        "speed_up": _middle([one[0] / two[0] for one, two in rows]),
        "cpu_of_two_over_one": _middle([two[1] / one[1] for one, two in rows]),
    }


def _middle(values: Sequence[float]) -> float:
    return round(sorted(values)[len(values) // 2], 3)


def asked(store: Path) -> dict[str, float]:
    """Return the seconds of each question of docs/fleet.md, and of the page."""
    page = (Path(__file__).parents[2] / "docs" / "fleet.md").read_text(encoding="utf-8")
    opened, found = open_store(str(store)), {}
    for number, part in enumerate(page.split("```sql\n")[1:], 1):
        start_s = time.monotonic()
        ask(opened, part.partition("```")[0])
        found[f"question {number}"] = round(time.monotonic() - start_s, 3)
    return found


def main(count: int = 1000) -> None:
    """Measure and keep the results."""
    found: dict[str, Any] = {"two workers": paired()}
    root, store = FOLDER / "root", FOLDER / "store"
    broken = made(root, count)
    wall_s, cpu_s = timed(root, store, 2)
    manifests = holdings_of(open_store(str(store))).manifests.values()
    sizes = [path.stat().st_size for path in store.rglob("*.parquet")]
    start_s = time.monotonic()
    again = _wheelsoil("fleet", "run", str(root), "--store", str(store))
    found["fleet"] = {
        "campaigns": len(manifests),
        "broken": broken,
        "failed": sum(one.state == "failed" for one in manifests),
        "wall_s": round(wall_s),
        "cpu_s_a_campaign": round(cpu_s / count, 3),
        "peak_mb": round(max(one.peak_bytes for one in manifests) / 1e6),
        "kb_a_campaign": round(sum(sizes) / count / 1e3, 1),
        "files": len(sizes),
        "once_more_s": round(time.monotonic() - start_s, 2),
        "once_more": again.stderr.splitlines()[0],
    }
    found["questions_s"] = asked(store)
    start_s = time.monotonic()
    overview_of(open_store(str(store))).write(FOLDER / "fleet.html")
    found["page"] = {
        "made_s": round(time.monotonic() - start_s, 2),
        "mb": round((FOLDER / "fleet.html").stat().st_size / 1e6, 2),
    }
    RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
