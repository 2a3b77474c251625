"""What a fleet works on: the campaign folders and single-wheel tables below some roots, with a name each."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from daq import ConfigError, Fault, WheelsoilError
from daq.runs import TERRAIN_FILE, VEHICLE_FILE, holds_runs
from daq.series import column_names

_REPORTS = (".html", ".pdf", ".json", ".md", ".png", ".svg")
"""Files of a campaign's folder that are made of its runs."""
_TABLE_COLUMNS = {"slip", "vertical_load_n", "drawbar_pull_n"}

Facts = dict[str, tuple[int, int]]
"""Size and time of change (ns) of files, by their path."""


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
        with os.scandir(self.folder) as entries:
            return facts_of(Path(entry.path) for entry in entries if entry.is_file() and _may_matter(entry.name))


def _may_matter(name: str) -> bool:
    return not name.startswith(".") and not name.lower().endswith(_REPORTS)


def facts_of(files: Iterable[Path]) -> Facts:
    """Return size and time of change of files; OSError if there is one that cannot be seen."""
    seen = ((str(file), file.stat()) for file in files)
    return {path: (stat.st_size, stat.st_mtime_ns) for path, stat in seen}


def find_sources(roots: Sequence[Path]) -> list[Source]:
    """Return every campaign folder and single-wheel table in some folders, however deep, by name.

    A folder that holds runs is a campaign, and is not searched further. A table is a CSV file with the columns slip,
    vertical_load_n and drawbar_pull_n in a folder with terrain.toml. Folders that begin with a dot are left out.

    Raises
    ------
    ConfigError
        There is none in a root, or two have the same name.
    """
    faults, found = [], []
    for root in map(Path, roots):
        own = list(_sources_in(root.absolute()))
        if not own:
            step = "name a folder that has campaigns in it, however deep: recordings or logs with vehicle.toml"
            what = "there is no campaign" if root.is_dir() else "there is no such folder"
            faults.append(Fault(what, str(root), next_step=step))
        found += own
    by_name: dict[str, set[str]] = {}
    for source in found:
        by_name.setdefault(source.name, set()).add(source.path)
    for name, paths in by_name.items():
        if len(paths) > 1:
            step = "rename one of them, or name the folder that both are in as the root"
            faults.append(Fault("two campaigns have the same name", name, ", ".join(sorted(paths)), next_step=step))
    if faults:
        raise ConfigError(*faults)
    return sorted(set(found), key=lambda source: source.name)


def _sources_in(root: Path) -> Iterator[Source]:
    for path, folders, files in os.walk(root):
        folder = Path(path)
        name = folder.relative_to(root).as_posix() if folder != root else root.name
        if holds_runs(folder):
            folders.clear()
            yield Source(name, path)
            continue
        folders[:] = sorted(each for each in folders if not each.startswith("."))
        if TERRAIN_FILE not in files:
            continue
        for file in sorted(each for each in files if each.endswith(".csv")):
            if _is_table(folder / file):
                stem = file.removesuffix(".csv")
                yield Source(stem if folder == root else f"{name}/{stem}", str(folder / file))


def _is_table(path: Path) -> bool:
    try:
        return set(column_names(path)) >= _TABLE_COLUMNS
    except WheelsoilError:
        return False
