"""DBC files through cantools: loading, repairs of a lenient load, files that ship, and the databases of each bus."""

from __future__ import annotations

import hashlib
import logging
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from daq.can.bits import Message, RawKind, Signal
from daq.can.database_limits import MOST_BITS, of_bits, of_length, too_long
from daq.can.signal_places import misplaced
from daq.config import VehicleConfig
from daq.errors import DatabaseError, Fault, every_error_as, nearest, shortened
from daq.limits import LARGEST_DBC_BYTES, LONGEST_MESSAGE_BYTES

_MESSAGE_LINE = re.compile(r"^\s*BO_\s+(\d+)\s+(\S+?)\s*:", re.MULTILINE)
_DANGLING = re.compile(r"^\s*((?:VAL_|SIG_VALTYPE_) \d+ \w+)\s*$", re.MULTILINE)
_OVERLONG = re.compile(r"(Standard|Extended) frame id 0x[0-9a-f]+ is more than (\d+) bits")
_SYNTAX = re.compile(r"[Ii]nvalid syntax at line (\d+), column (\d+)")
_IN_MESSAGE = re.compile(r"^The signals? (\w+)(?: and (\w+) are overlapping| does not fit) in message (\w+)")
_MULTIPLEXER = re.compile(r"\s*SG_\s+\S+\s+(?:m\d+)?M\s*:")
_WITH_SEMICOLON = ("VAL_", "CM_", "BA_", "SIG_VALTYPE_", "VAL_TABLE_", "SIG_GROUP_", "BO_TX_BU_", "SG_MUL_VAL_")
_STATEMENTS = ("BO_", "SG_", *_WITH_SEMICOLON)

LENIENT_HINT = "correct the file, or load it without what is refused: --lenient-dbc (what was excluded is listed)"
MAX_SIGNAL_BITS = 64
_KINDS = {".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"}
_SILENT = logging.NullHandler()  # what cantools warns of (names and identifiers twice) is said by us


@dataclass(frozen=True)
class BadLine:
    """A line that cantools refuses.

    Attributes
    ----------
    number : int
        Counted from 1.
    end : int
        Last line of what must go with it (the block of a message, a statement of several lines).
    """

    number: int
    text: str
    why: str
    end: int

    def __str__(self) -> str:
        more = f" (and the {self.end - self.number} lines behind it)" if self.end > self.number else ""
        return f"line {self.number}: {shortened(self.text.strip())}: {self.why}{more}"


