"""``wheelsoil import`` and ``wheelsoil replay``: frames of a log into a recording, and onto a bus again."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError
from wheelsoil.cli import options
from wheelsoil.console import check_output, counting, print_json, print_pairs, say

if TYPE_CHECKING:
    from daq import RunInfo
    from daq.runs import Configuration
    from daq.series import ImportedSeries
    from daq.sources import ReplaySummary


_OF_A_RUN = {
    "direction": "direction",
    "pass_number": "pass_number",
    "added_load": "added_load_kg",
    "inflation": "inflation_kpa",
}
"""Keys of runs.toml by the option that overrides each."""


def import_command(
    context: typer.Context,
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Logs of one run, in order: candump -L, BLF, ASC, ...; or decoded series: CSV, MAT, ...",
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Recording to write (default: LOG.mcap here).")
    ] = None,
    vehicle: options.Vehicle = None,
    terrain: options.Terrain = None,
    dbc: Annotated[
        list[str] | None,
        typer.Option(metavar="BUS=FILE", help="A DBC of a bus, if there is no vehicle.toml; may be repeated."),
    ] = None,
    bus: Annotated[
        list[str] | None,
        typer.Option(metavar="OLD=NEW", help="Rename a bus of the log to its name in vehicle.toml; may be repeated."),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="KEY=COLUMN,...", help="Columns of a CSV of frames: time=Time,id=MessageID:dec,data=Message."
        ),
    ] = None,
    lenient_dbc: options.LenientDbc = False,
    run_id: options.RunId = None,
    direction: options.DirectionOption = "out",
    pass_number: options.PassNumber = 1,
    added_load: options.AddedLoad = 0.0,
    inflation: options.Inflation = None,
    view_rate: Annotated[
        float, typer.Option(min=0.0, metavar="HZ", help="Rate of the decoded topics; 0: raw frames only.")
    ] = 100.0,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Turn log files of any format, or files of decoded series, into a recording (MCAP) that needs no other file.

    vehicle.toml, terrain.toml and runs.toml beside the (first) log are attached; options override them. The raw frames
    are kept unchanged, bit for bit. Decoded topics are a copy for people and other tools.

    Of decoded series every column is kept at its own rate; [signals] of vehicle.toml names columns instead of signals.
    """
    from daq.logs import import_logs, parse_columns
    from daq.runs import known_beside
    from daq.series import import_series, series_format

    given = options.configuration(vehicle, terrain, options.pairs(dbc, "--dbc", "BUS=FILE"), lenient_dbc=lenient_dbc)
    known = known_beside(logs[0], given, lenient_dbc=lenient_dbc)
    name = logs[0].name.partition(".")[0]
    target = check_output(output or Path(f"{name}.mcap"), force=force)
    info = options.run_info(target.name, run_id or name, direction, pass_number, added_load, inflation)
    info = _completed(info, context, known, logs[0].name)
    frame_columns = parse_columns(columns) if columns else None
    if frame_columns is None and all(map(series_format, logs)):
        with counting("importing", "rows") as watch:
            _print_series(import_series(logs, target, known, run=info, overwrite=force, watch=watch), json)
        return
    with counting("importing", "frames") as watch:
        done = import_logs(
            logs,
            target,
            known,
            run=info,
            rename_buses=dict(options.pairs(bus, "--bus", "OLD=NEW")),
            columns=frame_columns,
            view_rate_hz=view_rate or None,
            overwrite=force,
            watch=watch,
        )
    for remark in done.remarks:
        say(remark)
    facts = {
        "recording": done.path,
        "bytes": done.path.stat().st_size,
        "frames": done.frames,
        "known_frames": done.coverage.known,
        "unknown_frames": done.coverage.unknown,
        "error_frames": done.coverage.error_frames,
        "remote_frames": done.coverage.remote_frames,
        "remarks": done.remarks,
    }
    if json:
        print_json(facts)
    else:
        print_pairs(
            [
                ("recording", f"{done.path} ({done.path.stat().st_size / 1e6:.2f} MB)"),
                *((f"bus {name}", f"{count:,} frames") for name, count in done.frames.items()),
                ("known to the DBCs", f"{done.coverage.known:,} frames"),
                ("unknown", f"{done.coverage.unknown:,} frames"),
            ]
        )


