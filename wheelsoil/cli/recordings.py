"""``wheelsoil info``, ``wheelsoil export``, ``wheelsoil recover`` and ``wheelsoil sample``."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from daq import ConfigError, Fault, moment, number
from wheelsoil.cli.options import Force, Json, LenientDbc, Runs, RunsFile, Terrain, Vehicle, Wheel, configuration, pairs
from wheelsoil.console import check_output, counting, print_json, print_pairs, print_table, progress, say, say_folded

if TYPE_CHECKING:
    from daq.runs import SignalFacts
    from wheelsoil.workflows.recordings import FileFacts

_SHOWN_IDS = 20
_IF_ANY = ("balance", "wheels")
_LOSS_KINDS = {
    "kernel": "not read in time",
    "queue": "dropped by the logger",
    "counter": "missing by the counter",
    "missing": "missing by the rate",
}

_CLOCK = (
    ("offset", "offset_s", "offset_sigma_s", "s"),
    ("drift", "drift_ppm", "drift_sigma_ppm", "ppm"),
    ("residual", "residual_s", "", "s"),
    ("epochs", "epochs", "", ""),
)


def export_command(
    runs: Runs,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write into.")],
    kind: Annotated[
        Literal["parquet", "csv", "mat"], typer.Option("--format", help="File format of the tables.")
    ] = "parquet",
    signal: Annotated[
        list[str] | None,
        typer.Option(metavar="MESSAGE.SIGNAL", help="Only these signals; may be repeated (default: all)."),
    ] = None,
    decode: Annotated[
        bool, typer.Option("--decode", help="Write recordings with every decoded sample as a topic, not tables.")
    ] = False,
    vehicle: Vehicle = None,
    runs_file: RunsFile = None,
    lenient_dbc: LenientDbc = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write decoded signals in full: a table for each run, bus and message, with time stamps and units.

    Values are physical, in the unit of the DBC, empty where a code says that there is none; `process` gives them in SI
    and on one time base.
    """
    from daq.runs import open_runs
    from wheelsoil.workflows.recordings import export_recording, export_tables
    from wheelsoil.workflows.runs import say_set_aside

    if decode and signal:
        raise ConfigError.of("--decode writes every signal", next_step="omit --signal")
    if not output.parent.is_dir():
        raise ConfigError.of("no such folder", output.parent, next_step="create it or choose another output")
    opened = open_runs(runs, vehicle=vehicle, runs=runs_file, lenient_dbc=lenient_dbc, left_out=say_set_aside)
    ConfigError.stop_if_any(
        Fault("no DBC is known for this run", str(run.path), next_step="give --vehicle FILE, which names them")
        for run in opened
        if not run.databases
    )
    output.mkdir(exist_ok=True)
    written: list[Path] = []
    taken: set[str] = set()
    for run in progress(opened, "exporting", len(opened)):
        if decode:
            written.append(export_recording(run, output, overwrite=force, taken=taken))
        else:
            written += export_tables(run, output, kind, signal, overwrite=force, taken=taken)
    if json:
        print_json({"files": written})
    else:
        print_pairs([(path.name, _megabytes(path.stat().st_size)) for path in written])


