"""Runs from recordings, logs of any format and campaign folders, with what is known of them.

What a file says of itself is beaten by the campaign folder it lies in, and that by what the caller gives.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Literal

from daq import ConfigError, DataError, Fault, RecordingError, VehicleConfig, WheelsoilError, load_toml
from daq.can.roles import plain_name
from daq.formatting import numbered
from daq.gunzip import unpacked
from daq.logs.formats import LOG_SUFFIXES, is_frame_log, no_such_file
from daq.recording import RunRecording
from daq.recording.part_writer import part_number, parts_on_disk
from daq.recording.recovery import RECOVERED
from daq.runs.run import (
    LENIENT_KEY,
    RUNS_FILE,
    TERRAIN_FILE,
    VEHICLE_FILE,
    Configuration,
    Run,
    log_run,
    recording_run,
    runs_from_file,
    series_run,
    terrain_from_file,
    vehicle_from_file,
)
from daq.series.formats import SERIES_SUFFIXES, read_series, series_format

RUN_SUFFIXES = (".mcap", *(suffix for suffix in LOG_SUFFIXES if suffix not in (".csv", ".txt")))
"""Files that a folder without runs.toml offers as runs (CSV and text may be anything); see `logs_in`."""
_MCAP_MAGIC = b"\x89MCAP"
_NAMED, _LISTED = 4, 8
"""Folders or files that a message names, and those of a folder without a run; more are counted."""
_DESCRIBING = (".toml", ".dbc", ".kcd", ".sym", ".arxml")
_TOML_FILES = (VEHICLE_FILE, TERRAIN_FILE, RUNS_FILE, "zero.toml", "choice.toml", "manifest.toml", "model.toml")
_HEAD_BYTES = 16 << 10
FOR_THE_ZERO = ("lifted", "spin", "zero")
"""In the names of recordings, or of their folder, that `wheelsoil zero` takes, which are no runs of a campaign."""
_MISSPELT = 0.75
"""Likeness of a file's name to a known one from which on it is one that is spelled wrong."""


@dataclass(frozen=True)
class SetAsideRun:
    """A run that was given and is not used.

    Attributes
    ----------
    run : str
        Its id.
    cause : str
        "unreadable", "impossible", "misdeclared", "repeated", "switched_off", "missing", "not_read", "silent" or
        "hardly_coasted".
        `misdeclared`: impossible, and a line of vehicle.toml mends it. `missing`: runs.toml names it, and there is no
        such file. `not_read`: a file of the folder that looks like a run. `silent`: it lacks a signal of this wheel.
        `hardly_coasted`: on firm ground, and of no use there.
    reason, next_step : str
        Why, and what to do.
    message : str
        Both for a terminal; empty where whoever is there knows it, or the message of another run names it.
    """

    run: str
    cause: Literal[
        "unreadable",
        "impossible",
        "misdeclared",
        "repeated",
        "switched_off",
        "missing",
        "not_read",
        "silent",
        "hardly_coasted",
    ]
    reason: str
    next_step: str
    message: str = ""

    @property
    def drive_again(self) -> bool:
        """Whether nothing but another drive gives its measurement."""
        return self.cause in ("unreadable", "impossible")

    def facts(self) -> dict[str, str]:
        """Return what JSON holds of it."""
        return {"run": self.run, "cause": self.cause, "reason": self.reason, "next_step": self.next_step}


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
        step = "check the path and its permissions"
        fault = Fault("the path cannot be read", str(path), error.strerror or str(error), next_step=step)
        raise RecordingError(fault) from None


def logs_in(folder: Path, vehicle: VehicleConfig | None = None) -> Iterator[Path]:
    """Yield the recordings and logs of a folder, by name; OSError if the folder cannot be read.

    Without any, a folder with vehicle.toml, or one with a given `vehicle`, offers its tables of frames and its files of
    decoded series, each of which is opened for that.
    """
    files = sorted(path for path in folder.iterdir() if path.is_file())
    found = False
    for path in files:
        suffix = _log_suffix(path.name)
        if suffix in RUN_SUFFIXES or (suffix == ".txt" and is_frame_log(path)):
            found = True
            yield path
    if not found and (vehicle is not None or (folder / VEHICLE_FILE).is_file()):
        yield from (path for path in _tables(files) if _is_table_of_a_run(path, vehicle))


