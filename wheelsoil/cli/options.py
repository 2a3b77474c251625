"""Arguments and options shared by several commands."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from daq import ConfigError, Fault
from wheelsoil.console import say, say_folded

if TYPE_CHECKING:
    from daq import RunInfo, TerrainConfig
    from daq.can import Database
    from daq.runs import Configuration
    from wheelsoil.workflows.choice import Choice

Runs = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN...", readable=False, help="Recordings, logs or campaign folders."
    ),  # daq.runs.open reports it
]
RunsIfAny = Annotated[list[Path] | None, typer.Argument(metavar="RUN...", help="Recordings, logs or campaign folders.")]
TableFile = Annotated[
    Path | None,
    typer.Option(
        "--table", metavar="FILE.csv", help="Single-wheel tests instead of runs: slip, load, pull, torque, sinkage."
    ),
]
Vehicle = Annotated[
    Path | None, typer.Option("--vehicle", metavar="FILE", help="vehicle.toml; overrides what a run carries.")
]
Tables = Annotated[
    list[Path] | None,
    typer.Option("--table", metavar="FILE.csv", help="Single-wheel tests instead of runs: slip, load, pull, ..."),
]
WheelFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--vehicle",
        metavar="FILE",
        help="vehicle.toml; overrides what a run carries. With --table: one for all tables, one for each, or NAME=FILE "
        "for each name in a column wheel.",
    ),
]
Terrain = Annotated[
    Path | None, typer.Option("--terrain", metavar="FILE", help="terrain.toml; overrides what a run carries.")
]
RunsFile = Annotated[
    Path | None, typer.Option("--runs", metavar="FILE", help="runs.toml; overrides what a run carries.")
]
ZeroFile = Annotated[
    Path | None, typer.Option("--zero", metavar="FILE", help="zero.toml; overrides the one that vehicle.toml names.")
]

Against = Annotated[
    str | None,
    typer.Option(
        "--against",
        metavar="LAST",
        help="An earlier report (JSON, page or folder) or a fleet's store: what has changed since.",
    ),
]


Wheel = Annotated[
    str | None,
    typer.Option("--wheel", metavar="ID", help="One of several [[wheel]] in vehicle.toml (default: each in turn)."),
]
OneWheel = Annotated[
    str | None, typer.Option("--wheel", metavar="ID", help="Which one, if vehicle.toml has several [[wheel]].")
]


Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        "-j",
        min=1,
        metavar="N",
        envvar="WHEELSOIL_JOBS",
        help="Processes at once (default: one for each core).",
    ),
]


NoCache = Annotated[
    bool, typer.Option("--no-cache", help="Compute everything anew; keep nothing (see `wheelsoil cache`).")
]
AcceptImplausible = Annotated[
    bool,
    typer.Option("--accept-implausible", help="Go on with runs that are impossible as vehicle.toml declares them."),
]
LenientDbc = Annotated[
    bool, typer.Option("--lenient-dbc", help="Skip the DBC lines that cantools rejects, and list them.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Apart = Annotated[bool, typer.Option("--apart", help="Of several wheels: not all of them together, too.")]
Force = Annotated[bool, typer.Option("--force", "-f", help="Replace an existing output.")]


def complete_effects(incomplete: str) -> list[str]:
    """Return what the last of names between commas may become: effects, families, kinds."""
    from model.effects import EFFECTS

    before, comma, last = incomplete.rpartition(",")
    names = dict.fromkeys([*EFFECTS, *(effect.name for effect in EFFECTS.values()), "physical", "measurement"])
    return [f"{before}{comma}{name}" for name in names if name.startswith(last)]


def complete_presets(incomplete: str) -> list[str]:
    """Return the soils that a name may become."""
    return [name for name in PRESETS.split(", ") if name.startswith(incomplete)]


Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effects",
        metavar="NAME,...",
        help="Consider only these effects, families, or kinds.",
        autocompletion=complete_effects,
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="NAME,...",
        help="Exclude these effects, families, or kinds.",
        autocompletion=complete_effects,
    ),
]
PRESETS = "clay, sandy, ding_clay, dry_sand, lunar, hit_lss1, sandy_loam"
"""`model.wheel_soil.soils.SOILS`, written out so that --help need not import it."""
SoilPreset = Annotated[
    str | None,
    typer.Option(
        "--soil", metavar="NAME", help=f"A preset ({PRESETS}) instead of terrain.toml.", autocompletion=complete_presets
    ),
]
ChoiceFile = Annotated[
    Path | None,
    typer.Option(
        "--choice",
        metavar="FILE",
        help="choice.toml: runs, parts and settings selected by hand; an option overrides it.",
    ),
]
ModelFile = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="A model written by `diagnose -o`: fitted in addition to the four."),
]
TOKEN_VARIABLE = "WHEELSOIL_PAGE_TOKEN"
TokenFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help=f"File with the page's token (or: environment {TOKEN_VARIABLE}).")
]
PageHost = Annotated[
    str, typer.Option(metavar="ADDRESS", help="Address of the page; other than loopback it requires a token.")
]


def use_cores(context: typer.Context, jobs: int | None) -> None:
    """Let a command use so many processes until it ends; without a number all cores."""
    from model import available_cores, can_copy_processes, processes

    count = jobs or available_cores()
    if count > 1 and not can_copy_processes():
        say("one core is used: this system cannot copy a process")
    context.with_resource(processes(count))


def keep_results(context: typer.Context, no_cache: bool) -> None:
    """Let a command neither use nor keep results of earlier ones until it ends, if --no-cache is given."""
    from wheelsoil.cache import nothing_kept

    if no_cache:
        context.with_resource(nothing_kept())


def configuration(
    vehicle: Path | None, terrain: Path | None, dbc: Iterable[tuple[str, str]] = (), *, lenient_dbc: bool = False
) -> Configuration:
    """Load the files that the options name, or raise every error; DBCs alone become a vehicle.toml with buses only."""
    from daq.runs import Collected, Configuration, terrain_from_file, vehicle_from_file

    files = list(dbc)
    if vehicle and files:
        raise ConfigError.of("--dbc and --vehicle exclude each other", next_step="name the DBCs in vehicle.toml")
    collected = Collected()
    known = Configuration()
    with collected.catch():
        if vehicle:
            known = vehicle_from_file(vehicle, lenient_dbc=lenient_dbc)
        elif files:
            known = _only_databases(files, lenient=lenient_dbc)
    with collected.catch():
        if terrain:
            known = known.over(terrain_from_file(terrain))
    collected.stop_if_any()
    return known


def pairs(texts: Iterable[str] | None, option: str, form: str) -> list[tuple[str, str]]:
    """Parse ``a=b`` values of a repeated option; `ConfigError` where one is not of that form."""
    parsed = [tuple(text.partition("=")[::2]) for text in texts or ()]
    ConfigError.stop_if_any(
        Fault(f"{option} {text} is not understood", expected=form)
        for text, (left, right) in zip(texts or (), parsed, strict=True)
        if not left or not right
    )
    return [(left, right) for left, right in parsed]


def split(texts: Iterable[str] | None) -> list[str]:
    """Return the parts between the commas of a repeated option's values."""
    return [part.strip() for text in texts or () for part in text.split(",") if part.strip()]


