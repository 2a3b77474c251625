"""``wheelsoil process``, ``wheelsoil fit`` and ``wheelsoil sinkage``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq import OUTPUTS, number
from wheelsoil.cli import options
from wheelsoil.cli.per_wheel import PerWheel, print_set_aside
from wheelsoil.console import (
    check_output,
    computing,
    folded,
    print_json,
    print_pairs,
    print_table,
    say,
    say_folded,
    terminal_width,
)

if TYPE_CHECKING:
    from daq import Fault
    from daq.runs import Run, SetAsideRun
    from model.fit import CampaignFit
    from processing import ProcessedRun
    from wheelsoil.workflows.diagnosis import Processed
    from wheelsoil.workflows.sinkage import SinkageFacts

_BLOCK_ROWS = 1 << 16
_NO_LAW = "the wheels differ in radius or width: no law is fitted to all of them"


def process_command(
    context: typer.Context,
    runs: options.Runs,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Write the table: .parquet, .csv or .mat; all runs in one."
        ),
    ] = None,
    vehicle: options.Vehicle = None,
    wheel: options.Wheel = None,
    terrain: options.Terrain = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    lenient_dbc: options.LenientDbc = False,
    accept_implausible: options.AcceptImplausible = False,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Rate of the common time base.")] = 100.0,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Bring each run onto one time base and print a summary: slip, forces, segments, quality."""
    from wheelsoil.workflows.runs import Files, noted_in, process_runs

    target = check_output(output, force=force) if output else None
    by_hand = options.chosen(context)
    settings = by_hand.process_options(rate_hz=rate)
    files = Files(
        vehicle, terrain, runs_file, zero, lenient_dbc=lenient_dbc, accept_implausible=accept_implausible, wheel=wheel
    )
    unreadable: list[SetAsideRun] = []
    of_wheels: dict[str, Processed] = {}
    aside: list[tuple[str, SetAsideRun]] = []
    wheels = PerWheel(files.runs_of_wheels(runs, noted_in(unreadable)), json=json, unreadable=unreadable)

    def work(of_wheel: list[Run]) -> None:
        of_wheels[wheels.wheel] = process_runs(
            of_wheel,
            settings,
            zero=zero,
            choice=by_hand,
            accept_implausible=accept_implausible,
            set_aside=wheels.set_aside,
        )
        aside.extend((wheels.wheel, run) for run in wheels.set_aside_runs)

    try:
        wheels.each(work)
    finally:
        if found := [(wheel, run) for wheel, processed in of_wheels.items() for _, run in processed]:
            wheels.doubt(of_wheels)
            _show_processed(found, aside, target, wheels.doubts, json=json)


def _show_processed(
    found: Sequence[tuple[str, ProcessedRun]],
    aside: Sequence[tuple[str, SetAsideRun]],
    target: Path | None,
    doubts: Sequence[Fault],
    *,
    json: bool,
) -> None:
    from wheelsoil.wording.notes import noted_of_runs
    from wheelsoil.wording.run_summary import summary_table

    if target:
        _write(target, found)
    if json:
        entries = [(wheel, _as_json(run) | ({"doubts": doubts} if doubts else {})) for wheel, run in found]
        entries += [(w, {"run": {"id": r.run}, "samples": 0, "used": 0, "set_aside": r.facts()}) for w, r in aside]
        print_json([({"wheel": wheel} if wheel else {}) | entry for wheel, entry in entries])
        return
    for i, (wheel, run) in enumerate(found):
        if i:
            print()
        print_pairs([*([("wheel", wheel)] if wheel else []), *summary_table(run)])
    names = [f"{run.run.id}, wheel {wheel}" if wheel else run.run.id for wheel, run in found]
    for text in noted_of_runs([(name, run.quality.notes) for name, (_, run) in zip(names, found, strict=True)]):
        say_folded(text)
    print_set_aside([run for _, run in aside])


