"""Which files are the parts of a run: ``R.mcap``, ``R.part2.mcap``, ``R.part3.mcap``, ..."""

from __future__ import annotations

import re
from pathlib import Path

from daq.errors import Fault, RecordingError

ROTATED = "rotated"
"""Exit status of a part that another one follows."""

_PART_NAME = re.compile(r"(?P<first>.+)\.part(?P<number>[1-9]\d*)")


def part_path(first: Path, number: int) -> Path:
    """Return the file of a part: ``R.mcap``, ``R.part2.mcap``, ...; `first` is that of the first part."""
    return first if number == 1 else first.with_name(f"{first.stem}.part{number}{first.suffix}")


def part_number(path: Path) -> tuple[Path, int]:
    """Return the first part's file and the number of a part; ``(path, 1)`` where the name tells no part."""
    match = _PART_NAME.fullmatch(path.stem)
    if match is None or match["number"] == "1":
        return path, 1
    return path.with_name(match["first"] + path.suffix), int(match["number"])


def parts_on_disk(first: Path) -> dict[int, Path]:
    """Return the parts of a run that are there, by number, in order.

    Raises
    ------
    RecordingError
        If the folder cannot be read.
    """
    try:
        found = [path for path in first.parent.iterdir() if path.name.startswith(first.stem)]
    except FileNotFoundError:
        return {}
    except OSError as error:
        what = error.strerror or str(error)
        raise RecordingError(Fault("the folder cannot be read", str(first.parent), what)) from None
    numbered = {part_number(path)[1]: path for path in found if part_number(path)[0] == first}
    return dict(sorted(numbered.items()))


def next_part(first: Path) -> tuple[Path, int]:
    """Return the file and the number of the part that comes after those that are there.

    Raises
    ------
    RecordingError
        If the folder cannot be read.
    """
    number = max(parts_on_disk(first), default=0) + 1
    return part_path(first, number), number