def _only_databases(files: Iterable[tuple[str, str]], *, lenient: bool) -> Configuration:
    """Return a vehicle with buses and DBCs only."""
    import tomli_w

    from daq import VehicleConfig, parse_toml
    from daq.can import load_database, messages_by_bus
    from daq.runs import VEHICLE_FILE, Collected, Configuration

    buses: dict[str, list[Path]] = {}
    for bus, file in files:
        buses.setdefault(bus, []).append(Path(file))
    collected = Collected()
    databases: dict[str, tuple[Database, ...]] = {}
    for bus, paths in buses.items():
        for path in paths:
            with collected.catch():
                databases[bus] = (*databases.get(bus, ()), load_database(path, lenient=lenient))
    collected.stop_if_any()
    messages_by_bus(databases)
    text = tomli_w.dumps({"bus": [{"channel": bus, "dbc": [p.name for p in paths]} for bus, paths in buses.items()]})
    carried = {database.name: database.content for bus in databases.values() for database in bus}
    vehicle = parse_toml(text, VehicleConfig, "--dbc")
    return Configuration(vehicle, databases, attachments={VEHICLE_FILE: text.encode(), **carried})


Rename = Annotated[
    list[str] | None,
    typer.Option(
        "--rename", metavar="NEW=OLD[*FACTOR],...", help="Read a column of the table under another name and unit."
    ),
]
Where = Annotated[
    list[str] | None,
    typer.Option("--where", metavar="COLUMN=VALUE,...", help="Use only the rows of the table with this value."),
]


Direction = Literal["out", "back"]
RunId = Annotated[str | None, typer.Option("--run-id", metavar="ID", help="Name of the run.")]
DirectionOption = Annotated[Direction, typer.Option("--direction", help="Direction of travel on the track.")]
PassNumber = Annotated[int, typer.Option("--pass-number", min=1, help="Number of this pass in the track, from 1.")]
AddedLoad = Annotated[float, typer.Option("--added-load", metavar="KG", help="Load added to the vehicle.")]
Inflation = Annotated[float | None, typer.Option("--inflation", metavar="KPA", help="Inflation pressure of the tyre.")]


