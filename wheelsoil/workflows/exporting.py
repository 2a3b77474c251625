"""Decoded signals of a run as tables, or as a recording with every decoded sample."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from daq import Channel, ConfigError, Fault, data_frame, file_name
from daq.can import Decoder
from daq.recording import DecodedWriter, RecordingWriter
from daq.runs import LENIENT_KEY, Run
from daq.series import write_frame


def export_tables(
    run: Run, folder: Path, suffix: str, signals: Collection[str] | None = None, *, overwrite: bool = False
) -> list[Path]:
    """Write a table for each bus and message of a run: ``<run>.<bus>.<message>.<suffix>``.

    The decoded columns of one run are held in memory.

    Parameters
    ----------
    suffix : str
        ``parquet``, ``csv`` or ``mat``.
    signals : collection of "Message.Signal", optional
        All by default.

    Raises
    ------
    ConfigError
        A file is there already; a signal is in no DBC.
    RecordingError, HardwareError
        The run cannot be read, or a table cannot be written.
    """
    decoder = Decoder(run.databases, signals or None)
    pieces: dict[tuple[str, str], dict[str, list[Channel]]] = {}
    for batch in run.frame_batches():
        for (bus, name), channel in decoder.decode(batch).items():
            message, _, signal = name.rpartition(".")
            pieces.setdefault((bus, message), {}).setdefault(signal, []).append(channel)
    targets = {key: folder / f"{file_name(f'{run.id}.{key[0]}.{key[1]}')}.{suffix}" for key in pieces}
    there = [path for path in targets.values() if path.exists() and not overwrite]
    if there:
        raise ConfigError(
            *(Fault("the output exists already", str(path), next_step="another folder, or --force") for path in there)
        )
    return [_write(targets[key], columns) for key, columns in pieces.items()]


def export_recording(run: Run, folder: Path, *, overwrite: bool = False) -> Path:
    """Write a recording with the raw frames and every decoded sample as a topic.

    Raises
    ------
    RecordingError, HardwareError
        The run cannot be read, or the recording cannot be written.
    """
    target = folder / f"{file_name(run.id)}.mcap"
    if target.exists() and any(target.samefile(file) for file in run.files):
        raise ConfigError(Fault("the output is the run itself", str(target), next_step="choose another folder"))
    writer = RecordingWriter(
        target,
        run=run.info.model_copy(update={"file": target.name}),
        attachments=run.attachments,
        metadata={"source": run.path.name} | ({LENIENT_KEY: "yes"} if run.lenient else {}),
        flush_every_s=None,
        sync_every_s=None,
        decoded_rate_hz=None,
        overwrite=overwrite,
    )
    with writer:
        view, decoder = DecodedWriter(writer, run.vehicle, run.databases), Decoder(run.databases)
        for batch in run.frame_batches():
            writer.write_frames(batch)
            view.write(decoder.decode(batch))
    return target


def _write(path: Path, columns: dict[str, list[Channel]]) -> Path:
    first = next(iter(columns.values()))
    table = {"time_ns": np.concatenate([piece.time_ns for piece in first])}
    table |= {name: np.concatenate([piece.values for piece in parts]) for name, parts in columns.items()}
    units = {name: parts[0].unit for name, parts in columns.items()}
    return write_frame(path, data_frame(table, {"time_ns": "ns", **units}))
