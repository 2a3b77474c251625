"""``wheelsoil report`` and ``wheelsoil view``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from daq import ConfigError
from wheelsoil.cli import options
from wheelsoil.console import check_output, print_json, print_pairs, say, say_folded
from wheelsoil.wording.names import OMITTED

if TYPE_CHECKING:
    from daq.runs import SetAsideRun
    from wheelsoil.report import Report
    from wheelsoil.workflows.diagnosis import Processed
    from wheelsoil.workflows.last_report import LastReport
    from wheelsoil.workflows.report import Diagnosed, WheelReport


def report_command(
    context: typer.Context,
    runs: options.RunsIfAny = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="The report; its numbers are written to FILE.json. [default: report.html]",
            show_default=False,
        ),
    ] = None,
    form: Annotated[
        Literal["html", "pdf"] | None,
        typer.Option(
            "--format", help="pdf needs an installed Chromium or Chrome. [default: by the suffix of FILE, else html]"
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
    model: options.ModelFile = None,
    diagnose: Annotated[bool, typer.Option("--diagnosis/--no-diagnosis", help="Whether to diagnose the runs.")] = True,
    against: options.Against = None,
    lenient_dbc: options.LenientDbc = False,
    accept_implausible: options.AcceptImplausible = False,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Write the fitted-model report of a terrain's runs: one page that needs no network, and its numbers as JSON.

    With --table the page is of single-wheel tests. Of a vehicle with several wheels each has a page (report-FL.html),
    and the page of the vehicle leads to them.

    A section whose channel is missing is omitted, with the reason; the other sections are complete. Exit code 1: there
    is no result, neither fit nor diagnosis, or a fault has cost a section or the diagnosis.
    """
    from wheelsoil.workflows import Files, TableFiles, read_benches, report_of_tables
    from wheelsoil.workflows.model_files import models_of_wheels
    from wheelsoil.workflows.report import diagnosed_vehicle, report_of_opened
    from wheelsoil.workflows.runs import noted_in

    options.refuse_two_sources(runs or (), tables, choice, wheel, [*(rename or ()), *(where or ())], "report")
    target, browser = _target(output, form, force=force)
    by_hand = options.chosen(context)
    if tables and against:
        raise ConfigError.of("--against compares reports of driven runs", "--table", next_step="omit one of the two")
    if tables:
        wheels = TableFiles(tuple(vehicle or ()), (terrain,) if terrain else (), soil)
        benches = read_benches(tables, wheels, rename=rename, where=where)
        options.say_doubted_soils(wheel_test.terrain for wheel_test in benches)
        choices = by_hand.fit_choices(models_of_wheels(model, [""])[""])
        report = report_of_tables(benches, choices, diagnose=diagnose)
    else:
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
        unreadable: list[SetAsideRun] = []
        opened = files.runs_of_wheels(runs or (), noted_in(unreadable))
        models = models_of_wheels(model, opened)
        last = {name: _last(against, name) if against else None for name in opened}

        def report_on(name: str) -> tuple[Report, Processed, Diagnosed]:
            return report_of_opened(
                opened[name],
                runs or (),
                by_hand,
                files,
                extended=models[name],
                diagnose=diagnose,
                last=last[name],
                set_aside=unreadable,
            )

        if len(opened) > 1:

            def together(made: Sequence[WheelReport]) -> Diagnosed:
                return diagnosed_vehicle(runs or (), made, by_hand.fit_choices(), soil)

            _report_vehicle(list(opened), report_on, together, target, browser, force=force, json=json)
            return
        report, *_ = report_on(next(iter(opened)))
    entry = _written(report, target, browser)
    if json:
        print_json(entry)
    else:
        print_pairs([("report", str(entry["report"])), ("numbers", str(entry["numbers"]))])
        say(report.sentence)
    _stop_if_failed(report)


def _written(report: Report, target: Path, browser: str) -> dict[str, Any]:
    """Write a report, print what it lacks (stderr), and return what JSON says of it."""
    page, numbers = report.print(target, browser) if browser else report.write(target)
    for key, why in report.left_out.items():
        say(f"section {key} omitted: {why}")
    for other in filter(None, (section.numbers.get("another_thing") for section in report.sections)):
        say(f"--against: {other}")
    if report.not_fitted:
        say_folded(f"not fitted because a signal is missing (the page names it): {report.not_fitted}")
    return {
        "report": page,
        "numbers": numbers,
        **dict.fromkeys(OMITTED, report.left_out),
        "not_fitted": report.not_fitted,
        "failed": report.failed,
        "runs_set_aside": [run.facts() for run in report.set_aside],
        "result": report.sentence,
    }


def _stop_if_failed(report: Report) -> None:
    if report.failed:
        say_folded(f"a fault has cost a part of this report, and the page says why: {', '.join(report.failed)}")
    if report.failed or not report.has_result:
        raise typer.Exit(1)


