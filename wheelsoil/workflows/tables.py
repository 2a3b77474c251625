"""Reading of single-wheel tables with their wheels and their soil, with all faults reported at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path

import numpy as np

from daq import (
    ConfigError,
    DataError,
    Fault,
    TerrainConfig,
    VehicleConfig,
    WheelSection,
    load_toml,
    parse_mapping,
)
from daq.runs import Collected
from daq.series import (
    SharedOptions,
    WheelTable,
    column_names,
    parse_rename,
    parse_where,
    read_wheel_tables,
    refuse_repeated,
    several_wheels,
)
from model.wheel_soil import Soil, Wheel
from wheelsoil.workflows.fit import known_soil, load_terrain, wheel_of
from wheelsoil.workflows.runs import Files

_MOST_OF_LOAD = 5.0
"""Median of drawbar pull over load, and of torque over load x radius, above which a unit is wrong."""
_LEAST_LOAD_N, _SMALL_WHEEL_M = 1.0, 0.05
"""Median load below which it is in kN, on wheels that are not smaller than this."""
_NO_WHEEL = "give --vehicle FILE with [wheel] radius_m and width_m, or columns radius_m and width_m"


@dataclass(frozen=True)
class BenchFiles:
    """The rows, the wheel that made them and the soil; `terrain` is None where only a preset was given.

    `name` is unique among the tables that were read together.
    """

    rows: WheelTable
    wheel: Wheel
    wheel_section: WheelSection
    soil: Soil
    terrain: TerrainConfig | None
    name: str = ""


@dataclass(frozen=True)
class TableFiles:
    """Files and settings given beside single-wheel tables: options of the same names.

    Attributes
    ----------
    vehicles : tuple of str
        Paths of vehicle.toml with ``[wheel]``: one for all tables, or one for each; or NAME=PATH for the rows that
        have NAME in a column ``wheel``.
    terrains : tuple of Path
        One for all tables, or one for each.
    soil : str, optional
        A preset in place of terrain.toml.
    """

    vehicles: tuple[str, ...] = ()
    terrains: tuple[Path, ...] = ()
    soil: str | None = None


def read_benches(
    paths: Sequence[Path],
    files: TableFiles,
    *,
    rename: Iterable[str] | None = None,
    where: Iterable[str] | None = None,
) -> list[BenchFiles]:
    """Read single-wheel tables and their files; a table with several wheels gives several.

    Parameters
    ----------
    rename, where : iterable of str, optional
        See `daq.series.tables`; with several tables each holds for those that have the column.

    Raises
    ------
    ConfigError, DataError
        Everything that is wrong with any of them.
    """
    collected = Collected()
    with collected.catch():
        grounds = _grounds(files, len(paths))
    with collected.catch():
        wheels = read_wheels(paths, files.vehicles, rename=rename, where=where)
    collected.stop_if_any()
    return [
        BenchFiles(
            wheel_rows.rows,
            Wheel(wheel_rows.section.radius_m, wheel_rows.section.width_m),
            wheel_rows.section,
            *grounds[wheel_rows.table],
            wheel_rows.name,
        )
        for wheel_rows in wheels
    ]


@dataclass(frozen=True)
class WheelRows:
    """The rows of one wheel.

    Attributes
    ----------
    name : str
        Unique among the tables that were read together.
    table : int
        Position of the table that holds them.
    """

    rows: WheelTable
    section: WheelSection
    name: str
    table: int


def read_wheels(
    paths: Sequence[Path],
    vehicles: Sequence[str],
    *,
    rename: Iterable[str] | None = None,
    where: Iterable[str] | None = None,
) -> list[WheelRows]:
    """Read single-wheel tables and their wheels; see `read_benches` and `TableFiles`.

    `ConfigError` or `DataError` lists everything that is wrong with any of them.
    """
    collected = Collected()
    with collected.catch():
        described = _Vehicles.of(vehicles, len(paths))
    tables: list[list[WheelTable]] = []
    with collected.catch():
        tables = _read(paths, rename or (), where or ())
    if not vehicles and not tables:
        collected.errors.append(ConfigError(Fault("the wheel is not known", next_step=_NO_WHEEL)))
    collected.stop_if_any()
    found: list[WheelRows] = []
    for i, parts in enumerate(tables):
        with collected.catch():
            sections = described.sections(i, parts)
            found += [
                WheelRows(part, section, _name(part, parts), i) for part, section in zip(parts, sections, strict=True)
            ]
    for wheel_rows in found:
        with collected.catch():
            _refuse_other_force_units(wheel_rows.rows, wheel_rows.section.radius_m)
    of_one_wheel: dict[str, list[WheelTable]] = {}
    for wheel_rows in found:
        of_one_wheel.setdefault(repr(wheel_rows.section), []).append(wheel_rows.rows)
    for rows in of_one_wheel.values():
        with collected.catch():
            refuse_repeated(rows)
    collected.stop_if_any()
    names = [wheel_rows.name for wheel_rows in found]
    numbers = [f" ({names[:i].count(name)})" if names.count(name) > 1 else "" for i, name in enumerate(names, 1)]
    return [
        replace(wheel_rows, name=wheel_rows.name + number) for wheel_rows, number in zip(found, numbers, strict=True)
    ]


def _refuse_other_force_units(rows: WheelTable, radius_m: float) -> None:
    """Raise DataError where load, pull and torque of a wheel's rows cannot be in N and N m together."""
    load, in_kn = rows.vertical_load_n, "if the load is in kN: --rename vertical_load_n=vertical_load_n*1000"
    faults = []
    if radius_m > _SMALL_WHEEL_M and (found := float(np.median(load))) < _LEAST_LOAD_N:
        expected = f"{_LEAST_LOAD_N:g} N or more on a wheel of {radius_m:g} m"
        faults.append(Fault("column 'vertical_load_n' is not in N", rows.name, f"median {found:.3g}", expected, in_kn))
    for name, ratios, of, unit in (
        ("drawbar_pull_n", rows.drawbar_pull_n / load, "x load", "mN"),
        ("driving_torque_nm", rows.driving_torque_nm / (load * radius_m), "x load x radius", "N mm"),
    ):
        sizes = np.abs(ratios[np.isfinite(ratios)])
        if len(sizes) and (size := float(np.median(sizes))) > _MOST_OF_LOAD:
            step = f"{in_kn}; if this column is in {unit}: --rename {name}={name}*0.001"
            expected = f"at most {_MOST_OF_LOAD:g} {of}"
            faults.append(
                Fault(f"column {name!r} does not fit the load", rows.name, f"{size:.3g} {of}", expected, step)
            )
    if faults:
        raise DataError(*faults)


