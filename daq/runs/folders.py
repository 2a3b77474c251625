"""Folders on disk: which files of one are runs, which of its folders hold some, and what may not be read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq.errors import Fault, RecordingError, WheelsoilError
from daq.logs.formats import LOG_SUFFIXES
from daq.runs.run import RUNS_FILE

RUN_SUFFIXES = (".mcap", *(suffix for suffix in LOG_SUFFIXES if suffix != ".csv"))
"""Files that a folder without runs.toml offers as runs (a CSV may be anything)."""


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Raise the system's errors on a path as `RecordingError`.

    Raises
    ------
    RecordingError
        The path cannot be read.
    """
    try:
        yield
    except WheelsoilError:
        raise
    except OSError as error:
        fault = Fault(
            "the path cannot be read",
            str(path),
            error.strerror or str(error),
            next_step="check the path and its permissions",
        )
        raise RecordingError(fault) from None


def logs_in(folder: Path) -> list[Path]:
    """Return the recordings and logs of a folder, by name.

    Raises
    ------
    OSError
        The folder cannot be read.
    """
    return sorted(path for path in folder.iterdir() if _log_suffix(path) in RUN_SUFFIXES and path.is_file())


def holds_runs(folder: Path) -> bool:
    """Return whether a folder names runs or has some; raises as `logs_in`."""
    return (folder / RUNS_FILE).is_file() or bool(logs_in(folder))


def folders_in(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return its folders that hold runs, and what of it may not be read, each by name; raises as `logs_in`."""
    holding: list[Path] = []
    closed: list[Path] = []
    for path in sorted(folder.iterdir()):
        try:
            if path.is_dir() and holds_runs(path):
                holding.append(path)
        except OSError:
            closed.append(path)
    return holding, closed


def _log_suffix(path: Path) -> str:
    name = path.name.lower().removesuffix(".gz")
    return Path(name).suffix
