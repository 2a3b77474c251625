"""``wheelsoil diagnose``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, VehicleConfig
from wheelsoil.cli import options
from wheelsoil.cli.per_wheel import PerWheel
from wheelsoil.console import check_output, computing, print_json, say, terminal_width

if TYPE_CHECKING:
    from daq.runs import Run, SetAsideRun
    from model.diagnosis import Bench, Diagnosis, DiagnosisOptions, Plan
    from wheelsoil.workflows.diagnosis import Given, Processed


def diagnose_command(
    context: typer.Context,
    runs: options.RunsIfAny = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write the extended model (TOML), of several wheels one; with --plan the matrix of |cos| (CSV).",
        ),
    ] = None,
    tables: options.Tables = None,
    rename: options.Rename = None,
    where: options.Where = None,
    vehicle: options.WheelFiles = None,
    wheel: options.Wheel = None,
    terrain: options.Terrain = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    soil: options.SoilPreset = None,
    choice: options.ChoiceFile = None,
    considered: Annotated[
        str, typer.Option("--channels", help="Channels to use if measured: dp (drawbar pull), t (torque), z (sinkage).")
    ] = "dp,t,z",
    effects: options.Effects = None,
    without: options.Without = None,
    most_causes: Annotated[int, typer.Option(metavar="N", help="Largest set of causes considered, 1 to 3.")] = 3,
    error_of_form: Annotated[
        float | None,
        typer.Option(
            metavar="PERCENT",
            help="With --table: by how much of load, load x radius and radius a right model may be off. "
            "[default: by the repeats; without any 2.5]",
        ),
    ] = None,
    paired: Annotated[
        bool, typer.Option("--paired", help="With two wheels in --table: report what the second one does differently.")
    ] = False,
    apart: options.Apart = False,
    next_run: Annotated[bool, typer.Option("--next-run", help="Rank next runs for every verdict.")] = False,
    plan: Annotated[bool, typer.Option("--plan", help="Report which causes a planned campaign can separate.")] = False,
    planned_runs: Annotated[
        int | None, typer.Option(metavar="N", help="With --plan: number of runs without a runs.toml (6).")
    ] = None,
    planned_duration: Annotated[float, typer.Option(metavar="S", help="With --plan: duration of each run.")] = 40.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the resampling of runs.")] = 0,
    lenient_dbc: options.LenientDbc = False,
    accept_implausible: options.AcceptImplausible = False,
    force: options.Force = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Also probabilities, residuals, detectable sizes, further steps.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Report the error of the simulation, its cause, and the gain when the model is extended by that cause.

    Each folder is a campaign. Several campaigns are diagnosed jointly: causes are shared, soils are not. The verdict is
    a named cause, one of a few candidates, an unexplained misfit, or nothing detectable (with the minimum detectable
    effects). Each verdict ends with exit code 0.

    With --plan, RUN is a folder with vehicle.toml, terrain.toml and runs.toml (direction, added load, pass, inflation
    of each planned run), or --vehicle, --terrain and --runs name them; no recording is read.
    """
    from wheelsoil.wording.notes import texts_of
    from wheelsoil.workflows import (
        TableFiles,
        bench_of,
        campaigns_of,
        defaults_taken,
        diagnosis_options,
        plan_campaigns,
        read_benches,
    )
    from wheelsoil.workflows.diagnosis import vehicles_of
    from wheelsoil.workflows.runs import Files, noted_in

    by_hand = options.chosen(context)
    settings = diagnosis_options(
        by_hand.fit_choices().reading,
        effects=options.split(effects),
        without=options.split(without),
        channels=options.split([considered]),
        most_causes=most_causes,
        seed=seed,
        next_run=next_run,
        error_of_form=error_of_form,
    )
    if (error_of_form is not None or paired) and not tables:
        option = "--paired" if paired else "--error-of-form"
        raise ConfigError.of(f"{option} is of single-wheel tables", next_step="give --table FILE.csv")
    if plan and (tables or zero or choice):
        raise ConfigError.of("--plan reads no measurement", next_step="omit --table, --zero and --choice")
    paths = runs or []
    options.refuse_two_sources(paths, tables, choice, wheel, [*(rename or ()), *(where or ())], "diagnose")
    if tables:
        wheels = TableFiles(tuple(vehicle or ()), (terrain,) if terrain else (), soil)
        read = read_benches(tables, wheels, rename=rename, where=where)
        options.say_doubted_soils(wheel_test.terrain for wheel_test in read)
        benches = tuple(map(bench_of, read))
        if paired:
            _compare(benches, settings, json=json)
        else:
            alone = PerWheel({"": []}, json=json)
            show = partial(_show, alone, {"": VehicleConfig(wheel=read[0].wheel_section)}, verbose, output is not None)
            alone.each(lambda _: _diagnose(benches, settings, output, show, force=force))
        return
    vehicle_file = options.one_file(vehicle)
    files = Files(
        vehicle_file,
        terrain,
        runs_file,
        zero,
        soil,
        lenient_dbc=lenient_dbc,
        accept_implausible=accept_implausible,
        wheel=wheel,
    )
    if plan:
        target = check_output(output, force=force) if output else None
        found = plan_campaigns(paths, files, settings, run_count=planned_runs, duration_s=planned_duration)
        _print_plan(found, target, json=json)
        return
    unreadable: list[SetAsideRun] = []
    per_wheel = PerWheel(files.runs_of_wheels(paths, noted_in(unreadable)), json=json, unreadable=unreadable)
    of_all = per_wheel.several and not apart
    settings = replace(settings, average=output is not None and not of_all)
    if output and of_all:
        check_output(output, force=force)

    of_wheels: dict[str, Processed] = {}
    by_wheel: dict[str, Diagnosis] = {}
    configs: dict[str, VehicleConfig] = {}
    show = partial(_show, per_wheel, configs, verbose, output is not None)

    def work(of_wheel: list[Run]) -> None:
        processed = per_wheel.processed("diagnose", of_wheel, files, by_hand)
        for text in texts_of(defaults_taken(processed, {"direction", "pass_number"})):
            per_wheel.remark(text)
        vehicles = {run.vehicle.model_dump_json(include={"wheel", "sensors"}) for run, _ in processed}
        if len(vehicles) == 1:
            configs[per_wheel.wheel] = processed[0][0].vehicle
        target = output.with_stem(f"{output.stem}-{per_wheel.wheel}") if output and per_wheel.several else output
        by_wheel[per_wheel.wheel] = _diagnose(
            campaigns_of(paths, processed, soil), settings, None if of_all else target, show, processed, force=force
        )
        of_wheels[per_wheel.wheel] = processed

    def together() -> None:
        per_wheel.doubt(of_wheels)
        chosen = replace(settings, average=output is not None)
        processed = [each for of_wheel in of_wheels.values() for each in of_wheel]
        given = vehicles_of(paths, of_wheels, soil)
        found = _diagnose(given, chosen, output, show, processed, force=force, alone=by_wheel)
        if next_run or found.next_run:
            names = {f"wheel {wheel}": wheel for wheel in of_wheels}
            best = next((names[run.campaign] for run in found.next_run), next(iter(of_wheels)))
            say(
                f"next runs are ranked for one wheel at a time ({', '.join(of_wheels)}): "
                f"wheelsoil diagnose FOLDER --wheel {best} --next-run"
            )

    per_wheel.each(work, together if of_all else None)


