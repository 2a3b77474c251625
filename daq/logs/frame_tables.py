"""CAN frames in delimited tables (CSV): of known programs by their header, of others by columns that a user names."""

from __future__ import annotations

import binascii
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from daq import ConfigError, Fault, SeriesSection, nearest
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameBatch, FrameFlag
from daq.logs.frame_cells import Data, bytes_of_cells, bytes_of_text, columns_of_text, different_rows
from daq.logs.report import EMPTY, HEADERS, LogReport
from daq.logs.shapes import text_blocks
from daq.series.blocks import SeriesReport
from daq.series.time_stamps import TimeStamps

_DELIMITERS = "\t;,|"
_SHOWN = 80
_MOST_BYTES = 64
_LEAST_DIGITS = 15
"""Of different cells: (10 / 16) ** 15 is .1 %."""
_LOOKED_AT = 50
_MOST_HEADS = 100_000
_HEX_DATA = re.compile(r"(?:0x)?(?:[0-9A-Fa-f]{2}\s?){1,64}$")


class Column(NamedTuple):
    """A column of a table, and how its cells are written."""

    name: str
    form: str = ""


@dataclass(frozen=True)
class FrameColumns:
    """Which columns of a table hold what of a frame.

    Attributes
    ----------
    time : Column
        Form: s, ms, us, ns, or empty (by size or by the header).
    can_id : Column
        Form: hex or dec; a hexadecimal one may begin with 0x and end with x. Empty: decided by the cells.
    data : tuple of Column
        One with all bytes, form hex or base64; or one for each byte, form hex or dec, or empty as above.
    others : mapping str -> column
        ``bus``, ``length``, ``extended``, ``direction``, ``remote``, ``error``, ``fd``, ``brs``, ``esi``; or ``flags``
        with the bits of Kvaser's canlib.
    first_bus : int
        Number of the bus that is can0.
    """

    time: Column
    can_id: Column
    data: tuple[Column, ...]
    others: Mapping[str, str]
    first_bus: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """All columns."""
        return (self.time.name, self.can_id.name, *(column.name for column in self.data), *self.others.values())


_OTHERS = ("bus", "length", "extended", "direction", "remote", "error", "fd", "brs", "esi")
_FORMS = {"time": ("s", "ms", "us", "ns", ""), "id": ("hex", "dec"), "data": ("hex", "dec", "base64")}
_EXAMPLE = "time=Time,id=MessageID:dec,data=Message"


PYTHON_CAN = FrameColumns(
    Column("timestamp", "s"),
    Column("arbitration_id", "hex"),
    (Column("data", "base64"),),
    {"extended": "extended", "remote": "remote", "error": "error", "length": "dlc"},
)
SAVVYCAN = FrameColumns(
    Column("Time Stamp", "us"),
    Column("ID", "hex"),
    tuple(Column(f"D{i}", "hex") for i in range(1, 9)),
    {"extended": "Extended", "direction": "Dir", "bus": "Bus", "length": "LEN"},
)
CSS_ELECTRONICS = FrameColumns(
    Column("TimestampEpoch", "s"),
    Column("ID", "hex"),
    (Column("DataBytes", "hex"),),
    {"bus": "BusChannel", "extended": "IDE", "length": "DataLength", "direction": "Dir", "fd": "EDL", "brs": "BRS"}
    | {"esi": "ESI", "remote": "RTR"},
)
KVASER = FrameColumns(
    Column("Time", "s"),
    Column("ID", "dec"),
    tuple(Column(f"Data{i}", "dec") for i in range(_MOST_BYTES)),
    {"bus": "Channel", "length": "DLC", "flags": "Flags"},
    first_bus=1,
)
CABANA = FrameColumns(Column("time", "s"), Column("addr", "dec"), (Column("data", "hex"),), {"bus": "bus"})
KNOWN = {"python-can": PYTHON_CAN, "SavvyCAN": SAVVYCAN, "CSS Electronics": CSS_ELECTRONICS, "Kvaser": KVASER}
KNOWN["comma.ai Cabana"] = CABANA
"""Headers of programs."""


