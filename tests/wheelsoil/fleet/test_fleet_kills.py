"""Kills while campaigns finish, and two drivers: rows are those of an undisturbed run, and no file is left over.

Diagnoses are kept (`warm`), so that most of a call is the finishing of campaigns.
"""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from fleet_support import WHEELSOIL, Program, rows_of, running

from wheelsoil.fleet import holdings_of, open_store
from wheelsoil.fleet.engines import Lost, in_processes
from wheelsoil.fleet.manifests import sources_path

TARGETS = ("driver", "worker", "group")
CAMPAIGNS = 8


def _finished(url: Path) -> int:
    return len(list(url.glob("done/*.json")))


def _members(leader: int) -> list[int]:
    """Return the processes that a program has started, and itself."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if os.getpgid(int(entry.name)) == leader and (entry / "cmdline").read_bytes():
                found.append(int(entry.name))
    return found


def _workers(leader: int) -> list[int]:
    with_spawn = [(pid, Path(f"/proc/{pid}/cmdline")) for pid in _members(leader)]
    return [pid for pid, line in with_spawn if line.exists() and b"spawn_main" in line.read_bytes()]


def _kill(target: str, program: Program, random: np.random.Generator) -> str:
    """Kill it, or the driver where no worker is there; return what was killed."""
    leader = program.process.pid
    workers = _workers(leader)
    if target == "group":
        program.kill()
    elif target == "driver" or not workers:
        os.kill(leader, signal.SIGKILL)
        return "driver"
    else:
        with suppress(ProcessLookupError):
            os.kill(int(random.choice(workers)), signal.SIGKILL)
    return target


def _rows_are(url: Path, whole: Path, *, all_of_it: bool) -> None:
    """Compare every table row by row with that of an undisturbed run; of an unfinished store what it has."""
    expected, found = rows_of(whole), rows_of(url)
    names = set(holdings_of(open_store(str(url))).manifests)
    assert not holdings_of(open_store(str(url)), thorough=True).damaged
    assert len(names) == CAMPAIGNS or not all_of_it
    for table, rows in expected.items():
        own = [row for row in rows.to_pylist() if row["campaign"] in names]
        assert found[table].to_pylist() == own, table


def _nothing_else(url: Path) -> None:
    """Check that manifests name every file of a store."""
    holdings = holdings_of(open_store(str(url)))
    named = {"store.json"} | {part.name for part in holdings.parts}
    named |= {sources_path(part.name) for part in holdings.parts if part.is_pack}
    named |= {file.path for part in holdings.parts for file in part.files.values()}
    assert {str(path.relative_to(url)) for path in url.rglob("*") if path.is_file()} == named


def _disturbed(kills: int, fleet: Path, whole: Path, folder: Path) -> Counter[str]:
    """Kill so many calls, every second one when at least a third of the campaigns is finished; return what was hit."""
    hit: Counter[str] = Counter()
    for i in range(kills):
        random = np.random.default_rng(i)
        target, url = TARGETS[i % len(TARGETS)], folder / f"killed-{i}"
        call = (*WHEELSOIL, "fleet", "run", fleet, "--store", url, "--jobs", 2)
        after = int(random.integers(CAMPAIGNS // 3 + 1, CAMPAIGNS)) if i % 2 else int(random.integers(0, 3))
        with running(*call) as program:
            while _finished(url) < after and program.process.poll() is None:
                time.sleep(0.005)
            time.sleep(float(random.uniform(0.0, 0.4)))
            there = _finished(url)
            ended = program.process.poll() is not None
            target = _kill(target, program, random)
            if target == "worker":
                assert program.process.wait(120) == 1 or ended  # one campaign is broken
            else:
                deadline = time.monotonic() + 10.0
                while _members(program.process.pid) and time.monotonic() < deadline:
                    time.sleep(0.05)
                assert not _members(program.process.pid), "a worker outlives its driver"
            hit[f"{target}{' ended' if ended else ''}"] += 1
            hit["after a third"] += CAMPAIGNS / 3 <= there < CAMPAIGNS
        if (url / "store.json").exists():
            _rows_are(url, whole, all_of_it=target == "worker")
        with running(*call) as again:
            assert again.process.wait(240) == 1  # one campaign is broken
        _rows_are(url, whole, all_of_it=True)
        _nothing_else(url)
    return hit


@pytest.mark.slow
@pytest.mark.usefixtures("warm")
def test_three_kills_change_no_row(fleet: Path, store: Path, tmp_path: Path) -> None:
    _disturbed(3, fleet, store, tmp_path)


@pytest.mark.study
@pytest.mark.usefixtures("warm")
def test_forty_kills_change_no_row(fleet: Path, store: Path, tmp_path: Path) -> None:
    hit = _disturbed(40, fleet, store, tmp_path)
    print(dict(hit))
    assert hit["after a third"] >= 15 and not any("ended" in key for key in hit)


@pytest.mark.slow
@pytest.mark.usefixtures("warm")
def test_two_drivers_at_once_make_the_same_store(fleet: Path, store: Path, tmp_path: Path) -> None:
    call = (*WHEELSOIL, "fleet", "run", fleet, "--store", tmp_path / "s", "--jobs", 1)
    with running(*call) as one, running(*call) as other:
        assert [each.process.wait(240) for each in (one, other)] == [1, 1]  # one campaign is broken
    _rows_are(tmp_path / "s", store, all_of_it=True)
    _nothing_else(tmp_path / "s")


def _ends_five_times(path: Path) -> str:
    with path.open("a", encoding="utf-8") as file:
        file.write("tried\n")
    if path.read_text(encoding="utf-8").count("tried") <= 5:
        os._exit(1)
    return "done"


def test_an_item_that_ends_its_process_is_tried_three_times(tmp_path: Path) -> None:
    tried = tmp_path / "tried"
    [(_, result)] = in_processes(_ends_five_times, [tried], 1, 0)
    assert isinstance(result, Lost)
    assert tried.read_text(encoding="utf-8").count("tried") == 3
