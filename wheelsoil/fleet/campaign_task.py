"""One campaign of a fleet, from its files to its rows in the store: what a worker does."""

from __future__ import annotations

import contextlib
import hashlib
import io
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import pyarrow as pa

from daq import ALL_WHEELS, ConfigError, Fault, WheelsoilError, peak_memory_bytes, reset_peak_memory
from daq.runs import TERRAIN_FILE, VEHICLE_FILE, Run, SetAsideRun
from model import one_thread, processes
from model.diagnosis import Diagnosis, DiagnosisOptions
from processing import LOOK
from wheelsoil import __version__
from wheelsoil.cache.codec import encode
from wheelsoil.cache.store import keeping_only, nothing_kept
from wheelsoil.fleet import Manifest, open_store
from wheelsoil.fleet.roots import Facts, Source, facts_of
from wheelsoil.fleet.rows import Found, tables_of
from wheelsoil.wording.grounds_text import OPEN_AT
from wheelsoil.workflows import (
    CHOICE_FILE,
    BenchFiles,
    Choice,
    Files,
    FitChoices,
    TableFiles,
    bench_of,
    campaigns_of,
    diagnose_benches,
    diagnose_campaigns,
    diagnosis_options,
    fit_runs,
    fit_table,
    load_choice,
    process_on_soil,
    read_benches,
    vehicles_of,
)
from wheelsoil.workflows.fit import nothing_whole

_ONE_AT_A_TIME = threading.Lock()
"""What is printed is taken away from the whole process, and so is the cache."""
_GRAVEST = ("unexplained", "named", "one_of", "nothing_detectable")


@dataclass(frozen=True)
class FleetOptions:
    """How every campaign of a fleet is diagnosed; see `wheelsoil.workflows.diagnosis.diagnosis_options`."""

    effects: tuple[str, ...] = ()
    most_causes: int = 3


@dataclass(frozen=True)
class Task:
    """A campaign to be worked on, manifests of its older rows in the store, and what the store has of it."""

    source: Source
    older: tuple[str, ...] = ()
    content: str = ""


@dataclass(frozen=True)
class Done:
    """What became of a campaign; `new` tells one that was worked on from one that the store had already."""

    manifest: Manifest
    new: bool = True


@dataclass(frozen=True)
class _Opened:
    """A campaign's runs by wheel or its tables, and a hash of all that its rows depend on."""

    content: str
    facts: Facts = field(default_factory=dict)
    runs: dict[str, list[Run]] = field(default_factory=dict)
    benches: tuple[BenchFiles, ...] = ()
    choice: Choice = field(default_factory=Choice)
    unreadable: tuple[SetAsideRun, ...] = ()


@one_thread
def work_on(task: Task, url: str, options: FleetOptions, *, cached: bool = True) -> Done:
    """Process, fit and diagnose a campaign and write it into the store at `url`, unless it is there.

    What is wrong with a campaign is a result, and written down like one. Nothing is printed. Results that were kept are
    used where `cached`; of its own only the diagnosis is kept, which is the dearest and takes the least room.
    `ConfigError` where the store cannot be written.
    """
    store, source = open_store(url), task.source
    keeping = keeping_only("diagnosis") if cached else nothing_kept()
    with _ONE_AT_A_TIME, keeping, processes(1), contextlib.redirect_stderr(io.StringIO()):
        start_s = time.process_time()
        reset_peak_memory()
        opened = _Opened(content_of(source, "", options))
        try:
            facts = source.facts()
            opened = _Opened(content_of(source, _hashes(facts), options), facts)
            opened = _open(source, facts, options)
            if opened.content == task.content or store.has(source.name, opened.content):
                return Done(Manifest(source.name, opened.content, "done"), new=False)
            found = [_of_tables(source, opened, options)] if source.is_table else _of_wheels(source, opened, options)
            content, tables = _made(found, opened, options)
        except Exception as error:  # noqa: BLE001  # the boundary of a campaign: the others go on
            found = [Found(source, fault=_fault_of(error), state="failed")]
            content, tables = _made(found, opened, options)
        failed = any(each.state == "failed" for each in found)
        diagnosis = None if failed else _diagnosis_of(found)
        manifest = Manifest(
            source.name,
            content,
            "failed" if failed else "done",
            _fault_in(found),
            diagnosis.verdict if diagnosis else "",
            ",".join(cause.name for cause in diagnosis.causes if cause.probability >= OPEN_AT) if diagnosis else "",
            opened.facts,
            rows={name: len(rows) for name, rows in tables.items()},
            options=asdict(options),
            cpu_s=round(time.process_time() - start_s, 3),
            peak_bytes=peak_memory_bytes(),
            wheels=sum(each.wheel != ALL_WHEELS for each in found),
        )
        store.put(manifest, tables, task.older)
        return Done(manifest)


