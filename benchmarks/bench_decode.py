"""Decoding against a cantools loop, a pass of C, and asammdf from file to signals."""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.c_pass import compile_pass
from benchmarks.can_log import AUX_DBC, BUS, databases, test_log
from benchmarks.row import Row, median_seconds
from daq.channel import Channel
from daq.databases import Database, shipped_dbc
from daq.decode import Decoder
from daq.frames import FrameBatch, split
from daq.recording import Recording, RecordingWriter

SECONDS = 310.0
CANTOOLS_FRAMES = 20_000
REPEATS = 7
WRITE_FRAMES = 640
ASAMMDF = "asammdf==8.8.28"
PEER_VENV = Path(__file__).parent.parent / ".venv-bench"

Decoded = dict[tuple[str, str], Channel]


def rows() -> list[Row]:
    known = databases()
    batch = test_log(SECONDS, known)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [*_in_memory(batch, known, folder), _from_file(batch, known, folder)]


def _in_memory(batch: FrameBatch, known: list[Database], folder: Path) -> list[Row]:
    decoder = Decoder({BUS: known})
    ours_s = median_seconds(lambda: decoder.decode(batch), REPEATS) / len(batch)
    loop_s = median_seconds(lambda: _cantools_loop(batch[:CANTOOLS_FRAMES], known), 3) / CANTOOLS_FRAMES
    what = f"decode in memory, {len(batch) / 1e6:.1f} M frames, all signals"
    ours = _rate(ours_s)
    found = [
        Row(what, ours, "-", "-", ">= 10 Mframes/s", 1e-6 / ours_s >= 10),
        Row(what, ours, f"cantools loop: {_rate(loop_s)}", f"{loop_s / ours_s:.0f}x", ">= 40x", loop_s / ours_s >= 40),
    ]
    if shutil.which("gcc"):
        c_pass = compile_pass(folder, known)
        for mine, theirs in zip(decoder.decode(batch).values(), c_pass(batch), strict=True):
            np.testing.assert_array_equal(mine.values, theirs)
        c_s = median_seconds(lambda: c_pass(batch), REPEATS) / len(batch)
        found.append(Row(what, ours, f"one pass of C: {_rate(c_s)}", f"{c_s / ours_s:.2f}x", "-", None))
    return found


def _cantools_loop(batch: FrameBatch, known: list[Database]) -> list[Any]:
    import cantools.database

    reference = cantools.database.Database()
    for database in known:
        reference.add_dbc_string(database.content.decode())
    rows = zip(batch.frames["can_id"].tolist(), batch.frames["length"].tolist(), batch.frames["data"], strict=True)
    decode = reference.decode_message
    return [decode(can_id, data[:length].tobytes(), decode_choices=False) for can_id, length, data in rows]


def _from_file(batch: FrameBatch, known: list[Database], folder: Path) -> Row:
    what = f"file to signals, {len(batch) / 1e6:.1f} M frames"
    python = _peer_python()
    if python is None:
        return Row(what, "-", f"{ASAMMDF} cannot be installed here", "-", ">= 2.5x", None)
    np.save(folder / "frames.npy", batch.frames)
    (folder / "aux.dbc").write_text(AUX_DBC, encoding="utf-8")
    dbcs = [*(str(shipped_dbc(f"{name}.dbc")) for name in ("wft", "wheel_speed", "gnss")), str(folder / "aux.dbc")]
    mcap, mf4 = folder / "log.mcap", folder / "log.mf4"
    with RecordingWriter(mcap) as writer:
        for piece in split(batch, WRITE_FRAMES):
            writer.write_frames(piece)
    script = str(Path(__file__).with_name("peer_asammdf.py"))
    subprocess.run([python, script, "write", str(folder / "frames.npy"), str(mf4)], check=True)
    answer = subprocess.run([python, script, "read", str(mf4), "3", *dbcs], check=True, capture_output=True, text=True)
    peer = json.loads(answer.stdout)
    decoder = Decoder({BUS: known})
    _check_sums(decoder.decode(Recording.open(mcap).frames()), peer["sums"])
    ours_s = median_seconds(lambda: decoder.decode(Recording.open(mcap).frames()), REPEATS)
    peer_s = statistics.median(peer["seconds"])
    return Row(
        what,
        f"{ours_s:.2f} s from MCAP, {mcap.stat().st_size / 1e6:.1f} MB",
        f"asammdf: {peer_s:.2f} s from MF4, {mf4.stat().st_size / 1e6:.1f} MB",
        f"{peer_s / ours_s:.1f}x",
        ">= 2.5x",
        peer_s / ours_s >= 2.5,
    )


def _check_sums(decoded: Decoded, sums: dict[str, float]) -> None:
    """Both must have decoded the same; names that several messages have are left out."""
    names = [signal for _, name in decoded for signal in [name.split(".")[1]]]
    for (_, name), channel in decoded.items():
        signal = name.split(".")[1]
        if names.count(signal) == 1:
            np.testing.assert_allclose(np.nansum(channel.values), sums[signal], rtol=1e-9, atol=1e-6)


def _peer_python() -> str | None:
    """Return the interpreter of asammdf's own environment, made on first use; None where that fails."""
    python = PEER_VENV / "bin" / "python"
    if not python.exists():
        venv.create(PEER_VENV, with_pip=True)
    if subprocess.run([python, "-c", "import asammdf"], capture_output=True, check=False).returncode:
        print(f"installing {ASAMMDF}", file=sys.stderr)
        if subprocess.run([python, "-m", "pip", "install", "--quiet", ASAMMDF], check=False).returncode:
            return None
    return str(python)


def _rate(seconds_per_frame: float) -> str:
    return f"{1e-6 / seconds_per_frame:.3g} Mframes/s"