def decode_text(content: bytes) -> str:
    """Return the text of a DBC: UTF-8 where it is that, else Windows-1252 as Vector's tools write it."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def bad_lines(text: str, complaint: str) -> list[BadLine]:
    """Return the lines that a complaint of cantools is about; none when it cannot be traced to lines."""
    lines = text.split("\n")
    dangling = _DANGLING.findall(complaint)
    if dangling and "unused" in complaint:
        return _dangling_lines(lines, dangling)
    overlong = _OVERLONG.search(complaint)
    if overlong:
        return _overlong_blocks(lines)
    syntax = _SYNTAX.search(complaint)
    if syntax:
        return _statement_at(lines, int(syntax[1]), int(syntax[2]))
    clash = _IN_MESSAGE.search(complaint)
    return _signal_lines(lines, clash[3], [n for n in clash.group(1, 2) if n], complaint) if clash else []


def without(text: str, bad: Iterable[BadLine]) -> str:
    """Return the text with these lines emptied, so that line numbers stay."""
    lines = text.split("\n")
    for line in bad:
        lines[line.number - 1 : line.end] = [""] * (line.end - line.number + 1)
    return "\n".join(lines)


def _dangling_lines(lines: list[str], names: list[str]) -> list[BadLine]:
    found = []
    for name in names:
        keyword, number, signal = name.split()
        pattern = re.compile(rf"^\s*{keyword}\s+{number}\s+{signal}\b")
        why = f"there is no signal {signal} in a message {number}"
        found += [
            BadLine(i, line, why, _statement_end(lines, i)) for i, line in enumerate(lines, 1) if pattern.match(line)
        ]
    return found


def _overlong_blocks(lines: list[str]) -> list[BadLine]:
    found = []
    for i, line in enumerate(lines, 1):
        block = _MESSAGE_LINE.match(line)
        if not block:
            continue
        number = int(block[1])
        bits, kind = (29, "a 29-bit") if number & 0x8000_0000 else (11, "an 11-bit")
        if (number & 0x7FFF_FFFF) >> bits:
            why = f"0x{number & 0x7FFFFFFF:X} is too long for {kind} identifier (29-bit ones have bit 31 set in a DBC)"
            found.append(BadLine(i, line, why, _block_end(lines, i)))
    return found


def _statement_at(lines: list[str], number: int, column: int) -> list[BadLine]:
    """Return the statement with a syntax error, or nothing when leaving it out could change its neighbours."""
    if not 1 <= number <= len(lines):
        return []
    line = lines[number - 1]
    why = f"syntax error at column {column}"
    first = line.split(maxsplit=1)[0] if line.strip() else ""
    if first in _STATEMENTS and column > line.index(first) + 1:
        start, end = number, _statement_end(lines, number)
        if first == "BO_" or _MULTIPLEXER.match(line):
            # The line of the `BO_` that line `number` belongs to, 0 where there is none.
            start = next((i for i in range(number, 0, -1) if lines[i - 1].lstrip().startswith("BO_ ")), 0)
            end = _block_end(lines, start)
        return [BadLine(start, lines[start - 1], why, end)] if start else []
    before = next((i for i in range(number - 1, 0, -1) if lines[i - 1].strip()), 0)
    unended = before and ";" not in lines[before - 1] and lines[before - 1].split()[0] in _WITH_SEMICOLON
    return [BadLine(before, lines[before - 1], "the statement has no end (;)", before)] if unended else []


def _signal_lines(lines: list[str], message: str, signals: list[str], complaint: str) -> list[BadLine]:
    inside, found = False, []
    for i, line in enumerate(lines, 1):
        block = _MESSAGE_LINE.match(line)
        inside = block[2] == message if block else inside
        name = re.match(r"\s*SG_\s+(\w+)", line)
        if inside and name and name[1] in signals:
            found.append(BadLine(i, line, complaint.rstrip("."), i))
    return found


def _block_end(lines: list[str], start: int) -> int:
    """Return the last line of the ``BO_`` block that starts at line `start`."""
    end = start
    for i in range(start + 1, len(lines) + 1):
        line = lines[i - 1].strip()
        if re.match(r"SG_\s", line):
            end = i
        elif line and not line.startswith("//"):
            break
    return end


def _statement_end(lines: list[str], start: int) -> int:
    """Return the line that ends the statement at line `start`: its own, or for a long text that of its semicolon."""
    if not lines[start - 1].lstrip().startswith(_WITH_SEMICOLON):
        return start
    text = ""
    for i in range(start, len(lines) + 1):
        text += lines[i - 1].replace('\\"', "")
        if text.count('"') % 2 == 0 and ";" in re.sub(r'"[^"]*"', "", text):
            return i
    return start


@dataclass(frozen=True)
class Database:
    """One DBC file.

    Attributes
    ----------
    name : str
        File name, for people and for the attachment of a recording.
    content : bytes
        The file as it was read.
    left_out : tuple of str
        What a lenient load excluded or let pass, a sentence each; empty after a strict load.
    lenient : bool
        How it was loaded; a recording keeps this, so that it can be loaded again.
    """

    name: str
    content: bytes
    messages: tuple[Message, ...]
    left_out: tuple[str, ...] = ()
    lenient: bool = False

    @property
    def sha256(self) -> str:
        """Hash of the file, in hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()


