"""MATLAB files (v5 to v7.3) and HDF5 files of decoded series: vectors, structs with time, Simulink logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daq import RecordingError, SeriesSection, not_installed
from daq.series.blocks import Series, SeriesReport
from daq.series.readers.groups import Column, array_column, series_of

_LARGE_BYTES = 500 << 20
_VALUES = ("values", "value", "data", "Data", "Values", "y", "signal")
_TIMES = ("time", "Time", "t", "x_time", "timestamps", "Timestamps")
_UNITS = ("unit", "units", "Unit", "Units")
_SHORT = "less than two values"
_CHUNK_CACHE_BYTES = 64 << 20
"""A compressed chunk is unpacked once for all the columns and blocks that lie in it."""
_MOST_SIDE = 512
"""Columns of a matrix that are taken; a larger one is no set of channels."""


def read_mat(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a MAT file; one before v7.3 is read whole.

    Vectors are columns, matrices with more rows than columns are ``name[0]``, ``name[1]``, ...; members of structs have
    dotted names. A struct with values and a time (Simulink, many loggers) is a column with that time. Units are members
    ``unit`` or ``units`` of a struct, or of a variable ``units``. `RecordingError` for a file that cannot be read,
    `DataError` for one without series.
    """
    with path.open("rb") as file:
        if file.read(4) == b"\x89HDF" or (file.seek(512) and file.read(4) == b"\x89HDF"):
            return read_hdf5(path, layout, report)
    from scipy.io import loadmat

    if path.stat().st_size > _LARGE_BYTES:
        report.known.append(
            f"the file ({path.stat().st_size / 1e9:.1f} GB) was read whole: save it as v7.3 to need less memory"
        )
    try:
        variables = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        return read_hdf5(path, layout, report)
    except Exception as error:  # noqa: BLE001  # scipy raises whatever its parser meets in a damaged file
        raise RecordingError.of("the MAT file cannot be read", path, str(error)) from None
    plain = {name: value for name, value in variables.items() if not name.startswith("__")}
    units = _unit_texts(plain.pop("units", None))
    names = _unit_texts(plain.pop("names", None))
    found = list(_flattened("", plain, units, report))
    return series_of([_renamed(column, names) for column in found], layout, report)


def _renamed(column: Column, names: Mapping[str, str]) -> Column:
    """Undo the shortened names of our own export."""
    name = names.get(column.name, column.name)
    return Column(name, column.unit, column.length, column.cells, names.get(column.time, column.time))


def _unit_texts(value: Any) -> dict[str, str]:
    members = {name: getattr(value, name) for name in getattr(value, "_fieldnames", ())}
    return {name: text for name, text in members.items() if isinstance(text, str)}


def _members(value: Any) -> dict[str, Any] | None:
    if isinstance(value, Mapping):
        return dict(value)
    names = getattr(value, "_fieldnames", None)
    return None if names is None else {name: getattr(value, name) for name in names}


def _flattened(
    prefix: str, members: Mapping[str, Any], units: Mapping[str, str], report: SeriesReport, outer_time: str = ""
) -> Iterator[Column]:
    """Yield the columns of a struct and of those in it; they take the time of the nearest struct that has one."""
    time = next((prefix + name for name in _TIMES if name in members and _length(members[name]) > 1), outer_time)
    stated = next((str(members[name]) for name in _UNITS if isinstance(members.get(name), str)), "")
    for name, value in members.items():
        path = prefix + name
        structs = _structs(value)
        if structs:
            for i, struct in enumerate(structs):
                yield from _flattened(f"{prefix}{_part(name, struct, i, len(structs))}.", struct, {}, report, time)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim in (1, 2):
            unit = units.get(name, "") or (stated if name in _VALUES else "")
            short = prefix[:-1] if prefix and name in _VALUES else path
            yield from _arrays(short, value, unit, "" if path == time else time, report)
        elif not isinstance(value, (str, bytes, int, float, complex, np.generic)) and name not in _UNITS:
            numbers = isinstance(value, np.ndarray) and value.dtype.kind in "fiub"
            report.skipped[path] = f"an array of {value.ndim} dimensions" if numbers else "no numbers"


def _structs(value: Any) -> list[dict[str, Any]]:
    ones = value.ravel() if isinstance(value, np.ndarray) and value.dtype == object else [value]
    return [members for element in ones if (members := _members(element)) is not None]


