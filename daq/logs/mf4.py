"""MF4 (ASAM MDF 4 bus logging) through asammdf, which is an extra."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch, FrameFlag, joined
from daq.child_process import answers
from daq.errors import not_installed
from daq.logs.report import LogReport

_UNFINISHED = b"UnFinMF"
_RECORDS = 262_144
_BUS_EVENT = 2
_CAN = 2
_KINDS = {"CAN_DataFrame": FrameFlag(0), "CAN_RemoteFrame": FrameFlag.REMOTE, "CAN_ErrorFrame": FrameFlag.ERROR}
_FLAG_CHANNELS = {
    "IDE": FrameFlag.EXTENDED,
    "EDL": FrameFlag.FD,
    "BRS": FrameFlag.BITRATE_SWITCH,
    "ESI": FrameFlag.ERROR_STATE,
    "Dir": FrameFlag.TRANSMITTED,
}


def read_mf4(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of all CAN groups of an MF4 file, merged by time; BusChannel 1 is can1.

    `ConfigError` without asammdf; `RecordingError` if that cannot read the file, crashes on it, or gives nothing for
    long.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise not_installed("MF4 files", "asammdf", report.path, "mf4")
    if file.read(len(_UNFINISHED)) == _UNFINISHED:
        report.faults.append(
            "the logger did not finish the file: it states no number of frames, and the last may be lost"
        )
    file.close()  # asammdf wants the path
    what, step = "asammdf cannot read this MF4 file", "export it as BLF or ASC with the program that recorded it"
    stated = 0
    for stated, others, buses, frames in answers(
        "daq.logs.mf4:frames_apart", Path(report.path), what=what, next_step=step
    ):
        if report.balance.came is None:
            report.balance.come("records", stated + sum(others.values()))
            for name, count in others.items():
                report.note_skipped(f"records of the channel group {name}", count)
        for bus in buses:
            report.bus(bus)
        report.note_frames(frames, lambda i: f"frame {report.frames + i + 1}")
        report.share = report.frames / max(stated, 1)
        if len(frames):
            yield FrameBatch(frames, tuple(report.buses))
    if (lost := stated - report.frames) > 0:
        report.damage = f"the file states {stated:,} frames; the other {lost:,} are lost"
        report.balance.lose("stated, and not in the file", lost)


def start_ns_of(mdf: Any) -> int:
    """Return UTC nanoseconds of the start of a file that asammdf has opened; a float has no more than 256 ns."""
    start = mdf.header.start_time
    return int(start.timestamp()) * 10**9 + int(start.microsecond) * 1000


def frames_apart(path: str) -> Iterator[tuple[int, dict[str, int], list[str], FrameArray]]:
    """Yield, for `answers`: frames and other records that the file states, the buses so far, a piece of the frames.

    The counts are the same each time; the first piece is empty.
    """
    import asammdf

    report = LogReport(path, "MF4")
    with asammdf.MDF(path) as mdf:
        start_ns = start_ns_of(mdf)
        kinds = {index: kind for index, group in enumerate(mdf.groups) if (kind := _kind(group))}
        stated = sum(mdf.groups[index].channel_group.cycles_nr for index in kinds)
        others: dict[str, int] = {}
        for index, group in enumerate(mdf.groups):
            if index not in kinds and group.channel_group.cycles_nr:
                name = str(group.channel_group.acq_name or index)
                others[name] = others.get(name, 0) + group.channel_group.cycles_nr
        yield stated, others, [], np.zeros(0, CLASSIC_DTYPE)
        for frames in merged([_frames(mdf, index, kind, start_ns, report) for index, kind in kinds.items()]):
            yield stated, others, list(report.buses), frames


def _kind(group: Any) -> str | None:
    """Return what frames a channel group holds, None when they are not CAN frames."""
    head = group.channel_group
    if not head.flags & _BUS_EVENT or head.acq_source is None or head.acq_source.bus_type != _CAN:
        return None
    return next((channel.name for channel in group.channels if channel.name in _KINDS), None)


def _frames(mdf: Any, index: int, kind: str, start_ns: int, report: LogReport) -> Iterator[FrameArray]:
    cycles = mdf.groups[index].channel_group.cycles_nr
    for offset in range(0, cycles, _RECORDS):
        signal = mdf.get(kind, index, record_offset=offset, record_count=_RECORDS, raw=False)
        if not len(signal.timestamps):
            return
        columns = {name.removeprefix(f"{kind}."): signal.samples[name] for name in signal.samples.dtype.names}
        yield _filled(columns, signal.timestamps, _KINDS[kind], start_ns, report)


def _filled(columns: dict[str, Any], seconds: Any, kind: FrameFlag, start_ns: int, report: LogReport) -> FrameArray:
    count = len(seconds)

    def integers(name: str) -> Any:
        column = columns.get(name)
        if column is None:
            return np.zeros(count, np.int64)
        return (column == b"Tx") if column.dtype.kind == "S" else column.astype(np.int64)

    frames = np.zeros(count, FD_DTYPE if integers("EDL").any() else CLASSIC_DTYPE)
    frames["time_ns"] = start_ns + np.rint(seconds * 1e9).astype(np.int64)
    frames["can_id"] = integers("ID") & 0x1FFF_FFFF
    frames["flags"] = kind
    for name, flag in _FLAG_CHANNELS.items():
        frames["flags"] |= np.where(integers(name), flag, 0).astype(np.uint8)
    limit = 64 if frames.dtype == FD_DTYPE else 8
    length = integers("DLC") if kind == FrameFlag.REMOTE else integers("DataLength")
    frames["length"] = np.clip(length, 0, limit)
    if "DataBytes" in columns:
        data = columns["DataBytes"][:, :limit]
        frames["data"][:, : data.shape[1]] = np.where(np.arange(data.shape[1]) < frames["length"][:, None], data, 0)
    channel = integers("BusChannel")
    for number in np.unique(channel).tolist():
        frames["bus"][channel == number] = report.bus(f"can{number}")
    return frames


def merged(streams: list[Iterator[FrameArray]]) -> Iterator[FrameArray]:
    """Merge streams by time, holding one piece of each; equal times keep the order of the streams."""
    heads: dict[int, FrameArray] = {}
    open_streams = dict(enumerate(streams))
    while True:
        for key in [key for key in open_streams if not len(heads.get(key, ()))]:
            piece = next(open_streams[key], None)
            if piece is None:
                del open_streams[key]
            else:
                heads[key] = piece
        waiting = [heads[key] for key in sorted(heads) if len(heads[key])]
        if not waiting:
            return
        last = max(head["time_ns"].max() for head in waiting)
        limit = min((heads[key]["time_ns"][-1] for key in open_streams), default=last)
        ready = []
        for key in sorted(heads):
            cut = int(np.searchsorted(heads[key]["time_ns"], limit, side="right"))
            ready.append(heads[key][:cut])
            heads[key] = heads[key][cut:]
        together = joined(ready)
        yield together.take(np.argsort(together["time_ns"], kind="stable"))
