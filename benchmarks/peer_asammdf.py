"""asammdf's side of the comparison; runs in a virtual environment of its own, so it imports nothing of ours.

``python peer_asammdf.py write frames.npy bus.mf4`` and ``python peer_asammdf.py read bus.mf4 repeats dbc...``, which
prints the seconds of each reading, the number of samples and the sum of each signal as JSON.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from asammdf import MDF, Signal
from asammdf.blocks.v4_blocks import SourceInformation
from asammdf.blocks.v4_constants import BUS_TYPE_CAN, SOURCE_BUS

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


def write(frames_path: str, path: str) -> None:
    frames = np.load(frames_path)
    samples = np.zeros(len(frames), _FRAME)
    samples["CAN_DataFrame.BusChannel"] = 1
    samples["CAN_DataFrame.ID"] = frames["can_id"]
    samples["CAN_DataFrame.DLC"] = samples["CAN_DataFrame.DataLength"] = frames["length"]
    samples["CAN_DataFrame.DataBytes"] = frames["data"]
    seconds = (frames["time_ns"] - frames["time_ns"][0]) * 1e-9
    source = SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN)
    mdf = MDF(version="4.10")
    mdf.append(Signal(samples, seconds, name="CAN_DataFrame", source=source))
    mdf.save(path, compression=2, overwrite=True)


def read(path: str, repeats: int, dbcs: list[str]) -> None:
    times: list[float] = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        signals = _signals(path, dbcs)
        times.append(time.perf_counter() - start)
    samples = sum(len(signal) for signal in signals)
    sums = {signal.name: float(np.sum(signal.samples, dtype=np.float64)) for signal in signals}
    print(json.dumps({"seconds": times[1:], "samples": samples, "sums": sums}))


def _signals(path: str, dbcs: list[str]) -> list[Signal]:
    with MDF(path) as mdf, mdf.extract_bus_logging({"CAN": [(dbc, 0) for dbc in dbcs]}) as extracted:
        wanted = [
            (channel.name, g, c)
            for g, group in enumerate(extracted.groups)
            for c, channel in enumerate(group.channels)
            if c != extracted.masters_db.get(g)
        ]
        return extracted.select(wanted, ignore_value2text_conversions=True)


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(*sys.argv[2:])
    else:
        read(sys.argv[2], int(sys.argv[3]), sys.argv[4:])
