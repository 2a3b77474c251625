"""``wheelsoil fleet``: many campaigns, a store of what was found, and questions to it."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from daq import ConfigError
from wheelsoil.cli import options
from wheelsoil.console import check_output, print_json, print_pairs, print_table, say

if TYPE_CHECKING:
    from wheelsoil.fleet import Damage, Manifest, Step

StoreUrl = Annotated[str, typer.Argument(metavar="STORE", help="A folder, or a bucket: s3://bucket/folder.")]

_SHOWN = 40
_LINES = 20
"""Of what is not read, that are printed."""
_MINUTE_S, _HOUR_S = 60, 3600

fleet_app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Process, fit and diagnose many campaigns, and ask what was found in all of them.",
)


@fleet_app.command("run")
def fleet_run(
    context: typer.Context,
    roots: Annotated[list[Path], typer.Argument(metavar="ROOT...", help="Folders with campaigns, however deep.")],
    store: Annotated[str, typer.Option("--store", metavar="STORE", help="A folder, or s3://bucket/folder.")],
    engine: Annotated[
        Literal["local", "dask"], typer.Option(help="Processes of this machine, or Dask workers.")
    ] = "local",
    scheduler: Annotated[
        str, typer.Option(metavar="TCP", help="With --engine dask: tcp://HOST:8786 (default: workers of this machine).")
    ] = "",
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=0, metavar="N", help="Processes (default: one a core).")] = 0,
    memory: Annotated[
        float, typer.Option(min=0, metavar="GB", help="Most for each process (default: its share of 80 %).")
    ] = 0.0,
    shard: Annotated[str, typer.Option(metavar="I/N", help="Only this part of the campaigns: 3/20.")] = "1/1",
    effects: options.Effects = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Also those that failed before.")] = False,
    check: Annotated[bool, typer.Option("--check", help="Read all of the store for damage.")] = False,
    no_cache: options.NoCache = False,
    json: options.Json = False,
) -> None:
    """Take every campaign and single-wheel table through processing, fit and diagnosis into a store.

    What the store has already is not done again: the same call goes on where an earlier one ended, however that was.
    A campaign that fails is a row with its fault, and stops no other.

    Exit codes: 1 a campaign failed; 2 usage, no campaign, a store that cannot be written; 4 no scheduler or workers.
    """
    from wheelsoil.fleet import FleetOptions, Shard, Workers, is_open_to_others, plan_fleet, run_fleet
    from wheelsoil.wording.store_text import OPEN_STORE, PLAIN_SCHEDULER
    from wheelsoil.workflows import diagnosis_options

    options.keep_results(context, no_cache)
    if scheduler and engine == "local":
        raise ConfigError.of("--scheduler is of Dask", next_step="give --engine dask")
    chosen = options.split(effects)
    diagnosis_options(effects=chosen)
    settings = FleetOptions(tuple(chosen))
    plan = plan_fleet(roots, store, settings, shard=Shard.of(shard), retry_failed=retry_failed, thorough=check)
    if is_open_to_others(scheduler):
        say(PLAIN_SCHEDULER.format(scheduler))
    if plan.store.is_open_to_all:
        say(OPEN_STORE.format(store))
    more = len(plan.not_read) - _LINES
    for line in (*plan.not_read[:_LINES], *([f"{more} more files and folders are not read"] if more > 0 else [])):
        say(line)
    there = len(plan.found) - len(plan.todo)
    say(f"{len(plan.found)} campaign{'s' * (len(plan.found) != 1)}, {there} in the store already")
    anew = {damage.campaign for damage in plan.damaged} & {source.name for source in plan.todo}
    if anew:
        say(f"made anew, since their files in the store are damaged: {', '.join(sorted(anew))}")
    workers = Workers(engine, scheduler, jobs, int(memory * 1e9))
    failed = dict(plan.failed)
    for step in _shown(run_fleet(plan, workers), len(plan.todo)):
        if step.state == "failed":
            failed[step.name] = step.outcome
    if json:
        print_json({"store": store, "campaigns": len(plan.found), "done_before": there, "failed": failed})
    if failed:
        before = f", {len(plan.failed)} of them before: --retry-failed" if plan.failed else ""
        say(f"{len(failed)} failed{before}; `wheelsoil fleet status {store}` lists them")
    _set_aside(store, [damage for damage in plan.damaged if damage.campaign and damage.campaign not in anew])
    if failed:
        raise SystemExit(1)


def _set_aside(store: str, damaged: Sequence[Damage]) -> None:
    """Name what is damaged, and end with exit code 1; nothing if nothing is."""
    from wheelsoil.wording.store_text import damage_lines

    for line in damage_lines(store, damaged):
        say(line)
    if damaged:
        raise SystemExit(1)


def _shown(steps: Iterable[Step], total: int) -> Iterator[Step]:
    """Yield the steps and print each on stderr: in a bar with the time left on a terminal, else in a line each."""
    if not sys.stderr.isatty():
        for step in steps:
            left = f", {_duration(step.left_s)} left" if step.finished < step.total else ""
            cost = f", {step.cpu_s:.1f} s of CPU, {step.peak_bytes / 1e6:.0f} MB" if step.cpu_s else ""
            say(f"{step.finished}/{step.total} {step.name}: {step.state}, {step.outcome}{cost}{left}")
            yield step
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("campaigns"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        for step in steps:
            bar.update(task, advance=1, description=f"{step.failed} failed" if step.failed else "")
            if step.state == "failed":
                bar.console.print(f"{step.name}: {step.outcome}", markup=False, highlight=False)
            yield step


def _duration(seconds: float) -> str:
    if seconds < _MINUTE_S:
        return f"{seconds:.0f} s"
    return f"{seconds / _MINUTE_S:.0f} min" if seconds < _HOUR_S else f"{seconds / _HOUR_S:.1f} h"


@fleet_app.command("status")
def fleet_status(store: StoreUrl, json: options.Json = False) -> None:
    """Report what a store holds: campaigns and their verdicts, rows, what failed and why, what it took."""
    from wheelsoil.fleet import holdings_of, open_store
    from wheelsoil.fleet.store import uncollected

    with uncollected():
        holdings = holdings_of(open_store(store))
        facts = {"store": store, **_summary(list(holdings.manifests.values()))}
        facts["damaged"] = [vars(damage) for damage in holdings.damaged]
    if json:
        print_json(facts)
    else:
        _print_status(facts)
    _set_aside(store, holdings.damaged)


def _summary(manifests: Sequence[Manifest]) -> dict[str, Any]:
    tables = dict.fromkeys(table for manifest in manifests for table in manifest.rows)
    return {
        "campaigns": len(manifests),
        "failed": {manifest.campaign: manifest.fault for manifest in manifests if manifest.state == "failed"},
        "silent": {
            manifest.campaign: manifest.fault for manifest in manifests if manifest.state == "done" and manifest.fault
        },
        "verdicts": dict(Counter(manifest.verdict for manifest in manifests if manifest.verdict).most_common()),
        "causes": dict(Counter(name for each in manifests for name in each.families).most_common()),
        "rows": {table: sum(manifest.rows.get(table, 0) for manifest in manifests) for table in tables},
        "cpu_s": sum(manifest.cpu_s for manifest in manifests),
        "peak_bytes": max((manifest.peak_bytes for manifest in manifests), default=0),
        "longest": max(manifests, key=lambda manifest: manifest.cpu_s).campaign if manifests else None,
        "largest": max(manifests, key=lambda manifest: manifest.peak_bytes).campaign if manifests else None,
        "versions": sorted({manifest.version for manifest in manifests}),
    }


def _print_status(facts: Mapping[str, Any]) -> None:
    from wheelsoil.wording.grounds_text import VERDICT_WORDS
    from wheelsoil.wording.names import plain_name

    rows, failed = facts["rows"], facts["failed"]
    verdicts = ", ".join(
        f"{count} {VERDICT_WORDS.get(verdict, verdict)}" for verdict, count in facts["verdicts"].items()
    )
    each = facts["cpu_s"] / max(facts["campaigns"], 1)
    nothing = "not kept by the version that made the store" if {"named", "one_of"} & {*facts["verdicts"]} else "none"
    longest = f", longest {facts['longest']}" if facts["longest"] else ""
    largest = f": {facts['largest']}" if facts["largest"] else ""
    print_pairs(
        [
            ("store", facts["store"]),
            ("campaigns", f"{facts['campaigns']}, {len(failed)} failed"),
            ("verdicts", verdicts or "none"),
            ("causes", ", ".join(f"{plain_name(name)} {count}" for name, count in facts["causes"].items()) or nothing),
            ("rows", ", ".join(f"{name} {count:,}" for name, count in rows.items()) or "none"),
            ("computing", f"{_duration(facts['cpu_s'])} of one core, {each:.1f} s a campaign{longest}"),
            ("memory", f"{facts['peak_bytes'] / 1e6:.0f} MB at most for a campaign{largest}"),
            ("made by", ", ".join(f"wheelsoil {version}" for version in facts["versions"]) or "nobody"),
        ]
    )
    for name, fault in (*failed.items(), *facts["silent"].items()):
        print(f"  {'failed' if name in failed else 'silent'}: {name}: {fault}")


@fleet_app.command("sql")
def fleet_sql(
    store: StoreUrl,
    query: Annotated[str, typer.Argument(metavar="SQL", help='"select ... from campaigns"; - reads standard input.')],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the answer: .parquet or .csv.")
    ] = None,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Ask the store by SQL; docs/fleet.md has ten queries to begin with.

    Tables: campaigns, runs, samples, notes, fits, coefficients, diagnoses, causes, gains, sensors, evidence; and tasks,
    which says what each campaign cost. Each row has its campaign and, of several, its wheel.
    """
    from wheelsoil.fleet import ask, open_store, write_answer

    target = check_output(output, force=force) if output else None
    found = ask(open_store(store), sys.stdin.read() if query == "-" else query)
    answer = found.rows
    if target:
        write_answer(answer, target)
        say(f"wrote {target}")
    elif json:
        print_json([{name: _plain(value) for name, value in row.items()} for row in answer.to_pylist()])
    else:
        rows = answer.slice(0, _SHOWN).to_pylist()
        print_table(answer.column_names, [[_cell(value) for value in row.values()] for row in rows])
        if len(answer) > _SHOWN:
            say(f"{len(answer) - _SHOWN:,} more rows: give -o FILE, --json, or a limit")
    _set_aside(store, found.damaged)


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: sums are decimals in DuckDB, and moments are texts."""
    if isinstance(value, Decimal):
        return int(value) if value == value.to_integral_value() else float(value)
    return value.isoformat() if isinstance(value, date) else value


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.5g}"
    return "" if value is None else str(value)


@fleet_app.command("export")
def fleet_export(
    store: StoreUrl,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the tables go.")],
    tables: Annotated[
        list[str] | None, typer.Option("--tables", metavar="NAME,...", help="Only these (default: all).")
    ] = None,
    format: Annotated[str, typer.Option(metavar="SUFFIX", help="parquet or csv.")] = "parquet",
) -> None:
    """Write the store's tables as one file each, all campaigns in it."""
    from wheelsoil.fleet import export, open_store

    paths, damaged = export(open_store(store), output, tuple(options.split(tables)), f".{format.removeprefix('.')}")
    for path in paths:
        say(f"wrote {path}")
    _set_aside(store, damaged)