def info_command(
    runs: Runs,
    vehicle: Vehicle = None,
    wheel: Wheel = None,
    terrain: Terrain = None,
    runs_file: RunsFile = None,
    lenient_dbc: LenientDbc = False,
    all_ids: Annotated[
        bool, typer.Option("--all-ids", help="List every identifier and signal, not only the most frequent.")
    ] = False,
    dbc: Annotated[
        list[str] | None,
        typer.Option(metavar="BUS=FILE", help="A DBC of a bus, if there is no vehicle.toml; may be repeated."),
    ] = None,
    json: Json = False,
) -> None:
    """List the contents of a recording, log or series: every message and signal, rates, gaps, losses, attachments.

    With --wheel only that wheel's runs are checked for what is implausible; the list is of the whole file.
    """
    from daq.runs import one_wheel, open_runs
    from wheelsoil.workflows.recordings import file_facts
    from wheelsoil.workflows.runs import doubts_of, say_set_aside

    given = configuration(vehicle, terrain, pairs(dbc, "--dbc", "BUS=FILE"), lenient_dbc=lenient_dbc)
    opened = open_runs(runs, given=given, runs=runs_file, lenient_dbc=lenient_dbc, left_out=say_set_aside)
    if wheel is not None:
        one_wheel(opened, wheel)
    facts: list[FileFacts] = []
    doubts: list[list[str]] = []
    for run in opened:
        with counting(f"reading {run.path.name}", "frames") as watch:
            facts.append(file_facts(run, watch))
        names: list[str | None] = [wheel] if wheel else [*run.vehicle.wheel_ids]
        each = [] if facts[-1].recording_now else names or [None]
        doubts.append([f"wheel {name}: {text}" if name else text for name in each for text in doubts_of(run, name)])
    if json:
        print_json([_as_json(*each) for each in zip(facts, doubts, strict=True)])
    else:
        for i, recording in enumerate(facts):
            if i:
                print()
            _print(recording, None if all_ids else _SHOWN_IDS)
    for run, recording, texts in zip(opened, facts, doubts, strict=True):
        for text in texts:
            say_folded(f"{recording.file}: {text}")
        if recording.recording_now:
            say(f"{recording.file}: still being recorded; the part written so far was read")
        elif recording.loss and run.recording is not None:
            say(f"{recording.file}: cut off or damaged; `wheelsoil recover` writes the readable part to a new file")


def _as_json(facts: FileFacts, doubts: Sequence[str]) -> dict[str, Any]:
    from wheelsoil.to_json import plain
    from wheelsoil.wording.notes import note_text

    known: dict[str, Any] = {name: value for name, value in plain(facts).items() if name not in _IF_ANY or value}
    return (
        known
        | ({"doubts": doubts} if doubts else {})
        | {
            "gaps": [{**plain(gap), "text": note_text(gap.note())} for gap in facts.gaps],
            "recording_now": facts.recording_now,
            "duration_s": plain(facts.duration_s),
            "rate_hz": {bus: plain(facts.rate_hz(bus)) for bus in facts.frames},
            "known_frames": facts.coverage.known,
            "unknown_frames": facts.coverage.unknown,
        }
    )


def _print(facts: FileFacts, shown_ids: int | None) -> None:
    print_pairs([(name, text) for name, text in _head(facts) if text])
    if len(facts.parts) > 1:
        print()
        _print_parts(facts)
    if any(facts.losses.values()):
        print()
        _print_losses(facts)
    if facts.events:
        print()
        rows = [
            [moment(event.time_ns), event.name, event.severity, event.text.replace("\n", " ")] for event in facts.events
        ]
        print_table(["time", "event", "severity", "text"], rows, left=4)
    if facts.messages:
        print()
        _print_messages(facts, shown_ids)
    if facts.coverage.unknown and facts.databases:
        print()
        _print_ids(facts, shown_ids)
    if facts.topics:
        print()
        print_table(
            ["topic", "schema", "messages"],
            [[topic.name, topic.schema_name, f"{topic.message_count:,}"] for topic in facts.topics],
            left=2,
        )


