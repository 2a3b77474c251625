"""Where everything came from: files and their hashes, what was configured, versions, the command."""

from __future__ import annotations

from wheelsoil.report.content import Block, Section, Table, Text
from wheelsoil.report.material import Material, Source
from wheelsoil.report.words import count

KEY = "provenance"
TITLE = "Provenance"


def build(material: Material) -> Section:
    """Build the section."""
    blocks: list[Block] = [
        Text(f"Made by: {material.command}"),
        Table("Files", _FILE_HEAD, [_file_row(source) for source in material.sources], left=2),
        Table("Vehicle and terrain", ["what", "value"], material.facts, left=2),
        Table(
            "Options", ["option", "value"], [[name, _plain(value)] for name, value in material.options.items()], left=2
        ),
        Table("Versions", ["program", "version"], [[name, text] for name, text in material.versions.items()], left=2),
    ]
    numbers = {
        "command": material.command,
        "files": material.sources,
        "facts": material.facts,
        "options": material.options,
        "versions": material.versions,
    }
    return Section(KEY, TITLE, blocks, numbers)


_FILE_HEAD = ["run", "file", "size (MB)", "frames", "SHA-256 (first 16 digits)"]


def _file_row(source: Source) -> list[str]:
    size = f"{source.bytes / 1e6:.2f}" if source.bytes is not None else "–"
    frames = count(source.frames) if source.frames is not None else "–"
    return [source.run_id, source.file, size, frames, source.sha256[:16]]


def _plain(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple) else "default" if value is None else str(value)
