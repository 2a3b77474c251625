"""Disks of guests: ext4 in a file."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

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
