"""``wheelsoil recover``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wheelsoil.cli.options import Force, Json
from wheelsoil.cli.talk import check_output, print_facts, print_json


def command(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="The cut-off or damaged file; it stays as it is.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="New file (default: NAME-recovered.mcap).")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Save everything that a cut-off or damaged recording, or part of one, still holds into a whole file."""
    from daq.errors import Fault, RecordingError
    from daq.recording import Recording, recover
    from daq.recording.parts import part_number, part_path
    from daq.session.folder_lock import is_being_recorded

    first, part = part_number(recording)
    clean = part_path(first.with_name(f"{first.stem}-recovered.mcap"), part)
    if is_being_recorded(recording) and not Recording.open(recording).contents.has_summary:
        raise RecordingError(
            Fault(
                "a logger is still recording into this file",
                str(recording),
                next_step="end the run first; every other command reads the file as far as it is written",
            )
        )
    target = check_output(output or clean, force=force)
    done = recover(recording, target, overwrite=force)
    loss = [str(item) for item in done.loss]
    if json:
        print_json({"recording": done.path, "chunks": done.chunk_count, "loss": loss})
    else:
        print_facts(
            [("recording", str(done.path)), ("chunks saved", str(done.chunk_count)), *(("lost", text) for text in loss)]
        )