def load_database(source: Path | str | bytes, name: str = "", *, lenient: bool = False) -> Database:
    """Load a DBC file; or KCD, SYM or ARXML, by the suffix of its name.

    Parameters
    ----------
    source : path or bytes
        The file, or its content (an attachment of a recording).
    name : str, optional
        For messages; the file's name when `source` is a path.
    lenient : bool
        Leave out the lines that cantools refuses, let signals overlap or reach beyond their message, and list all
        of that in ``left_out``.

    Raises
    ------
    DatabaseError
        The file is not there or cannot be used; names the lines, and offers the lenient load where that helps.
    """
    if isinstance(source, bytes):
        content, where = source, name or "DBC"
    else:
        content, where = _read(Path(source)), str(source)
    if len(content) > LARGEST_DBC_BYTES:
        found, expected = f"{len(content):,} bytes", f"at most {LARGEST_DBC_BYTES:,}"
        raise DatabaseError.of("a DBC that is too large", where, found, expected, "check that this is the right file")
    text = decode_text(content)
    messages: list[Message] = []
    parsed = None

    def place() -> str:
        return where if parsed is None else f"{where}, message {parsed.messages[len(messages)].name}"

    with every_error_as(DatabaseError, "the DBC cannot be used", place):
        kind = _KINDS.get(Path(name or where).suffix.lower(), "dbc")
        leniently = lenient and kind == "dbc"
        parsed, notes = _parse_lenient(text, where) if leniently else (_parse_strict(text, where, kind), [])
        messages.extend(_message(message, parsed) for message in parsed.messages)
    messages, more = _without_doubles(messages, where, lenient=lenient)
    return Database(name or Path(where).name, content, tuple(messages), (*notes, *more), lenient)


def shipped_dbc(name: str) -> Path:
    """Return the path of a file in ``dbc/``, in a checkout and in an installed wheel alike.

    Raises
    ------
    DatabaseError
        No file of that name ships with wheelsoil.
    """
    here = Path(__file__).parents[1]
    folder = next((f for f in (here / "_dbc", here.parent / "dbc") if (f / "wft.dbc").is_file()), here / "_dbc")
    path = folder / name
    if not path.is_file():
        known = nearest(name, (p.name for p in folder.glob("*.dbc")))
        raise DatabaseError.of(f"no DBC called {name!r} ships with wheelsoil", folder, expected=known)
    return path


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        known = nearest(path.name, (p.name for p in path.parent.glob("*.dbc"))) if path.parent.is_dir() else ""
        raise DatabaseError.of("no such DBC file", path, expected=known, next_step="check the path") from None
    except OSError as error:
        raise DatabaseError.of(
            "the DBC file cannot be read", path, str(error), "", "check the path and its permissions"
        ) from None


def _parse(text: str, kind: str = "dbc") -> tuple[Any, str]:
    """Return cantools' database, or None and its complaint; where signals lie is looked at by `misplaced`."""
    from daq.can.library import database, errors

    logging.getLogger("cantools").addHandler(_SILENT)
    try:
        return database.load_string(text, kind, strict=False), ""
    except errors.UnsupportedDatabaseFormatError as error:
        return None, str(error.e_dbc or error)


def _too_long(text: str, kind: str = "dbc") -> list[BadLine]:
    """Return the lines of what no bus can carry, a message with those of its signals."""
    lines = text.split("\n")
    found = []
    for start, end, why in too_long(text, kind):
        first, last = (text.count("\n", 0, at) + 1 for at in (start, end))
        if kind == "dbc" and text.startswith("BO_", start):
            last = max(last, _block_end(lines, last))
        found.append(BadLine(first, lines[first - 1], why, last))
    return found


def _parse_strict(text: str, where: str, kind: str) -> Any:
    bad = _too_long(text, kind)
    parsed, complaint = (None, "") if bad else _parse(text, kind)
    complaint = complaint or next(_misplaced(parsed), "")
    if parsed is not None and not complaint:
        return parsed
    bad = bad or (bad_lines(text, complaint) if kind == "dbc" else [])
    if not bad:
        raise DatabaseError.of(
            f"cantools cannot load this {kind.upper()}", where, complaint, next_step="correct the file"
        )
    step = LENIENT_HINT if kind == "dbc" else "correct the file"
    texts = [
        (f"this {kind.upper()} is refused: {line.why}", f"line {line.number}: {shortened(line.text.strip())}")
        for line in bad
    ]
    raise DatabaseError(*(Fault(what, where, found, "", step) for what, found in texts))


