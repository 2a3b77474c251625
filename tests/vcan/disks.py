"""Disks of guests: ext4 in a file."""

from __future__ import annotations

import subprocess
from pathlib import Path

from vcan.guest import tool_or_skip


def disk(path: Path, megabytes: int = 256) -> Path:
    """Make an empty ext4 file system in a file."""
    command = [tool_or_skip("mke2fs"), "-q", "-t", "ext4", "-F", str(path), f"{megabytes}M"]
    subprocess.run(command, check=True, capture_output=True)
    return path


def repair(image: Path) -> None:
    """Do what a machine does when it starts after a power cut."""
    command = [tool_or_skip("e2fsck"), "-fy", str(image)]
    checked = subprocess.run(command, check=False, capture_output=True, text=True)
    assert checked.returncode in (0, 1), checked.stdout  # 1: errors were corrected


def copy_out(image: Path, folder: str, target: Path) -> None:
    """Copy a folder of the file system into a folder of this machine."""
    target.mkdir()
    command = [tool_or_skip("debugfs"), "-R", f"rdump {folder} {target}", str(image)]
    subprocess.run(command, check=True, capture_output=True)
