"""A power cut: the guest's kernel is killed, its page cache is gone, and the disk keeps what was written through.

The sender has what the logger leaves, as in `test_kill`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from vcan.disks import copy_out, disk, repair
from vcan.guest import GuestResult, PowerCut
from vcan.session import in_folder, make_vehicle, received_numbers, sent_log

from daq.recording import Recording

pytestmark = pytest.mark.vcan

RATE_HZ = 8000
MOST_LOST_S = 1.2


def recording_until_the_cut(folder: Path) -> str:
    return f"""{in_folder(folder)}
mkdir -p mnt
mount -t ext4 /dev/ubda mnt
out=mnt/out
begin
sending {RATE_HZ} 100000 sent.log vcan0
renice -n 19 -p $sender > /dev/null
touch alive
wait $sender
"""


def seconds_lost(folder: Path) -> float:
    """Return how many seconds of an 8 kHz bus were sent before the power cut and are not on the disk."""
    [path] = (folder / "found" / "out").glob("*.mcap")
    recording = Recording.open(path)
    number = received_numbers(recording) if "vcan0" in recording.buses else np.zeros(0, np.int64)
    assert np.array_equal(number, np.arange(len(number)))
    return float(sent_log(folder / "sent.log")["end"][-1] - len(number)) / RATE_HZ


@pytest.mark.parametrize("count", [2, pytest.param(20, marks=pytest.mark.study)])
@pytest.mark.slow
def test_a_power_cut_takes_little(guest: Callable[..., GuestResult], tmp_path: Path, count: int) -> None:
    folders = [tmp_path / f"cut-{number}" for number in range(count)]
    for folder, after_s in zip(folders, np.random.default_rng(count).uniform(0.7, 3.5, count), strict=True):
        folder.mkdir()
        make_vehicle(folder, "vcan0", logger="disk_reserve_mb = 1")
        cut = PowerCut(folder / "alive", float(after_s))
        result = guest(recording_until_the_cut(folder), disks=[disk(folder / "disk.img")], power_cut=cut)
        assert cut.sign.exists(), result.output
        repair(folder / "disk.img")
        copy_out(folder / "disk.img", "/out", folder / "found")

    lost_s = np.array([seconds_lost(folder) for folder in folders])

    print(f"{count} power cuts: {np.median(lost_s):.3f} s lost in the middle, {lost_s.max():.3f} s at most")
    assert lost_s.max() <= MOST_LOST_S