def _tables(files: Iterable[Path]) -> list[Path]:
    """Return the files whose names end as those of decoded series do."""
    return [path for path in files if _log_suffix(path.name) in SERIES_SUFFIXES]


def _is_table_of_a_run(path: Path, vehicle: VehicleConfig | None) -> bool:
    """Return whether a file holds frames or series; a table without times is something else."""
    try:
        if series_format(path) is None:
            return is_frame_log(path)
        vehicle = vehicle or load_toml(path.parent / VEHICLE_FILE, VehicleConfig)
        return bool(read_series(path, vehicle.series).topics)
    except DataError:
        return False
    except WheelsoilError:  # opening it says what is wrong
        return True


def holds_runs(folder: Path) -> bool:
    """Return whether a folder names runs or has some; OSError if it cannot be read."""
    return (folder / RUNS_FILE).is_file() or any(True for _ in logs_in(folder))


@lru_cache(4096)
def is_run_file(name: str) -> bool:
    """Return whether a file of this name makes its folder one that names runs or has some."""
    return name == RUNS_FILE or _log_suffix(name) in RUN_SUFFIXES


@lru_cache(4096)
def may_be_series(name: str) -> bool:
    """Return whether a file of this name may hold decoded series; a text is none by its name."""
    suffix = _log_suffix(name)
    return suffix in SERIES_SUFFIXES and suffix != ".txt"


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


def _log_suffix(name: str) -> str:
    before, dot, last = name.lower().removesuffix(".gz").rpartition(".")
    return dot + last if before else ""


def open_runs(
    paths: Sequence[str | Path],
    *,
    vehicle: str | Path | None = None,
    terrain: str | Path | None = None,
    runs: str | Path | None = None,
    given: Configuration | None = None,
    lenient_dbc: bool = False,
    left_out: Callable[[SetAsideRun], None] | None = None,
) -> list[Run]:
    """Open recordings, logs and campaign folders.

    Parameters
    ----------
    paths : sequence of path
        A recording (MCAP), a log of any format that `daq.logs.read_log` knows, or a folder with ``vehicle.toml``,
        ``terrain.toml``, ``runs.toml``, the DBCs and the runs. Without ``runs.toml`` every recording and log of the
        folder is a run, in the order of their names, but for what `recover` made of one that is there. A file that is
        named by itself takes what lies beside it.
        The parts of a run (``R.mcap``, ``R.part2.mcap``, ...) are one run, whichever of them is named.
    vehicle, terrain, runs : path, optional
        Files that override what folders and recordings carry; the names of DBCs start at the folder of vehicle.toml.
    given : Configuration, optional
        The same, already loaded.
    lenient_dbc : bool
        See `daq.can.databases.load_database`.
    left_out : callable, optional
        Called for each file of a folder that cannot be read or is empty: it is skipped while the folder has others.
        None: such a file is an error, as it always is where the file itself is named. Also called for each file that
        looks like a run and is none of the folder's.

    Returns
    -------
    list of Run
        With ids that differ.

    Raises
    ------
    ConfigError, DatabaseError, RecordingError
        Everything that is wrong with any of them, at once.
    """
    if not paths:
        raise ConfigError.of("no run is given", next_step="name a recording, a log or a campaign folder")
    collected = Collected()
    named = {VEHICLE_FILE: vehicle, TERRAIN_FILE: terrain, RUNS_FILE: runs}
    overriding = {name: Path(path) for name, path in named.items() if path is not None}
    given = _configuration(overriding, collected, lenient_dbc).over(given or Configuration())
    collected.stop_if_any()

    @cache
    def known_in(folder: Path, lenient: bool) -> Configuration | None:
        return _known_in(folder, given, collected, lenient)

    opened: list[Run] = []
    taken: set[Path] = set()
    for path in map(Path, paths):
        with collected.catch():
            with readable(path):
                whole = path.is_dir()
                lenient = lenient_dbc or (not whole and _is_lenient(path))
                known = known_in(path if whole else path.parent, lenient)
                if known is None:
                    continue
                files = _files_of(path, known, collected) if whole else [path]
            found: list[Run] = []
            unreadable: list[tuple[Path, RecordingError]] = []
            for file in files:
                with collected.catch():
                    if file.resolve() in taken:
                        continue
                    try:
                        found.append(_open_file(file, known, lenient_dbc))
                        taken |= _other_parts(found[-1])
                    except RecordingError as error:
                        unreadable.append((file, error))
            if whole and known.runs is None:
                found = _without_copies(found)
            if found and left_out:
                with readable(path):
                    aside = [_skipped(file, known, failure) for file, failure in unreadable]
                    if whole:
                        by_name = {Path(each).resolve() for each in paths}
                        aside += _overlooked(path, known, found, files, by_name, listed=given.runs is None)
                for run in aside:
                    left_out(run)
            else:
                collected.errors += [failure for _, failure in unreadable]
            opened += found
    collected.stop_if_any()
    return _with_unique_ids(opened)