def _as_json(run: ProcessedRun) -> dict[str, Any]:
    from wheelsoil.wording.run_summary import summary_table

    return {
        "run": run.run,
        "samples": len(run),
        "used": int(run.used.sum()),
        "rate_hz": run.rate_hz,
        "cutoff_hz": run.cutoff_hz,
        "start_ns": run.start_ns,
        "duration_s": len(run) / run.rate_hz,
        "quality": run.quality,
        "summary": dict(summary_table(run)),
    }


def _write(target: Path, found: Sequence[tuple[str, ProcessedRun]]) -> None:
    from daq.series import write_blocks
    from processing import units_of

    units = {name: unit for _, run in found for name, unit in units_of(run).items()}
    write_blocks(target, _blocks(found, units), units)
    say(f"wrote {target}")


def _blocks(found: Sequence[tuple[str, ProcessedRun]], names: Iterable[str]) -> Iterator[dict[str, Any]]:
    import numpy as np

    from processing import block_of

    for wheel, run in found:
        for start in range(0, len(run), _BLOCK_ROWS):
            columns = block_of(run, names, slice(start, start + _BLOCK_ROWS))
            count = len(columns["time_ns"])
            of_wheel = {"wheel": np.full(count, wheel)} if wheel else {}
            yield {"run": np.full(count, run.run.id), **of_wheel, **columns}


def fit_command(
    context: typer.Context,
    runs: options.RunsIfAny = None,
    table: options.TableFile = None,
    rename: options.Rename = None,
    where: options.Where = None,
    vehicle: options.Vehicle = None,
    wheel: options.Wheel = None,
    terrain: options.Terrain = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    soil: options.SoilPreset = None,
    choice: options.ChoiceFile = None,
    model: options.ModelFile = None,
    apart: options.Apart = False,
    lenient_dbc: options.LenientDbc = False,
    accept_implausible: options.AcceptImplausible = False,
    json: options.Json = False,
) -> None:
    """Fit Wong's model and the slip-sinkage laws of Vasil'ev, Lyasko and Ding.

    Prints the coefficients with their 95 % intervals, M0, R0 and R2 above the slip threshold, and the load that Eq. 7
    gives for each model's sinkage, relative to the measured one. Of several wheels also of all together: one law.
    """
    from wheelsoil.workflows import read_bench
    from wheelsoil.workflows.fit import SCHEMA, fit_as_json, fit_runs, fit_table, of_one_size, one_terrain
    from wheelsoil.workflows.model_files import models_of_wheels
    from wheelsoil.workflows.runs import Files, noted_in

    options.refuse_two_sources(runs or (), table, choice, wheel, [*(rename or ()), *(where or ())], "fit")
    by_hand = options.chosen(context)
    files = Files(
        vehicle,
        terrain,
        runs_file,
        zero,
        soil,
        lenient_dbc=lenient_dbc,
        accept_implausible=accept_implausible,
        wheel=wheel,
    )
    if table is not None:
        wheel_test = read_bench(table, files, rename=rename, where=where)
        options.say_doubted_soils([wheel_test.terrain])
        choices = by_hand.fit_choices(models_of_wheels(model, [""])[""])
        with computing("fitting"):
            fit = fit_table(wheel_test.rows, wheel_test.wheel, wheel_test.soil, choices, wheel_test.terrain)
        _show_fit_of_table(fit, json=json)
        return
    unreadable: list[SetAsideRun] = []
    opened = files.runs_of_wheels(runs or (), noted_in(unreadable))
    models = models_of_wheels(model, opened)
    wheels = PerWheel(opened, json=json, unreadable=unreadable)

    of_wheels: dict[str, Processed] = {}

    def work(of_wheel: list[Run]) -> None:
        processed = wheels.processed(by_hand.fit_choices().purpose, of_wheel, files, by_hand, one_terrain)
        fitted(processed)
        of_wheels[wheels.wheel] = processed

    def fitted(processed: Sequence[tuple[Run, ProcessedRun]]) -> None:
        with computing("fitting"):
            found = fit_runs(processed, by_hand.fit_choices(models[wheels.wheel]), soil)
        wheels.show(lambda: fit_as_json(found), lambda: print_fit(found))

    def together() -> None:
        wheels.doubt(of_wheels)
        of_all = [each for processed in of_wheels.values() for each in processed]
        if model and not models[wheels.wheel]:
            say("a cause of --model acts at one wheel alone: its model is not fitted to all wheels")
        if of_one_size(run for run, _ in of_all):
            fitted(of_all)
        else:
            say(_NO_LAW)
            if json:
                wheels.show(lambda: {"schema": SCHEMA, "notes": [_NO_LAW], "models": {}}, lambda: None)

    wheels.each(work, None if apart else together)


