"""Files of decoded series -> one recording that needs no other file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.config import RunInfo, VehicleConfig
from daq.logs.report import share_of_all
from daq.recording import whole_recording
from daq.recording.format import SERIES_BUS
from daq.runs.run import Configuration
from daq.series.formats import read_all


@dataclass(frozen=True)
class ImportedSeries:
    """Result of an import: the recording at `path`, and what came into it.

    Attributes
    ----------
    topics : mapping topic -> mapping column -> unit
    rows : mapping topic -> number of rows
    remarks : tuple of str
        What a user should know of the files.
    """

    path: Path
    topics: Mapping[str, Mapping[str, str]]
    rows: Mapping[str, int]
    remarks: tuple[str, ...]


def import_series(
    files: Sequence[Path],
    target: Path,
    known: Configuration,
    *,
    run: RunInfo,
    overwrite: bool = False,
    watch: Callable[[int, float], None] | None = None,
) -> ImportedSeries:
    """Write the series of files into a recording, every column at its own rate.

    Parameters
    ----------
    files : sequence of Path
        Of one run; several must share their clock.
    target : Path
        The recording to write.
    known : Configuration
        What goes along: vehicle, terrain. ``[series]`` of vehicle.toml says how the files are laid out.
    watch : callable, optional
        Called after each block with the number of rows and the share of the files that has been read.

    Raises
    ------
    ConfigError, DataError, RecordingError
        A file cannot be read, or `target` cannot be written; nothing is left behind then.
    """
    vehicle = known.vehicle or VehicleConfig()
    series, reports = read_all(files, vehicle.series)
    metadata = {"source": ", ".join(file.name for file in files)}
    carried = known.attachments
    rows = dict.fromkeys(series.topics, 0)
    sizes = [file.stat().st_size for file in files]
    with whole_recording(target, run=run, attachments=carried, metadata=metadata, overwrite=overwrite) as writer:
        for blocks in series.blocks():
            for block in blocks:
                units = series.topics[block.topic]
                writer.decoded.write(block.topic, SERIES_BUS, block.time_ns, block.columns, units)
                rows[block.topic] += len(block)
            if watch:
                watch(sum(rows.values()), share_of_all(sizes, reports))
    remarks = [f"{Path(report.path).name}: {line}" for report in reports for line in report.remarks()]
    return ImportedSeries(target, series.topics, rows, tuple(remarks))
