"""A logging session on vcan0: the script that a guest runs, and what must come of it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from frames_support import content

from daq.frames import FrameBatch
from daq.recording import Recording

WHEELSOIL = Path(sys.executable).with_name("wheelsoil")
TERMINATED = 128 + 15


def logged(folder: Path, send: str) -> str:
    """Log vcan0 while `send` runs, and end the logger as a service manager would."""
    return f"""
set -e
cd {folder}
{WHEELSOIL} log vehicle.toml --out out --json > summary.json &
logger=$!
until ls out/*.mcap > /dev/null 2>&1; do sleep 0.1; kill -0 $logger; done
{send}
sleep 1
kill -TERM $logger
wait $logger || test $? = {TERMINATED}
"""


def check(folder: Path, sent: FrameBatch) -> Recording:
    """Compare what was recorded with what was sent; return the recording."""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["frames"] == {"vcan0": len(sent)}
    assert summary["drops"] == {"vcan0": 0}
    assert summary["ended_by"] == "signal"
    assert summary["remarks"] == []
    [path] = (folder / "out").glob("*.mcap")
    recording = Recording.open(path)
    received = recording.frames()
    assert [frame[1:] for frame in content(received)] == [frame[1:] for frame in content(sent)]
    assert (np.diff(received.frames["time_ns"]) >= 0).all()
    assert recording.metadata["run_end"]["drops.vcan0"] == "0"
    return recording
