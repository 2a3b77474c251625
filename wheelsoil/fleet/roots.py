"""What a fleet works on: the campaign folders and single-wheel tables below some roots, with a name each."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path

from daq import ConfigError, Fault, VehicleConfig, WheelsoilError
from daq.runs import TERRAIN_FILE, VEHICLE_FILE, holds_runs, is_run_file, logs_in, may_be_series, misspelt_files
from daq.series import column_names

_REPORTS = (".html", ".pdf", ".json", ".md", ".png", ".svg")
"""Files of a campaign's folder that are made of its runs."""
_TABLE_COLUMNS = {"slip", "vertical_load_n", "drawbar_pull_n"}

_NAMED = 4
"""Files and folders that a fault names."""

Facts = dict[str, list[int]]
"""Size and time of change (ns) of files, by their path."""
Beside = tuple[tuple[str, int, int], ...]
"""Name, size and time of change (ns) of files in one folder."""


@dataclass(frozen=True)
class Source:
    """A campaign folder, or a single-wheel table.

    Attributes
    ----------
    name : str
        Path below its root, without a table's suffix: what the store calls it.
    path : str
        Absolute.
    """

    name: str
    path: str

    @property
    def folder(self) -> Path:
        """Where its files lie."""
        path = Path(self.path)
        return path.parent if self.is_table else path

    @property
    def is_table(self) -> bool:
        """Whether it is a single-wheel table."""
        return self.path.endswith(".csv")

    def facts(self) -> Facts:
        """Return the facts of a table and what describes it, or of all files of a campaign's folder but reports."""
        if self.is_table:
            beside = (self.folder / name for name in (VEHICLE_FILE, TERRAIN_FILE))
            return facts_of([Path(self.path), *(path for path in beside if path.is_file())])
        with os.scandir(self.path) as entries:
            return self.placed(_beside(filter(_is_file, entries)))

    def placed(self, files: Beside) -> Facts:
        """Return the facts of files in a campaign's folder by their path."""
        folder = self.path.rstrip(os.sep) + os.sep
        return {folder + name: [size, changed_ns] for name, size, changed_ns in files}


