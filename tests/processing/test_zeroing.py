"""What the sensors read at standstill, and how well that is known."""

from __future__ import annotations

import numpy as np
import pytest

from processing import Segment
from processing.pipeline.assembly import standstills

RATE_HZ = 100.0
CUTOFF_HZ = RATE_HZ / 2.5
"""With this filter every sample counts as an independent one."""


def test_the_sigma_of_a_level_is_that_of_repeated_standstills() -> None:
    rng = np.random.default_rng(2)
    count, length = 600, 200
    segments = np.tile(np.repeat([Segment.STANDSTILL, Segment.DRIVE], [length, 1]), count).astype(np.uint8)
    time = np.arange(len(segments)) / RATE_HZ
    found = standstills(time, segments, {"drawbar_pull": 7.0 + rng.standard_normal(len(time))}, CUTOFF_HZ)
    levels = np.array([one.levels["drawbar_pull"] for one in found])
    stated = np.sqrt(np.mean([one.sigmas["drawbar_pull"] ** 2 for one in found]))
    assert len(found) == count
    assert np.mean(levels) == pytest.approx(7.0, abs=0.02)
    assert stated == pytest.approx(np.std(levels), rel=0.1)


def test_only_standstills_count_and_only_channels_with_values() -> None:
    kinds = [Segment.DRIVE] * 3 + [Segment.STANDSTILL] * 4 + [Segment.BRAKE] * 3
    pull = np.array([9.0, 9.0, 9.0, 1.0, 2.0, np.nan, 3.0, 9.0, 9.0, 9.0])
    (one,) = standstills(
        np.arange(10) / RATE_HZ,
        np.array(kinds, np.uint8),
        {"drawbar_pull": pull, "driving_torque": np.full(10, np.nan)},
        CUTOFF_HZ,
    )
    assert one.levels == {"drawbar_pull": 2.0}
    assert set(one.sigmas) == {"drawbar_pull"}
