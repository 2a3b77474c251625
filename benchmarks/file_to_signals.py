"""asammdf and wheelsoil from file to physical signals, in turns; runs in the environment of the peers.

``python -m benchmarks.file_to_signals REPEATS LOG.mcap LOG.mf4 MERGED.dbc DBC...`` writes the frames of the recording
as MF4 and prints the processor times of every way to read them, and of the process that reads MF4, as JSON.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from asammdf import MDF, Signal
from asammdf.blocks.v4_blocks import SourceInformation
from asammdf.blocks.v4_constants import BUS_TYPE_CAN, SOURCE_BUS

from benchmarks.can_log import BUS
from benchmarks.timing import side_by_side
from daq import Channel
from daq.can import Decoder, FrameArray, FrameBatch, concatenate, load_database
from daq.logs import read_log
from daq.recording import Recording

Decoded = dict[tuple[str, str], Channel]

_MF4_BUS = 1
_FRAME = np.dtype(
    [
        ("CAN_DataFrame.BusChannel", "<u1"),
        ("CAN_DataFrame.ID", "<u4"),
        ("CAN_DataFrame.IDE", "<u1"),
        ("CAN_DataFrame.DLC", "<u1"),
        ("CAN_DataFrame.DataLength", "<u1"),
        ("CAN_DataFrame.DataBytes", "(8,)u1"),
        ("CAN_DataFrame.Dir", "<u1"),
    ]
)


def main(repeats: int, mcap: Path, mf4: Path, merged: Path, several: list[Path]) -> dict[str, list[float]]:
    """Return the processor times of each way, once all of them have given the same signals."""
    frames = Recording.open(mcap).frames()
    short = mf4.with_name(f"short{mf4.suffix}")
    _write_mf4(frames.frames, mf4)
    _write_mf4(frames.frames[:2], short)
    known = [load_database(path) for path in several]
    decoder = Decoder({BUS: known, f"can{_MF4_BUS}": known})

    def ours(batch: FrameBatch) -> Decoded:
        return decoder.decode(batch)

    ways = {
        "ours from MCAP": lambda: ours(Recording.open(mcap).frames()),
        "ours from MF4": lambda: ours(concatenate(list(read_log(mf4)))),
        "asammdf, one DBC": lambda: _asammdf(mf4, [merged]),
        "asammdf, four DBCs": lambda: _asammdf(mf4, several),
    }
    expected = _sums(ours(frames))
    for name, way in ways.items():
        decoded = way()
        found = _sums(decoded) if isinstance(decoded, dict) else _sums_of(decoded)
        for signal, total in expected.items():
            np.testing.assert_allclose(found[signal], total, rtol=1e-9, atol=1e-6, err_msg=f"{name}: {signal}")
    return side_by_side({**ways, "start of the process": lambda: ours(concatenate(list(read_log(short))))}, repeats)


def _write_mf4(frames: FrameArray, path: Path) -> None:
    samples = np.zeros(len(frames), _FRAME)
    samples["CAN_DataFrame.BusChannel"] = _MF4_BUS
    samples["CAN_DataFrame.ID"] = frames["can_id"]
    samples["CAN_DataFrame.DLC"] = samples["CAN_DataFrame.DataLength"] = frames["length"]
    samples["CAN_DataFrame.DataBytes"] = frames["data"]
    seconds = (frames["time_ns"] - frames["time_ns"][0]) * 1e-9
    source = SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN)
    mdf = MDF(version="4.10")
    mdf.append(Signal(samples, seconds, name="CAN_DataFrame", source=source))
    mdf.save(path, compression=2, overwrite=True)


def _asammdf(path: Path, dbcs: list[Path]) -> list[Signal]:
    with MDF(path) as mdf, mdf.extract_bus_logging({"CAN": [(str(dbc), 0) for dbc in dbcs]}) as extracted:
        wanted = [
            (channel.name, g, c)
            for g, group in enumerate(extracted.groups)
            for c, channel in enumerate(group.channels)
            if c != extracted.masters_db.get(g)
        ]
        return extracted.select(wanted, ignore_value2text_conversions=True)


def _sums(decoded: Decoded) -> dict[str, float]:
    """Return the sum of each signal whose name only one message has."""
    names = [name.split(".")[1] for _, name in decoded]
    named = zip(names, decoded.values(), strict=True)
    return {name: float(np.nansum(channel.values)) for name, channel in named if names.count(name) == 1}


def _sums_of(signals: list[Signal]) -> dict[str, float]:
    return {signal.name: float(np.sum(signal.samples, dtype=np.float64)) for signal in signals}


if __name__ == "__main__":
    paths = [Path(argument) for argument in sys.argv[2:]]
    print(json.dumps(main(int(sys.argv[1]), paths[0], paths[1], paths[2], paths[3:])))
