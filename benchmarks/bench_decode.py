"""Decoding against a pass of C, and asammdf from file to signals."""

from __future__ import annotations

import shutil
import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.c_pass import compile_pass
from benchmarks.can_log import AUX_DBC, BUS, databases, merged_dbc, test_log
from benchmarks.peer_environment import PeersMissingError, run_beside_peers
from benchmarks.table import Row, at_least, compared, compared_with_start, rate_of
from benchmarks.timing import side_by_side
from daq.can import Database, Decoder, FrameBatch, shipped_dbc, split
from daq.recording import RecordingWriter

SECONDS = 310.0
FILE_SECONDS = 2200.0
"""So long that asammdf takes five seconds, beside which a second for its own start in our process is little."""
MOST = 1.25
"""Times what asammdf takes for the same MF4, beyond the start of our process."""
REPEATS, FILE_REPEATS = 7, 3
WRITE_FRAMES = 640
"""Frames a batch: what 0.2 s bring at 3.2 kframes/s."""


def rows() -> list[Row]:
    known = databases()
    batch = test_log(SECONDS, known)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [*_in_memory(batch, known, folder), *_from_file(test_log(FILE_SECONDS, known), folder)]


def _in_memory(batch: FrameBatch, known: list[Database], folder: Path) -> list[Row]:
    decoder = Decoder({BUS: known})
    functions: dict[str, Callable[[], object]] = {"ours": lambda: decoder.decode(batch)}
    if shutil.which("gcc"):
        c_pass = compile_pass(folder, known)
        for mine, theirs in zip(decoder.decode(batch).values(), c_pass(batch), strict=True):
            np.testing.assert_array_equal(mine.values, theirs)
        functions["C"] = lambda: c_pass(batch)
    found = side_by_side(functions, REPEATS)
    what = f"decode in memory, {len(batch) / 1e6:.1f} M frames, all signals"
    as_text = rate_of(len(batch))
    ours_s = statistics.median(found["ours"])
    table = [Row(what, as_text(ours_s))]
    if "C" in found:
        table.append(compared(what, found["ours"], "one pass of C", found["C"], as_text, at_least(0.5, "x")))
    return table


def _from_file(batch: FrameBatch, folder: Path) -> list[Row]:
    """Return the rows of whole files against asammdf, which opens one DBC quicker than several of the same content."""
    what = f"file to all signals, {len(batch) / 1e6:.1f} M frames"
    mcap, mf4, merged, aux = (folder / name for name in ("log.mcap", "log.mf4", "merged.dbc", "aux.dbc"))
    merged.write_text(merged_dbc(), encoding="utf-8")
    aux.write_text(AUX_DBC, encoding="utf-8")
    several = [*(shipped_dbc(f"{name}.dbc") for name in ("wft", "wheel_speed", "gnss")), aux]
    with RecordingWriter(mcap) as writer:
        for piece in split(batch, WRITE_FRAMES):
            writer.write_frames(piece)
    try:
        took = run_beside_peers("file_to_signals", str(FILE_REPEATS), *map(str, (mcap, mf4, merged, *several)))
    except PeersMissingError as error:
        return [Row(what, "-", str(error))]
    mcap_mb, mf4_mb = mcap.stat().st_size / 1e6, mf4.stat().st_size / 1e6

    def as_text(seconds: float) -> str:
        return f"{seconds:.2f} s"

    def row(how: str, ours: str, peer: str, at_least_x: float) -> Row:
        return compared(f"{what}, {how}", took[ours], "asammdf", took[peer], as_text, at_least(at_least_x, "x"))

    same = f"{what}, both from the same MF4, one DBC"
    start_s, peer_s = took["start of the process"], took["asammdf, one DBC"]
    different = f"ours from MCAP ({mcap_mb:.1f} MB), asammdf from MF4 ({mf4_mb:.1f} MB)"
    return [
        compared_with_start(same, took["ours from MF4"], start_s, "asammdf", peer_s, MOST, as_text),
        row(f"{different}, one DBC", "ours from MCAP", "asammdf, one DBC", 2.5),
        row(f"{different}, four DBCs", "ours from MCAP", "asammdf, four DBCs", 2.5),
    ]