def known_beside(path: Path, given: Configuration, *, lenient_dbc: bool = False) -> Configuration:
    """Return what is given, completed by the files that lie beside a run.

    Raises
    ------
    ConfigError, DatabaseError
        Everything that is wrong with them, at once.
    """
    collected = Collected()
    known = _known_in(path.parent, given, collected, lenient_dbc)
    collected.stop_if_any()
    assert known is not None
    return known


class Collected:
    """Gathers errors so that all of them can be raised at once."""

    def __init__(self) -> None:
        self.errors: list[WheelsoilError] = []

    @contextmanager
    def catch(self, where: str = "") -> Iterator[None]:
        """Collect a `WheelsoilError` raised inside; faults that do not say where get `where`."""
        try:
            yield
        except WheelsoilError as error:
            self.errors.append(type(error)(*(replace(fault, where=fault.where or where) for fault in error.faults)))

    def stop_if_any(self) -> None:
        """Raise all faults as one error of the first one's kind."""
        if self.errors:
            faults = dict.fromkeys(fault for error in self.errors for fault in error.faults)
            raise type(self.errors[0])(*faults) from None


def one_wheel(runs: Sequence[Run], wheel: str | None) -> list[Run]:
    """Return runs of one wheel: of that named, else of the only one; of a single ``[wheel]`` they are the same.

    Raises
    ------
    ConfigError
        See `daq.runs.run.Run.for_wheel`; of all runs at once.
    """
    collected = Collected()
    found: list[Run] = []
    for run in runs:
        with collected.catch():
            found.append(run.for_wheel(wheel) if wheel is not None or run.vehicle.wheels else run)
    collected.stop_if_any()
    return found


