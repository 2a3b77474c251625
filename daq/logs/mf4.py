"""MF4 (ASAM MDF 4 bus logging) through asammdf, which is an extra.

asammdf reads in a process of its own, ``python -m daq.logs.mf4 FILE``: a file on which it crashes, hangs or takes all
memory is an error here. The process answers with pieces: a line of JSON, then frames as bytes.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple

import numpy as np

from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch, FrameFlag, joined
from daq.errors import RecordingError, not_installed
from daq.limits import MF4_BYTES_PER_S, MF4_MEMORY_BYTES, MF4_PATIENCE_S
from daq.logs.report import LogReport

_RECORDS = 65_536
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


class _Piece(NamedTuple):
    """What the process answers: frames; why there are none; or, as the last, how many the file states."""

    frames: FrameArray | None = None
    buses: tuple[str, ...] = ()
    error: str = ""
    stated: int = 0


def read_mf4(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of all CAN groups of an MF4 file, merged by time; BusChannel 1 is can1.

    Raises
    ------
    ConfigError
        If asammdf is not installed.
    RecordingError
        If asammdf cannot read the file, crashes on it, or gives nothing for `MF4_PATIENCE_S`.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise not_installed("MF4 files", "asammdf", report.path, "mf4")
    file.close()  # asammdf wants the path
    for piece in _pieces(report.path):
        if piece.error:
            what, step = (
                "asammdf cannot read this MF4 file",
                "export it as BLF or ASC with the program that recorded it",
            )
            raise RecordingError.of(what, report.path, piece.error, next_step=step)
        if piece.frames is None:
            if piece.stated > report.frames:
                report.damage = (
                    f"the file states {piece.stated:,} frames; the other {piece.stated - report.frames:,} are lost"
                )
            return
        for bus in piece.buses:
            report.bus(bus)
        report.note_frames(piece.frames, lambda i: f"frame {report.frames + i + 1}")
        yield FrameBatch(piece.frames, tuple(report.buses))


def _pieces(path: str) -> Iterator[_Piece]:
    """Yield what the process answers."""
    patience_s = MF4_PATIENCE_S + Path(path).stat().st_size / MF4_BYTES_PER_S
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "daq.logs.mf4", path]
    with (
        tempfile.TemporaryFile() as complaints,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, env=os.environ | paths) as process,
    ):
        try:
            while True:
                yield _next_piece(process, complaints, patience_s)
        finally:
            process.kill()


def _next_piece(process: subprocess.Popen[bytes], complaints: IO[bytes], patience_s: float) -> _Piece:
    """Return the next piece; the process is killed if it takes longer than `patience_s`."""
    assert process.stdout is not None
    began_s = time.monotonic()
    watchdog = threading.Timer(patience_s, process.kill)
    watchdog.start()
    try:
        head = json.loads(process.stdout.readline() or "null")
        if head is not None and "frames" in head:
            dtype = FD_DTYPE if head["fd"] else CLASSIC_DTYPE
            frames = np.frombuffer(bytearray(process.stdout.read(head["frames"] * dtype.itemsize)), dtype)
            return _Piece(frames, tuple(head["buses"]))
    except ValueError:  # it was ended in the middle of a piece
        head = None
    finally:
        watchdog.cancel()
    if head is not None:
        return _Piece(error=head["error"]) if "error" in head else _Piece(stated=head["stated"])
    code = process.wait()
    if time.monotonic() - began_s >= patience_s:
        return _Piece(error=f"it gave nothing for {patience_s:.0f} s")
    return _Piece(error=f"its process ended with {_ending(code)}{_last_line(complaints)}")


def _ending(code: int) -> str:
    """Return the exit code of a process in words."""
    with contextlib.suppress(ValueError):
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


def _last_line(complaints: IO[bytes]) -> str:
    complaints.seek(max(complaints.seek(0, os.SEEK_END) - 1000, 0))
    lines = complaints.read().decode(errors="replace").split("\n")
    return next((f": {line.strip()}" for line in reversed(lines) if line.strip()), "")


def _answer(path: str) -> None:
    """Write the pieces of a file to stdout; what asammdf prints goes to stderr."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    report = LogReport(path, "MF4")
    answer: dict[str, object] = {"stated": 0}
    try:
        for stated, frames in _all_frames(path, report):
            head = {"frames": len(frames), "fd": frames.dtype == FD_DTYPE, "buses": report.buses}
            out.write(json.dumps(head).encode() + b"\n" + frames.tobytes())
            out.flush()
            answer = {"stated": stated}
    except MemoryError:
        answer = {"error": f"it takes more than {_memory_bytes(path) / 1e9:.1f} GB of memory"}
    except Exception as error:  # noqa: BLE001  asammdf raises what it likes; the other process says it
        answer = {"error": f"{type(error).__name__}: {str(error)[:500]}"}
    out.write(json.dumps(answer).encode() + b"\n")
    out.close()


def _memory_bytes(path: str) -> int:
    return MF4_MEMORY_BYTES + 2 * Path(path).stat().st_size


def _limit_memory(path: str) -> None:
    """Let this process have no more than its share of memory, where the system can do that."""
    try:
        import resource
    except ImportError:
        return
    most = _memory_bytes(path)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _all_frames(path: str, report: LogReport) -> Iterator[tuple[int, FrameArray]]:
    """Yield pieces of the frames, each with the number of all frames that the file states."""
    import asammdf

    with asammdf.MDF(path) as mdf:
        start_ns = int(mdf.header.start_time.timestamp()) * 10**9 + mdf.header.start_time.microsecond * 1000
        kinds = {index: kind for index, group in enumerate(mdf.groups) if (kind := _kind(group))}
        stated = sum(mdf.groups[index].channel_group.cycles_nr for index in kinds)
        for frames in merged([_frames(mdf, index, kind, start_ns, report) for index, kind in kinds.items()]):
            yield stated, frames


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


if __name__ == "__main__":
    _limit_memory(sys.argv[1])
    _answer(sys.argv[1])
