"""Opening and processing runs, as several commands do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from daq.errors import ConfigError, Fault
from daq.open import Collected, open_runs
from daq.run import Run
from processing.options import ProcessOptions
from processing.processed_run import ProcessedRun
from wheelsoil.cli.talk import progress, say


def open_and_process(
    paths: Sequence[Path],
    options: ProcessOptions,
    *,
    vehicle: Path | None = None,
    terrain: Path | None = None,
    runs_file: Path | None = None,
    lenient_dbc: bool = False,
) -> list[tuple[Run, ProcessedRun]]:
    """Open runs and process each; says on stderr what could not be read of a damaged recording.

    Raises
    ------
    WheelsoilError
        What is wrong with any of the runs, of all of them at once.
    """
    opened = open_runs(paths, vehicle=vehicle, terrain=terrain, runs=runs_file, lenient_dbc=lenient_dbc)
    return process_runs(opened, options)


def process_runs(opened: Sequence[Run], options: ProcessOptions) -> list[tuple[Run, ProcessedRun]]:
    """Process runs that are open; see `open_and_process`."""
    from processing.pipeline import process_stream

    collected = Collected()
    processed = []
    for run in progress(opened, "processing", len(opened)):
        with collected.catch(str(run.path)):
            _check_vehicle(run)
            processed.append((run, process_stream(run.channel_batches(), run.vehicle, run.info, options)))
        if run.recording and run.recording.loss:
            say(f"{run.path}: read without what is damaged: {'; '.join(map(str, run.recording.loss))}")
            say("  next: `wheelsoil recover` makes a whole file of what can be read")
    collected.stop_if_any()
    return processed


def _check_vehicle(run: Run) -> None:
    if not run.vehicle.signals:
        raise ConfigError(
            Fault(
                "no vehicle.toml says which signals mean what",
                str(run.path),
                found="the file carries none" if not run.attachments else "vehicle.toml without [signals]",
                next_step="give --vehicle FILE with [wheel], [[bus]] and [signals]",
            )
        )