@fleet_app.command("compact")
def fleet_compact(store: StoreUrl) -> None:
    """Put the files of single campaigns together: at most one a table for 1,000 campaigns. Rows stay as they are.

    Queries may run meanwhile, and so may `fleet run`. A call that is killed loses nothing; the next one goes on.
    """
    from wheelsoil.fleet import compact, open_store

    done = compact(open_store(store))
    print(f"{done.campaigns} campaigns put together; {done.packs} pack{'s' * (done.packs != 1)} in the store")


@fleet_app.command("check")
def fleet_check(store: StoreUrl, json: options.Json = False) -> None:
    """Read every file of a store and compare it with its checksum; name the campaigns that are damaged.

    Other commands look at the size and the footer of the files that they read.

    Exit codes: 1 a file is damaged.
    """
    from wheelsoil.fleet import holdings_of, open_store

    holdings = holdings_of(open_store(store), thorough=True)
    sound = len(holdings.manifests)
    files = sum(len(part.files) for part in holdings.parts)
    if json:
        damaged = [vars(damage) for damage in holdings.damaged]
        print_json({"store": store, "campaigns": sound, "files": files, "damaged": damaged})
    else:
        print(f"{sound} campaigns in {files} files are as they were written")
    _set_aside(store, holdings.damaged)