def is_recording(path: Path) -> bool:
    """Return whether a file begins like an MCAP file, or is called one; of a run in parts the first need not be there.

    Raises RecordingError if there is no such file, or it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC or path.suffix.lower() == ".mcap"
    except FileNotFoundError:
        if parts_on_disk(part_number(path)[0]):
            return True
        raise no_such_file(path) from None
    except OSError as error:
        raise RecordingError.of("the file cannot be read", path, error.strerror or str(error)) from None


def _is_lenient(path: Path) -> bool:
    """Return whether a recording says that the DBCs, which then lie beside it, must be loaded leniently."""
    if not (is_recording(path) and (path.parent / VEHICLE_FILE).is_file()):
        return False
    return RunRecording.open(path).metadata.get("run_start", {}).get(LENIENT_KEY) == "yes"


def _configuration(files: dict[str, Path], collected: Collected, lenient_dbc: bool) -> Configuration:
    known = Configuration()
    readers: dict[str, Callable[[Path], Configuration]] = {
        VEHICLE_FILE: partial(vehicle_from_file, lenient_dbc=lenient_dbc),
        TERRAIN_FILE: terrain_from_file,
        RUNS_FILE: runs_from_file,
    }
    for name, read in readers.items():
        if name in files:
            with collected.catch():
                known = known.over(read(files[name]))
    return known


def _open_file(path: Path, known: Configuration, lenient_dbc: bool) -> Run:
    if path.is_file() and is_recording(path):
        return recording_run(path, known, lenient_dbc=lenient_dbc)
    return series_run(path, known) if series_format(path) else log_run(path, known)


def _skipped(file: Path, known: Configuration, failure: RecordingError) -> SetAsideRun:
    names = [run.id for run in known.runs or () if Path(run.file).name == file.name and run.id]
    name = names[0] if names else _stem(file)
    if known.runs is not None and not file.exists():
        reason, step = (
            f"{RUNS_FILE} names {file.name}, and there is no such file",
            f"copy it there, or correct {RUNS_FILE}",
        )
        return SetAsideRun(name, "missing", reason, step, f"{file}: skipped: no such file; next: {step}")
    step = "; ".join(dict.fromkeys(fault.next_step for fault in failure.faults if fault.next_step))
    message = "; ".join(f"{fault.where}: skipped: {fault.what}" for fault in failure.faults)
    return SetAsideRun(name, "unreadable", failure.what, step or "drive it again", message)


def _overlooked(
    folder: Path,
    known: Configuration,
    found: Sequence[Run],
    tried: Sequence[Path],
    by_name: Collection[Path],
    *,
    listed: bool,
) -> list[SetAsideRun]:
    """Return the files of a folder that look like runs and are none of those `found`, `tried` or given `by_name`.

    They are recordings and logs that runs.toml does not name (where `listed`), tables with a column of ``[signals]``
    beside recordings, and tables beside others that cannot be read as series. The source of a run is none of them: an
    imported table or log, a damaged recording. Raises OSError if the folder cannot be read.
    """
    vehicle = known.vehicle or found[0].vehicle
    gone = {*by_name, *(file.resolve() for file in (*tried, *(file for run in found for file in run.files)))}
    stems = {_stem_of_run(path) for path in (*tried, *(run.path for run in found))}
    sources = {name for run in found if run.recording for name in _sources(run.recording)}
    files = [
        path
        for path in sorted(folder.iterdir())
        if path.is_file()
        and path.resolve() not in gone
        and path.name not in sources
        and _stem_of_run(path) not in stems
    ]
    if known.runs is not None:
        unnamed = [path for path in files if _is_unnamed(path, vehicle, found)] if listed else []
        reason = f"{RUNS_FILE} does not name {{}}"
        return _not_read(unnamed, "not used", reason, f"name {{}} in {RUNS_FILE}, or take {{}} out of the folder")
    if any(_log_suffix(run.path.name) in RUN_SUFFIXES for run in found):
        beside = [path for path in _tables(files) if _is_table_of_the_vehicle(path, vehicle)]
        return _not_read(beside, "not read", "the folder has recordings", "import {} too, or give {} by name")
    refused = [path for path in _tables(files) if _looks_like_a_run(path, vehicle, found)]
    return [aside for path in refused for aside in _refused(path, vehicle)]


def _not_read(files: Sequence[Path], state: str, reason: str, step: str) -> list[SetAsideRun]:
    """Return the runs of files that share a reason; the message of the first names them all."""

    def worded(text: str, *, several: bool) -> str:
        return text.replace("{}", "them" if several else "it")

    names = ", ".join(_first([path.name for path in files]))
    several = len(files) > 1
    message = f"{names}: {state}, because {worded(reason, several=several)}; next: {worded(step, several=several)}"
    why, what = f"{state}, because {worded(reason, several=False)}", worded(step, several=False)
    return [SetAsideRun(_stem(path), "not_read", why, what, "" if i else message) for i, path in enumerate(files)]


def _first(names: Sequence[str], most: int = _NAMED) -> list[str]:
    """Return the first of some names, and how many more there are."""
    return [*names[:most], *([f"{len(names) - most} more"] if len(names) > most else [])]


def _refused(path: Path, vehicle: VehicleConfig) -> Iterator[SetAsideRun]:
    """Yield the run of a table that cannot be read as series; none if it can."""
    try:
        read_series(path, vehicle.series)
    except DataError as error:
        fault = error.faults[0]
        step = fault.next_step or "correct the file, or take it out of the folder"
        message = f"{path}: not read: {fault.what}; next: {step}"
        yield SetAsideRun(_stem(path), "not_read", f"not read: {fault.what}", step, message)
    except WheelsoilError:  # such a table is a run, and was opened
        pass


def _stem(path: Path) -> str:
    return path.name.partition(".")[0]


def _stem_of_run(path: Path) -> str:
    """Return the name of a file without suffixes and the number of a part: that of an imported log is the same."""
    name = part_number(path)[0].name
    return name[: len(name.lower().removesuffix(".gz"))].rpartition(".")[0]


def _sources(recording: RunRecording) -> set[str]:
    """Return the names of the files that a recording was made of."""
    named = (recording.metadata.get(key, {}).get("source", "") for key in recording.metadata)
    return {name for names in named for name in names.split(", ") if name}


def _is_unnamed(path: Path, vehicle: VehicleConfig, found: Sequence[Run]) -> bool:
    """Return whether a file is a recording, log or table that may be a run beside those that runs.toml names."""
    if any(word in path.stem.lower() for word in FOR_THE_ZERO):
        return False
    if _log_suffix(path.name) not in RUN_SUFFIXES:
        return bool(_tables([path])) and _is_table_of_the_vehicle(path, vehicle)
    return not _is_made_of(path, {file.name for run in found for file in run.files})


def _is_made_of(path: Path, names: Collection[str]) -> bool:
    """Return whether a file is a recording that was made of one with such a name."""
    try:
        return is_recording(path) and not _sources(RunRecording.open(path)).isdisjoint(names)
    except (WheelsoilError, OSError):
        return False


def _is_table_of_the_vehicle(path: Path, vehicle: VehicleConfig) -> bool:
    """Return whether a table holds frames, or series with a column of ``[signals]``: no table that we wrote."""
    try:
        if series_format(path) is None:
            return _log_suffix(path.name) == ".csv" and is_frame_log(path)
        roles = _columns_of_roles(vehicle)
        if not roles:
            return False
        columns = {name for topic in read_series(path, vehicle.series).topics.values() for name in topic}
        return not {*columns, *map(plain_name, columns)}.isdisjoint(roles)
    except (WheelsoilError, OSError):
        return False


def _looks_like_a_run(path: Path, vehicle: VehicleConfig, found: Sequence[Run]) -> bool:
    """Return whether a table's name differs from that of a run in its numbers only, or it begins with such a column."""

    def form(name: str) -> str:
        return re.sub(r"\d+", "0", name.lower())

    if form(path.name) in {form(run.path.name) for run in found}:
        return True
    with unpacked(path, _HEAD_BYTES) as file:
        head = file.read(_HEAD_BYTES)
    return any(plain_name(name).encode() in head for name in _columns_of_roles(vehicle))


