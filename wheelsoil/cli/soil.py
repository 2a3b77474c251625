"""``wheelsoil soil``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
import typer.core

from wheelsoil.cli.options import Force, Json, Rename, Where
from wheelsoil.console import check_output, print_json, print_pairs, print_table, say

if TYPE_CHECKING:
    from daq.series import PlateTest, SharedOptions, ShearTest
    from wheelsoil.wording.bevameter_text import BenchSoil

GREEDY = ("--plate", "--shear", "--radius", "--width")
"""Options with several values, up to the next option: ``--plate a.csv b.csv``, ``--plate plates/*.csv``."""


def spread(args: Iterable[str]) -> Iterator[str]:
    """Yield command-line arguments with a greedy option repeated before each of its values."""
    option, values = "", 0
    for arg in args:
        if arg.startswith("-"):
            name, sign, _ = arg.partition("=")
            option, values = (name, int(bool(sign))) if name in GREEDY else ("", 0)
        elif option:
            if values:
                yield option
            values += 1
        yield arg


class SoilCommand(typer.core.TyperCommand):
    """A command whose greedy options take several values."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments with greedy options spread out."""
        return super().parse_args(ctx, list(spread(args)))


def soil_command(
    plate: Annotated[
        list[Path] | None,
        typer.Option("--plate", metavar="FILE...", help="Pressure-sinkage tests: sinkage_m, pressure_pa or force_n."),
    ] = None,
    shear: Annotated[
        list[Path] | None,
        typer.Option(
            "--shear", metavar="FILE...", help="Shear tests: displacement_m, shear_stress_pa, normal_stress_pa."
        ),
    ] = None,
    radius: Annotated[
        list[float] | None,
        typer.Option("--radius", metavar="M...", help="Of round plates: one for all files, or one per file."),
    ] = None,
    width: Annotated[
        list[float] | None,
        typer.Option(
            "--width", metavar="M...", help="Smaller side of rectangular plates: one for all, or one per file."
        ),
    ] = None,
    ring: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="INNER OUTER", help="Radii of a shear ring in m, for rotation_rad and torque_nm."),
    ] = None,
    zero: Annotated[
        Literal["given", "contact", "fitted"],
        typer.Option(help="Sinkage 0: as given, where the pressure leaves its baseline, or fitted near there."),
    ] = "given",
    sinkage_from: Annotated[float, typer.Option("--from", metavar="M", help="Smallest sinkage used.")] = 0.0,
    sinkage_to: Annotated[
        float | None, typer.Option("--to", metavar="M", help="Largest sinkage used (default: all).")
    ] = None,
    shear_to: Annotated[
        float | None, typer.Option("--shear-to", metavar="M", help="Largest displacement used (default: all).")
    ] = None,
    base: Annotated[
        Path | None,
        typer.Option("--base", metavar="FILE", help="terrain.toml with the parameters that are not tested."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write a terrain.toml with its uncertainty.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Of the terrain (default: the output's).")] = None,
    rename: Rename = None,
    where: Where = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Determine terrain parameters from bevameter tests: k_c, k_phi, n from plates, c, phi, K from shear.

    Each test is fitted alone and counts once in the joint fit, so the intervals include the scatter between tests.
    """
    from daq import TerrainConfig, load_toml
    from daq.series import SharedOptions, refuse_repeated, write_whole
    from model.bevameter import WindowOptions
    from wheelsoil.wording.bevameter_text import evaluate, terrain_text

    target = check_output(output, force=force) if output else None
    known = load_toml(base, TerrainConfig) if base else None
    columns = SharedOptions(rename or [], where or [])
    plates = _plates(plate or [], radius or [], width or [], columns)
    shears = _shears(shear or [], ring, columns)
    columns.refuse_unused()
    refuse_repeated([*plates, *shears])
    result = evaluate(
        plates,
        shears,
        WindowOptions(zero, sinkage_from, float("inf") if sinkage_to is None else sinkage_to),
        shear_to_m=float("inf") if shear_to is None else shear_to,
    )
    try:
        if target:
            write_whole(target, terrain_text(result, name or target.stem, known))
    finally:
        _print(result, json=json)
    if target:
        say(f"wrote {target}")


def _plates(
    files: Sequence[Path], radii: Sequence[float], widths: Sequence[float], columns: SharedOptions
) -> list[PlateTest]:
    from daq import ConfigError, Fault
    from daq.series import column_names, read_plate_tests

    ConfigError.stop_if_any(
        Fault(
            f"{len(sizes)} values of --{option} for {len(files)} plate files",
            expected="one for all files, or one for each, in their order",
        )
        for option, sizes in (("radius", radii), ("width", widths))
        if len(sizes) not in (0, 1, len(files))
    )
    tests: list[PlateTest] = []
    for i, path in enumerate(files):
        radius, width = (sizes[i % len(sizes)] if sizes else None for sizes in (radii, widths))
        rename, where = columns.fitting(column_names(path))
        tests += read_plate_tests(path, radius_m=radius, width_m=width, rename=rename, where=where)
    return tests


def _shears(files: Sequence[Path], ring: tuple[float, float] | None, columns: SharedOptions) -> list[ShearTest]:
    from daq.series import column_names, read_shear_tests

    tests: list[ShearTest] = []
    for path in files:
        rename, where = columns.fitting(column_names(path))
        tests += read_shear_tests(path, ring_m=ring, rename=rename, where=where)
    return tests


def _print(result: BenchSoil, *, json: bool) -> None:
    from wheelsoil.wording.bevameter_text import as_json, facts, parameter_rows, plate_rows, shear_rows

    if json:
        print_json(as_json(result))
    else:
        tables = [rows(result) for rows in (plate_rows, shear_rows, parameter_rows)]
        for i, (head, lines) in enumerate(table for table in tables if table[1]):
            if i:
                print()
            print_table(head, lines)
        print()
        print_pairs(facts(result))
    for text in result.warnings:
        say(f"note: {text}")
