"""``wheelsoil view``."""

from __future__ import annotations

from typing import Annotated

import typer

from wheelsoil.cli.options import (
    LenientDbc,
    Runs,
    RunsFile,
    SoilPreset,
    Terrain,
    TokenFile,
    Vehicle,
    ZeroFile,
    page_token,
)
from wheelsoil.cli.talk import say


def command(
    runs: Runs,
    vehicle: Vehicle = None,
    terrain: Terrain = None,
    runs_file: RunsFile = None,
    zero: ZeroFile = None,
    soil: SoilPreset = None,
    lenient_dbc: LenientDbc = False,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Where it listens; beyond this machine it asks for a token.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, metavar="N", help="Its port (default: 8200, or the next free one).")
    ] = None,
    token_file: TokenFile = None,
    browser: Annotated[bool, typer.Option(help="Open a browser, where there is a display.")] = True,
) -> None:
    """Look at recordings in the browser: choose runs and parts of them, move parameters, fit, diagnose.

    Runs of one folder, soil and wheel are a campaign. What is chosen is kept as a file beside the runs, which
    `process`, `fit`, `diagnose` and `report` take with --choice. Nothing leaves this machine.

    Exit codes: 2 usage or configuration; 3 unreadable recording; 4 the port that --port gives is taken, no such
    address; 130 Ctrl-C, 143 SIGTERM.
    """
    from wheelsoil.fitting import known_soil
    from wheelsoil.view.opening import Files
    from wheelsoil.view.server import serve

    if soil is not None:
        known_soil(soil, None)
    files = Files(vehicle, terrain, runs_file, zero, soil, lenient_dbc)
    serve(runs, files, host=host, port=port, token=page_token(token_file), browser=browser, say=say)