_OPTIONS: dict[str, Any] = {
    "choice": ChoiceFile,
    "sinkage": Annotated[
        Literal["balanced", "literal"] | None,
        typer.Option("--sinkage", help="Slip-sinkage laws load-consistent or as published. [default: balanced]"),
    ],
    "channels": Annotated[
        str | None,
        typer.Option(
            "--channels",
            parser=lambda text: tuple(split([text])),
            metavar="TEXT",
            help="Fitted channels: dp (drawbar pull), t (torque), z (sinkage). [default: dp]",
        ),
    ],
    "soil_prior": Annotated[
        bool | None,
        typer.Option(
            "--soil-prior/--no-soil-prior", help="Also estimate the soil, within the laboratory's uncertainty."
        ),
    ],
    "slip_threshold": Annotated[
        float | None,
        typer.Option("--slip-threshold", metavar="SLIP", help="For M0, R0, R2 only (default: 0.2 on clay, else 0.1)."),
    ],
    "cutoff_hz": Annotated[
        float | None,
        typer.Option("--cutoff", metavar="HZ", help="Low-pass of every channel (default: by the slowest channel)."),
    ],
    "min_speed_mps": Annotated[
        float | None,
        typer.Option(
            "--min-speed",
            metavar="M/S",
            help="Slip is not computed below this speed (default: 0.5; less for a slow vehicle).",
        ),
    ],
    "max_gap_s": Annotated[
        float | None,
        typer.Option("--max-gap", metavar="S", help="Longest gap that is bridged (default: by the filter)."),
    ],
}
"""--choice, and each key of choice.toml that has an option."""
_OF_FIT = ("sinkage", "channels", "soil_prior", "slip_threshold", "min_speed_mps")
_TAKEN = {
    "process": ("cutoff_hz", "min_speed_mps", "max_gap_s", "choice"),
    "fit": _OF_FIT,
    "sinkage": ("min_speed_mps",),
    "diagnose": ("sinkage", "min_speed_mps"),
    "report": _OF_FIT,
}
"""Which of them a command takes, beside its own."""


def with_shared(name: str, command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that also takes --jobs, --no-cache and its options of choice.toml, before its last one."""
    if name not in _TAKEN:
        return command
    added = {key: (_OPTIONS[key], None) for key in _TAKEN[name]} | {"jobs": (Jobs, None), "no_cache": (NoCache, False)}

    @wraps(command)
    def run(context: typer.Context, **given: Any) -> None:
        use_cores(context, given["jobs"])
        keep_results(context, given["no_cache"])
        command(context, **{key: value for key, value in given.items() if key not in added})

    every = [
        each.replace(kind=Parameter.KEYWORD_ONLY) for each in signature(command, eval_str=True).parameters.values()
    ]
    more = [Parameter(key, Parameter.KEYWORD_ONLY, default=each[1], annotation=each[0]) for key, each in added.items()]
    vars(run)["__signature__"] = Signature([*every[:-1], *more, every[-1]])
    return run


def chosen(context: typer.Context) -> Choice:
    """Return the choice of --choice, overridden by the other options of the command line."""
    from wheelsoil.workflows.choice import Choice, load_choice

    given = {key: context.params.get(key) for key in _OPTIONS}
    return (load_choice(file) if (file := given.pop("choice")) else Choice()).but(**given)


def run_info(
    file: str, run_id: str, direction: Direction, pass_number: int, added_load_kg: float, inflation_kpa: float | None
) -> RunInfo:
    """Return the run information that the options give; `ConfigError` where a number is out of range."""
    from pydantic import ValidationError

    from daq import RunInfo

    try:
        return RunInfo(
            file=file,
            id=run_id,
            direction=direction,
            pass_number=pass_number,
            added_load_kg=added_load_kg,
            inflation_kpa=inflation_kpa,
        )
    except ValidationError as error:
        raise ConfigError(
            *(Fault(f"{item['loc'][0]}: {item['msg']}", found=repr(item["input"])) for item in error.errors())
        ) from None


def page_token(file: Path | None) -> str | None:
    """Return a page's token from a file, which must have one, or the environment; None if there is none."""
    if file is None:
        return os.environ.get(TOKEN_VARIABLE) or None
    try:
        text = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError.of(
            "the token cannot be read", file, str(error), next_step="check the path and its permissions"
        ) from None
    if not text:
        raise ConfigError.of("the file contains no token", file, next_step="write the token into it as one line")
    return text


def one_file(files: Sequence[str] | None) -> Path | None:
    """Return the only --vehicle, for runs; `ConfigError` if there are several."""
    if files and len(files) > 1:
        step = "give one, or diagnose the vehicles one after the other"
        raise ConfigError(Fault("runs take one --vehicle", found=", ".join(files), next_step=step))
    return Path(files[0]) if files else None


def refuse_two_sources(
    runs: Sequence[Path], table: object, choice: Path | None, wheel: str | None, columns: Sequence[str], verb: str
) -> None:
    """Check that a command takes runs, perhaps with a choice and a wheel, or a table, perhaps with `columns`.

    The columns are the values of --rename and --where; `verb` is what the command does with one of both, for the
    message.
    """
    if table and (runs or choice):
        other = "RUN" if runs else "--choice"
        raise ConfigError.of(f"{other} and --table exclude each other", next_step=f"{verb} one, then the other")
    if not table and columns:
        raise ConfigError.of("--rename and --where choose from a table", next_step="give --table FILE.csv")
    if table and wheel is not None:
        raise ConfigError.of("--wheel is of runs", next_step="choose rows of the table with --where wheel=NAME")


def say_doubted_soils(terrains: Iterable[TerrainConfig | None]) -> None:
    """Print what of soils is improbable as it is declared (stderr)."""
    from wheelsoil.workflows.grading import doubted_soils

    for text in doubted_soils(terrains):
        say_folded(text)
