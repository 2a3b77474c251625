"""``wheelsoil doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wheelsoil.cli.options import Json
from wheelsoil.cli.talk import print_json, say

if TYPE_CHECKING:
    from daq.doctor import Line

_PAGE_PORT = 8100


def command(
    vehicle: Annotated[
        Path, typer.Argument(metavar="VEHICLE.toml", help="Names the buses, their interfaces and DBCs.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", readable=False, help="Folder that will be recorded into.")
    ] = Path(),
    listen: Annotated[float, typer.Option(min=0.1, metavar="S", help="How long to listen to the buses.")] = 3.0,
    page_port: Annotated[
        int, typer.Option(min=1, max=65535, metavar="N", help="Port that the status page will have.")
    ] = _PAGE_PORT,
    json: Json = False,
) -> None:
    """Say whether this machine is ready to log the vehicle, line by line, and what to do where it is not.

    Warnings end with 0, a failed check with 1: also an interface that is missing, for the other lines are still told.
    """
    from daq.doctor import Verdict, examine, gather

    def about_to_listen() -> None:
        say(f"listening for {listen:g} s")

    lines = list(examine(gather(vehicle, out, listen, page_port, about_to_listen=about_to_listen)))
    count = {verdict.value: sum(line.verdict is verdict for line in lines) for verdict in Verdict}
    if json:
        print_json({"schema": "wheelsoil/doctor/1", "ready": not count["fail"], "count": count, "lines": lines})
    else:
        _print(lines)
        print(", ".join(f"{number} {verdict}" for verdict, number in count.items()))
    if count["fail"]:
        raise typer.Exit(1)


def _print(lines: list[Line]) -> None:
    width = max(len(line.check) for line in lines)
    for line in lines:
        where = f"{line.where}: " if line.where else ""
        print(f"{line.verdict.value}  {line.check.ljust(width)}  {where}{line.found}")
        if line.next_step:
            print(f"{' ' * (width + 8)}-> {line.next_step}")