def _part(name: str, struct: Mapping[str, Any], i: int, count: int) -> str:
    """Return what a struct is called: its label (Simulink), of several its name, else the variable's."""
    keys = ("label", "name", "Name") if count > 1 else ("label",)
    stated = next((text for key in keys if isinstance(text := struct.get(key), str) and text), "")
    return stated or (name if count == 1 else f"{name}[{i}]")


def _length(value: Any) -> int:
    return len(value) if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiu" else 0


def _arrays(name: str, value: Any, unit: str, time: str, report: SeriesReport) -> Iterator[Column]:
    if value.ndim == 1:
        if len(value) > 1:
            yield array_column(name, value, unit, time)
        else:
            report.skipped[name] = _SHORT
        return
    if value.shape[1] > value.shape[0]:
        value = value.T
    if value.shape[1] > _MOST_SIDE:
        report.skipped[name] = f"a matrix of {value.shape[0]} x {value.shape[1]}"
        return
    for i in range(value.shape[1]):
        yield array_column(f"{name}[{i}]", value[:, i], unit, time)


def read_hdf5(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open an HDF5 or MAT v7.3 file: datasets are columns, groups their paths; the attribute ``unit`` is the unit.

    Raises as `read_mat`, and ConfigError where h5py is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise not_installed("HDF5 and MAT v7.3 files", "h5py", path, "series") from None
    columns: list[Column] = []
    try:
        _visit(h5py.File(path, "r", rdcc_nbytes=_CHUNK_CACHE_BYTES), "", columns, report)  # closed by its last dataset
    except (OSError, RuntimeError, KeyError) as error:
        raise RecordingError.of("the HDF5 file cannot be read", path, str(error)) from None
    return series_of(columns, layout, report)


def _visit(group: Any, prefix: str, columns: list[Column], report: SeriesReport) -> None:
    import h5py

    times = [f"{prefix}{name}" for name in _TIMES if isinstance(group.get(name), h5py.Dataset) and group[name].size > 1]
    texts = {name: _matlab_text(group[name]) for name in _UNITS if isinstance(group.get(name), h5py.Dataset)}
    stated = next((text for text in texts.values() if text), "")
    for name, item in group.items():
        full = f"{prefix}{name}"
        if isinstance(item, h5py.Group):
            if not name.startswith("#"):
                _visit(item, f"{full}.", columns, report)
        elif item.dtype.kind not in "fiub" or name in texts:
            if item.dtype.kind not in "fiub":
                report.skipped[full] = "no numbers"
        elif item.size > 1 and sum(side > 1 for side in item.shape) <= 2:
            unit = _attribute(item) or (stated if name in _VALUES else "")
            short = prefix[:-1] if prefix and name in _VALUES else full
            time = times[0] if times and full not in times else ""
            columns += _dataset_columns(short, full, item, unit, time, report)
        else:
            report.skipped[full] = _SHORT if item.size <= 1 else f"an array of {item.ndim} dimensions"


def _dataset_columns(name: str, full: str, item: Any, unit: str, time: str, report: SeriesReport) -> list[Column]:
    sides = [i for i, side in enumerate(item.shape) if side > 1]
    if len(sides) == 1:
        return [Column(name, unit, item.shape[sides[0]], _cells(item, sides[0], ()), time)]
    long, short = sorted(sides, key=lambda i: -item.shape[i])
    if item.shape[short] > _MOST_SIDE:
        report.skipped[full] = f"a matrix of {item.shape[long]} x {item.shape[short]}"
        return []
    return [
        Column(f"{name}[{i}]", unit, item.shape[long], _cells(item, long, ((short, i),)), time)
        for i in range(item.shape[short])
    ]


def _cells(item: Any, along: int, fixed: Sequence[tuple[int, int]]) -> Any:
    def read(start: int, end: int) -> Any:
        index: list[Any] = [0] * item.ndim
        index[along] = slice(start, end)
        for side, at in fixed:
            index[side] = at
        return item[tuple(index)]

    return read


def _attribute(item: Any) -> str:
    for name in _UNITS:
        value = item.attrs.get(name)
        if value is not None:
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return ""


def _matlab_text(item: Any) -> str:
    """Return the text of a MATLAB char array, which v7.3 keeps as numbers."""
    if item.dtype.kind == "u" and item.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.asarray(item).ravel()))
    return ""
