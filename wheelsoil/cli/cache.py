"""``wheelsoil cache``."""

from __future__ import annotations

from typing import Annotated

import typer

from wheelsoil.cli import options
from wheelsoil.console import print_json, print_pairs, say


def cache_command(
    clear: Annotated[bool, typer.Option("--clear", help="Remove everything that is kept.")] = False,
    json: options.Json = False,
) -> None:
    """Report where results are kept, how many, and how much may be kept.

    Processed runs, fits, diagnoses and sinkages from forces are kept by the content of what they were made from and by
    the version of the code. WHEELSOIL_CACHE names the folder, or is "off"; WHEELSOIL_CACHE_LIMIT is a size (2 GB).
    """
    from wheelsoil.cache import clear as remove
    from wheelsoil.cache import entries, folder, limit_bytes

    removed = remove() if clear else 0
    place = folder()
    there = entries(place) if place else []
    facts = {
        "folder": str(place) if place else None,
        "entries": len(there),
        "bytes": sum(entry.bytes for entry in there),
        "limit_bytes": limit_bytes(),
    }
    if json:
        print_json(facts | {"removed": removed})
        return
    sizes = f"{facts['bytes']:,} of {facts['limit_bytes']:,} bytes"
    print_pairs([("folder", str(place or "off")), ("entries", str(len(there))), ("size", sizes)])
    if clear:
        say(f"{removed} entries removed")