def parse_columns(text: str) -> FrameColumns:
    """Parse ``time=Time,id=MessageID:dec,data=Message``; a data column for each byte is joined with ``+``.

    Raises
    ------
    ConfigError
        Lists every fault.
    """
    faults: list[Fault] = []
    found: dict[str, str] = {}
    for part in text.split(","):
        key, sign, value = (piece.strip() for piece in part.partition("="))
        if not sign or not value or key not in ("time", "id", "data", *_OTHERS):
            expected = nearest(key, ("time", "id", "data", *_OTHERS)) if sign else f"e.g. {_EXAMPLE}"
            faults.append(
                Fault(f"--columns {part.strip()}: not understood", expected=expected, next_step="correct this part")
            )
        found[key] = value
    faults += [
        Fault(f"--columns has no {key}=", expected=f"e.g. {_EXAMPLE}", next_step="add it")
        for key in ("time", "id", "data")
        if key not in found
    ]
    if faults:
        raise ConfigError(*faults)
    time, can_id = (_column(key, found[key]) for key in ("time", "id"))
    data = tuple(_column("data", name) for name in found["data"].split("+"))
    if len(data) == 1:
        data = (Column(data[0].name, data[0].form or "hex"),)
    return FrameColumns(time, can_id, data, {key: found[key] for key in _OTHERS if key in found})


def _column(key: str, text: str) -> Column:
    name, _, form = text.rpartition(":") if text.rpartition(":")[2] in _FORMS[key] and ":" in text else (text, "", "")
    return Column(name, form)


def columns_of(header: Sequence[str]) -> FrameColumns | None:
    """Return the columns of a program's table by its header, None for one that nobody has described to us."""
    there = {name.strip().lower() for name in header}
    for known in KNOWN.values():
        needed = {known.time.name, known.can_id.name, known.data[0].name}
        if {name.lower() for name in needed} <= there:
            return known
    return None


def header_of(head: bytes) -> tuple[str, list[str]]:
    """Return the delimiter and the cells of the first line."""
    line = head.removeprefix(b"\xef\xbb\xbf").partition(b"\n")[0].decode("utf-8", "replace").strip("\r")
    delimiter = max(_DELIMITERS, key=line.count)
    return delimiter, [cell.strip().strip('"') for cell in line.split(delimiter)]


def is_frame_table(head: bytes) -> bool:
    """Return whether a file is a table of frames: by a header that is known, or by data in hexadecimal digits."""
    delimiter, header = header_of(head)
    if columns_of(header):
        return True
    guess = _guess(header)
    if not all(guess.values()):
        return False
    lines = head.split(b"\n")[1:_LOOKED_AT]
    rows = [[cell.strip().strip('"') for cell in line.decode("ascii", "replace").split(delimiter)] for line in lines]
    cells = [row[header.index(guess["data"])] for row in rows if len(row) == len(header)]
    alike = sum(bool(_HEX_DATA.match(cell)) for cell in cells)
    return alike > 0.9 * len(cells) and any(re.search("[A-Fa-f]", cell) for cell in cells)


def read_frame_table(file: BinaryIO, report: LogReport, columns: FrameColumns | None = None) -> Iterator[FrameBatch]:
    """Yield the frames of a table; `columns` says which they are where its header is not known.

    `ConfigError` where the header is of no known program and `columns` is not given, or a named column is not there.
    """
    rows: _Rows | None = None
    line = 1
    for block in text_blocks(file, report):
        if rows is None:
            rows = _rows(block, report, columns)
            report.balance.come("lines", 1)
            report.balance.put_aside(HEADERS, 1)
            block = block.partition(b"\n")[2]
            line = 2
        count = block.count(b"\n") + (not block.endswith(b"\n"))
        report.balance.come("lines", count)
        yield from rows.read(block, line)
        line += count


