"""``wheelsoil simulate``: a campaign folder, or frames on a bus in real time; and ``wheelsoil demo``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from daq import ConfigError, VehicleConfig
from wheelsoil.cli.options import PRESETS, Force, Json, NoCache, keep_results
from wheelsoil.console import computing, print_json, print_pairs, progress, say, terminal_width

if TYPE_CHECKING:
    from model.diagnosis import Diagnosis
    from wheelsoil.simulation.options import SimulationOptions

_CAMPAIGN = "clay"
_CAVEAT = (
    "Simulator and diagnosis share their physics: the demo shows that the program works, not that the model is right. "
    "docs/blind_results.md has results with an independent simulator, docs/real_data.md with real measurements. "
    "docs/diagnosis.md explains every number above: nats, Bayes factors, residuals."
)


def demo_command(
    context: typer.Context,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder.")] = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the hidden effect, the soil and the noise.")] = 10,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 6,
    duration: Annotated[float, typer.Option(metavar="S", help="Duration of each run.")] = 40.0,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Simulate a vehicle with a hidden effect, diagnose its CAN frames, compare with the true value; 15 s to a minute.

    The seed draws a cause of the library (family, form, size, direction), or none. The vehicle drives over a clay
    drawn within the laboratory's uncertainty; its frames are encoded with the DBCs into recordings. Processing and
    diagnosis read these recordings only, first from forces alone, then with ten readings of the rut's depth.
    """
    from wheelsoil.wording.diagnosis_text import diagnosis_lines
    from wheelsoil.wording.verdict import sentence_of
    from wheelsoil.workflows.demo import draw_hidden, open_envelope

    keep_results(context, no_cache)
    _check_folder(output)
    options = _campaign(seed, runs, duration)
    hidden = draw_hidden(seed, options.wheel)
    first, found, vehicle, page, numbers = _simulate_to_report(output, replace(options, effects=hidden.effects))
    opened = open_envelope(hidden, found)
    if json:
        print_json(
            {
                "report": page,
                "numbers": numbers,
                "recordings": output / _CAMPAIGN,
                "result": sentence_of(found),
                "verdict": found.verdict,
                "before_ruts": {"result": sentence_of(first), "verdict": first.verdict},
                "hidden": {"family": hidden.family, "effect": hidden.key, "parameters": hidden.values},
                "outcome": opened.outcome,
                "compared": opened.parameters,
            }
        )
        return
    width = terminal_width()
    before = f"From forces alone. {sentence_of(first)}"
    after = f"With {options.rut} readings of the rut's depth, by a ruler to 5 mm:"
    hidden_text = f"Hidden effect. {opened.sentence} {_CAVEAT}"
    told = [*wrap(after, width), *diagnosis_lines(found, vehicle, width)]
    for paragraph in (wrap(before, width), told, wrap(hidden_text, width)):
        say("\n".join(["", *paragraph]))
    print_pairs([("report", str(page)), ("numbers", str(numbers)), ("recordings", str(output / _CAMPAIGN))])


def _campaign(seed: int, runs: int, duration_s: float) -> SimulationOptions:
    """Return the options of the simulation, without the hidden effect."""
    from wheelsoil.simulation.options import SimulationOptions

    return SimulationOptions(
        runs=runs,
        duration_s=duration_s,
        seed=seed,
        draw_soil=True,
        pass_number=(1, 1, 1, 2, 2, 2),
        inflation_kpa=(340.0, 340.0, 250.0, 250.0),
        rut=10,
    )


def _simulate_to_report(
    output: Path, options: SimulationOptions
) -> tuple[Diagnosis, Diagnosis, VehicleConfig, Path, Path]:
    """Run everything from frames to the report.

    Returns the diagnosis from forces alone, that with rut readings, the vehicle, and the paths of the report's page and
    numbers.
    """
    from processing import ProcessOptions
    from wheelsoil.simulation.campaign import simulate_campaign
    from wheelsoil.workflows import (
        Diagnosed,
        Files,
        FitChoices,
        campaigns_of,
        diagnose_campaigns,
        diagnosis_options,
        fit_runs,
        open_and_process,
        report_of_processed,
    )
    from wheelsoil.workflows.demo import without_ruts

    folder = output / _CAMPAIGN
    choices, process_options = FitChoices(), ProcessOptions(purpose="diagnose")
    with _step("simulate and record"):
        output.mkdir(parents=True, exist_ok=True)
        simulated = simulate_campaign(folder, options, force=True)
    say(f"  {options.runs} runs, {simulated.frames:,} frames in {folder}")
    with _step("decode and process"):
        processed = open_and_process([folder], process_options, Files(accept_implausible=True))
    with _step("diagnose from forces"), computing("diagnosing"):
        unread = [(run, without_ruts(processed_run)) for run, processed_run in processed]
        first = diagnose_campaigns(campaigns_of([folder], unread), diagnosis_options())
    with _step("diagnose with rut readings"), computing("diagnosing"):
        found = diagnose_campaigns(campaigns_of([folder], processed), diagnosis_options())
    with _step("fit four models"), computing("fitting"):
        fit = fit_runs(processed, choices, None, keep_predictions=True)
    with _step("write the report"):
        report = report_of_processed(processed, choices, process_options, campaign=fit, diagnosed=Diagnosed(found))
        page, numbers = report.write(output / "report.html")
    return first, found, processed[0][0].vehicle, page, numbers


