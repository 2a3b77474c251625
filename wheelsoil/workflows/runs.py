"""Opening and processing of runs, with all faults reported at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from daq import (
    ROLES,
    ChannelDefinition,
    ConfigError,
    DataError,
    Fault,
    Note,
    RecordingCode,
    StaticTest,
    TimeUnitError,
    UncertainTimestamps,
    VehicleConfig,
    WheelsoilError,
)
from daq.can import no_bus_in_common
from daq.logger import is_being_recorded
from daq.runs import (
    FOR_THE_ZERO,
    RUNS_FILE,
    TERRAIN_FILE,
    VEHICLE_FILE,
    Collected,
    Run,
    SetAsideRun,
    folders_in,
    misspelt_files,
    one_wheel,
    open_runs,
)
from model import in_parallel
from processing import LOOK, SLIP_ROLES, ProcessedRun, ProcessOptions, RunCode, is_refusal, is_refused, keep_only
from wheelsoil.console import progress, say
from wheelsoil.wording.notes import texts_of
from wheelsoil.wording.plausibility_text import refusal
from wheelsoil.workflows.grading import plausibility_of
from wheelsoil.workflows.kept_runs import KeptRun, place_of

if TYPE_CHECKING:
    from wheelsoil.workflows.choice import Choice, RunInUse

_LISTED_BYTES = 64 << 20
_NOISY = tuple(ROLES[role] for role in ("drawbar_pull", "driving_torque"))
_MAY_BE_EVEN = tuple(ROLES[role] for role in ("wheel_speed", "vertical_load"))
"""On a test bench two runs may have the same."""
_OF_A_COPY = (*_MAY_BE_EVEN, *(ROLES[role] for role in ("ground_speed", "sinkage")))
"""The same to the last bit in a copy of a run without forces."""
_SAME_NOISE = 0.1
"""In sigmas; two measurements are 1.4 apart, a cut copy less than .001."""
_PROBED = 64
_WEAK, _FEWEST = 0.05, 3
"""Probability that a run is sound as declared from which on a doubt is weak: so many runs or more may dispel it."""


SetAside = Callable[[SetAsideRun], None]


def wheel_id(run: Run) -> str:
    """Return the id of the one wheel of a run; empty where it has none."""
    return " ".join(run.vehicle.wheel_ids)


def say_set_aside(run: SetAsideRun) -> None:
    """Print why a run is not used (stderr), unless whoever is there switched it off."""
    if run.message:
        say(run.message)


def noted_in(kept: list[SetAsideRun]) -> SetAside:
    """Return what prints why a run is not used, and keeps it."""

    def note(run: SetAsideRun) -> None:
        say_set_aside(run)
        kept.append(run)

    return note


@dataclass(frozen=True)
class Files:
    """Files and settings given beside the recordings: options of the same names.

    `soil` is a preset in place of terrain.toml. `accept_implausible` goes on with runs that are impossible as they are
    declared. `wheel` is the id of one of several wheels.
    """

    vehicle: Path | None = None
    terrain: Path | None = None
    runs: Path | None = None
    zero: Path | None = None
    soil: str | None = None
    lenient_dbc: bool = False
    accept_implausible: bool = False
    wheel: str | None = None

    def open_runs(self, paths: Sequence[Path], set_aside: SetAside) -> list[Run]:
        """Open runs of one wheel with these files in place of their own; see `daq.runs.open_runs`.

        Raises
        ------
        ConfigError
            Also where the vehicle has several wheels, and `wheel` names none of them.
        """
        return one_wheel(self._open(paths, set_aside), self.wheel)

    def each_run(self, paths: Sequence[Path], set_aside: SetAside) -> list[Run]:
        """Open runs, each once for every wheel of its vehicle, or for `wheel` alone.

        Raises
        ------
        ConfigError
            As `open_runs`; also where one zero file is given for several wheels.
        """
        collected, found = Collected(), list[Run]()
        for run in self._open(paths, set_aside):
            with collected.catch():
                found += run.by_wheel().values() if self.wheel is None else one_wheel([run], self.wheel)
        collected.stop_if_any()
        wheels = list(dict.fromkeys(wheel_id(run) for run in found))
        if len(wheels) > 1 and self.zero:
            raise ConfigError.of(
                "one zero file for several wheels",
                self.zero,
                ", ".join(wheels),
                next_step=f"name the wheel: --wheel {wheels[0]}",
            )
        return found

    def runs_of_wheels(self, paths: Sequence[Path], set_aside: SetAside) -> dict[str, list[Run]]:
        """Open the runs of each wheel, or of `wheel` alone, by its id; a single ``[wheel]`` without an id has none.

        Raises
        ------
        ConfigError
            As `each_run`; also where the runs are of different wheels.
        """
        by_wheel: dict[str, list[Run]] = {}
        by_run: dict[str, list[str]] = {}
        for run in self.each_run(paths, set_aside):
            by_wheel.setdefault(wheel_id(run), []).append(run)
            by_run.setdefault(run.id, []).append(wheel_id(run))
        if any(len(runs) < len(by_run) for runs in by_wheel.values()):
            others = ", ".join(f"{run} {' '.join(wheels) or 'one [wheel]'}" for run, wheels in by_run.items())
            raise ConfigError.of(
                "the runs are of vehicles with different wheels",
                found=others,
                next_step="name a wheel that all have by --wheel, or give the runs of each vehicle by themselves",
            )
        return by_wheel

    def _open(self, paths: Sequence[Path], set_aside: SetAside) -> list[Run]:
        self._say_misspelt(paths)
        opened = open_runs(
            paths,
            vehicle=self.vehicle,
            terrain=self.terrain,
            runs=self.runs,
            lenient_dbc=self.lenient_dbc,
            left_out=set_aside,
        )
        inside = {folder for path in paths if path.is_dir() for folder in folders_in(path)[0]}
        others = sorted(folder.name for folder in inside - {run.path.parent for run in opened})
        if names := ", ".join(name for name in others if not any(word in name.lower() for word in FOR_THE_ZERO)):
            say(f"{names}: not read, because folders in a folder are not; next: name them too, if their runs count")
        return opened

    def _say_misspelt(self, paths: Sequence[Path]) -> None:
        """Say which files of the folders are nearly called like one that is looked for."""
        options = {VEHICLE_FILE: self.vehicle, TERRAIN_FILE: self.terrain or self.soil, RUNS_FILE: self.runs}
        given = [name for name, option in options.items() if option]
        for folder in paths:
            with suppress(OSError):  # opening it says what is wrong
                for line in misspelt_files([path.name for path in folder.iterdir()], given):
                    say(f"{folder}: {line}")


Check = Callable[[Sequence[Run]], object]


def open_and_process(
    paths: Sequence[Path],
    options: ProcessOptions,
    files: Files | None = None,
    *,
    choice: Choice | None = None,
    check: Check | None = None,
    set_aside: SetAside = say_set_aside,
) -> list[tuple[Run, ProcessedRun]]:
    """Open runs and process each; says on stderr what could not be read of a damaged recording; see `on_soil`.

    Of `files`, the zero file takes the place of those that the vehicles name (`wheelsoil.workflows.zero.zeros_for`).
    Of `choice`, the runs and what is kept of them are taken; `options` are given by themselves
    (`Choice.process_options`). `check` is given the runs that are used before the work, and may raise. `set_aside` is
    called with every run that is not used.

    Raises
    ------
    WheelsoilError
        What is wrong with any of the runs, of all of them at once.
    """
    files = files or Files()
    opened = files.open_runs(paths, set_aside)
    return process_on_soil(opened, options, files, choice=choice, check=check, set_aside=set_aside)


def process_on_soil(
    opened: Sequence[Run],
    options: ProcessOptions,
    files: Files,
    *,
    choice: Choice | None = None,
    check: Check | None = None,
    set_aside: SetAside = say_set_aside,
) -> list[tuple[Run, ProcessedRun]]:
    """Process open runs with the zero and the settings of `files`; see `open_and_process`."""
    processed = process_runs(
        opened,
        options,
        zero=files.zero,
        choice=choice,
        accept_implausible=files.accept_implausible,
        check=check,
        set_aside=set_aside,
    )
    return on_soil(processed, set_aside)


def process_runs(
    opened: Sequence[Run],
    options: ProcessOptions,
    *,
    zero: Path | None = None,
    choice: Choice | None = None,
    accept_implausible: bool = False,
    check: Check | None = None,
    set_aside: SetAside = say_set_aside,
) -> list[tuple[Run, ProcessedRun]]:
    """Process runs that are open; see `open_and_process`.

    `set_aside` is called with each run that is switched off, repeats another, or is impossible as it is declared; it
    is an error where none is left. `accept_implausible` keeps those that are impossible.
    """
    from wheelsoil.workflows.choice import Choice, runs_in_use

    def attempt(given: tuple[Run, KeptRun | None]) -> ProcessedRun | WheelsoilError:
        try:
            return _process(*given, options, zero)
        except WheelsoilError as error:
            return error

    def attempts() -> Iterator[ProcessedRun | WheelsoilError]:
        places = [place_of(used.run, options, zero) for used in in_use]
        kept = [place.get() if place else None for place in places]
        rows = zip(in_use, places, kept, strict=True)
        todo = [(used.run, place) for used, place, kept_run in rows if kept_run is None]
        # the first loads what all of them need, before this process is copied
        anew = chain(map(attempt, todo[:1]), in_parallel(attempt, todo[1:]))
        return (next(anew) if kept_run is None else kept_run for kept_run in kept)

    collected = Collected()
    processed = []
    chosen = choice or Choice()
    of_one = one_wheel(opened, None)
    in_use, unfit = runs_in_use(chosen, of_one)
    used_ids = {used.run.id for used in in_use}
    for run in (run for run in of_one if run.id not in used_ids and not unfit):
        step = f"say use = true of it in {chosen.source}, to use it"
        set_aside(SetAsideRun(run.id, "switched_off", f"switched off in {Path(chosen.source).name}", step))
    if check and in_use:
        check([used.run for used in in_use])
    collected.errors += [ConfigError(*unfit)] * bool(unfit)
    found = progress(attempts(), "processing", len(in_use))
    for used, result in zip(in_use, found, strict=True):
        run = used.run
        for text in texts_of(used.warnings):
            say(f"run {run.id}: {text}")
        if isinstance(result, WheelsoilError):
            collected.errors.append(result)
        else:
            with collected.catch():
                processed.append((run, _as_chosen(used, result, chosen.source)))
            for note in (note for note in result.quality.notes if note.code == RecordingCode.READ and note.severity):
                say(f"run {run.id}: {note.values['text']}")
        if run.recording and run.recording.loss:
            say(f"{run.path}: read without what is damaged: {'; '.join(map(str, run.recording.loss))}")
            if is_being_recorded(run.files[-1]):
                say("  it is still being recorded")
            else:
                say("  next: `wheelsoil recover` makes a whole file of what can be read")
    collected.stop_if_any()
    once = doubted_by_most(_once(processed, set_aside))
    return once if accept_implausible else _plausible(once, set_aside)


def repetitions(runs: Sequence[ProcessedRun]) -> dict[int, int]:
    """Return the place of each run that measures nothing new, with that of the run that has all of it.

    It is the same measurement where pull, torque, load and wheel speed have the same noise, from the begin on over half
    of the shorter run: a copy, a cut one, or what `recover` or `import` made of it. Without pull and torque it is where
    all else that was measured is the same.
    """
    whole: list[int] = []
    found: dict[int, int] = {}
    for i in sorted(range(len(runs)), key=lambda i: -len(runs[i])):
        same = next((j for j in whole if _repeats(runs[i], runs[j])), None)
        if same is None:
            whole.append(i)
        else:
            found[i] = same
    return found


def _repeats(run: ProcessedRun, other: ProcessedRun) -> bool:
    def agree(rows: slice) -> bool:
        if any(_apart(run, other, channel, rows) >= _SAME_NOISE for channel in (*_NOISY, *_MAY_BE_EVEN)):
            return False
        if any(np.isfinite(_apart(run, other, channel, rows)) for channel in _NOISY):
            return True
        pairs = [(run.column(c.field)[rows], other.column(c.field)[rows]) for c in _OF_A_COPY]
        return len(run) == len(other) and all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)

    half = len(run) // 2
    return agree(slice(0, half, half // _PROBED + 1)) and agree(slice(half))


def _apart(run: ProcessedRun, other: ProcessedRun, channel: ChannelDefinition, rows: slice) -> float:
    """Return how many of its sigmas two runs are apart in a channel while the wheel turns; NaN where one lacks it."""
    a, b, sigma = run.column(channel.field)[rows], other.column(channel.field)[rows], run.column(channel.sigma_field)
    there = np.isfinite(a) & np.isfinite(b) & (run.wheel_speed_radps[rows] != 0)
    if not there.any():
        return np.nan
    return float(np.median(np.abs(a - b)[there] / np.maximum(sigma[rows][there], np.finfo(float).tiny)))


def _once(processed: list[tuple[Run, ProcessedRun]], set_aside: SetAside) -> list[tuple[Run, ProcessedRun]]:
    """Return the runs without those that repeat another."""
    repeated = repetitions([run for _, run in processed])
    for i, j in sorted(repeated.items()):
        run, same = processed[i][0], processed[j][0]
        message = f"set aside: {_name(run)}: the same measurement as {_name(same)}"
        reason = f"the same measurement as {same.id}"
        set_aside(SetAsideRun(run.id, "repeated", reason, f"take {run.path.name} out of the folder", message))
    return [pair for i, pair in enumerate(processed) if i not in repeated]


def doubted_by_most(processed: list[tuple[Run, ProcessedRun]]) -> list[tuple[Run, ProcessedRun]]:
    """Return the runs without a weak doubt of what vehicle.toml declares that few runs of it share: it is of all."""

    def doubts(note: Note, least: float = 0.0) -> bool:
        return note.code == RunCode.IMPLAUSIBLE and "held" not in note.values and note.values["sound"] >= least

    doubted = [any(map(doubts, found.quality.notes)) for _, found in processed]

    def cleared(run: Run, found: ProcessedRun) -> ProcessedRun:
        alike = [own for (other, _), own in zip(processed, doubted, strict=True) if other.vehicle == run.vehicle]
        if len(alike) < _FEWEST or 2 * sum(alike) >= len(alike):
            return found
        left = tuple(note for note in found.quality.notes if not doubts(note, _WEAK))
        return replace(found, quality=replace(found.quality, notes=left))

    pairs = zip(processed, doubted, strict=True)
    return [(run, cleared(run, found) if own else found) for (run, found), own in pairs]


def _plausible(processed: list[tuple[Run, ProcessedRun]], set_aside: SetAside) -> list[tuple[Run, ProcessedRun]]:
    """Return the runs that are possible as they are declared.

    Where none is, `ConfigError` names each run, with what would mend it.
    """
    refused = [
        (run, refusal(note, f"{_name(run)}, {run.vehicle_source}"), "held" not in note.values)
        for run, processed_run in processed
        for note in islice(filter(is_refusal, processed_run.quality.notes), 1)
    ]
    if len(refused) == len(processed) and refused:
        raise ConfigError(*(fault for _, fault, _ in refused))
    for run, fault, mended in refused:
        cause: Literal["misdeclared", "impossible"] = "misdeclared" if mended else "impossible"
        set_aside(SetAsideRun(run.id, cause, fault.what, fault.next_step, f"set aside: {fault}"))
    return [pair for pair in processed if not is_refused(pair[1])]


def _same_wheel(vehicle: VehicleConfig, other: VehicleConfig) -> bool:
    return (vehicle.vehicle.name, vehicle.wheel) == (other.vehicle.name, other.wheel)


def on_soil(
    processed: Sequence[tuple[Run, ProcessedRun]], set_aside: SetAside = say_set_aside
) -> list[tuple[Run, ProcessedRun]]:
    """Return the runs on soil: what the others read while coasting on firm ground is a static test of these.

    It counts once: for the runs of its folder or, where all of them are on firm ground, of the first on soil with the
    same vehicle and wheel. `set_aside` is called with each run on firm ground that hardly coasted.

    Raises
    ------
    ConfigError
        No run is on soil, or none of the vehicle that was on firm ground.
    """
    from model.diagnosis import coasted

    soft = [(run, done) for run, done in processed if done.run.ground == "soft"]
    if processed and not soft:
        raise ConfigError.of(
            "every run is on firm ground",
            processed[0][0].path.parent / RUNS_FILE,
            'ground = "firm"',
            "a run on soil beside them",
            "give the runs on soil too, or look at these with `wheelsoil process`",
        )
    tests: dict[Path, tuple[StaticTest, ...]] = {run.path.parent: () for run, _ in soft}
    for run, done in (pair for pair in processed if pair[1].run.ground == "firm"):
        alike = (each.path.parent for each, _ in soft if _same_wheel(each.vehicle, run.vehicle))
        home = run.path.parent if run.path.parent in tests else next(alike, None)
        if home is None:
            raise ConfigError.of(
                f"run {run.id} is on firm ground, with another vehicle or wheel than every run on soil",
                run.path,
                expected="a run on soil of this vehicle and wheel, with the same [vehicle] name and [wheel]",
                next_step="give the runs of each vehicle by themselves",
            )
        try:
            tests[home] += (coasted(done, wheel_id(run)),)
            say(f"run {run.id}: on firm ground: its rolling is a static test, and no soil is fitted to it")
        except DataError as error:
            [fault] = error.faults
            set_aside(SetAsideRun(run.id, "hardly_coasted", fault.what, fault.next_step, f"set aside: {fault}"))
    return [(replace(run, static=(*run.static, *tests[run.path.parent])), done) for run, done in soft]


def doubts_of(run: Run, wheel: str | None = None) -> list[str]:
    """Return what makes a run implausible as it is declared, for a command that only lists what is in it.

    Nothing of a run that cannot be processed, that has no speeds or wheel, or whose files are larger than 64 MB, which
    take longer than a list may. Of several wheels one is named.
    """
    try:
        [run] = one_wheel([run], wheel)
        if run.vehicle.wheel is None or not run.vehicle.signals.keys() >= set(SLIP_ROLES):
            return []
        if sum(file.stat().st_size for file in run.files) > _LISTED_BYTES:
            return []
        options = ProcessOptions(purpose=LOOK)
        place = place_of(run, options, None)
        kept = place.get() if place else None
        processed = _process(run, place, options, None) if kept is None else kept
    except TimeUnitError as error:
        return [f"{fault.what}: {fault.found}; {fault.next_step}" for fault in error.faults]
    except (WheelsoilError, OSError):
        return []  # `process` says what is wrong
    return texts_of(plausibility_of(processed))


def _process(run: Run, place: KeptRun | None, options: ProcessOptions, zero: Path | None) -> ProcessedRun:
    """Process one run and keep it; the run then knows which of its chunks cannot be read."""
    from processing.pipeline import process_stream
    from wheelsoil.workflows.zero import zeros_for

    _check_vehicle(run)
    try:
        unsure, frames = UncertainTimestamps(), run.frame_batches()
        channels = run.channel_batches(watch=unsure.take, frames=frames)
        processed = process_stream(channels, run.vehicle, run.info, options, zeros_for(run, zero))
    except (ConfigError, DataError) as error:
        raise _explained(run, error) from None
    gaps = [gap.note() for gap in run.recording.gaps] if run.recording else []
    of_run = (*unsure.notes(), *gaps, *run.reading_notes(frames), *run.signal_notes())
    processed = replace(processed, quality=replace(processed.quality, notes=(*of_run, *processed.quality.notes)))
    if place:
        place.put(processed)
    return processed


def _as_chosen(used: RunInUse, processed: ProcessedRun, source: str) -> ProcessedRun:
    """Return a processed run with the warnings about its file, and the parts that are kept of it."""
    processed = replace(processed, quality=replace(processed.quality, notes=(*used.warnings, *processed.quality.notes)))
    try:
        return processed if used.keep is None else keep_only(processed, used.keep, source)
    except (ConfigError, DataError) as error:
        raise _explained(used.run, error) from None


def _check_vehicle(run: Run) -> None:
    if not run.vehicle.signals:
        raise ConfigError.of(
            "no vehicle.toml says which signals mean what",
            run.path,
            found=f"{run.vehicle_source} without [signals]" if run.attachments else "none in the file, none beside it",
            next_step="give --vehicle FILE with [wheel], [[bus]] and [signals]",
        )


def _explained(run: Run, error: ConfigError | DataError) -> ConfigError | DataError:
    """Return an error that says which run and which file it is about, or why no signal of the run is known."""
    strangers = no_bus_in_common(run.vehicle, _buses(run)) if isinstance(error, DataError) else ""
    if not strangers:
        return type(error)(*(_placed(run, fault) for fault in error.faults))
    return DataError.of(
        f"{strangers}: nothing can be decoded",
        f"{_name(run)}, {run.vehicle_source}",
        next_step="name them alike: channel under [[bus]], or `wheelsoil import LOG --bus old=new`",
    )


def _placed(run: Run, fault: Fault) -> Fault:
    """Return a fault that names the run, and vehicle.toml as its file is called."""
    if fault.where.startswith(VEHICLE_FILE):
        return replace(fault, where=run.vehicle_source + fault.where.removeprefix(VEHICLE_FILE))
    return replace(
        fault,
        where=f"{_name(run)}: {fault.where}" if fault.where else _name(run),
        next_step=fault.next_step.replace(VEHICLE_FILE, run.vehicle_source),
    )


def _name(run: Run) -> str:
    wheel = run.vehicle.wheel
    return f"run {run.id}, {run.path}" + (f", wheel {wheel.id}" if wheel and wheel.id else "")


def _buses(run: Run) -> list[str]:
    """Return the buses that have frames in a run."""
    if run.recording:
        return [bus for bus, count in run.recording.frame_counts.items() if count]
    seen: dict[str, None] = {}
    for batch in run.frame_batches():
        seen |= dict.fromkeys(batch.buses[i] for i in np.unique(batch.frames["bus"]))
    return list(seen)
