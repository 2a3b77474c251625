"""Every reader closes its balance: what comes in is samples or lost by name, and a cut file says that it is cut."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from frames_support import content, some_frames
from fuzz.mutators import mutated
from fuzz.readers import FORMATS, whole_file

from daq import Balance, WheelsoilError
from daq.balance import UNACCOUNTED
from daq.can import concatenate
from daq.logs import LogReport, read_log, shapes
from daq.logs.candump import candump_text
from daq.series import SeriesReport, read_series

IN_A_PROCESS = ("mat", "hdf5")
LOGS = ("candump", "asc", "trc", "blf", "frames in csv", "busmaster")
SERIES = ("series in csv", "parquet", "mat", "hdf5", "tdms", "rpc iii")
TEXTS = ("candump", "asc", "trc", "frames in csv", "busmaster", "series in csv")


def balance_of(name: str, path: Path) -> tuple[Balance, list[str]]:
    """Return the balance of a file read to its end, and what its report says."""
    if name in LOGS:
        reading = read_log(path)
        frames = sum(map(len, reading))
        report: LogReport | SeriesReport = reading.report
        assert report.balance.out == frames
    else:
        series = read_series(path)
        rows = sum(len(block) for blocks in series.blocks() for block in blocks)
        report = series.report
        assert report.balance.out == rows
    balance = report.balance
    assert balance.came is not None and balance.open == 0 and UNACCOUNTED not in balance.losses
    return balance, report.remarks()


@pytest.mark.parametrize("name", [*LOGS, *SERIES])
def test_a_whole_file_loses_nothing_and_a_damaged_one_nothing_without_a_name(name: str, tmp_path: Path) -> None:
    whole = whole_file(name, tmp_path)
    path = tmp_path / f"run{FORMATS[name].suffix}"
    path.write_bytes(whole)
    balance, _ = balance_of(name, path)
    assert balance.out > 0 and not balance.losses
    for seed in range(3 if name in IN_A_PROCESS else 60):
        path.write_bytes(mutated(whole, np.random.default_rng(seed)))
        try:
            balance, _ = balance_of(name, path)
        except WheelsoilError:
            continue
        if name in TEXTS:
            text = path.read_bytes()
            assert (balance.came or 0) >= text.count(b"\n")


def content_of(path: Path, batch_frames: int) -> tuple[object, list[str]]:
    """Return the frames of a log and what is said of it, its first bad line being where it is said to be."""
    reading = read_log(path, batch_frames=batch_frames)
    frames = content(concatenate(list(reading)))
    if reading.report.bad:
        place = re.match(r"line (\d+): (?:no time: )?([!-\[\]-~]*)", reading.report.first_bad)
        assert place is not None and place[2] in path.read_bytes().split(b"\n")[int(place[1]) - 1].decode("latin1")
    return frames, [remark.partition("; the first is ")[0] for remark in reading.report.remarks()]


@pytest.mark.parametrize("name", [name for name in TEXTS if name in LOGS])
def test_the_pieces_that_a_log_is_read_in_change_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However damaged it is: every frame and count, and the places of what is bad."""
    whole, path = whole_file(name, tmp_path), tmp_path / f"run{FORMATS[name].suffix}"
    for seed in range(12):
        path.write_bytes(whole if seed == 0 else mutated(whole, np.random.default_rng(seed)))
        try:
            at_once = content_of(path, 1000)
        except WheelsoilError:
            continue
        with monkeypatch.context() as patched:
            patched.setattr(shapes, "BLOCK_BYTES", 1000)
            assert content_of(path, 100) == at_once


def test_of_a_packed_log_the_bytes_behind_damage_are_counted(tmp_path: Path) -> None:
    path, text = tmp_path / "run.log.gz", candump_text(some_frames(np.random.default_rng(0), 5000))
    packed = bytearray(gzip.compress(text))
    packed[len(packed) // 2 : len(packed) // 2 + 40] = bytes(40)
    path.write_bytes(packed)
    reading = read_log(path)
    assert sum(map(len, reading)) > 10
    balance = reading.report.file_bytes
    assert balance.came == balance.lost("of the packed file behind the damage") > 0 == balance.open


@pytest.mark.parametrize("name", [*LOGS, *SERIES])
@pytest.mark.parametrize("packed", [False, True])
def test_a_cut_file_says_so_or_ends_between_two_lines(name: str, packed: bool, tmp_path: Path) -> None:
    whole = whole_file(name, tmp_path)
    if packed and name not in (*TEXTS, "blf"):
        return
    suffix = FORMATS[name].suffix + (".gz" if packed else "")
    path, data = tmp_path / f"run{suffix}", gzip.compress(whole) if packed else whole
    path.write_bytes(data)
    full, said = balance_of(name, path)
    assert not full.losses and "cut off" not in " ".join(said)
    for share in (0.5,) if name in IN_A_PROCESS else (0.99, 0.9, 0.7, 0.5):
        path.write_bytes(data[: int(share * len(data))])
        try:
            cut, now = balance_of(name, path)
        except WheelsoilError:
            continue
        if name in TEXTS and not packed:
            continue  # text has no end of its own
        assert cut.out == full.out or now != said


def test_a_balance_in_words() -> None:
    balance = Balance()
    balance.come("lines", 1204)
    balance.out += 1200
    balance.put_aside("headers", 1)
    balance.lose("unreadable", 2, "line 7")
    balance.close()
    assert balance.sentence("frames") == (f"1,204 lines = 1,200 frames + 1 headers + 2 unreadable + 1 {UNACCOUNTED}")
