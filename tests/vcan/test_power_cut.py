"""A power cut: the guest's kernel is killed, its page cache is gone, and the disk keeps what was written through."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from vcan.guest import GuestResult, PowerCut
from vcan.session import in_folder, make_vehicle, received_numbers, sent_log

from daq.recording import Recording

pytestmark = pytest.mark.vcan

RATE_HZ = 8000
MOST_LOST_S = 1.2
_SBIN = "/usr/sbin:/sbin:/usr/bin:/bin"


def disk(path: Path, megabytes: int = 256) -> Path:
    """Make an empty ext4 file system in a file."""
    subprocess.run(
        [shutil.which("mke2fs", path=_SBIN) or "mke2fs", "-q", "-t", "ext4", "-F", str(path), f"{megabytes}M"],
        check=True,
        capture_output=True,
    )
    return path


def repair(image: Path) -> None:
    """Do what a machine does when it starts after a power cut."""
    checked = subprocess.run(
        [shutil.which("e2fsck", path=_SBIN) or "e2fsck", "-fy", str(image)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert checked.returncode in (0, 1), checked.stdout  # 1: errors were corrected


def recording_until_the_cut(folder: Path) -> str:
    return f"""{in_folder(folder)}
mkdir -p mnt
mount -t ext4 /dev/ubda mnt
out=mnt/out
begin
sending {RATE_HZ} 100000 sent.log vcan0
touch alive
wait $sender
"""


def mounted_again(folders: list[Path]) -> str:
    """Copy what a new guest finds on the disks to this machine."""
    lines = [
        f"mkdir -p {folder}/mnt; mount -t ext4 /dev/ubd{letter} {folder}/mnt && cp -r {folder}/mnt/out {folder}/found"
        for folder, letter in zip(folders, "abcdefghijklmnop", strict=False)
    ]
    return "\n".join(["set -e", *lines])


def seconds_lost(folder: Path) -> float:
    """Return how much of what was sent before the power cut is not on the disk."""
    [path] = (folder / "found").glob("*.mcap")
    number = received_numbers(Recording.open(path))
    sent = sent_log(folder / "sent.log")
    assert (np.diff(number) == 1).all()
    assert number[0] == 0
    first_lost = int(np.searchsorted(sent["end"], number[-1] + 1, side="right"))
    by_clock_s = (sent["time_ns"][-1] - sent["time_ns"][min(first_lost, len(sent) - 1)]) / 1e9
    by_count_s = (sent["end"][-1] - number[-1] - 1) / RATE_HZ
    return float(max(by_clock_s, by_count_s))


@pytest.mark.parametrize("count", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_a_power_cut_takes_little(guest: Callable[..., GuestResult], tmp_path: Path, count: int) -> None:
    folders = [tmp_path / f"cut-{number}" for number in range(count)]
    for folder, after_s in zip(folders, np.random.default_rng(count).uniform(0.7, 3.5, count), strict=True):
        folder.mkdir()
        make_vehicle(folder, "vcan0", logger="disk_reserve_mb = 1")
        cut = PowerCut(folder / "alive", float(after_s))
        result = guest(recording_until_the_cut(folder), disks=[disk(folder / "disk.img")], power_cut=cut)
        assert cut.sign.exists(), result.output
        repair(folder / "disk.img")
    for some in (folders[i : i + 10] for i in range(0, count, 10)):
        result = guest(mounted_again(some), disks=[folder / "disk.img" for folder in some])
        assert result.exit_code == 0, result.output

    lost_s = np.array([seconds_lost(folder) for folder in folders])

    print(f"{count} power cuts: {np.median(lost_s):.3f} s lost in the middle, {lost_s.max():.3f} s at most")
    assert lost_s.max() <= MOST_LOST_S