def _columns_of_roles(vehicle: VehicleConfig) -> set[str]:
    """Return the names of columns that have a role; none where the signals are those of frames."""
    return set() if vehicle.bus else {name.signal for each in vehicle.each_wheel for name in each.signals.values()}


def misspelt_files(names: Collection[str], given: Collection[str] = ()) -> list[str]:
    """Return a line for each TOML file of a folder whose name is nearly that of one which the folder lacks.

    `names` are those of its files; `given` are known ones that are given in another way.
    """
    others = sorted(name for name in names if name.lower().endswith(".toml") and name not in _TOML_FILES)
    if not others:  # of most folders
        return []
    lacking = {name.removesuffix(".toml"): name for name in _TOML_FILES[:3] if name not in {*names, *given}}
    stems = [(name, name.lower().removesuffix(".toml")) for name in others]
    near = [(name, difflib.get_close_matches(stem, lacking, 1, _MISSPELT)) for name, stem in stems if lacking]
    return [f"{name} is not read: is it {lacking[known[0]]}?" for name, known in near if known]


def _other_parts(run: Run) -> set[Path]:
    """Return the files that are no runs of their own because they are parts of this one."""
    if run.recording is None or len(run.files) + len(run.recording.unreadable) == 1:
        return set()
    return {file.resolve() for file in (*run.files, *run.recording.unreadable)}


def _without_copies(runs: list[Run]) -> list[Run]:
    """Drop recordings recovered from a file that is present itself: its frames would count twice."""
    there = {file for run in runs for file in run.files}

    def is_copy(run: Run) -> bool:
        source = run.recording.metadata.get(RECOVERED, {}).get("source") if run.recording else None
        return source is not None and run.path.parent / source in there

    return [run for run in runs if not is_copy(run)]


