"""One frame of each text format with its time and bus, to the nanosecond that the format can hold."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from daq.logs import read_log

SECOND = 10**9
ASC = "date Sat Sep 30 {} 2017\nbase hex  timestamps absolute\nno internal events\n   1.250000 1  123 Rx d 1 68\n"
TRC = (
    ";$FILEVERSION=2.1\n;$STARTTIME=44548.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
    "      1      1250.500 DT 1 0300 Rx -  1  00\n      2      1251.500 DT 2 0300 Rx -  1  00\n"
)
CSV = "timestamp,arbitration_id,extended,remote,error,dlc,data\n1700000000.250001,0x1,0,0,0,1,aA==\n"


def at(*when: int) -> int:
    return int(datetime(*when, tzinfo=UTC).timestamp()) * SECOND  # type: ignore[arg-type,misc]


AFTERNOON = at(2017, 9, 30, 15, 6, 13) + 191_000_000


@pytest.mark.parametrize(
    ("name", "text", "times_ns", "buses"),
    [
        ("a.log", "(1700000000.5) can3 123#00\n", [1700000000 * SECOND + 500_000_000], ["can3"]),
        ("b.log", "(1700000000.500001) can0 123#00\n", [1700000000 * SECOND + 500_001_000], ["can0"]),
        ("c.log", "(1700000000.500000007) can0 123#00\n", [1700000000 * SECOND + 500_000_007], ["can0"]),
        ("24h.asc", ASC.format("15:06:13.191"), [AFTERNOON + 1_250_000_000], ["can0"]),
        ("12h.asc", ASC.format("03:06:13.191 pm"), [AFTERNOON + 1_250_000_000], ["can0"]),
        ("noon.asc", ASC.format("12:00:00 pm"), [at(2017, 9, 30, 12) + 1_250_000_000], ["can0"]),
        ("midnight.asc", ASC.format("12:00:00 am"), [at(2017, 9, 30) + 1_250_000_000], ["can0"]),
        # days since 30 December 1899
        ("a.trc", TRC, [at(2021, 12, 18, 12) + ms * 1_000_000 + 500_000 for ms in (1250, 1251)], ["can0", "can1"]),
        ("a.csv", CSV, [1700000000 * SECOND + 250_001_000], ["can0"]),
    ],
)
def test_time_and_bus(tmp_path: Path, name: str, text: str, times_ns: list[int], buses: list[str]) -> None:
    (tmp_path / name).write_text(text)
    found = [
        (int(frame["time_ns"]), batch.buses[frame["bus"]])
        for batch in read_log(tmp_path / name)
        for frame in batch.frames
    ]
    assert found == list(zip(times_ns, buses, strict=True))
