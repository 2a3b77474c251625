"""RecordingWriter: frames into a crash-safe MCAP file.

Raw topics hold the frames as they came, many fixed-size records a message.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from daq import DataError, RunInfo
from daq.can.frames import FrameArray, FrameBatch, as_bytes, joined
from daq.recording.chunks import Compression
from daq.recording.decoded_topics import DecodedTopics
from daq.recording.events import HostTopics
from daq.recording.format import (
    CLASSIC_SCHEMA,
    FD_SCHEMA,
    RAW_DTYPES,
    RUN_END,
    RUN_START,
    TopicNames,
    raw_message_head,
    raw_schema_text,
    with_checksum,
)
from daq.recording.sink import INDEX_ENTRY, McapSink, MessageGroup

FRAMES_PER_MESSAGE = 4096


class RawTopics:
    """The raw topics of a recording that is being written: one for each bus and kind of frame.

    Frames are written when `chunk_bytes` are gathered.
    """

    def __init__(self, sink: McapSink, names: TopicNames, chunk_bytes: int) -> None:
        self._sink = sink
        self._names = names
        self._chunk_bytes = chunk_bytes
        self._buses: dict[str, int] = {}
        self._streams: dict[tuple[str, bool], _Stream] = {}
        self._pending_bytes = 0

    @property
    def frame_counts(self) -> dict[str, int]:
        """Frames taken so far, per bus; after a failed write, those of them that are in the file."""
        counts = dict.fromkeys(self._buses, 0)
        for (bus, _), stream in self._streams.items():
            counts[bus] += stream.written if self._sink.file.failed else stream.count
        return counts

    @property
    def steps_back(self) -> int:
        """How often a frame was earlier than the one before it in its topic."""
        return sum(stream.steps_back for stream in self._streams.values())

    def write(self, batch: FrameBatch) -> None:
        """Gather frames, and write a chunk when there are enough; see `RecordingWriter.write_frames`."""
        bus = batch.frames["bus"]
        highest = int(bus.max(initial=0))
        if highest >= len(batch.buses) and len(batch):
            raise DataError.of(f"a frame is of bus {highest}", found=f"{len(batch.buses)} buses in the batch")
        for name in batch.buses:
            self._stream(name, batch.is_fd)
        size = batch.frames.dtype.itemsize
        start = 0
        while start < len(batch):
            room = max(1, (self._chunk_bytes - self._pending_bytes) // size)
            self._gather(batch[start : start + room])
            start += room
            if self._pending_bytes >= self._chunk_bytes:
                self.write_chunk()

    def write_chunk(self) -> None:
        """Write what is gathered."""
        gathered = [stream for stream in self._streams.values() if stream.pending]
        self._sink.write_chunk([stream.release() for stream in gathered])
        self._pending_bytes = 0
        for stream in gathered:
            stream.written = stream.count

    def _stream(self, bus: str, is_fd: bool) -> _Stream:
        stream = self._streams.get((bus, is_fd))
        if stream is None:
            index = self._buses.setdefault(bus, len(self._buses))
            schema = FD_SCHEMA if is_fd else CLASSIC_SCHEMA
            schema_id = self._sink.add_schema(schema, raw_schema_text(schema))
            topic = self._names.raw_topic(bus, is_fd)
            channel_id = self._sink.add_channel(topic, schema_id, {"bus": bus, "bus_index": str(index)})
            stream = self._streams[bus, is_fd] = _Stream(channel_id, index, RAW_DTYPES[schema])
        return stream

    def _gather(self, batch: FrameBatch) -> None:
        bus = batch.frames["bus"]
        if len(batch.buses) == 1 or (bus == bus[0]).all():
            self._stream(batch.buses[bus[0]], batch.is_fd).take(batch.frames, int(bus[0]))
        else:
            for number in np.flatnonzero(np.bincount(bus)).tolist():
                self._stream(batch.buses[number], batch.is_fd).take(batch[bus == number].frames, number)
        self._pending_bytes += batch.frames.nbytes


class _Stream:
    """Frames gathered for one topic."""

    def __init__(self, channel_id: int, bus_index: int, dtype: np.dtype[np.void]) -> None:
        self.channel_id = channel_id
        self.bus_index = bus_index
        self.pending = 0
        self.count = self.written = 0
        self.steps_back = 0
        self._frames: FrameArray = np.empty(FRAMES_PER_MESSAGE, dtype)
        self._sequence = 0
        self._last_ns = np.int64(-(2**63))

    def take(self, frames: FrameArray, bus_index: int) -> None:
        """Gather copies of frames; `bus_index` is what their bus column holds."""
        end = self.pending + len(frames)
        if end > len(self._frames):
            self._frames = joined([self._frames, np.empty(end, frames.dtype)])
        own = self._frames[self.pending : end]
        as_bytes(own)[:] = as_bytes(frames)
        if bus_index != self.bus_index:
            own["bus"] = self.bus_index
        time_ns = own["time_ns"]
        self.steps_back += int(np.count_nonzero(time_ns[1:] < time_ns[:-1]) + (time_ns[0] < self._last_ns))
        self._last_ns = time_ns[-1]
        self.pending = end
        self.count += len(frames)

    def release(self) -> MessageGroup:
        """Return the gathered frames as messages, to be written before others are gathered, and forget them."""
        frames = self._frames[: self.pending]
        self.pending = 0
        records: list[bytes | memoryview] = []
        entries: list[tuple[int, int]] = []
        position = 0
        for start in range(0, len(frames), FRAMES_PER_MESSAGE):
            piece = frames[start : start + FRAMES_PER_MESSAGE]
            latest_ns = int(piece["time_ns"].max())
            head = raw_message_head(self.channel_id, self._sequence, latest_ns, len(piece), piece.dtype.itemsize)
            entries.append((max(latest_ns, 0), position))
            records += [head, piece.view(np.uint8).data]
            position += len(head) + piece.nbytes
            self._sequence += 1
        return MessageGroup(self.channel_id, records, np.array(entries, INDEX_ENTRY))


class RecordingWriter:
    """Writes frames, and views of them, into one MCAP file.

    Frames are gathered and written as a chunk when there are enough or when `flush_every_s` has passed; what a kill
    can take is what was gathered since. Not for several threads at once.

    Parameters
    ----------
    path : str or Path
    attachments : mapping str -> bytes
        DBC files, ``vehicle.toml``, ``terrain.toml``.
    metadata : mapping str -> str
        Goes into the ``run_start`` record.
    compression : {"zstd", "lz4", "none"}
    chunk_bytes : int
        Uncompressed size at which a chunk is written whatever the clock says.
    flush_every_s, sync_every_s : float or None
        How often gathered frames are handed to the operating system, and how often it is made to put them, and
        decoded topics, on the disk; None: only on request.
    decoded_rate_hz : float or None
        Decoded topics are thinned to this rate; None: every sample.
    overwrite : bool
        Whether a file that is there may be replaced.
    clock : callable
        Monotonic time, s.

    Attributes
    ----------
    decoded, host : DecodedTopics, HostTopics
        Write the topics beside the raw ones.
    counts_hold : bool
        Whether `frame_counts` are valid: Ctrl-C may have interrupted a write.

    Raises
    ------
    RecordingError
        If the file is there already or cannot be made.
    HardwareError
        From any method, if the disk fails or is full. What was written before stays readable.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        run: RunInfo | None = None,
        attachments: Mapping[str, bytes] | None = None,
        metadata: Mapping[str, str] | None = None,
        compression: Compression = "zstd",
        chunk_bytes: int = 1 << 20,
        flush_every_s: float | None = 0.2,
        sync_every_s: float | None = 1.0,
        decoded_rate_hz: float | None = 100.0,
        overwrite: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = Path(path)
        self._clock = clock
        self._flush_every_s = flush_every_s
        self._sync_every_s = sync_every_s
        self._sink = McapSink(self.path, compression=compression, overwrite=overwrite, clock=clock)
        names = TopicNames()
        self._raw = RawTopics(self._sink, names, chunk_bytes)
        self.decoded = DecodedTopics(self._sink, chunk_bytes, self.tick, names, decoded_rate_hz)
        self.host = HostTopics(self._sink, chunk_bytes, self.tick)
        self._closed = False
        self._settled = self.counts_hold = True
        self._flushed_at = self._synced_at = clock()
        started = {"created_ns": str(time.time_ns()), **(metadata or {})}
        if run is not None:
            started["run"] = run.model_dump_json()
        try:
            for name, data in (attachments or {}).items():
                self._sink.attach(name, data)
            self.add_metadata(RUN_START, started)
            if sync_every_s is not None:
                self._sink.file.sync()
        except BaseException:
            self._sink.give_up()
            raise

    @property
    def frame_counts(self) -> dict[str, int]:
        """Frames taken so far, per bus; after a failed write, those of them that are in the file."""
        return self._raw.frame_counts

    @property
    def failed(self) -> bool:
        """Whether a write has failed; nothing is written any more then."""
        return self._sink.file.failed

    @property
    def bytes_written(self) -> int:
        """Size of the file so far."""
        return self._sink.file.position

    def write_frames(self, batch: FrameBatch) -> None:
        """Take frames in the order they were received.

        Raises
        ------
        DataError
            If a frame's bus is not one of the batch's.
        """
        self._begin()
        self._raw.write(batch)
        self._settled = True
        self.tick()

    def attach(self, name: str, data: bytes) -> None:
        """Add an attachment."""
        self._sink.attach(name, data)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record, e.g. the final clock fit."""
        self._sink.add_metadata(name, with_checksum(name, values))

    def flush(self) -> None:
        """Hand everything gathered so far to the operating system, so that a kill cannot lose it."""
        self._flush(decoded=True)

    def sync(self) -> None:
        """Flush and fsync, so that a power cut cannot lose it."""
        self._synced_at = self._clock()
        self.flush()
        self._sink.file.sync()

    @property
    def flush_due_s(self) -> float:
        """In how many seconds it is time to flush; negative when it is, infinite if that is only done on request."""
        if self._flush_every_s is None:
            return math.inf
        return self._flushed_at + self._flush_every_s - self._clock()

    def tick(self) -> None:
        """Flush and sync if it is time to. Every write does this; call it when there is nothing to write.

        It is synced beside the writing, so that a slow disk holds up no flush, and begun so much earlier as the last
        time took, so that it does not stretch what a power cut can take. Decoded topics, which can be had again from
        the raw frames, are written when it is time to sync only: in small pieces they take much room.
        """
        now = self._clock()
        if self._sync_is_due(now) and not self._sink.file.syncing:
            self._synced_at = now
            self.flush()
            self._sink.file.begin_sync()
        elif self._flush_every_s is not None and now - self._flushed_at >= self._flush_every_s:
            self._flush(decoded=self._sync_every_s is None)

    def close(
        self,
        exit_status: str = "ok",
        drops: Mapping[str, int] | None = None,
        ended: Mapping[str, str] | None = None,
    ) -> None:
        """Write what is left, the ``run_end`` record and the summary; a second call does nothing.

        Parameters
        ----------
        exit_status : str
            ``"ok"``, ``"interrupted"`` or what went wrong.
        drops : mapping str -> int, optional
            Frames lost before they came here, per bus.
        ended : mapping str -> str, optional
            Goes into the ``run_end`` record.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self.flush()
            values = {"ended_ns": str(time.time_ns()), "exit_status": exit_status}
            if self.counts_hold:
                values |= {f"frames.{bus}": str(count) for bus, count in self.frame_counts.items()}
            values |= {f"drops.{bus}": str(count) for bus, count in (drops or {}).items()}
            self.add_metadata(RUN_END, {**values, "time_steps_back": str(self._raw.steps_back), **(ended or {})})
        finally:
            self._sink.finish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        elif self._sink.file.failed:
            self._closed = True
            self._sink.finish()
        else:
            self.close("interrupted" if issubclass(kind, KeyboardInterrupt) else f"error: {kind.__name__}")

    def _sync_is_due(self, now: float) -> bool:
        if self._sync_every_s is None:
            return False
        return now - self._synced_at >= self._sync_every_s - min(self._sink.file.sync_took_s, self._sync_every_s / 2)

    def _flush(self, *, decoded: bool) -> None:
        self._begin()
        self._flushed_at = self._clock()
        self._raw.write_chunk()
        if decoded:
            self.decoded.write_chunk()
        self.host.write_chunk()
        self._settled = True

    def _begin(self) -> None:
        """Note whether Ctrl-C interrupted the previous write: the counts are not recorded then."""
        self.counts_hold &= self._settled
        self._settled = False


@contextmanager
def whole_recording(
    path: Path,
    *,
    run: RunInfo,
    attachments: Mapping[str, bytes],
    metadata: Mapping[str, str],
    decoded_rate_hz: float | None = None,
    overwrite: bool = False,
) -> Iterator[RecordingWriter]:
    """Write a recording in one go, as fast as it can be; nothing is left behind when that fails.

    Parameters and errors are those of `RecordingWriter`.
    """
    writer = RecordingWriter(
        path,
        run=run,
        attachments=attachments,
        metadata=metadata,
        flush_every_s=None,
        sync_every_s=None,
        decoded_rate_hz=decoded_rate_hz,
        overwrite=overwrite,
    )
    try:
        with writer:
            yield writer
    except BaseException:
        path.unlink(missing_ok=True)
        raise
