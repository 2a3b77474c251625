"""Provenance: files and their hashes, configuration, versions, the command; noise model and soils of the diagnosis."""

from __future__ import annotations

from wheelsoil.report.content import Block, Contents, Pair, Table, Text, section
from wheelsoil.report.inputs import ReportInputs, Source
from wheelsoil.wording.names import letter, named_with_unit, plain_name, soil_unit
from wheelsoil.wording.notes import texts_of
from wheelsoil.wording.numbers import count, number, signed, unit

_FILE_HEAD = ["run", "file", "size (MB)", "frames", "SHA-256 (16 of its 64 digits; all in the JSON)"]

_SOIL_HEAD = ["parameter", "value", "sigma", "unit", "off the laboratory's (its sigmas)"]


@section("provenance", "Provenance")
def provenance(inputs: ReportInputs) -> Contents:
    """Build the section."""
    options = [*inputs.options.items(), *_used(inputs)]
    rows = [[name.replace("_", " "), _value_text(value)] for name, value in options]
    blocks: list[Block] = [
        Text(f"Made by: {inputs.command}"),
        Table("Files", _FILE_HEAD, [_file_row(source) for source in inputs.sources], left=2, words=_FILE_HEAD[-1:]),
        Pair(
            [
                Table("Vehicle and terrain", ["what", "value"], inputs.facts, left=2),
                Table("Options", ["option", "value"], rows, left=2),
                Table("Versions", ["program", "version"], [[*pair] for pair in inputs.versions.items()], left=2),
            ]
        ),
    ]
    numbers = {
        "command": inputs.command,
        "files": inputs.sources,
        "facts": inputs.facts,
        "options": inputs.options,
        "used": dict(_used(inputs)),
        "versions": inputs.versions,
    }
    return blocks, numbers


def _file_row(source: Source) -> list[str]:
    size = f"{source.bytes / 1e6:.2f}" if source.bytes is not None else "–"
    frames = count(source.frames) if source.frames is not None else "–"
    return [source.run_id, source.file, size, frames, source.sha256[:16]]


def _used(inputs: ReportInputs) -> list[tuple[str, object]]:
    """Return the values used for options that may be at their default."""
    cutoffs = tuple(dict.fromkeys(f"{run.cutoff_hz:.3g} Hz" for run in inputs.runs))
    used: list[tuple[str, object]] = [] if inputs.tables else [("cut-off used", cutoffs)]
    return used + ([("slip threshold used", f"{inputs.campaign.slip_threshold:g}")] if inputs.campaign else [])


def _value_text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "none"
    return "default" if value is None else str(value)


@section("workings", "How the diagnosis was made")
def workings(inputs: ReportInputs) -> Contents:
    """Build the section."""
    found = inputs.diagnosis
    blocks: list[Block] = [Text(f"{note[0].upper()}{note[1:].rstrip('.')}.") for note in texts_of(found.notes)]
    tables: list[Block] = []
    if found.noise:
        named = [(*named_with_unit(name), value) for name, value in found.noise.items()]
        rows = [[name, number(value), unit] for name, unit, value in named]
        note = "Estimated from these runs by marginal likelihood; everything else on this page is weighed with it."
        tables.append(Table("Noise model", ["quantity", "value", "unit"], rows, note, words=("unit",)))
    for soil in found.soils:
        rows = [
            [
                letter(name),
                number(scale * value, 4),
                number(scale * soil.sigmas.get(name, float("nan")), 2),
                unit(text),
                signed(soil.off_laboratory[name], "+.1f") if name in soil.off_laboratory else "–",
            ]
            for name, value in soil.values.items()
            for scale, text in [soil_unit(name)]
        ]
        note = "With the named cause in the model, or none where none is named."
        tables.append(Table(f"Soil as the data leave it: {soil.campaign}", _SOIL_HEAD, rows, note, words=("unit",)))
    if found.stages_s:
        rows = [[plain_name(name), f"{seconds:.2f}"] for name, seconds in found.stages_s.items()]
        tables.append(Table("Stages", ["stage", "time (s)"], rows))
    blocks += [Pair(tables)] if tables else []
    numbers = {"noise": found.noise, "soils": found.soils, "notes": found.notes, "stages_s": found.stages_s}
    return blocks or [Text("Nothing is known of it.")], numbers
