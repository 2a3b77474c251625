"""``wheelsoil replay``."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.errors import ConfigError, Fault
from wheelsoil.cli.options import Json
from wheelsoil.cli.talk import print_facts, print_json, say

if TYPE_CHECKING:
    from daq.player import ReplaySummary


def command(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A recording, or a log of any format.")],
    interface: Annotated[str, typer.Option(metavar="NAME", help="Interface that python-can knows.")] = "socketcan",
    channel: Annotated[
        list[str] | None,
        typer.Option(metavar="BUS=CHANNEL", help="Send a recorded bus there, and only those named; may be repeated."),
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.0, help="1: as recorded; 10: ten times faster; 0: as fast as the bus takes.")
    ] = 1.0,
    start: Annotated[float, typer.Option("--from", metavar="S", help="From this second of the recording on.")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", metavar="S", help="Up to this second of it.")] = None,
    loop: Annotated[
        str, typer.Option(metavar="N|forever", help="How often; time goes on, data bytes (counters too) repeat.")
    ] = "1",
    fd: Annotated[bool, typer.Option("--fd", help="Open the interface for CAN FD.")] = False,
    json: Json = False,
) -> None:
    """Send the frames of a recording onto buses, with the timing they were recorded with; Ctrl-C ends it (130)."""
    from daq.replay import replay
    from wheelsoil.cli.vehicles import pairs

    channels = dict(pairs(channel, "--channel", "BUS=CHANNEL")) or None
    loops = _loops(loop)
    done = replay(
        recording, interface, channels=channels, speed=speed or None, from_s=start, to_s=end, loops=loops, fd=fd
    )
    _tell(done, json)
    if done.interrupted:
        raise KeyboardInterrupt


def _loops(text: str) -> int | None:
    if text == "forever":
        return None
    if not text.isdecimal() or int(text) < 1:
        raise ConfigError(
            Fault("--loop is not understood", found=text, expected='a number of at least 1, or "forever"')
        )
    return int(text)


def _tell(done: ReplaySummary, json: bool) -> None:
    if done.skipped_error_frames:
        say(f"{done.skipped_error_frames} error frames cannot be sent and were left out")
    if json:
        print_json(vars(done) | {"cpu_percent": done.cpu_percent})
        return
    facts = [(f"sent to {name}", f"{count:,} frames") for name, count in done.frames.items()]
    rounds = f" in {done.rounds} rounds" if done.rounds > 1 else ""
    facts.append(("took", f"{done.duration_s:.2f} s for {done.recorded_duration_s:.2f} s of recording sent{rounds}"))
    facts.append(("CPU", f"{done.cpu_s:.2f} s, {done.cpu_percent:.0f} % of a core"))
    if isfinite(done.lateness_p99_s):
        late = (done.lateness_p50_s, done.lateness_p99_s, done.lateness_max_s)
        facts.append(("late", " / ".join(f"{1e3 * value:.2f}" for value in late) + " ms (median / 99 % / most)"))
    print_facts(facts)
