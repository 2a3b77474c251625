"""Sends numbered frames at a steady rate and notes when: ``numbered.py RATE_HZ SECONDS LOG BUS ...``, in a guest.

With ``FREEZE_AT=NUMBER`` in the environment the waves are constant from that frame on.

A frame's data are its number (32 bits), a wave (16 bits) and a counter (16 bits), see `DBC`; the log is written
through to this machine's disk, so that it outlives the guest. A delay is not made up for: the rate is never higher.
On SIGTERM it notes the current batch before it ends.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from daq.can import CLASSIC_DTYPE, FrameArray
from daq.sources.socketcan import SocketCanSink

IDS = 8
FIRST_ID = 0x300
BATCH_S = 0.01
SENT_DTYPE = np.dtype([("end", "<i8"), ("time_ns", "<i8")])
"""After a batch: the number of frames sent so far, and CLOCK_MONOTONIC."""

DBC = 'VERSION ""\n\nBS_:\n\nBU_: Node Logger\n' + "".join(
    f"""
BO_ {FIRST_ID + i} Load_{i}: 8 Node
 SG_ Number : 0|32@1+ (1,0) [0|4294967295] "" Logger
 SG_ Wave : 32|16@1- (0.5,0) [-16384|16383.5] "N" Logger
 SG_ Counter : 48|16@1+ (1,0) [0|65535] "" Logger
"""
    for i in range(IDS)
)


def frames(first: int, count: int, freeze_at: int = 2**32) -> FrameArray:
    """Return the frames with the numbers from `first` on."""
    made = np.zeros(count, CLASSIC_DTYPE)
    number = np.arange(first, first + count)
    made["can_id"] = FIRST_ID + number % IDS
    made["length"] = 8
    made["data"][:, :4] = number.astype("<u4")[:, None].view(np.uint8)
    wave = (10_000 * np.sin(np.minimum(number, freeze_at) / 4000.0)).astype("<i2")
    made["data"][:, 4:6] = wave[:, None].view(np.uint8)
    made["data"][:, 6:] = (number // IDS).astype("<u2")[:, None].view(np.uint8)
    return made


def numbers(received: FrameArray) -> np.ndarray:
    """Return the numbers that frames carry."""
    return np.ascontiguousarray(received["data"][:, :4]).view("<u4")[:, 0]


def send(rate_hz: float, seconds: float, log: Path, buses: list[str]) -> None:
    """Send to every bus at `rate_hz`."""
    sinks = [SocketCanSink(bus) for bus in buses]
    size = max(1, round(rate_hz * BATCH_S))
    freeze_at = int(os.environ.get("FREEZE_AT", 2**32))
    first, due = 0, time.monotonic()
    end = due + seconds
    signals: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: signals.append(number))
    with log.open("wb", buffering=0) as file:
        while due < end and not signals:
            made = frames(first, size, freeze_at)
            for sink in sinks:
                sink.send(made, 5.0)
            first += size
            file.write(np.array((first, time.monotonic_ns()), SENT_DTYPE).tobytes())
            due = max(due + size / rate_hz, time.monotonic() - BATCH_S)
            time.sleep(max(due - time.monotonic(), 0.0))


if __name__ == "__main__":
    send(float(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:])
