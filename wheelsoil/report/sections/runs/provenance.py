"""Provenance: files and their hashes, configuration, versions, the command."""

from __future__ import annotations

from wheelsoil.report.content import Block, Section, Table, Text
from wheelsoil.report.inputs import ReportInputs, Source
from wheelsoil.report.words import count

KEY = "provenance"
TITLE = "Provenance"


def build(material: ReportInputs) -> Section:
    """Build the section."""
    blocks: list[Block] = [
        Text(f"Made by: {material.command}"),
        Table("Files", _FILE_HEAD, [_file_row(source) for source in material.sources], left=2),
        Table("Vehicle and terrain", ["what", "value"], material.facts, left=2),
        Table(
            "Options",
            ["option", "value"],
            [
                [name.replace("_", " "), _value_text(value)]
                for name, value in [*material.options.items(), *_used(material)]
            ],
            left=2,
        ),
        Table("Versions", ["program", "version"], [[name, text] for name, text in material.versions.items()], left=2),
    ]
    numbers = {
        "command": material.command,
        "files": material.sources,
        "facts": material.facts,
        "options": material.options,
        "used": dict(_used(material)),
        "versions": material.versions,
    }
    return Section(KEY, TITLE, blocks, numbers)


_FILE_HEAD = ["run", "file", "size (MB)", "frames", "SHA-256 (16 of its 64 digits; all in the JSON)"]


def _file_row(source: Source) -> list[str]:
    size = f"{source.bytes / 1e6:.2f}" if source.bytes is not None else "–"
    frames = count(source.frames) if source.frames is not None else "–"
    return [source.run_id, source.file, size, frames, source.sha256[:16]]


def _used(material: ReportInputs) -> list[tuple[str, object]]:
    """Return the values used for options that may be at their default."""
    cutoffs = tuple(dict.fromkeys(f"{run.cutoff_hz:.3g} Hz" for run in material.runs))
    threshold = [("slip threshold used", f"{material.campaign.slip_threshold:g}")] if material.campaign else []
    return [("cut-off used", cutoffs), *threshold]


def _value_text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "none"
    return "default" if value is None else str(value)
