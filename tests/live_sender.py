"""A vehicle on a UDP multicast bus: ``python live_sender.py CHANNEL``, told what to do by lines on stdin.

It drives the moving part of a sample run round and round, its fast messages thinned to 50 Hz, with rolling counters
and GNSS time that go on. ``well``: all frames; ``freeze``: the forces are frozen; ``drop``: every fifth frame of them
is lost.
"""

from __future__ import annotations

import sys
import threading
import time
from itertools import count
from pathlib import Path

import can
import numpy as np

from daq.recording import Recording

SAMPLE = Path(__file__).parents[1] / "recordings" / "clay" / "run-1.mcap"
COUNTER_BYTE = {0x100: 6, 0x101: 6, 0x102: 5, 0x303: 5, 0x1D0: 7}
"""The message and the byte whose lower half is its rolling counter."""
THINNED = {0x100: 20, 0x101: 20, 0x102: 20, 0x1D0: 2}
FORCES = 0x100
GNSS_TIME = 0x301
SPAN_S = 28.0


def main() -> None:
    """Send until stdin ends."""
    state = ["well"]
    threading.Thread(target=_listen, args=(state,), daemon=True).start()
    frames = _moving_part()
    numbers = dict.fromkeys(COUNTER_BYTE, 0)
    began_s = time.monotonic()
    with can.Bus(interface="udp_multicast", channel=sys.argv[1]) as bus:
        held = b""
        for turn in count():
            for at_s, can_id, data in frames:
                time.sleep(max(0.0, began_s + turn * SPAN_S + at_s - time.monotonic()))
                if state[0] == "over":
                    return
                body = bytearray(data)
                if can_id == FORCES:
                    held = held if state[0] == "freeze" else bytes(body)
                    body[:] = held
                if can_id == GNSS_TIME:
                    now = int.from_bytes(body[1:4]) + round(100 * turn * SPAN_S)
                    body[1:4] = now.to_bytes(3)
                place = COUNTER_BYTE.get(can_id)
                if place is not None:
                    numbers[can_id] += 1
                    body[place] = body[place] & 0xF0 | numbers[can_id] % 16
                    if can_id == FORCES and state[0] == "drop" and numbers[can_id] % 5 == 0:
                        continue
                bus.send(can.Message(arbitration_id=can_id, data=body, is_extended_id=False))


def _listen(state: list[str]) -> None:
    for line in sys.stdin:
        state[0] = line.strip()
    state[0] = "over"


def _moving_part() -> list[tuple[float, int, bytes]]:
    """Return (seconds, identifier, data) of the sample's frames, from its 6th second on."""
    batch = Recording.open(SAMPLE).frames().frames
    time_s = (batch["time_ns"] - batch["time_ns"][0]) * 1e-9
    kept = (time_s >= 6.0) & (time_s < 6.0 + SPAN_S)
    for can_id, every in THINNED.items():
        rows = np.flatnonzero(batch["can_id"] == can_id)
        kept[np.setdiff1d(rows, rows[::every])] = False
    return [
        (float(t) - 6.0, int(row["can_id"]), row["data"][: row["length"]].tobytes())
        for t, row in zip(time_s[kept], batch[kept], strict=True)
    ]


if __name__ == "__main__":
    main()
