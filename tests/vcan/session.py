"""A logging session: the vehicle, the script that a guest runs, and what must come of it."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
from cli_support import ok
from frames_support import content
from vcan import numbered

from daq.can import FrameBatch
from daq.recording import Recording

WHEELSOIL = Path(sys.executable).with_name("wheelsoil")
REPOSITORY = Path(__file__).parents[2]
TERMINATED = 128 + 15
PAGE = "http://127.0.0.1:8100"
ROLES = '[signals]\ndrawbar_pull = "Load_0.Wave"\nvertical_load = "Load_1.Wave"\n'
ADD_BUS = "add_bus() { ip link add dev $1 type vcan; ip link set $1 up; }"


def make_vehicle(folder: Path, *buses: str, logger: str = "", more: str = "") -> None:
    """Write a vehicle.toml whose buses carry numbered frames, and their DBC."""
    (folder / "numbered.dbc").write_text(numbered.DBC, encoding="utf-8")
    sections = "".join(f'[[bus]]\nchannel = "{bus}"\ndbc = ["numbered.dbc"]\nbitrate = 1000000\n' for bus in buses)
    text = f'[vehicle]\nname = "test rig"\n{sections}[logger]\n{logger}\n{more}'
    (folder / "vehicle.toml").write_text(text, encoding="utf-8")


def in_folder(folder: Path) -> str:
    """Return the first lines of a script: functions for what most of them do.

    ``begin [OPTION ...]`` starts a logger and waits for its file, ``end`` ends it as a service manager would,
    ``sending RATE SECONDS LOG BUS ...`` starts a sender of numbered frames and waits for its first.
    """
    return f"""
set -e
cd {shlex.quote(str(folder))}
WHEELSOIL={WHEELSOIL}
recorded() {{ ls "${{out:-out}}" 2> /dev/null | grep -c mcap || true; }}
begin() {{
  before=$(recorded)
  $WHEELSOIL log vehicle.toml --out "${{out:-out}}" --json "$@" > summary.json 2> said.txt &
  logger=$!
  until test $(recorded) -gt $before && grep -qs raw /proc/net/can/rcvlist_all; do sleep 0.05; kill -0 $logger; done
}}
end() {{ kill -TERM $logger; wait $logger || test $? = {TERMINATED}; }}
sending() {{
  PYTHONPATH={REPOSITORY} {sys.executable} {numbered.__file__} "$@" &
  sender=$!
  until test -s "$3"; do sleep 0.05; kill -0 $sender; done
}}
{ADD_BUS}
"""


def watch(file: str) -> str:
    """Return the command that keeps what the page sends to a browser, and waits for its first snapshot."""
    return f"curl --silent --no-buffer {PAGE}/events > {file} &\nuntil grep -qs snapshot {file}; do sleep 0.1; done"


def snapshots(file: Path) -> list[dict[str, Any]]:
    """Return the snapshots that `watch` kept."""
    lines = file.read_text().splitlines()
    messages = [
        json.loads(line.removeprefix("data:")) for line in lines if line.startswith("data:") and line.endswith("}")
    ]
    return [message["snapshot"] for message in messages if "snapshot" in message]


def logged(folder: Path, send: str) -> str:
    """Log while `send` runs."""
    return f"{in_folder(folder)}\nbegin\n{send}\nsleep 1\nend\n"


def check(folder: Path, sent: FrameBatch) -> Recording:
    """Compare what was recorded with what was sent, bus by bus in vehicle.toml's order; return the recording."""
    summary = json.loads((folder / "summary.json").read_text())
    sent = FrameBatch(sent.frames, tuple(summary["frames"]))
    assert summary["frames"] == {bus: int((sent.frames["bus"] == i).sum()) for i, bus in enumerate(sent.buses)}
    assert summary["drops"] == dict.fromkeys(sent.buses, 0)
    assert summary["ended_by"] == "signal"
    assert summary["remarks"] == []
    [path] = (folder / "out").glob("*.mcap")
    recording = Recording.open(path)
    assert not recording.loss
    for bus in sent.buses:
        received = recording.frames(bus)
        expected = sent[sent.frames["bus"] == sent.buses.index(bus)]
        assert [frame[1:] for frame in content(received)] == [frame[1:] for frame in content(expected)]
        assert (np.diff(received.frames["time_ns"]) >= 0).all()
        assert recording.metadata["run_end"][f"drops.{bus}"] == "0"
    return recording


def received_numbers(recording: Recording, bus: str = "vcan0", freeze_at: int = 2**32) -> np.ndarray:
    """Return the numbers of what was recorded, which must be what was sent, bit for bit and in order."""
    received = recording.frames(bus).frames
    number = numbered.numbers(received).astype(np.int64)
    expected = numbered.frames(0, int(number.max(initial=-1)) + 1, freeze_at)[number]
    for column in ("can_id", "length", "data"):
        assert np.array_equal(received[column], expected[column]), column
    assert (np.diff(number) > 0).all()
    assert (np.diff(received["time_ns"]) >= 0).all()
    return number


def sent_log(path: Path) -> np.ndarray:
    """Return what a sender noted: frames sent so far, and when by the guest's monotonic clock."""
    whole = path.stat().st_size // numbered.SENT_DTYPE.itemsize
    return np.fromfile(path, numbered.SENT_DTYPE, count=whole)


def info(path: Path) -> dict[str, Any]:
    """Return what `wheelsoil info` says of a recording."""
    [facts] = ok("info", path, "--json").json
    return cast(dict[str, Any], facts)