def _rows(block: bytes, report: LogReport, columns: FrameColumns | None) -> _Rows:
    delimiter, header = header_of(block)
    chosen = columns or columns_of(header)
    if chosen is None:
        what, expected = "the header is of no known program", ", ".join(KNOWN)
        names = _guess(header)
        decided = _base_of(_cells_of(block, delimiter, header, (names["id"],))) if names["id"] else None
        names["id"] += f":{decided[0]}" if decided else ""
        guess = ",".join(f"{key}={name or '?'}" for key, name in names.items())
        step = f"import it, and say which columns hold what: `import --columns {guess}` (id=...:dec or id=...:hex)"
        raise ConfigError.of(what, report.path, ", ".join(header[:16]), expected, step)
    places = {name.lower(): i for i, name in enumerate(header)}
    absent = [name for name in chosen.names if name.lower() not in places]
    optional = {column.name for column in chosen.data[1:]} | (set() if columns else set(chosen.others.values()))
    faults = [
        Fault(
            f"no column is called {n!r}",
            report.path,
            ", ".join(header[:16]),
            nearest(n, header),
            "correct the name in --columns",
        )
        for n in absent
        if n not in optional
    ]
    if faults:
        raise ConfigError(*faults)
    return _Rows(_with_bases(chosen, block, delimiter, header, report), places, delimiter, report)


def _with_bases(
    chosen: FrameColumns, block: bytes, delimiter: str, header: Sequence[str], report: LogReport
) -> FrameColumns:
    """Return the columns with hex or dec for identifiers and bytes of which nobody says it; raises ConfigError."""
    for option, columns in (("id", (chosen.can_id,)), ("data", chosen.data)):
        if columns[0].form:
            continue
        names = tuple(column.name for column in columns)
        decided = _base_of(_cells_of(block, delimiter, header, names))
        if decided is None:
            what = f"the cells of {', '.join(names[:3])} may be hexadecimal or decimal"
            step = f"say which: `import --columns ...,{option}={names[0]}:hex or {option}={names[0]}:dec`"
            raise ConfigError.of(what, report.path, expected="a digit A to F, or many decimal digits", next_step=step)
        form, why = decided
        if form == "dec":
            report.readings.append(f"{', '.join(names[:3])} read as decimal, because {why}")
        typed = tuple(Column(column.name, form) for column in columns)
        chosen = replace(chosen, can_id=typed[0]) if option == "id" else replace(chosen, data=typed)
    return chosen


def _cells_of(block: bytes, delimiter: str, header: Sequence[str], names: Sequence[str]) -> set[str]:
    """Return the different cells of some columns in the first lines."""
    places = [i for i, name in enumerate(header) if name.lower() in {column.lower() for column in names}]
    rows = (line.replace('"', "").split(delimiter) for line in block.decode("utf-8", "replace").split("\n")[1:])
    return {row[i].strip() for row in rows for i in places if i < len(row)} - {""}


def _base_of(cells: set[str]) -> tuple[str, str] | None:
    """Return hex or dec, and why; None where cells can be either.

    A hexadecimal digit is above 9 in 6 of 16 cases: many digits without one are decimal.
    """
    digits = [cell.lower().removesuffix("x") for cell in cells]
    if any(re.search("[a-f]", cell) or cell.startswith("0x") for cell in digits):
        return "hex", "there are digits above 9"
    padded = any(len(cell) > 1 and cell.startswith("0") for cell in digits)
    count = sum(map(len, digits))
    if not padded and count >= _LEAST_DIGITS and all(cell.isdecimal() for cell in digits):
        return "dec", f"none of {count} digits of {len(cells)} different cells is above 9"
    return None