def read_bench(
    path: Path, files: Files, *, rename: Iterable[str] | None = None, where: Iterable[str] | None = None
) -> BenchFiles:
    """Read a table of one wheel and its files; see `read_benches`.

    Parameters
    ----------
    files : Files
        Of these vehicle.toml, terrain.toml and the preset are taken.

    Raises
    ------
    ConfigError, DataError
        Everything that is wrong with any of them; the rows are of several wheels.
    """
    # The files of one wheel's table.
    vehicles = (str(files.vehicle),) if files.vehicle else ()
    found = read_benches(
        [path], TableFiles(vehicles, (files.terrain,) if files.terrain else (), files.soil), rename=rename, where=where
    )
    if len(found) > 1:
        raise ConfigError(several_wheels([wheel_test.rows for wheel_test in found]))
    return found[0]


def _name(part: WheelTable, parts: Sequence[WheelTable]) -> str:
    stem = Path(part.name).stem
    return f"{stem}, {part.wheel}" if len(parts) > 1 else stem


def _read(paths: Sequence[Path], rename: Iterable[str], where: Iterable[str]) -> list[list[WheelTable]]:
    if len(paths) == 1:
        return [read_wheel_tables(paths[0], rename=parse_rename(rename), where=parse_where(where))]
    shared = SharedOptions(rename, where)
    collected = Collected()
    tables = []
    for path in paths:
        with collected.catch():
            renamed, chosen = shared.fitting(column_names(path))
            tables.append(read_wheel_tables(path, rename=renamed, where=chosen))
    collected.stop_if_any()
    shared.refuse_unused()
    return tables