def _parse_lenient(text: str, where: str) -> tuple[Any, list[str]]:
    excluded = _too_long(text)
    text = without(text, excluded)
    parsed, complaint = _parse(text)
    while parsed is None and text.strip():
        bad = bad_lines(text, complaint)
        if not bad:
            what = "cantools cannot load this DBC, not even leniently"
            raise DatabaseError.of(what, where, complaint, next_step="correct the file")
        excluded += bad
        text = without(text, bad)
        parsed, complaint = _parse(text)
    if parsed is None or (excluded and not parsed.messages):
        what = f"{len(excluded)} faults, the first: {excluded[0]}" if excluded else "an empty file"
        raise DatabaseError.of("nothing is left of this DBC", where, what, "", "export it again from its program")
    notes = [f"excluded {line}" for line in sorted(excluded, key=lambda line: line.number)]
    return parsed, [*notes, *(f"let pass: {told.rstrip('.')}" for told in _misplaced(parsed))]


def _misplaced(parsed: Any) -> Iterator[str]:
    """Yield the first misplaced signal of every message."""
    return filter(None, map(misplaced, parsed.messages if parsed is not None else ()))


def _without_doubles(messages: list[Message], where: str, *, lenient: bool) -> tuple[list[Message], list[str]]:
    """Refuse two messages with one identifier; a lenient load keeps the last, as cantools does."""
    last = {message.key: message for message in messages}
    doubled = [m for m in messages if last[m.key] is not m]
    if doubled and not lenient:
        texts = [(m.id_text(), f"{m.name}, {last[m.key].name}") for m in doubled]
        raise DatabaseError(*(Fault(f"{i} is defined twice", where, names, "", LENIENT_HINT) for i, names in texts))
    notes = [f"excluded {m.name}: {last[m.key].name} has the same identifier {m.id_text()}" for m in doubled]
    for key, message in last.items():
        long = [s for s in message.signals if s.length_bits > MAX_SIGNAL_BITS]
        notes += [f"excluded {message.name}.{s.name}: longer than {MAX_SIGNAL_BITS} bits" for s in long]
        if long:
            last[key] = replace(message, signals=tuple(s for s in message.signals if s not in long))
    return list(last.values()), notes


def _message(message: Any, parsed: Any) -> Message:
    if message.length > LONGEST_MESSAGE_BYTES:
        raise ValueError(of_length(message.length))
    attributes = (parsed.dbc.attributes if parsed.dbc else None) or {}
    protocol = str(attributes["ProtocolType"].value) if "ProtocolType" in attributes else ""
    j1939 = message.is_extended_frame and (message.protocol == "j1939" or "J1939" in protocol.upper())
    return Message(
        name=message.name,
        can_id=message.frame_id,
        extended=message.is_extended_frame,
        length=message.length,
        signals=tuple(_signal(signal) for signal in message.signals),
        cycle_time_s=_cycle_time_s(message.cycle_time),
        j1939=j1939,
        fd=message.is_fd,
        comment=message.comment or "",
    )


def _cycle_time_s(value: object) -> float | None:
    """Return GenMsgCycleTime, in ms, as seconds; some files define it as a text or leave it 0."""
    try:
        milliseconds = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    return milliseconds * 1e-3 if 0 < milliseconds < math.inf else None


def _signal(signal: Any) -> Signal:
    scale, offset = signal.scale, signal.offset
    if max(signal.start, signal.length) > MOST_BITS:
        raise ValueError(f"{signal.name}: {of_bits()}")
    if not (math.isfinite(scale) and math.isfinite(offset)):
        raise ValueError(f"signal {signal.name} has the scale {scale} and the offset {offset}")
    if not signal.is_float and float(scale).is_integer() and float(offset).is_integer():
        scale, offset = int(scale), int(offset)
    kind = RawKind.FLOAT if signal.is_float else RawKind.SIGNED if signal.is_signed else RawKind.UNSIGNED
    return Signal(
        name=signal.name,
        unit=signal.unit or "",
        start_bit=signal.start,
        length_bits=signal.length,
        big_endian=signal.byte_order == "big_endian",
        kind=kind,
        scale=scale,
        offset=offset,
        minimum=signal.minimum,
        maximum=signal.maximum,
        labels={int(value): str(text) for value, text in (signal.choices or {}).items()},
        multiplexer=signal.multiplexer_signal,
        multiplexer_ids=tuple(sorted(signal.multiplexer_ids or ())),
        comment=signal.comment or "",
    )


