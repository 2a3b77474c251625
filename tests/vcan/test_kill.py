"""kill -9 at random instants: little is lost, nothing is damaged, and the next start goes on with the run.

The guest has a disk of its own: a file of this machine that it syncs would stop all of it. What a kill takes is
counted in frames that the guest had handed to its kernel before, by the sender's own notes, and expressed in seconds
of a bus of 8 kHz. On a vehicle frames come from elsewhere; in a guest with one processor, of which a busy machine
gives it a part, the sender has what the logger leaves, and does not make up for what it was kept waiting. Where the
guest has its processor this changes nothing, and where it has not, both are slow.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest
from vcan import kills
from vcan.disks import disk
from vcan.guest import GuestResult
from vcan.session import REPOSITORY, in_folder, make_vehicle, received_numbers, sent_log

from daq.recording import Recording

pytestmark = pytest.mark.vcan

RATE_HZ = 8000
MOST_LOST_S, NEVER_MORE_S = 0.25, 0.5
LEAST_RATE_HZ = 1000
USUAL_SHARE = 0.8
CONFIDENCE = 0.95


def killing(folder: Path, waits_s: np.ndarray) -> str:
    """Return a script: one sender for all of it, and the loggers that are killed."""
    return f"""{in_folder(folder)}
mkdir -p mnt
mount -t ext4 /dev/ubda mnt
mkdir -p mnt/out
sending {RATE_HZ} 100000 sent.log vcan0
renice -n 19 -p $sender > /dev/null
PYTHONPATH={REPOSITORY} {sys.executable} {kills.__file__} mnt/out killed.txt {" ".join(f"{s:.3f}" for s in waits_s)}
kill $sender
cp -a mnt/out out
"""


def seconds_lost(folder: Path, count: int) -> np.ndarray:
    """Return the seconds of the bus that were sent before each kill and are not in the files."""
    files = sorted((folder / "out").glob("*.mcap"), key=lambda path: received_numbers(Recording.open(path))[0])
    assert len(files) == count + 1
    sent = sent_log(folder / "sent.log")
    assert sent["end"][-1] / ((sent["time_ns"][-1] - sent["time_ns"][0]) / 1e9) > LEAST_RATE_HZ
    killed_ns = np.loadtxt(folder / "killed.txt", np.int64, ndmin=1)
    before_kill, earlier = (
        sent["end"][np.searchsorted(sent["time_ns"], killed_ns - ago_ns, side="right") - 1].astype(np.int64)
        for ago_ns in (0, 500_000_000)
    )
    print(f"frames a second before each kill: {((before_kill - earlier) / 0.5).astype(int).tolist()}")
    numbers = [received_numbers(Recording.open(path)) for path in files]
    for number in numbers:
        assert (np.diff(number) == 1).all(), "frames are missing in the middle"
    for number, following in pairwise(numbers):
        assert following[0] > number[-1], "a frame stands in two files"
    for path in files[:-1]:
        *within_a_write, end = [loss.what for loss in Recording.open(path).loss]
        assert within_a_write in ([], ["a record is cut off"])
        assert end == "the end of the file is missing: no footer, no summary"
    assert not Recording.open(files[-1]).loss
    last = np.array([number[-1] for number in numbers[:-1]])
    return np.maximum(before_kill - last - 1, 0) / RATE_HZ


@pytest.mark.parametrize("count", [pytest.param(5, marks=pytest.mark.slow), pytest.param(50, marks=pytest.mark.study)])
def test_a_kill_takes_little(guest: Callable[..., GuestResult], tmp_path: Path, count: int) -> None:
    make_vehicle(tmp_path, "vcan0", logger="disk_reserve_mb = 1")
    waits_s = np.random.default_rng(count).uniform(0.0, 1.4, count)

    image = disk(tmp_path / "disk.img")
    result = guest(killing(tmp_path, waits_s), timeout_s=60 + 6 * count, disks=[image])

    assert result.exit_code == 0, result.output
    lost_s = seconds_lost(tmp_path, count)
    within = int(np.count_nonzero(lost_s <= MOST_LOST_S))
    least = binomtest(within, count, alternative="greater").proportion_ci(CONFIDENCE).low
    print(f"{count} kills: {np.median(lost_s):.3f} s lost in the middle, {lost_s.max():.3f} s at most;")
    print(f"{within} of them within {MOST_LOST_S} s: at least {least:.0%} are; {np.round(lost_s, 3).tolist()}")
    assert lost_s.max() <= NEVER_MORE_S
    assert within >= USUAL_SHARE * count