def _guess(header: Sequence[str]) -> dict[str, str]:
    """Return what columns may be, by their names, for a user to correct."""
    patterns = {
        "time": r"time|stamp",
        "id": r"\bid\b|id$|identifier",
        "data": r"^(?!.*(?:id$|len)).*(?:data|message|payload)",
    }
    return {
        key: next((name for name in header if re.search(pattern, name, re.IGNORECASE)), "")
        for key, pattern in patterns.items()
    }


class _Head(NamedTuple):
    """A frame without its time and data; a negative length is that of the data."""

    can_id: int
    flags: int
    bus: int
    length: int
    most: int
    has_data: bool
    needs_data: bool


_HEADS = np.dtype(list(zip(_Head._fields, ("i8", "i8", "i8", "i8", "i8", "?", "?"), strict=True)))
Cells = Sequence[str] | Mapping[int, str]
"""Of a row, by their place."""
_Frame = tuple[str, bytes, int, _Head, int]
"""Time, data, line, head and length; a plain tuple, for there are millions."""


class _Rows:
    """Takes the rows of a table apart; what is no frame is counted with its line."""

    def __init__(self, columns: FrameColumns, places: Mapping[str, int], delimiter: str, report: LogReport) -> None:
        self._delimiter, self._report = delimiter, report
        self._time, self._id = places[columns.time.name.lower()], places[columns.can_id.name.lower()]
        self._base = 16 if columns.can_id.form == "hex" else 10
        self._data = [places[column.name.lower()] for column in columns.data if column.name.lower() in places]
        self._form = columns.data[0].form
        self._first_bus = columns.first_bus
        self._others = {key: places[name.lower()] for key, name in columns.others.items() if name.lower() in places}
        self._stamps_report = SeriesReport(report.path, "times")
        self._stamps = TimeStamps(columns.time.name, columns.time.form, SeriesSection(), self._stamps_report)
        self._numeric: bool | None = None
        self._head_of: Callable[[Any], Any] = itemgetter(self._id, *self._others.values())
        self._heads: dict[Any, _Head] = {}

    def read(self, block: bytes, first_line: int) -> Iterator[FrameBatch]:
        """Yield the frames of whole lines, as one batch: by columns, or line by line where one is not as usual."""
        quick = self._by_columns(block)
        if quick is not None:
            yield from self._usable(*quick, first_line + np.arange(len(quick[0])))
            return
        found: list[_Frame] = []
        bad: list[tuple[int, str]] = []
        empty = -block.endswith(b"\n")  # what is behind the last line feed is no line
        for number, line in enumerate(block.decode("utf-8", "replace").split("\n"), first_line):
            if not line or line.isspace():
                empty += 1
                continue
            try:
                found.append(self._frame(line, number))
            except (ValueError, IndexError, KeyError) as error:
                text = line.rstrip("\r")
                bad.append((number, f"{text[:_SHOWN]} ({error})" if str(error) else text[:_SHOWN]))
        self._report.balance.put_aside(EMPTY, empty)
        if found:
            yield from self._batch(found, bad)
        else:
            self._note(bad)

    def _frame(self, line: str, number: int) -> _Frame:
        cells = (line.replace('"', "") if '"' in line else line).split(self._delimiter)
        key = self._head_of(cells)
        head = self._heads.get(key)
        if head is None:
            if len(self._heads) >= _MOST_HEADS:
                self._heads.clear()
            head = self._heads[key] = self._head([cell.strip() for cell in cells])
        data = self._bytes(cells, head.length) if head.has_data else b""
        length = len(data) if head.length < 0 else head.length
        if len(data) > head.most or (length > len(data) and head.needs_data):
            raise ValueError(f"{len(data)} bytes of data for a length of {length}")
        return cells[self._time], data, number, head, min(length, head.most)

    def _head(self, cells: Cells) -> _Head:
        """Return what the cells beside time and data say: there are few such rows, and many frames of each."""
        can_id, extended = self._identifier(cells[self._id])
        flags = FrameFlag(0)
        if self._is("extended", cells) if "extended" in self._others else extended:
            flags |= FrameFlag.EXTENDED
        elif can_id > 0x7FF:
            raise ValueError("an identifier above 7FF that is not extended")
        for key, flag in _FLAGS.items():
            if self._is(key, cells):
                flags |= flag
        bits = int(cells[self._others["flags"]]) if "flags" in self._others else 0
        for bit, flag in _KVASER_FLAGS.items():
            if bits & bit:
                flags |= flag
        if "direction" in self._others and cells[self._others["direction"]].lower() in ("tx", "1", "t"):
            flags |= FrameFlag.TRANSMITTED
        length = int(cells[self._others["length"]]) if "length" in self._others else -1
        if length < 0 and "length" in self._others:
            raise ValueError("a negative length")
        bus = cells[self._others["bus"]] if "bus" in self._others else "0"
        name = f"can{max(int(bus) - self._first_bus, 0)}" if bus.isdecimal() else bus or "can0"
        most = _MOST_BYTES if flags & FrameFlag.FD else 8
        has_data = not flags & FrameFlag.REMOTE
        needs_data = not flags & (FrameFlag.REMOTE | FrameFlag.ERROR)
        return _Head(can_id, int(flags), self._report.bus(name), length, most, has_data, needs_data)

    def _identifier(self, cell: str) -> tuple[int, bool]:
        digits = cell.lower()
        extended = digits.endswith("x") and self._base == 16 and digits != "0x"
        digits = digits.removesuffix("x") if extended else digits
        can_id = int(digits, 16 if digits.startswith("0x") else self._base)
        if not 0 <= can_id <= 0x1FFF_FFFF:
            raise ValueError("an identifier beyond 29 bits")
        return can_id, extended or can_id > 0x7FF

    def _is(self, key: str, cells: Cells) -> bool:
        return key in self._others and cells[self._others[key]].lower() in ("1", "true", "x", "yes", "e")

    def _bytes(self, cells: Sequence[str], length: int) -> bytes:
        if len(self._data) > 1:
            base = 16 if self._form == "hex" else 10
            own = [cells[place] for place in self._data if place < len(cells) and cells[place].strip()]
            return bytes(int(cell, base) for cell in (own[:length] if length >= 0 else own))
        cell = cells[self._data[0]].strip()
        if self._form == "base64":
            data = binascii.a2b_base64(cell, strict_mode=True)
        else:
            data = bytes.fromhex(cell.removeprefix("0x")) if self._form == "hex" else bytes(map(int, cell.split()))
        return data[:length] if length >= 0 else data

    def _batch(self, found: list[_Frame], bad: list[tuple[int, str]]) -> Iterator[FrameBatch]:
        import pyarrow as pa

        times, data, numbers, heads, lengths = zip(*found, strict=True)
        wide = any(flags & int(FrameFlag.FD) for flags in {head.flags for head in heads})
        frames = np.zeros(len(found), FD_DTYPE if wide else CLASSIC_DTYPE)
        room = frames["data"].shape[1]
        frames["can_id"] = [head.can_id for head in heads]
        frames["flags"] = [head.flags for head in heads]
        frames["bus"] = [head.bus for head in heads]
        frames["length"] = lengths
        joined = b"".join([payload.ljust(room, b"\0") for payload in data])
        frames["data"] = np.frombuffer(joined, np.uint8).reshape(-1, room)
        yield from self._usable(frames, pa.array(times, pa.string()), np.array(numbers), bad)

    def _by_columns(self, block: bytes) -> tuple[np.ndarray, Any] | None:
        """Return the frames of whole lines without their times, and the cells of these; None if a line is unusual."""
        places = (self._time, self._id, *self._others.values(), *self._data)
        columns = columns_of_text(block, self._delimiter, places)
        kinds = columns and different_rows([columns[place] for place in (self._id, *self._others.values())])
        if not columns or not kinds:
            return None
        first, kind = kinds
        if len(first) > _MOST_HEADS:
            return None
        try:
            heads = np.array([self._head_in(columns, row) for row in first.tolist()], _HEADS)
        except (ValueError, KeyError, OverflowError):
            return None
        each, wide = heads[kind], (heads["flags"] & int(FrameFlag.FD)).any()
        frames = np.zeros(len(kind), FD_DTYPE if wide else CLASSIC_DTYPE)
        room = frames["data"].shape[1]
        data = self._data_in(columns, each, room)
        if data is None:
            return None
        lengths = np.where(each["length"] < 0, data.lengths, each["length"])
        if ((data.lengths > each["most"]) | ((lengths > data.lengths) & each["needs_data"])).any():
            return None
        frames["can_id"], frames["flags"], frames["bus"] = each["can_id"], each["flags"], each["bus"]
        frames["length"], frames["data"] = np.minimum(lengths, each["most"]), data.values[:, :room]
        return frames, columns[self._time]

    def _head_in(self, columns: Mapping[int, Any], row: int) -> _Head:
        cells = {place: columns[place][row].as_py() for place in (self._id, *self._others.values())}
        key = self._head_of(cells)
        if key not in self._heads:
            self._heads[key] = self._head({place: cell.strip() for place, cell in cells.items()})
        return self._heads[key]

    def _data_in(self, columns: Mapping[int, Any], each: np.ndarray, room: int) -> Data | None:
        cells = [columns[place] for place in self._data]
        if len(cells) > 1:
            return bytes_of_cells(cells, 16 if self._form == "hex" else 10, each["has_data"], each["length"], room)
        data = None if self._form == "dec" else bytes_of_text(cells[0], self._form, each["has_data"], _MOST_BYTES)
        if data is None:
            return None
        return data.up_to(np.where(each["length"] < 0, data.lengths, each["length"]))

    def _usable(
        self, frames: np.ndarray, times: Any, lines: np.ndarray, bad: Sequence[tuple[int, str]] = ()
    ) -> Iterator[FrameBatch]:
        """Yield frames with their times, but for those that have none."""
        frames["time_ns"], usable = self._times(times)
        self._note(
            [*bad, *((lines[i], f"no time: {times[i].as_py()[:_SHOWN]}") for i in np.flatnonzero(~usable).tolist())]
        )
        frames, lines = frames[usable], lines[usable]
        self._report.local_time |= self._stamps_report.unzoned
        if len(frames):
            self._report.note_frames(frames, lambda i: f"line {lines[i]}")
            yield FrameBatch(frames, tuple(self._report.buses))

    def _note(self, bad: Iterable[tuple[int, str]]) -> None:
        for line, why in sorted(bad):
            self._report.note_bad(f"line {line}", why)

    def _times(self, cells: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return nanoseconds, and which are usable: numbers where the first one is a number, else dates."""
        import pyarrow as pa

        if self._numeric is None:
            self._numeric = _number(cells[0].as_py()) == _number(cells[0].as_py())
        if not self._numeric:
            return self._stamps.of(np.array(cells.to_pylist(), object))
        try:
            numbers = cells.cast(pa.float64()).to_numpy()
        except pa.ArrowInvalid:
            numbers = np.array([_number(cell) for cell in cells.to_pylist()])
        return self._stamps.of(numbers)


_KVASER_FLAGS = {
    0x01: FrameFlag.REMOTE,
    0x04: FrameFlag.EXTENDED,
    0x20: FrameFlag.ERROR,
    0x40: FrameFlag.TRANSMITTED,
    0x10000: FrameFlag.FD,
    0x20000: FrameFlag.BITRATE_SWITCH,
    0x40000: FrameFlag.ERROR_STATE,
}
_FLAGS = {
    "remote": FrameFlag.REMOTE,
    "error": FrameFlag.ERROR,
    "fd": FrameFlag.FD,
    "brs": FrameFlag.BITRATE_SWITCH,
    "esi": FrameFlag.ERROR_STATE,
}


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
