"""Tables to Parquet, CSV and MATLAB files, units included."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ConfigError, DataError, Fault, HardwareError, nearest

if TYPE_CHECKING:
    import pandas as pd

Columns = Mapping[str, NDArray[Any]]
_LONGEST_MATLAB_NAME = 63


def write_table(path: str | Path, columns: Columns, units: Mapping[str, str] | None = None) -> Path:
    """Write columns of equal length as a table; see `write_blocks`."""
    return write_blocks(path, [columns], units)


def write_frame(path: str | Path, frame: pd.DataFrame) -> Path:
    """Write a frame as a table, with the units of its ``attrs["units"]``; see `write_blocks`, also for its errors.

    Parameters
    ----------
    frame : pandas.DataFrame
        Shape (n, columns), as `to_frame` of a channel or a processed run gives it; its index is not written.
    """
    columns = {name: frame[name].to_numpy() for name in frame.columns}
    columns = {name: values.astype(str) if values.dtype == object else values for name, values in columns.items()}
    return write_table(path, columns, frame.attrs.get("units", {}))


def write_blocks(path: str | Path, blocks: Iterable[Columns], units: Mapping[str, str] | None = None) -> Path:
    """Write a table that comes in blocks of rows; the suffix says which format.

    ``.parquet`` carries units in each field's metadata (key ``unit``), ``.csv`` in its header (``name [unit]``; NaN
    is an empty cell), ``.mat`` in a struct ``units`` and the original names in a struct ``names``, since MATLAB
    takes only letters, digits and underscores. A MATLAB file alone needs the whole table in memory.

    Parameters
    ----------
    path : str or Path
        A file that is there is replaced when the new one is whole.
    blocks : iterable of mapping str -> array, shape (n,)
        One at least, all with the same columns. Numbers, truth values or text.
    units : mapping str -> str, optional
        Of the columns that have one.

    Returns
    -------
    Path
        Where it was written.

    Raises
    ------
    ConfigError
        If the suffix is none of the three, or the file cannot be made there.
    DataError
        If columns differ in length, or there is a unit for a column that does not exist.
    HardwareError
        If the disk fails or is full.
    """
    target = Path(path)
    units = units or {}
    write = _WRITERS.get(target.suffix.lower())
    if write is None:
        what = f"tables are not written as {target.suffix or 'a file without a suffix'}"
        raise ConfigError.of(what, target, expected=", ".join(_WRITERS), next_step="choose one of these suffixes")
    checked = (_checked(block, units) for block in blocks)
    first = next(checked)
    try:
        with draft_of(target) as draft, draft.open("wb") as file:
            write(file, first, checked, units)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        step = "check the folder, and whether another program holds the file"
        raise ConfigError.of("the table cannot be made", target, error.strerror or str(error), next_step=step) from None
    except OSError as error:
        raise HardwareError.of(
            "the table cannot be written", target, error.strerror or str(error), next_step="free the disk"
        ) from None
    return target


@contextlib.contextmanager
def draft_of(target: Path) -> Iterator[Path]:
    """Give a file to write that replaces `target` at the end of the block; after an error it is deleted instead."""
    target = target.resolve()  # a link stays one
    draft = target.with_name(f".wheelsoil-{os.getpid()}{target.suffix}")
    try:
        yield draft
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: Path, text: str, errors: str = "replace") -> None:
    """Write a text as UTF-8; an older file is replaced only when all is written.

    Parameters
    ----------
    errors : str
        How a surrogate is written, which stands for a byte of a file name that is not UTF-8; see `str.encode`.

    Raises
    ------
    OSError
        It cannot be written.
    """
    content = text.encode(errors=errors)
    if path.exists() and not path.is_file():  # a pipe, a terminal
        path.write_bytes(content)
        return
    with draft_of(path) as draft:
        draft.write_bytes(content)


def _checked(columns: Columns, units: Mapping[str, str]) -> Columns:
    lengths = {name: column.shape for name, column in columns.items()}
    faults = [
        Fault(f"there is a unit for {name!r}, but no such column", expected=nearest(name, columns))
        for name in units
        if name not in columns
    ]
    if len(set(lengths.values())) > 1 or any(len(shape) != 1 for shape in lengths.values()):
        listed = ", ".join(f"{name} {shape}" for name, shape in lengths.items())
        faults.append(Fault("the columns of a table must be of one length", found=listed))
    if faults:
        raise DataError(*faults)
    return columns


def _write_parquet(file: Any, first: Columns, others: Iterable[Columns], units: Mapping[str, str]) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    types = {name: pa.array(column[:0]).type for name, column in first.items()}
    schema = pa.schema([pa.field(name, kind, metadata={"unit": units.get(name, "")}) for name, kind in types.items()])
    with pyarrow.parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for block in chain([first], others):
            writer.write_table(pa.table([pa.array(block[name]) for name in first], schema=schema))


def _write_csv(file: Any, first: Columns, others: Iterable[Columns], units: Mapping[str, str]) -> None:
    import pyarrow as pa
    import pyarrow.csv

    heads = [f"{name} [{units[name]}]" if units.get(name) else name for name in first]
    tables = (
        pa.table([pa.array(block[name], from_pandas=True) for name in first], names=heads)
        for block in chain([first], others)
    )
    table = next(tables)
    with pyarrow.csv.CSVWriter(file, table.schema) as writer:
        for part in chain([table], tables):
            writer.write_table(part)


def _write_mat(file: Any, first: Columns, others: Iterable[Columns], units: Mapping[str, str]) -> None:
    from scipy.io import savemat

    blocks = [first, *others]
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in first}
    names: dict[str, str] = {}
    for name in columns:
        names[_matlab_name(name, names)] = name
    content: dict[str, Any] = {}
    for short, name in names.items():
        column = columns[name]
        content[short] = column.astype(object) if column.dtype.kind in "US" else column  # text as a cell array
    content["units"] = {short: units.get(name, "") for short, name in names.items()}
    content["names"] = names
    savemat(file, content, long_field_names=True, do_compression=True, oned_as="column")


def _matlab_name(name: str, taken: Mapping[str, str]) -> str:
    """Return `name` as MATLAB allows it, numbered when it is taken."""
    plain = re.sub(r"[^0-9A-Za-z_]", "_", name)
    short = (plain if plain[:1].isalpha() else f"x{plain}")[:_LONGEST_MATLAB_NAME]
    candidate, number = short, 2
    while candidate in taken or candidate in ("units", "names"):
        tail = f"_{number}"
        candidate, number = short[: _LONGEST_MATLAB_NAME - len(tail)] + tail, number + 1
    return candidate


_WRITERS: dict[str, Callable[[Any, Columns, Iterable[Columns], Mapping[str, str]], None]] = {
    ".parquet": _write_parquet,
    ".csv": _write_csv,
    ".mat": _write_mat,
}
