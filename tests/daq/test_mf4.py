"""A module in place of asammdf crashes, hangs or gives frames and channels. What the real one reads is in test_logs.py.

The gate does not install asammdf: its stand-in has the attributes that we use.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from frames_support import content

import daq.child_process
from daq import RecordingError, SeriesSection
from daq.can import FrameBatch, FrameFlag
from daq.can.frames import joined
from daq.logs import LogReport, read_log
from daq.logs.mf4 import _kind, frames_apart
from daq.series import SeriesReport
from daq.series.readers.mdf import read_mdf

CRASHES = {
    "os.kill(os.getpid(), signal.SIGSEGV)": "its process ended with signal SIGSEGV",
    "os._exit(3)": "its process ended with exit code 3",
    "print('at offset 12', file=sys.stderr); os.abort()": "signal SIGABRT: at offset 12",
    "time.sleep(1000)": "it gave nothing for 3 s",
    "while True: pass": "it gave nothing for 3 s",
    "[bytearray(1 << 30) for _ in range(64)]": "it takes more than 2.1 GB of memory",
    "raise ValueError('the block at 12 is none')": "ValueError: the block at 12 is none",
    "raise KeyError": "KeyError",
    "print('{}', flush=True); os._exit(0)": "its process ended with exit code 0: {}",
    "sys.exit('enough')": "its process ended with exit code 1: enough",
}


LIKE_ANOTHER = ("while True: pass", "raise KeyError", "print('{}', flush=True); os._exit(0)", "sys.exit('enough')")


@pytest.mark.parametrize(
    "crash", [pytest.param(crash, marks=[pytest.mark.slow] * (crash in LIKE_ANOTHER)) for crash in CRASHES]
)
def test_whatever_asammdf_does_is_an_error_with_the_file(
    crash: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = f"import os, signal, sys, time\nclass MDF:\n    def __init__(self, path):\n        {crash}\n"
    (tmp_path / "asammdf.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "asammdf", raising=False)
    monkeypatch.setattr(daq.child_process, "LIBRARY_PATIENCE_S", 3.0 if "gave nothing" in CRASHES[crash] else 60.0)
    path = tmp_path / "drive.mf4"
    path.write_bytes(b"MDF     4.11    CE      ".ljust(4096, b"\0"))
    with pytest.raises(RecordingError, match="asammdf cannot read this MF4 file") as caught:
        list(read_log(path))
    assert CRASHES[crash] in caught.value.faults[0].found
    assert caught.value.faults[0].where == str(path)


START_NS = 1_714_564_800_250_000_000


def mdf_of(groups: list[tuple[str, bool, dict[str, Any]]], missing: int = 0) -> Any:
    """Stand-in for the module: groups by name, whether they hold frames, with the signals of their channels.

    Each states so many records more than there are.
    """

    def channel(name: str) -> Any:
        return SimpleNamespace(name=name, unit="kN", channel_type=0, conversion=None)

    def group(name: str, frames: bool, signals: dict[str, Any]) -> Any:
        cycles = max(len(signal.timestamps) for signal in signals.values()) + missing
        source = SimpleNamespace(bus_type=2)
        head = SimpleNamespace(flags=2 * frames, acq_source=source, cycles_nr=cycles, acq_name=name)
        return SimpleNamespace(channel_group=head, channels=[channel(name) for name in signals])

    class MDF:
        def __init__(self, path: object) -> None:
            self.header = SimpleNamespace(start_time=datetime(2024, 5, 1, 12, 0, 0, 250_000, UTC))
            self.groups = [group(*one) for one in groups]

        def __enter__(self) -> MDF:
            return self

        def __exit__(self, *_: object) -> None: ...

        def get(self, name: str, index: int, *, record_offset: int, record_count: int, raw: bool) -> Any:
            signal = groups[index][2][name]
            rows = slice(record_offset, record_offset + record_count)
            found = SimpleNamespace(timestamps=signal.timestamps[rows], samples=signal.samples[rows])
            return SimpleNamespace(physical=lambda **_: found) if raw else found

    return SimpleNamespace(MDF=MDF)


def bus_signal(kind: str, seconds: list[float], **fields: Any) -> Any:
    columns = {f"{kind}.{name}": np.array(values) for name, values in fields.items()}
    samples = np.zeros(len(seconds), [(name, column.dtype, column.shape[1:]) for name, column in columns.items()])
    for name, column in columns.items():
        samples[name] = column
    return SimpleNamespace(timestamps=np.array(seconds), samples=samples)


def test_frames_of_two_groups_come_in_order_with_what_they_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    data = np.arange(16).reshape(2, 8).astype(np.uint8)
    sent = {"ID": [0x123, 0x18FEF100], "IDE": [0, 1], "Dir": [b"Rx", b"Tx"], "DataLength": [2, 8], "DataBytes": data}
    groups = [
        ("data", True, {"CAN_DataFrame": bus_signal("CAN_DataFrame", [0.5, 1.5], BusChannel=[1, 2], **sent)}),
        (
            "wide",
            True,
            {"CAN_DataFrame": bus_signal("CAN_DataFrame", [1.0], ID=[7], EDL=[1], BRS=[1], DataLength=[12])},
        ),
        ("remote", True, {"CAN_RemoteFrame": bus_signal("CAN_RemoteFrame", [2.0], ID=[9], DLC=[4], BusChannel=[1])}),
        ("wheel", False, {"FZ": bus_signal("FZ", [0.0, 1.0, 2.0], FZ=[1, 2, 3])}),
    ]
    monkeypatch.setitem(sys.modules, "asammdf", mdf_of(groups))
    (stated, others, _, first), *pieces = frames_apart("drive.mf4")
    assert (stated, others, len(first)) == (4, {"wheel": 3}, 0)
    frames = joined([piece for *_, piece in pieces])
    assert ((frames["time_ns"] - START_NS) / 1e9).tolist() == [0.5, 1.0, 1.5, 2.0]
    fd = FrameFlag.FD | FrameFlag.BITRATE_SWITCH
    assert [
        (bus, can_id, flags, length)
        for bus, can_id, flags, length, _ in content(FrameBatch(frames, tuple(pieces[-1][2])))
    ] == [
        ("can1", 0x123, 0, 2),
        ("can0", 7, fd, 12),
        ("can2", 0x18FEF100, FrameFlag.EXTENDED, 8),
        ("can1", 9, FrameFlag.REMOTE, 4),
    ]
    assert frames["flags"][2] & FrameFlag.TRANSMITTED and not frames["flags"][0] & FrameFlag.TRANSMITTED
    assert frames["data"][0][:3].tolist() == [0, 1, 0] and frames["data"][2][:8].tolist() == [*range(8, 16)]


def test_a_damaged_file_of_series_is_an_error_with_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(_: Path) -> None:
        raise ValueError("the block at 12 is none")

    monkeypatch.setitem(sys.modules, "asammdf", SimpleNamespace(MDF=damaged))
    with pytest.raises(RecordingError, match="asammdf cannot read this MF4 file") as caught:
        read_mdf(Path("run.mf4"), SeriesSection(), SeriesReport("run.mf4", "MF4"))
    assert (caught.value.faults[0].where, caught.value.faults[0].found) == ("run.mf4", "the block at 12 is none")


@pytest.mark.parametrize(
    ("flags", "bus", "is_of_frames"),
    [(2, 2, True), (6, 2, True), (0, 2, False), (1, 2, False), (2, 3, False), (2, 0, False)],
)
def test_frames_are_in_the_groups_of_a_can_bus(flags: int, bus: int, is_of_frames: bool) -> None:
    head = SimpleNamespace(flags=flags, acq_source=SimpleNamespace(bus_type=bus) if bus else None)
    group = SimpleNamespace(
        channel_group=head, channels=[SimpleNamespace(name=name) for name in ("t", "CAN_DataFrame")]
    )
    assert _kind(group) == ("CAN_DataFrame" if is_of_frames else None)


def test_channels_have_their_times(monkeypatch: pytest.MonkeyPatch) -> None:
    time_s = np.arange(4) / 50
    signal = SimpleNamespace(timestamps=time_s, samples=np.array([1.0, 2.0, 4.0, 8.0]))
    monkeypatch.setitem(sys.modules, "asammdf", mdf_of([("wheel", False, {"FZ": signal})]))
    series = read_mdf(Path("run.mf4"), SeriesSection(), SeriesReport("run.mf4", "MF4"))
    assert series.topics == {"wheel": {"FZ": "kN"}}
    ((block,),) = series.blocks()
    assert (block.time_ns - START_NS - np.arange(4) * 20_000_000 == 0).all()
    assert block.columns["FZ"].tolist() == [1.0, 2.0, 4.0, 8.0]


@pytest.mark.parametrize("missing", [0, 3])
@pytest.mark.parametrize("frames", [True, False])
def test_records_that_are_stated_and_not_there_are_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: int, frames: bool
) -> None:
    sent = bus_signal("CAN_DataFrame", [0.5, 1.0, 1.5], ID=[1, 2, 3], DataLength=[1, 2, 3], BusChannel=[1, 1, 1])
    signal = SimpleNamespace(timestamps=np.arange(3) / 50, samples=np.arange(3.0))
    groups = [("bus", True, {"CAN_DataFrame": sent})] if frames else [("wheel", False, {"FZ": signal})]
    monkeypatch.setitem(sys.modules, "asammdf", mdf_of(groups, missing))
    monkeypatch.setattr("importlib.util.find_spec", lambda _: object())
    monkeypatch.setattr("daq.logs.mf4.answers", lambda _, path, **__: frames_apart(str(path)))
    path = tmp_path / "drive.mf4"
    path.write_bytes(b"MDF     4.11    CE      ".ljust(4096, b"\0"))
    report: LogReport | SeriesReport = SeriesReport(str(path), "MF4")
    if frames:
        reading = read_log(path)
        assert [len(batch) for batch in reading] == [3]
        report = reading.report
        assert report.share == pytest.approx(3 / (3 + missing))
        assert ("the file states 6 frames; the other 3 are lost" in report.damage) == (missing > 0)
    else:
        list(read_mdf(path, SeriesSection(), report).blocks())
    assert (report.balance.came, report.balance.out) == (3 + missing, 3)
    assert {kind: loss.count for kind, loss in report.balance.losses.items()} == (
        {"stated, and not in the file": missing} if missing else {}
    )
