"""A disk that is slow to put data down, or fails to: what no disk here does when it is asked."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from frames_support import some_frames

from daq import HardwareError
from daq.recording import Recording, RecordingWriter
from daq.recording.sink import DiskFile


def test_a_slow_fsync_holds_up_no_flush(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with RecordingWriter(tmp_path / "run.mcap", flush_every_s=0.0, sync_every_s=1e-9) as writer:
        released, really = threading.Event(), os.fsync
        monkeypatch.setattr(os, "fsync", lambda descriptor: released.wait(30) and really(descriptor))
        for seed in range(5):
            writer.write_frames(some_frames(np.random.default_rng(seed), 100))
        assert len(Recording.open(writer.path).frames()) == 500
        released.set()


def test_what_fsync_says_is_reported_by_the_next_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    file = DiskFile(tmp_path / "run.mcap", overwrite=False)
    file.write(b"kept")
    monkeypatch.setattr(os, "fsync", fail)
    file.begin_sync()
    with pytest.raises(HardwareError, match="the recording cannot be written on"):
        file.begin_sync()
    with pytest.raises(HardwareError):
        file.write(b"lost")
    file.close()
    assert file.failed
    assert (tmp_path / "run.mcap").read_bytes() == b"kept"