def _print_series(done: ImportedSeries, json: bool) -> None:
    for remark in done.remarks:
        say(remark)
    size = done.path.stat().st_size
    if json:
        print_json(vars(done) | {"recording": done.path, "bytes": size})
        return
    rows = [(topic, f"{done.rows[topic]:,} rows, {len(units)} columns") for topic, units in done.topics.items()]
    print_pairs([("recording", f"{done.path} ({size / 1e6:.2f} MB)"), *rows])


def _completed(info: RunInfo, context: typer.Context, known: Configuration, log: str) -> RunInfo:
    """Return the run information: given options override runs.toml, which overrides the defaults of the options."""
    listed = [run for run in known.runs or () if Path(run.file).name == log]
    if not listed:
        return info
    sources = {key: context.get_parameter_source(option) for option, key in _OF_A_RUN.items()}
    given = [key for key, source in sources.items() if source is not None and source.name != "DEFAULT"]
    name = info.id if context.params["run_id"] else listed[0].id or info.id
    return listed[0].model_copy(update={"file": info.file, "id": name} | {key: getattr(info, key) for key in given})


def replay_command(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A recording, or a log of any format.")],
    interface: Annotated[str, typer.Option(metavar="NAME", help="Interface that python-can knows.")] = "socketcan",
    channel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BUS=CHANNEL",
            help="Send a recorded bus to this channel, and only the named buses; may be repeated.",
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.0, help="1: as recorded; 10: ten times faster; 0: as fast as the bus takes.")
    ] = 1.0,
    start: Annotated[float, typer.Option("--from", metavar="S", help="Start at this second of the recording.")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", metavar="S", help="End at this second of the recording.")] = None,
    loop: Annotated[
        str,
        typer.Option(
            metavar="N|forever", help="Number of repetitions; time continues, data bytes (also counters) repeat."
        ),
    ] = "1",
    fd: Annotated[bool, typer.Option("--fd", help="Open the interface for CAN FD.")] = False,
    json: options.Json = False,
) -> None:
    """Send the frames of a recording onto buses, with the timing they were recorded with; Ctrl-C stops (130)."""
    from daq.sources import replay

    channels = dict(options.pairs(channel, "--channel", "BUS=CHANNEL")) or None
    loops = _loops(loop)
    done = replay(
        recording, interface, channels=channels, speed=speed or None, from_s=start, to_s=end, loops=loops, fd=fd
    )
    _print_summary(done, json)
    if done.interrupted:
        raise KeyboardInterrupt


def _loops(text: str) -> int | None:
    if text == "forever":
        return None
    if not text.isdecimal() or int(text) < 1:
        raise ConfigError.of("--loop is not understood", found=text, expected='a number of at least 1, or "forever"')
    return int(text)


def _print_summary(done: ReplaySummary, json: bool) -> None:
    if done.skipped_error_frames:
        say(f"{done.skipped_error_frames} error frames cannot be sent and were skipped")
    if json:
        print_json(vars(done) | {"cpu_percent": done.cpu_percent})
        return
    facts = [(f"sent to {name}", f"{count:,} frames") for name, count in done.frames.items()]
    repeated = f" in {done.rounds} rounds" if done.rounds > 1 else ""
    facts += [
        ("took", f"{done.duration_s:.2f} s for {done.recorded_duration_s:.2f} s of recording sent{repeated}"),
        ("CPU", f"{done.cpu_s:.2f} s, {done.cpu_percent:.0f} % of a core"),
    ]
    if isfinite(done.lateness_p99_s):
        late = (done.lateness_p50_s, done.lateness_p99_s, done.lateness_max_s)
        facts.append(("late", " / ".join(f"{1e3 * value:.2f}" for value in late) + " ms (median / 99 % / maximum)"))
    print_pairs(facts)