def _show_fit_of_table(fit: CampaignFit, *, json: bool) -> None:
    from wheelsoil.workflows.fit import fit_as_json

    comparison = _sinkages(fit)
    if json:
        print_json(fit_as_json(fit) | ({"sinkage": comparison} if comparison else {}))
        return
    print_fit(fit)
    if comparison:
        _print_sinkages(comparison)


def print_fit(fit: CampaignFit) -> None:
    """Print coefficients and criteria as tables, warnings on stderr."""
    from wheelsoil.wording.fit_text import coefficients, criteria_table, remarks
    from wheelsoil.workflows.fit import NOT_AT_AN_END, ended

    print_table(*coefficients(fit), left=2)
    for channel in OUTPUTS:
        head, rows = criteria_table(fit, channel)
        if rows:
            print()
            print_table(head, rows)
    for text in remarks(fit):
        say_folded(text)
    if not all(ended(model) for model in fit.models):
        say(f"  next: {NOT_AT_AN_END}")


def _sinkages(fit: CampaignFit) -> dict[str, Any] | None:
    """Return the sinkage that each model predicts beside the measured one; None if it was not measured."""
    import numpy as np

    observed = fit.observations
    if not np.isfinite(observed.sinkage_m).any():
        return None
    driven = (observed.slip >= 0) & np.isfinite(observed.sinkage_m)
    predictions = {}
    for model in fit.models:
        forward = fit.options.forward(fit.wheel, fit.soil, model.name)
        predictions[model.name] = forward.predict(observed.conditions, model.values).sinkage_m[driven]
    errors = {name: values - observed.sinkage_m[driven] for name, values in predictions.items()}
    return {
        "slip": observed.slip[driven],
        "measured_m": observed.sinkage_m[driven],
        "predicted_m": predictions,
        "mean_error_m": {name: float(np.nanmean(error)) for name, error in errors.items()},
        "rms_error_m": {name: float(np.sqrt(np.nanmean(error**2))) for name, error in errors.items()},
    }


def _print_sinkages(comparison: dict[str, Any]) -> None:
    models = list(comparison["predicted_m"])
    print()
    rows = [
        [number(slip, 3), number(1e3 * measured), *(number(1e3 * comparison["predicted_m"][m][i]) for m in models)]
        for i, (slip, measured) in enumerate(zip(comparison["slip"], comparison["measured_m"], strict=True))
    ]
    rows.append(["rms error", "", *(number(1e3 * comparison["rms_error_m"][m]) for m in models)])
    print_table(["sinkage mm at slip", "measured", *models], rows)


