"""How many frames came while the clock was set, and by how much their times can be wrong."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daq import UncertainTimestamps
from daq.can import CLASSIC_DTYPE, FrameBatch, FrameFlag, split
from wheelsoil.wording.notes import texts_of

_BUSES = ("can0", "can1")
MS = 1_000_000


def _batch(time_ms: list[float], unsure: list[bool], bus: list[int]) -> FrameBatch:
    frames = np.zeros(len(time_ms), CLASSIC_DTYPE)
    frames["time_ns"] = np.array(time_ms) * MS
    frames["flags"] = np.where(unsure, FrameFlag.UNCERTAIN_TIME | FrameFlag.EXTENDED, 0)
    frames["bus"] = bus
    return FrameBatch(frames, _BUSES)


def test_the_next_sure_frame_of_the_bus_bounds_the_error() -> None:
    times = UncertainTimestamps()
    assert (times.frames, times.within_s, times.notes()) == (0, 0.0, ())
    times.take(_batch([0, 1, 1, 1], [False, False, True, True], [0, 1, 0, 1]))
    assert np.isnan(times.within_s)
    assert texts_of(times.notes()) == ["2 frames came while the host's clock was set; their times may be wrong"]
    times.take(_batch([5, 8], [False, False], [0, 0]))
    assert np.isnan(times.within_s)  # nothing sure came from can1 yet
    times.take(_batch([13, 14, 14], [False, True, False], [1, 0, 0]))
    assert times.within_s == 0.012
    said = "3 frames came while the host's clock was set; their times may be wrong by up to 0.012 s"
    assert texts_of(times.notes()) == [said]


@given(st.lists(st.tuples(st.integers(0, 50), st.booleans(), st.integers(0, 1)), max_size=60), st.integers(1, 60))
def test_no_error_is_larger_whatever_the_batches(frames: list[tuple[int, bool, int]], size: int) -> None:
    came_ms = np.cumsum([gap for gap, _, _ in frames], dtype=np.int64)
    told_ms, last = [], [0, 0]
    for (gap, unsure, bus), true in zip(frames, came_ms.tolist(), strict=True):
        last[bus] = max(last[bus], true - 3 * gap) if unsure else true  # never late, and in order
        told_ms.append(last[bus])
    whole = _batch(told_ms, [unsure for _, unsure, _ in frames], [bus for _, _, bus in frames])
    times = UncertainTimestamps()
    for batch in split(whole, size):
        times.take(batch)
    assert times.frames == sum(unsure for _, unsure, _ in frames)
    ends_unsure = any([unsure for _, unsure, on in frames if on == bus][-1:] == [True] for bus in (0, 1))
    assert np.isnan(times.within_s) == ends_unsure
    if not ends_unsure:
        assert max(came_ms - told_ms, default=0) <= round(times.within_s * 1e3)