def _head(facts: FileFacts) -> list[tuple[str, str]]:
    from wheelsoil.wording.notes import note_text

    info = facts.info
    run = f"{facts.run_id} ({info.direction}, pass {info.pass_number}, {info.added_load_kg:g} kg added"
    run += f", {info.inflation_kpa:g} kPa)" if info.inflation_kpa else ")"
    lines = [
        ("file", facts.file),
        ("kind", f"{facts.kind}, {_megabytes(facts.bytes)}" + (f", by {facts.written_by}" if facts.written_by else "")),
        ("sha256", facts.sha256),
        ("run", run),
        ("vehicle", facts.vehicle),
        ("wheels", ", ".join(facts.wheels)),
        ("terrain", facts.terrain),
        ("start", moment(facts.start_ns) if facts.start_ns is not None else ""),
        ("duration", f"{facts.duration_s:.2f} s" if facts.start_ns is not None else ""),
    ]
    for bus, count in facts.frames.items():
        lost = f", {facts.drops[bus]:,} lost before recording" if facts.drops.get(bus) else ""
        known = ", ".join(facts.databases.get(bus, [])) or "no DBC"
        lines.append((f"bus {bus}", f"{count:,} frames, {number(facts.rate_hz(bus))} /s, {known}{lost}"))
    lines += [
        ("known to DBCs", f"{facts.coverage.known:,} frames" if facts.databases else ""),
        ("unknown", f"{facts.coverage.unknown:,} frames" if facts.coverage.unknown else ""),
        ("error frames", f"{facts.coverage.error_frames:,}" if facts.coverage.error_frames else ""),
        ("remote frames", f"{facts.coverage.remote_frames:,}" if facts.coverage.remote_frames else ""),
        ("attached", ", ".join(f"{name} ({size:,} B)" for name, size in facts.attachments.items())),
        ("balance", facts.balance.sentence("frames" if facts.frames else "rows") if facts.balance else ""),
        ("end", facts.exit_status),
        ("clock", _clock(facts.clock)),
        ("uncertain time stamps", _uncertain_timestamps(facts)),
        ("clock steps", ", ".join(f"{key} {text}" for key, text in facts.clock_steps.items())),
    ]
    lines += [("gap", note_text(gap.note())) for gap in facts.gaps]
    return lines + [("loss", text) for text in facts.loss] + [("remark", text) for text in facts.remarks]


def _clock(clock: Mapping[str, str]) -> str:
    """Return host time minus GNSS time, from the recording's metadata, as one line."""
    shown = []
    for label, key, sigma_key, unit in _CLOCK:
        if key in clock:
            sigma = f" ± {_shortened(clock[sigma_key])}" if sigma_key in clock else ""
            shown.append(f"{label} {_shortened(clock[key])}{sigma} {unit}".rstrip())
    return ", ".join(shown)


def _uncertain_timestamps(facts: FileFacts) -> str:
    """Return the number of frames received while the host's clock was set; empty if there are none."""
    if not facts.unsure_frames:
        return ""
    known = facts.unsure_within_s == facts.unsure_within_s
    return f"{facts.unsure_frames:,} frames" + (f", wrong by up to {facts.unsure_within_s:.3g} s" if known else "")


def _shortened(text: str) -> str:
    """Return a number with fewer digits, anything else as it is."""
    try:
        return text if text.isdecimal() else number(float(text))
    except ValueError:
        return text


def _megabytes(size: int) -> str:
    """Return a size with three digits: 8.008 beside 3,001 could be read as eight thousand and eight."""
    return f"{number(size / 1e6, 3)} MB"


def _print_parts(facts: FileFacts) -> None:
    rows = [
        [
            Path(part.file).name,
            f"{part.frames:,}",
            number(part.bytes / 1e6, 3),
            moment(part.start_ns) if part.start_ns is not None else "-",
            part.exit_status or ("still being recorded" if part.recording_now else "cut off"),
        ]
        for part in facts.parts
    ]
    print_table(["part", "frames", "MB", "start", "end"], rows, left=1)


def _print_losses(facts: FileFacts) -> None:
    from wheelsoil.wording.losses import losses_as_texts

    rows = []
    for key, count in losses_as_texts(facts.losses).items():
        kind, _, where = key.partition(".")
        rows.append([where, _LOSS_KINDS.get(kind, kind), count])
    print_table(["lost on", "how", "frames"], rows, left=2)


