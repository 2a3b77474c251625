"""``wheelsoil info``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.shown import number
from wheelsoil.cli.options import Json, LenientDbc, Runs, RunsFile, Terrain, Vehicle
from wheelsoil.cli.talk import counter, print_facts, print_json, print_table, say

if TYPE_CHECKING:
    from wheelsoil.facts import FileFacts

_SHOWN_IDS = 20
_LOSS_KINDS = {
    "kernel": "not fetched in time",
    "queue": "given up by the logger",
    "counter": "missing by the counter",
    "missing": "missing by the rate",
}


def command(
    runs: Runs,
    vehicle: Vehicle = None,
    terrain: Terrain = None,
    runs_file: RunsFile = None,
    lenient_dbc: LenientDbc = False,
    all_ids: Annotated[
        bool, typer.Option("--all-ids", help="List every identifier, not only the most frequent.")
    ] = False,
    json: Json = False,
) -> None:
    """Say what a recording holds: parts, buses, frames, rates, identifiers, attachments, marks, drops and losses."""
    from daq.open import open_runs
    from wheelsoil.facts import file_facts

    opened = open_runs(runs, vehicle=vehicle, terrain=terrain, runs=runs_file, lenient_dbc=lenient_dbc, left_out=say)
    facts = []
    for run in opened:
        with counter(f"reading {run.path.name}", "frames") as watch:
            facts.append(file_facts(run, watch))
    if json:
        print_json([_as_json(one) for one in facts])
    else:
        for i, one in enumerate(facts):
            if i:
                print()
            _print(one, None if all_ids else _SHOWN_IDS)
    for one in facts:
        if one.recording_now:
            say(f"{one.file}: still being recorded; it was read as far as it is written")
        elif one.loss and one.kind.startswith("recording"):
            say(f"{one.file}: cut off or damaged; `wheelsoil recover` makes a whole file of what can be read")


def _as_json(facts: FileFacts) -> dict[str, Any]:
    from wheelsoil.plain import plain

    known: dict[str, Any] = plain(facts)
    return known | {
        "gaps": [{**plain(gap), "text": str(gap)} for gap in facts.gaps],
        "recording_now": facts.recording_now,
        "duration_s": plain(facts.duration_s),
        "rate_hz": {bus: plain(facts.rate_hz(bus)) for bus in facts.frames},
        "known_frames": facts.coverage.known,
        "unknown_frames": facts.coverage.unknown,
    }


def _print(facts: FileFacts, shown_ids: int | None) -> None:
    print_facts([(name, text) for name, text in _head(facts) if text])
    if len(facts.parts) > 1:
        print()
        _print_parts(facts)
    if any(facts.losses.values()):
        print()
        _print_losses(facts)
    if facts.events:
        print()
        _print_events(facts)
    if facts.coverage.ids:
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
    from wheelsoil.times import utc

    info = facts.info
    run = f"{facts.run_id} ({info.direction}, pass {info.pass_number}, {info.added_load_kg:g} kg added"
    run += f", {info.inflation_kpa:g} kPa)" if info.inflation_kpa else ")"
    lines = [
        ("file", facts.file),
        (
            "kind",
            f"{facts.kind}, {facts.bytes / 1e6:.3f} MB" + (f", by {facts.written_by}" if facts.written_by else ""),
        ),
        ("sha256", facts.sha256),
        ("run", run),
        ("vehicle", facts.vehicle),
        ("terrain", facts.terrain),
        ("start", utc(facts.start_ns) if facts.start_ns is not None else ""),
        ("duration", f"{facts.duration_s:.3f} s" if facts.start_ns is not None else ""),
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
        ("end", facts.exit_status),
        ("clock", _clock(facts.clock)),
        ("unsure time", _unsure(facts)),
        ("clock steps", ", ".join(f"{key} {text}" for key, text in facts.clock_steps.items())),
    ]
    lines += [("gap", str(gap)) for gap in facts.gaps]
    return lines + [("loss", text) for text in facts.loss] + [("remark", text) for text in facts.remarks]


_CLOCK = (
    ("offset", "offset_s", "offset_sigma_s", "s"),
    ("drift", "drift_ppm", "drift_sigma_ppm", "ppm"),
    ("residual", "residual_s", "", "s"),
    ("epochs", "epochs", "", ""),
)


def _clock(clock: Mapping[str, str]) -> str:
    """Return host time less GNSS time, as the record tells it, in a line."""
    shown = []
    for label, key, sigma_key, unit in _CLOCK:
        if key in clock:
            sigma = f" ± {_shortened(clock[sigma_key])}" if sigma_key in clock else ""
            shown.append(f"{label} {_shortened(clock[key])}{sigma} {unit}".rstrip())
    return ", ".join(shown)


def _unsure(facts: FileFacts) -> str:
    """Return how many frames came while the host's clock was set; empty where none did."""
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


def _print_parts(facts: FileFacts) -> None:
    from wheelsoil.times import utc

    rows = [
        [
            Path(part.file).name,
            f"{part.frames:,}",
            f"{part.bytes / 1e6:.3f}",
            utc(part.start_ns) if part.start_ns is not None else "-",
            part.exit_status or ("still being recorded" if part.recording_now else "cut off"),
        ]
        for part in facts.parts
    ]
    print_table(["part", "frames", "MB", "start", "end"], rows, left=1)


def _print_losses(facts: FileFacts) -> None:
    rows = []
    for key, count in facts.losses.items():
        kind, _, where = key.partition(".")
        if count:
            rows.append([where, _LOSS_KINDS.get(kind, kind), f"{count:,}"])
    print_table(["lost on", "how", "frames"], rows, left=2)


def _print_events(facts: FileFacts) -> None:
    from wheelsoil.times import utc

    rows = [[utc(event.time_ns), event.name, event.severity, event.text.replace("\n", " ")] for event in facts.events]
    print_table(["time", "event", "severity", "text"], rows, left=4)


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