def load_for_vehicle(vehicle: VehicleConfig, folder: Path, *, lenient: bool = False) -> dict[str, tuple[Database, ...]]:
    """Load the DBCs of every ``[[bus]]`` of a vehicle, by bus name, and cross-check them; see `load_database`.

    Relative names start at `folder`, that of vehicle.toml; a bare name that is not there may be a shipped one. One file
    on several buses is loaded once. Raises DatabaseError with all faults of all files at once.
    """
    loaded: dict[str, Database] = {}
    faults: list[Fault] = []
    for name in dict.fromkeys(name for bus in vehicle.bus for name in bus.dbc):
        try:
            loaded[name] = load_database(_locate(name, folder), lenient=lenient)
        except DatabaseError as error:
            faults += error.faults
    DatabaseError.stop_if_any(faults)
    databases: dict[str, tuple[Database, ...]] = {}
    for bus in vehicle.bus:
        more = tuple(loaded[name] for name in bus.dbc)
        databases[bus.channel] = (*databases.get(bus.channel, ()), *more)
    messages_by_bus(databases)
    return databases


def no_bus_in_common(vehicle: VehicleConfig, buses: Collection[str]) -> str:
    """Return a note where no bus of a log is in vehicle.toml, else an empty text."""
    described = {bus.channel for bus in vehicle.bus}
    if not (described and buses) or described & set(buses):
        return ""
    return f"no bus of vehicle.toml ({', '.join(sorted(described))}) is in the log ({', '.join(buses)})"


def messages_by_bus(databases: Mapping[str, Sequence[Database]]) -> dict[str, dict[str, Message]]:
    """Merge the databases of each bus; the keys are the names by which channels and roles know the messages.

    A name that several identifiers of one bus carry gets the identifier behind it: ``STATUS@0x200``.

    Raises
    ------
    DatabaseError
        Lists every identifier that two databases of one bus lay out differently.
    """
    faults: list[Fault] = []
    merged = {bus: _merge(bus, files, faults) for bus, files in databases.items()}
    DatabaseError.stop_if_any(faults)
    return {bus: _named(list(messages.values())) for bus, messages in merged.items()}


def signals_of(databases: Mapping[str, Sequence[Database]]) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return the names of the signals by bus and message; raises as `messages_by_bus`."""
    merged = messages_by_bus(databases)
    return {(bus, name): tuple(m.by_name) for bus, known in merged.items() for name, m in known.items()}


def _merge(bus: str, files: Sequence[Database], faults: list[Fault]) -> dict[int, Message]:
    owner: dict[int, tuple[Message, str]] = {}
    for database in files:
        for message in database.messages:
            other, name = owner.setdefault(message.key, (message, database.name))
            if other != message:
                what = f"two DBCs lay out identifier {message.id_text()} differently"
                found = f"{other.name} in {name}, {message.name} in {database.name}"
                step = "give this bus only one of the two files, or take the message out of one"
                faults.append(Fault(what, f"bus {bus}", found, "one layout per identifier on a bus", step))
    return {key: message for key, (message, _) in owner.items()}


def _named(messages: list[Message]) -> dict[str, Message]:
    count = Counter(message.name for message in messages)
    return {(m.name if count[m.name] == 1 else f"{m.name}@{m.id_text()}"): m for m in messages}


def _locate(name: str, folder: Path) -> Path:
    path = folder / name
    if path.is_file() or Path(name).name != name:
        return path
    try:
        return shipped_dbc(name)
    except DatabaseError:
        return path