def sinkage_command(
    context: typer.Context,
    runs: options.RunsIfAny = None,
    table: options.TableFile = None,
    rename: options.Rename = None,
    where: options.Where = None,
    vehicle: options.WheelFiles = None,
    wheel: options.Wheel = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    lenient_dbc: options.LenientDbc = False,
    accept_implausible: options.AcceptImplausible = False,
    json: options.Json = False,
) -> None:
    """Estimate the sinkage of a driven wheel without a sinkage sensor.

    Load, drawbar pull, torque and radius give the sinkage with a 95 % band in bins of slip, and its growth with slip.
    A measured sinkage is printed beside it, and every driven row is checked against a bound that holds on every soil.
    """
    from wheelsoil.workflows.runs import Files, noted_in
    from wheelsoil.workflows.sinkage import sinkage_as_json, sinkage_of_runs, sinkage_of_table
    from wheelsoil.workflows.tables import read_wheels

    options.refuse_two_sources(runs or (), table, None, wheel, [*(rename or ()), *(where or ())], "evaluate")
    if table is not None:
        read = read_wheels([table], tuple(vehicle or ()), rename=rename, where=where)
        by_name = {found.name if len(read) > 1 else "": found for found in read}
        of_table = PerWheel({name: [] for name in by_name}, json=json)

        def show(_: list[Run]) -> None:
            facts = sinkage_of_table(by_name[of_table.wheel].rows, by_name[of_table.wheel].section)
            of_table.show(lambda: sinkage_as_json(facts), lambda: print_sinkage(facts))

        of_table.each(show)
        return
    vehicle_file = options.one_file(vehicle)
    files = Files(
        vehicle_file,
        runs=runs_file,
        zero=zero,
        lenient_dbc=lenient_dbc,
        accept_implausible=accept_implausible,
        wheel=wheel,
    )
    by_hand = options.chosen(context)
    unreadable: list[SetAsideRun] = []
    wheels = PerWheel(files.runs_of_wheels(runs or (), noted_in(unreadable)), json=json, unreadable=unreadable)

    def work(of_wheel: list[Run]) -> None:
        found = sinkage_of_runs(wheels.processed("sinkage", of_wheel, files, by_hand))
        wheels.show(lambda: sinkage_as_json(found), lambda: print_sinkage(found))

    wheels.each(work)


def print_sinkage(facts: SinkageFacts) -> None:
    """Print the table of sinkage against slip, its growth and the bound; notes on stderr."""
    from wheelsoil.workflows.sinkage import (
        IN_THE_BAND,
        agreement_sentence,
        growth_rows,
        growth_sentence,
        unknown_sentence,
    )

    measured = any(slip_bin.measured_m == slip_bin.measured_m for slip_bin in facts.bins)
    head = ["slip", "load N", "sinkage mm", "95 % band", "noise mm", *(["measured mm"] if measured else []), "samples"]
    rows = [
        [
            f"{slip_bin.slip:.2f}",
            f"{slip_bin.vertical_load_n:.0f}" if slip_bin.vertical_load_n >= 100 else number(slip_bin.vertical_load_n),
            "-" if (found := facts.number_m(slip_bin)) is None else number(1e3 * found, 3),
            "withdrawn"
            if facts.withdrawn
            else " .. ".join(number(1e3 * end, 3) for end in slip_bin.sinkage_m.interval95),
            number(1e3 * slip_bin.noise_m, 2),
            *([number(1e3 * slip_bin.measured_m, 3)] if measured else []),
            f"{slip_bin.samples}",
        ]
        for slip_bin in facts.bins
    ]
    print_table(head, rows)
    if unknown := unknown_sentence(facts):
        print("\n".join(folded(unknown, terminal_width())))
    print()
    grown = growth_rows(facts.growth)
    if grown:
        print_table(["growth from no slip to full slip", "mm", "95 % interval"], grown)
    print(growth_sentence(facts.growth))
    if facts.agreement is not None:
        print("\n".join(folded(agreement_sentence(facts.agreement), terminal_width())))
    if facts.checked:
        print(f"bound T/r - Dp <= W tan(theta_1): {_bound(facts)}")
    else:
        say("no measured sinkage: the bound T/r - Dp <= W tan(theta_1) cannot be checked")
    for note in (IN_THE_BAND, *facts.notes):
        say(note)


def _bound(facts: SinkageFacts) -> str:
    from wheelsoil.wording.notes import note_text

    if not facts.inconsistent:
        return f"satisfied in all {facts.checked} driven rows with measured sinkage"
    return "; ".join(f"violated, suspect {item.channel}: {note_text(item.why)}" for item in facts.inconsistent)