def _grounds(files: TableFiles, count: int) -> list[tuple[Soil, TerrainConfig | None]]:
    """Return the soil of each table."""
    _refuse_count("--terrain", len(files.terrains), count)
    if files.soil is None and not files.terrains:
        step = "give --terrain FILE (`wheelsoil soil` makes one of plate and shear tests), or --soil PRESET"
        raise ConfigError(Fault("the soil of the table is not known", next_step=step))
    labs = [load_terrain(path) for path in files.terrains] or [None]
    found = [(known_soil(files.soil, lab), lab) for lab in labs]
    return found * count if len(found) == 1 else found


def _refuse_count(option: str, given: int, tables: int) -> None:
    if given not in (0, 1, tables):
        what = f"{given} times {option} for {tables} table{'s' * (tables > 1)}"
        raise ConfigError(Fault(what, expected=f"one for all, or {tables} in the order of --table"))


@dataclass(frozen=True)
class _Vehicles:
    """Wheels of the files that were given: in the order of the tables, or by the names in a column ``wheel``."""

    listed: tuple[tuple[str, WheelSection], ...]
    named: dict[str, tuple[str, WheelSection]]
    tables: int

    @staticmethod
    def of(texts: Sequence[str], tables: int) -> _Vehicles:
        listed, named = [], {}
        collected = Collected()
        for text in texts:
            name, sign, path = text.partition("=")
            with collected.catch():
                if sign and not Path(text).exists():
                    named[name] = (path, _wheel(path))
                else:
                    listed.append((text, _wheel(text)))
        collected.stop_if_any()
        if listed and named:
            step = "give --vehicle NAME=FILE for every name in the column wheel, or none of them"
            raise ConfigError(Fault("--vehicle FILE and --vehicle NAME=FILE exclude each other", next_step=step))
        _refuse_count("--vehicle", len(listed), tables)
        return _Vehicles(tuple(listed), named, tables)

    def sections(self, index: int, parts: Sequence[WheelTable]) -> list[WheelSection]:
        """Return the wheel of each part of a table: what its file says with what its columns say."""
        if self.named:
            return [_merged(part, *self._of_name(part)) for part in parts]
        if not self.listed:
            return [_merged(part, "", None) for part in parts]
        source, section = self.listed[index if len(self.listed) > 1 else 0]
        if len(parts) > 1 and all(part.sizes == parts[0].sizes for part in parts):
            names = ", ".join(part.wheel for part in parts)
            step = (
                "choose one: --where wheel=NAME; or give --vehicle NAME=FILE for each, or columns radius_m, width_m, "
            )
            step += "lug_height_m"
            raise ConfigError(Fault("rows of several wheels, and one wheel file", parts[0].name, names, next_step=step))
        return [_merged(part, source, section) for part in parts]

    def _of_name(self, part: WheelTable) -> tuple[str, WheelSection]:
        if part.wheel not in self.named:
            step = f"give --vehicle {part.wheel or 'NAME'}=FILE, or exclude its rows with --where"
            found = part.wheel or "no column wheel"
            raise ConfigError(Fault("a wheel has no file", part.name, found, ", ".join(self.named), step))
        return self.named[part.wheel]


def _wheel(path: str) -> WheelSection:
    described = load_toml(Path(path), VehicleConfig)
    wheel_of(described, path)
    assert described.wheel is not None
    return described.wheel


def _merged(part: WheelTable, source: str, section: WheelSection | None) -> WheelSection:
    """Return what file and columns say of a wheel.

    `ConfigError` where they contradict each other, or leave radius or width open.
    """
    stated = section.model_dump(exclude_none=True) if section else {}
    against = [
        Fault(
            f"column {name!r} contradicts the wheel file",
            part.name,
            f"{value:g}{f' for {part.wheel}' if part.wheel else ''}",
            f"{stated[name]:g}, as {source} says",
            "correct one of them, choose the rows with --where, or give a wheel file for each wheel",
        )
        for name, value in part.sizes.items()
        if name in stated and not isclose(stated[name], value, rel_tol=1e-6)
    ]
    if against:
        raise ConfigError(*against)
    wheel = {**stated, **part.sizes}
    if "radius_m" not in wheel or "width_m" not in wheel:
        raise ConfigError(Fault("the wheel is not known", part.wheel or part.name, next_step=_NO_WHEEL))
    if "lug_count" in wheel:
        wheel["lug_count"] = round(wheel["lug_count"])
    if not wheel.get("lug_height_m"):
        wheel.pop("lug_count", None)
    return parse_mapping(wheel, WheelSection, part.name)