@fleet_app.command("diagnose")
def fleet_diagnose(store: StoreUrl, json: options.Json = False) -> None:
    """Pool the store's campaigns: what is wrong with which transducer since when, which soils differ, what changed.

    A single campaign does not tell a wrong gain from another soil; many with the same transducer do. Needs
    [transducer] serial in vehicle.toml, and recordings with a date. No recording is read.
    """
    from wheelsoil.fleet import day_of, open_store, pool, pooled_json
    from wheelsoil.wording.passport_text import (
        change_lines,
        left_out_line,
        named_lines,
        passport_line,
        soil_lines,
        trend_lines,
    )

    found = pool(open_store(store))
    if json:
        for text in pooled_json(found):
            print(text, end="")
        _set_aside(store, found.damaged)
        return
    for passport in found.passports:
        days = [day_of(point.years) for trend in passport.trends.values() for point in trend.points]
        print(passport_line(passport, min(days, default=""), max(days, default="")))
        if trends := list(trend_lines(passport)):
            print("\n    ".join(("  each as if it alone were wrong:", *trends)))
    for title, lines in (
        ("errors of the measurement that a campaign names:", list(named_lines(found.named))),
        ("soils that differ from their laboratory:", list(soil_lines(found.soils))),
        ("since the last campaign of the same vehicle or terrain:", list(change_lines(found.changes))),
    ):
        if lines:
            print("\n  ".join((title, *lines)))
    if found.nameless:
        say(left_out_line(found.nameless, "a serial ([transducer] serial in vehicle.toml)"))
    if found.dateless:
        say(left_out_line(found.dateless, "a date"))
    _set_aside(store, found.damaged)


@fleet_app.command("report")
def fleet_report(
    store: StoreUrl,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The page.")] = Path("fleet.html"),
    force: options.Force = False,
) -> None:
    """Write one page of all campaigns: verdicts, causes, transducers, drawbar pull by terrain; its numbers as JSON.

    A campaign whose folder has a report.html leads to it.
    """
    from wheelsoil.fleet import open_store, overview_of

    target = check_output(output, force=force)
    check_output(target.with_suffix(".json"), force=force)
    overview = overview_of(open_store(store))
    for path in overview.write(target):
        say(f"wrote {path}")
    print(overview.headline)
    _set_aside(store, overview.pooled.damaged)
