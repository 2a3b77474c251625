"""Tables of single-wheel, pressure-sinkage and shear tests, in SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from daq import ConfigError, DataError, Fault, FloatArray, IndexArray
from daq.series.tables import Source, Table, read_table

WHEEL_REQUIRED = ("slip", "vertical_load_n", "drawbar_pull_n")
WHEEL_OPTIONAL = ("driving_torque_nm", "sinkage_m")
WHEEL_SIZES = ("radius_m", "width_m", "lug_height_m", "lug_count")
"""Columns that describe the wheel of a row, beside its name in a column ``wheel``."""
SIZES = ("radius_m", "width_m", "length_m")
_OF_THE_WHEEL = re.compile(
    r"radius|diameter|(?<!rut_)(?<!track_)width|^(wheel|tyre|tire)([ _]?(id|no|nr|name|type|number|code))?$|lug",
    re.IGNORECASE,
)
"""Names of columns whose values belong to a wheel."""
_LONGEST_M = 2.0  # a longer sinkage or displacement is in millimetres
_LARGEST_PLATE_M = 1.0  # of the radius or width of a plate, and of a ring's outer radius
_STEADY = 0.05  # share by which a measured normal stress may vary within a test


@dataclass(frozen=True)
class WheelTable:
    """Rows of single-wheel tests; every array has shape (n,), and is all NaN where the table has no such column.

    Attributes
    ----------
    name : str
        Of the file.
    group : int array
        Position in `group_names`; rows of one group belong together (one soil preparation, one speed).
    sigma : mapping name -> array
        One-sigma of a column, from ``<name>_sigma``; only those that are there.
    lines : tuple of int
        Line of each row in the file; empty where the rows are of no file.
    wheel : str
        From a column ``wheel``; of several wheels without it, what differs.
    sizes : mapping name -> float
        Of `WHEEL_SIZES` those that the table has: one value for all rows.
    """

    name: str
    slip: FloatArray
    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    sinkage_m: FloatArray
    group: IndexArray
    group_names: tuple[str, ...]
    sigma: dict[str, FloatArray] = field(default_factory=dict)
    lines: tuple[int, ...] = ()
    wheel: str = ""
    sizes: dict[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.slip)


@dataclass(frozen=True)
class PlateTest:
    """One pressure-sinkage test.

    Attributes
    ----------
    sinkage_m : array, shape (n,)
        In the order of time, downwards positive.
    pressure_pa : array, shape (n,)
    width_m : float
        b of ``k_c / b + k_phi``: the smaller side of a rectangular plate, the radius of a round one (Bekker).
    """

    sinkage_m: FloatArray
    pressure_pa: FloatArray
    width_m: float
    name: str = ""


@dataclass(frozen=True)
class ShearTest:
    """One shear test under constant normal stress.

    Attributes
    ----------
    displacement_m, shear_stress_pa : array, shape (n,)
    """

    displacement_m: FloatArray
    shear_stress_pa: FloatArray
    normal_stress_pa: float
    name: str = ""


def refuse_repeated(tests: Sequence[WheelTable | PlateTest | ShearTest]) -> None:
    """Raise ConfigError where two tests have the same values: what is given twice would count twice."""
    faults = [
        Fault("the same test twice", " and ".join(dict.fromkeys((a.name, b.name))), next_step="leave one of them out")
        for a, b in combinations(tests, 2)
        if _values(a) == _values(b)
    ]
    if faults:
        raise ConfigError(*faults)


def _values(test: WheelTable | PlateTest | ShearTest) -> list[bytes]:
    return [value.tobytes() for value in vars(test).values() if isinstance(value, np.ndarray)]


def read_wheel_table(
    path: Path, *, rename: Mapping[str, Source] | None = None, where: Mapping[str, str] | None = None
) -> WheelTable:
    """Read single-wheel tests of one wheel; see `read_wheel_tables`.

    Raises
    ------
    ConfigError
        Also where the rows are of several wheels.
    DataError
        See `read_wheel_tables`.
    """
    tables = read_wheel_tables(path, rename=rename, where=where)
    if len(tables) > 1:
        raise ConfigError(several_wheels(tables))
    return tables[0]


def several_wheels(tables: Sequence[WheelTable]) -> Fault:
    """Return that the rows of one file are of several wheels, where one is expected."""
    names = [table.wheel for table in tables]
    step = "choose the rows of one: --where COLUMN=VALUE; `wheelsoil diagnose` takes several wheels"
    return Fault("the rows are of several wheels", tables[0].name, "; ".join(names), "one wheel", step)


def read_wheel_tables(
    path: Path, *, rename: Mapping[str, Source] | None = None, where: Mapping[str, str] | None = None
) -> list[WheelTable]:
    """Read single-wheel tests: columns ``slip, vertical_load_n, drawbar_pull_n`` and what else there is.

    Returns
    -------
    list of WheelTable
        One for each wheel: rows that agree in the columns ``wheel`` and `WHEEL_SIZES`, as far as there are any.

    Raises
    ------
    ConfigError
        See `read_table`; a required column is missing.
    DataError
        A cell is not a number, a load is not positive, a slip is not in -1 to 1, a sinkage or a sigma is negative, a
        wheel has no positive size, or lugs that are as high as its radius.
    """
    table = read_table(path, rename=rename, where=where)
    sizes = table.numbers((), WHEEL_SIZES)
    _refuse_unread_wheels(table, sizes)
    _refuse_sizes(table, sizes)
    names = table.columns.get("wheel", ("",) * len(table))
    wheels = [(name, *(float(column[i]) for column in sizes.values())) for i, name in enumerate(names)]
    kinds = list(dict.fromkeys(map(str, wheels)))
    parts = [table.kept([str(wheel) == kind for wheel in wheels]) for kind in kinds]
    whole = _wheel_table(table)
    if len(parts) == 1:
        return [replace(whole, wheel=names[0], sizes=_one_size(sizes, 0))]
    first = [list(map(str, wheels)).index(kind) for kind in kinds]
    each = [_one_size(sizes, i) for i in first]
    vary = [name for name in sizes if len({str(size.get(name)) for size in each}) > 1]
    vary = [name for name in vary if name != "lug_count" or vary == ["lug_count"]]
    return [
        replace(_wheel_table(part), wheel=_wheel_name(names[i], {n: size[n] for n in vary if n in size}), sizes=size)
        for part, i, size in zip(parts, first, each, strict=True)
    ]


def _wheel_name(name: str, varying: Mapping[str, float]) -> str:
    return name or ", ".join(f"{key} {value:g}" for key, value in varying.items()) or "no size"


def _one_size(sizes: Mapping[str, FloatArray], row: int) -> dict[str, float]:
    return {name: float(column[row]) for name, column in sizes.items() if math.isfinite(column[row])}


def _refuse_unread_wheels(table: Table, sizes: Mapping[str, FloatArray]) -> None:
    """Raise ConfigError where a column that describes the wheel differs and is not read: there are several wheels."""
    read = ("wheel", *WHEEL_SIZES, *(f"{name}_sigma" for name in WHEEL_SIZES))
    for name, values in table.columns.items() if "wheel" not in table else ():
        different = list(dict.fromkeys(values))
        covered = any(size.partition("_")[0] in name.lower() for size in sizes)
        if name not in read and not covered and _OF_THE_WHEEL.search(name) and len(different) > 1:
            raise ConfigError.of(
                f"the rows are of several wheels: column {name!r} has {len(different)} values and is not read",
                table.source,
                "; ".join(different[:5]),
                "one wheel, or a column radius_m, width_m or wheel",
                f"--rename radius_m={name} (width_m, wheel), or the rows of one wheel: --where {name}={different[0]}",
            )


def _refuse_sizes(table: Table, sizes: Mapping[str, FloatArray]) -> None:
    """Raise DataError for sizes that no wheel has."""
    faults = []
    for name, column in sizes.items():
        positive = name in ("radius_m", "width_m")
        good = ~(column <= 0) if positive else ~(column < 0)
        faults += _outside(table, name, good, "a positive size" if positive else "0 or more")
    if "lug_height_m" in sizes and "radius_m" in sizes:
        good = ~(sizes["lug_height_m"] >= sizes["radius_m"])
        step = "lug_height_m is in metres, from the rim to the tip: --rename lug_height_m=lug_height_m*0.001"
        faults += _outside(table, "lug_height_m", good, "lugs lower than the wheel's radius", step)
    if faults:
        raise DataError(*faults)


def _wheel_table(table: Table) -> WheelTable:
    measured = (*WHEEL_REQUIRED, *WHEEL_OPTIONAL)
    values = table.numbers(WHEEL_REQUIRED, (*WHEEL_OPTIONAL, *(f"{name}_sigma" for name in measured)))
    sigma = {name: values[f"{name}_sigma"] for name in measured if f"{name}_sigma" in values}
    faults = [
        *_outside(table, "vertical_load_n", values["vertical_load_n"] > 0, "a positive load"),
        *_outside(table, "slip", np.abs(values["slip"]) <= 1, "a slip from -1 to 1"),
    ]
    if "sinkage_m" in values:
        downwards = "sinkage counts downwards: --rename sinkage_m=sinkage_m*-1 turns it, or exclude the rows"
        faults += _outside(table, "sinkage_m", ~(values["sinkage_m"] < 0), "0 m or more", downwards)
        _refuse_other_units(table, "sinkage_m", values["sinkage_m"])
    for name, column in sigma.items():
        faults += _outside(table, f"{name}_sigma", ~(column < 0), "a one-sigma that is not negative")
    if faults:
        raise DataError(*faults)
    cells = table.columns.get("group", ("",) * len(table))
    names = tuple(dict.fromkeys(cells))
    absent = np.full(len(table), np.nan)
    return WheelTable(
        name=table.source,
        slip=values["slip"],
        vertical_load_n=values["vertical_load_n"],
        drawbar_pull_n=values["drawbar_pull_n"],
        driving_torque_nm=values.get("driving_torque_nm", absent),
        sinkage_m=values.get("sinkage_m", absent),
        group=np.array([names.index(cell) for cell in cells], np.intp),
        group_names=names,
        sigma=sigma,
        lines=table.lines,
    )


def read_plate_tests(
    path: Path,
    *,
    radius_m: float | None = None,
    width_m: float | None = None,
    rename: Mapping[str, Source] | None = None,
    where: Mapping[str, str] | None = None,
) -> list[PlateTest]:
    """Read plate tests: columns ``sinkage_m`` and ``pressure_pa`` or ``force_n``; a column ``test`` separates several.

    Parameters
    ----------
    radius_m : float, optional
        Of a round plate; or a column ``radius_m``.
    width_m : float, optional
        Smaller side of a rectangular plate; or a column ``width_m``. A force needs ``length_m``, the larger side, too.

    Raises
    ------
    ConfigError
        See `read_table`; no plate size, or two.
    DataError
        A cell is not a number, or a plate's size changes within a test.
    """
    table = read_table(path, rename=rename, where=where)
    parts = list(table.groups("test"))
    return [_plate_test(part, _test_name(path, label), radius_m, width_m) for label, part in parts]


def read_shear_tests(
    path: Path,
    *,
    ring_m: tuple[float, float] | None = None,
    rename: Mapping[str, Source] | None = None,
    where: Mapping[str, str] | None = None,
) -> list[ShearTest]:
    """Read shear tests: columns ``displacement_m, shear_stress_pa, normal_stress_pa``; of a ring, what it measures.

    A ring has ``rotation_rad`` and ``torque_nm`` instead of displacement and stress, and may have ``normal_force_n``.
    A column ``test`` parts several; where there is none, each normal stress is a test.

    Parameters
    ----------
    ring_m : (float, float), optional
        Inner and outer radius of a ring; or columns ``inner_radius_m`` and ``outer_radius_m``.

    Raises
    ------
    ConfigError
        See `read_table`; a torque or a force without the radii of the ring.
    DataError
        A cell is not a number, or the normal stress is negative or changes within a test.

    Source
    ------
    Wong, Theory of Ground Vehicles: the same stress over the ring, ``T = 2 pi / 3 (r_o^3 - r_i^3) tau``, and the
    displacement at its mean radius.
    """
    table = read_table(path, rename=rename, where=where)
    values = _shear_values(table, ring_m)
    normal = values["normal_stress_pa"]
    if "test" in table:
        labels: Sequence[str] = table.columns["test"]
    else:
        alone = np.ptp(normal) <= _STEADY * np.max(np.abs(normal))
        labels = [""] * len(table) if alone else [f"{stress:g}" for stress in normal]
    chosen = {label: np.array([cell == label for cell in labels]) for label in dict.fromkeys(labels)}
    return [
        _shear_test(table, {name: column[rows] for name, column in values.items()}, _test_name(path, label))
        for label, rows in chosen.items()
    ]


def _shear_values(table: Table, ring_m: tuple[float, float] | None) -> dict[str, FloatArray]:
    """Return displacement, shear stress and normal stress of all rows."""
    measured = {"displacement_m": "rotation_rad", "shear_stress_pa": "torque_nm", "normal_stress_pa": "normal_force_n"}
    names = tuple(ring if ring in table and plain not in table else plain for plain, ring in measured.items())
    values = dict(zip(measured, table.numbers(names).values(), strict=True))
    of_ring = [plain for plain, name in zip(measured, names, strict=True) if name != plain]
    if not of_ring:
        return values
    inner, outer = _ring_radii(table, ring_m)
    to_stress = {
        "displacement_m": (inner + outer) / 2,
        "shear_stress_pa": 3 / (2 * math.pi * (outer**3 - inner**3)),
        "normal_stress_pa": 1 / (math.pi * (outer**2 - inner**2)),
    }
    return values | {name: values[name] * to_stress[name] for name in of_ring}


def _ring_radii(table: Table, ring_m: tuple[float, float] | None) -> tuple[float, float]:
    columns = ("inner_radius_m", "outer_radius_m")
    if ring_m is None and not all(name in table for name in columns):
        what, expected = "the radii of the shear ring are not known", f"columns {' and '.join(columns)}"
        raise ConfigError.of(what, table.source, "", expected, "add the columns, or give --ring INNER OUTER")
    if ring_m is None:
        radii = table.numbers(columns)
        ring_m = (_constant(table, columns[0], radii[columns[0]]), _constant(table, columns[1], radii[columns[1]]))
    inner, outer = ring_m
    if not 0 <= inner < outer <= _LARGEST_PLATE_M:
        found, expected = f"{inner:g} and {outer:g} m", f"inner below outer, and this at most {_LARGEST_PLATE_M:g} m"
        step = (
            f"give them in metres; {outer:g} mm are {outer * 1e-3:.4g} m" if outer > _LARGEST_PLATE_M else "in metres"
        )
        raise ConfigError.of("these are no radii of a ring", table.source, found, expected, step)
    return inner, outer


def _shear_test(table: Table, values: Mapping[str, FloatArray], name: str) -> ShearTest:
    _refuse_other_units(table, "displacement_m", values["displacement_m"])
    normal = _constant(table, "normal_stress_pa", values["normal_stress_pa"], _STEADY)
    if normal < 0:
        raise DataError.of("the normal stress is negative", table.source, f"{normal:g} Pa", "0 Pa or more")
    return ShearTest(values["displacement_m"], values["shear_stress_pa"], normal, name)


def _plate_test(table: Table, name: str, radius_m: float | None, width_m: float | None) -> PlateTest:
    load = "pressure_pa" if "pressure_pa" in table else "force_n"
    values = table.numbers(("sinkage_m", load), SIZES)
    _refuse_other_units(table, "sinkage_m", values["sinkage_m"])
    sizes: dict[str, float] = {key: _constant(table, key, values[key]) for key in SIZES if key in values}
    sizes |= {key: size for key, size in (("radius_m", radius_m), ("width_m", width_m)) if size is not None}
    for key, size in sizes.items():
        if not (math.isfinite(size) and size > 0):
            raise ConfigError.of(f"{key} must be positive", table.source, found=f"{size:g}")
        if key != "length_m" and size > _LARGEST_PLATE_M:
            step = f"give it in metres; {size:g} mm are {size * 1e-3:.4g} m"
            found, expected = f"{size:g} m", f"at most {_LARGEST_PLATE_M:g} m"
            raise ConfigError.of(f"{key} is the size of no plate", table.source, found, expected, step)
    if ("radius_m" in sizes) == ("width_m" in sizes):
        raise ConfigError(_no_size(table, sizes))
    b = sizes.get("radius_m", sizes.get("width_m", math.nan))
    pressure = values[load] if load == "pressure_pa" else values[load] / _area(table, sizes)
    return PlateTest(values["sinkage_m"], pressure, b, name)


def _no_size(table: Table, sizes: Mapping[str, float]) -> Fault:
    if sizes.keys() >= {"radius_m", "width_m"}:
        return Fault("a plate has a radius or a width, not both", table.source, next_step="give one of them")
    expected, step = "a column radius_m (round) or width_m (rectangular)", "add the column, or give --radius or --width"
    return Fault("the size of the plate is not known", table.source, "", expected, step)


def _area(table: Table, sizes: Mapping[str, float]) -> float:
    if "radius_m" in sizes:
        return math.pi * sizes["radius_m"] ** 2
    if "length_m" not in sizes:
        step = "add a column length_m, or give pressure_pa instead of force_n"
        raise ConfigError.of("a force on a rectangular plate needs the plate's length", table.source, next_step=step)
    return sizes["width_m"] * sizes["length_m"]


def _constant(table: Table, name: str, values: FloatArray, share: float = 1e-6) -> float:
    if np.ptp(values) > share * np.max(np.abs(values)):
        found, step = f"{np.min(values):g} to {np.max(values):g}", "name the tests in a column 'test'"
        raise DataError.of(f"column {name!r} changes within one test", table.source, found, next_step=step)
    return float(np.mean(values))


def _refuse_other_units(table: Table, name: str, values: FloatArray) -> None:
    longest = float(np.nanmax(np.abs(values), initial=0.0))
    if longest > _LONGEST_M:
        step = f"if it is in millimetres: --rename {name}={name}*0.001"
        raise DataError.of(f"column {name!r} is not in metres", table.source, f"up to {longest:g}", next_step=step)


def _outside(table: Table, name: str, good: Iterable[bool], expected: str, next_step: str = "") -> list[Fault]:
    bad: Sequence[int] = np.flatnonzero(~np.asarray(good)).tolist()
    if not bad:
        return []
    listed = ", ".join(f"line {table.lines[i]}: {table.columns[name][i]}" for i in bad[:5])
    more = f" and {len(bad) - 5} more" if len(bad) > 5 else ""
    return [Fault(f"column {name!r} has impossible values", table.source, listed + more, expected, next_step)]


def _test_name(path: Path, label: str) -> str:
    return f"{path.stem}: {label}" if label else path.stem
