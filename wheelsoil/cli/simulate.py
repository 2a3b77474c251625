"""``wheelsoil simulate``: a campaign folder, or frames on a bus in real time."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, Fault
from wheelsoil.cli.console import progress, say
from wheelsoil.cli.options import PRESETS, Force

if TYPE_CHECKING:
    from wheelsoil.simulation.options import SimulationOptions


class Format(StrEnum):
    """File format of the runs."""

    mcap = "mcap"
    candump = "candump"
    both = "both"


class Reading(StrEnum):
    """Interpretation of the slip-sinkage laws: balanced is load-consistent, literal is as published."""

    balanced = "balanced"
    literal = "literal"


def simulate_command(
    ctx: typer.Context,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Campaign folder to write.")
    ] = None,
    soil: Annotated[str, typer.Option(help=f"A preset ({PRESETS}) or a terrain.toml.")] = "clay",
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[:KEY=VALUE,...]",
            help="An effect of wheel or soil beyond Wong's model, or of a sensor; repeatable.",
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", metavar="FILE", help="Soil, wheel, --sinkage and effects of a model written by `diagnose -o`."
        ),
    ] = None,
    sinkage: Annotated[
        Reading, typer.Option(help="Slip-sinkage laws load-consistent or as published.")
    ] = Reading.balanced,
    runs: Annotated[int, typer.Option(help="Number of runs.")] = 6,
    duration: Annotated[float, typer.Option(metavar="SECONDS", help="Duration of each run.")] = 40.0,
    seed: Annotated[int, typer.Option(help="The same seed gives the same frames.")] = 0,
    added_load: Annotated[
        list[float] | None,
        typer.Option(metavar="KG", help="Added mass; repeatable, used in turn. [default: 0, 300, 500]"),
    ] = None,
    pass_number: Annotated[
        list[int] | None, typer.Option(metavar="N", help="Pass over the track; repeatable, used in turn. [default: 1]")
    ] = None,
    inflation: Annotated[
        list[float] | None,
        typer.Option(metavar="KPA", help="Tyre pressure stated in runs.toml; repeatable, used in turn."),
    ] = None,
    radius: Annotated[float, typer.Option(metavar="M", help="Wheel radius.")] = 0.47,
    width: Annotated[float, typer.Option(metavar="M", help="Wheel width.")] = 0.318,
    draw_soil: Annotated[
        bool, typer.Option("--draw-soil", help="Draw the true soil from the laboratory's uncertainty.")
    ] = False,
    wheel_axes: Annotated[
        bool, typer.Option("--wheel-axes", help="The transducer sends forces in axes that rotate with the wheel.")
    ] = False,
    noise: Annotated[float, typer.Option(help="Factor on every sensor's noise; 0 for ideal sensors.")] = 1.0,
    start: Annotated[
        str | None, typer.Option(metavar="TIME", help="UTC of the first run, ISO 8601; with --live: now.")
    ] = None,
    kind: Annotated[Format, typer.Option("--format", help="File format of the runs.")] = Format.mcap,
    decoded: Annotated[
        bool, typer.Option("--decoded", help="Write decoded topics beside the raw frames, for other tools.")
    ] = False,
    live: Annotated[
        str | None, typer.Option(metavar="INTERFACE", help="Send the frames in real time, e.g. socketcan.")
    ] = None,
    channel: Annotated[str, typer.Option(help="Channel of the interface.")] = "can0",
    speed: Annotated[float, typer.Option(help="With --live: factor of speed over real time.")] = 1.0,
    force: Force = False,
) -> None:
    """Drive a simulated instrumented vehicle over a soil.

    Writes a campaign folder for process, fit and report. Only its manifest.toml contains the true values.
    """
    if output is None and live is None:
        raise ConfigError(Fault("nothing to do", next_step="give a folder to write with -o, or --live an interface"))
    from model.wheel_soil import Wheel
    from wheelsoil.simulation.campaign import simulate_campaign
    from wheelsoil.simulation.options import SimulationOptions

    options = SimulationOptions(
        soil=soil,
        effects=_effects(effect or []),
        reading=sinkage.value,
        runs=runs,
        duration_s=duration,
        seed=seed,
        added_load_kg=tuple(added_load) if added_load else (0.0, 300.0, 500.0),
        pass_number=tuple(pass_number) if pass_number else (1,),
        inflation_kpa=tuple(inflation or ()),
        wheel=Wheel(radius, width),
        draw_soil=draw_soil,
        wheel_axes=wheel_axes,
        noise=noise,
        start=_start(start, live=live is not None),
    )
    if model is not None:
        from wheelsoil.simulation.options import with_model

        options = with_model(options, model, _given(ctx))
    _warn_of_inactive_effects(options)
    if output is not None:
        campaign = simulate_campaign(output, options, kind=kind.value, decoded=decoded, force=force)
        say(f"{options.runs} runs, {campaign.frames} frames")
        print(campaign.folder)
    if live is not None:
        _send(options, live, channel, speed)


def _given(ctx: typer.Context) -> list[str]:
    """Return the names of the options given on the command line."""
    return [name for name in ctx.params if getattr(ctx.get_parameter_source(name), "name", "") == "COMMANDLINE"]


def _effects(texts: list[str]) -> dict[str, dict[str, float]]:
    from wheelsoil.simulation.options import parse_effect

    effects: dict[str, dict[str, float]] = {}
    for text in texts:
        name, values = parse_effect(text)
        if name in effects:
            raise ConfigError(Fault(f"effect {name} is given twice", next_step="give it once, with all its parameters"))
        effects[name] = values
    return effects


def _warn_of_inactive_effects(options: SimulationOptions) -> None:
    from model.effects import EFFECTS

    if set(options.pass_number) == {1}:
        for name in options.effects:
            if EFFECTS[name].needs.several_passes:
                say(f"{name} acts from the second pass on, but every run is a first pass: add --pass-number 2")


def _start(text: str | None, *, live: bool) -> datetime:
    from wheelsoil.simulation.options import DEFAULT_START

    if text is None:
        return datetime.now(UTC) if live else DEFAULT_START
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ConfigError(
            Fault("the start is not a time", found=text, expected="ISO 8601, e.g. 2026-05-04T08:00:00Z")
        ) from None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _send(options: SimulationOptions, interface: str, channel: str, speed: float) -> None:
    """Send one run after the other, each with its own timing."""
    from daq import BusSection
    from daq.sources import open_sink, replay_batches
    from wheelsoil.simulation.campaign import BUS, campaign_frames

    sink = open_sink(BusSection(channel=channel, interface=interface))
    try:
        for run, frames in progress(campaign_frames(options), "sending", total=options.runs):
            summary = replay_batches([frames], {BUS: sink}, speed=speed)
            say(
                f"{run.info.id}: {sum(summary.frames.values())} frames in {summary.duration_s:.1f} s, "
                f"99 % at most {summary.lateness_p99_s * 1e3:.2f} ms late"
            )
    finally:
        sink.close()