def _made(found: Sequence[Found], opened: _Opened, options: FleetOptions) -> tuple[str, dict[str, pa.Table]]:
    """Return the content of a campaign and its rows; one that failed has another, so that it can be tried again."""
    failed = any(each.state == "failed" for each in found)
    inputs = ["failed", opened.content]
    content = content_of(found[0].source, inputs, options) if failed else opened.content
    return content, tables_of(found, content)


def _fault_in(found: Sequence[Found]) -> str:
    """Return what is wrong with a campaign, with the wheels that it is of."""
    places: dict[str, list[str]] = {}
    for each in found:
        place = "all wheels together" if each.wheel == ALL_WHEELS else each.wheel and f"wheel {each.wheel}"
        places.setdefault(each.fault, []).append(place)
    return "; ".join(": ".join(filter(None, (", ".join(own), fault))) for fault, own in places.items() if fault)


def _diagnosis_of(found: Sequence[Found]) -> Diagnosis | None:
    """Return the diagnosis of a campaign: of all its wheels together, else the gravest of any."""
    of_wheels = {each.wheel: each.diagnosis for each in found if each.diagnosis}
    gravest = min(of_wheels.values(), key=lambda each: _GRAVEST.index(each.verdict), default=None)
    return of_wheels.get(ALL_WHEELS, gravest)


def content_of(source: Source, inputs: object, options: FleetOptions) -> str:
    """Return the hash of a campaign's name, what is known of it, how it is worked on, and the program's version."""
    text, _ = encode([__version__, source.name, inputs, asdict(options)])
    return hashlib.sha256(text).hexdigest()[:16]


def _open(source: Source, facts: Facts, options: FleetOptions) -> _Opened:
    if source.is_table:
        vehicle = source.folder / VEHICLE_FILE
        files = TableFiles((str(vehicle),) if vehicle.is_file() else (), (source.folder / TERRAIN_FILE,))
        benches = tuple(read_benches([Path(source.path)], files))
        return _Opened(content_of(source, _hashes(facts), options), facts, benches=benches)
    unreadable: list[SetAsideRun] = []
    wheels = Files().runs_of_wheels([Path(source.path)], unreadable.append)
    runs = next(iter(wheels.values()), [])
    facts = facts | facts_of(file for run in runs for file in run.files)
    chosen = source.folder / CHOICE_FILE
    described = [{name: hashlib.sha256(data).hexdigest() for name, data in run.attachments.items()} for run in runs]
    return _Opened(
        content_of(source, [_hashes(facts), described], options),
        facts,
        wheels or {"": []},
        choice=load_choice(chosen) if chosen.is_file() else Choice(),
        unreadable=tuple(unreadable),
    )


def _hashes(files: Iterable[str]) -> list[list[str]]:
    found = []
    for path in sorted(files):
        with Path(path).open("rb") as file:
            found.append([Path(path).name, hashlib.file_digest(file, "sha256").hexdigest()])
    return found


