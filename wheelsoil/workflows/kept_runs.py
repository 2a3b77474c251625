"""Processed runs that are kept, by the content of the recording, what is known of it, and the options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from daq import WheelsoilError
from daq.runs import Run
from processing import ProcessedRun, ProcessOptions, purposes_served
from wheelsoil.cache.keys import OF_PROCESSING, content_of
from wheelsoil.cache.store import folder, get, key_for, put

_KIND = "processed"
_Facts = tuple[tuple[int, int, int], ...]


@dataclass(frozen=True)
class KeptRun:
    """Where a processed run is kept.

    Attributes
    ----------
    shared, own : str
        Names of entries: for every purpose that the run serves alike, and for that of the options.
    facts : tuple
        Size, time of change and number of each file, before it was read.
    """

    run: Run
    purpose: str
    shared: str
    own: str
    facts: _Facts

    def get(self) -> ProcessedRun | None:
        """Return the processed run that is kept; None if there is none."""
        found: ProcessedRun | None = get(self.shared)
        return found if found is not None and self.purpose in purposes_served(found) else get(self.own)

    def put(self, processed: ProcessedRun) -> None:
        """Keep a processed run, unless something of the recording cannot be read, or it has just been written to."""
        damaged = self.run.recording is not None and self.run.recording.loss
        if not damaged and _facts(self.run.files) == self.facts:
            put(self.shared if self.purpose in purposes_served(processed) else self.own, processed)


def place_of(run: Run, options: ProcessOptions, zero: Path | None) -> KeptRun | None:
    """Return where a run is kept that is processed with some options; None where it cannot be.

    `ConfigError` where WHEELSOIL_CACHE_LIMIT is no size.
    """
    if folder() is None or not all(file.is_file() for file in run.files):
        return None
    try:
        facts = _facts(run.files)
        inputs = _inputs(run, zero)
    except (OSError, WheelsoilError):
        return None  # processing says what is wrong
    chosen = {field.name: getattr(options, field.name) for field in fields(options)}
    purpose = chosen.pop("purpose")
    shared, own = (key_for(_KIND, OF_PROCESSING, (inputs, chosen, which)) for which in ("", purpose))
    return KeptRun(run, purpose, shared, own, facts)


def _inputs(run: Run, zero: Path | None) -> tuple[object, ...]:
    """Return all that a processed run depends on but for the options; `counts` tells a file that has grown since."""
    counts = run.recording.frame_counts if run.recording else {}
    databases = {
        bus: tuple((database.name, database.sha256, database.lenient) for database in there)
        for bus, there in run.databases.items()
    }
    names = tuple(file.name for file in run.files)
    return names, content_of(run.files), counts, run.info, run.vehicle, databases, run.zeros(zero)


def _facts(files: Sequence[Path]) -> _Facts:
    return tuple((facts.st_size, facts.st_mtime_ns, facts.st_ino) for facts in (file.stat() for file in files))
