"""A file that grows by whole records: a failed or interrupted write leaves no partial record."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable
from io import FileIO
from pathlib import Path

from daq.errors import Fault, HardwareError, RecordingError


class DiskFile:
    """A new file that is written from beginning to end, unbuffered.

    Parameters
    ----------
    overwrite : bool
        Whether a file that is there may be replaced.
    clock : callable
        Monotonic time, s.

    Attributes
    ----------
    position : int
        Bytes written.
    failed : bool
        Whether a write has failed; nothing is written any more then.
    sync_took_s : float
        How long the last fsync took.

    Raises
    ------
    RecordingError
        If the file is there already, or cannot be made.
    HardwareError
        From `write`, `sync` and `begin_sync`, if the disk fails or is full.
    """

    def __init__(self, path: Path, *, overwrite: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.position = 0
        self.failed = False
        self.sync_took_s = 0.0
        self._path = path
        self._clock = clock
        self._syncing: threading.Thread | None = None
        self._sync_error: OSError | None = None
        self._file = _create(path, overwrite)
        sync_folder(path)

    def write(self, *parts: bytes | memoryview) -> None:
        """Append all of `parts`, or nothing."""
        if self.failed:
            raise HardwareError(Fault("the recording was given up after a failed write", str(self._path)))
        self._raise_sync_error()
        end = self.position + sum(map(len, parts))
        try:
            for part in parts:
                rest = memoryview(part)
                while rest:
                    rest = rest[self._file.write(rest) :]
            self.position = end
        except OSError as error:
            raise self._given_up(error) from None
        finally:
            if self.position != end:  # Ctrl-C comes through here too
                self._cut_back()

    def sync(self) -> None:
        """Have the operating system put on the disk what was written (fsync), and wait for it."""
        self._join()
        self._fsync()
        self._raise_sync_error()

    @property
    def syncing(self) -> bool:
        """Whether what `begin_sync` began is under way."""
        return self._syncing is not None and self._syncing.is_alive()

    def begin_sync(self) -> None:
        """Begin what `sync` does, in a thread: a slow disk does not delay writes. The next call raises a failure."""
        self._join()
        self._raise_sync_error()
        self._syncing = threading.Thread(target=self._fsync, name="fsync", daemon=True)
        self._syncing.start()

    def close(self) -> None:
        """Close the file."""
        self._join()
        self._file.close()

    def _join(self) -> None:
        if self._syncing is not None:
            self._syncing.join()

    def _fsync(self) -> None:
        began_at = self._clock()
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._sync_error = error
        self.sync_took_s = self._clock() - began_at

    def _raise_sync_error(self) -> None:
        if self._sync_error is not None:
            raise self._given_up(self._sync_error) from None

    def _given_up(self, error: OSError) -> HardwareError:
        self.failed = True
        return HardwareError(
            Fault(
                "the recording cannot be written on",
                str(self._path),
                error.strerror or str(error),
                next_step="free the disk; what was written before stays readable",
            )
        )

    def _cut_back(self) -> None:
        """Take off a half-written record, so that only whole ones stay."""
        with contextlib.suppress(OSError):
            self._file.truncate(self.position)
            self._file.seek(self.position)


def _create(path: Path, overwrite: bool) -> FileIO:
    try:
        return FileIO(path, "w" if overwrite else "x")
    except FileExistsError:
        raise RecordingError(
            Fault("there is a file already", str(path), next_step="choose another name, or say that it may be replaced")
        ) from None
    except OSError as error:
        raise RecordingError(
            Fault("the recording cannot be made", str(path), error.strerror or str(error), next_step="check the folder")
        ) from None


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing, so that their names survive a power cut.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        sync_folder(path)


def sync_folder(path: Path) -> None:
    """Have the name of a new file or folder survive a power cut; where its folder cannot be synced nothing is done."""
    with contextlib.suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
