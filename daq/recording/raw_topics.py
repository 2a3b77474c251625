"""Raw topics: frames as they came, many fixed-size records a message."""

from __future__ import annotations

import numpy as np

from daq.errors import DataError, Fault
from daq.frames import FrameArray, FrameBatch, joined
from daq.recording.format import CLASSIC_SCHEMA, FD_SCHEMA, raw_message_head, raw_schema_text
from daq.recording.sink import McapSink, MessageGroup
from daq.recording.topics import TopicNames

FRAMES_PER_MESSAGE = 4096


class RawTopics:
    """The raw topics of a recording that is being written: one for each bus and kind of frame.

    Parameters
    ----------
    sink : McapSink
    names : TopicNames
    chunk_bytes : int
        Frames are written when so many bytes are gathered.
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
            counts[bus] += stream.written if self._sink.failed else stream.count
        return counts

    @property
    def steps_back(self) -> int:
        """How often a frame was earlier than the one before it in its topic."""
        return sum(stream.steps_back for stream in self._streams.values())

    def write(self, batch: FrameBatch) -> None:
        """Gather frames, and write a chunk when there are enough; see `RecordingWriter.write_frames`."""
        highest = int(batch.frames["bus"].max(initial=0))
        if highest >= len(batch.buses) and len(batch):
            raise DataError(Fault(f"a frame is of bus {highest}", found=f"{len(batch.buses)} buses in the batch"))
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
            stream = self._streams[bus, is_fd] = _Stream(channel_id, index)
        return stream

    def _gather(self, batch: FrameBatch) -> None:
        bus = batch.frames["bus"]
        for number in np.flatnonzero(np.bincount(bus)):
            rows = bus == number
            own = batch.frames.copy() if rows.all() else batch[rows].frames
            self._stream(batch.buses[number], batch.is_fd).take(own)
        self._pending_bytes += batch.frames.nbytes


class _Stream:
    """Frames gathered for one topic."""

    def __init__(self, channel_id: int, bus_index: int) -> None:
        self.channel_id = channel_id
        self.bus_index = bus_index
        self.pending: list[FrameArray] = []
        self.count = self.written = 0
        self.steps_back = 0
        self._sequence = 0
        self._last_ns: int | None = None

    def take(self, frames: FrameArray) -> None:
        """Gather frames; the array is ours from now on."""
        frames["bus"] = self.bus_index
        time_ns = frames["time_ns"]
        self.steps_back += int(np.count_nonzero(time_ns[1:] < time_ns[:-1]))
        if self._last_ns is not None and time_ns[0] < self._last_ns:
            self.steps_back += 1
        self._last_ns = int(time_ns[-1])
        self.pending.append(frames)
        self.count += len(frames)

    def release(self) -> MessageGroup:
        """Return the gathered frames as messages, and forget them."""
        frames = self.pending[0] if len(self.pending) == 1 else joined(self.pending)
        self.pending = []
        starts = range(0, len(frames), FRAMES_PER_MESSAGE)
        records: list[bytes | memoryview] = []
        offsets = np.zeros(len(starts), np.int64)
        log_time_ns = np.zeros(len(starts), np.int64)
        position = 0
        for i, start in enumerate(starts):
            piece = frames[start : start + FRAMES_PER_MESSAGE]
            offsets[i] = position
            log_time_ns[i] = piece["time_ns"].max()
            head = raw_message_head(
                self.channel_id, self._sequence, int(log_time_ns[i]), len(piece), piece.dtype.itemsize
            )
            records += [head, piece.view(np.uint8).data]
            position += len(head) + piece.nbytes
            self._sequence += 1
        return MessageGroup(self.channel_id, records, offsets, log_time_ns)
