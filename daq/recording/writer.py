"""RecordingWriter: frames into a crash-safe MCAP file."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from daq.config import RunInfo
from daq.frames import FrameBatch
from daq.recording.chunks import Compression
from daq.recording.decoded_topics import DecodedTopics
from daq.recording.format import RUN_END, RUN_START, with_checksum
from daq.recording.host_topics import HostTopics
from daq.recording.raw_topics import RawTopics
from daq.recording.sink import McapSink
from daq.recording.topic_writer import Topics, TopicWriter
from daq.recording.topics import TopicNames


class RecordingWriter(TopicWriter):
    """Writes frames, and views of them, into one MCAP file.

    Frames are gathered and written as a chunk when there are enough or when `flush_every_s` has passed; what a kill
    can take is what was gathered since. Not for several threads at once.

    Parameters
    ----------
    path : str or Path
    run : RunInfo, optional
    attachments : mapping str -> bytes
        DBC files, ``vehicle.toml``, ``terrain.toml``.
    metadata : mapping str -> str
        Goes into the ``run_start`` record.
    compression : {"zstd", "lz4", "none"}
    chunk_bytes : int
        Uncompressed size at which a chunk is written whatever the clock says.
    flush_every_s, sync_every_s : float or None
        How often gathered frames are handed to the operating system, and how often it is made to put them, and
        decoded topics, on the disk; None: only when told.
    decoded_rate_hz : float or None
        Decoded topics are thinned to this rate; None: every sample.
    overwrite : bool
        Whether a file that is there may be replaced.
    clock : callable
        Monotonic time, s.

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
        self._beside = Topics(
            DecodedTopics(self._sink, names, decoded_rate_hz), HostTopics(self._sink), chunk_bytes, self.tick
        )
        self._closed = False
        self._settled = self._counts_hold = True
        self._flushed_at = self._synced_at = clock()
        started = {"created_ns": str(time.time_ns()), **(metadata or {})}
        if run is not None:
            started["run"] = run.model_dump_json()
        try:
            for name, data in (attachments or {}).items():
                self._sink.attach(name, data)
            self.add_metadata(RUN_START, started)
            if sync_every_s is not None:
                self._sink.sync()
        except BaseException:
            self._sink.give_up()
            raise

    @property
    def frame_counts(self) -> dict[str, int]:
        """Frames taken so far, per bus; after a failed write, those of them that are in the file."""
        return self._raw.frame_counts

    @property
    def counts_hold(self) -> bool:
        """Whether `frame_counts` can be believed: Ctrl-C may have come in the middle of a write."""
        return self._counts_hold

    @property
    def failed(self) -> bool:
        """Whether a write has failed; nothing is written any more then."""
        return self._sink.failed

    @property
    def bytes_written(self) -> int:
        """Size of the file so far."""
        return self._sink.position

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

    @property
    def topics(self) -> Topics:
        """Of the file that is written now."""
        return self._beside

    def attach(self, name: str, data: bytes) -> None:
        """Add an attachment."""
        self._sink.attach(name, data)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record, e.g. the final clock fit."""
        self._sink.add_metadata(name, with_checksum(name, values))

    def flush(self) -> None:
        """Hand everything gathered so far to the operating system; a kill cannot take it any more."""
        self._flush(decoded=True)

    def sync(self) -> None:
        """Flush, and have it put on the disk; a power cut cannot take it any more."""
        self._synced_at = self._clock()
        self.flush()
        self._sink.sync()

    @property
    def flush_due_s(self) -> float:
        """In how many seconds it is time to flush; negative when it is, infinite if that is only done when told."""
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
        if self._sync_is_due(now) and not self._sink.syncing:
            self._synced_at = now
            self.flush()
            self._sink.begin_sync()
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
            told = {"ended_ns": str(time.time_ns()), "exit_status": exit_status}
            if self._counts_hold:
                told |= {f"frames.{bus}": str(count) for bus, count in self.frame_counts.items()}
            told |= {f"drops.{bus}": str(count) for bus, count in (drops or {}).items()}
            told |= {"time_steps_back": str(self._raw.steps_back)}
            self.add_metadata(RUN_END, told | dict(ended or {}))
        finally:
            self._sink.finish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        elif self._sink.failed:
            self._closed = True
            self._sink.finish()
        else:
            self.close("interrupted" if issubclass(kind, KeyboardInterrupt) else f"error: {kind.__name__}")

    def _sync_is_due(self, now: float) -> bool:
        if self._sync_every_s is None:
            return False
        return now - self._synced_at >= self._sync_every_s - min(self._sink.sync_took_s, self._sync_every_s / 2)

    def _flush(self, *, decoded: bool) -> None:
        self._begin()
        self._flushed_at = self._clock()
        self._raw.write_chunk()
        if decoded:
            self._beside.decoded.write_chunk()
        self._beside.host.write_chunk()
        self._settled = True

    def _begin(self) -> None:
        """Note whether Ctrl-C left the write before this one half done: the counts are not told then."""
        self._counts_hold &= self._settled
        self._settled = False
