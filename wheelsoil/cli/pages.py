"""``wheelsoil report`` and ``wheelsoil view``."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, Fault
from wheelsoil.cli import options
from wheelsoil.console import check_output, print_json, print_pairs, say, say_folded

if TYPE_CHECKING:
    from wheelsoil.workflows.diagnosis import Processed
    from wheelsoil.workflows.last_report import LastReport


class Format(StrEnum):
    """File format of the report."""

    HTML = "html"
    PDF = "pdf"


def report_command(
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN...", help="Recordings, logs or campaign folders.")
    ] = None,
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
        Format | None,
        typer.Option(
            "--format", help="pdf needs an installed Chromium or Chrome. [default: by the suffix of FILE, else html]"
        ),
    ] = None,
    tables: options.Tables = None,
    rename: options.Rename = None,
    where: options.Where = None,
    vehicle: options.WheelFiles = None,
    wheel: options.OneWheel = None,
    terrain: options.Terrain = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    soil: options.SoilPreset = None,
    choice: options.ChoiceFile = None,
    sinkage: options.Sinkage = None,
    channels: options.Channels = None,
    soil_prior: options.SoilPrior = None,
    slip_threshold: options.SlipThreshold = None,
    model: options.ModelFile = None,
    diagnose: Annotated[bool, typer.Option("--diagnosis/--no-diagnosis", help="Whether to diagnose the runs.")] = True,
    min_speed: options.MinSpeed = None,
    against: options.Against = None,
    jobs: options.Jobs = None,  # noqa: ARG001  # its callback uses it
    no_cache: options.NoCache = False,  # noqa: ARG001  # its callback uses it
    lenient_dbc: options.LenientDbc = False,
    accept_implausible: options.AcceptImplausible = False,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Write the fitted-model report of a terrain's runs: one page that needs no network, and its numbers as JSON.

    With --table the page is of single-wheel tests.

    A section whose channel is missing is omitted, with the reason; the other sections are complete. Exit code 1: there
    is no result, neither fit nor diagnosis, or a fault has cost a section or the diagnosis.
    """
    from wheelsoil.workflows import Files, TableFiles, load_model, read_benches, report_of, report_of_tables

    options.refuse_two_sources(runs or (), tables, choice, [*(rename or ()), *(where or ())], "report")
    options.refuse_wheel_of_a_table(tables, wheel)
    last = _last(against) if against else None
    target, browser = _target(output, form, force=force)
    extended = load_model(model) if model else None
    by_hand = options.chosen(
        choice,
        sinkage=sinkage,
        channels=channels,
        soil_prior=soil_prior,
        slip_threshold=slip_threshold,
        min_speed=min_speed,
    )
    if tables and against:
        raise ConfigError.of("--against compares reports of driven runs", "--table", next_step="omit one of the two")
    if tables:
        wheels = TableFiles(tuple(vehicle or ()), (terrain,) if terrain else (), soil)
        benches = read_benches(tables, wheels, rename=rename, where=where)
        options.say_doubted_soils(bench.terrain for bench in benches)
        report = report_of_tables(benches, by_hand.fit_choices(extended), diagnose=diagnose)
    else:
        files = Files(
            options.one_file(vehicle),
            terrain,
            runs_file,
            zero,
            soil,
            lenient_dbc=lenient_dbc,
            accept_implausible=accept_implausible,
            wheel=wheel,
        )
        report = report_of(runs or (), by_hand, files, extended=extended, diagnose=diagnose, last=last)
    page, numbers = report.print(target, browser) if browser else report.write(target)
    for key, why in report.left_out.items():
        say(f"section {key} omitted: {why}")
    if report.not_fitted:
        say_folded(f"not fitted because a signal is missing (the page names it): {report.not_fitted}")
    if json:
        print_json(
            {
                "report": page,
                "numbers": numbers,
                "left_out": report.left_out,
                "not_fitted": report.not_fitted,
                "failed": report.failed,
                "runs_set_aside": [run.facts() for run in report.set_aside],
                "result": report.sentence,
            }
        )
    else:
        print_pairs([("report", str(page)), ("numbers", str(numbers))])
        say(report.sentence)
    if report.failed:
        say_folded(f"a fault has cost a part of this report, and the page says why: {', '.join(report.failed)}")
    if report.failed or not report.has_result:
        raise typer.Exit(1)


def _last(place: str) -> LastReport | Callable[[Processed], LastReport]:
    """Return the last report, or what finds the last campaign in a store.

    Raises
    ------
    ConfigError
        There is no such report or store.
    """
    from wheelsoil.workflows.last_report import load_last, store_meant

    url = store_meant(place)
    if url is None:
        return load_last(Path(place))

    from wheelsoil.fleet import last_campaign, open_store
    from wheelsoil.wording.store_text import damage_lines

    store = open_store(url)

    def find(processed: Processed) -> LastReport:
        found, damaged = last_campaign(store, processed)
        for line in damage_lines(url, damaged):
            say(line)
        return found

    return find


def _target(output: Path | None, form: Format | None, *, force: bool) -> tuple[Path, str]:
    """Return the file to write and, for a PDF, the browser that prints it."""
    suffix = output.suffix.lower() if output else ""
    pdf = form is Format.PDF or (form is None and suffix == ".pdf")
    if output and ((pdf and suffix != ".pdf") or (not pdf and suffix == ".pdf")):
        raise ConfigError.of(
            f"--format {'pdf' if pdf else 'html'} contradicts the output's name",
            output,
            next_step=f"call it {output.with_suffix('.pdf' if pdf else '.html').name}, or omit --format",
        )
    if suffix == ".json":
        fault = Fault(
            ".json is the suffix of the numbers beside the report", str(output), next_step="use .html or .pdf"
        )
        raise ConfigError(fault)
    target = check_output(output or Path("report.pdf" if pdf else "report.html"), force=force)
    check_output(target.with_suffix(".json"), force=force)
    if not pdf:
        return target, ""
    from wheelsoil.report.build import find_browser

    return target, find_browser()


def view_command(
    runs: options.Runs,
    vehicle: options.Vehicle = None,
    wheel: options.OneWheel = None,
    terrain: options.Terrain = None,
    runs_file: options.RunsFile = None,
    zero: options.ZeroFile = None,
    soil: options.SoilPreset = None,
    lenient_dbc: options.LenientDbc = False,
    no_cache: options.NoCache = False,  # noqa: ARG001  # its callback uses it
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

    if soil is not None:
        known_soil(soil, None)
    if against:
        _last(against)
    files = Files(vehicle, terrain, runs_file, zero, soil, lenient_dbc, wheel=wheel)
    token = options.page_token(token_file)
    serve(runs, files, host=host, port=port, token=token, browser=browser, say=say, against=against or "")