def _known_in(folder: Path, given: Configuration, collected: Collected, lenient_dbc: bool) -> Configuration | None:
    """Return what is known of the runs in a folder; None where its files are wrong, which is collected."""
    before = len(collected.errors)
    have = {VEHICLE_FILE: given.vehicle, TERRAIN_FILE: given.terrain, RUNS_FILE: given.runs}
    files = {name: folder / name for name, known in have.items() if known is None and (folder / name).is_file()}
    known = given.over(_configuration(files, collected, lenient_dbc))
    return known if len(collected.errors) == before else None


def _files_of(folder: Path, known: Configuration, collected: Collected) -> list[Path]:
    listed = [folder / run.file for run in known.runs or () if run.file]
    if known.runs is not None and not listed:
        fault = Fault("runs.toml names no file", str(folder), next_step='add file = "..." to each [[run]]')
        collected.errors.append(ConfigError(fault))
    if listed:
        return list(dict.fromkeys(listed))
    if known.runs is not None:
        return []
    found = list(logs_in(folder, known.vehicle))
    if not found:
        collected.errors.append(ConfigError(_no_run_in(folder), *_passed_over(folder, known)))
    return found


def _no_run_in(folder: Path) -> Fault:
    """Return what a folder without a run lacks: files of decoded series need vehicle.toml to be runs."""
    files = sorted(folder.iterdir())
    holding, closed = folders_in(folder)
    tables = [] if (folder / VEHICLE_FILE).is_file() else [path.name for path in _tables(files)]
    step = f"name {' or '.join(_first([str(path) for path in holding])) or 'the folder of a campaign, or a recording'}"
    if tables and not holding:
        step = (
            f"write {VEHICLE_FILE} with [wheel] and [signals] beside {', '.join(_first(tables))}, or give "
            f"one by --vehicle; a {RUNS_FILE} names the files, and says direction, pass and load of each"
        )
    kinds = {
        **dict.fromkeys(filter(Path.is_dir, files), " (holds no run)"),
        **dict.fromkeys(holding, " (holds runs)"),
        **dict.fromkeys(closed, " (cannot be read)"),
    }
    present = ", ".join(_first([path.name + kinds.get(path, "") for path in files], _LISTED)) or "nothing"
    return Fault(
        "the folder holds no run",
        str(folder),
        f"{present}; no {VEHICLE_FILE}, no {RUNS_FILE}" if tables else present,
        f"recordings or logs ({', '.join(RUN_SUFFIXES)}), a {RUNS_FILE} that names them, or {VEHICLE_FILE} beside "
        f"files of decoded series ({', '.join(SERIES_SUFFIXES)})",
        step,
    )


def _passed_over(folder: Path, known: Configuration) -> Iterator[Fault]:
    """Yield why files of a folder without a run are none; not of what describes runs, or only lacks vehicle.toml."""
    others = (path for path in sorted(folder.iterdir()) if path.is_file() and path.suffix.lower() not in _DESCRIBING)
    for path in [path for path in others if not path.name.startswith(".")][:_LISTED]:
        try:
            _open_file(path, known, lenient_dbc=False)
            if not _tables([path]):
                expected = f"a name that ends with one of {', '.join(RUN_SUFFIXES)}"
                yield Fault(
                    "by its name it is no run", str(path), path.name, expected, "rename it, or name it by itself"
                )
        except WheelsoilError as error:  # found is left out where no reader knows the file, so that one fault is of all
            yield error.faults[0] if _tables([path]) else replace(error.faults[0], found="")


def campaign_folders(path: Path) -> list[Path]:
    """Return the folder itself where it holds runs; else those of its folders that do, by name; itself where none does.

    What may not be read counts as a campaign where there are others, so that opening it reports the fault.
    """
    try:
        holding, closed = ([], []) if holds_runs(path) else folders_in(path)
    except OSError:
        return [path]
    return sorted([*holding, *closed]) if holding else [path]


def _with_unique_ids(runs: list[Run]) -> list[Run]:
    """Append a number to the ids of runs with the same id."""
    result: dict[str, Run] = {}
    for run in runs:
        name = numbered(run.id, result, "-")
        same = name == run.id
        result[name] = run if same else replace(run, id=name, info=run.info.model_copy(update={"id": name}))
    return list(result.values())