def _report_vehicle(
    wheels: Sequence[str],
    report_on: Callable[[str], tuple[Report, Processed, Diagnosed]],
    together: Callable[[Sequence[WheelReport]], Diagnosed],
    target: Path,
    browser: str,
    *,
    force: bool,
    json: bool,
) -> None:
    """Write a report of each wheel and the vehicle's page; what is wrong with a wheel is raised when all is written."""
    from daq.runs import Collected
    from wheelsoil.report.vehicle import build_vehicle_report, line_of, vehicle_lines
    from wheelsoil.workflows.report import WheelReport
    from wheelsoil.workflows.vehicle import doubts_of_wheels

    targets = {wheel: target.with_stem(f"{target.stem}-{wheel}") for wheel in wheels}
    for path in targets.values():
        check_output(check_output(path, force=force).with_suffix(".json"), force=force)
    collected, made, entries = Collected(), list[WheelReport](), list[dict[str, Any]]()
    for wheel, path in targets.items():
        say(f"wheel {wheel}")
        with collected.catch(f"wheel {wheel}"):
            report, processed, found = report_on(wheel)
            entries.append({"wheel": wheel, **_written(report, path, browser)})
            made.append(WheelReport(wheel, processed, report, found, path.name))
            continue
        made.append(WheelReport(wheel, why=collected.errors[-1].what))
    if not entries:
        collected.stop_if_any()
    doubts = doubts_of_wheels({each.wheel: each.processed for each in made if each.processed})
    for doubt in doubts:
        say(str(doubt))
    whole = build_vehicle_report(made, together(made).diagnosis, doubts)
    entry = _written(whole, target, browser)
    if json:
        print_json({**entry, "wheels": entries, "doubts": doubts, "vehicle": whole.sections[0].numbers["key_figures"]})
    else:
        pages = [(f"wheel {each['wheel']}", str(each["report"])) for each in entries]
        print_pairs([("report", str(entry["report"])), ("numbers", str(entry["numbers"])), *pages])
        print()
        print_pairs(vehicle_lines(whole))
        print()
        lines = [(f"wheel {each.wheel}", line_of(each)) for each in made]
        print_pairs([*lines, ("all wheels together", whole.sentence)])
    collected.stop_if_any()
    _stop_if_failed(whole)


def _last(place: str, wheel: str = "") -> LastReport | Callable[[Processed], LastReport]:
    """Return the last report, of one of several wheels, or what finds the last campaign in a store."""
    from wheelsoil.workflows.last_report import load_last, store_meant

    url = store_meant(place)
    if url is None:
        return load_last(Path(place), wheel)

    from wheelsoil.fleet import last_campaign, open_store
    from wheelsoil.wording.store_text import damage_lines

    store = open_store(url)

    def find(processed: Processed) -> LastReport:
        found, damaged = last_campaign(store, processed)
        for line in damage_lines(url, damaged):
            say(line)
        return found

    return find


def _target(output: Path | None, form: Literal["html", "pdf"] | None, *, force: bool) -> tuple[Path, str]:
    """Return the file to write and, for a PDF, the browser that prints it."""
    suffix = output.suffix.lower() if output else ""
    pdf = form == "pdf" or (form is None and suffix == ".pdf")
    if output and ((pdf and suffix != ".pdf") or (not pdf and suffix == ".pdf")):
        raise ConfigError.of(
            f"--format {'pdf' if pdf else 'html'} contradicts the output's name",
            output,
            next_step=f"call it {output.with_suffix('.pdf' if pdf else '.html').name}, or omit --format",
        )
    if suffix == ".json":
        what = ".json is the suffix of the numbers beside the report"
        raise ConfigError.of(what, output, next_step="use .html or .pdf")
    target = check_output(output or Path("report.pdf" if pdf else "report.html"), force=force)
    check_output(target.with_suffix(".json"), force=force)
    if not pdf:
        return target, ""
    from wheelsoil.report.build import find_browser

    return target, find_browser()


def view_command(
    context: typer.Context,
    runs: options.Runs,
    vehicle: options.Vehicle = None,
    wheel: options.Wheel = None,
    terrain: options.Terrain = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    soil: options.SoilPreset = None,
    lenient_dbc: options.LenientDbc = False,
    no_cache: options.NoCache = False,
    host: options.PageHost = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, metavar="N", help="Its port (default: 8200, or the next free one).")
    ] = None,
    token_file: options.TokenFile = None,
    against: options.Against = None,
    browser: Annotated[bool, typer.Option(help="Open a browser if there is a display.")] = True,
) -> None:
    """Explore recordings in the browser: select runs and parts of them, adjust parameters, fit, diagnose.

    Runs of one folder, soil and wheel form a campaign. The selection is saved as a file beside the runs; `process`,
    `fit`, `diagnose` and `report` use it with --choice. No data leave this machine.

    Exit codes: 2 usage or configuration; 3 unreadable recording; 4 the port that --port gives is taken, no such
    address; 130 Ctrl-C, 143 SIGTERM.
    """
    from wheelsoil.view.server import serve
    from wheelsoil.workflows import Files, known_soil

    options.keep_results(context, no_cache)
    if soil is not None:
        known_soil(soil, None)
    if against:
        _last(against, wheel or "")
    files = Files(vehicle, terrain, runs_file, zero, soil, lenient_dbc=lenient_dbc, wheel=wheel)
    token = options.page_token(token_file)
    serve(runs, files, host=host, port=port, token=token, browser=browser, say=say, against=against or "")
