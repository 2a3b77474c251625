"""Frames whose time is unsure: counted by `info`, remarked by `process`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cli_support import ok, small_campaign

from daq.can import FrameFlag, split
from daq.recording import Recording, RecordingWriter


def test_unsure_frames_are_counted_and_remarked(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path / "campaign", runs=1)
    path = campaign / "run-1.mcap"
    assert ok("info", path, "--json").json[0]["unsure_frames"] == 0
    assert "uncertain time stamps" not in ok("info", path).out
    recording = Recording.open(path)
    whole = recording.frames()
    set_at = int(whole.frames["time_ns"][0]) + 5_000_000_000
    rows = np.abs(whole.frames["time_ns"] - set_at) < 40_000_000
    whole.frames["flags"][rows] |= np.uint8(FrameFlag.UNCERTAIN_TIME)
    with RecordingWriter(path, run=recording.run, attachments=recording.attachments, overwrite=True) as writer:
        for batch in split(whole, 500):
            writer.write_frames(batch)
    (facts,) = ok("info", path, "--json").json
    assert facts["unsure_frames"] == np.count_nonzero(rows) > 0
    assert 0.07 < facts["unsure_within_s"] < 0.2
    assert f"{np.count_nonzero(rows):,} frames, wrong by up to 0." in ok("info", path).out
    (run,) = ok("process", path, "--json").json
    (note,) = [note for note in run["quality"]["notes"] if "clock was set" in note]
    assert note.startswith(f"{np.count_nonzero(rows):,} frames came while")
    assert f"by up to {facts['unsure_within_s']:.3g} s" in note
