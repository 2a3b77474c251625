"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Runs = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Recordings, logs or campaign folders.")]
Vehicle = Annotated[
    Path | None, typer.Option("--vehicle", metavar="FILE", help="vehicle.toml; overrides what a run carries.")
]
Terrain = Annotated[
    Path | None, typer.Option("--terrain", metavar="FILE", help="terrain.toml; overrides what a run carries.")
]
RunsFile = Annotated[
    Path | None, typer.Option("--runs", metavar="FILE", help="runs.toml; overrides what a run carries.")
]
LenientDbc = Annotated[
    bool, typer.Option("--lenient-dbc", help="Leave out the DBC lines that cantools refuses, and list them.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Force = Annotated[bool, typer.Option("--force", "-f", help="Replace the output if it is there.")]