@contextmanager
def _step(name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    say(f"{name}: {time.perf_counter() - start:.1f} s")


def _check_folder(output: Path) -> None:
    """Reject a folder with a campaign that is not a demo."""
    from wheelsoil.simulation.campaign import MANIFEST_FILE

    campaign = output / _CAMPAIGN
    if campaign.is_dir() and any(campaign.iterdir()) and not (campaign / MANIFEST_FILE).is_file():
        raise ConfigError.of(
            "the folder contains files that are not from a demo", campaign, next_step="choose another: -o FOLDER"
        )


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
            help="An effect of wheel or soil beyond Wong's model, or of a sensor (NAME@FR: at that wheel); repeatable.",
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", metavar="FILE", help="Soil, wheel, --sinkage and effects of a model written by `diagnose -o`."
        ),
    ] = None,
    sinkage: Annotated[
        Literal["balanced", "literal"], typer.Option(help="Slip-sinkage laws load-consistent or as published.")
    ] = "balanced",
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
    wheels: Annotated[
        int, typer.Option("--wheels", metavar="N", help="Instrumented wheels: 1 (rear left), 2 (left) or 4.")
    ] = 1,
    faulty_wheel: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Sensor effects are of this wheel only: FL, FR, RL or RR. [default: of all]"),
    ] = None,
    draw_soil: Annotated[
        bool, typer.Option("--draw-soil", help="Draw the true soil from the laboratory's uncertainty.")
    ] = False,
    wheel_axes: Annotated[
        bool, typer.Option("--wheel-axes", help="The transducer sends forces in axes that rotate with the wheel.")
    ] = False,
    tilt: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Tilt of the ground, uphill on out. [default: drawn, up to 0.3 either way]"),
    ] = None,
    steering: Annotated[
        float, typer.Option(metavar="DEG", help="Drive a slalom: largest angle of the front wheels. No lateral force.")
    ] = 0.0,
    brakes: Annotated[
        Literal["held", "released"] | None,
        typer.Option(help="At every standstill. [default: drawn, held in 7 of 10 campaigns]", show_default=False),
    ] = None,
    lifted: Annotated[
        bool, typer.Option("--lifted", help="Also record the lifted wheel before and after the runs, for `zero`.")
    ] = False,
    rut: Annotated[
        int,
        typer.Option(metavar="N", help="Readings of the rut's depth in runs.toml, +-5 mm, over slips from .05 to .8."),
    ] = 0,
    noise: Annotated[float, typer.Option(help="Factor on every sensor's noise; 0 for ideal sensors.")] = 1.0,
    transducer_rate: Annotated[float, typer.Option(metavar="HZ", help="Of the transducers' messages.")] = 1000.0,
    start: Annotated[
        str | None, typer.Option(metavar="TIME", help="UTC of the first run, ISO 8601; with --live: now.")
    ] = None,
    kind: Annotated[
        Literal["mcap", "candump", "both"], typer.Option("--format", help="File format of the runs.")
    ] = "mcap",
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
        raise ConfigError.of("nothing to do", next_step="give a folder to write with -o, or --live an interface")
    from model.wheel_soil import Wheel
    from wheelsoil.simulation import SimulationOptions, simulate_campaign

    if live is not None and wheels > 1:
        raise ConfigError.of("--live sends one wheel", found=f"--wheels {wheels}", next_step="omit one of the two")
    options = SimulationOptions(
        soil=soil,
        effects=_effects(effect or []),
        reading=sinkage,
        runs=runs,
        duration_s=duration,
        seed=seed,
        added_load_kg=tuple(added_load) if added_load else (0.0, 300.0, 500.0),
        pass_number=tuple(pass_number) if pass_number else (1,),
        inflation_kpa=tuple(inflation or ()),
        wheel=Wheel(radius, width),
        wheels=wheels,
        faulty_wheel="" if model else faulty_wheel or "",
        draw_soil=draw_soil,
        wheel_axes=wheel_axes,
        tilt_deg=tilt,
        steering_deg=steering,
        brakes=brakes,
        lifted=lifted,
        rut=rut,
        noise=noise,
        transducer_rate_hz=transducer_rate,
        start=_start(start, live=live is not None),
    )
    if model is not None:
        from wheelsoil.simulation.options import with_model

        options = with_model(options, model, _given(ctx), faulty_wheel or "")
    if options.model_set:
        say(f"drives set {options.model_set}, without errors of measurement")
    _warn_of_inactive_effects(options)
    if output is not None:
        campaign = simulate_campaign(output, options, kind=kind, decoded=decoded, force=force)
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
            raise ConfigError.of(f"effect {name} is given twice", next_step="give it once, with all its parameters")
        effects[name] = values
    return effects


def _warn_of_inactive_effects(options: SimulationOptions) -> None:
    from model.effects import EFFECTS

    for name in options.effects:
        needs = EFFECTS[name].needs
        if needs.several_passes and set(options.pass_number) == {1} and options.wheels == 1:
            say(f"{name} acts from the second pass on, but every run is a first pass: add --pass-number 2")
        if needs.roles:
            say(f"{name} cannot be diagnosed from this campaign: no signal for {', '.join(needs.roles)} is simulated")


def _start(text: str | None, *, live: bool) -> datetime:
    from wheelsoil.simulation.options import DEFAULT_START

    if text is None:
        return datetime.now(UTC) if live else DEFAULT_START
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ConfigError.of(
            "the start is not a time", found=text, expected="ISO 8601, e.g. 2026-05-04T08:00:00Z"
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
            # in full beforehand: the bus must not wait for the simulation
            summary = replay_batches(list(frames), {BUS: sink}, speed=speed)
            say(
                f"{run.id}: {sum(summary.frames.values())} frames in {summary.duration_s:.1f} s, "
                f"99 % at most {summary.lateness_p99_s * 1e3:.2f} ms late"
            )
    finally:
        sink.close()