def _diagnose(
    given: Given,
    settings: DiagnosisOptions,
    output: Path | None,
    show: Callable[[Diagnosis], None],
    processed: Processed = (),
    *,
    force: bool,
    alone: Mapping[str, Diagnosis] | None = None,
) -> Diagnosis:
    from daq.series import write_whole
    from wheelsoil.report.inputs import command_line
    from wheelsoil.workflows.diagnosis import diagnose_given, with_advice
    from wheelsoil.workflows.model_files import model_targets, model_toml, models_of

    targets = model_targets(output, list(dict.fromkeys(each.ground for each in given)), force=force) if output else []
    with computing("diagnosing"):
        diagnosis = diagnose_given(given, settings)
        diagnosis = with_advice(diagnosis, alone) if alone else diagnosis
    written = list(zip(targets, models_of(diagnosis, given, settings.reading, command_line(), processed), strict=False))
    try:
        for path, model in written:
            write_whole(path, model_toml(model))
    finally:
        show(diagnosis)
    for path, model in written:
        none = "it has no effect, because no cause is named"
        note = f"the average of {len(model.sets)} sets of causes" if model.sets else "" if model.effects else none
        say(f"wrote {path}" + (f": {note}" if note else ""))
    return diagnosis


def _compare(benches: Sequence[Bench], settings: DiagnosisOptions, *, json: bool) -> None:
    from model.diagnosis import compare_wheels
    from wheelsoil.wording.wheel_pair_text import wheel_pair_json, wheel_pair_lines

    if len(benches) != 2:
        found = ", ".join(wheel_test.name for wheel_test in benches)
        step = "give two --table, or one with a column wheel or lug_height_m that holds two; --where chooses rows"
        raise ConfigError.of("--paired compares two wheels", found=found, expected="two", next_step=step)
    first, second = benches
    with computing("diagnosing"):
        compared = compare_wheels(first, second, settings)
    if json:
        print_json(wheel_pair_json(compared, first.name, second.name))
        return
    for line in wheel_pair_lines(compared, first.name, second.name, terminal_width()):
        print(line)


def _print_plan(plan: Plan, target: Path | None, *, json: bool) -> None:
    from daq.series import write_whole
    from wheelsoil.wording.diagnosis_json import plan_json
    from wheelsoil.wording.plan_text import matrix_csv, plan_lines

    try:
        if target:
            write_whole(target, matrix_csv(plan))
    finally:
        if json:
            print_json(plan_json(plan))
        else:
            print("\n".join(plan_lines(plan, terminal_width())))
    if target:
        say(f"wrote {target}")


def _show(
    wheels: PerWheel, vehicles: Mapping[str, VehicleConfig], verbose: bool, saved: bool, diagnosis: Diagnosis
) -> None:
    """Print a diagnosis; `vehicles` is by wheel, without one whose runs are of several vehicles."""
    from model.effects import parted
    from wheelsoil.wording.diagnosis_json import diagnosis_json
    from wheelsoil.wording.diagnosis_text import diagnosis_lines
    from wheelsoil.wording.verdict import headline_of

    places = [parted(cause.name)[1] for cause in diagnosis.causes]
    vehicle = vehicles.get(next(filter(None, places), wheels.wheel))

    def print_text() -> None:
        from wheelsoil.report import checks_of

        shown = partial(diagnosis_lines, wheels=vehicles, checks=checks_of(diagnosis), verbose=verbose, saved=saved)
        print("\n".join(shown(diagnosis, vehicle, terminal_width())))

    wheels.show(lambda: diagnosis_json(diagnosis), print_text, headline_of(diagnosis))