def _print_messages(facts: FileFacts, limit: int | None) -> None:
    """Print what came of the messages that have most samples, and the range of their signals."""
    often = sorted(facts.messages, key=lambda message: -message.samples)[:limit]
    shown = [message for message in facts.messages if message in often]
    rows = [
        [
            message.bus or "-",
            message.name,
            f"{message.samples:,}",
            number(message.rate_hz),
            "-" if isnan(message.missing_share) else f"{100 * message.missing_share:.1f} %",
            number(message.longest_gap_s, 3),
            number(message.gap_at_s, 4) if message.longest_gap_s > 0 else "-",
        ]
        for message in shown
    ]
    print_table(
        ["bus", "message" if facts.frames else "topic", "samples", "/s", "missing", "longest gap s", "at s"],
        rows,
        left=2,
    )
    signals = [
        [
            f"{message.name}.{signal.name}",
            signal.unit or "-",
            number(signal.least),
            number(signal.most),
            f"{100 * signal.share:.4g} %",
            _absence(signal, message.samples),
        ]
        for message in shown
        for signal in message.signals
    ]
    if signals:
        print()
        print_table(["signal", "unit", "least", "most", "present", ""], signals, left=2)
    if len(facts.messages) > len(shown):
        print(f"... and {len(facts.messages) - len(shown)} more with their signals (--all-ids)")


def _absence(signal: SignalFacts, samples: int) -> str:
    """Return why samples have no value, and what the DBC may have left open."""
    shares = [f"{word} {100 * count / samples:.4g} %" for word, count in signal.absent.items()]
    if signal.all_bits_set:
        shares.append(
            f"all bits set in {100 * signal.all_bits_set / samples:.4g} %: no data? The DBC has it as a value"
        )
    return "; ".join(shares)


def _print_ids(facts: FileFacts, limit: int | None) -> None:
    ids = sorted(facts.coverage.ids, key=lambda row: -row.frames)
    shown = sorted(ids[:limit], key=lambda row: (row.bus, row.extended, row.can_id))
    rows = [
        [
            row.bus,
            f"0x{row.can_id:08X}" if row.extended else f"0x{row.can_id:03X}",
            row.message or "-",
            f"{row.frames:,}",
        ]
        for row in shown
    ]
    print_table(["bus", "id", "message", "frames"], rows, left=3)
    if len(ids) > len(shown):
        rest = sum(row.frames for row in ids[len(shown) :])
        print(f"... and {len(ids) - len(shown)} more identifiers with {rest:,} frames (--all-ids)")
    if facts.coverage.further_frames:
        print(f"... and {facts.coverage.further_frames:,} frames of further unknown identifiers")


def recover_command(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="The cut-off or damaged file; it is not changed.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="New file (default: NAME-recovered.mcap).")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write the readable content of a cut-off or damaged recording, or of a part of one, to a new file."""
    from daq import RecordingError
    from daq.logger import is_being_recorded
    from daq.recording import Recording, part_number, part_path, recover

    first, part = part_number(recording)
    clean = part_path(first.with_name(f"{first.stem}-recovered.mcap"), part)
    if is_being_recorded(recording) and not Recording.open(recording).contents.has_summary:
        raise RecordingError.of(
            "a logger is still recording into this file",
            recording,
            next_step="end the run first; every other command reads the part written so far",
        )
    target = check_output(output or clean, force=force)
    done = recover(recording, target, overwrite=force)
    loss = [str(item) for item in done.loss]
    if json:
        print_json({"recording": done.path, "chunks": done.chunk_count, "loss": loss})
    else:
        print_pairs(
            [("recording", str(done.path)), ("chunks saved", str(done.chunk_count)), *(("lost", text) for text in loss)]
        )


def sample_command(
    name: Annotated[Literal["clay"], typer.Argument(metavar="NAME", help="Which one: clay.")] = "clay",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write. [default: NAME here]")
    ] = None,
    force: Force = False,
) -> None:
    """Write a sample campaign: recordings of six runs, vehicle.toml, terrain.toml, runs.toml and DBCs.

    Its hidden effect is in manifest.toml only, which no command reads.
    """
    target = output or Path(name)
    if target.exists() and not (target.is_dir() and (force or not any(target.iterdir()))):
        raise ConfigError.of("the output exists already", target, next_step="choose another folder, or --force")
    package = Path(__file__).parents[1]
    places = (package / "_samples", package.parent / "recordings")  # in a wheel, in a checkout
    source = next(place for place in places if place.is_dir()) / name
    shutil.copytree(source, target, copy_function=shutil.copyfile, dirs_exist_ok=True)
    print(target)
    say(f'six runs; next: wheelsoil diagnose "{target}"')