def _is_file(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_file()
    except OSError:  # a link to itself
        return False


def _beside(entries: Iterable[os.DirEntry[str]]) -> Beside:
    """Return the facts of a campaign's files but reports; OSError if there is one that cannot be seen."""
    seen = ((entry.name, entry.stat()) for entry in entries if _may_matter(entry.name))
    return tuple((name, stat.st_size, stat.st_mtime_ns) for name, stat in seen)


@lru_cache(4096)
def _may_matter(name: str) -> bool:
    return not name.startswith(".") and not name.lower().endswith(_REPORTS)


def facts_of(files: Iterable[Path]) -> Facts:
    """Return size and time of change of files; OSError if there is one that cannot be seen."""
    seen = ((str(file), file.stat()) for file in files)
    return {path: [stat.st_size, stat.st_mtime_ns] for path, stat in seen}


def find_sources(roots: Sequence[Path], not_read: list[str] | None = None) -> dict[Source, Beside | None]:
    """Return every campaign folder and single-wheel table in some folders, however deep, by name.

    A folder that holds recordings or logs is a campaign, and is not searched further. One with series beside
    vehicle.toml is a campaign where no folder below it has recordings or logs. A table is a CSV file with the columns
    slip, vertical_load_n and drawbar_pull_n in a folder with terrain.toml. Folders that begin with a dot are left out.

    Parameters
    ----------
    not_read : list of str, optional
        Takes a line for each file that is nearly called like one that a campaign is described by, for each folder
        with series that lacks vehicle.toml, and for each symbolic link to a folder outside the root.

    Returns
    -------
    mapping Source -> facts
        Of the files in a campaign's folder but reports; None of a table, or where one cannot be seen.

    Raises
    ------
    ConfigError
        There is none in a root, two have the same name, or a name is no UTF-8.
    """
    faults: list[Fault] = []
    found: dict[Source, Beside | None] = {}
    for root in map(Path, roots):
        unread: list[str] = []
        own = dict(_sources_in(str(root.absolute()), unread))
        if not own:
            step = "name a folder that has campaigns in it, however deep: recordings or logs with vehicle.toml"
            what = "there is no campaign" if root.is_dir() else "there is no such folder"
            faults.append(Fault(what, str(root), "; ".join(sorted(unread)[:_NAMED]), next_step=step))
        if not_read is not None:
            not_read += sorted(unread)
        found |= own
    ordered = sorted(found, key=lambda source: source.name)
    for name, same in groupby(ordered, key=lambda source: source.name):
        paths = sorted(source.path for source in same)
        if not name.isascii() and name.encode(errors="replace").decode() != name:
            step = "rename the folder: a store keeps names as UTF-8"
            faults.append(Fault("this name of a campaign is no UTF-8", repr(name), next_step=step))
        if len(paths) > 1:
            step = "rename one of them, or name the folder that both are in as the root"
            faults.append(Fault("two campaigns have the same name", name, ", ".join(paths), next_step=step))
    ConfigError.stop_if_any(faults)
    return {source: found[source] for source in ordered}


def _sources_in(root: str, not_read: list[str]) -> Iterator[tuple[Source, Beside | None]]:
    waiting = [root]
    undescribed: dict[str, str] = {}
    of_series: list[tuple[Source, Beside | None]] = []
    above: set[str] = set()  # folders that have one with recordings below them
    while waiting:
        folder = waiting.pop()
        try:
            with os.scandir(folder) as listed:
                entries = list(listed)
        except OSError:
            continue
        below = folder.removeprefix(root).strip(os.sep).replace(os.sep, "/")
        files = list(filter(_is_file, entries))
        source = Source(below or Path(root).name, folder)
        not_read += [f"{source.name}: {line}" for line in misspelt_files([entry.name for entry in files])]
        if any(is_run_file(entry.name) for entry in files):
            _add_above(above, root, folder)
            yield source, _seen(files)
            continue
        folders = [entry for entry in entries if not entry.name.startswith(".") and entry.is_dir()]
        waiting += [entry.path for entry in folders if not entry.is_symlink()]
        not_read += [
            f"{f'{below}/{entry.name}'.strip('/')}: not read, because it is a link to a folder; next: name the folder "
            "itself as a root, or move it here"
            for entry in folders
            if entry.is_symlink() and not Path(entry.path).resolve().is_relative_to(Path(root).resolve())
        ]
        if _holds_series(folder, files):
            of_series.append((source, _seen(files)))
            continue
        names = {entry.name for entry in files}
        for name in sorted(names if TERRAIN_FILE in names else ()):
            if name.endswith(".csv") and _is_table(Path(folder, name)):
                stem = name.removesuffix(".csv")
                yield Source(f"{below}/{stem}" if below else stem, str(Path(folder, name))), None
        # Parquet may be of a store below a root
        if VEHICLE_FILE not in names and any(may_be_series(n) and not n.endswith(".parquet") for n in names):
            undescribed[folder] = source.name
    # beside folders with recordings a table with times is no campaign
    yield from (found for found in of_series if found[0].path not in above)
    for folder, name in undescribed.items():
        if folder not in above and _has_series(folder):
            not_read.append(
                f"{name}: not read, because it has series and no {VEHICLE_FILE}; next: write one, or ignore it"
            )


def _add_above(above: set[str], root: str, folder: str) -> None:
    """Add the folders from a root down to the one that holds a folder."""
    while folder != root:
        folder = folder.rpartition(os.sep)[0] or os.sep
        if folder in above:
            return
        above.add(folder)


def _holds_series(folder: str, files: Iterable[os.DirEntry[str]]) -> bool:
    """Return whether a folder with vehicle.toml, and without recordings and logs, has runs of decoded series."""
    if not any(entry.name == VEHICLE_FILE for entry in files):
        return False
    try:
        return holds_runs(Path(folder))
    except OSError:
        return False


def _has_series(folder: str) -> bool:
    """Return whether a folder that nothing describes has tables with times."""
    try:
        return any(True for _ in logs_in(Path(folder), VehicleConfig()))
    except OSError:
        return False


def _seen(files: Iterable[os.DirEntry[str]]) -> Beside | None:
    try:
        return _beside(files)
    except OSError:
        return None


def _is_table(path: Path) -> bool:
    try:
        return set(column_names(path)) >= _TABLE_COLUMNS
    except WheelsoilError:
        return False