def _of_wheels(source: Source, opened: _Opened, options: FleetOptions) -> list[Found]:
    """Return what is found of each wheel, and where none failed of all that are not silent together."""
    if len(opened.runs) == 1:
        return [_of_runs(source, runs, opened, options) for runs in opened.runs.values()]
    found = [_tried(source, wheel, _of_runs, runs, opened, options) for wheel, runs in opened.runs.items()]
    there = [each for each in found if not each.fault]
    if len(there) > 1 and not any(each.state == "failed" for each in found):
        found.append(_tried(source, ALL_WHEELS, _together, there, opened, options))
    return found


def _tried(source: Source, wheel: str, work: Callable[..., Found], *given: object) -> Found:
    """Return what is found of a wheel, or what is wrong with it."""
    try:
        return replace(work(source, *given), wheel=wheel)
    except Exception as error:  # noqa: BLE001  # the boundary of a wheel: the others go on
        return Found(source, fault=_fault_of(error), state="failed", wheel=wheel)


def _together(source: Source, wheels: Sequence[Found], opened: _Opened, options: FleetOptions) -> Found:
    vehicles = vehicles_of([Path(source.path)], {each.wheel: each.processed for each in wheels})
    return Found(source, diagnosis=diagnose_campaigns(vehicles, _settings(opened, options)))


def _settings(opened: _Opened, options: FleetOptions) -> DiagnosisOptions:
    reading = opened.choice.fit_choices().reading
    return diagnosis_options(reading, effects=options.effects, most_causes=options.most_causes)


def _of_runs(source: Source, runs: Sequence[Run], opened: _Opened, options: FleetOptions) -> Found:
    choice, fit, remarks = opened.choice, None, []
    aside = list(opened.unreadable)
    files = Files(accept_implausible=True)
    processed = process_on_soil(runs, choice.process_options(LOOK), files, choice=choice, set_aside=aside.append)
    try:
        fit = fit_runs(processed, choice.fit_choices(), None)
    except WheelsoilError as error:
        remarks.append(("fit", _fault_of(error)))
    if missing := nothing_whole([done for _, done in processed]):
        return Found(source, processed, fault=missing, state="silent", set_aside=tuple(aside))
    campaigns = campaigns_of([Path(source.path)], processed)
    if len(campaigns) > 1:
        step = "put the runs of each soil and wheel into a folder of their own"
        raise ConfigError(Fault("the runs are of several soils or wheels", next_step=step))
    diagnosis = diagnose_campaigns(campaigns, _settings(opened, options))
    return Found(source, processed, fit=fit, diagnosis=diagnosis, remarks=tuple(remarks), set_aside=tuple(aside))


def _of_tables(source: Source, opened: _Opened, options: FleetOptions) -> Found:
    fit, remarks = None, []
    if len(opened.benches) == 1:
        wheel_test = opened.benches[0]
        try:
            fit = fit_table(wheel_test.rows, wheel_test.wheel, wheel_test.soil, FitChoices(), wheel_test.terrain)
        except WheelsoilError as error:
            remarks.append(("fit", _fault_of(error)))
    settings = diagnosis_options(effects=options.effects, most_causes=options.most_causes)
    diagnosis = diagnose_benches(tuple(map(bench_of, opened.benches)), settings)
    return Found(source, benches=opened.benches, fit=fit, diagnosis=diagnosis, remarks=tuple(remarks))


def _fault_of(error: Exception) -> str:
    """Return what went wrong, in a line."""
    if isinstance(error, WheelsoilError):
        return "; ".join(", ".join(filter(None, (fault.what, fault.where, fault.found))) for fault in error.faults)
    if isinstance(error, OSError):
        return ", ".join(filter(None, (error.strerror or str(error), str(error.filename or ""))))
    if isinstance(error, MemoryError):
        return "it needs more memory than a worker may use: give --memory"
    return f"a fault of wheelsoil ({type(error).__name__}: {error}); please report it"
